"""A law where the vocabulary has none: forms with free exponents and lengths, fitted through the whole simulation.

Nothing measured is differentiated. Every form is tried beside the baseline and beside the best of the vocabulary; the
one that predicts held-out conditions best is taken, the simpler where two are level. What any force of the same
arguments could explain stands beside it (`ceiling`).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from .detect import Detection, Direction, Span, detect, directions
from .document.values import Discovered, Status
from .fitting import Fit, Problem
from .naming import Naming, held_out_score
from .search import FEW, Search, Start, race, some, start_of
from .system import System, patterns_of

ROUNDS = ((3, 16), (5, 7))  # iterations of a fit in each of them, and forms that go on
LEVEL = 2.0  # of log likelihood: forms that predict alike; the simpler is taken
ENOUGH = 0.9  # share of what the baseline gets wrong that a law must explain to be told where it leaves misfit
SEED = 2  # of the look at the forms: the same data give the same law
SURE = 10.0  # of log likelihood on conditions held out; the best of n forms gains some ln n by chance, of 100: 5
DRAWS = 500  # of the groups, for how often a form wins
TOLD = 0.05  # share of the draws from which a form is told


@dataclass(frozen=True)
class Discovery:
    """A law and how well it holds. fit: of the model with it, last of its mechanisms, after those it stands beside.

    r2: share of the baseline's excess over the noise that it explains. stability: how often each form wins when groups
    of trials are drawn again. rivals: forms that predict as well, within LEVEL. gained: of log likelihood on conditions
    held out, beyond the better of the models that it stands beside.
    """

    form: str
    before: Fit
    fit: Fit
    r2: float
    stability: Mapping[str, float]
    rivals: tuple[str, ...]
    detection: Detection
    gained: float

    @property
    def sure(self) -> bool:
        """Whether noise alone is left beside it, and chance does not gain so much."""
        return not self.detection.discrepant and self.gained > SURE


@dataclass(frozen=True)
class Law:
    """A law that was found, under its own name. system: what is questioned, with the law in its vocabulary; fit: the
    model with it, last of its mechanisms; described: as it is told."""

    found: Discovery
    system: System
    fit: Fit
    described: Discovered

    @property
    def status(self) -> Status:
        """Whether more than noise is left beside it."""
        return Status.PARTIAL if self.found.detection.discrepant else Status.COMPLETE

    def fitted_anew(self, part: Problem, base: Fit, rng: np.random.Generator) -> Fit:
        """The model fitted to a part of the motions, the law from the values that it was found with."""
        first = {p.name: p.start for p in self.system.candidates[self.fit.mechanisms[-1]].parameters}
        return part.fit(self.fit.mechanisms, {**self.fit.named, **base.named, **first}) or base


class Library(Protocol):
    """Forms of the laws that a system may follow."""

    @property
    def whole(self) -> System:
        """The system with every form among its candidates."""
        ...

    @property
    def forms(self) -> Sequence[str]: ...
    def rivals(self, named: Sequence[str]) -> Mapping[tuple[str, ...], Sequence[str]]:
        """Forms for which some of the named mechanisms may pass, by what is named beside them."""
        ...

    def law(self, found: Discovery, problem: Problem) -> Law:
        """What was found under its own name, with what it can do. problem: without the forms."""
        ...


class Laws:
    """The search for a law that no vocabulary lists, beside the search for mechanisms: where no two of them pass the
    test, before more are tried together (`alone`), and at its end (`law`).

    asked: whether forms were tried beside the baseline; found: the one that explains what it gets wrong.
    """

    def __init__(self, problem: Problem, library: Library, say: Callable[[str], None]) -> None:
        self.problem, self.library, self.say = problem, library, say
        self.whole = problem.asked_of(library.whole)
        self.asked = False
        self.found: Discovery | None = None

    def alone(self, search: Search) -> bool:
        """Whether one law beside the baseline leaves nothing over: then larger sets are not tried."""
        self.say("no two mechanisms of the vocabulary explain all of it: searching for a law")
        return self.explains(search.base)

    def explains(self, base: Fit) -> bool:
        """Whether one law beside the baseline leaves nothing over."""
        if not self.asked:
            self._ask(base)
        return self.found is not None and not self.found.detection.discrepant

    def law(self, base: Fit, n: Naming) -> Law | None:
        """The law that explains what the vocabulary leaves over; None where no law is found."""
        if not self.asked:
            self.say("no mechanism of the vocabulary explains all of it: searching for a law")
            self._ask(base)
        tried = [self.found]
        if n.named and (self.found is None or self.found.detection.discrepant):
            tried.append(self._beside(base, n.best.fit))
        good = [x for x in tried if x]
        best = max(good, key=lambda x: (not x.detection.discrepant, held_out_score(self.whole, x.fit)), default=None)
        return self.library.law(best, self.problem) if best else None

    def rival(self, base: Fit, n: Naming) -> dict[str, Any]:
        """What changes of the findings where a law, in the place of listed causes that pass the test, predicts better
        what is held out; else nothing. A scale hides most of what a bent perspective shows."""
        whole, named = self.whole, n.best.fit
        rests = self.library.rivals(n.named).items()
        tried = race(whole, [((*rest, form), named.named) for rest, forms in rests for form in forms])
        limit = held_out_score(whole, named)
        better = [(f, s - limit) for f in tried if (s := held_out_score(whole, f)) > limit + SURE]
        for fit, gained in sorted(better, key=lambda x: LEVEL * len(x[0].mechanisms) - x[1]):
            listed = directions(whole, fit, _listed(whole, self.library.forms))
            test = detect(whole, fit, listed, np.random.default_rng(SEED))
            rest = next((e for e in n.tried if e.mechanisms == fit.mechanisms[:-1]), None)
            if test.discrepant or rest is None:
                continue
            found = Discovery(
                form=fit.mechanisms[-1],
                before=rest.fit,
                fit=fit,
                r2=explained(self.problem, base, fit.chi2),
                stability=wins(whole, [f for f, _ in better], np.random.default_rng(SEED)),
                rivals=tuple(f.mechanisms[-1] for f, g in better if f is not fit and abs(g - gained) <= LEVEL),
                detection=test,
                gained=gained,
            )
            # the odds that the listed causes are all there is: those of what is held out
            status, best = (Status.PARTIAL, rest) if rest.mechanisms else (Status.UNDETERMINED, n.best)
            less = replace(n, named=rest.mechanisms, status=status, best=best, twins=(), suffices=math.exp(-gained))
            gone = {} if set(less.named) & set(patterns_of(self.problem.system)) else {"varies": None}
            return {"law": self.library.law(found, self.problem), "naming": less, **gone}
        return {}

    def _ask(self, base: Fit) -> None:
        self.asked, self.found = True, self._beside(base, base)

    def _beside(self, base: Fit, fit: Fit) -> Discovery | None:
        return discover(self.whole, base, fit, self.library.forms, np.random.default_rng(SEED))


def discover(
    problem: Problem,
    base: Fit,
    fit: Fit,
    forms: Sequence[str],
    rng: np.random.Generator,
) -> Discovery | None:
    """The form that explains what a fit leaves over; None where none leaves noise alone, or explains ENOUGH of what the
    baseline gets wrong.

    problem: of a system that has the forms among its candidates. fit: the model beside which they are tried.
    """
    few = some(problem, FEW)  # a few conditions tell where to begin
    part, near = problem.over(few), fit.over(few)
    columns = directions(part, near, forms)
    if not columns:
        return None
    limit = max(held_out_score(problem, f) for f in (base, fit))
    tried = race(problem, _starts(problem, fit, detect(part, near, columns, rng), few))
    better = [(f, s) for f in tried if (s := held_out_score(problem, f)) > limit]
    if not better:
        return None
    top = max(s for _, s in better)
    level = [(f, s) for f, s in better if s >= top - LEVEL]
    best, score = min(level, key=lambda x: (at_end(x[0]), len(x[0].parameters), -x[1]))
    rivals = tuple(f.mechanisms[-1] for f, _ in level if f is not best)
    best = problem.polished(best, about=False)  # a fit that stopped short in a valley has neither value nor sigma
    r2 = explained(problem, base, best.chi2)
    test = detect(problem, best, directions(problem, best, _listed(problem, forms)), rng)
    if r2 < ENOUGH and test.discrepant:  # what passes leaves noise alone, a large share of a small misfit
        return None
    stability = wins(problem, [f for f, _ in better], rng)
    return Discovery(best.mechanisms[-1], fit, best, r2, stability, rivals, test, score - limit)


def at_end(fit: Fit) -> bool:
    """Whether a parameter is at an end of its range: the form then only imitates a simpler one."""
    return any(p.at_end(x) for p, x in zip(fit.parameters, fit.values))


def explained(problem: Problem, base: Fit, chi2: float) -> float:
    """Share of the baseline's excess of chi^2 over the noise that a model with this chi^2 explains."""
    dof = max(problem.n - len(base.parameters), 1)
    return (base.chi2 - max(chi2, dof)) / max(base.chi2 - dof, 1e-300)


