"""The whole questioning, in order: look (baseline, test, where), explain (which cause), foretell (what it is worth).

Every system is asked in this order, jumps and studies alike; what only some can be asked (laws of no list,
experiments not yet made) they hand over.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from jumpvision.engine.document.values import Cell, Detectable, Status
from jumpvision.engine.noise.noise import Noise

from .detect import Detection, detect, detectable, directions, locate
from .fitting import Fit, Problem
from .naming import Naming, name
from .system import Costly, Parameter, patterns_of
from .worth.gain import Choose, Gain, among, begun_at, gain

if TYPE_CHECKING:  # imported where they are asked for: most questions end before
    from .discovery import Law, Laws
    from .vary.explain import Scattered, Varies, Wider
    from .vary.odd import Odd
    from .worth.design import Proposal

STARTS = 6  # of the baseline's fit where runs cost; else four times as many, over the ranges of its parameters
NEIGHBOURS = ("kind", "volume_fraction", "delay", "frequency")  # labels that order conditions
HALVED = 4.0  # of chi^2, where the error is halved
FIFTH = 0.2  # of the misfit: the values of a number that is at fault leave less, linearly
FEWEST = 4  # recordings among which one can be odd
SCATTERED = 20  # sets that are fitted anew with one value in all of what scatters
ALONE = 2  # single mechanisms beside which what varies is asked for anew
SURE = 0.003  # chance below which a pattern over recordings counts where the other looks see nothing
LAW_SEED, VARY_SEED = 2, 3  # of the folds that judge a law, of what varies

Say = Callable[[str], None]


@dataclass(frozen=True)
class Findings:
    """What is wrong with a model, or that nothing is. naming, gain, next_experiment: None for an adequate model.

    varies: what was taken for constant and is not. problem: that these findings are of, where it is
    not the one that was looked at.

    law: of no list, that explains what the vocabulary does not. detectable: of every mechanism that is not named, the
    strength that would have shown.
    """

    noise: Noise
    baseline: Fit
    detection: Detection
    where: list[Cell]
    naming: Naming | None = None
    law: Law | None = None
    gain: Gain | None = None
    extrapolation: dict[str, Gain] | None = None
    next_experiment: Proposal | None = None
    detectable: tuple[Detectable, ...] = ()
    varies: Varies | None = None
    problem: Problem | None = field(default=None, repr=False)

    @property
    def adequate(self) -> bool:
        return not self.detection.discrepant

    @property
    def complete(self) -> bool:
        return self.naming is not None and self.naming.status == Status.COMPLETE

    @property
    def named_fit(self) -> Fit:
        """The fit of the named mechanisms, else the baseline."""
        return self.naming.best.fit if self.naming and self.naming.named else self.baseline

    @property
    def best(self) -> Fit:
        """The fit that the findings stand by: with the law where one was found, else of the named mechanisms."""
        return self.law.fit if self.law else self.named_fit


Offer = Callable[[], tuple[Problem, Sequence[int]]]  # motions that could be made: a system that has them, their places


def silent(_: object) -> None:
    """Says nothing."""


@dataclass(frozen=True)
class Order:
    """The steps of a questioning. What is handed over besides the problem:

    by: labels of the observations to report by; None: where the misfit lies is not asked. stops: time after which each
    observation's apex counts [s]. laws: makes the search for a law of no list. offered: experiments that could be
    made. choosing: of how a fold, where a gain is judged, chooses its model. say: is told what is being done. reached:
    is given what is found so far, for whoever may have to stop.
    """

    problem: Problem
    rng: np.random.Generator
    by: Sequence[str] | None = ()
    stops: Sequence[float] | None = None
    laws: Callable[[Problem], Laws] | None = None
    offered: Offer | None = None
    choosing: Callable[[Choose], Choose] = lambda choose: choose
    say: Say = silent
    reached: Callable[[Findings], None] = silent

    @functools.cached_property
    def _laws(self) -> Laws | None:
        return self.laws(self.problem) if self.laws else None

    def all(self) -> Findings:
        """Every step. Raises ValueError when the baseline cannot be followed on the data."""
        return self.foretell(self.explain(self.look()))

    def look(self) -> Findings:
        """Whether a model is wrong, and where. Raises ValueError when the baseline cannot be followed on the data."""
        self.say("fitting the baseline")
        base = fit_baseline(self.problem, self.rng)
        self.say("testing it")
        found = detect(self.problem, base, directions(self.problem, base), self.rng)
        where = [] if self.by is None else locate(self.problem, base, tuple(self.by), self.rng)
        return Findings(self.problem.noise, base, found, where)

    def name(self, d: Findings, beside: Fit | None = None) -> Findings:
        """What was looked at, with the mechanisms that explain it best, whatever the verdict."""
        enough = self._laws.alone if self._laws else None
        return replace(d, naming=name(self.problem, d.baseline, d.detection, self.rng, enough, beside))

    def explain(self, d: Findings) -> Findings:
        """What was looked at, with what explains it where the model is wrong."""
        d = self._varying(d) if d.adequate else d
        if d.adequate:
            return self._as_repeats_tell(d) or d
        self.reached(d)
        self.say(f"discrepant (p = {d.detection.p_value:.2g}): looking for numbers that vary")
        if (found := self._as_repeats_tell(d) or self._by_forces(d)) is not None:
            return found
        wide = self._wider(d.baseline)
        if wide is not None and wide.odd is not None and wide.odd.explained:
            return self._without(d, wide.odd)
        apart = self._apart(d) if wide is not None and wide.odd is None else ()
        if apart and (few := self._mistaken(d, apart)):
            return few
        order = self if wide is None else replace(self, problem=wide.problem)
        self.say(f"trying {len(self.problem.system.candidates)} mechanisms")
        found = order.name(replace(d, problem=order.problem))
        if wide is not None:
            found = order._decided(d, found, wide)
        if found.adequate or (found.varies and (found.varies.aside or found.varies.scatter)):
            return found
        if found.naming and wide is not None and not (found.complete and order._steady(found)):
            order, found = order._again(found, wide)
        if apart and found.naming and not found.complete:
            found = self._but_a_few(d, apart) or found
            if found.varies and found.varies.aside:
                return found
        self.reached(found)
        return order.beyond(found)

    def _as_repeats_tell(self, d: Findings) -> Findings | None:
        """What was looked at, with what repeats take for noise: a number that scatters, or its cause; or None."""
        if not (self._may_vary and any(self.problem.scattered.values())):
            return None
        from .vary import explain

        s = explain.in_full(self.problem, d.baseline, np.random.default_rng(VARY_SEED))
        if not isinstance(s, Problem):
            return None if s is None else self._scattering(d, s)
        order = replace(self, problem=s)
        found = order.explain(order.look())
        good = found.complete or (found.varies and found.varies.aside)
        return replace(found, problem=found.problem or s) if good else None

    def _by_forces(self, d: Findings) -> Findings | None:
        """Mechanisms that explain all, where one value a recording of no number comes near that; else None."""
        if not self._may_vary or isinstance(self.problem.system, Costly):
            return None
        from .vary.screen import screen

        excess, quick = d.baseline.chi2 - self.problem.n, screen(self.problem, d.baseline, quick=True)
        if min((a.chi2 for a in quick.apart), default=math.inf) < self.problem.n + FIFTH * excess:
            return None
        self.say(f"trying {len(self.problem.system.candidates)} mechanisms")
        found = self.name(d)
        return self.beyond(found) if found.complete and self._steady(found) else None

    def _varying(self, d: Findings) -> Findings:
        """A third look: a number that varies from recording to recording by so little that chi^2 does not show it."""
        p = self._chance(d.baseline)
        return replace(d, detection=replace(d.detection, p_value=p)) if p < SURE else d

    def _steady(self, d: Findings) -> bool:
        """Whether no number varies beside what is named, not even by less than chi^2 shows."""
        return self._chance(d.best) >= SURE

    def _chance(self, about: Fit) -> float:
        """Of a pattern over the recordings, about a fit, by noise alone; 1 where that is not asked."""
        if not self._may_vary or isinstance(self.problem.system, Costly):
            return 1.0
        from .vary.screen import chance, screen

        return chance(screen(self.problem, about, quick=True))

    @property
    def _may_vary(self) -> bool:
        """Whether there are recordings enough, and a system that can give each its own numbers."""
        return len(self.problem.all) >= FEWEST and hasattr(self.problem.system, "predict_apart")

    def _wider(self, about: Fit, *, beside: bool = False) -> Wider | None:
        if not self._may_vary:
            return None
        from .vary import explain

        rng = np.random.default_rng(VARY_SEED)
        return explain.wider(self.problem, about, rng, beside=beside)

    def _decided(self, d: Findings, found: Findings, wide: Wider) -> Findings:
        """What is named, or scatter alone, or recordings set aside: whatever is likeliest and passes the test."""
        from .vary import explain

        rng, problem, naming = np.random.default_rng(VARY_SEED), self.problem, found.naming
        assert naming is not None
        gained = explain.gained(problem, naming.best.fit, d.baseline) if found.complete else 0.0
        s = explain.scattered(problem, wide.screen, d.baseline, gained, rng)
        if s is not None and not s.detection.discrepant:
            return self._scattering(d, s)
        if s is not None and not found.complete and s.detection.p_value >= SURE:
            return self._named_about(d, s)[1]  # scatter takes all but what chance may
        if found.complete or wide.odd is None:
            return replace(found, varies=explain.named(problem, naming))
        return self._without(d, wide.odd)

    @staticmethod
    def _scattering(d: Findings, s: Scattered) -> Findings:
        """What was looked at, adequate with a number that scatters."""
        from .vary.explain import Varies

        said = Varies(scatter=s.scatter)
        return replace(d, baseline=s.baseline, detection=s.detection, varies=said, problem=s.problem)

    def _without(self, d: Findings, odd: Odd) -> Findings:
        """What is found where a few recordings are set aside; causes that all others show beside it."""
        from .vary.explain import Varies

        part, rest = self._others(odd.members)
        found = part.explain(rest) if not rest.adequate and len(self.problem.all) - len(odd.members) >= FEWEST else rest
        if found.naming and found.naming.named:
            return self._beside(d, found, part, odd)
        without = Varies(aside=odd.members, commands=odd.commands, slips=odd.slips)
        return replace(d, varies=without, problem=part.problem)

    def _apart(self, d: Findings) -> tuple[int, ...]:
        """Recordings, enough others beside them, that take most of the misfit."""
        from .vary.odd import those_apart

        few = those_apart(self.problem, d.baseline)
        return few if len(self.problem.all) - len(few) >= FEWEST else ()

    def _mistaken(self, d: Findings, apart: tuple[int, ...]) -> Findings | None:
        """What explains all recordings but these, where each of them is a mistake; None where they may be none."""
        from .vary.odd import may_be_mistaken

        if not may_be_mistaken(self.problem, d.baseline, apart):
            return None
        found = self._but_a_few(d, apart)
        return found if found and found.varies and found.varies.mistaken else None

    def _but_a_few(self, d: Findings, apart: tuple[int, ...]) -> Findings | None:
        """What explains all recordings but these; None where nothing does."""
        from .vary.odd import about

        self.say("testing all recordings but those that differ")
        part, rest = self._others(apart)
        found = rest if rest.adequate else part.explain(rest)
        if not (found.adequate or found.complete) or (found.varies and found.varies.aside):
            return None
        few = about(self.problem, found.problem or part.problem, found.best, apart)
        return self._beside(d, found, part, few)

    def _others(self, apart: Sequence[int]) -> tuple[Order, Findings]:
        """(the order of all recordings but these, what it sees at first)."""
        from .vary.odd import set_aside

        part = replace(self, problem=self.problem.asked_of(set_aside(self.problem.system, apart)))
        return part, part.look()

    @staticmethod
    def _beside(d: Findings, found: Findings, part: Order, odd: Odd) -> Findings:
        """What is found in the others, with what is known of those that are set aside."""
        from .vary.explain import Varies

        both = replace(found.varies or Varies(), aside=odd.members, commands=odd.commands, slips=odd.slips)
        return replace(found, detection=d.detection, varies=both, problem=found.problem or part.problem)

    def _again(self, found: Findings, wide: Wider) -> tuple[Order, Findings]:
        """What is named with what varies about it, where that explains more. wide: by which this was asked before."""
        from .vary import explain

        naming = found.naming
        assert naming is not None
        self.say("looking for numbers that vary, with these in the model")
        for about in self._abouts(naming, wide):
            wide = self._wider(about, beside=True) or wide
            partly = None
            if wide.problem.system.candidates.keys() != self.problem.system.candidates.keys():
                order = replace(self, problem=wide.problem)
                more = order.name(replace(found, naming=None, problem=order.problem), about)
                assert more.naming is not None
                known = order, replace(more, varies=explain.named(order.problem, more.naming))
                if more.complete:
                    return known
                partly = known if about is naming.best.fit and more.naming.status == Status.PARTIAL else None
            if (better := self._scatter_beside(found, wide, about) or partly) is not None:
                return better
        return self, found

    def _scatter_beside(self, found: Findings, wide: Wider, about: Fit) -> tuple[Order, Findings] | None:
        """Causes with a number that scatters about them, where both are all."""
        from .vary import explain

        rng = np.random.default_rng(VARY_SEED)
        s = explain.scattered(self.problem, wide.screen, about, explain.SECOND, rng) if about.mechanisms else None
        if s is None or s.detection.discrepant or (base := explain.without_causes(s, found.baseline, rng)) is None:
            return None
        order, more = self._named_about(found, base, s.baseline)
        return (order, more) if more.complete else None

    def _named_about(self, d: Findings, s: Scattered, beside: Fit | None = None) -> tuple[Order, Findings]:
        """What is named where a number scatters."""
        from .vary.explain import named

        order = replace(self, problem=s.problem)
        found = order.name(replace(d, baseline=s.baseline, detection=s.detection, problem=s.problem), beside)
        assert found.naming is not None
        return order, replace(found, varies=replace(named(s.problem, found.naming), scatter=s.scatter))

    def _abouts(self, naming: Naming, wide: Wider) -> list[Fit]:
        """The fit of what is named; where nothing is also those of the likeliest single mechanisms, whose place others
        may have taken that what varies had asked for."""
        fits = [naming.best.fit]
        if naming.status == Status.UNDETERMINED and wide.screen.weighed and not isinstance(self.problem.system, Costly):
            own = patterns_of(self.problem.system)
            alone = [e.fit for e in naming.tried if len(e.mechanisms) == 1 and e.mechanisms[0] not in own]
            fits += alone[:ALONE]
        return fits

    def beyond(self, d: Findings) -> Findings:
        """Add to what is named a law of no list that describes the rest, if something is left and a cause is likelier
        than chance."""
        n = d.naming
        if n is None or n.by_chance or (d.varies and (d.varies.aside or (d.complete and d.varies.scatter))):
            return d
        if d.complete:
            return replace(d, **self._laws.rival(d.baseline, n)) if self._laws else d
        law = self._laws.law(d.baseline, n) if self._laws else None
        if law and n.named and n.best.fit.chi2 < HALVED * law.fit.chi2:
            law = None  # beside named causes a law of no list that leaves nearly as much explains nothing
        return replace(d, law=law)

    def foretell(self, d: Findings) -> Findings:
        """What is explained, with its gain on conditions held out, the next experiment, what might yet be hidden."""
        problem, found, naming = d.problem or self.problem, d.detection, d.naming
        if problem is not self.problem:
            return replace(self, problem=problem).foretell(d)
        if naming is None:
            return replace(d, detectable=tuple(detectable(problem, d.baseline, found, self.rng)))
        best, worth = naming.best.fit, None
        if not (d.varies and d.varies.only_odd(naming.named)):  # which tell nothing of other recordings
            self.say("predicting held-out conditions")
            worth = self._gain(d)
        beyond: dict[str, Gain] = {}
        if self.by and len({str(o.labels.get(self.by[0])) for o in problem.system.observations}) > 1:
            from .worth.refitted import extrapolation

            beyond = extrapolation(problem, d.baseline, best, self.by[0], self._times)
        # a motion not yet made has no numbers of its own
        patterns = patterns_of(problem.system)
        tried = [e for e in naming.tried if not set(e.mechanisms) & set(patterns)]
        whole = self.offered is not None and not set(naming.named) & set(patterns)
        proposal = None
        if self.offered and whole:
            from .worth.design import propose

            proposal = propose(*self.offered(), tried)
        seen = naming.best.detection if naming.named else found
        hidden = detectable(problem, best if naming.named else d.baseline, seen or found, self.rng)
        return replace(d, gain=worth, extrapolation=beyond, next_experiment=proposal, detectable=tuple(hidden))

    @property
    def _times(self) -> Sequence[float]:
        if self.stops is not None:
            return self.stops
        return [float(o.t[0]) for o in self.problem.system.observations]

    def _gain(self, d: Findings) -> Gain | None:
        """Of the law with its form as it was found; else by the vocabulary, chosen anew in every fold."""
        problem = self.problem
        if patterns_of(problem.system):
            from .vary.explain import only

            problem = only(problem, d.naming.named if d.naming else ())
        if d.varies and d.varies.scatter:
            from .vary.explain import at_common

            problem = at_common(problem)
        if d.law is None:
            assert d.naming is not None
            base, tried = d.baseline, d.naming.tried
            if d.varies and d.varies.scatter:  # the fits are of other residuals
                base = problem.fit(base.mechanisms, base.named) or base
                known = [e for e in tried if set(e.mechanisms) <= set(problem.system.candidates)][:SCATTERED]
                some = ((e, problem.fit(e.mechanisms, e.fit.named)) for e in known)
                tried = tuple(replace(e, fit=f) for e, f in some if f is not None)
            choose = self.choosing(among(tried))
            found = gain(problem, begun_at(base), self._times, self.rng, NEIGHBOURS, choose)
        else:
            whole, rng = problem.asked_of(d.law.system), np.random.default_rng(LAW_SEED)
            found = gain(whole, fit_baseline, self._times, rng, NEIGHBOURS, d.law.fitted_anew)
        self.reached(replace(d, gain=found))
        return found


def fit_baseline(problem: Problem, rng: np.random.Generator) -> Fit:
    """The baseline from its own values and, where it has ranges, from the better ones of a few drawn in them."""
    free = problem.system.baseline
    starts = [{p.name: p.start for p in free}]
    costly = isinstance(problem.system, Costly)
    if free:
        draws = min(2 * len(free), STARTS) if costly else 4 * STARTS
        starts += [{p.name: draw(p, rng) for p in free} for _ in range(draws)]
    cost = [problem.cost((), s, problem.scouts(problem.all) if costly else None) for s in starts]
    chosen = [0, *(i for i in np.argsort(cost) if i != 0 and cost[i] < cost[0])][: 2 if costly else 3]
    fits = [f for f in (problem.fit((), starts[i]) for i in chosen) if f is not None]
    if not fits:
        raise ValueError(
            "the baseline model cannot be simulated with its own parameters for these jumps; "
            "check [model] and [model.fit]"
        )
    return problem.polished(min(fits, key=lambda f: f.chi2))


def draw(p: Parameter, rng: np.random.Generator) -> float:
    """A value from a parameter's prior."""
    if np.isfinite(p.sigma):
        return float(np.clip(rng.normal(p.start, p.sigma), p.low, p.high))
    return float(rng.uniform(p.low, p.high))
