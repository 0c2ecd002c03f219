"""A model whose recordings each have their own value of one number, fitted together with what they share.

Gauss-Newton over the shared parameters and the N values; recordings touch each other through the shared ones alone, so
one prediction gives the derivatives by all N values, and the Schur complement what is known of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
import scipy.optimize
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.engine.fitting import STEP, Fit, Problem
from jumpvision.engine.system import Costly, System

from .variables import LOST, SINCE, Changes, Variable, Varying, instruments, shown

MUCH = 0.5  # of the excess of chi^2 that must go linearly before runs are spent on it, where they are dear
FEW_LAPS = 3  # of a system whose runs are dear
LAPS = 15  # of Gauss-Newton at most; a recording that is far off is found by the grid before
PATIENT = 3  # laps after which a number that cannot win is given up
GRID = (-2.0, -1.0, -0.5, -0.2, 0.2, 0.5, 1.0, 2.0)  # spreads, at which a recording's first value is tried
STUCK = 1.5  # times the typical chi^2 a sample, 5 sigma of 200 readings: a value that may be of another minimum
WIDE, FINE = 3.0, 81  # standard deviations of all values about their mean, and points there: where it is looked for
ENOUGH = 0.1  # a smaller expected fall of chi^2 ends the fit
LOOSE = 3.0  # spreads: standard deviation that keeps a value which the recording does not tell from running away
PLACES = 400  # instants at most at which frames may have been lost, evenly over a record


@dataclass(frozen=True)
class Apart:
    """change: (N,) of every recording, at the best; information: (N, N) of them, whatever the shared parameters are.
    chi2: of the whole model there. shared: the shared parameters, by their names. since: (N,) instants of lost frames
    [s], None for any other number."""

    variable: Variable
    change: Array
    information: Array
    chi2: float
    shared: Array
    names: tuple[str, ...]
    since: Array | None = None

    @property
    def free(self) -> bool:
        """Whether the number is one of the shared parameters too."""
        return self.variable.name in self.names

    @property
    def named(self) -> dict[str, float]:
        """The shared parameters."""
        return dict(zip(self.names, self.shared.tolist()))

    @property
    def sigma(self) -> Array:
        """(N,) standard uncertainty of each recording's change by itself, the shared parameters as they are."""
        return 1.0 / np.sqrt(np.maximum(np.diag(self.information), 1e-300))


def variables(system: System) -> dict[str, Variable]:
    """All that may differ from recording to recording."""
    assert isinstance(system, Varying)
    return {**system.variables, **instruments(system.observations)}


def predicted(
    system: System,
    mechanisms: tuple[str, ...],
    values: Mapping[str, float],
    changes: Changes,
    which: Sequence[int],
) -> list[Array]:
    """What a system predicts of these recordings with the changes of each."""
    assert isinstance(system, Varying)
    return system.predict_apart(mechanisms, values, changes, which)


class Each:
    """The residuals of a fit's model with each recording's own value of one number."""

    def __init__(self, problem: Problem, fit: Fit, variable: Variable, since: Array | None = None) -> None:
        self.problem, self.fit, self.variable, self.since = problem, fit, variable, since
        self.count, self.names = len(problem.all), tuple(p.name for p in fit.parameters)

    def residuals(self, shared: Array, change: Array) -> list[Array] | None:
        """Whitened, by recording; None where the model cannot be followed."""
        changes = {self.variable.name: change} | ({} if self.since is None else {SINCE: self.since})
        system = self.problem.system
        values = dict(zip(self.names, shared.tolist()))
        y = predicted(system, self.fit.mechanisms, values, changes, self.problem.all)
        if not all(np.isfinite(a).all() for a in y):
            return None
        each = zip(self.problem.whitening, system.observations, y, self.fit.frame)
        return [w.whitened(o.y - a, f) for w, o, a, f in each]

    def columns(self, shared: Array, change: Array, at: list[Array]) -> list[Array] | None:
        """d(prediction)/d(change), by recording."""
        dear = isinstance(self.problem.system, Costly)
        if dear and self.variable.name in self.names:  # a chord: the fit has it, and no run is needed
            k = self.names.index(self.variable.name)
            size = float(shared[k]) if self.variable.relative else 1.0
            return [size * j[:, k] for j in self.fit.jacobian]
        h = self.variable.step
        for step in (h, -h):
            there = self.residuals(shared, change + step)
            if there is not None:
                return [(a - b) / step for a, b in zip(at, there)]
        return None

    def jacobian(self, shared: Array, change: Array, at: list[Array]) -> list[Array]:
        """d(prediction)/d(shared parameter); of a system whose runs are dear as the fit had it."""
        free = self.fit.parameters
        if isinstance(self.problem.system, Costly):
            return self.fit.jacobian
        out = [np.zeros((a.size, len(free))) for a in at]
        for k, p in enumerate(free):
            step = -STEP * p.scale if shared[k] + STEP * p.scale > p.high else STEP * p.scale
            moved = shared.copy()
            moved[k] += step
            if (there := self.residuals(moved, change)) is not None:
                for o, a, b in zip(out, at, there):
                    o[:, k] = (a - b) / step
        return out


