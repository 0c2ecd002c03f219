"""No result depends on how pictures are written, turned or inverted; for piv, track and bed.

A picture written in another way (type, order of bytes, layout, gain, offset) holds the same light: whole numbers give
the same bits, decimals what float32 rounds, 2^-24 of 255 grey beside a noise of one grey: 1e-3 sigma. A turned picture
of a ball or a bed gives the same sums in another order: 1e-6 sigma. Vectors of a picture of whole steps lie on each
other when it is turned, but splines take rows and columns in turn, half a dozen steps long: 0.2 sigma.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
import scipy

import jumpvision as jv
from jumpvision.base.arrays import AnyArray, Array
from jumpvision.base.schema import InputError
from jumpvision.films.parameters import SMALLEST_BALL

Write = Callable[[AnyArray], AnyArray]
WRITTEN: dict[str, tuple[Write, float]] = {  # how, and the greatest difference over sigma
    "uint16, 257 times": (lambda a: a.astype(np.uint16) * np.uint16(257), 1e-3),
    "float64": (lambda a: a.astype(float), 1e-3),
    "float16": (lambda a: a.astype(np.float16), 1e-3),
    "big-endian": (lambda a: a.astype(">u2"), 0.0),
    "columns first": (np.asfortranarray, 0.0),
    "a turned view": (lambda a: a[..., ::-1].copy()[..., ::-1], 0.0),
    "gain 1/255": (lambda a: a / 255.0, 1e-3),
    "offset 1e5": (lambda a: a + 1e5, 1e-3),
    "below zero": (lambda a: a - 128.0, 1e-3),
}


class Turn(NamedTuple):
    """How a stack (n, rows, columns) is changed, and how a place and a motion of it come back."""

    change: Write
    place: Callable[[Array, Array, int, int], tuple[Array, Array]]  # x, y, rows, columns
    motion: Callable[[Array, Array], tuple[Array, Array]]  # of the picture, y down
    lies: bool = False  # whether windows come to lie elsewhere


TURNS = {
    "mirror": Turn(lambda a: a[..., ::-1], lambda x, y, r, c: (c - 1 - x, y), lambda u, v: (-u, v), True),
    "upside down": Turn(lambda a: a[..., ::-1, :], lambda x, y, r, c: (x, r - 1 - y), lambda u, v: (u, -v), True),
    "transpose": Turn(lambda a: a.swapaxes(-1, -2), lambda x, y, r, c: (y, x), lambda u, v: (v, u), True),
    "swap": Turn(lambda a: a[::-1], lambda x, y, r, c: (x, y), lambda u, v: (-u, -v)),
    "invert": Turn(lambda a: 255 - a, lambda x, y, r, c: (x, y), lambda u, v: (u, v)),
}
VECTOR, BALL, BED = 0.2, 1e-6, 1e-6  # of sigma, for turned pictures


def speckle(seed: int = 0) -> AnyArray:
    """Two pictures of a speckle that moves by (-2.4, 1.3) px and turns a little, 97 x 129 px, 8 bits; mirrored, its
    windows lie on each other."""
    rng = np.random.default_rng(seed)
    face = scipy.ndimage.gaussian_filter(rng.normal(0.0, 1.0, (117, 149)), 1.3)
    face = 20.0 + 200.0 * (face - face.min()) / np.ptp(face)
    y, x = np.mgrid[:117, :149].astype(float)
    moved = scipy.ndimage.map_coordinates(face, [y - 1.3 + 0.004 * x, x + 2.4 - 0.004 * y], order=5, mode="nearest")
    both = np.stack([f[10:-10, 10:-10] for f in (face, moved)]) + rng.normal(0.0, 1.5, (2, 97, 129))
    return np.rint(both.clip(0, 255)).astype(np.uint8)


def ball(seed: int = 0) -> AnyArray:
    """A dark ball of 12 px before a scene, moving by 1.3 px a frame, 64 x 90 px."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:64, :90]
    scene = 170.0 + 12.0 * scipy.ndimage.gaussian_filter(rng.normal(0.0, 1.0, (64, 90)), 3.0) * 6.0
    inside = [scipy.special.ndtr((6.0 - np.hypot(x - 25.2 - 1.3 * i, y - 32.3)) / 0.8) for i in range(10)]
    film = np.array([scene + (40.0 - scene) * e for e in inside]) + rng.normal(0.0, 2.0, (10, 64, 90))
    return np.rint(film.clip(0, 255)).astype(np.uint8)


def bed(seed: int = 0) -> AnyArray:
    """A bed below bright air, its surface at row 40 with waves, 100 x 120 px."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:100, :120]
    surface = 40.3 + 1.5 * np.sin(0.1 * x) + 0.02 * x
    image = 230.0 - 190.0 * scipy.special.ndtr((y - surface) / 1.2) + rng.normal(0.0, 3.0, y.shape)
    return np.rint(image.clip(0, 250)).astype(np.uint8)[None]


def vectors(pair: AnyArray) -> tuple[Array, Array, Array]:
    """u, v (y down) and sigma, (rows, columns) from the picture's top left."""
    f = jv.piv(*pair, window=32, step=16).sortby("x").sortby("y", ascending=False)
    return f.u.values, -f.v.values, f.u_sigma.values


