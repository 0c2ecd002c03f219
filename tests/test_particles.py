"""Drawn Brownian particles of known D: places, drift, mean squared displacement, diffusion coefficient and sigmas."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtr

import jumpvision as jv
from jumpvision.base.schema import InputError

N, SHAPE, WIDTH, NOISE = 40, (220, 260), 1.8, 4.0
D, DRIFT = 0.4, (0.25, -0.1)  # px^2 and px a frame


def brownian(rng):
    """(particles, N, 2) from a grid whose cells they do not leave; the drift in it."""
    grid = np.stack(np.meshgrid(np.arange(25, 240, 30.0), np.arange(30, 200, 30.0)), -1).reshape(-1, 1, 2)
    steps = rng.normal(0, np.sqrt(2 * D), (len(grid), N - 1, 2)) + DRIFT
    return grid + np.concatenate([np.zeros_like(grid), np.cumsum(steps, axis=1)], axis=1)


def drawn(at, rng):
    """Each pixel takes a Gaussian spot's integral over it: no sub-pixels, no value at its middle."""
    edges = [np.arange(n + 1) - 0.5 for n in SHAPE]
    out = np.full(SHAPE, 40.0)
    for x, y in at:
        out += 2500.0 * np.outer(np.diff(ndtr((edges[0] - y) / WIDTH)), np.diff(ndtr((edges[1] - x) / WIDTH)))
    return np.clip(np.rint(out + rng.normal(0, NOISE, SHAPE)), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def measured():
    pytest.importorskip("trackpy", reason="jv.particles needs trackpy: pip install 'jumpvision[particles]'")
    rng = np.random.default_rng(11)
    truth = brownian(rng)
    frames = np.array([drawn(truth[:, i], rng) for i in range(N)])
    return truth, jv.particles(frames, diameter=9, frame_rate=50.0, scale=2e-7, search=6.0)


def test_places_and_their_sigma(measured):
    """48 particles x 40 frames, two axes: 3,840 errors. The share within sigma is known to 0.8 % (three: 2.3 %); sigma
    is the larger of two that are nearly alike."""
    truth, found = measured
    t = found.tracks
    away = np.hypot(
        t.x_px.to_numpy()[:, None] - truth[:, t.frame, 0].T, t.y_px.to_numpy()[:, None] - truth[:, t.frame, 1].T
    )
    assert t.particle.nunique() == len(truth) and len(t) > 0.98 * truth.shape[0] * N
    own = away.argmin(axis=1)
    error = np.stack([t.x_px, t.y_px], 1) - truth[own, t.frame]
    assert np.abs(error).max() < 6 * t.sigma_px.max()
    assert abs(np.mean(np.abs(error) < t.sigma_px.to_numpy()[:, None]) - 0.70) < 0.05
    assert np.allclose(t.x_m, t.x_px * 2e-7) and np.allclose(t.y_m, -t.y_px * 2e-7)


def test_drift_displacement_and_diffusion(measured):
    """The mean step of 48 particles scatters by sqrt(2 D / 48); a sum of 39 by sqrt(39) as much. The squared
    displacements at one lag are 4 D t + 4 sigma^2, less 1/48 that the drift takes; 1,872 steps of two axes know it to
    sqrt(1 / 1872)."""
    truth, found = measured
    px2 = (2e-7) ** 2
    end = found.drift.iloc[-1]
    scatter = np.sqrt(2 * D * (N - 1) / len(truth))
    assert abs(end.x_m / 2e-7 - DRIFT[0] * (N - 1)) < 4 * scatter
    assert abs(-end.y_m / 2e-7 - DRIFT[1] * (N - 1)) < 4 * scatter
    first = found.msd.msd_m2[0] / px2
    expected = (1 - 1 / len(truth)) * (4 * D + 4 * float(np.mean(found.tracks.sigma_px**2)))
    assert abs(first / expected - 1) < 4 / np.sqrt(len(truth) * (N - 1))
    assert found.msd.lag_s[0] == 0.02 and len(found.msd) == N // 4
    d = D * px2 * 50.0
    assert abs(found.diffusion - d) < 3 * found.diffusion_sigma + d / len(truth)
    assert found.diffusion_sigma < 0.1 * d


def test_a_bad_call_is_refused_by_name():
    with pytest.raises(InputError, match="diameter = 8: must be odd"):
        jv.particles(np.zeros((3, 40, 40)), diameter=8)
    with pytest.raises(InputError, match="polarity = 'grey'"):
        jv.particles(np.zeros((3, 40, 40)), polarity="grey")
