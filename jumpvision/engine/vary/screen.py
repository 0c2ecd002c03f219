"""Which numbers vary, about a fit: every one linearly, the best few in full, their patterns by evidence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from jumpvision.engine.fitting import Fit, Problem
from jumpvision.engine.system import Costly

from .apart import MUCH, Apart, apart, linear, lost_frames, variables
from .patterns import Scatter, Weighed, patterns, scatter, weigh
from .variables import LOST

FULL = 6  # numbers whose values are fitted in full: those that take most from chi^2, linearly
DEAR = 2  # the same where runs are dear, and patterns that are tried there
KEPT, CLOSE = 4, 12.0  # patterns that are tried beside mechanisms; nats behind the best up to which they are
CLEAR = 3.0  # standard uncertainties that a pattern's own coefficients must be off, beside a common value
KINDS = 5  # of patterns, each as likely before


@dataclass(frozen=True)
class Screen:
    """apart: the values of each number that was fitted in full; weighed: patterns, the likeliest first; scatters alike.
    log_price: of the numbers that were asked of, and the kinds."""

    apart: tuple[Apart, ...]
    weighed: tuple[Weighed, ...]
    scatters: tuple[Scatter, ...]
    log_price: float

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

    base: float = 0.0
    kept: int = KEPT
    most: float = math.inf  # chi^2 that a pattern may leave and still be tried


def screen(problem: Problem, fit: Fit, without: Sequence[str] = ()) -> Screen:
    """without: numbers that are not asked of."""
    every = {n: v for n, v in variables(problem.system).items() if n not in without}
    about = problem.each([partial(linear, problem, fit, v) for n, v in every.items() if n != LOST])
    rough = sorted((a for a in about if a is not None), key=lambda a: a.chi2)
    if isinstance(problem.system, Costly):
        worth = [a for a in rough[:DEAR] if fit.chi2 - a.chi2 > MUCH * (fit.chi2 - problem.n)]
        full = [apart(problem, fit, a.variable) for a in worth] + [a for a in rough if a not in worth]
    else:
        full = [apart(problem, fit, a.variable) for a in rough[:FULL]]
    if LOST in every:
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
