"""Means, noise of a series, the central column: stated uncertainty against the true one. A second or two."""

from __future__ import annotations

import numpy as np
import pytest

from jumpvision.estimate.mean import difference_noise, weighted_mean
from jumpvision.films.grains.column import central_column


def test_the_sigma_of_a_mean_is_its_error():
    """2000 draws of 12 values with sigmas from 1 to 3: the scatter factor only widens, by about 0.2/sqrt(11), so the
    share within one sigma lies between 0.683 - 3 * 0.0104 and 0.74."""
    rng = np.random.default_rng(1)
    sigma = rng.uniform(1, 3, 12)
    inside = 0
    for _ in range(2000):
        m = weighted_mean(5 + sigma * rng.normal(size=12), sigma, "m")
        inside += abs(m.value - 5) < m.sigma
    assert 0.65 < inside / 2000 < 0.74


def test_a_mean_leaves_out_what_is_missing_and_widens_with_scatter():
    m = weighted_mean([1.0, np.nan, 3.0], [0.1, 0.1, 0.1], "m")
    assert (m.value, m.n) == (2.0, 2)
    assert m.sigma == pytest.approx(np.sqrt(200) * 0.1 / np.sqrt(2))  # chi2 = 200 with one degree of freedom
    assert weighted_mean([np.nan], [1.0], "m").reason == "no value"


def test_noise_of_a_smooth_series():
    """A jump of 30 mm at 200 frames/s under 0.05 mm of noise: the median of 350 third differences is good to 5 %."""
    rng = np.random.default_rng(2)
    t = np.arange(360) / 200
    smooth = 0.03 * np.sin(2 * np.pi * 2.0 * t) * (t > 0.5)
    noise = [difference_noise(smooth + rng.normal(0, 5e-5, t.size)) for _ in range(50)]
    assert np.mean(noise) == pytest.approx(5e-5, rel=0.1)
    assert difference_noise(smooth[:7]) == 0.0


def test_the_sigma_of_the_central_column_holds_the_overlap_of_windows(length=3):
    """Errors that are means of `length` independent pixels in a row, as those of windows overlapping by as much.

    400 fields of 30 rows: share within one sigma 0.683 +- 3 * 0.0043, rows being independent.
    """
    rng, inside = np.random.default_rng(3), []
    x = np.linspace(-0.03, 0.03, 25)
    for _ in range(400):
        pixels = rng.normal(size=(30, x.size + length - 1))
        error = np.stack([pixels[:, i : i + length].mean(axis=1) for i in range(x.size)], axis=1) * np.sqrt(length)
        valid, how = rng.random(error.shape) > 0.05, {"half_width": 0.006, "correlation_length": length}
        speed, sigma = central_column(-0.5 + 0.01 * error, np.full(error.shape, 0.01), valid, x, **how)
        inside.append(np.abs(speed - 0.5) < sigma)
    assert np.mean(inside) == pytest.approx(0.683, abs=0.013)
