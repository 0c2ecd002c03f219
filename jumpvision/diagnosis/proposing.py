"""What the extended model gains on conditions held out in turn, and the experiment that best tells causes apart."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.diagnosis.noise.noise import Noise

from .fitting import STEP, Fit, Problem


class Runnable(Protocol):
    """An experiment that could be done: its labels, its frames, and what a model predicts for it."""

    @property
    def labels(self) -> Mapping[str, Any]: ...
    @property
    def t(self) -> Array: ...
    def predict(self, mechanisms: tuple[str, ...], values: Mapping[str, float]) -> Array: ...


@dataclass(frozen=True)
class Proposal:
    """expected_log10_odds: for the right one of two explanations over the other, after one such jump."""

    labels: Mapping[str, Any]
    separates: tuple[str, str]
    expected_log10_odds: float


def propose(runnable: Sequence[Runnable], first: Fit, second: Fit, noise: Noise) -> Proposal | None:
    """The best of the experiments for telling two explanations apart; None when none can be predicted."""
    best: Proposal | None = None
    for r in runnable:
        odds = expected_log10_odds(r, first, second, noise)
        if odds is not None and (best is None or odds > best.expected_log10_odds):
            names = tuple("+".join(f.mechanisms) or "baseline" for f in (first, second))
            best = Proposal(r.labels, (names[0], names[1]), odds)
    return best


def expected_log10_odds(r: Runnable, first: Fit, second: Fit, noise: Noise) -> float | None:
    """Half the squared distance of the predictions in noise units, with both models' parameters as uncertain as they
    are: d^T (I + J S J^T)^-1 d / 2, the mean log-likelihood ratio of two Gaussian predictions."""
    at = [r.predict(f.mechanisms, f.named) for f in (first, second)]
    if not all(np.all(np.isfinite(y)) for y in at):
        return None
    columns = [np.ones((r.t.size, 1)) * 1e3 * noise.s]  # the zero level is unknown
    for f, y in zip((first, second), at):
        jac = np.zeros((r.t.size, len(f.parameters)))
        for i, p in enumerate(f.parameters):
            step = STEP * p.scale * (-1.0 if f.values[i] + STEP * p.scale > p.high else 1.0)
            there = r.predict(f.mechanisms, {**f.named, p.name: f.values[i] + step})
            jac[:, i] = np.nan_to_num((there - y) / step)
        w, v = np.linalg.eigh(f.covariance) if f.parameters else (np.zeros(0), np.zeros((0, 0)))
        columns.append(jac @ (v * np.sqrt(np.maximum(w, 0.0))))
    d = noise.whiten(r.t, at[0] - at[1])
    j = noise.whiten(r.t, np.hstack(columns))
    inner = np.linalg.solve(np.eye(j.shape[1]) + j.T @ j, j.T @ d)
    return float(d @ d - (j.T @ d) @ inner) / 2 / math.log(10)


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
    problem: Problem,
    before: Fit,
    after: Fit,
    folds: Sequence[Sequence[int]],
    stops: Sequence[float],
    rng: np.random.Generator,
) -> Gain | None:
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
