"""What models are worth on conditions held out in turn: the gain of the extended one, and which predicts best."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import scipy

from jumpvision.base.arrays import Array
from jumpvision.engine.fitting import ITERATIONS, Fit, Problem
from jumpvision.engine.search import log_prior
from jumpvision.engine.system import Costly, Observation, Part, by_condition

if TYPE_CHECKING:
    from jumpvision.engine.naming import Explanation

FOLDS = 4
BEST = 5  # sets, by evidence linear about their fits, that are fitted to a fold
FAR = 30.0  # nats behind the best: linear about a fit, none so far behind comes first
CLEARLY = math.log(10.0)  # odds of ten, strong in the words of Jeffreys (1961)
FEW_LAPS = 2  # of the fit of a fold where runs are dear
LEVEL = 1.05  # errors that are as good: noise makes so much of an rms of 200 independent readings
PARTS = 4  # at least: fewer conditions than these are held out in pieces
FEW_GROUPS = 3  # groups below which an interval is not stated


@dataclass(frozen=True)
class Gain:
    """Root mean squares of measured minus predicted on held-out motions, by the baseline and by the extended model.

    ratio: of the track's, before / after; ratio_ci95: by leaving out groups of trials in turn. held_out: names of the
    motions. selection: sets of mechanisms with how often each was chosen over the folds; () where none was chosen anew.
    """

    held_out: tuple[str, ...]
    height_before: float
    height_after: float
    track_before: float
    track_after: float
    ratio: float
    ratio_ci95: tuple[float, float]
    selection: tuple[tuple[tuple[str, ...], int], ...] = ()

    @property
    def claimed(self) -> bool:
        """The interval excludes no gain."""
        return self.ratio_ci95[0] > 1.0


Begin = Callable[[Problem, np.random.Generator], Fit]  # the baseline, from its own values
Choose = Callable[[Problem, Fit, np.random.Generator], Fit]


def gain(
    problem: Problem,
    begin: Begin,
    stops: Sequence[float],
    rng: np.random.Generator,
    order: Sequence[str],
    choose: Choose,
) -> Gain | None:
    """Gain over all conditions, a block of them held out at a time; None when there is but one condition.

    Without the held-out ones the baseline is fitted anew and a model chosen anew. stops: (observations,) time from
    which a height counts [s]. order: labels by which conditions are neighbours; neighbours are held out together.
    """
    observations = problem.system.observations
    place = {o.condition: [_place(o.labels.get(n)) for n in order] for o in observations}
    conditions = sorted(place, key=lambda c: place[c])
    if len(conditions) < 2:
        return None
    folds = [list(f) for f in np.array_split(np.array(conditions, dtype=object), min(FOLDS, len(conditions)))]

    def without(fold: list[str], rng: np.random.Generator) -> tuple[tuple[str, ...], dict[int, Row]] | None:
        held = [i for i, o in enumerate(observations) if o.condition in fold]
        part = problem.over([i for i in problem.all if i not in held])
        try:
            base = begin(part, rng)
        except ValueError:
            return None
        best = choose(part, base, rng)
        return best.mechanisms, errors(problem, base, best, held, stops)

    found = problem.each(partial(without, fold, own) for fold, own in zip(folds, rng.spawn(len(folds))))
    if None in found:
        return None
    rows: dict[int, Row] = {}
    chosen: Counter[tuple[str, ...]] = Counter()
    for mechanisms, off in filter(None, found):
        chosen[mechanisms] += 1
        rows |= off
    return summed(problem, rows, tuple(chosen.most_common()))


def laps(part: Problem) -> int:
    """Of the fit of a fold, from that of all recordings."""
    return FEW_LAPS if isinstance(part.system, Costly) else ITERATIONS


def begun_at(base: Fit) -> Begin:
    """The baseline of a fold from where that of all recordings ended: its runs, and their derivatives, serve again."""

    def begin(part: Problem, _: np.random.Generator) -> Fit:
        assert isinstance(part.system, Part)
        found = part.fit(base.mechanisms, onward=base.over(part.system.kept), iterations=laps(part))
        if found is None:
            raise ValueError("the baseline cannot be followed")
        return found

    return begin


def among(tried: Sequence[Explanation]) -> Choose:
    """Of the sets that were fitted to all recordings, the likeliest of a fold: the best by evidence linear about each
    fit are fitted, and of those about as likely the smallest is taken. Alternative functions, which no residual can ask
    for, are among them."""

    def choose(part: Problem, base: Fit, _: np.random.Generator) -> Fit:
        assert isinstance(part.system, Part)
        known = part.system.candidates
        fits = [e.fit.over(part.system.kept) for e in tried if e.mechanisms and set(e.mechanisms) <= set(known)]
        likely = [(part.evidence_near(f) + log_prior(f.mechanisms, known), f) for f in fits]
        order = sorted(likely, key=lambda x: -x[0])[: 1 if isinstance(part.system, Costly) else BEST]
        near = [f for x, f in order if x > order[0][0] - FAR]
        found = [part.fit(f.mechanisms, onward=f, iterations=laps(part)) for f in near]
        level = {f.log_evidence + log_prior(f.mechanisms, known): f for f in (base, *found) if f}
        return min((f for x, f in level.items() if x > max(level) - CLEARLY), key=lambda f: len(f.mechanisms))

    return choose


def _place(label: object) -> tuple[float, str]:
    """Order of labels: numbers by their size, before texts."""
    return (float(label), "") if isinstance(label, int | float) else (math.inf, str(label))


# of an observation: sums of squares of two models, samples, squares of what their heights are off
Row = tuple[float, float, int, float, float]


def errors(problem: Problem, before: Fit, after: Fit, held: Sequence[int], stops: Sequence[float]) -> dict[int, Row]:
    """Squared errors of the motions held out, by either model."""
    predicted = [problem.system.predict(f.mechanisms, f.named, held) for f in (before, after)]
    rows: dict[int, Row] = {}
    for k, i in enumerate(held):
        o = problem.system.observations[i]
        r = [o.y - p[k] for p in predicted]
        off = [_off_height(o, p[k], stops[i]) for p in predicted]
        rows[i] = (float(r[0] @ r[0]), float(r[1] @ r[1]), o.t.size, off[0] ** 2, off[1] ** 2)
    return rows


def _off_height(o: Observation, y: Array, stop: float) -> float:
    """A model's height, of its curve y (n,), minus the measured one; NaN where none was measured."""
    if o.measured is None:
        return math.nan
    from jumpvision.estimate.height import curve_height

    return curve_height(o.t, y, stop) - o.measured[0]


