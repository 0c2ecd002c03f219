"""The tracks of a campaign's jumps as recordings of a simulator that is not ours."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import asdict, replace

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError, read
from jumpvision.engine.study.study import Recording
from jumpvision.experiment.inputs.experiment import Campaign, Experiment
from jumpvision.experiment.inputs.labels import Labels
from jumpvision.experiment.inputs.parameters import SimulateParams
from jumpvision.experiment.inputs.sections import Actuation, Motor, MotorLog
from jumpvision.experiment.results.tables import RodMotion
from jumpvision.experiment.stages.simulate import driver
from jumpvision.experiment.workflow.run import Outcome
from jumpvision.experiment.workflow.stage import StageWarning
from jumpvision.jumper.physics.forcing import Loop

from .circumstances import circumstances
from .jumps import states_noise


def recordings_of(campaign: Campaign, outcomes: Mapping[str, Outcome]) -> list[Recording]:
    """The tracks of a campaign's jumps as recordings of a simulator that is not ours.

    values: height above rest [m]; inputs: motor_time_s, motor_m, motor_stop_s where a motor is known, and every section
    of the experiment by name ("robot", "bed", ...) as a dict; labels: kind, frequency, delay, and [labels].
    Raises InputError where no experiment has a track.
    """
    out = []
    known = circumstances(campaign.experiments)
    for e in campaign.experiments:
        outcome = outcomes.get(e.name)
        if outcome is None or not (outcome.results / RodMotion.file).exists():
            continue
        t, y, sigma = RodMotion.load(outcome.results).arrays
        c = known[e.name]
        made = recording_of(e, t, y, sigma if states_noise(e) else None)
        out.append(replace(made, order=c.order, recorded=c.time, session=c.session or "", source=c.source))
    if not out:
        raise InputError(
            [f"{campaign.path}: no experiment has a track ([rod_video] or [rod_track]): nothing to diagnose"]
        )
    return out


def recording_of(e: Experiment, t: Array, y: Array, sigma: Array | None) -> Recording:
    """One of them; its place in the series is not known. t [s], y, sigma [m]: (n,)."""
    law, log, motor = e.section(Actuation), e.section(MotorLog), e.section(Motor)
    inputs: dict[str, object] = {n: asdict(x) for n, x in e.sections.items() if n != Labels.name}
    if (law and law.moves) or log:
        p, _ = read(SimulateParams, e.params.get("simulate", {}), "")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StageWarning)  # said by the stage `simulate`
            forcing, stop = driver(log, law, motor, p or SimulateParams(), sand=e.ground == "granular")
        inputs["motor_stop_s"] = stop
        if not isinstance(forcing, Loop):
            fine = np.linspace(t[0], t[-1], 4 * (t.size - 1) + 1)  # four values of the motor's position a frame
            inputs |= {"motor_time_s": fine, "motor_m": forcing(fine)[0]}
    labels: dict[str, str | float | None] = {"kind": law.kind if law else "logged_motion"}
    labels |= {"frequency": law.frequency, "delay": law.delay} if law else {}
    if own := e.section(Labels):
        labels |= own.values
    return Recording(e.name, t, y, inputs, labels, e.header.group or e.name, sigma=sigma)
