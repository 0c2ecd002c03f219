"""Which mechanism explains what the baseline gets wrong: every one is fitted, alone and, where that fails, in pairs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jumpvision.base.arrays import Z90

from .detect import Detection, Direction, Span, detect, directions
from .fitting import Fit, Problem
from .system import Parameter

CONFIDENCE = 0.9  # of the set of models that is kept
FIRSTS, SECONDS = 4, 4  # pairs tried: the best single ones, each with those its residuals ask for
SHORT = 1.0  # of chi^2 by which a fit is said to have stopped short
WORTH = 3.0  # of log evidence that a second mechanism must bring
LAP, LAPS = 5, 6  # iterations of a fit before it is compared with the others, and how often
LEFT = 0.01  # of the baseline's excess of chi^2: a mechanism that leaves less is named, though the rest shows.
# Substitutes for an effect of no vocabulary leave 3 to 16 %.
SHARE = 1 / 3  # of a named effect: a mechanism that may make so much of it is declared beside it
BEHIND, CLOSE = 3.0, 50.0  # a fit goes on while its chi^2 is less than this many laps, or this much, behind the best


@dataclass(frozen=True)
class Explanation:
    """A model that was tried. probability: among all tried, equal before; delta_score: held-out log-likelihood gain."""

    fit: Fit
    probability: float
    delta_score: float
    detection: Detection | None = None

    @property
    def mechanisms(self) -> tuple[str, ...]:
        return self.fit.mechanisms


@dataclass(frozen=True)
class Naming:
    """named: () when no model in the vocabulary passes the test that the baseline failed, nor leaves less than LEFT.

    tried: best first. twins: the mechanisms beside each named one that would do as well, itself included. remainder:
    share of what the baseline got wrong (its excess of chi^2) that the named ones leave; 0 where they pass the test.
    """

    named: tuple[str, ...]
    best: Explanation
    tried: tuple[Explanation, ...]
    twins: tuple[tuple[str, ...], ...]
    remainder: float = 0.0

    def probability(self, mechanism: str) -> float:
        return sum(e.probability for e in self.tried if mechanism in e.mechanisms)


def name(problem: Problem, base: Fit, found: Detection, rng: np.random.Generator) -> Naming:
    """Fits every mechanism of the vocabulary, then pairs if no single one passes the test."""
    singles = race(problem, [s for m in problem.system.candidates for s in _starts(problem, base, found, m)])
    models, tests = [base, *singles], {}
    for fit in singles[:FIRSTS]:
        tests[fit.mechanisms] = detect(problem, fit, directions(problem, fit), rng)
        if not tests[fit.mechanisms].discrepant:
            break
    if all(t.discrepant for t in tests.values()):
        alone = {f.mechanisms[0]: f.log_evidence for f in singles}
        pairs = race(problem, _pairs(problem, base, singles, tests))
        worth = [f for f in pairs if f.log_evidence > WORTH + max(alone.get(m, -math.inf) for m in f.mechanisms)]
        models += pairs
        for fit in worth[:2]:
            tests[fit.mechanisms] = detect(problem, fit, directions(problem, fit), rng)
            for better in simpler(problem, fit, singles):
                models = [f for f in models if f.mechanisms != better.mechanisms] + [better]
                tests[better.mechanisms] = detect(problem, better, directions(problem, better), rng)
    weight = np.array([f.log_evidence for f in models])
    weight = np.exp(weight - weight.max())
    weight /= weight.sum()
    score = held_out_score(problem, base)
    tried = tuple(
        Explanation(f, float(w), held_out_score(problem, f) - score, tests.get(f.mechanisms))
        for w, f in sorted(zip(weight, models), key=lambda x: -x[1].log_evidence)
    )
    passed = [e for e in confidence_set(tried) if e.detection is not None and not e.detection.discrepant]
    if passed:
        return Naming(passed[0].mechanisms, passed[0], tried, _twins(problem, passed[0], tried))
    excess = base.chi2 - problem.n
    left = {e.mechanisms: (e.fit.chi2 - problem.n) / excess for e in tried}
    nearly = min((e for e in tried if left[e.mechanisms] < LEFT), key=lambda e: len(e.mechanisms), default=None)
    if nearly is None or LEFT * excess < 3.0 * math.sqrt(2.0 * problem.n):  # so little would be lost in the noise
        return Naming((), tried[0], tried, ())
    test = nearly.detection or detect(problem, nearly.fit, directions(problem, nearly.fit), rng)
    nearly = replace(nearly, detection=test)
    return Naming(nearly.mechanisms, nearly, tried, _twins(problem, nearly, tried), left[nearly.mechanisms])


def simpler(problem: Problem, pair: Fit, singles: Sequence[Fit]) -> list[Fit]:
    """Single mechanisms of a pair that fit better from the pair's values than alone: they had stopped short."""
    chi2 = {f.mechanisms: f.chi2 for f in singles}
    again = [problem.fit((m,), pair.named) for m in pair.mechanisms]
    return [f for f in again if f is not None and f.chi2 < chi2.get(f.mechanisms, math.inf) - SHORT]


