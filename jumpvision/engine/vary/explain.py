"""A model that is wrong explained by mechanisms and by what varies together: one search over both, by evidence.

Before mechanisms are tried, every number that was taken for constant is given its own value a recording; the patterns
that explain most of it stand beside the mechanisms in the search. Scatter without a pattern is a part of the noise: it
counts where that alone makes the model adequate and is likelier than every cause.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from jumpvision.base.arrays import Array
from jumpvision.engine.detect import Detection, detect, directions
from jumpvision.engine.document.values import Pattern as Kind
from jumpvision.engine.fitting import Fit, Problem
from jumpvision.engine.naming import Naming
from jumpvision.engine.search import log_prior
from jumpvision.engine.system import patterns_of

from .apart import Apart, apart, beside, variables
from .candidates import coefficient
from .odd import Odd, command_of, odd_ones
from .patterns import Pattern, Scatter, Weighed, patterns, scatter, weigh
from .screen import Screen, screen
from .variables import Varying

WORTH = 5.0  # nats that a pattern, or scatter, must gain over nothing before it is looked at
SHIFTED = 4.0  # standard uncertainties of the common value of what scatters: further from the declared one is no chance
SECOND = 8.0  # the same, where mechanisms were tried already


@dataclass(frozen=True)
class Varied:
    """A pattern that a model has, with its coefficients and their covariance. each: every recording's own change beside
    it. p_value: of as good a pattern of any number by noise alone."""

    pattern: Pattern
    coefficients: Array
    covariance: Array
    p_value: float
    each: Apart | None


@dataclass(frozen=True)
class Varies:
    """What varies: patterns that are named; scatter; recordings that no number of theirs explains, set aside; by the
    command of which other one some of these, or of the patterns, were driven; numbers of them that are far off."""

    patterns: tuple[Varied, ...] = ()
    scatter: Scatter | None = None
    aside: tuple[int, ...] = ()
    commands: Mapping[int, int] = field(default_factory=dict)
    slips: Mapping[int, Weighed] = field(default_factory=dict)

    @property
    def mistaken(self) -> bool:
        """Whether every recording that is set aside was driven as another, or has a number that is far off."""
        return all(i in self.commands or (i in self.slips and self.slips[i].far) for i in self.aside)

    def slipped(self, named: Sequence[str]) -> bool:
        """Whether all that is named is numbers of single recordings that are off by a factor."""
        return self.only_odd(named) and all(p.pattern.far(p.coefficients) for p in self.patterns)

    def only_odd(self, named: Sequence[str]) -> bool:
        """Whether all that is named is of recordings that stand apart."""
        odd = {v.pattern.name for v in self.patterns if v.pattern.kind is Kind.ODD}
        return bool(odd) and set(named) <= odd

    def __bool__(self) -> bool:
        return bool(self.patterns or self.scatter or self.aside)


@dataclass(frozen=True)
class Wider:
    """A problem with more candidates. screen: by which they were chosen."""

    problem: Problem
    screen: Screen
    odd: Odd | None


def wider(problem: Problem, about: Fit, rng: np.random.Generator, *, beside: bool = False) -> Wider:
    """The problem with patterns that the recordings ask for beside its mechanisms. beside: about a fit that has named
    causes; a pattern must then gain SECOND nats whatever else is there, or each takes up what another leaves."""
    worth = SECOND if beside else WORTH
    assert isinstance(problem.system, Varying)
    seen = screen(problem, about)
    few = odd_ones(problem, about, rng)
    offered = [w for w in seen.promising if _gain(w, seen) > worth]
    own = few.described if few else ()
    offered = [*own, *(w for w in offered if w.pattern.name not in {x.pattern.name for x in own})]
    system = problem.system.varying(offered, seen.log_price + SECOND * beside) if offered else problem.system
    return Wider(problem.asked_of(system), seen, few)


def _gain(w: Weighed, seen: Screen) -> float:
    """Nats that a pattern gains over none."""
    return w.log_evidence - seen.log_price + 0.5 * seen.base


def gained(problem: Problem, fit: Fit, base: Fit) -> float:
    """Nats that a set of mechanisms and patterns gains over the baseline."""
    candidates = problem.system.candidates
    prior = log_prior(fit.mechanisms, candidates) - log_prior((), candidates)
    return fit.log_evidence - base.log_evidence + prior


@dataclass(frozen=True)
class Scattered:
    """The problem in which a number scatters, its baseline and test."""

    problem: Problem
    baseline: Fit
    detection: Detection
    scatter: Scatter


def scattered(problem: Problem, seen: Screen, base: Fit, least: float, rng: np.random.Generator) -> Scattered | None:
    """The likeliest scatter where it gains more than `least` nats; its test says whether the model is adequate then."""
    if not seen.scatters:
        return None
    s = seen.scatters[0]
    s = replace(s, gained=s.log_evidence - seen.log_price + 0.5 * seen.base)
    # about another value than the declared one: then that value is a cause, beside which it may scatter
    if s.gained <= max(least, WORTH) or abs(s.shift) > SHIFTED:
        return None
    system = problem.system
    assert isinstance(system, Varying)
    sizes = {**problem.scattered, s.variable.name: s.value}
    with_it = Problem(system.scattered(s.variable.name, s.apart.change), problem.noise, sizes, problem.measured)
    fit = with_it.fit(base.mechanisms, s.apart.named)  # about which the changes were fitted
    return None if fit is None else Scattered(with_it, fit, detect(with_it, fit, directions(with_it, fit), rng), s)


def without_causes(s: Scattered, base: Fit, rng: np.random.Generator) -> Scattered | None:
    """The same scatter, which was found about causes, about none; None where that is adequate or cannot be followed."""
    if (fit := s.problem.fit(base.mechanisms, base.named)) is None:
        return None
    found = detect(s.problem, fit, directions(s.problem, fit), rng)
    return replace(s, baseline=fit, detection=found) if found.discrepant else None


def in_full(problem: Problem, base: Fit, rng: np.random.Generator) -> Scattered | Problem | None:
    """What differs from trial to trial, as the repeats tell, with every recording's own value of it: about one value
    for all it is linear only in what is small beside the noise. None where no such model is adequate. Where a pattern
    explains those values better, as of one odd recording, the problem without scatter: it is no noise."""
    every, known_as = variables(problem.system), getattr(problem.system, "scattered_as", {})
    for name in (n for n, s in problem.scattered.items() if s > 0.0):
        rest = {n: s for n, s in problem.scattered.items() if n != name}
        bare = Problem(problem.system, problem.noise, rest, problem.measured)
        fit = bare.fit(base.mechanisms, base.named)
        number = every.get(known_as.get(name, name))
        found = None if fit is None or number is None else apart(bare, fit, number)
        if fit is None or found is None or (s := scatter(found)) is None:
            continue
        ordered = [weigh(p, found).log_evidence for p in patterns(found, problem.system.observations)]
        if max(ordered, default=-math.inf) > s.log_evidence + WORTH:
            return Problem(problem.system, problem.noise, {}, problem.measured)
        seen = Screen((found,), (), (s,), 0.0, fit.chi2)
        if (best := scattered(bare, seen, fit, 0.0, rng)) is not None and not best.detection.discrepant:
            return best
    return None


def at_common(problem: Problem) -> Problem:
    """The problem with one value in all of what scatters: of a recording held out nothing is known beforehand."""
    assert isinstance(problem.system, Varying)
    return problem.asked_of(problem.system.at_common())


def only(problem: Problem, named: Sequence[str]) -> Problem:
    """The problem without the patterns that are not named."""
    kept = copy.copy(problem.system)
    gone = patterns_of(problem.system).keys() - set(named)
    kept.candidates = {n: c for n, c in problem.system.candidates.items() if n not in gone}  # type: ignore[misc]
    return problem.asked_of(kept) if gone else problem


def named(problem: Problem, naming: Naming) -> Varies:
    """What varies among what is named; of recordings with numbers of the drive of their own, those that were driven as
    another was to be."""
    patterns, fit = varied(problem, naming), naming.best.fit
    commands: dict[int, int] = {}
    for p in (x.pattern for x in patterns):
        if p.kind is Kind.ODD and all(v.drive for v in p.variables):
            own = [coefficient(p.name, k) for k in range(p.design.shape[1])]
            values = np.array([0.0 if q.name in own else x for q, x in zip(fit.parameters, fit.values)])
            plain = replace(fit, values=values)
            commands |= {i: j for i in p.members if (j := command_of(problem, plain, i)) is not None}
    return Varies(patterns, commands=commands)


def varied(problem: Problem, naming: Naming) -> tuple[Varied, ...]:
    """The patterns among what is named."""
    fit, known = naming.best.fit, patterns_of(problem.system)
    names = [p.name for p in fit.parameters]
    out = []
    for m in naming.named:
        if (p := known.get(m)) is None:
            continue
        at = [names.index(coefficient(m, k)) for k in range(p.design.shape[1])]
        values, covariance = fit.values[at], fit.covariance[np.ix_(at, at)]
        fall = float(values @ np.linalg.solve(covariance, values))
        price = problem.system.candidates[m].price
        chance = min(1.0, math.exp(min(price, 300.0)) * float(scipy.stats.chi2.sf(fall, len(at))))
        each = beside(problem, fit, p.variable, p.since)
        out.append(Varied(p, values, covariance, chance, each))
    return tuple(sorted(out, key=lambda v: v.p_value))
