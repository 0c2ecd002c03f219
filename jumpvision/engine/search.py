"""The search over sets of mechanisms: forward by one and by two, backward, by exchange; several routes are kept.

No set is taken for the answer before it passes the test that the baseline failed. What is worth a fit is judged first
by the residuals of sets that were fitted: linear in the strengths, each within its range.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from jumpvision.base.arrays import Array

from .detect import Detection, Direction, detect, directions
from .fitting import Fit, Problem
from .system import Candidate, Costly, Parameter

MOST = 4  # mechanisms in a set
ONES, TWOS = 4, 4  # extensions of a set by one mechanism, and by two, that its residuals ask for
LAP, LAPS = 4, 6  # iterations of a fit before it is compared with the others, and how often
FEW = 8  # conditions that the first lap goes over
BEHIND, CLOSE = 3.0, 50.0  # a fit goes on while its chi^2 is less than this many laps, or this much, behind the best
WORTH = 0.1  # share of the excess of chi^2 that a mechanism whose runs are dear must take to be tried alone
NEAR = 2.0  # chi^2 per degree of freedom up to which a fit that fails the test may only have stopped short
ROUTES = 3  # best sets of each size that are built upon
LEADING = 8  # sets that go on after the first lap, beside all that are CLOSE to the best

Start = tuple[tuple[str, ...], dict[str, float]]
Key = frozenset[str]

Enough = Callable[["Search"], bool]


def log_prior(chosen: Collection[str], candidates: Mapping[str, Candidate]) -> float:
    """ln of the probability of a set before the data: every number of causes from 0 to MOST alike, and every set of
    one number alike. What was chosen among many counts as one of them, at its price."""
    bought = [c.price for c in candidates.values() if c.price > 0.0]
    vocabulary = len(candidates) - len(bought) + (1 if bought else 0)
    price = sum(candidates[m].price for m in chosen)
    return -math.log((min(MOST, vocabulary) + 1) * max(math.comb(vocabulary, len(chosen)), 1)) - price


class Search:
    """Sets of mechanisms that were fitted, and the tests of those that were looked at.

    fits: the best fit of every set; tests: of its residuals.
    """

    def __init__(self, problem: Problem, base: Fit, found: Detection, rng: np.random.Generator) -> None:
        self.problem, self.base, self.rng = problem, base, rng
        self.fits: dict[Key, Fit] = {frozenset(): base}
        self.tests: dict[Key, Detection] = {frozenset(): found}

    def run(self, enough: Enough | None = None) -> None:
        """Sets of one mechanism, then of one more until one passes, or none is likelier than the smaller ones.

        enough: asked where no set of two passes, whether larger ones need not be tried.
        """
        candidates = self.problem.system.candidates
        found, asked = self.tests[frozenset()], list(candidates)
        asked = [m for m in asked if not candidates[m].dear or self.asks_for(m)]
        begun = self.problem.each(partial(starts, self.problem, self.base, found, m) for m in asked)
        self.race([s for some in begun for s in some])
        for size in range(1, MOST + 1):
            if size > 1:
                self.race([*self.forward(size)])
            if not self.ranked(size) or self.settled(size):
                return
            # pairs are tried before a law of no vocabulary is
            if size == 2 and enough is not None and enough(self):
                return
            before, after = (self.fits[self.ranked(k)[0]] for k in (size - 1, size))
            # still larger sets are tried where this one took a tenth of the excess of chi^2
            if before.chi2 - after.chi2 < 0.1 * (before.chi2 - self.problem.n):
                return

    def asks_for(self, mechanism: str) -> bool:
        """Whether a mechanism would take a share of the baseline's excess of chi^2, linear in its strength."""
        found = self.tests[frozenset()]
        most = max((z * z for d, z in zip(found.directions, found.score) if d.mechanism == mechanism), default=0.0)
        return bool(most > WORTH * max(self.base.chi2 - self.problem.n, 0.0))

    # -- what is known ---------------------------------------------------------------------------------------------
    def log_probability(self, key: Key) -> float:
        """ln of a set's probability after the data, up to a constant."""
        return self.fits[key].log_evidence + log_prior(key, self.problem.system.candidates)

    def ranked(self, size: int) -> list[Key]:
        """The sets of a size, the likeliest first."""
        return sorted((k for k in self.fits if len(k) == size), key=lambda k: -self.log_probability(k))

    def test(self, key: Key) -> Detection:
        """The test of a set's residuals."""
        if key not in self.tests:
            self._look(key)
            near = self.tests[key].discrepant and self.tests[key].chi2_per_dof < NEAR
            if near and isinstance(self.problem.system, Costly) and self.keep(self._better(key)):
                self._look(key)  # what a fit that stopped short leaves is no misfit
        return self.tests[key]

    def _better(self, key: Key) -> Fit:
        return self.problem.polished(self.fits[key], about=False)

    def _look(self, key: Key) -> None:
        fit = self.fits[key]
        self.tests[key] = detect(self.problem, fit, directions(self.problem, fit), self.rng)

    def passing(self) -> list[Key]:
        """The sets whose residuals are noise, the likeliest first."""
        good = [k for k, t in self.tests.items() if not t.discrepant]
        return sorted(good, key=lambda k: -self.log_probability(k))

    def keep(self, fit: Fit | None) -> bool:
        """Whether a fit is better than the one of its set that is known; it then takes its place."""
        if fit is None:
            return False
        key = frozenset(fit.mechanisms)
        # a fit has stopped short where another start gains this much chi^2
        if key in self.fits and fit.chi2 >= self.fits[key].chi2 - 1.0:
            return False
        self.fits[key] = fit
        self.tests.pop(key, None)
        return True

    # -- what is tried ---------------------------------------------------------------------------------------------
    def race(self, tried: Sequence[Start]) -> None:
        for fit in race(self.problem, tried, LEADING):
            self.keep(fit)

    def settled(self, size: int) -> bool:
        """Whether a set of this size passes, mechanisms of the best one having been exchanged for others."""
        for _ in range(3):  # rounds in which one mechanism of the best set is put in place of another
            best = self.ranked(size)[0]
            if any(not self.test(k).discrepant for k in self.ranked(size)[:ROUTES]):
                self.without(self.passing()[0])
                return True
            if size == 1:
                return False
            smaller = self.without(best)
            self.race([s for k in smaller for s in self.extended(k, 1, ONES)])
            if self.ranked(size)[0] == best:
                return False
        return not self.test(self.ranked(size)[0]).discrepant

    def without(self, key: Key) -> list[Key]:
        """The set with each of its mechanisms taken away, fitted from its values; what hardly loses is tested."""
        whole, out = self.fits[key], []
        rests = [tuple(x for x in whole.mechanisms if x != m) for m in whole.mechanisms if len(key) > 1]
        known = [r for r in rests if isinstance(self.problem.system, Costly) and frozenset(r) in self.fits]
        wanted = [r for r in rests if r not in known]  # another start of what was fitted is not worth dear runs
        for fit in self.problem.each(partial(self.problem.fit, rest, whole.named) for rest in wanted):
            self.keep(fit)
        for rest in rests:
            if (smaller := frozenset(rest)) in self.fits:
                out.append(smaller)
                # a set that loses no more chi^2 without one of its mechanisms may do without it
                if self.fits[smaller].chi2 < whole.chi2 + 30.0:
                    self.test(smaller)
        return out

    def forward(self, size: int) -> Iterator[Start]:
        """Sets of one size: the best smaller ones extended by one, those smaller still by two, and kin."""
        for key in self.ranked(size - 1)[:ROUTES]:
            yield from self.extended(key, 1, ONES)
        for key in self.ranked(size - 2)[: ROUTES - 1]:
            yield from self.extended(key, 2, TWOS)
        candidates = self.problem.system.candidates
        for key in self.ranked(size - 2)[:1]:
            for m, c in candidates.items():
                for kin in (o for o in c.goes_with if o in candidates and m < o and not {m, o} & key):
                    yield from self.begun(key | {m, kin}, [])

    def extended(self, key: Key, by: int, n: int) -> Iterator[Start]:
        """The n extensions of a set by so many mechanisms that take most from its chi^2, linear in their strengths."""
        fit, test = self.fits[key], self.test(key)
        best: dict[Key, tuple[float, tuple[Direction, ...], Array]] = {}
        for some, gained, strengths in combinations(self.problem, fit, test, by):
            names = frozenset(d.mechanism for d in some)
            if names not in best or gained > best[names][0]:
                best[names] = (gained, some, strengths)
        for names, (_, some, strengths) in sorted(best.items(), key=lambda x: -x[1][0])[:n]:
            if by > 1 and key | names in self.fits:
                continue
            values = dict(fit.named)
            for d, z in zip(some, strengths):
                strength = self.problem.system.candidates[d.mechanism].parameters[0].name
                begin = start_of(self.problem, fit, d, float(z))
                values |= {k: v for k, v in begin.items() if k not in fit.named or k == strength}
            yield from self.begun(key | names, [values])
        if by == 1:
            yield from self.in_place(key)

    def in_place(self, key: Key) -> Iterator[Start]:
        """The set with a mechanism in place of a term of the baseline, with the values that it has alone."""
        candidates = self.problem.system.candidates
        gone = {candidates[m].replaces for m in key}
        for m, c in candidates.items():
            alone = self.fits.get(frozenset((m,)))
            if c.replaces and c.replaces not in gone and alone is not None and key | {m} not in self.fits:
                own = self.fits[key].named
                yield from self.begun(key | {m}, [{**own, **alone.named}, {**alone.named, **own}])

    def begun(self, key: Key, warm: Sequence[dict[str, float]]) -> list[Start]:
        """The two best starts of a set: those given, shares of their strengths, ordinary strengths beside the values of
        the best of its parts."""
        candidates = self.problem.system.candidates
        names = tuple(n for n in candidates if n in key)
        strengths = [(candidates[n].parameters[0], candidates[n].null) for n in names if not candidates[n].replaces]
        part = self.fits[min((k for k in self.fits if k < key), key=lambda k: self.fits[k].chi2)]
        first = {p.name: p.start for p in self.problem.system.baseline}
        tries = list(warm)
        for values in [part.named] if warm else [part.named, first, self.base.at_low]:
            absent = [(p, null) for p, null in strengths if p.name not in values]
            for factors in itertools.product((1.0, 4.0), repeat=min(len(absent), 2)):
                for sign in (1.0, -1.0):
                    moved = dict(values)
                    for (p, null), factor in zip(absent, (*factors, *[1.0] * len(absent))):
                        moved[p.name] = min(max(null + sign * factor * p.scale, p.low), p.high)
                    tries.append(moved)
        tries += [{**part.named, **c.begin} for n in names if (c := candidates[n]).begin is not None]
        tries += [{**w, **{p.name: null + 0.3 * (w[p.name] - null) for p, null in strengths}} for w in warm]
        return best_starts(self.problem, part, names, tries, 2)


