"""The sections of experiment.toml and campaign.toml: what each key means, its unit and its allowed range.

Every section is optional, and so is nearly every key, until a stage needs it: `need` then names what is missing.
SI units throughout. Sections that name a recording carry `file`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime
from typing import ClassVar

from jumpvision.base.schema import FileSection, MissingKey, NotApplicable, Section, lacking, need, param

from .recordings import (
    LENGTHS,
    SPEEDS,
    BedImage,
    Calibration,
    Clock,
    ContactLog,
    CraterDepth,
    CraterImage,
    GrainMask,
    GrainVideo,
    IntrusionLog,
    MotorLog,
    PivField,
    RodCorrections,
    RodTrack,
    RodVideo,
    SpringLog,
)


@dataclass(frozen=True)
class RobotSigma(Section):
    """Standard uncertainties of the robot's values; 0 takes the value as exact."""

    name: ClassVar[str] = "robot.sigma"
    motor_mass: float = param(0.0, "kg", "standard uncertainty", lo=0)
    rod_mass: float = param(0.0, "kg", "standard uncertainty", lo=0)
    foot_mass: float = param(0.0, "kg", "standard uncertainty", lo=0)
    spring_stiffness: float = param(0.0, "N/m", "standard uncertainty", lo=0)
    spring_damping: float = param(0.0, "N s/m", "standard uncertainty", lo=0)
    foot_radius: float = param(0.0, "m", "standard uncertainty", lo=0)
    gravity: float = param(0.0, "m/s^2", "standard uncertainty", lo=0)


@dataclass(frozen=True)
class Robot(Section):
    """Masses, spring and foot."""

    name: ClassVar[str] = "robot"
    motor_mass: float | None = param(None, "kg", "actuator and carriage", lo=0, hi=1e4, open_lo=True)
    rod_mass: float | None = param(None, "kg", "thrust rod", lo=0, hi=1e4, open_lo=True)
    foot_mass: float = param(0.0, "kg", "foot", lo=0, hi=1e3)
    spring_stiffness: float | None = param(None, "N/m", "spring between rod and foot", lo=0, hi=1e8, open_lo=True)
    spring_damping: float = param(0.0, "N s/m", "viscous damping of the spring", lo=0, hi=1e6)
    foot_radius: float | None = param(None, "m", "radius of the flat disc foot", lo=0, hi=1.0, open_lo=True)
    gravity: float = param(9.81, "m/s^2", "along the rail", lo=0, hi=30.0, open_lo=True)
    sigma: RobotSigma = param(RobotSigma(), "", "standard uncertainties of the values above")


@dataclass(frozen=True)
class Motor(Section):
    """Feedback loop and limits of the motor."""

    name: ClassVar[str] = "motor"
    kp: float | None = param(None, "N/m", "position gain", lo=0)
    kd: float | None = param(None, "N s/m", "velocity gain", lo=0)
    max_force: float | None = param(None, "N", "force limit", lo=0, open_lo=True)
    max_speed: float | None = param(None, "m/s", "speed limit", lo=0, open_lo=True)
    stroke: float | None = param(None, "m", "travel", lo=0, hi=10.0, open_lo=True)


PHASES = {"single": 1.5 * math.pi, "stutter": 0.5 * math.pi, "delayed_stutter": 0.5 * math.pi, "sine": 0.0}


@dataclass(frozen=True)
class Actuation(Section):
    """X_m(t) = A [sin(2 pi f t + phase) - sin(phase)], t from `start`."""

    name: ClassVar[str] = "actuation"
    kind: str = param(
        "sine", "", "jump type", choices=("single", "stutter", "delayed_stutter", "sine", "custom", "none")
    )
    frequency: float | None = param(None, "Hz", "forcing frequency", lo=0, hi=1000.0, open_lo=True)
    amplitude: float | None = param(None, "m", "forcing amplitude A", lo=0, hi=1.0, open_lo=True)
    phase: float | None = param(None, "rad", "start phase; default by kind", lo=-10.0, hi=10.0)
    cycles: float = param(1.0, "", "number of cycles", lo=0, hi=1e5, open_lo=True)
    delay: float = param(0.0, "s", "pause between the two half cycles", lo=0, hi=100.0)
    dwell_gain: float = param(1.0, "", "position gain during the delay / normal gain", lo=0, hi=1.0)
    start: float = param(0.0, "s", "start of the motion on the common clock", lo=-1e6, hi=1e9)

    @property
    def moves(self) -> bool:
        """Whether the law is a known motion."""
        return self.kind not in ("none", "custom")

    @property
    def start_phase(self) -> float:
        return PHASES.get(self.kind, 0.0) if self.phase is None else self.phase

    @property
    def stop(self) -> float:
        """End of the motor's motion on the common clock [s]; `start` where the law is not known."""
        return self.start + (self.cycles / need(self, "frequency")[0] + self.delay if self.moves else 0.0)

    def check(self) -> list[str]:
        """A pause needs the one cycle that it divides."""
        if self.delay and self.cycles != 1:
            return [f"delay = {self.delay}: needs cycles = 1 (the pause divides one cycle); cycles = {self.cycles}"]
        return []


