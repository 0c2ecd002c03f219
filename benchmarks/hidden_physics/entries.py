"""What an entry is given and what it answers; our own entry, and plain least squares."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from jumpvision.campaign.diagnose import leftover
from jumpvision.campaign.discovered import Laws
from jumpvision.campaign.document import document
from jumpvision.diagnosis.diagnose import explain, fit_baseline, foretell
from jumpvision.diagnosis.fitting import Problem
from jumpvision.diagnosis.jumper.jumper import Jumper
from jumpvision.diagnosis.jumper.jumps import Jump
from jumpvision.diagnosis.noise.learning import learn_noise


@dataclass(frozen=True)
class Task:
    """A campaign: its jumps (tracks, what drove them, the declared model), ranges and priors of declared values."""

    jumps: list[Jump]
    ranges: dict[str, tuple[float, float]]
    priors: dict[str, float]


@dataclass(frozen=True)
class Answer:
    """adequate: nothing is missing. named: what is. partial: significant misfit is left beside it. twins: sets that
    cannot be told apart. probability: of mechanisms; parameters: name -> 90 % interval; described: otherwise than by
    names."""

    adequate: bool
    named: tuple[str, ...] = ()
    partial: bool = False
    twins: tuple[tuple[str, ...], ...] = ()
    probability: dict[str, float] = field(default_factory=dict)
    parameters: dict[str, tuple[float, float]] = field(default_factory=dict)
    described: tuple[str, ...] = ()


Entry = Callable[[Task], Answer]


def ours(task: Task) -> Answer:
    """`jumpvision diagnose`."""
    learned = learn_noise(Jumper(task.jumps, task.ranges, task.priors, workers=1))
    system, stops = learned.system, [j.stop for j in task.jumps]
    rng = np.random.default_rng(1)
    problem, say = Problem(system, learned.noise, learned.scatter), lambda text: None
    laws = Laws(problem, system, say)
    found = explain(problem, rng, by=("kind",), say=say, enough=laws.alone)
    law = laws.law(found)
    found = foretell(problem, found, rng, by=("kind",), stops=stops, runnable=(), say=say)
    left = None if law else leftover(found, problem, system, lambda text: None)
    d = document(found, learned, left, law=law)
    chances = {c.mechanism: c.probability for c in d.causes}
    intervals = {n: (p.low, p.high) for c in d.causes if c.mechanism in d.named for n, p in c.parameters.items()}
    described = (law.law.equation,) if law else left.terms if left else ()
    return Answer(d.adequate, d.named, d.status == "partial", d.indistinguishable, chances, intervals, described)


def least_squares(task: Task) -> Answer:
    """Every mechanism alone, by least squares; the one with the smallest residuals is named, always."""
    learned = learn_noise(Jumper(task.jumps, task.ranges, task.priors, workers=1))
    problem = Problem(learned.system, learned.noise)
    base = fit_baseline(problem, np.random.default_rng(1))
    fits = [f for m in learned.system.candidates if (f := problem.fit((m,), base.named)) is not None]
    best = min(fits, key=lambda f: f.chi2)
    return Answer(False, best.mechanisms)


def entry(name: str) -> Entry:
    """`ours`, `least_squares`, or MODULE:NAME."""
    module, _, function = name.rpartition(":")
    found: Entry = getattr(importlib.import_module(module or __name__), function)
    return found
