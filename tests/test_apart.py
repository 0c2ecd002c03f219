"""Every recording's own value of one number, where chi^2 has more than one minimum: oscillations of many turns, whose
side lobes are minima, too."""

from __future__ import annotations

import copy

import numpy as np

from jumpvision.engine.fitting import Problem
from jumpvision.engine.noise.noise import Noise
from jumpvision.engine.system import Observation, Parameter
from jumpvision.engine.vary.apart import apart
from jumpvision.engine.vary.variables import Variable

T = np.linspace(0.0, 1.0, 201)
NOISE, TURNS = 1e-3, 100.0
TRUE = np.array([0.0, 0.0102, -0.0098, 0.0049, 0.0155, -0.0051, 0.0201, -0.0197])  # the fifth is in no first value


class Oscillations:
    """y = sin(2 pi f (1 + change) t), beside a drift of unknown slope that all share."""

    def __init__(self, change):
        self.candidates = {}
        self.baseline = (Parameter("slope", 0.0, -1.0, 1.0, 0.1),)
        self.variables = {"f": Variable("f", TURNS, "Hz", 0.01, 1e-6)}
        rng = np.random.default_rng(5)
        y = self.predict_apart((), {"slope": 0.2}, {"f": change}, range(change.size))
        self.observations = [
            Observation(f"run {k}", T, a + NOISE * rng.standard_normal(T.size), f"run {k}", f"run {k}")
            for k, a in enumerate(y)
        ]

    def predict(self, mechanisms, values, which):
        return self.predict_apart(mechanisms, values, {}, which)

    def predict_apart(self, mechanisms, values, changes, which):
        own = changes.get("f", np.zeros(max(which, default=0) + 1))
        return [np.sin(2 * np.pi * TURNS * (1.0 + own[i]) * T) + values["slope"] * T for i in which]

    def scatter(self, mechanisms, values, which):
        return {}

    def varying(self, weighed, log_price=0.0):
        return copy.copy(self)

    def scattered(self, name, changes):
        return copy.copy(self)

    def at_common(self):
        return copy.copy(self)


def test_a_recording_in_another_minimum_is_found():
    """From the grid of first values it falls into a side lobe (0.5 of the motion stays); all values are then those of
    least squares: 8 x 200 readings of noise, and every change within five of its standard uncertainties."""
    problem = Problem(Oscillations(TRUE), Noise(NOISE, 0.0, T[1]))
    fit = problem.fit()
    found = apart(problem, fit, problem.system.variables["f"])
    assert abs(found.chi2 - problem.n) < 5 * np.sqrt(2 * problem.n)
    np.testing.assert_array_less(np.abs(found.change - TRUE), 5 * found.sigma)