def off_field(pair: AnyArray, changed: AnyArray, turn: Turn | None = None) -> float:
    """Greatest difference of a vector over its sigma, on vectors that both have."""
    u, v, sigma = vectors(pair)
    a, b, _ = vectors(changed)
    if turn is not None:
        back = turn.change if turn.lies else lambda f: f
        a, b = turn.motion(back(a), back(b))
    return float(np.nanmax(np.hypot(a - u, b - v) / sigma))


def off_track(film: AnyArray, changed: AnyArray, turn: Turn | None = None) -> float:
    """The same of a ball's places, by frame."""
    rows, columns = film.shape[1:]
    one = jv.track(film, diameter=12, polarity="dark")
    other = jv.track(changed, diameter=12, polarity="bright" if turn is TURNS["invert"] else "dark")
    if (one.flag != "").any() or (other.flag != "").any():
        return np.inf
    x, y = other.x_px.to_numpy(), other.y_px.to_numpy()
    if turn is not None:
        x, y = turn.place(x, y, rows, columns)
    return float((np.hypot(x - one.x_px, y - one.y_px) / one.sigma_px).max())


def off_bed(picture: AnyArray, changed: AnyArray) -> float:
    """The same of a bed's height."""
    one, other = (jv.bed(p, floor_row=95.0).iloc[0] for p in (picture, changed))
    return abs(float(other.height_px - one.height_px)) / float(one.sigma_px)


def test_how_a_picture_is_written_changes_nothing():
    pair, film, picture = speckle(), ball(), bed()
    for how, (write, bound) in WRITTEN.items():
        assert off_field(pair, write(pair)) <= bound, how
        assert off_track(film, write(film)) <= bound, how
        assert off_bed(picture, write(picture)) <= bound, how


def test_how_a_picture_is_turned_changes_nothing():
    pair, film, picture = speckle(), ball(), bed()
    for how, turn in TURNS.items():
        assert off_field(pair, turn.change(pair), turn) <= VECTOR, how
        if how != "swap":  # a tracker learns radius and blur as it goes: a film run backwards is another one
            assert off_track(film, turn.change(film), turn) <= BALL, how
    assert off_bed(picture, TURNS["mirror"].change(picture)) <= BED


def test_the_smallest_ball_has_one_size():
    """keys.md named 3 px, the tracker refused 6: what the parameters allow, the tracker takes."""
    film = ball()
    with pytest.raises(InputError, match=r"diameter = 5.9: must be in \[6, 2000\] px"):
        jv.track(film, diameter=5.9, polarity="dark")
    assert SMALLEST_BALL == 6.0 and len(jv.track(film[:2], diameter=SMALLEST_BALL, polarity="dark")) == 2


def test_masked_and_infinite_pixels_are_left_out_or_refused():
    """Of a field no vector lies wholly on them, the others are as without; a track and a bed read every pixel."""
    a, b = speckle().astype(float)
    hidden = np.zeros(a.shape, bool)
    hidden[:40] = True
    masked = jv.piv(*(np.ma.array(p, mask=hidden) for p in (a, b)), window=16, step=8)
    np.testing.assert_array_equal(masked.u, jv.piv(a, b, mask=~hidden, window=16, step=8).u)
    assert np.isnan(masked.u.to_numpy()).any()
    a[5, 7], b[40, 60] = np.inf, np.nan
    assert np.isfinite(jv.piv(a, b, window=32, step=16).u).all()
    film = np.ma.array(ball(), mask=np.zeros((10, 64, 90), bool))
    film.mask[2, 5, 7] = True
    for ask in (lambda f: jv.track(f, diameter=12), lambda f: jv.bed(f, floor_row=60.0)):
        with pytest.raises(ValueError, match=r"frame 2 has 1 pixels that are masked .* in row 5, column 7"):
            ask(film)


def test_what_is_no_grey_image_or_no_scale_is_refused():
    a, b = speckle()
    for scale in ((1, 2), 0.5, True, 0.0, float("nan"), "0.001"):
        for call in (lambda s: jv.piv(a, b, scale=s), lambda s: jv.track(ball(), diameter=12, scale=s)):
            with pytest.raises(InputError, match=r"scale = .*\(0, 0.01\] m per pixel"):
                call(scale)
    for given, words in ((np.dstack([a] * 3), "frame 0 has shape"), (a.astype(complex), "frame 0 holds complex128"),
                         (a[:, :10], "different sizes"), (np.zeros_like(a), "no vector in the field")):  # fmt: skip
        with pytest.raises(ValueError, match=words):
            jv.piv(given, b if given.any() else given)
