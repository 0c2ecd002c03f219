"""Straight lines, the packing theory and the record of a fit."""

import json
import math

import numpy as np
import pytest

from jumpvision.estimate.estimate import Estimate, fit_line, least_squares_fit, radius_exponent
from jumpvision.films.grains.cone import cone_growth
from jumpvision.films.grains.front import fit_mu


def test_sigmas_of_a_line_are_its_true_errors():
    rng, z, c = np.random.default_rng(0), [], []
    x = np.linspace(-1.0, 4.0, 40)
    for _ in range(1500):
        s = rng.uniform(0.1, 1.0, x.size)
        line = fit_line(x, 2.0 - 0.7 * x + rng.normal(0.0, s), s)
        at, at_sigma = line.at(3.0)
        z.append(
            [(line.slope + 0.7) / line.slope_sigma, (at + 0.1) / at_sigma, (line.intercept - 2) / line.intercept_sigma]
        )
        c.append(line.chi2)
    # 0.683 +- 3 * 0.012, and up to 0.02 more because the scatter factor only widens
    assert np.all(np.abs(np.mean(np.abs(z) < 1.0, axis=0) - 0.69) < 0.045)
    assert np.mean(c) == pytest.approx(38.0, abs=3.0 * math.sqrt(2.0 * 38.0 / 1500))


def test_stray_frames_do_not_move_mu():
    rng, z = np.random.default_rng(2), []
    x = np.linspace(0.0, 1.0, 40)
    for _ in range(300):
        y = 2.2 * x + rng.normal(0.0, 0.05, x.size)
        y[rng.choice(40, 4, replace=False)] += rng.uniform(2.0, 5.0, 4)
        line = fit_mu(x, y, np.full(40, 0.05))
        z.append((line.slope - 2.2) / line.slope_sigma)
    assert abs(np.mean(np.abs(z) < 1.0) - 0.68) < 0.09  # 3 * 0.027
    assert abs(np.mean(z)) < 3.0 / math.sqrt(300)


def test_nothing_to_fit_is_a_value_and_a_bad_sigma_an_error():
    assert math.isnan(fit_line([1.0, 1.0], [2.0, 3.0], [1.0, 1.0]).slope)
    assert fit_line([1.0, np.nan], [2.0, 3.0], [1.0, 1.0]).reason
    with pytest.raises(ValueError, match=r"sigma\[1\] = 0"):
        fit_line([1.0, 2.0], [2.0, 3.0], [1.0, 0.0])
    x = np.linspace(0.0, 1.0, 9)
    assert least_squares_fit(lambda p: x - (p[0] + p[1]) * x, [0.2, 0.3]) is None


def test_entry_has_exactly_the_keys_of_the_contract_and_no_nan():
    entry = Estimate(math.nan, 1.0, "m", 3, 2.0, "why").entry()
    assert entry == {
        "value": None,
        "sigma": 1.0,
        "sigma_common": 0.0,
        "unit": "m",
        "n": 3,
        "chi2": 2.0,
        "reason": "why",
    }
    assert "reason" not in Estimate(2.0, 1.0, "m", 3, 2.0).entry()
    again = Estimate.of_entry(json.loads(json.dumps(entry, allow_nan=False)))
    assert again.entry() == entry and math.isnan(again.value) and not again.known


def test_growth_of_the_cone_at_the_thesis_packing():
    cone = cone_growth(0.57, 0.605)
    assert math.degrees(cone.beta_jammed) == pytest.approx(54.74, abs=0.005)
    assert math.degrees(cone.beta_unjammed) == pytest.approx(60.08, abs=0.02)  # 60.07 from 54.736, printed from 54.72
    assert math.degrees(cone.beta) == pytest.approx(57.4, abs=0.05)
    assert cone.mu == pytest.approx(2.565, abs=0.0005)
    for phi in (0.605, 0.4):
        with pytest.raises(ValueError, match="volume_fraction"):
            cone_growth(phi, 0.605)


def test_the_sigma_of_a_power_of_the_foots_radius_is_its_error():
    """Three feet in each of three beds, F = c(bed) r^2 with trials that differ by 3 % where each states 0.1 %: what is
    left has 9 - 3 - 1 freedoms, so that one sigma of Student's t with five holds 0.637. 1500 draws: +- 3 * 0.0125."""
    rng, inside = np.random.default_rng(3), []
    radius, bed = np.tile([0.02, 0.03, 0.05], 3), np.repeat([0.57, 0.59, 0.61], 3)
    force = 2e6 * (bed - 0.5) * radius**2
    for _ in range(1500):
        n = radius_exponent(radius, force * np.exp(0.03 * rng.standard_normal(9)), 1e-3 * force, bed)
        inside.append(abs(n.value - 2.0) < n.sigma)
    assert np.mean(inside) == pytest.approx(0.637, abs=0.038)
