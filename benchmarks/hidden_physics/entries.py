"""What an entry is given and what it answers; our own entry, and plain least squares."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from jumpvision.engine.detect import detect, directions
from jumpvision.engine.discovery import Laws
from jumpvision.engine.fitting import Fit, Problem
from jumpvision.engine.order import Order, fit_baseline, silent
from jumpvision.engine.worth.gain import Choose
from jumpvision.jumper.question.discovered import JumperForms
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.jumps import Jump
from jumpvision.jumper.question.learning import learn_noise
from jumpvision.jumper.question.words import diagnosis_of


@dataclass(frozen=True)
class Task:
    """A campaign: its jumps (tracks, what drove them, the declared model), ranges and priors of declared values."""

    jumps: list[Jump]
    ranges: dict[str, tuple[float, float]]
    priors: dict[str, float]


@dataclass(frozen=True)
class Gained:
    """interval: 95 %, of the root mean square error on conditions held out, before over after. on: the same of other
    jumps."""

    interval: tuple[float, float]
    on: Callable[[list[Jump]], float]


@dataclass(frozen=True)
class Answer:
    """adequate: nothing is missing. named: what is. partial: significant misfit is left beside it. twins: sets that
    cannot be told apart. probability: of mechanisms; parameters: name -> 90 % interval; described: otherwise than by
    names. detectable: mechanism -> (parameter, value that would have shown in 90 %); again: whether more than was
    answered shows in another campaign."""

    adequate: bool
    named: tuple[str, ...] = ()
    partial: bool = False
    twins: tuple[tuple[str, ...], ...] = ()
    probability: dict[str, float] = field(default_factory=dict)
    parameters: dict[str, tuple[float, float]] = field(default_factory=dict)
    described: tuple[str, ...] = ()
    gain: Gained | None = None
    detectable: dict[str, tuple[str, float]] = field(default_factory=dict)
    again: Callable[[Task], bool] | None = None


Entry = Callable[[Task], Answer]


def ours(task: Task) -> Answer:
    """`jumpvision diagnose`."""
    learned = learn_noise(Jumper(task.jumps, task.ranges, task.priors, workers=1))
    system, stops = learned.system, [j.stop for j in task.jumps]
    rng = np.random.default_rng(1)
    problem = Problem(system, learned.noise, learned.scatter)
    folds: list[Fold] = []

    def kept(choose: Choose) -> Choose:
        def chosen(part: Problem, base: Fit, rng: np.random.Generator) -> Fit:
            folds.append((part, base, choose(part, base, rng)))
            return folds[-1][2]

        return chosen

    laws = lambda p: Laws(p, JumperForms(p.system), silent)  # noqa: E731
    found = Order(problem, rng, by=("kind",), stops=stops, laws=laws, choosing=kept).all()
    d, law = diagnosis_of(found, learned), found.law
    chances = {c.mechanism: c.probability for c in d.causes}
    intervals = {n: (p.low, p.high) for c in d.causes if c.mechanism in d.named for n, p in c.parameters.items()}
    described = (law.described.law,) if law else ()
    gained = (
        Gained(found.gain.ratio_ci95, lambda jumps: on_others(folds, task, jumps)) if found.gain and folds else None
    )
    shown = {x.mechanism: (x.parameter, x.value) for x in d.detectable}
    return Answer(
        d.adequate, d.named, d.status == "partial", d.indistinguishable, chances, intervals, described, gained, shown,
        None if law or d.varies else lambda other: shows(found.named_fit, other),
    )  # fmt: skip


Fold = tuple[Problem, Fit, Fit]  # a campaign without some conditions, baseline and extended model made from the rest


def on_others(folds: list[Fold], task: Task, jumps: list[Jump]) -> float:
    """Ratio of the errors of the baselines and of the extended models on other jumps; each by the fold that was made
    without the jump that is nearest to it."""
    system = Jumper(jumps, task.ranges, task.priors, workers=1)
    errors = np.zeros(2)
    for part, *fits in folds:
        used = {o.condition for o in part.system.observations}
        mine = [i for i, j in enumerate(jumps) if nearest(j, task.jumps).condition not in used]
        for i, o in zip(mine, (system.observations[i] for i in mine)):
            for m, fit in enumerate(fits):
                errors[m] += float(np.sum((o.y - system.predict(fit.mechanisms, fit.named, [i])[0]) ** 2))
    return float(np.sqrt(errors[0] / errors[1]))


def nearest(jump: Jump, among: list[Jump]) -> Jump:
    """The jump of the same kind whose frequency is nearest."""
    alike = [j for j in among if j.labels["kind"] == jump.labels["kind"]]
    return min(alike, key=lambda j: abs(j.labels["frequency"] - jump.labels["frequency"]))


def shows(fit: Fit, task: Task) -> bool:
    """Whether a model is called discrepant on a campaign, its parameters fitted to that."""
    learned = learn_noise(Jumper(task.jumps, task.ranges, task.priors, workers=1))
    problem, rng = Problem(learned.system, learned.noise, learned.scatter), np.random.default_rng(1)
    again = problem.fit(fit.mechanisms, fit.named) if fit.mechanisms else fit_baseline(problem, rng)
    return again is None or detect(problem, again, directions(problem, again), rng).discrepant


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
