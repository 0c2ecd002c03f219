"""Which mechanisms explain what the baseline gets wrong, how likely each is, and what is left when all are tried."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jumpvision.base.arrays import Z90, Array, log_interval

from .detect import Detection, Span
from .document.values import Status
from .fitting import Fit, Problem
from .search import Enough, Key, Search, Start, limits, log_prior
from .system import System, by_condition

CONFIDENCE = 0.9  # of the set of models that is kept
# Of what a mechanism alone explains: more may not be left where it is named though misfit is left. Substitutes left 3 %
# and more in the laboratory's campaigns with effects outside the vocabulary (`benchmarks.causes laws`).
ESTABLISHED = 0.03
ONCE = 1.01  # of what a covariance is by its own slopes, beyond which it has been widened
SHARE = 1 / 3  # of a named effect: a mechanism that may make so much of it is declared beside it
CLEAR = 3.0  # standard uncertainties that a pattern's own coefficients must be off, beside a common value
TWIN = 50.0  # of chi^2: what an exchange would cost, linear, is judged by a fit if it is less
PRIORS = (1 / 3, 1.0, 3.0)  # factors on the ranges of all strengths, for the sensitivity of the probabilities


@dataclass(frozen=True)
class Explanation:
    """A model that was tried. probability: among all tried; delta_score: held-out log-likelihood gain."""

    fit: Fit
    probability: float
    delta_score: float
    detection: Detection | None = None

    @property
    def mechanisms(self) -> tuple[str, ...]:
        return self.fit.mechanisms


@dataclass(frozen=True)
class Naming:
    """named: what the data establish.

    best: the model of the named ones, else the likeliest. tried: best first. twins: the mechanisms beside each named
    one that would do as well, itself included. left: share of what the baseline got wrong (its excess of chi^2) that
    `best` leaves; 0 where it passes. probabilities: of each mechanism, with those under other priors (PRIORS), were the
    vocabulary all there is; suffices: the greatest chance that it is. widened: factor on the standard uncertainties of
    `best` for what is left. by_chance: nothing is named, and sets pass the test that are less likely than no cause.
    """

    named: tuple[str, ...]
    status: Status
    best: Explanation
    tried: tuple[Explanation, ...]
    twins: tuple[tuple[str, ...], ...]
    left: float
    probabilities: Mapping[str, tuple[float, ...]]
    widened: float = 1.0
    suffices: float = 1.0
    by_chance: bool = False

    def chances(self, mechanism: str) -> tuple[float, ...]:
        """Of a mechanism under each of PRIORS: what is not established may be in the place of something not listed."""
        share = 1.0 if mechanism in self.named else self.suffices
        return tuple(share * p for p in self.probabilities.get(mechanism, (0.0,) * len(PRIORS)))

    def probability(self, mechanism: str) -> float:
        """Of a mechanism, under the stated priors."""
        return self.chances(mechanism)[PRIORS.index(1.0)]


def name(
    problem: Problem,
    base: Fit,
    found: Detection,
    rng: np.random.Generator,
    enough: Enough | None = None,
    beside: Fit | None = None,
) -> Naming:
    """Searches over sets of mechanisms, and names those that the data establish. enough: see `Search.run`; beside: of
    what is named already, to which ways in which numbers vary are added, though it may pass the test without."""
    search = Search(problem, base, found, rng)
    search.run(enough)
    if beside is not None:
        known = frozenset(beside.mechanisms)
        if known not in search.fits:  # this search may not have come by it
            search.keep(problem.fit(beside.mechanisms, beside.named))
        search.race(varying(search, beside))
        if known in search.fits:
            check_likelier(search, known)
    top = max(search.fits, key=search.log_probability)
    if not has_own(problem, search.fits[top]):
        search.race(exchanges(search, top))  # the simpler cause in its place may not have been tried
    passing = likelier(search)
    key = passing[0] if passing else established(search)
    if key:
        search.race(exchanges(search, key))
        passing = likelier(search)
        key = passing[0] if passing else key
    likeliest = likeliest_of(search)
    stated = key or likeliest
    if (better := problem.polished(search.fits[stated])) is not search.fits[stated] and not search.keep(better):
        search.fits[stated] = better  # by so little that its test stands
    test = search.test(stated)
    left = left_of(problem, search.fits[stated], test.score)
    share = 0.0 if passing else left / max(left_of(problem, base, found.score), left)
    fit, wider = (search.fits[stated], 1.0) if passing else widened(problem.system, search.fits[stated])
    dispersion = max(search.test(likeliest).chi2_per_dof, 1.0) if not passing else 1.0
    explanations, probabilities = weighed(search, likeliest, 1.0 / dispersion)
    tried = tuple(replace(e, fit=fit) if frozenset(e.mechanisms) == stated else e for e in explanations)
    best = next(e for e in tried if frozenset(e.mechanisms) == stated)
    status = Status.COMPLETE if passing else Status.PARTIAL if key else Status.UNDETERMINED
    named = fit.mechanisms if key else ()
    twins = _twins(problem, best, tried) if key else ()
    suffices = 1.0 if passing else least_doubt(search.test(likeliest).p_value)
    by_chance = not key and bool(search.passing())
    return Naming(named, status, best, tried, twins, share, probabilities, wider, suffices, by_chance)


def check_likelier(search: Search, key: Key) -> None:
    """Tests the sets that are likelier than a given one, the likeliest first, until one passes. A search ends with the
    smallest sets that pass, before larger ones are tested."""
    chance = search.log_probability
    for k in sorted((k for k in search.fits if chance(k) > chance(key)), key=lambda k: -chance(k)):
        if not search.test(k).discrepant:
            return


def varying(search: Search, beside: Fit) -> list[Start]:
    """Starts of what is named with each way in which a number varies, and of the same less one mechanism."""
    candidates, named = search.problem.system.candidates, beside.mechanisms
    rests = [named, *(tuple(x for x in named if x != m) for m in named)]
    new = {n: c.begin for n, c in candidates.items() if c.begin is not None and n not in named}
    sets = [({*rest, n}, {**beside.named, **begin}) for n, begin in new.items() for rest in rests]
    return [(tuple(x for x in candidates if x in s), values) for s, values in sets]


def likelier(search: Search) -> list[Key]:
    """The sets that pass the test and are likelier than every part of them, no cause at all among these: a test of 2 %
    fails once in fifty where nothing is missing, and then some further mechanism always makes it pass."""
    chance = search.log_probability
    good = [k for k in search.passing() if has_own(search.problem, search.fits[k])]
    return [k for k in good if all(chance(k) > chance(part) for part in search.fits if part < k)]


def likeliest_of(search: Search) -> Key:
    """The likeliest set of mechanisms that are all more than a simpler cause."""
    ordered = sorted(search.fits, key=search.log_probability, reverse=True)
    return next(k for k in ordered if has_own(search.problem, search.fits[k]))


def has_own(problem: Problem, fit: Fit) -> bool:
    """Whether what makes each mechanism of a fit more than a simpler cause is off by CLEAR standard uncertainties."""
    names = [p.name for p in fit.parameters]
    for m in fit.mechanisms:
        if own := problem.system.candidates[m].own:
            at = [names.index(n) for n in own]
            x = fit.values[at]
            if float(x @ np.linalg.solve(fit.covariance[np.ix_(at, at)], x)) < CLEAR**2:
                return False
    return True


def least_doubt(p: float) -> float:
    """The greatest probability that a hypothesis of even odds has beside a p-value below 1/e, whatever the alternative
    (Sellke, Bayarri and Berger 2001): odds -e p ln p."""
    odds = -math.e * p * math.log(p) if 0.0 < p < 1.0 / math.e else float(p > 0.0)
    return odds / (1.0 + odds)


def established(search: Search) -> Key:
    """Of the likeliest set, the mechanisms beside whose own part what is left is small; may be empty.

    A mechanism's own part is what every set of no more mechanisms leaves without it. What is left may hide as much
    of any mechanism's effect as it shows; substitutes for an effect of no vocabulary leave 3 % of it and more.
    """
    key = likeliest_of(search)
    while key:
        # a pattern that is no more than a simpler cause is that cause: its sets are not without it
        fits = {k: f for k, f in search.fits.items() if has_own(search.problem, f)}
        if key not in fits:
            return frozenset()
        left = left_of(search.problem, fits[key], search.test(key).score)
        without = {m: min(f.chi2 for k, f in fits.items() if m not in k and len(k) <= len(key)) for m in key}
        weakest = min(without, key=lambda m: without[m])
        if left < ESTABLISHED * (without[weakest] - fits[key].chi2):
            return key
        search.without(key)
        key = key - {weakest}
    return key


def exchanges(search: Search, key: Key) -> list[Start]:
    """Starts of sets in which one mechanism is another that would, linear about the fit, do nearly as well."""
    problem, fit, test = search.problem, search.fits[key], search.test(key)
    out: list[Start] = []
    for m in fit.mechanisms:
        candidate = problem.system.candidates[m]
        strength = candidate.parameters[0]
        if candidate.replaces:
            continue
        at = [p.name for p in fit.parameters].index(strength.name)
        span = Span(fit, without=strength.name)
        effect = (fit.values[at] - candidate.null) * span.off(span.stack([j[:, at] for j in fit.jacobian]))
        rest = tuple(x for x in fit.mechanisms if x != m)
        for d in test.directions:
            column = span.off(d.effect)
            long = float(column @ column)
            low, high = limits(problem, fit, d)
            amount = min(max(float(column @ effect) / long, low), high) if long > 0 else 0.0
            lost = effect - amount * column
            other = problem.system.candidates[d.mechanism].parameters
            if float(lost @ lost) < TWIN:
                shape = dict(zip((p.name for p in other[1:]), d.shape))
                names = tuple(n for n in problem.system.candidates if n in (*rest, d.mechanism))
                null = problem.system.candidates[d.mechanism].null
                out.append((names, {**fit.named, **shape, other[0].name: null + amount * d.strength}))
    return out


def weighed(search: Search, best: Key, trust: float) -> tuple[tuple[Explanation, ...], dict[str, tuple[float, ...]]]:
    """(models that were fitted by their probability, probability of every mechanism under each of PRIORS).

    Sets with one more mechanism than the best are weighed too, linear in its strength. trust: power of the likelihood,
    below 1 where misfit is left that no model accounts for (quasi-likelihood: chi^2 over its dispersion).
    """
    problem, fits = search.problem, search.fits
    keys = sorted(fits, key=lambda k: -search.log_probability(k))
    more = supersets(search, best)
    sets = [*keys, *(best | {m} for m in more)]
    evidence = np.array([fits[k].log_evidence for k in keys] + [fits[best].log_evidence + x for x in more.values()])
    prior = np.array([log_prior(k, problem.system.candidates) for k in sets])
    size = np.array([len(k) for k in sets])
    weights = []
    for factor in PRIORS:
        log = trust * evidence + prior - size * math.log(factor)
        weight = np.exp(log - log.max())
        weights.append(weight / weight.sum())
    mechanisms = problem.system.candidates
    chances = {m: tuple(float(sum(w[i] for i, k in enumerate(sets) if m in k)) for w in weights) for m in mechanisms}
    score, likely = held_out_score(problem, search.base), weights[PRIORS.index(1.0)]
    return tuple(
        Explanation(fits[k], float(w), held_out_score(problem, fits[k]) - score, search.tests.get(k))
        for k, w in zip(keys, likely)
    ), chances


def supersets(search: Search, key: Key) -> dict[str, float]:
    """By what a further mechanism changes the log evidence of a set, where that set was not fitted: linear in its
    strength, which has all of its range before, and all its shapes alike."""
    problem, fit, test = search.problem, search.fits[key], search.test(key)
    odds: dict[str, list[float]] = {}
    for d, z in zip(test.directions, test.score):
        if key | {d.mechanism} in search.fits:
            continue
        low, high = limits(problem, fit, d)
        strength = problem.system.candidates[d.mechanism].parameters[0]
        width = strength.width / abs(d.strength)
        inside = float(log_interval(np.array(low - z), np.array(high - z)))
        odds.setdefault(d.mechanism, []).append(0.5 * (math.log(2 * math.pi) + z * z) + inside - math.log(width))
    return {m: float(np.logaddexp.reduce(x)) - math.log(len(x)) for m, x in odds.items()}


def held_out_score(problem: Problem, fit: Fit) -> float:
    """Log-likelihood of each condition as predicted from the others, summed; by the curvature at the full fit."""
    n = len(fit.parameters)
    wide = np.array([12.0 / (p.high - p.low) ** 2 for p in fit.parameters])
    hessian = sum((j.T @ j for j in fit.jacobian), fit.known.precision + np.diag(wide) if n else np.zeros((0, 0)))
    total = 0.0
    for held in by_condition(problem.system.observations):
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
        if total >= CONFIDENCE * sum(x.probability for x in tried):
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


def likely(naming: Naming, at_least: float = 1e-4) -> list[str]:
    """Mechanisms by their probability, those of the models that were fitted."""
    fitted = dict.fromkeys(m for e in naming.tried for m in e.mechanisms)  # in one order where two are as likely
    chance = {m: naming.probabilities.get(m, (0.0,) * len(PRIORS))[PRIORS.index(1.0)] for m in fitted}
    return [m for m, p in sorted(chance.items(), key=lambda x: -x[1]) if p >= at_least or m in naming.named]


def left_of(problem: Problem, fit: Fit, scores: Array) -> float:
    """chi^2 beyond what noise leaves, 0 or more: of all residuals, or in the direction of the greatest score."""
    top = float(np.max(np.abs(scores))) if scores.size else 0.0
    return max(fit.chi2 - problem.n, top * top, 0.0)


def widened(system: System, fit: Fit) -> tuple[Fit, float]:
    """(the fit with its covariance widened for misfit that it leaves, median factor on its standard uncertainties); a
    fit that is as wide already is left.

    A discrepancy is as large, along what the parameters do, as along any other of the few directions in which the
    residuals of one kind of motion vary: their excess of chi^2 is shared out over the participation ratio of the
    spectrum of their course in time, which is 1 where all motions of a kind are wrong alike.
    """
    observations = system.observations
    kinds: dict[str, list[int]] = {}
    for i, o in enumerate(observations):
        kinds.setdefault(str(o.labels.get("kind")), []).append(i)
    inner = fit.known.precision.astype(float)
    own = inner + sum(j.T @ j for j in fit.jacobian)
    if np.trace(fit.covariance @ own) > ONCE * max(len(fit.parameters), 1):
        return fit, 1.0
    for mine in kinds.values():
        excess = sum(float(fit.residuals[i] @ fit.residuals[i]) - observations[i].t.size + 1 for i in mine)
        course = np.stack([_course(fit.residuals[i]) for i in mine])
        spectrum = np.linalg.svd(course, compute_uv=False) ** 2
        directions = float(spectrum.sum() ** 2 / max(float(np.sum(spectrum**2)), 1e-300))
        factor = 1.0 + max(excess, 0.0) / directions
        inner = inner + factor * sum(fit.jacobian[i].T @ fit.jacobian[i] for i in mine)
    covariance = fit.covariance @ inner @ fit.covariance
    if not fit.parameters:
        return fit, 1.0
    before, after = np.sqrt(np.diag(fit.covariance)), np.sqrt(np.diag(covariance))
    wide = np.maximum(after, before)
    grown = np.divide(wide, after, out=np.zeros_like(wide), where=after > 0.0)
    covariance = covariance * np.outer(grown, grown)
    covariance[np.diag_indices_from(covariance)] = wide**2  # of what the recordings do not touch as it was
    return replace(fit, covariance=covariance), float(np.median(wide / before))


def _course(residual: Array) -> Array:
    """A residual (n,) as means over 40 equal parts of its motion."""
    # parts enough to see what residuals of one kind have in common
    parts = np.array_split(residual, 40)
    return np.array([p.mean() * math.sqrt(p.size) if p.size else 0.0 for p in parts])
