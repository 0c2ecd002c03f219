"""Curves through parts of a track: exact on exact values, and their stated uncertainties are the true ones."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import savgol_coeffs, savgol_filter
from scipy.sparse import csr_array, diags_array, hstack

from jumpvision.estimate.curves import CURVES, Measured, fit_curve, plus_minus, unit_of
from jumpvision.estimate.height import parabola_noise, parabolas
from jumpvision.estimate.local import local_polynomial

TRUE = {
    "line": [0.3, -2.0],
    "parabola": [0.3, 1.5, -9.81],
    "sine": [0.02, 7.0, 0.4, 0.1],
    "damped": [0.02, 9.0, 0.3, 0.4, 0.1],
    "decay": [0.05, 0.12, 0.01],
}
N, SIGMA = 80, 1e-4
T = np.linspace(0.1, 0.5, N)
EXACT = Measured(T, "s", csr_array((N, N)), np.zeros(N))


def measured(values, sigma=SIGMA, unit="m", common=0.0) -> Measured:
    return Measured(values, unit, csr_array(diags_array(np.full(len(values), sigma))), common * np.asarray(values))


def band(trials: int) -> tuple[float, float]:
    """Where the share within one sigma lies in 99.9 % of experiments: 3.3 standard deviations of a binomial."""
    half = 3.3 * math.sqrt(0.683 * 0.317 / trials)
    return 0.683 - half, 0.683 + half


@pytest.mark.parametrize("kind", CURVES)
def test_a_curve_is_exact_on_exact_values_and_its_stated_sigma_is_the_true_one(kind):
    p = np.array(TRUE[kind])
    y = CURVES[kind].model(T - T[0], p)
    fit = fit_curve(kind, EXACT, measured(y))
    assert fit.p == pytest.approx(TRUE[kind], rel=1e-6) and fit.rms < 1e-9
    assert fit.at(T) == pytest.approx(y, abs=1e-9)
    for step, exact in zip(1e-6 * np.eye(p.size), CURVES[kind].slopes(T, p).T):
        near = (CURVES[kind].model(T, p + step) - CURVES[kind].model(T, p - step)) / 2e-6
        assert near == pytest.approx(exact, rel=1e-5, abs=1e-8)
    trials, rng, inside = 100, np.random.default_rng(7), np.zeros(p.size)
    for _ in range(trials):
        fit = fit_curve(kind, EXACT, measured(y + rng.normal(0, SIGMA, N)))
        inside += [abs(e.value - v) < e.sigma for e, v in zip(fit.parameters.values(), TRUE[kind])]
    low, high = band(trials)
    high += 0.242 * 2 * 0.2 / math.sqrt(N)  # sigmas are widened, never shrunk: scatter_factor
    assert ((low < inside / trials) & (inside / trials < high)).all(), inside / trials


def test_the_sigma_of_a_slope_of_speeds_holds_what_neighbours_share():
    """Speeds of neighbouring frames are of the same positions: taken as independent they would state a wrong sigma."""
    trials, rng, inside = 100, np.random.default_rng(8), 0
    sigma = np.full(N, SIGMA)
    rate, _ = parabola_noise(T, np.ones(N, bool), sigma, 7)
    for _ in range(trials):
        y = 1.5 * T - 0.5 * 9.81 * T**2 + rng.normal(0, SIGMA, N)
        (v, _), (v_sigma, _) = parabolas(T, y[None], sigma, 7)
        speed = Measured(v, "m/s", rate, np.zeros(N))
        assert speed.sigma == pytest.approx(v_sigma, rel=1e-9)
        slope = fit_curve("line", EXACT, speed).parameters["b"]
        inside += abs(slope.value + 9.81) < slope.sigma
        assert slope.unit == "m/s²"
    low, high = band(trials)
    assert low < inside / trials < high + 0.05, inside / trials


def test_errors_that_hold_on_from_frame_to_frame_widen_the_sigma():
    """A third of each error is that of the frame before: taken as independent, 55 % would lie within the sigma."""
    trials, rng, inside, n, keep = 200, np.random.default_rng(5), 0, 200, 0.35
    t = np.linspace(0, 0.4, n)
    x = Measured(t, "s", csr_array((n, n)), np.zeros(n))
    for _ in range(trials):
        e = rng.normal(0, SIGMA * math.sqrt(1 - keep**2), n)
        e[0] = rng.normal(0, SIGMA)
        for i in range(1, n):
            e[i] += keep * e[i - 1]
        bend = fit_curve("parabola", x, measured(-4.905 * t * t + e)).parameters["a"]
        inside += abs(bend.value + 9.81) < bend.sigma
    low, high = band(trials)
    assert low - 0.03 < inside / trials < high, inside / trials  # an order found by BIC shows a little less


def test_errors_of_both_axes_count():
    trials, rng, inside = 200, np.random.default_rng(9), 0
    unit = csr_array(diags_array(np.ones(N)))
    nothing = csr_array((N, N))
    x0 = np.linspace(0.0, 0.2, N)
    for _ in range(trials):
        x, y = x0 + rng.normal(0, 2e-4, N), 3.0 * x0 + rng.normal(0, 1e-4, N)
        fit = fit_curve(
            "line",
            Measured(x, "m", csr_array(hstack([2e-4 * unit, nothing])), np.zeros(N)),
            Measured(y, "m", csr_array(hstack([nothing, 1e-4 * unit])), np.zeros(N)),
        )
        inside += abs(fit.p[1] - 3.0) < fit.parameters["b"].sigma
    low, high = band(trials)
    assert low < inside / trials < high + 0.03, inside / trials


def test_the_scale_s_error_is_common_and_errors_stated_too_small_widen_the_sigmas():
    y = 1.5 * T - 0.5 * 9.81 * T**2
    g = fit_curve("parabola", EXACT, measured(y, 1e-6, common=0.01)).parameters["a"]
    assert g.sigma_common == pytest.approx(0.0981, rel=0.02) and g.sigma == pytest.approx(g.sigma_common, rel=0.02)
    y = 0.3 + np.random.default_rng(1).normal(0, 10 * SIGMA, N)
    fit, honest = fit_curve("line", EXACT, measured(y)), fit_curve("line", EXACT, measured(y, 10 * SIGMA))
    assert fit.excess == pytest.approx(100, rel=0.5)
    assert fit.parameters["b"].sigma == pytest.approx(honest.parameters["b"].sigma, rel=0.3)


def test_what_determines_nothing_is_refused():
    with pytest.raises(ValueError, match="parabola: 3 values here; it needs 4"):
        use = np.arange(N) < 3
        fit_curve("parabola", EXACT.taken(use), measured(T).taken(use))
    with pytest.raises(ValueError, match="one place of the abscissa"):
        fit_curve("line", Measured(np.ones(N), "s", csr_array((N, N)), np.zeros(N)), measured(T))


def test_a_value_has_the_digits_that_its_sigma_allows_and_parameters_have_units():
    for value, sigma, text in (
        (9.7934, 0.0312, "9.79 ± 0.03 m/s²"),
        (9.7934, 0.0123, "9.793 ± 0.012 m/s²"),
        (-1234.5, 20.0, "-1230 ± 20 m/s²"),
        (1.23456e-7, 3e-9, "(1.23 ± 0.03)·10^-7 m/s²"),
        (9.81, 0.0, "9.81 m/s²"),
    ):
        assert plus_minus(value, sigma, "m/s²") == text
    assert unit_of("m", 1, "s", -2) == "m/s²" and unit_of("m/s", 1, "s", -1) == "m/s²"
    assert unit_of("m", 1, "m", -1) == "" and unit_of("m", 0, "s", -1) == "1/s"
    assert unit_of("m²/s²", 1, "m", -1) == "m/s²"


@pytest.mark.parametrize(("width", "order", "deriv"), [(5, 2, 0), (31, 3, 1)])
def test_local_polynomials_are_those_of_scipy(width, order, deriv):
    y, how = np.random.default_rng(2).normal(size=120), {"deriv": deriv, "delta": 0.02}
    got, sigma = local_polynomial(y, width, order, **how)
    np.testing.assert_allclose(got, savgol_filter(y, width, order, **how), rtol=1e-9, atol=1e-12 * np.ptp(got))
    assert sigma == pytest.approx(np.linalg.norm(savgol_coeffs(width, order, **how)), rel=1e-12)
