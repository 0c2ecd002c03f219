"""The integrator of a body in one dimension ends, whatever its parameters."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from jumpvision.diagnosis.study.particle import LONGEST, path

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
