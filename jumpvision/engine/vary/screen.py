"""Which numbers vary, about a fit: every one linearly, the best few in full, their patterns by evidence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import scipy

from jumpvision.engine.fitting import Fit, Problem
from jumpvision.engine.naming import CLEAR
from jumpvision.engine.system import Costly

from .apart import MUCH, Apart, apart, linear, lost_frames, variables
from .patterns import Scatter, Weighed, patterns, scatter, weigh
from .variables import LOST

WORTH = 0.3  # share of the best linear fall of chi^2 that a number must take, linearly, to be fitted in full
FULL = 6  # numbers whose values are fitted in full: those that take most from chi^2, linearly
DEAR = 2  # the same where runs are dear, and patterns that are tried there
KEPT, CLOSE = 4, 12.0  # patterns that are tried beside mechanisms; nats behind the best up to which they are
BEHIND, FAR = 4.0, 100.0  # excesses of chi^2 of the best, and chi^2, behind it up to which a number is looked at
KINDS = 5  # of patterns, each as likely before


@dataclass(frozen=True)
class Screen:
    """apart: the values of each number that was fitted in full; weighed: patterns, the likeliest first; scatters alike.
    log_price: of the numbers that were asked of, and the kinds. base: chi^2 of the fit; kept: patterns that are tried;
    most: chi^2 that one may leave and still be tried."""

    apart: tuple[Apart, ...]
    weighed: tuple[Weighed, ...]
    scatters: tuple[Scatter, ...]
    log_price: float
    base: float
    kept: int = KEPT
    most: float = math.inf

    @property
    def promising(self) -> tuple[Weighed, ...]:
        """The best pattern of each number, none far behind the best of all."""
        first: dict[str, Weighed] = {}
        for w in self.weighed:
            if w.chi2 <= self.most:
                first.setdefault(w.pattern.variable.name, w)
        top = list(first.values())[: self.kept]
        return tuple(w for w in top if w.log_evidence > top[0].log_evidence - max(CLOSE, 0.1 * self._reach(top)))

    def _reach(self, top: Sequence[Weighed]) -> float:
        """Nats that the best gains over no pattern at all."""
        return top[0].log_evidence + 0.5 * self.base if top else 0.0


def screen(problem: Problem, fit: Fit, *, quick: bool = False) -> Screen:
    """quick: linear about the fit, which is nearly right; frames that were lost are not sought."""
    every = variables(problem.system)
    about = problem.each([partial(linear, problem, fit, v) for n, v in every.items() if n != LOST])
    rough = sorted((a for a in about if a is not None), key=lambda a: a.chi2)
    full: list[Apart | None] = [*rough] if quick else _in_full(problem, fit, rough)
    if LOST in every and not quick:
        full.append(lost_frames(problem, fit))
    found = tuple(a for a in full if a is not None and math.isfinite(a.chi2))
    dear = isinstance(problem.system, Costly)
    kept, most = (DEAR, fit.chi2 - MUCH * (fit.chi2 - problem.n)) if dear else (KEPT, math.inf)
    price = math.log(max(len(every), 1)) + math.log(KINDS)
    observations = problem.system.observations
    weighed = [w for a in found for p in patterns(a, observations) if (w := weigh(p, a)).significance > CLEAR]
    weighed.sort(key=lambda w: -w.log_evidence)
    scatters = sorted((s for a in found if (s := scatter(a)) is not None), key=lambda s: -s.log_evidence)
    return Screen(found, tuple(weighed), tuple(scatters), price, fit.chi2, kept, most)


def _in_full(problem: Problem, fit: Fit, rough: Sequence[Apart]) -> list[Apart | None]:
    """The fits of these numbers; one that is far behind the best is given up."""
    if isinstance(problem.system, Costly):  # only what takes much, linearly; the others as that has them
        worth = [a for a in rough[:DEAR] if fit.chi2 - a.chi2 > MUCH * (fit.chi2 - problem.n)]
        return [apart(problem, fit, a.variable) if any(a is w for w in worth) else a for a in rough]
    out: list[Apart | None] = []
    least = fit.chi2 - WORTH * (fit.chi2 - min((a.chi2 for a in rough), default=fit.chi2))
    for a in (x for x in rough[:FULL] if x.chi2 <= least):
        best = min((x.chi2 for x in out if x is not None), default=math.inf)
        give_up = best + BEHIND * max(best - problem.n, 0.0) + FAR
        out.append(apart(problem, fit, a.variable, give_up=give_up))
    return out


def chance(seen: Screen) -> float:
    """Of a pattern as clear as the clearest by noise alone: its chance times how many were asked for (Bonferroni)."""
    p = 1.0
    for w in seen.weighed:
        dof = w.coefficients.size - w.pattern.about_own
        log = seen.log_price + w.pattern.log_price + float(scipy.stats.chi2.logsf(w.significance**2, dof))
        p = min(p, math.exp(min(log, 0.0)))
    return p