Start = tuple[tuple[str, ...], dict[str, float]]


def race(problem: Problem, starts: Sequence[Start]) -> list[Fit]:
    """The best fit of every set of mechanisms, the likeliest first; those that cannot win are not fitted to the end."""
    running = [f for m, s in starts if (f := problem.fit(m, s, iterations=LAP)) is not None]
    for _ in range(LAPS):
        best = min((f.chi2 for f in running), default=0.0)
        slow = []
        for i, fit in enumerate(running):
            if fit.converged or fit.chi2 - best > max(BEHIND * (fit.chi2_first - fit.chi2), CLOSE):
                continue
            more = problem.fit(fit.mechanisms, fit.named, iterations=LAP)
            assert more is not None
            running[i] = more
            slow.append(i)
        if not slow:
            break
    out: dict[frozenset[str], Fit] = {}
    for fit in sorted(running, key=lambda f: -f.log_evidence):
        out.setdefault(frozenset(fit.mechanisms), fit)
    return list(out.values())


def _starts(problem: Problem, base: Fit, found: Detection, mechanism: str) -> list[Start]:
    """The two best of a few strengths and shapes, and of the linear estimates from the baseline's residuals."""
    candidate = problem.system.candidates[mechanism]
    if candidate.replaces:
        first = {p.name: p.start for p in problem.system.baseline}  # a baseline without it may have been bent far off
        tries = _about(candidate.parameters, base.named) + _about(candidate.parameters, first)
        last = candidate.parameters[-1].name  # a place, such as the depth of a bend: each its own basin
        places = sorted({t[last] for t in tries})
        return [s for x in places for s in best_starts(problem, (mechanism,), [t for t in tries if t[last] == x], 2)]
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
    return best_starts(problem, (mechanism,), tries, 2)


def _about(free: Sequence[Parameter], values: dict[str, float]) -> list[dict[str, float]]:
    """The parameters' first values and combinations of others a few scales away, beside given values of the rest."""
    grid = itertools.product((-3.0, 0.0, 4.0), repeat=len(free))
    return [
        {**values, **{p.name: min(max(p.start + f * p.scale, p.low), p.high) for p, f in zip(free, factors)}}
        for factors in grid
    ]


def best_starts(
    problem: Problem, mechanisms: tuple[str, ...], tries: Sequence[dict[str, float]], n: int
) -> list[Start]:
    """The n starts of least cost over one trial of each condition."""
    first = {o.condition: i for i, o in reversed(list(enumerate(problem.system.observations)))}
    cost = [problem.cost(mechanisms, t, sorted(first.values())) for t in tries]
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


def _pairs(problem: Problem, base: Fit, singles: Sequence[Fit], tests: dict[tuple[str, ...], Detection]) -> list[Start]:
    """Pairs of one of the best single mechanisms with those its residuals ask for, and those known to go together.

    Each from the end of the single fit and from ordinary strengths: a single fit that fails may have run far off.
    """
    pairs: dict[frozenset[str], list[dict[str, float]]] = {}
    candidates = problem.system.candidates
    for fit in singles[:FIRSTS]:
        test = tests[fit.mechanisms]
        asked: dict[str, tuple[float, Direction]] = {}
        for d, z in zip(test.directions, test.score):
            if abs(z) > abs(asked.get(d.mechanism, (0.0, d))[0]):
                asked[d.mechanism] = (float(z), d)
        for z, d in sorted(asked.values(), key=lambda x: -abs(x[0]))[:SECONDS]:
            pairs.setdefault(frozenset((*fit.mechanisms, d.mechanism)), []).append(start_of(problem, fit, d, z))
    for m, c in candidates.items():
        pairs |= {frozenset((m, o)): [] for o in c.goes_with if o in candidates and frozenset((m, o)) not in pairs}
    out: list[Start] = []
    for pair, warm in pairs.items():
        names = tuple(n for n in candidates if n in pair)
        tries = list(warm)
        for factors in ((1.0, 1.0), (4.0, 1.0), (1.0, 4.0), (4.0, 4.0)):
            for values in (base.named, {p.name: p.start for p in problem.system.baseline}, base.at_low):
                moved = dict(values)
                for n, factor in zip(names, factors):
                    strength = candidates[n].parameters[0]
                    moved[strength.name] = min(candidates[n].null + factor * strength.scale, strength.high)
                tries.append(moved)
        out += best_starts(problem, names, tries, 2)
    return out