def combinations(
    problem: Problem, fit: Fit, test: Detection, by: int
) -> Iterator[tuple[tuple[Direction, ...], float, Array]]:
    """(directions of different mechanisms, fall of chi^2, coefficients of the unit vectors), linear about a fit."""
    found = [(d, float(z), *limits(problem, fit, d)) for d, z in zip(test.directions, test.score)]
    if by == 1:
        for d, z, low, high in found:
            at = min(max(z, low), high)
            yield (d,), z * z - (z - at) ** 2, np.array([at])
        return
    for (a, za, la, ha), (b, zb, lb, hb) in itertools.combinations(found, 2):
        c = float(a.vector @ b.vector)
        if a.mechanism == b.mechanism or abs(c) > 0.999999:  # cosine of two directions that cannot be told apart
            continue
        x = min(max((za - c * zb) / (1.0 - c * c), la), ha)
        y = min(max(zb - c * x, lb), hb)
        x = min(max(za - c * y, la), ha)
        yield (a, b), 2 * (x * za + y * zb) - x * x - y * y - 2 * c * x * y, np.array([x, y])


def limits(problem: Problem, fit: Fit, d: Direction) -> tuple[float, float]:
    """Range of a direction's coefficient that the range of its mechanism's strength allows."""
    candidate = problem.system.candidates[d.mechanism]
    strength = candidate.parameters[0]
    null = fit.named.get(strength.name, candidate.null)
    low, high = sorted(((strength.low - null) / d.strength, (strength.high - null) / d.strength))
    return min(low, 0.0), max(high, 0.0)