@dataclass(frozen=True)
class _Normal:
    """The equations of Gauss-Newton at a point: step of the shared parameters and of the changes."""

    inner: Array  # (p, p) of the shared parameters
    mixed: Array  # (p, N)
    own: Array  # (N,)
    slope: Array  # (p,)
    pull: Array  # (N,)
    free: NDArray[np.bool_]  # (shared,) which of the shared parameters these are

    def without(self, fixed: NDArray[np.bool_]) -> _Normal:
        """The same with some of the shared parameters as they are."""
        kept = ~fixed
        return _Normal(self.inner[np.ix_(kept, kept)], self.mixed[kept], self.own, self.slope[kept], self.pull, kept)

    @property
    def information(self) -> Array:
        return np.asarray(np.diag(self.own) - self.mixed.T @ self._solved(self.mixed))

    def _solved(self, x: Array) -> Array:
        return np.asarray(np.linalg.solve(self.inner, x)) if self.inner.size else x

    def step(self, loose: float) -> tuple[Array, Array]:
        if not self.own.any():  # a number that changes nothing
            return self._solved(self.slope), np.zeros(self.own.size)
        right = self.pull - self.mixed.T @ self._solved(self.slope)
        least = loose + 1e-10 * float(np.max(self.own))  # a change of all alike may be one of the shared parameters
        change = scipy.linalg.solve(self.information + least * np.eye(self.own.size), right, assume_a="sym")
        return self._solved(self.slope - self.mixed @ change), np.asarray(change)


def _normal(each: Each, here: _Point, loose: float, jacobian: list[Array] | None = None) -> _Normal | None:
    shared, change, at = here.shared, here.change, here.residuals
    columns = each.columns(shared, change, at)
    if columns is None:
        return None
    jac, known = jacobian or each.jacobian(shared, change, at), each.fit.known
    inner = sum((j.T @ j for j in jac), known.precision)
    inner = inner + 1e-9 * np.diag(np.diag(inner)) + 1e-300 * np.eye(shared.size)  # a parameter may change nothing
    slope = sum((j.T @ a for j, a in zip(jac, at)), known.rows.T @ known.pull(shared))
    mixed = np.stack([j.T @ c for j, c in zip(jac, columns)], axis=1)
    own = np.array([float(c @ c) for c in columns])
    pull = np.array([float(c @ a) for c, a in zip(columns, at)]) - loose * change
    whole = _Normal(inner, mixed, own, slope, pull, np.ones(shared.size, bool))
    fixed: NDArray[np.bool_] = np.zeros(shared.size, bool)
    for _ in range(shared.size):  # what would step over an end of its range stays there
        step = np.zeros(shared.size)
        step[~fixed] = whole.without(fixed).step(loose)[0]
        over = [p.at_end(x) and not p.low <= x + d <= p.high for p, x, d in zip(each.fit.parameters, shared, step)]
        if not np.any(over & ~fixed):
            break
        fixed |= over
    return whole.without(fixed)


def linear(problem: Problem, fit: Fit, variable: Variable, since: Array | None = None) -> Apart | None:
    """The same about the fit itself, by one prediction: chi2 as the linear model foretells it. None where the number
    changes nothing or cannot be changed."""
    each = Each(problem, fit, variable, since)
    start = np.zeros(each.count)
    normal = _normal(each, _Point(fit.values, start, fit.residuals, fit.chi2), 0.0, fit.jacobian)
    if normal is None or not normal.own.any():
        return None
    loose = (LOOSE * variable.spread) ** -2
    change = normal.step(loose)[1]
    right = normal.pull - normal.mixed.T @ normal._solved(normal.slope)
    fall = float(2.0 * right @ change - change @ normal.information @ change)
    return Apart(variable, change, normal.information, fit.chi2 - fall, fit.values, each.names, since)


