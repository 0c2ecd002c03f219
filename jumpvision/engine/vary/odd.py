"""Recordings that a model does not describe though it describes all others, and what of theirs would mend it."""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
import scipy

from jumpvision.base.arrays import Array
from jumpvision.engine.detect import detect
from jumpvision.engine.document.values import Pattern as Kind
from jumpvision.engine.fitting import Fit, Problem
from jumpvision.engine.system import ASIDE, Costly, System

from .apart import ENOUGH, GRID, LOOSE, predicted, variables
from .patterns import ODD, WIDTHS, Pattern, Weighed
from .variables import Variable

SHARE = 6  # one recording in so many may stand apart
EXCHANGE = 8  # recordings from which two may, which were exchanged
HALF = 0.5  # of the excess of chi^2 that must go with each recording left out, or they are not a few odd ones
# factors of a slip: decimal points, radius and diameter, Hz and rad/s, kgf and N, degrees, inches, minutes
SLIPS = (10.0, 100.0, 1000.0, 2.0, 2.0 * math.pi, 9.81, 180.0 / math.pi, 25.4, 60.0)
FACTORS = tuple(x for f in SLIPS for x in (f, 1.0 / f))
FEW = 6  # numbers that are tried two by two: those that alone do best
SINGLE = 1e-3  # chance below which a recording stands apart, or is not described by its numbers
MOST = 0.1  # share of its chi^2 that it may keep for a mistake to be looked into where a force hides, too
SLIP = 1e-3  # share of its chi^2 that a recording may keep where a number of it is far off
AS_WELL = 3.0  # nats behind the best number of a recording, within which another does as well: odds of 20
LAPS = 12  # of Gauss-Newton, damped: a start may be far off


@dataclass(frozen=True)
class Odd:
    """members: recordings without which the model is adequate. described: numbers of some that mend
    them. commands: by which command a member was driven, of which other recording. slips: numbers that are off by so
    much that they take nearly all of a member's misfit, though not all of it."""

    members: tuple[int, ...]
    described: tuple[Weighed, ...]
    commands: Mapping[int, int]
    slips: Mapping[int, Weighed]

    @property
    def explained(self) -> bool:
        """Whether every one of them moves as another was to be driven, or has a number that is far off."""
        return all(i in self.commands or i in self.slips for i in self.members)


@runtime_checkable
class Commanded(Protocol):
    """A system that can foretell a recording driven as another one was."""

    def predict_commanded(
        self, mechanisms: tuple[str, ...], values: Mapping[str, float], which: int, like: int
    ) -> Array: ...


def set_aside(system: System, members: Sequence[int]) -> System:
    """The same system, these recordings counting for nothing."""
    out = copy.copy(system)
    every = list(system.observations)
    for i in members:
        every[i] = replace(every[i], spread=np.full(every[i].t.size, ASIDE))
    out.observations = every  # type: ignore[misc]
    return out


