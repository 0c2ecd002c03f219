"""The keys of a protocol with unit and range, and its experiments: every combination of the lists of a sweep."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

from jumpvision.base.schema import REQUIRED, param

from .films.optics import BedCamera, Camera, GrainCamera
from .jumper import Law, Samples

Move = tuple[str, float]  # of an arm: ("to", depth [m]) | ("pause", time [s])

PHASES = {"single": 1.5 * math.pi, "stutter": 0.5 * math.pi, "delayed_stutter": 0.5 * math.pi, "sine": 0.0, "none": 0.0}

INTRUSIONS = ("intrusion", "reintrusion", "stop_go")


@dataclass(frozen=True)
class Header:
    """The keys above the first table."""

    name: str = param("campaign", "", "shown in the files' comments")
    ground: str = param("granular", "", "what the robot stands on", choices=("hard", "granular"))
    duration: float = param(1.8, "s", "length of the recordings", lo=0.01, hi=600.0)
    start: float = param(0.2, "s", "start of the motor on the common clock", lo=0)


@dataclass(frozen=True)
class RobotValues:
    """The robot as declared; mechanisms of [truth] such as payload change the real one."""

    motor_mass: float = param(REQUIRED, "kg", "actuator and carriage", lo=0, open_lo=True)
    rod_mass: float = param(REQUIRED, "kg", "thrust rod", lo=0, open_lo=True)
    spring_stiffness: float = param(REQUIRED, "N/m", "spring between rod and foot", lo=0, open_lo=True)
    foot_mass: float = param(0.0, "kg", "foot", lo=0)
    spring_damping: float = param(0.0, "N s/m", "viscous damping of the spring", lo=0)
    foot_radius: float = param(0.0381, "m", "radius of the flat disc foot", lo=0, open_lo=True)
    gravity: float = param(9.81, "m/s^2", "along the rail", lo=0, open_lo=True)


@dataclass(frozen=True)
class MotorValues:
    """Feedback loop of the real motor; without the table the motor is where its law says."""

    kp: float = param(REQUIRED, "N/m", "position gain", lo=0, open_lo=True)
    kd: float = param(0.0, "N s/m", "velocity gain", lo=0)
    max_force: float = param(1e9, "N", "force limit", lo=0, open_lo=True)
    max_speed: float = param(1e9, "m/s", "speed limit", lo=0, open_lo=True)
    stroke: float = param(1e9, "m", "travel", lo=0, open_lo=True)


@dataclass(frozen=True)
class BedValues:
    """The bed; volume_fraction is a key of [[jumps]]."""

    solid_volume: float = param(0.045, "m^3", "total volume of the grains", lo=0, open_lo=True)
    length: float = param(0.56, "m", "bed length", lo=0, open_lo=True)
    width: float = param(0.56, "m", "bed width", lo=0, open_lo=True)
    grain_density: float = param(1000.0, "kg/m^3", "density of a grain", lo=1.0)
    grain_diameter: float = param(0.001, "m", "grain diameter", lo=0, open_lo=True)


@dataclass(frozen=True)
class PreparationValues:
    """How air pulses after fluidisation pack the bed, the faster the more it is shaken; for `pulses` of [[jumps]]."""

    law: str = param("logarithmic", "", "how the packing goes on", choices=("logarithmic", "stretched"))
    loose: float = param(0.57, "", "volume fraction of the fluidised bed", lo=0.3, hi=0.8)
    dense: float = param(0.64, "", "volume fraction after pulses without end", lo=0.3, hi=0.8)
    shape: float = param(0.4, "", "B of 1 - 1/(1 + B ln(1 + n/tau)), exponent of 1 - exp(-(n/tau)^shape)", lo=0.01)
    tau: float = param(5.0, "", "pulses by which it packs, without shaking", lo=0, open_lo=True)
    shaking: float = param(1.0, "m/s^2", "shaking that halves tau", lo=0, open_lo=True)
    air_speed: float = param(0.3, "m/s", "of a pulse", lo=0)

    def check(self) -> list[str]:
        """Pulses pack."""
        if self.dense <= self.loose:
            return [f"dense = {self.dense:g}: must be > loose = {self.loose:g}"]
        return []

    def packed(self, pulses: float, shaking: float) -> float:
        """Volume fraction after pulses."""
        n = pulses / (self.tau / (1.0 + shaking / self.shaking))
        left = 1.0 / (1.0 + self.shape * math.log(1.0 + n)) if self.law == "logarithmic" else math.exp(-(n**self.shape))
        return self.dense - (self.dense - self.loose) * left


@dataclass(frozen=True)
class JumpSweep:
    """One [[jumps]]: every combination of its lists (a number, a list, or "LO:HI:N"), `trials` times."""

    kind: str = param(REQUIRED, "", "jump type", choices=tuple(PHASES))
    frequency: tuple[float, ...] = param((1.0,), "Hz", "forcing frequency", lo=0, open_lo=True)
    amplitude: tuple[float, ...] = param((0.01875,), "m", "forcing amplitude", lo=0)
    phase: tuple[float, ...] = param((), "rad", "start phase; default by kind", lo=-10, hi=10)
    delay: tuple[float, ...] = param((0.0,), "s", "pause between the two half cycles", lo=0)
    volume_fraction: tuple[float, ...] = param((0.57,), "", "of the bed", lo=0.3, hi=0.8)
    pulses: tuple[float, ...] = param((), "", "air pulses that pack the bed by [preparation], in its place", lo=0)
    shaking: tuple[float, ...] = param((0.0,), "m/s^2", "of the bed during the pulses", lo=0)
    cycles: float = param(1.0, "", "number of cycles", lo=0, open_lo=True)
    dwell_gain: float = param(1.0, "", "position gain during the delay / normal gain", lo=0, hi=1)
    trials: int = param(1, "", "repetitions of each", lo=1, hi=10000)

    def check(self) -> list[str]:
        """A pause divides one cycle; a moving motor has a frequency."""
        if any(self.delay) and self.cycles != 1:
            return [f"delay: needs cycles = 1, not {self.cycles:g}"]
        if self.kind == "delayed_stutter" and not all(self.delay):
            return ["delay: kind = 'delayed_stutter' needs delay > 0"]
        return []


@dataclass(frozen=True)
class IntrusionSweep:
    """One [[intrusions]]: an arm pushes a foot slowly into the bed; every combination of its lists, `trials` times."""

    kind: str = param("intrusion", "", "straight down, with withdrawals, or with pauses", choices=tuple(INTRUSIONS))
    volume_fraction: tuple[float, ...] = param((0.57,), "", "of the bed", lo=0.3, hi=0.8)
    foot_radius: tuple[float, ...] = param((), "m", "of the foot; default: the robot's", lo=0, open_lo=True)
    depth: float = param(0.06, "m", "how deep in the end", lo=0, open_lo=True)
    stops: int = param(4, "", "withdrawals or pauses on the way, evenly spaced", lo=1, hi=100)
    pause: tuple[float, ...] = param((0.3, 3.0), "s", "lengths of the pauses, in turn", lo=0, open_lo=True)
    trials: int = param(1, "", "repetitions of each", lo=1, hi=10000)


@dataclass(frozen=True)
class RodTrack:
    """rod_track.csv: a tracked rod with noise e_n = rho e_(n-1) + fresh, of the standard deviation asked for."""

    rate: float = param(200.0, "1/s", "samples a second", lo=0, open_lo=True)
    noise: float = param(5e-5, "m", "standard deviation", lo=0)
    rho: float = param(0.0, "", "correlation of neighbouring samples", lo=0, hi=0.99)
    step: float = param(0.0, "m", "heights are rounded to multiples of it (0: not)", lo=0)
    family: str = param(
        "white",
        "",
        "Gaussian, Student's t with 3 degrees of freedom, or Gaussian with 0.5 % of outliers of 8 to 60 "
        "standard deviations",
        choices=("white", "t3", "outliers"),
    )
    drift: float = param(0.0, "m", "root mean square of a slow wander of each track over its record", lo=0)
    ratio: float = param(1.0, "", "noisiest / quietest track; each has its own factor about `noise`", lo=1, hi=1e4)
    stated: bool = param(True, "", "whether the table has a column sigma_m")
    scale_error: float = param(0.0, "", "reported / true height - 1, of all tracks", lo=-0.5, hi=0.5)
    clock_offset: float = param(0.0, "s", "a frame stamped t shows t + clock_offset + clock_drift t", lo=-1, hi=1)
    clock_drift: float = param(0.0, "s/s", "see clock_offset", lo=-0.1, hi=0.1)


@dataclass(frozen=True)
class MotorLog:
    """motor.csv: the encoder and the motor's force."""

    rate: float = param(1000.0, "1/s", "samples a second", lo=0, open_lo=True)
    force_noise: float = param(0.3, "N", "standard deviation of the force", lo=0)
    step: float = param(6.25e-6, "m", "encoder step", lo=0)


