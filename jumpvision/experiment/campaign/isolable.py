"""Which causes the recordings of a campaign could tell apart, before they are made: from what is declared alone.

Linear about the declared model (`engine.worth.isolable`).
"""

from __future__ import annotations

import warnings
from dataclasses import asdict

import numpy as np

from jumpvision.base.schema import InputError
from jumpvision.engine.fitting import Problem
from jumpvision.engine.noise.noise import Noise
from jumpvision.engine.worth.isolable import Isolable
from jumpvision.engine.worth.isolable import isolable as causes_shown
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
            [f"{campaign.path}: no experiment with [robot] and [actuation] to predict; {'; '.join(left_out)}"]
        )
    first = next(e for e in asked if e.name == jumps[0].name)
    spec, robot = spec_of(first), first.required(Robot)
    priors = {n: s for n, s in asdict(robot.sigma).items() if s}
    system = Jumper(jumps, {n: (low, high) for n, (low, high) in spec.fit.items()}, {**spec.sigma, **priors}, workers)
    noise = Noise(NOISE, 0.0, float(np.median(np.diff(jumps[0].t))))
    called = f"jumps with {1e3 * NOISE:g} mm of noise"
    causes = causes_shown(Problem(system, noise))
    return Isolable(causes, len(jumps), called, " (jumpvision explore)", left_out)


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
