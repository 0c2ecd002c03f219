"""The film of discs: pixels hold the area-weighted light, the exposure is a mean, the noise is the stated one."""

from __future__ import annotations

import numpy as np
import pytest

from jumpvision.laboratory.films.discs import GAP, LIT, DiscCamera, draw_discs, draw_foot, soften
from jumpvision.laboratory.films.optics import blur


def camera(n=3, shape=(60, 80), seed=0, **how):
    options = {"scale": 1e-4, "surface_row": 10.0, "axis_column": 39.5, "half_width": 1e-3, "height": 8e-4}
    options |= {"glare": 20.0} | how
    return DiscCamera(shape, np.full(n, 4e-4), rng=np.random.default_rng(seed), **options)


@pytest.mark.parametrize("seed", range(4))
def test_a_disc_covers_pixels_by_area(seed):
    """Against 16 x 16 points a pixel of the same shading; the cover of a rim taken as straight errs by 1/(8 r)."""
    rng = np.random.default_rng(seed)
    r, c0, r0 = rng.uniform(2.5, 6.0), *rng.uniform(12.0, 14.0, 2)
    image = np.full((27, 31), GAP, np.float32)
    draw_discs(image, np.array([c0]), np.array([r0]), np.array([[r, 120.0, 0, 0, 0, 0, 0, 0]], np.float32))
    at = (np.arange(16) + 0.5) / 16 - 0.5
    down, across = (np.arange(n)[:, None] + at for n in image.shape)
    b, a = np.meshgrid(down.ravel() - r0, across.ravel() - c0, indexing="ij")
    tone = 120.0 * (1 - LIT[0] * (a * a + b * b) / r**2 + LIT[1] * a / r + LIT[2] * b / r)
    truth = np.where(a * a + b * b < r * r, tone, GAP).reshape(27, 16, 31, 16).mean(axis=(1, 3))
    assert np.sqrt(np.mean((image - truth)[np.abs(truth - GAP) > 0.1] ** 2)) < 0.05 * 120.0
    assert image.sum() - GAP * image.size == pytest.approx(truth.sum() - GAP * truth.size, rel=0.02)


def test_the_foots_face_moves_in_parts_of_a_pixel():
    body = np.full((20, 40), 60.0, np.float32)
    for face in (15.0, 15.25, 15.5, 16.1):
        image = np.full((40, 40), 100.0, np.float32)
        draw_foot(image, face, face - 8.0, 20.0, 6.0, body)
        covered = (100.0 - image[9:, 20]).sum() / 40.0
        assert covered == pytest.approx(face + 0.5 - 9.0, abs=1e-5)
        assert np.all(image[:, :12] == 100.0)


def test_an_exposure_is_the_mean_of_its_instants():
    c = camera(glare=0.0)
    x, y = np.array([[0.0, 1e-3, -1e-3], [2e-4, 1e-3, -1e-3]]), np.full((2, 3), -2e-3)
    both = c.frame(x, y, np.zeros(2))
    each = [c.frame(x[k : k + 1], y[k : k + 1], np.zeros(1)) for k in range(2)]
    assert both == pytest.approx(np.mean(each, axis=0), abs=1e-3)
    assert np.abs(each[0] - each[1]).max() > 10.0


def test_the_glare_stands_still_on_the_glass():
    x, y = np.zeros((1, 3)), np.full((1, 3), -2e-3)
    plain, bright = camera(glare=0.0).frame(x, y, np.zeros(1)), camera(glare=20.0).frame(x, y, np.zeros(1))
    assert 15.0 < (bright - plain).max() <= 20.0


def test_the_lens_is_the_laboratorys_gaussian():
    image = np.random.default_rng(0).uniform(0, 200, (30, 41)).astype(np.float32)
    assert soften(image, 0.55) == pytest.approx(blur(image, 0.55), abs=1e-3)


@pytest.mark.parametrize("grey", [20.0, 150.0])
def test_the_noise_has_the_stated_variance(grey):
    """20,000 pixels: the variance is known to sqrt(2/n) = 1 %; 4 of it allowed."""
    mean = np.full((100, 200), grey, np.float32)
    got = camera().record(mean, electrons_per_grey=30.0, read_noise=1.2, rng=np.random.default_rng(1))
    assert got.mean() == pytest.approx(grey, abs=4 * np.sqrt((grey / 30 + 1.5) / mean.size))
    assert got.var() == pytest.approx(grey / 30.0 + 1.44 + 1 / 12, rel=0.04)