def summed(problem: Problem, rows: Mapping[int, Row], selection: tuple[tuple[tuple[str, ...], int], ...]) -> Gain:
    observations = problem.system.observations
    groups: dict[str, list[int]] = {}
    for i in rows:
        groups.setdefault(observations[i].group, []).append(i)
    sums = np.array([np.sum([rows[i][:2] for i in g], axis=0) for g in groups.values()])
    table = np.array(list(rows.values()))
    n = table[:, 2].sum()
    track = [math.sqrt(table[:, k].sum() / n) for k in (0, 1)]
    known = table[np.isfinite(table[:, 3:]).all(axis=1), 3:]
    height = np.sqrt(known.mean(axis=0)).tolist() if known.size else [math.nan, math.nan]
    names = tuple(observations[i].name for i in sorted(rows))
    ratio = track[0] / track[1]
    return Gain(names, height[0], height[1], track[0], track[1], ratio, ratio_interval(sums), selection)


def ratio_interval(sums: Array, level: float = 0.95) -> tuple[float, float]:
    """Interval of sqrt(sum of column 0 / sum of column 1) over groups (n, 2): its logarithm by the jackknife, with
    Student's t of n - 1 degrees of freedom; (0, inf) for fewer than FEW_GROUPS."""
    n = len(sums)
    if n < FEW_GROUPS:
        return 0.0, math.inf
    total = sums.sum(axis=0)
    whole = 0.5 * math.log(total[0] / total[1])
    rest = total - sums
    each = 0.5 * np.log(rest[:, 0] / rest[:, 1])
    pseudo = n * whole - (n - 1) * each
    half = float(scipy.stats.t.ppf(0.5 + 0.5 * level, n - 1)) * float(np.std(pseudo, ddof=1)) / math.sqrt(n)
    return math.exp(whole - half), math.exp(whole + half)


def best_at_prediction(problem: Problem, fits: Iterable[Fit]) -> tuple[Fit, Array]:
    """(the fit with the fewest parameters among those whose held-out error is within LEVEL of the least; its squared
    errors by part)"""
    each = [(f, held_out_error(problem, f)) for f in fits]
    least = min(float(e.sum()) for _, e in each)
    level = [(f, e) for f, e in each if float(e.sum()) <= LEVEL**2 * least]
    return min(level, key=lambda x: (len(x[0].parameters), float(x[1].sum())))


def held_out_error(problem: Problem, fit: Fit) -> Array:
    """(parts,) sum of squared whitened residuals of each condition as predicted from the others: linear about the fit,
    a parameter kept within its range, one that its end holds left there. Fewer than PARTS conditions are held out in
    pieces, each of so many consecutive samples of every motion."""
    n = len(fit.parameters)
    rows = _parts(problem, fit)
    total = [(r, j) for part in rows for r, j in part]
    wide = np.diag([12.0 / p.width**2 for p in fit.parameters]) if n else np.zeros((0, 0))
    hessian = sum((j.T @ j for _, j in total), fit.known.precision + wide)
    slope = sum((j.T @ r for r, j in total), fit.known.rows.T @ fit.known.pull(fit.values))
    low, high = (np.array([getattr(p, end) for p in fit.parameters]) for end in ("low", "high"))
    free = np.array([not p.at_end(x) for p, x in zip(fit.parameters, fit.values)], bool)
    out = np.zeros(len(rows))
    for k, part in enumerate(rows):
        r, j = np.concatenate([r for r, _ in part]), np.vstack([j for _, j in part])
        step = np.zeros(n)
        if free.any():
            own = j[:, free]
            rest = hessian[np.ix_(free, free)] - own.T @ own
            step[free] = np.linalg.lstsq(rest, slope[free] - own.T @ r, rcond=None)[0]
            step = np.clip(fit.values + step, low, high) - fit.values
        out[k] = float(np.sum((r - j @ step) ** 2))
    return out


def _parts(problem: Problem, fit: Fit) -> list[list[tuple[Array, Array]]]:
    """Residuals and derivatives by part."""
    conditions = by_condition(problem.system.observations)
    pieces = -(-PARTS // len(conditions))
    out = []
    for held in conditions:
        cut = [(np.array_split(fit.residuals[i], pieces), np.array_split(fit.jacobian[i], pieces)) for i in held]
        out += [[(r[k], j[k]) for r, j in cut] for k in range(pieces)]
    return out