@dataclass(frozen=True)
class ContactLog:
    """contact.csv."""

    rate: float = param(1000.0, "1/s", "samples a second", lo=0, open_lo=True)


@dataclass(frozen=True)
class RodFilm:
    """The film of the ball."""

    file: str = param("rod.avi", "", "rod.avi, .mkv, .tif, .mraw, or a folder of images such as rod")
    rate: float = param(200.0, "1/s", "frames a second", lo=0, open_lo=True)
    scale: float = param(5e-4, "m/px", "true metres per pixel", lo=0, open_lo=True)
    ball_diameter: float = param(0.0095, "m", "diameter of the ball", lo=0, open_lo=True)
    exposure: float = param(0.001, "s", "exposure time", lo=0)
    columns: int = param(60, "px", "width of the frames", lo=8, hi=4096)


@dataclass(frozen=True)
class BedImage:
    """bed.png, the back-lit side view."""

    scale: float = param(5e-4, "m/px", "metres per pixel", lo=0, open_lo=True)


@dataclass(frozen=True)
class GrainFilm:
    """grains.mkv around the first landing and the push-off."""

    source: str = param(
        "flow", "", "grains carried by a prescribed flow, or simulated discs", choices=("flow", "discs")
    )
    frames: int = param(58, "", "number of frames", lo=2, hi=10000)
    rate: float = param(500.0, "1/s", "frames a second", lo=0, open_lo=True)
    rows: int = param(464, "px", "height of the frames", lo=64, hi=4096)
    columns: int = param(396, "px", "width of the frames", lo=64, hi=4096)
    scale: float = param(3e-4, "m/px", "true metres per pixel", lo=0, open_lo=True)
    area_fraction: float = param(0.72, "", "of the discs in the plane", lo=0.3, hi=0.84)


