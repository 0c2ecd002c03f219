"""The integrator of a body in one dimension ends, whatever its parameters."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jumpvision.diagnosis.study.particle import LONGEST, Body, path
from jumpvision.diagnosis.system import Observation

TIMES = np.arange(0.0, 2.0, 0.02)


def test_a_body_that_trembles_within_its_presliding_rests():
    """At rest, held by dry friction with a presliding length of 1 um: it looped for ever. Friction of 0.557 holds it
    where 19.47 sin(x) is less, here at x = 0.01; it stays there to within its presliding."""
    x = path(0.01, 0.0, TIMES, np.array([0.0, 19.47, 0.0, 0.0, 0.557, 1e-6]), LONGEST)
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
    out = path(x, v, TIMES, p, LONGEST)
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
        out = path(x, v, TIMES, law, LONGEST)
        slowest = max(slowest, time.perf_counter() - began)
        ended = np.flatnonzero(~np.isfinite(out))
        assert ended.size == 0 or np.all(~np.isfinite(out[ended[0] :]))
    assert slowest < 5.0


def test_a_body_that_cannot_be_followed_names_its_law():
    """A gap of 1,000 s would take 500,000 steps of 2 ms."""
    record = Observation("far", np.array([0.0, 1.0, 1000.0]), np.zeros(3), "one", "one", {})
    with pytest.raises(ValueError, match=r"stiffness = 19\.47.*coulomb = 0\.557"):
        Body([record], None, {"stiffness": 19.47, "coulomb": 0.557}, (), {})
