"""The gain of one model over another, both as they are, on conditions that neither was fitted to."""

from __future__ import annotations

from collections.abc import Sequence

from jumpvision.engine.fitting import Fit, Problem

from .gain import Gain, errors, summed


def extrapolation(problem: Problem, before: Fit, after: Fit, label: str, stops: Sequence[float]) -> dict[str, Gain]:
    """The gain on each value of a label (a kind of jump, a volume fraction) when none of it was fitted."""
    observations, out = problem.system.observations, {}
    for value in dict.fromkeys(str(o.labels.get(label)) for o in observations):
        held = [i for i, o in enumerate(observations) if str(o.labels.get(label)) == value]
        rest = [i for i in problem.all if i not in set(held)]
        # few iterations: each starts from the full fit
        fits = [f for g in (before, after) if (f := problem.fit(g.mechanisms, g.named, rest, iterations=6))]
        if len(fits) == 2:
            out[value] = summed(problem, errors(problem, fits[0], fits[1], held, stops), ())
    return out