@dataclass(frozen=True)
class IntrusionLog:
    """intrusion.csv of the [[intrusions]]: the arm's depth and its load cell."""

    rate: float = param(500.0, "1/s", "samples a second", lo=0, open_lo=True)
    speed: float = param(0.01, "m/s", "of the arm", lo=0, open_lo=True)
    start: float = param(0.006, "m", "height above the arm's zero at which the log begins", lo=-1, hi=1)
    noise: float = param(0.05, "N", "standard deviation of the load cell", lo=0)
    fluctuation: float = param(0.1, "N", "standard deviation of the grains' force, at the robot's foot_radius", lo=0)
    grain_length: float = param(0.001, "m", "depth over which that force is correlated", lo=0, open_lo=True)
    weight: float = param(0.8, "N", "what the load cell carries in the air", lo=-1e4, hi=1e4)
    surface: float = param(5e-4, "m", "standard deviation of the grains' surface about the arm's zero", lo=0)
    step: float = param(1e-5, "m", "resolution of the depth", lo=0, open_lo=True)


@dataclass(frozen=True)
class CraterImage:
    """crater.png: a laser line over the crater that the foot has left; its volume is crater_volume of [truth]."""

    scale: float = param(4e-4, "m/px", "metres per pixel", lo=0, open_lo=True)
    laser_angle: float = param(0.9, "rad", "between line of sight and laser sheet", lo=0.05, hi=0.5 * math.pi)
    depth: float = param(0.01, "m", "of the bowl, at the robot's foot_radius", lo=0, open_lo=True)
    line_width: float = param(1.8, "px", "standard deviation of the line across itself", lo=0.3, hi=20)
    speckle: float = param(0.05, "", "contrast of the laser's speckle", lo=0, hi=1)
    roughness: float = param(1e-4, "m", "standard deviation of the surface's relief, a grain wide", lo=0)
    uneven: float = param(0.0, "", "relative standard deviation of the relief of each half", lo=0, hi=0.5)


@dataclass(frozen=True)
class Records:
    """[record]: what is recorded, None where nothing is."""

    rod_track: RodTrack | None = None
    rod_film: RodFilm | None = None
    motor_log: MotorLog | None = None
    contact_log: ContactLog | None = None
    grain_film: GrainFilm | None = None
    bed_image: BedImage | None = None
    crater_image: CraterImage | None = None
    intrusion_log: IntrusionLog | None = None


JUMP_RECORDS = ("rod_track", "rod_film", "motor_log", "contact_log", "grain_film")
BED_RECORDS = ("bed_image", "crater_image")  # of jumps and intrusions alike


@dataclass(frozen=True)
class Cameras:
    """The cameras of a protocol, each with its own table."""

    camera: Camera = Camera()
    grain_camera: GrainCamera = GrainCamera()
    bed_camera: BedCamera = BedCamera()


FILMED_BY = {"rod_film": "camera", "grain_film": "grain_camera", "bed_image": "bed_camera"}