def held_out_score(problem: Problem, fit: Fit) -> float:
    """Log-likelihood of each condition as predicted from the others, summed; by the curvature at the full fit."""
    n = len(fit.parameters)
    wide = np.array([12.0 / (p.high - p.low) ** 2 for p in fit.parameters])
    hessian = sum((j.T @ j for j in fit.jacobian), fit.known.precision + np.diag(wide) if n else np.zeros((0, 0)))
    total = 0.0
    conditions: dict[str, list[int]] = {}
    for i, o in enumerate(problem.system.observations):
        conditions.setdefault(o.condition, []).append(i)
    for held in conditions.values():
        r = np.concatenate([fit.residuals[i] for i in held])
        j = np.vstack([fit.jacobian[i] for i in held])
        rest = hessian - j.T @ j + 1e-12 * np.diag(np.diag(hessian)) if n else hessian
        slope = j.T @ r
        total -= 0.5 * float(r @ r)
        if n:
            total -= 0.5 * float(slope @ np.linalg.solve(rest, slope))
            total -= 0.5 * float(np.linalg.slogdet(hessian)[1] - np.linalg.slogdet(rest)[1])
    return total


def confidence_set(tried: Sequence[Explanation]) -> list[Explanation]:
    """The likeliest models that together hold CONFIDENCE of the probability."""
    out, total = [], 0.0
    for e in tried:
        out.append(e)
        total += e.probability
        if total >= CONFIDENCE:
            break
    return out


def _twins(problem: Problem, best: Explanation, tried: Sequence[Explanation]) -> tuple[tuple[str, ...], ...]:
    """For each named mechanism, those that may stand in its place, or make a third of its effect beside it."""
    out = []
    for m in best.mechanisms:
        rest = set(best.mechanisms) - {m}
        others = [
            next(iter(set(e.mechanisms) - rest))
            for e in confidence_set(tried)
            if rest <= set(e.mechanisms)
            and len(e.mechanisms) == len(best.mechanisms)
            and e is not best
            and m not in e.mechanisms
        ]
        others += shared(problem, best, m)
        if others:
            out.append((m, *dict.fromkeys(others)))
    return tuple(out)


def shared(problem: Problem, best: Explanation, mechanism: str) -> list[str]:
    """Mechanisms whose 90 % interval beside a named one reaches values at which a third of its effect is theirs.

    Linear about the fit: a mechanism's strength is estimated by what the fit cannot mimic of it, and takes from the
    named one what that can. A scale of the camera and a drag, seen over one short fall, are such a pair. The two that
    share most.
    """
    candidates, fit, test = problem.system.candidates, best.fit, best.detection
    named = candidates[mechanism]
    if test is None or named.replaces:
        return []
    strength = named.parameters[0]
    at = [p.name for p in fit.parameters].index(strength.name)
    span = Span(fit, without=strength.name)
    column = span.off(span.stack([j[:, at] for j in fit.jacobian]))
    size = float(np.linalg.norm(column))
    effect = (fit.values[at] - named.null) * size  # in noise units
    if effect == 0.0:
        return []
    share: dict[str, float] = {}
    for d, z in zip(test.directions, test.score):
        other = candidates[d.mechanism].parameters[0]
        null = fit.named.get(other.name, candidates[d.mechanism].null)
        low, high = sorted(((other.low - null) / d.strength, (other.high - null) / d.strength))
        mimics = float(column @ d.effect) / size / effect  # share of the named effect, at unit strength
        ends = (min(z, 0.0) - Z90, max(z, 0.0) + Z90)  # about 0 too: a track's own faults lean one way as easily
        reach = max(mimics * min(max(end, low), high) for end in ends)
        share[d.mechanism] = max(share.get(d.mechanism, 0.0), reach)
    return [m for m, x in sorted(share.items(), key=lambda x: -x[1]) if x >= SHARE][:2]


def likely(tried: Sequence[Explanation], at_least: float = 1e-4) -> list[str]:
    """Mechanisms by their probability."""
    total: dict[str, float] = {}
    for e in tried:
        for m in e.mechanisms:
            total[m] = total.get(m, 0.0) + e.probability
    return [m for m, p in sorted(total.items(), key=lambda x: -x[1]) if p >= at_least or math.isnan(p)]
