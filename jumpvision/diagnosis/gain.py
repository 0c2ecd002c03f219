"""What the extended model gains on motions it was not fitted to: whole conditions are held out in turn."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .fitting import Fit, Problem

Array = NDArray[np.float64]

FOLDS = 4
BOOTSTRAP = 4000
REFIT = 6  # iterations, from the full fit


@dataclass(frozen=True)
class Gain:
    """Root mean squares of measured minus predicted on held-out motions, by the baseline and by the extended model.

    ratio: of the track's, before / after; ratio_ci95: by resampling groups of trials. held_out: names of the motions.
    """

    held_out: tuple[str, ...]
    height_before: float
    height_after: float
    track_before: float
    track_after: float
    ratio: float
    ratio_ci95: tuple[float, float]

    @property
    def claimed(self) -> bool:
        """The interval excludes no gain."""
        return self.ratio_ci95[0] > 1.0


def apex(t: Array, y: Array, after: float, half: int = 5) -> float:
    """Greatest height after a time [unit of y]: the vertex of a parabola through the samples about the largest."""
    late = np.flatnonzero(t >= after)
    if late.size < 3:
        return math.nan
    top = late[int(np.argmax(y[late]))]
    near = slice(max(top - half, late[0]), min(top + half + 1, y.size))
    if t[near].size < 4:
        return float(y[top])
    a, b, c = np.polyfit(t[near] - t[top], y[near], 2)
    at = -b / (2 * a) if a < 0 else 0.0
    return float(c + b * at + a * at * at) if abs(at) <= (t[near][-1] - t[near][0]) else float(y[top])


def gain(problem: Problem, before: Fit, after: Fit, stops: Sequence[float], rng: np.random.Generator) -> Gain | None:
    """Gain over all conditions, each held out once; None when there is but one condition.

    stops: (observations,) time after which an apex counts [s].
    """
    observations = problem.system.observations
    conditions = list(dict.fromkeys(o.condition for o in observations))
    if len(conditions) < 2:
        return None
    folds = [conditions[k :: min(FOLDS, len(conditions))] for k in range(min(FOLDS, len(conditions)))]
    held = [[i for i, o in enumerate(observations) if o.condition in fold] for fold in folds]
    return _score(problem, before, after, held, stops, rng)


def extrapolation(
    problem: Problem, before: Fit, after: Fit, label: str, stops: Sequence[float], rng: np.random.Generator
) -> dict[str, Gain]:
    """The gain on each value of a label (a kind of jump, a volume fraction) when none of it was fitted."""
    observations = problem.system.observations
    values = list(dict.fromkeys(str(o.labels.get(label)) for o in observations))
    if len(values) < 2:
        return {}
    out = {}
    for value in values:
        held = [i for i, o in enumerate(observations) if str(o.labels.get(label)) == value]
        if (found := _score(problem, before, after, [held], stops, rng)) is not None:
            out[value] = found
    return out


def _score(
    problem: Problem, before: Fit, after: Fit, folds: Sequence[Sequence[int]], stops: Sequence[float],
    rng: np.random.Generator,
) -> Gain | None:  # fmt: skip
    observations = problem.system.observations
    squares: dict[int, tuple[float, float, int, float, float]] = {}
    for held in folds:
        rest = [i for i in problem.all if i not in set(held)]
        fits = [problem.fit(f.mechanisms, f.named, rest, iterations=REFIT) for f in (before, after)]
        if any(f is None for f in fits):
            return None
        predicted = [problem.system.predict(f.mechanisms, f.named, held) for f in fits if f is not None]
        for k, i in enumerate(held):
            o = observations[i]
            r = [o.y - p[k] for p in predicted]
            tops = [apex(o.t, p[k], stops[i]) - apex(o.t, o.y, stops[i]) for p in predicted]
            squares[i] = (float(r[0] @ r[0]), float(r[1] @ r[1]), o.t.size, tops[0] ** 2, tops[1] ** 2)
    groups: dict[str, list[int]] = {}
    for i in squares:
        groups.setdefault(observations[i].group, []).append(i)
    sums = np.array([np.sum([squares[i][:3] for i in g], axis=0) for g in groups.values()])
    picks = rng.integers(0, len(sums), (BOOTSTRAP, len(sums)))
    totals = sums[picks].sum(axis=1)
    ratios = np.sqrt(totals[:, 0] / totals[:, 1])
    table = np.array(list(squares.values()))
    n = table[:, 2].sum()
    track = [math.sqrt(table[:, k].sum() / n) for k in (0, 1)]
    height = [float(np.sqrt(np.nanmean(table[:, k]))) for k in (3, 4)]
    low, high = np.quantile(ratios, [0.025, 0.975])
    names = tuple(observations[i].name for i in sorted(squares))
    ci95 = (float(low), float(high))
    return Gain(names, height[0], height[1], track[0], track[1], track[0] / track[1], ci95)
