"""The gain of one model over another, both as they are, on conditions that neither was fitted to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jumpvision.engine.fitting import Fit, Problem

from .gain import FOLDS, Gain, Row, errors, summed


def extrapolation(problem: Problem, before: Fit, after: Fit, label: str, stops: Sequence[float]) -> dict[str, Gain]:
    """The gain on each value of a label (a kind of jump, a volume fraction) when none of it was fitted."""
    observations, out = problem.system.observations, {}
    for value in dict.fromkeys(str(o.labels.get(label)) for o in observations):
        held = [i for i, o in enumerate(observations) if str(o.labels.get(label)) == value]
        if (found := _score(problem, before, after, [held], stops)) is not None:
            out[value] = found
    return out


def held_out_ratio(problem: Problem, before: Fit, after: Fit) -> float:
    """By what the error on conditions held out falls from one model to another, a block of them held out at a time;
    0 where there is but one, or a model cannot be followed."""
    observations = problem.system.observations
    conditions = list(dict.fromkeys(o.condition for o in observations))
    if len(conditions) < 2:
        return 0.0
    folds = np.array_split(np.array(conditions, dtype=object), min(FOLDS, len(conditions)))
    held = [[i for i, o in enumerate(observations) if o.condition in fold] for fold in folds]
    found = _score(problem, before, after, held, [float(o.t[0]) for o in observations])
    return found.ratio if found else 0.0


def _score(
    problem: Problem,
    before: Fit,
    after: Fit,
    folds: Sequence[Sequence[int]],
    stops: Sequence[float],
) -> Gain | None:
    rows: dict[int, Row] = {}
    for held in folds:
        rest = [i for i in problem.all if i not in set(held)]
        # few iterations: each starts from the full fit
        fits = [f for g in (before, after) if (f := problem.fit(g.mechanisms, g.named, rest, iterations=6))]
        if len(fits) < 2:
            return None
        rows |= errors(problem, fits[0], fits[1], held, stops)
    return summed(problem, rows, ())