def beside(problem: Problem, fit: Fit, variable: Variable, since: Array | None = None) -> Apart | None:
    """Every recording's own change about a fit by itself, linearly, with what is shared as it is."""
    each = Each(problem, fit, variable, since)
    columns = each.columns(fit.values, np.zeros(each.count), fit.residuals)
    if columns is None:
        return None
    own = np.array([float(c @ c) for c in columns])
    pull = np.array([float(c @ r) for c, r in zip(columns, fit.residuals)])
    change = np.where(own > 0.0, pull / np.maximum(own, 1e-300), 0.0)
    return Apart(variable, change, np.diag(own), fit.chi2, fit.values, each.names, since)


class _Point(NamedTuple):
    """Of the fit: shared parameters, changes (N,), whitened residuals by recording, chi^2 with all priors."""

    shared: Array
    change: Array
    residuals: list[Array]
    cost: float


def apart(
    problem: Problem,
    fit: Fit,
    variable: Variable,
    since: Array | None = None,
    start: Apart | None = None,
    give_up: float = math.inf,
) -> Apart | None:
    """The fit of all values together, from an earlier one where it is given. None as of `linear`, or where chi^2 is
    still beyond `give_up` after a few laps."""
    each = Each(problem, fit, variable, since)
    loose = (LOOSE * variable.spread) ** -2
    shared = (fit.values if start is None else start.shared).copy()
    change = _first(each, shared, fit.residuals) if start is None else start.change
    at = each.residuals(shared, change)
    if at is None:
        at, change, shared = list(fit.residuals), np.zeros(each.count), fit.values.copy()
    here = _Point(shared, change, at, _cost(each, at, shared, change, loose))
    jacobian: list[Array] | None = None
    dear, freed = isinstance(problem.system, Costly), False
    for lap in range(FEW_LAPS if dear else LAPS):
        if lap % 2 == 0:  # derivatives by the shared parameters serve two laps
            jacobian = each.jacobian(here.shared, here.change, here.residuals)
        normal = _normal(each, here, loose, jacobian)
        there = None if normal is None else _stepped(each, here, normal, loose, 2 if dear else 6)
        gained = 0.0 if there is None else here.cost - there.cost
        here = there or here
        if gained < ENOUGH:
            if dear or freed or (away := _freed(each, here, loose)) is None:
                break
            here, freed = away, True
        elif lap == PATIENT and here.cost > give_up:
            break
    normal = _normal(each, here, 0.0)
    if normal is None or not normal.own.any() or here.cost > give_up:
        return None
    left = here.cost - float(loose * here.change @ here.change)
    return Apart(variable, here.change, _definite(normal.information), left, here.shared, each.names, since)


def _cost(each: Each, residuals: list[Array], shared: Array, change: Array, loose: float) -> float:
    pull = each.fit.known.pull(shared)
    return float(sum(r @ r for r in residuals) + pull @ pull + loose * change @ change)


def _stepped(each: Each, here: _Point, normal: _Normal, loose: float, tries: int) -> _Point | None:
    """A step of Gauss-Newton, shorter where it does not lower chi^2, for each recording by itself."""
    step, change = normal.step(loose)
    change = np.clip(change, -each.variable.spread, each.variable.spread)
    full = np.zeros(here.shared.size)
    full[normal.free] = step
    low, high = (np.array([getattr(p, end) for p in each.fit.parameters]) for end in ("low", "high"))
    whole, share = 1.0, np.ones(each.count)
    for _ in range(tries):  # ever shorter
        shared = np.clip(here.shared + whole * full, low, high)
        moved = np.maximum(here.change + share * change, each.variable.least)
        there = each.residuals(shared, moved)
        if there is not None and (cost := _cost(each, there, shared, moved, loose)) < here.cost:
            return _Point(shared, moved, there, cost)
        worse = [there is None or bool(b @ b > a @ a) for a, b in zip(here.residuals, there or here.residuals)]
        share, whole = np.where(np.array(worse), 0.3 * share, share), 0.5 * whole
    return None


