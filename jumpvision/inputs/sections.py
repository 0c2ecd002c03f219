"""The sections of experiment.toml and campaign.toml: what each key means, its unit and its allowed range.

Every section is optional, and so is nearly every key, until a stage needs it: `need` then names what is missing.
SI units throughout. Sections that name a recording carry `file`.
"""

from __future__ import annotations

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
from .section import FileSection, Header, MissingKey, NotApplicable, Section, need

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
