"""Protocols: what the automated apparatus should do and record, as TOML; SI units (docs/laboratory.md shows one).

A protocol holds the robot, the bed, the truth (mechanisms with their parameters, also by volume fraction), sweeps
over jumps, what is recorded, the camera's faults and the model that the written campaign declares.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from itertools import pairwise, product
from pathlib import Path
from typing import Any, NamedTuple

from jumpvision.schema import InputError, closest, read

from .mechanisms import AT_THE_CAMERA, KNOWN, Law, Motor, Robot, truth_of
from .protocol_keys import PHASES, RECORDS, BedValues, Camera, Header, JumpSweep, MotorValues, RobotValues

CAMERA_PARAMETERS = {"camera_scale": "scale", "time_offset": "dt"}
PARAMETERS = {name for names in KNOWN.values() for name in names} | set(CAMERA_PARAMETERS.values())
_SWEPT = ("volume_fraction", "frequency", "amplitude", "phase", "delay")


class Jump(NamedTuple):
    """One experiment of a protocol."""

    number: int
    name: str
    group: str
    kind: str
    law: Law
    volume_fraction: float


@dataclass(frozen=True)
class Protocol:
    """A validated protocol. parameters: value, or ((phi, value), ...) joined by straight lines; scatter: relative
    standard deviations from jump to jump. tables: [model] and [robot.sigma] as they go into campaign.toml."""

    header: Header
    robot: Robot
    motor: Motor | None
    bed: BedValues
    terms: tuple[str, ...]
    parameters: Mapping[str, Any]
    scatter: Mapping[str, float]
    jumps: tuple[Jump, ...]
    records: Mapping[str, Any]
    camera: Camera
    tables: Mapping[str, Any] = field(default_factory=dict)

    def truth(self, phi: float, rng: Any) -> tuple[float, dict[str, float]]:
        """Volume fraction and parameters of one jump asked for at `phi`, with their scatter."""
        phi = phi * (1 + self.scatter.get("volume_fraction", 0.0) * rng.normal())
        values = values_at(self.parameters, phi)
        return phi, {n: v * (1 + self.scatter.get(n, 0.0) * rng.normal()) for n, v in values.items()}


def values_at(parameters: Mapping[str, Any], phi: float) -> dict[str, float]:
    """Parameters of [truth] at a volume fraction."""
    return {n: v if isinstance(v, float) else _at(v, phi) for n, v in parameters.items()}


def _at(points: Sequence[tuple[float, float]], phi: float) -> float:
    """Straight lines between points, the outer ones continued."""
    for (a, x), (b, y) in pairwise(points):
        if phi <= b or (b, y) == points[-1]:
            return x + (y - x) * (phi - a) / (b - a)
    return points[0][1]


def read_protocol(path: Path) -> Protocol:
    """The protocol file at `path`. Raises InputError with every problem found."""
    try:
        table = tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
    except tomllib.TOMLDecodeError as e:
        raise InputError([f"{path}: not valid TOML: {e}"]) from e
    except (OSError, UnicodeDecodeError) as e:
        raise InputError([f"{path}: cannot be read: {e}"]) from e
    return protocol_of(table, str(path))


def protocol_of(table: Mapping[str, Any], where: str) -> Protocol:
    """The protocol that a table describes; `where` names it in messages."""
    known = {"robot", "motor", "bed", "truth", "jumps", "record", "camera", "model"}
    plain = {k: v for k, v in table.items() if k not in known}
    header, problems = read(Header, plain, f"{where}:")

    def part(cls: type, name: str, value: Any, extra: tuple[str, ...] = ()) -> Any:
        out, more = read(cls, value, f"{where}: [{name}]", extra=extra)
        problems.extend(more)
        return out

    robot = part(RobotValues, "robot", table.get("robot", {}), ("sigma",))
    motor = part(MotorValues, "motor", table["motor"]) if "motor" in table else None
    bed = part(BedValues, "bed", table.get("bed", {}))
    camera = part(Camera, "camera", table.get("camera", {}))
    record = table.get("record", {})
    records = {}
    for name, value in record.items() if isinstance(record, Mapping) else ():
        if name in RECORDS:
            records[name] = part(RECORDS[name], f"record.{name}", value)
        else:
            problems.append(f"{where}: [record.{name}]: cannot be recorded{closest(name, RECORDS)}")
    if not records:
        problems.append(
            f"{where}: [record]: nothing is recorded; give one of {', '.join(RECORDS)}, e.g. rod_track = {{}}"
        )
    terms, parameters, scatter, more = _truth(table.get("truth", {}), f"{where}: [truth]")
    problems += more
    sweeps = table.get("jumps", [])
    if not isinstance(sweeps, list) or not sweeps:
        problems.append(f"{where}: [[jumps]]: missing; give at least one with kind = ...")
        sweeps = []
    read_sweeps = []
    for i, sweep in enumerate(sweeps, 1):
        out, more = read(JumpSweep, _lists(sweep), f"{where}: [[jumps]] number {i}:")
        read_sweeps.append(out)
        problems += more
    if problems:
        raise InputError(problems)
    jumps = _expand(read_sweeps, header.start, header.ground)
    problems = _check(header, jumps, records, where)
    values = {f.name: getattr(robot, f.name) for f in fields(robot)}
    for phi in dict.fromkeys(j.volume_fraction for j in jumps):
        try:
            density = phi * bed.grain_density
            truth_of(Robot(**values), terms, values_at(parameters, phi), ground=header.ground, bed_density=density)
        except ValueError as e:
            problems.append(f"{where}: [truth] at volume fraction {phi:g}: {e}")
    if motor and "motor_lag" in terms:
        problems.append(f"{where}: [truth] terms: 'motor_lag' beside [motor]; leave one of them out")
    if problems:
        raise InputError(problems)
    tables = {"model": table.get("model", {}), "robot.sigma": table["robot"].get("sigma", {})}
    loop = Motor(**{f.name: getattr(motor, f.name) for f in fields(motor)}) if motor else None
    return Protocol(
        header, Robot(**values), loop, bed, terms, parameters, scatter, jumps, records, camera,
        {k: v for k, v in tables.items() if v},
    )  # fmt: skip


def _truth(table: Any, where: str) -> tuple[tuple[str, ...], dict[str, Any], dict[str, float], list[str]]:
    if not isinstance(table, Mapping):
        return (), {}, {}, [f"{where}: must be a table"]
    problems = []
    terms = tuple(table.get("terms", ()))
    vocabulary = (*KNOWN, *AT_THE_CAMERA)
    problems += [
        f"{where} terms: unknown mechanism {t!r}{closest(str(t), vocabulary)}" for t in terms if t not in vocabulary
    ]
    parameters: dict[str, Any] = {}
    for name, value in table.items():
        if name in ("terms", "scatter"):
            continue
        if name not in PARAMETERS:
            problems.append(f"{where} {name}: unknown parameter{closest(name, PARAMETERS)}")
        elif isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value):
            parameters[name] = float(value)
        elif _is_points(value):
            parameters[name] = tuple((float(a), float(b)) for a, b in value)
        else:
            problems.append(f"{where} {name} = {value!r}: must be a number, or [[phi, value], ...] with rising phi")
    need = {n: t for t in terms for n in KNOWN.get(t, ())}
    need |= {CAMERA_PARAMETERS[t]: t for t in terms if t in CAMERA_PARAMETERS}
    problems += [f"{where} {n}: missing; '{t}' needs it" for n, t in need.items() if n not in table]
    scatter = table.get("scatter", {})
    for name, value in scatter.items() if isinstance(scatter, Mapping) else ():
        if name not in (*parameters, "volume_fraction"):
            problems.append(f"{where[:-1]}.scatter] {name}: no parameter of [truth]{closest(name, parameters)}")
        elif not isinstance(value, (int, float)) or not 0 <= value < 1:
            problems.append(
                f"{where[:-1]}.scatter] {name} = {value!r}: must be in [0, 1) (relative standard deviation)"
            )
    return terms, parameters, {k: float(v) for k, v in dict(scatter).items()} if not problems else {}, problems


def _is_points(value: Any) -> bool:
    number = (int, float)
    good = isinstance(value, list) and len(value) >= 2
    good = good and all(isinstance(p, list) and len(p) == 2 and all(isinstance(x, number) for x in p) for p in value)
    return good and all(a[0] < b[0] for a, b in pairwise(value))


def _lists(sweep: Any) -> Any:
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


def _expand(sweeps: Sequence[JumpSweep], start: float, ground: str) -> tuple[Jump, ...]:
    out: list[Jump] = []
    for s in sweeps:
        axes = {"volume_fraction": s.volume_fraction if ground == "granular" else s.volume_fraction[:1]}
        axes |= {"frequency": s.frequency, "amplitude": s.amplitude, "delay": s.delay}
        axes["phase"] = s.phase or (PHASES[s.kind],)
        told = [n for n, a in axes.items() if len(a) > 1 and n != "frequency"]
        for values in product(*axes.values()):
            v = dict(zip(axes, values))
            cycles, amplitude = (0.0, 0.0) if s.kind == "none" else (s.cycles, v["amplitude"])
            law = Law(v["frequency"], amplitude, v["phase"], start, cycles, v["delay"], s.dwell_gain)
            unit = {"volume_fraction": "phi", "amplitude": "A", "delay": "delay", "phase": "phase"}
            group = "-".join([s.kind, f"{v['frequency']:.6g}Hz", *(f"{unit[n]}{v[n]:.6g}" for n in told)])
            for trial in range(1, s.trials + 1):
                out.append(Jump(len(out), f"{group}-{trial}", group, s.kind, law, v["volume_fraction"]))
    return tuple(out)


def _check(header: Header, jumps: Sequence[Jump], records: Mapping[str, Any], where: str) -> list[str]:
    problems = []
    names = [j.name for j in jumps]
    twice = sorted({n for n in names if names.count(n) > 1}) if len(set(names)) < len(names) else []
    problems += [f"{where}: [[jumps]]: '{n}' is made twice; put its trials into one entry" for n in twice]
    late = [j for j in jumps if j.law.stop >= header.duration]
    problems += [
        f"{where}: duration = {header.duration:g}: the motor of '{j.name}' stops at {j.law.stop:.4g} s; record longer"
        for j in late[:1]
    ]
    if header.ground == "hard":
        problems += [
            f"{where}: [record.{n}]: needs ground = 'granular'" for n in ("bed_image", "grain_film") if n in records
        ]
    return problems
