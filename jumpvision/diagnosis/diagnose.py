"""The whole questioning, in order: noise, baseline, test, where, which cause, gain, next experiment."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jumpvision.diagnosis.jumper.jumps import Measured
from jumpvision.diagnosis.noise.noise import Noise

from .detect import Cell, Detectable, Detection, detect, detectable, directions, locate
from .fitting import Fit, Problem
from .naming import Naming, name
from .proposing import Gain, Proposal, Runnable, extrapolation, gain, propose
from .system import Costly, Parameter, System

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


def diagnose(
    system: System,
    noise: Noise,
    rng: np.random.Generator,
    *,
    scatter: Mapping[str, float] | None = None,
    measured: Sequence[Measured] = (),
    by: Sequence[str] = (),
    stops: Sequence[float] | None = None,
    runnable: Sequence[Runnable] = (),
    say: Say = lambda text: None,
    known: Callable[[Findings], None] = lambda findings: None,
) -> Findings:
    """Questions a system. by: labels of the observations to report by. stops: time after which each one's apex counts.
    scatter: standard deviations of what differs from trial to trial (System.scatter). measured: of parameters, by other
    means. known: told what is known so far, for whoever may have to stop.

    Raises ValueError when the baseline cannot be followed on the data.
    """
    problem = Problem(system, noise, scatter, measured)
    say("fitting the baseline")
    base = fit_baseline(problem, rng)
    say("testing it")
    found = detect(problem, base, directions(problem, base), rng)
    where = locate(problem, base, tuple(by), rng)
    if not found.discrepant:
        return Findings(noise, base, found, where, detectable=tuple(detectable(problem, base, found, rng)))
    known(Findings(noise, base, found, where))
    say(f"discrepant (p = {found.p_value:.2g}): trying {len(system.candidates)} mechanisms")
    naming = name(problem, base, found, rng)
    known(Findings(noise, base, found, where, naming))
    say("predicting held-out conditions")
    times = stops if stops is not None else [float(o.t[0]) for o in system.observations]
    best = naming.best.fit
    gained = gain(problem, fit_baseline, times, rng, NEIGHBOURS)
    beyond = extrapolation(problem, base, best, by[0], times) if by else {}
    second = next((e.fit for e in naming.tried if e is not naming.best), base)
    proposal = propose(runnable, best, second, noise) if runnable else None
    seen = naming.best.detection if naming.named else found
    hidden = detectable(problem, best if naming.named else base, seen or found, rng)
    return Findings(noise, base, found, where, naming, gained, beyond, proposal, tuple(hidden))


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
