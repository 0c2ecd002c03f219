"""Laws of the bed against phi and the granular sweeps: laws drawn and fitted back, axes, files, figures, bad calls.

Truth: laws drawn with known noise, the coverage of their stated uncertainties; jump.simulate with parameters put in by
hand for a point of a sweep; equations (32) and (33) for scaling. About 20 s on one core.
"""

import dataclasses
import functools
import json
import math
import os
import subprocess
import sys

import numpy as np
import pytest

from jumpvision.cli import main
from jumpvision.physics.force_models import fitted_drag, force_model
from jumpvision.physics.forcing import sinusoid
from jumpvision.physics.jump import simulate
from jumpvision.physics.packing_laws import PackingLaw, fit_packing_law
from jumpvision.report.sweeps import picture
from jumpvision.schema import InputError
from jumpvision.sweep.dataset import write
from jumpvision.sweep.laws import EXAMPLE, read_laws
from jumpvision.sweep.machine import machine

SAND = machine("granular", None, {})
PHI = np.repeat(np.linspace(0.57, 0.63, 9), 2)


# -- laws ------------------------------------------------------------------------------------------------------------
def kinked(phi, phi_c=0.605, below=40e3, above=220e3):
    return 3500.0 + below * np.minimum(phi - phi_c, 0.0) + above * np.maximum(phi - phi_c, 0.0)


def test_a_law_without_noise_is_found_exactly():
    fit = fit_packing_law(PHI, kinked(PHI), np.full(PHI.size, 10.0))
    assert fit.phi_c == pytest.approx(0.605, abs=1e-7)  # the search stops at 1e-9 in phi
    assert (fit.slope_below, fit.slope_above) == pytest.approx((40e3, 220e3), rel=1e-4)
    np.testing.assert_allclose(fit.law(PHI), kinked(PHI), rtol=1e-6)
    assert fit.p_straight < 1e-3 and fit.interval[0] <= 0.605 <= fit.interval[1]


def test_uncertainties_of_a_fitted_law_are_true():
    """z of every parameter, 95 % interval of phi_c and sigma of the value over 300 draws."""
    rng = np.random.default_rng(11)
    sigma = 100.0 + 100.0 * rng.random(PHI.size)
    truth, z, inside = np.array([0.605, 3500.0, 40e3, 220e3]), [], 0
    for _ in range(300):
        fit = fit_packing_law(PHI, kinked(PHI) + sigma * rng.standard_normal(PHI.size), sigma, rng=rng)
        found = np.array([fit.phi_c, fit.value_c, fit.slope_below, fit.slope_above])
        z.append((found - truth) / np.sqrt(np.diag(fit.covariance)))
        inside += fit.interval[0] <= 0.605 <= fit.interval[1]
    # the scatter factor max(1, chi2/dof) of 14 degrees of freedom widens by 7 % on average; 300 draws: 4 % of a sigma
    assert np.all(np.abs(np.std(z, axis=0) - 0.95) < 0.13), np.std(z, axis=0)
    assert np.all(np.abs(np.mean(z, axis=0)) < 0.2)  # 0.06 expected of chance; bias of a kink below 0.2 sigma
    assert 0.92 * 300 < inside <= 0.995 * 300, inside  # 95 % widened by the same factor, +- 4 binomial sigmas below


def test_a_straight_law_seldom_asks_for_a_kink():
    rng = np.random.default_rng(5)
    p = [
        fit_packing_law(PHI, 3000.0 + 5e4 * (PHI - 0.6) + 100.0 * rng.standard_normal(PHI.size),
                        np.full(PHI.size, 37.0), rng=rng).p_straight
        for _ in range(200)
    ]  # fmt: skip
    # uniform, whatever the stated sigma: 5 % and 50 % of 200, +- 4 binomial sigmas
    assert np.mean(np.array(p) < 0.05) < 0.05 + 4 * math.sqrt(0.05 * 0.95 / 200)
    assert abs(np.mean(np.array(p) < 0.5) - 0.5) < 4 * math.sqrt(0.25 / 200)


def test_a_law_that_cannot_be_fitted_or_asked_is_refused():
    with pytest.raises(ValueError, match="at least five"):
        fit_packing_law([0.57, 0.58, 0.6, 0.61, np.nan], np.ones(5), np.ones(5))
    with pytest.raises(ValueError, match="sigma: must be > 0"):
        fit_packing_law(PHI, PHI, np.zeros(PHI.size))
    with pytest.raises(ValueError, match=r"outside 0.57 to 0.6"):
        PackingLaw((0.57, 0.6), (1.0, 2.0))([0.58, 0.61])


def test_the_example_holds_the_printed_set():
    laws, p = read_laws(EXAMPLE), SAND.model.parameters
    at = laws.points(0.57, SAND.model.foot_radius)
    for name in ("k1", "k2", "delta", "b", "C", "mu"):
        assert float(at[f"model.{name}"]) == getattr(p, name)
    assert float(at["model.k1"]) / (math.pi * 3.81**2) / 100 == pytest.approx(0.46, abs=0.005)  # N/cm^3


@pytest.mark.parametrize(
    "text, words",
    [
        ("k7 = 1.0", "did you mean"),
        ("k1 = {phi = [0.6, 0.57], value = [1.0, 2.0]}", "increasing"),
        ("k1 = {phi = [0.57, 0.6], value = [1.0]}", "as long"),
        ("k1 = {phi = [0.57, 0.6], value = [1.0, -2.0]}", "k1 = -2"),
        ("k1 = 'stiff'", "must be a number, or a table"),
        ("foot_radius = 0\nk1 = 1.0", "foot_radius = 0"),
        ("", "holds no law"),
        ("k1 = [", "is not TOML"),
    ],
)
def test_a_bad_file_of_laws_is_told(text, words, tmp_path):
    (tmp_path / "laws.toml").write_text(text)
    with pytest.raises(InputError) as error:
        read_laws(tmp_path / "laws.toml")
    assert words in str(error.value) and "laws.toml" in str(error.value)