def ceiling(problem: Problem, base: Fit, best: Fit, surface: Sequence[str]) -> float:
    """Share that the best law and a smooth force of its arguments beside it explain together.

    surface: candidates that are local bumps of force over the arguments; linear about the fit, less the gain that as
    many bumps find in noise alone.
    """
    span = Span(best)
    columns = [d.vector for d in directions(problem, best, surface)]
    if not columns:
        return explained(problem, base, best.chi2)
    u, s, _ = np.linalg.svd(np.stack(columns, axis=1), full_matrices=False)
    u = u[:, s > 1e-3 * s[0]]
    gain = float(np.sum((u.T @ span.off(span.residual)) ** 2)) - u.shape[1]
    return explained(problem, base, best.chi2 - max(gain, 0.0))


def _listed(problem: Problem, forms: Sequence[str]) -> list[str]:
    """The vocabulary without the forms."""
    return [m for m in problem.system.candidates if m not in forms]


def _starts(problem: Problem, fit: Fit, found: Detection, few: Sequence[int]) -> list[Start]:
    """Starts of the forms that come furthest in short fits over a share of the conditions, fewer each round; none
    where all of them stay far from the noise.

    Each form begins at the shapes that the residuals ask for most, its strength by the linear estimate.
    """
    asked: dict[str, list[tuple[float, Direction]]] = {}
    for d, z in zip(found.directions, found.score):
        asked.setdefault(d.mechanism, []).append((float(z), d))
    starts: list[Start] = []
    for form, each in asked.items():
        # a form starts from its two best sets of shape parameters
        for z, d in sorted(each, key=lambda x: -abs(x[0]))[:2]:
            starts.append(((*fit.mechanisms, form), start_of(problem, fit, d, z)))
    before = problem.cost(fit.mechanisms, fit.named, few)
    after = sum(problem.system.observations[i].t.size for i in few)
    # a form that explains less than half of what could be after the first laps is not followed
    limit = before - 0.5 * max(before - after, 0.0)
    for iterations, kept in ROUNDS:
        fits = [f for m, s in starts if (f := problem.fit(m, s, few, iterations)) is not None]
        best: dict[tuple[str, ...], Fit] = {}
        for f in sorted(fits, key=lambda f: f.chi2):
            best.setdefault(f.mechanisms, f)
        starts = [(f.mechanisms, f.named) for f in list(best.values())[:kept] if f.chi2 < limit]
    return starts


def wins(problem: Problem, tried: Sequence[Fit], rng: np.random.Generator) -> dict[str, float]:
    """How often the last mechanism of each fit is in the best of them when groups of trials are drawn again, the most
    frequent first, those from a share TOLD; a parameter costs 2 of chi^2 (Akaike's criterion)."""
    groups: dict[str, list[int]] = {}
    for i, o in enumerate(problem.system.observations):
        groups.setdefault(o.group, []).append(i)
    cost = np.array([[sum(float(f.residuals[i] @ f.residuals[i]) for i in g) for g in groups.values()] for f in tried])
    picks = rng.multinomial(len(groups), np.full(len(groups), 1.0 / len(groups)), DRAWS)
    total = picks @ cost.T + 2.0 * np.array([len(f.parameters) for f in tried])
    count = Counter(tried[k].mechanisms[-1] for k in np.argmin(total, axis=1))
    return {name: n / DRAWS for name, n in count.most_common() if n / DRAWS >= TOLD}
