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
    "big-endian decimals": (lambda a: a.astype(">f4"), ROUNDING),
    "half precision": (lambda a: a.astype(np.float16), ROUNDING),
    "turned view": (lambda a: a[..., ::-1].copy()[..., ::-1], 0.0),
    "from 0 to 1": (lambda a: a / 255.0, ROUNDING),
    "bright": (lambda a: 1e6 * a, ROUNDING),
    "an offset": (lambda a: a + 1e5, ROUNDING),
    "below zero": (lambda a: a - 128.0, ROUNDING),
}


def test_a_field_does_not_depend_on_how_pictures_are_written(pair, field):
    for how, (write, bound) in WRITTEN.items():
        other = jv.piv(*map(write, pair), window=32, step=16)
        for name in ("u", "v", "u_sigma", "v_sigma"):
            np.testing.assert_allclose(other[name], field[name], rtol=1e-4, atol=bound, err_msg=how)


def test_a_track_does_not_depend_on_how_pictures_are_written(frames):
    one = jv.track(frames, diameter=12, polarity="dark")
    for how, (write, bound) in WRITTEN.items():
        other = jv.track(write(frames), diameter=12, polarity="dark")
        assert (one.flag == "").all() and (other.flag == "").all(), how
        # decimals: rounded otherwise, the fit ends elsewhere within its tolerance, far inside sigma
        allowed = 0.2 * float(one.sigma_px.min()) if bound else 0.0
        np.testing.assert_allclose(other[["x_px", "y_px"]], one[["x_px", "y_px"]], rtol=0.0, atol=allowed, err_msg=how)


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


def test_what_reads_every_pixel_refuses_masked_ones(frames):
    film = np.ma.array(frames, mask=np.zeros(frames.shape, bool))
    film.mask[2, 5, 7] = True
    for ask in (lambda f: jv.track(f, diameter=12), lambda f: jv.bed(f, floor_row=60.0)):
        with pytest.raises(ValueError, match=r"frame 2 has 1 pixels that are masked .* in row 5, column 7"):
            ask(film)


def test_what_is_no_grey_image_or_no_scale_is_refused(pair, frames):
    a, b = pair
    for scale in ((1, 2), 0.5, True, 0.0, float("nan"), "0.001"):
        for call in (lambda s: jv.piv(a, b, scale=s), lambda s: jv.track(frames, diameter=12, scale=s)):
            with pytest.raises(InputError, match=r"scale = .*\(0, 0.01\] m per pixel"):
                call(scale)
    for given, words in (
        (np.dstack([a] * 3), "frame 0 has shape"), (a.astype(complex), "frame 0 holds complex128"),
        (a[:, :10], "different sizes"), (np.zeros_like(a), "no vector in the field"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=words):
            jv.piv(given, b if given.any() else given)
