"""What jv.piv, jv.track and jv.bed take for images: numbers of any kind, gain and offset give one result, or a word.

Truth: the same picture written in another way is the same picture. Bounds: whole numbers are exact; decimals are
brought to one contrast by a power of 2, so what is left is the rounding of float32, 2^-24 of 255 grey.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy

import jumpvision as jv
from jumpvision.base.schema import InputError

ROUNDING = 1e-5  # px


@pytest.fixture(scope="module")
def pair():
    """Two pictures of a speckle moved by (-2.4, 1.3) px, never square, 8 bits."""
    rng = np.random.default_rng(0)
    face = scipy.ndimage.gaussian_filter(rng.normal(0.0, 1.0, (96, 124)), 1.3)
    face = 10.0 + 220.0 * (face - face.min()) / np.ptp(face)
    moved = scipy.ndimage.shift(face, (1.3, -2.4), order=5)
    return tuple(np.rint(f[10:-10, 10:-10].clip(0, 255)).astype(np.uint8) for f in (face, moved))


@pytest.fixture(scope="module")
def field(pair):
    return jv.piv(*pair, window=32, step=16)


@pytest.fixture(scope="module")
def frames():
    """A dark ball of 12 px that moves by 1.3 px a frame."""
    y, x = np.mgrid[:64, :80]
    film = [200.0 - 160.0 / (1.0 + np.exp(2.0 * (np.hypot(x - 30.2 - 1.3 * i, y - 32.0) - 6.0))) for i in range(8)]
    return np.rint(film).astype(np.uint8)


WRITTEN = {
    "big-endian": (lambda a: a.astype(">u2"), 0.0),
    "big-endian decimals": (lambda a: a.astype(">f4"), ROUNDING),
    "half precision": (lambda a: a.astype(np.float16), ROUNDING),
    "signed": (lambda a: a.astype(np.int16), ROUNDING),
    "long": (lambda a: a.astype(np.int64), ROUNDING),
    "columns first": (np.asfortranarray, 0.0),
    "turned view": (lambda a: a[..., ::-1].copy()[..., ::-1], 0.0),
    "from 0 to 1": (lambda a: a / 255.0, ROUNDING),
    "faint": (lambda a: 0.05 * a, ROUNDING),
    "bright": (lambda a: 1e6 * a, ROUNDING),
    "an offset": (lambda a: a + 1e5, ROUNDING),
    "below zero": (lambda a: a - 128.0, ROUNDING),
}


@pytest.mark.parametrize("how", WRITTEN)
def test_a_field_does_not_depend_on_how_pictures_are_written(pair, field, how):
    write, bound = WRITTEN[how]
    other = jv.piv(*map(write, pair), window=32, step=16)
    for name in ("u", "v", "u_sigma", "v_sigma"):
        np.testing.assert_allclose(other[name], field[name], rtol=1e-4, atol=bound)


@pytest.mark.parametrize("how", WRITTEN)
def test_a_track_does_not_depend_on_how_pictures_are_written(frames, how):
    write, bound = WRITTEN[how]
    one, other = (jv.track(f, diameter=12, polarity="dark") for f in (frames, write(frames)))
    assert (one.flag == "").all() and (other.flag == "").all()
    # decimals: rounded otherwise, the fit ends elsewhere within its tolerance, far inside sigma
    allowed = 0.2 * float(one.sigma_px.min()) if bound else 0.0
    np.testing.assert_allclose(other[["x_px", "y_px"]], one[["x_px", "y_px"]], rtol=0.0, atol=allowed)


def test_a_mirrored_or_transposed_or_swapped_pair_moves_the_other_way(pair, field):
    """Windows of a picture whose sides are whole steps lie on each other when it is mirrored: equal to their sigma."""
    a, b = pair
    mean = {k: float(field[k].mean()) for k in ("u", "v")}
    bound = 4.0 * float(field.u_sigma.mean()) / np.sqrt(field.u.size)
    for one, other, u, v in (
        (a[:, ::-1], b[:, ::-1], -mean["u"], mean["v"]),
        (a[::-1], b[::-1], mean["u"], -mean["v"]),
        (a.T, b.T, -mean["v"], -mean["u"]),
        (b, a, -mean["u"], -mean["v"]),
    ):
        turned = jv.piv(one, other, window=32, step=16)
        assert abs(float(turned.u.mean()) - u) < bound and abs(float(turned.v.mean()) - v) < bound


def test_masked_and_infinite_pixels_are_left_out(pair):
    """Of a field no vector lies wholly on them; the others are as without."""
    a, b = (p.astype(float) for p in pair)
    hidden = np.zeros(a.shape, bool)
    hidden[:40] = True
    masked = jv.piv(*(np.ma.array(p, mask=hidden) for p in (a, b)), window=16, step=8)
    given = jv.piv(a, b, mask=~hidden, window=16, step=8)
    np.testing.assert_array_equal(masked.u, given.u)
    assert np.isnan(masked.u.to_numpy()).any()
    a[5, 7], b[40, 60] = np.inf, np.nan
    assert np.isfinite(jv.piv(a, b, window=32, step=16).u).all()


@pytest.mark.parametrize("call", ["track", "bed"])
def test_what_reads_every_pixel_refuses_masked_ones(frames, call):
    film = np.ma.array(frames, mask=np.zeros(frames.shape, bool))
    film.mask[2, 5, 7] = True
    ask = {"track": lambda f: jv.track(f, diameter=12), "bed": lambda f: jv.bed(f, floor_row=60.0)}[call]
    with pytest.raises(ValueError, match=r"frame 2 has 1 pixels that are masked .* in row 5, column 7"):
        ask(film)


def test_a_field_without_a_vector_is_an_error(pair):
    with pytest.raises(ValueError, match=r"no vector in the field: .* x no texture in the window"):
        jv.piv(*(np.zeros_like(p) for p in pair))


@pytest.mark.parametrize("scale", [(1, 2), 0.5, True, 0.0, float("nan"), "0.001"])
def test_a_scale_is_a_number_of_metres_a_pixel(pair, frames, scale):
    for call in (lambda: jv.piv(*pair, scale=scale), lambda: jv.track(frames, diameter=12, scale=scale)):
        with pytest.raises(InputError, match=r"scale = .*: must be a number in \(0, 0.01\] m per pixel"):
            call()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (lambda a: np.dstack([a] * 3), "frame 0 has shape .*: make it grey"),
        (lambda a: a.astype(complex), "frame 0 holds complex128"),
        (lambda a: a[:, :10], "images of different sizes"),
    ],
)
def test_what_is_no_grey_image_is_refused_by_its_frame(pair, given, words):
    a, b = pair
    with pytest.raises(ValueError, match=words):
        jv.piv(given(a), b)