def race(problem: Problem, starts: Sequence[Start], leading: int = LEADING) -> list[Fit]:
    """The best fit of every set of mechanisms, the likeliest first; those that cannot win are not fitted to the end.

    The first lap goes over a few conditions only; who leads there goes on, and what was found to fit before.
    """
    few, candidates = some(problem, FEW), problem.system.candidates
    # what some recordings have for themselves shows in those alone
    whole = [(m, s) for m, s in starts if any(candidates[x].begin is not None for x in m)]
    first_lap = [x for x in starts if x not in whole]
    tried = problem.each(partial(problem.fit, m, s, few, LAP) for m, s in first_lap)
    first = sorted((f for f in tried if f is not None), key=lambda f: f.chi2)
    lap: dict[Key, Fit] = {}
    for fit in first:
        lap.setdefault(frozenset(fit.mechanisms), fit)
    ahead = list(lap.values())[:leading]
    ahead += [f for f in lap.values() if f.chi2 < ahead[0].chi2 + CLOSE and f not in ahead]
    onward = [*whole, *((g.mechanisms, g.named) for g in ahead)]
    begun = problem.each(partial(problem.fit, m, s, iterations=LAP) for m, s in onward)
    running = [f for f in begun if f is not None]
    for _ in range(LAPS):
        best = min((f.chi2 for f in running), default=0.0)
        slow = [
            i
            for i, f in enumerate(running)
            if not f.converged and f.chi2 - best <= max(BEHIND * (f.chi2_first - f.chi2), CLOSE)
        ]
        if not slow:
            break
        more = problem.each(
            partial(problem.fit, f.mechanisms, iterations=LAP, onward=f) for f in map(running.__getitem__, slow)
        )
        for i, further in zip(slow, more):
            assert further is not None
            running[i] = further
    out: dict[Key, Fit] = {}
    for fit in sorted(running, key=lambda f: -f.log_evidence):
        out.setdefault(frozenset(fit.mechanisms), fit)
    return list(out.values())


