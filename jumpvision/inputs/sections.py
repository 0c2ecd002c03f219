"""The sections of experiment.toml and campaign.toml: what each key means, its unit and its allowed range.

Every section is optional, and so is nearly every key, until a stage needs it: `need` then names what is missing.
SI units throughout. Sections that name a recording carry `file`.
"""

from __future__ import annotations

from dataclasses import dataclass

from jumpvision.base.schema import FileSection, MissingKey, NotApplicable, Section, need, param

from .apparatus import PHASES, Actuation, Bed, Fan, Motor, Robot, RobotSigma
from .recordings import (
    LENGTHS,
    SPEEDS,
    BedImage,
    Calibration,
    Clock,
    ContactLog,
    CraterDepth,
    CraterImage,
    GrainVideo,
    IntrusionLog,
    MotorLog,
    PivField,
    RodTrack,
    RodVideo,
    SpringLog,
)

__all__ = [
    "LENGTHS",
    "PHASES",
    "SECTIONS",
    "SPEEDS",
    "Actuation",
    "Bed",
    "BedImage",
    "Calibration",
    "Clock",
    "ContactLog",
    "CraterDepth",
    "CraterImage",
    "Fan",
    "FileSection",
    "GrainVideo",
    "Header",
    "IntrusionLog",
    "MissingKey",
    "Motor",
    "MotorLog",
    "NotApplicable",
    "PivField",
    "Robot",
    "RobotSigma",
    "RodTrack",
    "RodVideo",
    "Section",
    "SpringLog",
    "need",
]


@dataclass(frozen=True)
class Header:
    """The keys above the first section."""

    schema: int = param(1, "", "version of this file format", lo=1, hi=1)
    name: str = param("", "", "unique in a campaign; default: the folder's name")
    ground: str = param("granular", "", "what the robot stands on", choices=("hard", "granular"))
    group: str = param("", "", "trials of one condition share a group")
    exclude: str = param("", "", "a reason: the experiment is skipped and listed with it")


SECTIONS: dict[str, type[Section]] = {
    s.name: s
    for s in (
        Robot,
        Motor,
        Actuation,
        Bed,
        Fan,
        RodVideo,
        Calibration,
        Clock,
        BedImage,
        GrainVideo,
        RodTrack,
        MotorLog,
        ContactLog,
        IntrusionLog,
        SpringLog,
        CraterDepth,
        PivField,
        CraterImage,
    )
}
