"""Which causes the recordings of a campaign could tell apart, before they are made: from what is declared alone.

Linear about the declared model (`engine.worth.identify`): of every mechanism, and of every number that may drift in the
order of the jumps, the strength from which it would show, and what it would not be told from.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from jumpvision.base.schema import InputError
from jumpvision.engine.document.diagnosis import strength
from jumpvision.engine.document.values import Pattern as Kind
from jumpvision.engine.fitting import Problem
from jumpvision.engine.noise.noise import Noise
from jumpvision.engine.vary.apart import variables
from jumpvision.engine.vary.patterns import Pattern, Weighed
from jumpvision.engine.worth.identify import Shown, information, limits_of_causes
from jumpvision.experiment.inputs.experiment import Campaign, Experiment
from jumpvision.experiment.inputs.parameters import SimulateParams
from jumpvision.experiment.inputs.sections import Actuation, Bed, Motor, MotorLog, Robot, RodVideo
from jumpvision.experiment.stages.simulate import build_model, driver
from jumpvision.experiment.workflow.stage import StageWarning
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.jumps import Jump

from .explore.offers import AFTER
from .jumps import questioned, spec_of

RATE, NOISE = 200.0, 5e-5  # 1/s, m: of a track whose film says nothing else
DRIFT = "drift of "


@dataclass(frozen=True)
class Isolable:
    """causes: mechanisms, and drifts of numbers, each with what shows of it; noise [m], rate [1/s]: as assumed.
    left_out: experiments that were not asked, and why."""

    causes: Sequence[Shown]
    jumps: int
    noise: float
    left_out: Sequence[str]

    @property
    def rows(self) -> list[dict[str, str]]:
        """As a table: cause, shows from, cannot be told from."""
        return [
            {
                "cause": c.mechanism,
                "shows from": f"{c.parameter} {strength(c.from_)} {'' if c.unit == '1' else c.unit}".rstrip()
                if np.isfinite(c.from_)
                else "nothing in its range shows",
                "cannot be told from": ", ".join(c.twins) or "-",
            }
            for c in self.causes
        ]

    @property
    def sentence(self) -> str:
        blind = [c.mechanism for c in self.causes if not np.isfinite(c.from_)]
        twins = sum(bool(c.twins) for c in self.causes)
        shown = f"{len(self.causes) - len(blind)} of {len(self.causes)} causes"
        said = f"{self.jumps} jumps with {1e3 * self.noise:g} mm of noise could show {shown}"
        if twins:
            said += f"; {twins} of them cannot be told apart from another by these jumps: that needs another sensor, a"
            said += " test of its own or other motions (jumpvision explore)"
        return said + (f"; nothing in its range would show: {', '.join(blind)}" if blind else "") + "."


def isolable(campaign: Campaign, workers: int = 1) -> Isolable:
    """Raises InputError where no experiment says how it is driven."""
    jumps, left_out = [], []
    asked = questioned(campaign)
    for e in asked:
        law = e.section(Actuation)
        if law is None or not law.moves or law.kind == "custom":
            left_out.append(f"{e.name}: only a log says how it is driven")
            continue
        try:
            jumps.append(_jump(e, law))
        except InputError as x:
            left_out.append(f"{e.name}: {x.problems[0]}")
    if not jumps:
        raise InputError(
            [f"{campaign.path}: no experiment with [robot] and [actuation] to foretell; {'; '.join(left_out)}"]
        )
    first = next(e for e in asked if e.name == jumps[0].name)
    spec, robot = spec_of(first), first.required(Robot)
    priors = {n: s for n, s in asdict(robot.sigma).items() if s}
    system = Jumper(jumps, {n: (low, high) for n, (low, high) in spec.fit.items()}, {**spec.sigma, **priors}, workers)
    noise = Noise(NOISE, 0.0, float(np.median(np.diff(jumps[0].t))))
    drifts = _drifts(system)
    info = information(Problem(system.varying(drifts), noise))
    numbers = {w.pattern.name: w.pattern.variable.name for w in drifts}
    causes = [_named(c, numbers) for c in limits_of_causes(info, range(len(jumps)))]
    return Isolable(causes, len(jumps), NOISE, left_out)


def _jump(e: Experiment, law: Actuation) -> Jump:
    log, film = e.section(MotorLog), e.section(RodVideo)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StageWarning)  # said where it is simulated
        model = build_model(e, e.required(Robot), spec_of(e), e.section(Bed), None)
        forcing, stop = driver(None, law, None if log else e.section(Motor), SimulateParams())
    rate = film.frame_rate if film is not None and film.frame_rate else RATE
    t = np.arange(0.0, stop + AFTER, 1.0 / rate)
    labels = {"kind": law.kind, "frequency": law.frequency, "delay": law.delay}
    return Jump(e.name, model, forcing, stop, t, np.zeros(t.size), e.name, e.name, log is None, labels)


def _drifts(system: Jumper) -> list[Weighed]:
    """Of every number, a straight line over the jumps in their order."""
    line = np.linspace(0.0, 1.0, len(system.jumps))[:, None]
    every = [v for v in variables(system).values() if not v.whole]
    patterns = [Pattern((v,), Kind.DRIFT, "order", line) for v in every]
    return [Weighed(p, np.array([0.1 * p.variable.spread]), np.eye(1), 0.0, 0.0) for p in patterns]


def _named(c: Shown, drifts: Mapping[str, str]) -> Shown:
    """A drift by the name of its number, in shares of it. drifts: names of numbers by those of their patterns."""

    def said(name: str) -> str:
        return f"{DRIFT}{drifts[name]}" if name in drifts else name

    parameter = "change" if c.mechanism in drifts else c.parameter
    return replace(c, mechanism=said(c.mechanism), parameter=parameter, twins=tuple(map(said, c.twins)))