def _taken_away(problem: Problem, fit: Fit) -> Iterator[tuple[tuple[int, ...], Problem, Fit]]:
    """(recordings, the problem without them, its fit): one more at a time, or two that were exchanged, as long as each
    takes half of what a model gets wrong."""
    members: tuple[int, ...] = ()
    rest, excess = fit, fit.chi2 - problem.n
    count = len(problem.all)
    most = min(ODD, max(count // SHARE, 2 if count >= EXCHANGE else 0))
    while len(members) < most:
        falls = {i: _fall(rest, i) for i in range(count) if i not in members}
        for size in range(1, min(2, most - len(members)) + 1):
            worst = sorted(falls, key=lambda i: -falls[i])[:size]
            if not all(_strange(problem, i, falls[i]) for i in worst):
                return
            # where runs are dear, without one: leaving them out takes too little, linear about the fit
            if isinstance(problem.system, Costly) and sum(falls[i] for i in worst) < HALF * excess:
                continue
            part = problem.asked_of(set_aside(problem.system, [*members, *worst]))
            again = part.fit(fit.mechanisms, rest.named)
            if again is not None and again.chi2 - part.n <= HALF**size * excess:
                break
        else:
            return
        members, rest, excess = tuple(sorted([*members, *worst])), again, again.chi2 - part.n
        yield members, part, again


def those_apart(problem: Problem, fit: Fit) -> tuple[int, ...]:
    """The few recordings that each take half of what a model gets wrong; none where they do not."""
    return max((members for members, _, _ in _taken_away(problem, fit)), key=len, default=())


def may_be_mistaken(problem: Problem, fit: Fit, members: Sequence[int]) -> bool:
    """Whether of every one of these recordings most of the misfit goes with the command of another, or with a number
    that is off by the factor of a slip, all else as it is: without a fit."""
    usable = [v for v in variables(problem.system).values() if v.relative and not v.whole]
    for i in members:
        alone = _Alone(problem, fit, i)
        slips = (alone.chi2((v,), x) for v in usable for x in _factors(v))
        if min([_by_command(problem, fit, i)[0], *slips]) > MOST * alone.chi2((), np.zeros(0)):
            return False
    return True


def about(problem: Problem, part: Problem, fit: Fit, members: tuple[int, ...]) -> Odd:
    """What mends these recordings, about a fit of the others (`part`)."""
    system = copy.copy(part.system)
    system.observations = problem.system.observations  # type: ignore[misc]
    whole = part.asked_of(system)
    numbers = {i: w for i in members if (w := described(whole, fit, i)) is not None}
    plain = {i for i, w in numbers.items() if _plain(w)}
    commands = {i: j for i in members if i not in plain and (j := command_of(whole, fit, i)) is not None}
    return Odd(members, (), commands, {i: w for i, w in numbers.items() if i not in commands})


def _plain(w: Weighed) -> bool:
    """Whether one number is off by the factor of a slip that no two commands are apart by."""
    v, change = w.pattern.variables[0], float(w.coefficients[0])
    factors = [f for f in FACTORS if f not in (2.0, 0.5)]
    return w.coefficients.size == 1 and v.relative and any(abs((1.0 + change) / f - 1.0) < 0.01 for f in factors)


def odd_ones(problem: Problem, fit: Fit, rng: np.random.Generator) -> Odd | None:
    """The few recordings without which a model is adequate; None where there are none."""
    for found, part, rest in _taken_away(problem, fit):
        if not detect(part, rest, (), rng).discrepant:
            commands = {i: j for i in found if (j := command_of(problem, rest, i)) is not None}
            numbers = {i: w for i in found if (w := described(problem, rest, i)) is not None}
            commands = {i: j for i, j in commands.items() if not (i in numbers and _plain(numbers[i]))}
            numbers = {i: w for i, w in numbers.items() if i not in commands}
            slips = {i: w for i, w in numbers.items() if not _describes(problem, i, w.chi2)}
            return Odd(found, tuple(w for i, w in numbers.items() if i not in slips), commands, slips)
    return None


def _describes(problem: Problem, i: int, chi2: float) -> bool:
    """Whether a recording's chi^2 is such as noise makes it."""
    return bool(scipy.stats.chi2.sf(chi2, problem.system.observations[i].independent) >= SINGLE)


def command_of(problem: Problem, fit: Fit, i: int) -> int | None:
    """The other recording by whose command this one was driven; None where no command describes it."""
    chi2, other = _by_command(problem, fit, i)
    return other if _describes(problem, i, chi2) else None


def _by_command(problem: Problem, fit: Fit, i: int) -> tuple[float, int]:
    """(chi^2 of a recording driven as the other one whose command suits it best, that one); inf where none can."""
    if not isinstance(problem.system, Commanded):
        return math.inf, -1
    alone, observations = _Alone(problem, fit, i), problem.system.observations
    best = (math.inf, -1)
    for j in (j for j in problem.all if observations[j].condition != observations[i].condition):
        y = problem.system.predict_commanded(fit.mechanisms, fit.named, i, j)
        if np.isfinite(y).all():
            r = problem.whitening[i].whitened(observations[i].y - y, alone.frame)
            best = min(best, (float(r @ r), j))
    return best


def _strange(problem: Problem, i: int, fall: float) -> bool:
    """Whether a recording's chi^2 is larger than noise makes any; size and tails of the noise as they were learned."""
    n, noise = problem.system.observations[i].independent, problem.noise
    spread = math.sqrt((noise.kurtosis - 1.0) / max(n, 1) + noise.log_power**2)
    z = math.log(max(fall, 1e-300) / max(n, 1)) / spread
    return len(problem.all) * float(scipy.stats.norm.sf(z)) < SINGLE


def _fall(fit: Fit, i: int) -> float:
    """By what chi^2 falls without a recording, linear about the fit."""
    r, j = fit.residuals[i], fit.jacobian[i]
    if not fit.parameters:
        return float(r @ r)
    whole = sum((x.T @ x for x in fit.jacobian), fit.known.precision)
    rest = whole - j.T @ j + 1e-9 * np.diag(np.diag(whole))
    slope = j.T @ r
    return float(r @ r + slope @ np.linalg.solve(rest, slope))


def described(problem: Problem, fit: Fit, i: int) -> Weighed | None:
    """One number of a recording with which the model describes it, else two; the others as they are fitted."""
    alone = _Alone(problem, fit, i)
    usable = [v for v in variables(problem.system).values() if not v.whole]
    singles = [_Tried((v,), x) for v in usable if (x := alone.fitted((v,), [*_grid(v), *_factors(v)])) is not None]
    if (found := _best(singles, alone, len(usable))) is not None:
        return found
    if isinstance(problem.system, Costly):  # two by two takes more runs than the question
        return None
    top = sorted(singles, key=lambda x: x.found.chi2)[:FEW]
    some = [(a.variables[0], b.variables[0]) for a, b in itertools.combinations(top, 2)]
    some += [p for p in itertools.combinations([v for v in usable if v.drive], 2) if p not in some]
    first = {x.variables[0].name: x.found.values[0] for x in singles}
    pairs = []
    for a, b in some:
        starts = [np.array([first.get(a.name, 0.0), 0.0]), np.array([0.0, first.get(b.name, 0.0)])]
        if a.drive and b.drive:
            starts += [np.concatenate(x) for x in itertools.product(_grid(a), _grid(b))]
        if (found_pair := alone.fitted((a, b), starts)) is not None:
            pairs.append(_Tried((a, b), found_pair))
    return _best(pairs, alone, len(usable))


def _grid(v: Variable) -> list[Array]:
    return [np.array([f * v.spread]) for f in (0.0, *GRID)]


def _factors(v: Variable) -> list[Array]:
    return [np.array([f - 1.0]) for f in FACTORS] if v.relative else []


@dataclass(frozen=True)
class _Found:
    """chi^2 of a recording, numbers of its own (k,) and their covariance."""

    chi2: float
    values: Array
    covariance: Array


@dataclass(frozen=True)
class _Tried:
    variables: tuple[Variable, ...]
    found: _Found

    @property
    def widths(self) -> Array:
        """Of the numbers before the data: a mistake of a factor is as likely as a small one; `_best` pays for as many
        sizes as `patterns.weigh` tries."""
        spread = np.array([v.spread for v in self.variables])
        return np.maximum(WIDTHS[-1] * spread, np.abs(self.found.values))

    @property
    def log_evidence(self) -> float:
        size, spread = self.found.values / self.widths, self.widths
        volume = 0.5 * float(np.linalg.slogdet(self.found.covariance)[1]) - float(np.sum(np.log(spread)))
        price = sum(v.log_price for v in self.variables)
        return -0.5 * self.found.chi2 - 0.5 * float(size @ size) + volume - price


def _best(tried: Sequence[_Tried], alone: _Alone, count: int) -> Weighed | None:
    """The likeliest, where it describes the recording."""
    if not tried:
        return None
    best = max(tried, key=lambda x: x.log_evidence)
    alike = [x for x in tried if x.log_evidence > best.log_evidence - AS_WELL]
    best = next((x for x in alike if all(v.drive for v in x.variables)), best)  # entered by hand for each recording
    slip = best.found.chi2 < SLIP * alone.chi2((), np.zeros(0))
    if not (slip or _describes(alone.problem, alone.i, best.found.chi2)):
        return None
    design = np.zeros((len(alone.problem.all), len(best.variables)))
    design[alone.i] = 1.0
    price = math.log(len(alone.problem.all)) + len(best.variables) * math.log(count * len(WIDTHS))
    whole = price + sum(v.log_price for v in best.variables)
    also = tuple(" and ".join(v.name for v in x.variables) for x in alike if x is not best)
    pattern = Pattern(
        best.variables, Kind.ODD, None, design, (alone.i,), log_price=whole, widths=best.widths, also=also
    )
    found, log = best.found, best.log_evidence - price
    return Weighed(pattern, found.values, found.covariance, found.chi2, log, alone.fit.named)


class _Alone:
    """One recording with numbers of its own, all that it shares with others as it is."""

    def __init__(self, problem: Problem, fit: Fit, i: int) -> None:
        self.problem, self.fit, self.i = problem, fit, i
        self.frame = problem.frame(fit.mechanisms, fit.named, [i])[0]

    def residual(self, chosen: Sequence[Variable], x: Array) -> Array | None:
        i, system = self.i, self.problem.system
        changes = {v.name: np.zeros(len(self.problem.all)) for v in chosen}
        for v, value in zip(chosen, x):
            changes[v.name][i] = max(float(value), v.least)
        y = predicted(system, self.fit.mechanisms, self.fit.named, changes, [i])[0]
        if not np.isfinite(y).all():
            return None
        return self.problem.whitening[i].whitened(system.observations[i].y - y, self.frame)

    def chi2(self, chosen: Sequence[Variable], x: Array) -> float:
        r = self.residual(chosen, x)
        with np.errstate(over="ignore"):  # a number that is far off may make the motion run away
            return math.inf if r is None else float(r @ r)

    def fitted(self, chosen: Sequence[Variable], starts: Sequence[Array]) -> _Found | None:
        """From the best of some starts."""
        cost = [(self.chi2(chosen, x), k) for k, x in enumerate(starts)]
        if not cost or not math.isfinite(min(cost)[0]):
            return None
        x = starts[min(cost)[1]]
        steps, spread = np.array([v.step for v in chosen]), np.array([v.spread for v in chosen])
        damping = 1e-3
        for _ in range(LAPS):
            if (moved := self._jacobian(chosen, x, steps)) is None:
                return None
            r, j = moved
            wide = LOOSE * np.maximum(spread, np.abs(x))
            inner = j.T @ j + np.diag(wide**-2.0)
            full = inner + damping * np.diag(np.diag(inner))
            step = np.linalg.solve(full, j.T @ r - x / wide**2)
            there = self.chi2(chosen, x + step)
            gained = float(r @ r) - there
            if gained > 0:
                x, damping = x + step, damping / 10
                if gained < ENOUGH:
                    break
            else:
                damping *= 10
                if damping > 1e3:
                    break
        if (moved := self._jacobian(chosen, x, steps)) is None:
            return None
        r, j = moved
        return _Found(float(r @ r), x, np.asarray(np.linalg.inv(j.T @ j + np.diag(spread**-2.0))))

    def _jacobian(self, chosen: Sequence[Variable], x: Array, steps: Array) -> tuple[Array, Array] | None:
        r = self.residual(chosen, x)
        if r is None:
            return None
        columns = []
        for k in range(x.size):
            moved = x.copy()
            moved[k] += steps[k]
            there = self.residual(chosen, moved)
            if there is None:
                return None
            columns.append((r - there) / steps[k])
        return r, np.stack(columns, axis=1)