_SWEPT = ("volume_fraction", "pulses", "shaking", "frequency", "amplitude", "phase", "delay", "foot_radius", "pause")


class Jump(NamedTuple):
    """A jump of a protocol."""

    number: int
    name: str
    group: str
    kind: str
    law: Law | Samples
    volume_fraction: float
    pulses: float | None = None  # since fluidisation; None: the packing is given
    shaking: float = 0.0  # m/s^2


class Intrusion(NamedTuple):
    """A slow intrusion of a protocol; foot_radius [m]."""

    number: int
    name: str
    group: str
    moves: tuple[Move, ...]
    foot_radius: float
    volume_fraction: float


def lists(sweep: Any) -> Any:
    """Numbers and "LO:HI:N" as lists, for the keys that may be swept."""
    if not isinstance(sweep, Mapping):
        return sweep
    out = dict(sweep)
    for key in _SWEPT:
        value = out.get(key)
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            out[key] = [value]
        elif isinstance(value, str) and value.count(":") == 2:
            try:
                lo, hi, n = float(value.split(":")[0]), float(value.split(":")[1]), int(value.split(":")[2])
            except ValueError:
                continue
            out[key] = [round(lo + (hi - lo) * i / max(n - 1, 1), 9) for i in range(n)]
    return out


def jumps_of(
    sweeps: Sequence[JumpSweep],
    *,
    start: float,
    ground: str,
    part: str,
    first: int,
    preparation: PreparationValues | None = None,
) -> tuple[Jump, ...]:
    """part: goes before every name; first: number of the first one."""
    out: list[Jump] = []
    for s in sweeps:
        axes = {"volume_fraction": s.volume_fraction if ground == "granular" else s.volume_fraction[:1]}
        if s.pulses and preparation:
            axes = {"pulses": s.pulses, "shaking": s.shaking}
        axes |= {"frequency": s.frequency, "amplitude": s.amplitude, "delay": s.delay}
        axes["phase"] = s.phase or (PHASES[s.kind],)
        varied = [n for n, a in axes.items() if len(a) > 1 and n != "frequency"]
        for values in product(*axes.values()):
            v = dict(zip(axes, values))
            cycles, amplitude = (0.0, 0.0) if s.kind == "none" else (s.cycles, v["amplitude"])
            law = Law(v["frequency"], amplitude, v["phase"], start, cycles, v["delay"], s.dwell_gain)
            pulses, shaking = v.get("pulses"), v.get("shaking", 0.0)
            if preparation and pulses is not None:
                v["volume_fraction"] = preparation.packed(pulses, shaking)
            unit = {
                "volume_fraction": "phi",
                "pulses": "pulses",
                "shaking": "shaking",
                "amplitude": "A",
                "delay": "delay",
                "phase": "phase",
            }
            group = "-".join([part + s.kind, f"{v['frequency']:.6g}Hz", *(f"{unit[n]}{v[n]:.6g}" for n in varied)])
            for trial in range(1, s.trials + 1):
                number = first + len(out)
                name, phi = f"{group}-{trial}", v["volume_fraction"]
                out.append(Jump(number, name, group, s.kind, law, phi, pulses, shaking))
    return tuple(out)


def intrusions_of(
    sweeps: Sequence[IntrusionSweep], *, foot_radius: float, part: str, first: int
) -> tuple[Intrusion, ...]:
    """foot_radius [m]: of the robot; part, first: as in `jumps_of`."""
    out: list[Intrusion] = []
    for s in sweeps:
        ways = {other.stops for other in sweeps if other.kind == s.kind}
        stops = f"-{s.stops}stops" if s.kind != "intrusion" and len(ways) > 1 else ""
        for radius, phi in product(s.foot_radius or (foot_radius,), s.volume_fraction):
            variant = (f"-R{1e3 * radius:.6g}mm" if len(s.foot_radius) > 1 else "") + stops
            group = f"{part}{s.kind}{variant}-phi{phi:.6g}"
            for trial in range(1, s.trials + 1):
                number = first + len(out)
                out.append(Intrusion(number, f"{group}-{trial}", group, moves_of(s), radius, phi))
    return tuple(out)


def moves_of(s: IntrusionSweep) -> tuple[Move, ...]:
    """What the arm does; a withdrawal goes 4 mm above the arm's zero."""
    at = [s.depth * (i + 1) / (s.stops + 1) for i in range(s.stops)] if s.kind != "intrusion" else []
    out: list[Move] = []
    for i, z in enumerate(at):
        out += [("to", z), ("to", -0.004) if s.kind == "reintrusion" else ("pause", s.pause[i % len(s.pause)])]
    return (*out, ("to", s.depth))