def some(problem: Problem, n: int) -> list[int]:
    """One observation of each of about n conditions, spread over them."""
    first = {o.condition: i for i, o in reversed(list(enumerate(problem.system.observations)))}
    every = sorted(first.values())
    return every[:: max(len(every) // n, 1)]


def starts(problem: Problem, base: Fit, found: Detection, mechanism: str) -> list[Start]:
    """The two best of a few strengths and shapes, and of the linear estimates from the baseline's residuals."""
    candidate = problem.system.candidates[mechanism]
    if candidate.begin is not None:
        return [((mechanism,), {**base.named, **candidate.begin})]
    if candidate.replaces:
        first = {p.name: p.start for p in problem.system.baseline}  # a baseline without it may have been bent far off
        tries = _about(candidate.parameters, base.named) + _about(candidate.parameters, first)
        last = candidate.parameters[-1].name  # a place, such as the depth of a bend: each its own basin
        places = sorted({t[last] for t in tries})
        return [
            s for x in places for s in best_starts(problem, base, (mechanism,), [t for t in tries if t[last] == x], 2)
        ]
    linear = [
        start_of(problem, base, d, float(z)) for d, z in zip(found.directions, found.score) if d.mechanism == mechanism
    ]
    if not linear:
        return []
    strength, *others = candidate.parameters
    tries = list(linear)
    for shape in candidate.shapes:
        fixed = dict(zip((p.name for p in others), shape or [p.start for p in others]))
        for factor in (-3.0, -1.0, -0.3, 0.3, 1.0, 3.0, 10.0):
            value = base.named.get(strength.name, candidate.null) + factor * strength.scale
            if strength.low <= value <= strength.high:
                tries.append({**base.named, **fixed, strength.name: value})
    return best_starts(problem, base, (mechanism,), tries, 2)


def _about(free: Sequence[Parameter], values: dict[str, float]) -> list[dict[str, float]]:
    """The parameters' first values and combinations of others a few scales away, beside given values of the rest."""
    grid = itertools.product((-3.0, 0.0, 4.0), repeat=len(free))
    return [
        {**values, **{p.name: min(max(p.start + f * p.scale, p.low), p.high) for p, f in zip(free, factors)}}
        for factors in grid
    ]


def best_starts(
    problem: Problem, fit: Fit, mechanisms: tuple[str, ...], tries: Sequence[dict[str, float]], n: int
) -> list[Start]:
    """The n starts of least cost over a few conditions; the one where runs are dear. Trials scatter as about `fit`."""
    few = problem.scouts(some(problem, FEW))
    frame = [fit.frame[i] for i in few]
    cost = problem.costs(mechanisms, tries, few, frame)
    n = 1 if isinstance(problem.system, Costly) else n
    return [(mechanisms, tries[i]) for i in np.argsort(cost)[:n] if math.isfinite(cost[i])]


def start_of(problem: Problem, fit: Fit, direction: Direction, score: float) -> dict[str, float]:
    """First values of a fit with one more mechanism: its strength as the linear estimate has it, within its range."""
    strength, *others = problem.system.candidates[direction.mechanism].parameters
    null = problem.system.candidates[direction.mechanism].null
    base = fit.named.get(strength.name, null)
    value = min(max(base + direction.strength * score, strength.low), strength.high)
    if value == base:  # the estimate lies on the wrong side of the null
        value = min(max(base + 0.1 * strength.scale, strength.low), strength.high)
    shape = dict(zip((p.name for p in others), direction.shape or [p.start for p in others]))
    return {**shape, **fit.named, strength.name: value}
