"""The integrator of a body in one dimension ends, whatever its parameters."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from jumpvision.engine.fitting import Problem
from jumpvision.engine.noise.noise import Noise
from jumpvision.engine.system import Observation, Parameter
from tests.worlds.particle import LONGEST, UNDRIVEN, Body, path

TIMES = np.arange(0.0, 2.0, 0.02)


def test_a_body_that_trembles_within_its_presliding_rests():
    """At rest, held by dry friction with a presliding length of 1 um: it looped for ever. Friction of 0.557 holds it
    where 19.47 sin(x) is less, here at x = 0.01; it stays there to within its presliding."""
    x = path(0.01, 0.0, TIMES, np.array([0.0, 19.47, 0.0, 0.0, 0.557, 1e-6]), LONGEST, UNDRIVEN)
    assert np.all(np.abs(x - 0.01) < 2e-6)


@settings(max_examples=300, deadline=None)
@given(
    st.floats(-2.0, 2.0),
    st.one_of(st.just(0.0), st.floats(-5.0, 5.0)),
    st.tuples(
        st.floats(-10.0, 10.0),
        st.floats(0.0, 400.0),
        st.floats(0.0, 50.0),
        st.floats(0.0, 50.0),
        st.floats(0.0, 20.0),
        st.one_of(st.just(0.0), st.floats(-8.0, 0.0).map(lambda e: 10.0**e)),
    ),
)
def test_every_motion_ends(x, v, law):
    """And gains no energy: x stays within what the first energy allows, with that of the bent contacts of a presliding
    (force times length at most), 1 % for the steps."""
    p = np.array(law)
    out = path(x, v, TIMES, p, LONGEST, UNDRIVEN)
    assert out.shape == TIMES.shape
    if np.isfinite(out).all():
        energy = 0.5 * v * v - p[1] * math.cos(x) + p[0] * x + p[4] * p[5]
        assert np.all(-p[1] * np.cos(out) + p[0] * out <= energy + 0.01 * (abs(energy) + p[1] + 1.0))


def test_a_thousand_systems_end_in_time():
    """1,000 random bodies in one dimension, values over many decades: all end, none above 5 s; what cannot be followed
    is NaN, and what is followed has a number at every time."""
    rng, slowest = np.random.default_rng(0), 0.0
    for _ in range(1000):
        law = np.array([rng.normal(0.0, 5.0), *(10.0 ** rng.uniform(-6.0, 3.0, 4)), 10.0 ** rng.uniform(-12.0, 0.0)])
        law[rng.random(6) < 0.3] = 0.0
        x, v = rng.normal(0.0, 1.0), rng.choice([0.0, rng.normal(0.0, 3.0), 10.0 ** rng.uniform(-12.0, 2.0)])
        began = time.perf_counter()
        out = path(x, v, TIMES, law, LONGEST, UNDRIVEN)
        slowest = max(slowest, time.perf_counter() - began)
        ended = np.flatnonzero(~np.isfinite(out))
        assert ended.size == 0 or np.all(~np.isfinite(out[ended[0] :]))
    assert slowest < 5.0


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_ramp_of_force_sets_a_body_in_motion_when_it_overcomes_friction(friction):
    """b F = t: x = (t - f)^3 / 6 from t = f on, exact (Runge-Kutta's fourth order takes a cubic as it is); then F falls
    as it rose and the body comes to rest, for good."""
    b, drive = 4.0, np.array([[0.0, 1.0, 2.0], [0.0, 0.25, 0.0]])
    p = np.array([0.0, 0.0, 0.0, 0.0, friction, 0.0, b])
    t = np.linspace(0.0, 1.0, 41)
    x = path(0.0, 0.0, t, p, LONGEST, drive)
    assert np.abs(x - np.maximum(t - friction, 0.0) ** 3 / 6.0).max() < 1e-12
    if friction:
        late = path(0.0, 0.0, np.linspace(0.0, 6.0, 61), p, LONGEST, drive)
        assert late[-1] == late[-20] > x[-1]


def test_a_driven_pendulum_is_fitted_with_its_logged_torque():
    """A pendulum (W 20, c 0.3) under a torque of two frequencies, logged at 1 kHz, by another integrator: one over its
    inertia, stiffness and damping within 4 sigma, each to 1 %; without the torque nothing fits."""
    rng, logged = np.random.default_rng(3), np.arange(0.0, 8.0, 1e-3)
    truth = {"drive": 5.0, "stiffness": 20.0, "viscous": 0.3}
    records, drives = [], []
    for k in range(2):
        torque = 0.3 * np.sin(3.1 * logged + k) + 0.2 * np.sin(7.7 * logged)

        def rate(t, s, torque=torque):
            return [s[1], 5.0 * np.interp(t, logged, torque) - 20.0 * math.sin(s[0]) - 0.3 * s[1]]

        t = np.arange(0.0, 8.0, 0.02)
        y = solve_ivp(rate, (0.0, 8.0), [0.1 * k, 0.0], t_eval=t, rtol=1e-8, atol=1e-10, max_step=5e-3).y[0]
        records.append(Observation(f"r{k}", t, y + rng.normal(0.0, 1e-3, t.size), "one", f"c{k}"))
        drives.append(np.stack([logged, torque]))
    free = (
        Parameter("drive", 4.0, 0.1, 50.0, 1.0),
        Parameter("stiffness", 18.0, 1.0, 100.0, 2.0),
        Parameter("viscous", 0.1, 0.0, 5.0, 0.1),
    )
    noise = Noise(1e-3, 0.0, 0.02)
    fitted = Problem(Body(records, noise, {}, free, {}, drives=drives), noise).fit(())
    for name, value in truth.items():
        sigma = fitted.sigma(name)
        assert abs(fitted.named[name] - value) < 4.0 * sigma < 0.04 * value
    alone = Problem(Body(records, noise, {}, free[1:], {}), noise).fit(())
    assert alone.chi2 > 100.0 * fitted.chi2


def test_a_thousand_driven_systems_end_in_time():
    """As above, under a force that jumps about."""
    rng, slowest = np.random.default_rng(1), 0.0
    for _ in range(300):
        law = np.array(
            [rng.normal(0.0, 5.0), *(10.0 ** rng.uniform(-6.0, 3.0, 4)), 10.0 ** rng.uniform(-12.0, 0.0), 1.0]
        )
        law[:6][rng.random(6) < 0.3] = 0.0
        drive = np.stack([np.linspace(0.0, 2.0, 200), rng.normal(0.0, 10.0 ** rng.uniform(-3.0, 3.0), 200)])
        began = time.perf_counter()
        out = path(rng.normal(), rng.choice([0.0, rng.normal()]), TIMES, law, LONGEST, drive)
        slowest = max(slowest, time.perf_counter() - began)
        ended = np.flatnonzero(~np.isfinite(out))
        assert ended.size == 0 or np.all(~np.isfinite(out[ended[0] :]))
    assert slowest < 5.0


@pytest.mark.parametrize(
    ("drives", "said"),
    [
        ([np.zeros(3)], r"drives\[0\] has shape \(3,\): must be \(2, m\)"),
        ([np.array([[0.0, 0.0], [1.0, 1.0]])], r"drives\[0\]: times must increase"),
        ([np.array([[0.0, 1.0], [1.0, 1.0]])] * 2, "drives: 2 for 1 records: must be one a record"),
    ],
)
def test_a_drive_that_cannot_be_is_refused(drives, said):
    record = Observation("r", TIMES, np.zeros(TIMES.size), "one", "one")
    with pytest.raises(ValueError, match=said):
        Body([record], None, {"drive": 1.0}, (), {}, drives=drives)


def test_a_body_that_cannot_be_followed_names_its_law():
    """A gap of 1,000 s would take 500,000 steps of 2 ms."""
    record = Observation("far", np.array([0.0, 1.0, 1000.0]), np.zeros(3), "one", "one", {})
    with pytest.raises(ValueError, match=r"stiffness = 19\.47.*coulomb = 0\.557"):
        Body([record], None, {"stiffness": 19.47, "coulomb": 0.557}, (), {})
