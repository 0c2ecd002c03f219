"""Protocols: what the robot does and what is recorded of it, in SI units. docs/laboratory.md shows one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import NamedTuple

import numpy as np

from .films.optics import BedCamera, Camera, GrainCamera
from .jumper import Law, Motor, Robot, Samples
from .write import Value

PHASES = {"single": 1.5 * math.pi, "stutter": 0.5 * math.pi, "delayed_stutter": 0.5 * math.pi, "sine": 0.0, "none": 0.0}
FAMILIES = ("white", "t3", "outliers")


@dataclass(frozen=True)
class RodTrack:
    """rod_track.csv: a tracked rod with noise e_n = rho e_(n-1) + fresh, of the standard deviation asked for."""

    rate: float = 200.0  # 1/s
    noise: float = 5e-5  # m, standard deviation
    rho: float = 0.0  # correlation of neighbouring samples, in [0, 1)
    step: float = 0.0  # m, heights are rounded to multiples of it (0: not)
    family: str = "white"  # or "t3": Student's t, 3 degrees of freedom; "outliers": 0.5 % of 8 to 60 deviations
    drift: float = 0.0  # m, root mean square of a slow wander of each track over its record
    ratio: float = 1.0  # noisiest / quietest track; each has its own factor about `noise`
    stated: bool = True  # whether the table has a column sigma_m
    scale_error: float = 0.0  # reported / true height - 1, of all tracks
    clock_offset: float = 0.0  # s, a frame stamped t shows t + clock_offset + clock_drift t
    clock_drift: float = 0.0

    def __post_init__(self) -> None:
        if self.family not in FAMILIES or not 0 <= self.rho < 1 <= self.ratio:
            raise ValueError(f"{self}: needs family of {', '.join(FAMILIES)}, rho in [0, 1) and ratio >= 1")


@dataclass(frozen=True)
class MotorLog:
    """motor.csv: the encoder and the motor's force."""

    rate: float = 1000.0  # 1/s
    force_noise: float = 0.3  # N, standard deviation
    step: float = 6.25e-6  # m, of the encoder


@dataclass(frozen=True)
class ContactLog:
    """contact.csv."""

    rate: float = 1000.0  # 1/s


@dataclass(frozen=True)
class RodFilm:
    """Describe the film of the ball."""

    file: str = "rod.avi"  # or .mkv, .tif, .mraw, or a folder of images such as rod
    rate: float = 200.0  # 1/s
    scale: float = 5e-4  # m/px
    ball_diameter: float = 0.0095  # m
    exposure: float = 0.001  # s
    columns: int = 60  # px


@dataclass(frozen=True)
class BedImage:
    """bed.png, the back-lit side view."""

    scale: float = 5e-4  # m/px


@dataclass(frozen=True)
class GrainFilm:
    """grains.mkv around the first landing and the push-off, of grains carried by a prescribed flow."""

    frames: int = 58
    rate: float = 500.0  # 1/s
    rows: int = 464  # px
    columns: int = 396  # px
    scale: float = 3e-4  # m/px


@dataclass(frozen=True)
class Records:
    """List the recordings of every jump, None for each that is not made."""

    rod_track: RodTrack | None = None
    rod_film: RodFilm | None = None
    motor_log: MotorLog | None = None
    contact_log: ContactLog | None = None
    bed_image: BedImage | None = None
    grain_film: GrainFilm | None = None


@dataclass(frozen=True)
class Bed:
    """Describe the bed; its volume fraction is the jump's."""

    solid_volume: float = 0.045  # m^3, of all grains
    length: float = 0.56  # m
    width: float = 0.56  # m
    grain_density: float = 1000.0  # kg/m^3
    grain_diameter: float = 0.001  # m


class Jump(NamedTuple):
    """A jump of a protocol."""

    name: str
    group: str
    kind: str
    law: Law | Samples
    volume_fraction: float


def jumps_of(
    kind: str,
    frequency: Sequence[float],
    amplitude: Sequence[float] = (0.01875,),
    *,
    delay: Sequence[float] = (0.0,),
    volume_fraction: Sequence[float] = (0.57,),
    trials: int = 1,
    start: float = 0.2,
    cycles: float = 1.0,
    dwell_gain: float = 1.0,
) -> tuple[Jump, ...]:
    """Every combination of frequency [Hz], amplitude [m], delay [s] and volume fraction, `trials` times each.

    kind: one of PHASES, which has its phase; start of the motor [s]. Names say what is varied.
    """
    cycles = 0.0 if kind == "none" else cycles
    out: list[Jump] = []
    for phi, f, A, pause in product(volume_fraction, frequency, amplitude, delay):
        law = Law(f, A if cycles else 0.0, PHASES[kind], start, cycles, pause, dwell_gain)
        varied = (("phi", phi, volume_fraction), ("A", A, amplitude), ("delay", pause, delay))
        group = "-".join([kind, f"{f:.6g}Hz", *(f"{n}{value:.6g}" for n, value, axis in varied if len(axis) > 1)])
        out += [Jump(f"{group}-{trial}", group, kind, law, phi) for trial in range(1, trials + 1)]
    return tuple(out)


@dataclass(frozen=True)
class Protocol:
    """Hold the robot as declared, the mechanisms in force with their parameters, the jumps, what is recorded of them.

    parameters: values, or functions of the volume fraction; scatter: relative standard deviations from jump to jump,
    of parameters and of "volume_fraction". motor: the feedback loop, None where the motor is where its law says.
    model, robot_sigma: [model] and [robot.sigma] as campaign.toml has them. Faults of the cameras stand in camera (of
    the rod), grain_camera and bed_camera.
    """

    robot: Robot
    jumps: tuple[Jump, ...]
    records: Records
    terms: tuple[str, ...] = ()
    parameters: Mapping[str, float | Callable[[float], float]] = field(default_factory=dict)
    ground: str = "granular"
    duration: float = 1.8  # s
    bed: Bed = Bed()
    motor: Motor | None = None
    scatter: Mapping[str, float] = field(default_factory=dict)
    camera: Camera = Camera()
    grain_camera: GrainCamera = GrainCamera()
    bed_camera: BedCamera = BedCamera()
    model: Mapping[str, Value] = field(default_factory=dict)
    robot_sigma: Mapping[str, Value] = field(default_factory=dict)

    def __post_init__(self) -> None:
        late = next((j for j in self.jumps if j.law.stop >= self.duration), None)
        if late:
            stop = f"the motor of {late.name!r} stops at {late.law.stop:.4g} s"
            raise ValueError(f"duration = {self.duration:g}: {stop}; record longer")

    def draw_truth(self, phi: float, rng: np.random.Generator) -> tuple[float, dict[str, float]]:
        """Volume fraction and parameters of one jump asked for at `phi`, with their scatter."""
        phi = phi * (1 + self.scatter.get("volume_fraction", 0.0) * rng.normal())
        values = {n: v(phi) if callable(v) else v for n, v in self.parameters.items()}
        return phi, {n: v * (1 + self.scatter.get(n, 0.0) * rng.normal()) for n, v in values.items()}
