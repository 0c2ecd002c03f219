"""The whole questioning, in order: noise, baseline, test, where, which cause, gain, next experiment."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jumpvision.engine.noise.noise import Noise
from jumpvision.engine.priors import Measured

from .detect import Cell, Detectable, Detection, detect, detectable, directions, locate
from .fitting import Fit, Problem
from .naming import Naming, name
from .search import Enough
from .system import Costly, Parameter, System
from .worth.design import Proposal, propose
from .worth.gain import Gain, extrapolation, gain

STARTS = 6  # of the baseline's fit, over the ranges of its parameters
NEIGHBOURS = ("kind", "volume_fraction", "delay", "frequency")  # labels that order conditions
Say = Callable[[str], None]


@dataclass(frozen=True)
class Findings:
    """What is wrong with a model, or that nothing is. naming, gain, next_experiment: None for an adequate model.

    detectable: of every mechanism that is not named, the strength that would have shown.
    """

    noise: Noise
    baseline: Fit
    detection: Detection
    where: list[Cell]
    naming: Naming | None = None
    gain: Gain | None = None
    extrapolation: dict[str, Gain] | None = None
    next_experiment: Proposal | None = None
    detectable: tuple[Detectable, ...] = ()

    @property
    def adequate(self) -> bool:
        return not self.detection.discrepant


Offer = Callable[[], tuple[Problem, Sequence[int]]]  # motions that could be made: a system that has them, their places
Known = Callable[[Findings], None]  # is told what is known so far, for whoever may have to stop


def diagnose(
    system: System,
    noise: Noise,
    rng: np.random.Generator,
    *,
    scatter: Mapping[str, float] | None = None,
    measured: Sequence[Measured] = (),
    by: Sequence[str] = (),
    stops: Sequence[float] | None = None,
    offered: Offer | None = None,
    say: Say = lambda text: None,
    known: Known = lambda findings: None,
) -> Findings:
    """Questions a system: what is wrong (`look`) and why (`explain`), then what that is worth (`foretell`).

    scatter: standard deviations of what differs from trial to trial (System.scatter). measured: of parameters, by other
    means.
    """
    problem = Problem(system, noise, scatter, measured)
    found = explain(problem, look(problem, rng, by=by, say=say), rng, say=say, known=known)
    return foretell(problem, found, rng, by=by, stops=stops, offered=offered, say=say)


def look(problem: Problem, rng: np.random.Generator, *, by: Sequence[str], say: Say) -> Findings:
    """Whether a model is wrong, and where. by: labels of the observations to report by.

    Raises ValueError when the baseline cannot be followed on the data.
    """
    say("fitting the baseline")
    base = fit_baseline(problem, rng)
    say("testing it")
    found = detect(problem, base, directions(problem, base), rng)
    return Findings(problem.noise, base, found, locate(problem, base, tuple(by), rng))


def explain(
    problem: Problem,
    d: Findings,
    rng: np.random.Generator,
    *,
    say: Say,
    known: Known = lambda findings: None,
    enough: Enough | None = None,
) -> Findings:
    """What was looked at, with the mechanisms that explain it where the model is wrong. enough: see `Search.run`."""
    if d.adequate:
        return d
    known(d)
    say(f"discrepant (p = {d.detection.p_value:.2g}): trying {len(problem.system.candidates)} mechanisms")
    d = replace(d, naming=name(problem, d.baseline, d.detection, rng, enough))
    known(d)
    return d


def foretell(
    problem: Problem,
    d: Findings,
    rng: np.random.Generator,
    *,
    by: Sequence[str],
    stops: Sequence[float] | None,
    offered: Offer | None = None,
    say: Say,
    gained: Callable[[], Gain | None] | None = None,
) -> Findings:
    """What is explained, with its gain on conditions held out, the next experiment, and what might yet be hidden.

    offered: the next experiment is one of these. stops: time after which each observation's apex counts. gained: in
    place of the gain by the vocabulary.
    """
    base, found, naming = d.baseline, d.detection, d.naming
    if naming is None:
        return replace(d, detectable=tuple(detectable(problem, base, found, rng)))
    say("predicting held-out conditions")
    times = stops if stops is not None else [float(o.t[0]) for o in problem.system.observations]
    best = naming.best.fit
    gain_of = gained or (lambda: gain(problem, fit_baseline, times, rng, NEIGHBOURS))
    worth = gain_of()
    beyond = extrapolation(problem, base, best, by[0], times) if by else {}
    proposal = propose(*offered(), naming.tried) if offered else None
    seen = naming.best.detection if naming.named else found
    hidden = detectable(problem, best if naming.named else base, seen or found, rng)
    return replace(d, gain=worth, extrapolation=beyond, next_experiment=proposal, detectable=tuple(hidden))


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
    return min(fits, key=lambda f: f.chi2)


def draw(p: Parameter, rng: np.random.Generator) -> float:
    """A value from a parameter's prior."""
    if np.isfinite(p.sigma):
        return float(np.clip(rng.normal(p.start, p.sigma), p.low, p.high))
    return float(rng.uniform(p.low, p.high))
