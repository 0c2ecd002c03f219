"""Doubts: where the recordings of an experiment contradict each other, and what is right only by an odd chance."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

from jumpvision.base.record import Record
from jumpvision.base.schema import StageWarning
from jumpvision.experiment.inputs.experiment import Experiment
from jumpvision.experiment.inputs.model import ModelSpec
from jumpvision.experiment.inputs.sections import (
    Actuation,
    Bed,
    BedImage,
    Calibration,
    ContactLog,
    CraterDepth,
    CraterImage,
    GrainVideo,
    IntrusionLog,
    Motor,
    MotorLog,
    Robot,
    RodTrack,
    RodVideo,
    SpringLog,
)
from jumpvision.experiment.results.tables import RodMotion
from jumpvision.experiment.results.values import BedHeight, CraterShape, Doubts
from jumpvision.experiment.workflow.stage import Inputs, stage

from .preflight import Found, suspicious


@dataclass(frozen=True)
class Everything(Inputs):
    """All that can contradict something else, None where it is not there."""

    rod: RodMotion | None
    height: BedHeight | None
    shape: CraterShape | None
    robot: Robot | None
    law: Actuation | None
    log: MotorLog | None
    motor: Motor | None
    contact: ContactLog | None
    table: RodTrack | None
    film: RodVideo | None
    grains: GrainVideo | None
    image: BedImage | None
    line: CraterImage | None
    depth: CraterDepth | None
    pushed: IntrusionLog | None
    spring: SpringLog | None
    calibration: Calibration | None
    section: Bed | None
    spec: ModelSpec | None


RECORDED = ("rod", "log", "contact", "table", "film", "grains", "image", "line", "depth", "pushed", "spring")


@stage(version=5, any_of=RECORDED)
def doubts(experiment: Experiment, given: Everything) -> Doubts:
    """Recordings that contradict each other or what is declared; units, clocks, marks and names that look wrong.

    `warnings` [{kind, message, recording, values}], those of `jumpvision check`.
    """
    made: dict[type, Record | None] = {RodMotion: given.rod, BedHeight: given.height, CraterShape: given.shape}
    warned = suspicious(experiment, Found([], [], {}, made))
    for t in warned:
        warnings.warn(StageWarning(t["kind"], t["message"], t["recording"], t["values"]), stacklevel=2)
    return Doubts({"warnings": warned})
