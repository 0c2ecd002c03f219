"""Films of the laboratory: lens, corners and glare; the quick grain film against the slow one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from jumpvision.laboratory.films.flow import Flow
from jumpvision.laboratory.films.grains import GrainScene, QuickGrainScene, View, carry
from jumpvision.laboratory.films.optics import Lens, distorted, lens_of, margin, record_bright, reflection, shade


def test_a_lens_moves_a_picture_as_its_formula_says():
    """Waves of 12 px, drawn where the formula puts each pixel: a cubic spline is within 1 % of their amplitude."""
    shape, lens = (120, 90), Lens(2e-6, 1e-10, 59.5, 44.5)
    m = margin(shape, lens)
    assert 6 < m < 60

    def waves(row, column):
        return np.sin(2 * np.pi * row / 12.0) + np.cos(2 * np.pi * column / 12.0)

    wide = waves(*(a - m for a in np.mgrid[: shape[0] + 2 * m, : shape[1] + 2 * m].astype(float)))
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    r2 = (y - lens.row) ** 2 + (x - lens.column) ** 2
    more = 1 + lens.k1 * r2 + lens.k2 * r2**2
    seen = waves(lens.row + (y - lens.row) * more, lens.column + (x - lens.column) * more)
    np.testing.assert_allclose(distorted(wide, lens, shape), seen, atol=0.01)
    assert np.abs(seen - waves(y, x)).max() > 0.5
    plain = np.ones(shape)
    assert distorted(plain, lens_of(0.0, 0.0, shape), shape) is plain


def test_corners_and_glare():
    light = shade((30, 50), 0.4)
    assert light[0, 0] == pytest.approx(0.6) and light.max() == pytest.approx(1.0, abs=1e-3)
    spot = reflection((101, 101), 25.0)
    assert 24.9 < spot.max() <= 25.0 and spot[0, 0] < 0.01


VIEW = View((220, 310), 3e-4, 42.0, 150.0)


@pytest.fixture(scope="module")
def flow() -> Flow:
    return Flow(0.0381, 2.0, math.pi / 3, 2.7, math.radians(45.0), 0.008, (0.0062, 0.031))


def test_grains_are_carried_as_by_many_small_steps(flow):
    """Against midpoint steps of 2 um, which err by 2 um x 0.3 where a grain joins the cone; the closed form takes the
    cut-off width in the middle of 0.4 mm, whose second order is (0.4 mm)^2/24 x 20/m = 0.1 um; rounded up to 4 um."""
    rng = np.random.default_rng(5)
    r = rng.uniform(-0.07, 0.07, 800)
    y = rng.uniform(-0.12, -0.001, 800)
    y = np.where(np.abs(r) < flow.R, np.minimum(y, -0.0065), y)
    fine, quick = y.copy(), y.copy()
    flow.advect(r, fine, 0.0062, 0.0185, max_step=2e-6)
    carry(flow, r, quick, 0.0062, 0.0185)
    assert np.ptp(quick - y) > 0.01
    np.testing.assert_allclose(quick, fine, atol=4e-6)
    parts = y.copy()
    for a, b in ((0.0062, 0.0064), (0.0064, 0.0131), (0.0131, 0.0185)):
        carry(flow, r, parts, a, b)
    np.testing.assert_allclose(parts, quick, atol=2e-6)  # another choice of middles


def test_pictures_agree(flow):
    """A foot that sinks, rests and retreats: the same picture but for single precision (1e-4 of 200 grey) and grains
    carried by other steps (up to 9 um = 0.03 px of a few of them, at edges of 100 grey/px: 3 grey)."""
    cameras = [
        kind(VIEW, flow, 0.0062, diameter=1e-3, spread=0.15, rng=np.random.default_rng(6))
        for kind in (GrainScene, QuickGrainScene)
    ]
    for z in (0.0062, 0.0071, 0.0093, 0.0093, 0.0081):
        slow, quick = (c.frame(np.array([z])) for c in cameras)
        assert np.abs(quick - slow).max() < 4.0
        assert (quick - slow).std() < 0.1
        assert slow[60:].std() > 15
    # 0.6 px in the exposure: two instants for the slow film's eight give the same spread to 2 % of a pixel, 2 grey more
    slow, quick = (c.frame(0.0095 + np.linspace(0.0, 1.8e-4, 8)) for c in cameras)
    assert np.abs(quick - slow).max() < 6.0 and (quick - slow).std() < 0.5


@pytest.mark.parametrize("grey", [20.0, 150.0])
def test_noise_of_bright_pixels(grey):
    """Mean and variance as `record`: 200,000 pixels give the variance to 0.3 %, asked within 2 %."""
    image = record_bright(np.full((400, 500), grey), electrons_per_grey=60.0, read_noise=1.0,
                          rng=np.random.default_rng(3))  # fmt: skip
    want = grey / 60 + 1.0 + 1 / 12
    assert image.dtype == np.uint8
    assert image.astype(float).var() == pytest.approx(want, rel=0.02)
    assert image.mean() == pytest.approx(grey, abs=5 * math.sqrt(want / image.size))