@dataclass(frozen=True)
class Bed(Section):
    """The granular bed."""

    name: ClassVar[str] = "bed"
    volume_fraction: float | None = param(None, "", "solid volume / bulk volume", lo=0.3, hi=0.8)
    solid_volume: float | None = param(None, "m^3", "total volume of the grains", lo=0, hi=100.0, open_lo=True)
    length: float | None = param(None, "m", "bed length", lo=0, hi=100.0, open_lo=True)
    width: float | None = param(None, "m", "bed width", lo=0, hi=100.0, open_lo=True)
    grain_density: float = param(1000.0, "kg/m^3", "density of a grain; 1 g/cm^3 is 1000", lo=10.0, hi=3e4)
    grain_diameter: float | None = param(None, "m", "grain diameter", lo=0, hi=0.1, open_lo=True)


@dataclass(frozen=True)
class Preparation(Section):
    """What was done to the bed after it was fluidised, before the jump: air pulses and shaking pack it."""

    name: ClassVar[str] = "preparation"
    pulses: float = param(0.0, "", "air pulses since the bed was fluidised", lo=0, hi=1e9)
    air_speed: float | None = param(None, "m/s", "superficial air speed of a pulse", lo=0, hi=100.0)
    shaking: float = param(0.0, "m/s^2", "amplitude of the bed's acceleration by its shaker meanwhile", lo=0, hi=1000.0)


@dataclass(frozen=True)
class Fan(Section):
    """The fan that blows air through the bed: its curve, for the check of fluidisation."""

    name: ClassVar[str] = "fan"
    speed: tuple[float, ...] = param((), "m/s", "air speeds through the bed's area, increasing", lo=0, hi=100)
    pressure: tuple[float, ...] = param((), "Pa", "static pressure of the fan at these speeds", lo=0, hi=1e6)
    loss: float = param(0.0, "Pa s^2/m^2", "pressure lost in duct and distributor, per speed squared", lo=0)

    def check(self) -> list[str]:
        """Two points or more, speeds increasing."""
        if len(self.speed) != len(self.pressure) or len(self.speed) == 1:
            return [f"speed, pressure: {len(self.speed)} and {len(self.pressure)} values; must be two or more, as many"]
        if any(b <= a for a, b in zip(self.speed, self.speed[1:])):
            return [f"speed = {list(self.speed)}: must increase"]
        return []


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
    "GrainMask",
    "GrainVideo",
    "Header",
    "IntrusionLog",
    "MissingKey",
    "Motor",
    "MotorLog",
    "NotApplicable",
    "PivField",
    "Preparation",
    "Robot",
    "RobotSigma",
    "RodCorrections",
    "RodTrack",
    "RodVideo",
    "Section",
    "SpringLog",
    "lacking",
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
    recorded: datetime | None = param(None, "", "when it was recorded, with an offset from UTC or without")
    session: str = param("", "", "the day, person or set-up that it was recorded with")
    order: float | None = param(None, "", "its place in the series of recordings; default: by `recorded`")
    citation: str = param("", "", "how to cite the recordings: text, a DOI or an address")
    license: str = param("", "", "terms of use of the recordings: an SPDX identifier (CC-BY-4.0), an address or text")


SECTIONS: dict[str, type[Section]] = {
    s.name: s
    for s in (
        Robot,
        Motor,
        Actuation,
        Bed,
        Preparation,
        Fan,
        RodVideo,
        RodCorrections,
        Calibration,
        Clock,
        BedImage,
        GrainVideo,
        GrainMask,
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