def _freed(each: Each, here: _Point, loose: float) -> _Point | None:
    """With the values of a few recordings that ended in another minimum than the others at the best of those about
    them; None where none did, or where nothing near is better."""
    size = np.array([float(r @ r) / max(r.size, 1) for r in here.residuals])
    stuck = np.flatnonzero(size > STUCK * np.median(size))
    if not 0 < stuck.size <= each.count // 3:
        return None
    change = here.change.copy()
    for i in map(int, stuck):
        change[i] = _best_minimum(each, here, i, loose)
    at = each.residuals(here.shared, change)
    if at is None or (now := _cost(each, at, here.shared, change, loose)) >= here.cost:
        return None
    return _Point(here.shared, change, at, now)


def _best_minimum(each: Each, here: _Point, i: int, loose: float) -> float:
    """The value of a recording at the lowest of all minima in the reach of the others' values, all else as it is."""
    problem, values = each.problem, dict(zip(each.names, here.shared.tolist()))

    def cost(x: float) -> float:
        moved = here.change.copy()
        moved[i] = max(x, each.variable.least)
        changes = {each.variable.name: moved} | ({} if each.since is None else {SINCE: each.since})
        y = predicted(problem.system, each.fit.mechanisms, values, changes, [i])[0]
        if not np.isfinite(y).all():
            return math.inf
        r = problem.whitening[i].whitened(problem.system.observations[i].y - y, each.fit.frame[i])
        return float(r @ r + loose * moved[i] ** 2)

    middle, reach = float(np.mean(here.change)), WIDE * float(np.std(here.change))
    grid = np.linspace(middle - reach, middle + reach, FINE)
    height = np.array([cost(x) for x in grid])
    best, least = float(here.change[i]), cost(float(here.change[i]))
    for k in range(1, FINE - 1):
        if height[k] <= min(height[k - 1], height[k + 1]):
            found = scipy.optimize.minimize_scalar(cost, bounds=(grid[k - 1], grid[k + 1]), method="bounded")
            if found.fun < least - ENOUGH:
                best, least = float(found.x), float(found.fun)
    return best


def _definite(information: Array) -> Array:
    """The nearest that is symmetric and not negative: the shared parameters can mimic some of the changes wholly."""
    values, vectors = np.linalg.eigh(0.5 * (information + information.T))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def _first(each: Each, shared: Array, at: list[Array]) -> Array:
    """The best of a few values for every recording by itself."""
    best = np.array([float(a @ a) for a in at])
    change = np.zeros(each.count)
    if isinstance(each.problem.system, Costly):
        return change
    for factor in GRID:
        x = max(factor * each.variable.spread, each.variable.least)
        if (there := each.residuals(shared, np.full(each.count, x))) is None:
            continue
        cost = np.array([float(a @ a) for a in there])
        better = cost < 0.7 * best  # a value beside the minimum would do as well
        change[better], best[better] = x, cost[better]
    return change


def lost_frames(problem: Problem, fit: Fit) -> Apart | None:
    """The fit of frames lost, sought anew where they went missing once the shared parameters are free of them."""
    variable = instruments(problem.system.observations)[LOST]
    since = _lost_since(problem, fit, fit.values)
    if isinstance(problem.system, Costly):
        about = linear(problem, fit, variable, since)
        if about is None or fit.chi2 - about.chi2 < MUCH * (fit.chi2 - problem.n):
            return about
    found = apart(problem, fit, variable, since)
    for _ in range(2):
        if found is None or np.array_equal(again := _lost_since(problem, fit, found.shared), since):
            break
        since = again
        found = apart(problem, fit, variable, since, found)
    return found


def _lost_since(problem: Problem, fit: Fit, shared: Array) -> Array:
    """(N,) when in each recording frames were lost, if any were [s]: where a shift of all that follows by one frame
    takes most."""
    system = problem.system
    values = dict(zip((p.name for p in fit.parameters), shared.tolist()))
    predictions = system.predict(fit.mechanisms, values, problem.all)
    out = np.zeros(len(problem.all))
    for i, (o, y) in enumerate(zip(system.observations, predictions)):
        places = o.t[:: max(1, o.t.size // PLACES)]
        late = shown(o, y, {LOST: 1.0}, -math.inf) - y  # of a record whose every frame comes late
        moved = late[:, None] * (o.t[:, None] >= places)
        white, frame = problem.whitening[i], fit.frame[i]
        columns, residual = white.whitened(moved, frame), white.whitened(o.y - y, frame)
        size = np.sum(columns * columns, axis=0)
        out[i] = places[int(np.argmax((columns.T @ residual) ** 2 / np.maximum(size, 1.0)))]
    return out
