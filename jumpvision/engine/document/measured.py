"""Quantities that were measured beside the motions: what the motions alone say of them, and whether both agree."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from jumpvision.engine.fitting import Fit, Problem
from jumpvision.engine.priors import Measured

from .values import Agreement, Confirmation

CONTRADICT = 3.0  # sigmas


def motions_alone(fit: Fit, problem: Problem) -> Fit:
    """The same model, fitted to the motions without what else was measured of it."""
    if not problem.measured:
        return fit
    alone = Problem(problem.system, problem.noise, problem.scattered).fit(fit.mechanisms, fit.named)
    return fit if alone is None else alone


def confirmations(
    alone: Fit, measured: Sequence[Measured], given: Mapping[str, tuple[float, str]]
) -> list[Confirmation]:
    """Every quantity of a model that was measured beside the motions: by them, by the motions alone (`alone`).

    given: parameters that the model has, each with its value where it is not fitted, and its unit.
    """
    rows = []
    for m in measured:
        for name, value in zip(m.names, m.values.tolist()):
            if name in given:
                at, unit = given[name]
                motions = (float(alone.named[name]), alone.sigma(name)) if name in alone.named else (at, 0.0)
                rows.append(compared(name, m.source, motions, (value, m.sigma(name)), unit))
    return rows


def compared(
    quantity: str, source: str, motions: tuple[float, float], beside: tuple[float, float], unit: str
) -> Confirmation:
    """A quantity by the motions and by another measurement, each (value, sigma): they contradict each other beyond
    CONTRADICT sigmas."""
    z = (beside[0] - motions[0]) / math.hypot(beside[1], motions[1])
    verdict = Agreement.CONTRADICT if abs(z) > CONTRADICT else Agreement.AGREE
    return Confirmation(quantity, unit, source, *motions, *beside, z, verdict)
