"""Protocols: what the automated apparatus should do and record, as TOML; SI units (docs/laboratory.md shows one).

A protocol holds the robot, the bed, the truth (mechanisms with their parameters, also by volume fraction), sweeps
over jumps, what is recorded, the camera's faults and the model that the written campaign declares.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np

from jumpvision.base.schema import InputError, closest, read, type_of

from .jumper import AT_THE_CAMERA, KNOWN, MAY_BE, UNLOGGED, Motor, Robot, truth_of
from .protocol_keys import (
    BED_RECORDS,
    FILMED_BY,
    JUMP_RECORDS,
    BedValues,
    Cameras,
    Header,
    Intrusion,
    IntrusionSweep,
    Jump,
    JumpSweep,
    MotorValues,
    PreparationValues,
    Records,
    RobotValues,
    intrusions_of,
    jumps_of,
    lists,
)
from .write import Value

Points = tuple[tuple[float, float], ...]  # (volume fraction, value), rising
CAMERA_PARAMETERS = {"camera_scale": "scale", "time_offset": "dt"}
PARAMETERS = {name for names in KNOWN.values() for name in names} | {*CAMERA_PARAMETERS.values(), *MAY_BE}
BED_PROPERTIES = ("saw", "crater_volume")  # of [truth] besides the parameters of mechanisms: N, m^3
MADE_BY_AN_ARM = {"motor_mass": 1.0, "rod_mass": 1.0, "spring_stiffness": 1.0, "foot_mass": 1.0}  # without [[jumps]]


@dataclass(frozen=True)
class Protocol:
    """A validated protocol. parameters: value, or ((phi, value), ...) joined by straight lines; scatter: relative
    standard deviations from jump to jump. model, robot_sigma: [model] and [robot.sigma] as campaign.toml has them."""

    header: Header
    robot: Robot
    motor: Motor | None
    bed: BedValues
    terms: tuple[str, ...]
    parameters: Mapping[str, float | Points]
    scatter: Mapping[str, float]
    jumps: tuple[Jump, ...]
    intrusions: tuple[Intrusion, ...]
    records: Records
    cameras: Cameras = Cameras()
    model: Mapping[str, Value] = field(default_factory=dict)
    robot_sigma: Mapping[str, Value] = field(default_factory=dict)
    file: Path = Path()
    part: str = ""  # what the names of its experiments begin with, where the protocol is part of another
    preparation: PreparationValues | None = None

    @property
    def experiments(self) -> tuple[Jump | Intrusion, ...]:
        """All of them, in the order of their numbers."""
        return self.jumps + self.intrusions

    def truth(self, phi: float, rng: np.random.Generator) -> tuple[float, dict[str, float]]:
        """Volume fraction and parameters of one jump asked for at `phi`, with their scatter."""
        phi = phi * (1 + self.scatter.get("volume_fraction", 0.0) * rng.normal())
        values = values_at(self.parameters, phi)
        return phi, {n: v * (1 + self.scatter.get(n, 0.0) * rng.normal()) for n, v in values.items()}


def values_at(parameters: Mapping[str, float | Points], phi: float) -> dict[str, float]:
    """Parameters of [truth] at a volume fraction."""
    return {n: v if isinstance(v, float) else _at(v, phi) for n, v in parameters.items()}


def _at(points: Points, phi: float) -> float:
    """Straight lines between points, the outer ones continued."""
    for (a, x), (b, y) in pairwise(points):
        if phi <= b or (b, y) == points[-1]:
            return x + (y - x) * (phi - a) / (b - a)
    return points[0][1]


def critical_fraction(volume: float | Points | None) -> float | None:
    """Volume fraction at which a crater_volume of [truth] is zero, if it crosses zero once."""
    if volume is None or isinstance(volume, float):
        return None
    found = [a + (b - a) * x / (x - y) for (a, x), (b, y) in pairwise(volume) if x * y < 0 or (y == 0 and x != 0)]
    return found[0] if len(found) == 1 else None


def read_protocol(path: Path) -> Protocol:
    """The protocol file at `path`. Raises InputError with every problem found."""
    return protocol_of(_table(path), str(path))


def read_parts(path: Path) -> list[Protocol]:
    """The protocol at `path`, or those that it names in `parts`, whose experiments carry the names of their files."""
    table = _table(path)
    if "parts" not in table:
        return [protocol_of(table, str(path))]
    names = table["parts"]
    others = [f"{path}: {k}: belongs in the parts, not beside them" for k in table if k not in ("parts", "name")]
    if not isinstance(names, list) or not names or not all(isinstance(n, str) for n in names):
        others.append(f"{path}: parts = {names!r}: must be a list of protocols, e.g. ['hard.toml', 'sand.toml']")
    elif len({Path(n).stem for n in names}) < len(names):
        others.append(f"{path}: parts = {names!r}: two files of one name; rename one")
    if others:
        raise InputError(others)
    out: list[Protocol] = []
    for name in names:
        file = Path(path).parent / name
        first = sum(len(p.experiments) for p in out)
        out.append(protocol_of(_table(file), str(file), part=f"{file.stem}-", first=first))
    return out


def _table(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
    except tomllib.TOMLDecodeError as e:
        raise InputError([f"{path}: not valid TOML: {e}"]) from e
    except (OSError, UnicodeDecodeError) as e:
        raise InputError([f"{path}: cannot be read: {e}"]) from e


def protocol_of(table: Mapping[str, Any], where: str, *, part: str = "", first: int = 0) -> Protocol:
    """The protocol that a table describes; `where` names it in messages, part and first as in `jumps_of`."""
    known = {
        "robot",
        "motor",
        "bed",
        "preparation",
        "truth",
        "jumps",
        "intrusions",
        "record",
        "model",
        *_names(Cameras),
    }
    plain = {k: v for k, v in table.items() if k not in known}
    header, problems = read(Header, plain, f"{where}:")

    def section(cls: type, name: str, value: Any, extra: tuple[str, ...] = ()) -> Any:
        out, more = read(cls, value, f"{where}: [{name}]", extra=extra)
        problems.extend(more)
        return out

    def sweeps(cls: type, name: str) -> list[Any]:
        given = table.get(name, [])
        if not isinstance(given, list):
            problems.append(f"{where}: {name} = {given!r}: must be written [[{name}]]")
            return []
        out = []
        for i, sweep in enumerate(given, 1):
            one, more = read(cls, lists(sweep), f"{where}: [[{name}]] number {i}:")
            out.append(one)
            problems.extend(more)
        return out

    declared = table.get("robot", {})
    if "jumps" not in table and isinstance(declared, Mapping):
        declared = MADE_BY_AN_ARM | dict(declared)
    robot = section(RobotValues, "robot", declared, ("sigma",))
    motor = section(MotorValues, "motor", table["motor"]) if "motor" in table else None
    bed = section(BedValues, "bed", table.get("bed", {}))
    packs = section(PreparationValues, "preparation", table["preparation"]) if "preparation" in table else None
    cameras = {name: section(type_of(Cameras, name)[0], name, table.get(name, {})) for name in _names(Cameras)}
    record = table.get("record", {})
    records = {}
    for name, value in record.items() if isinstance(record, Mapping) else ():
        if name in _names(Records):
            records[name] = section(type_of(Records, name)[0], f"record.{name}", value)
        else:
            problems.append(f"{where}: [record.{name}]: cannot be recorded{closest(name, _names(Records))}")
    terms, parameters, scatter, more = _truth(table.get("truth", {}), f"{where}: [truth]")
    problems += more
    jump_sweeps, intrusion_sweeps = sweeps(JumpSweep, "jumps"), sweeps(IntrusionSweep, "intrusions")
    if not jump_sweeps and not intrusion_sweeps:
        problems.append(f"{where}: [[jumps]]: missing; give at least one with kind = ..., or one [[intrusions]]")
    for i, (given, sweep) in enumerate(zip(table.get("jumps", []), jump_sweeps), 1):
        if sweep and sweep.pulses and packs is None:
            problems.append(f"{where}: [[jumps]] number {i}: pulses: need [preparation], which says how they pack")
        if sweep and sweep.pulses and "volume_fraction" in given:
            problems.append(f"{where}: [[jumps]] number {i}: pulses beside volume_fraction: give one of them")
    problems += _recorded(list(records), bool(jump_sweeps), bool(intrusion_sweeps), where)
    if problems:
        raise InputError(problems)
    jumps = jumps_of(jump_sweeps, start=header.start, ground=header.ground, part=part, first=first, preparation=packs)
    intrusions = intrusions_of(intrusion_sweeps, foot_radius=robot.foot_radius, part=part, first=first + len(jumps))
    values = {f.name: getattr(robot, f.name) for f in fields(robot)}
    loop = Motor(**{f.name: getattr(motor, f.name) for f in fields(motor)}) if motor else None
    protocol = Protocol(
        header,
        Robot(**values),
        loop,
        bed,
        terms,
        parameters,
        scatter,
        jumps,
        intrusions,
        Records(**records),
        Cameras(**cameras),
        table.get("model", {}),
        declared.get("sigma", {}),
        Path(where),
        part,
        packs,
    )
    return checked(protocol, where)


def checked(protocol: Protocol, where: str) -> Protocol:
    """The protocol itself. Raises InputError where its parts do not fit each other; `where` names it."""
    if problems := _check(protocol, where):
        raise InputError(problems)
    return protocol


def _names(cls: type) -> list[str]:
    return [f.name for f in fields(cls)]


def _recorded(records: Sequence[str], jumps: bool, intrusions: bool, where: str) -> list[str]:
    """Whether every experiment leaves something, and every record has its experiment."""
    out = []
    can = {"jumps": (*JUMP_RECORDS, *BED_RECORDS), "intrusions": ("intrusion_log", *BED_RECORDS)}
    for name, there in (("jumps", jumps), ("intrusions", intrusions)):
        if there and not set(records) & set(can[name]):
            out.append(
                f"{where}: [record]: nothing is recorded of [[{name}]]; give one of {', '.join(can[name])}, "
                f"e.g. {can[name][0]} = {{}}"
            )
    if "intrusion_log" in records and not intrusions:
        out.append(f"{where}: [record.intrusion_log]: needs [[intrusions]]")
    if not jumps and intrusions:
        out += [f"{where}: [record.{n}]: needs [[jumps]]" for n in records if n in JUMP_RECORDS]
    return out


def _truth(table: object, where: str) -> tuple[tuple[str, ...], dict[str, float | Points], dict[str, float], list[str]]:
    if not isinstance(table, Mapping):
        return (), {}, {}, [f"{where}: must be a table"]
    problems = []
    terms = tuple(table.get("terms", ()))
    vocabulary = (*KNOWN, *AT_THE_CAMERA)
    problems += [
        f"{where} terms: unknown mechanism {t!r}{closest(str(t), vocabulary)}" for t in terms if t not in vocabulary
    ]
    parameters: dict[str, float | Points] = {}
    for name, value in table.items():
        if name in ("terms", "scatter"):
            continue
        if name not in PARAMETERS and name not in BED_PROPERTIES:
            problems.append(f"{where} {name}: unknown parameter{closest(name, {*PARAMETERS, *BED_PROPERTIES})}")
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


def _is_points(value: object) -> TypeGuard[list[list[float]]]:
    if not isinstance(value, list) or len(value) < 2:
        return False
    pairs = all(isinstance(p, list) and len(p) == 2 and all(isinstance(x, (int, float)) for x in p) for p in value)
    return pairs and all(a[0] < b[0] for a, b in pairwise(value))


def _check(protocol: Protocol, where: str) -> list[str]:
    """What the parts of a protocol must be to each other."""
    header, records, names = protocol.header, protocol.records, [e.name for e in protocol.experiments]
    twice = sorted({n for n in names if names.count(n) > 1}) if len(set(names)) < len(names) else []
    problems = [
        f"{where}: {'[[intrusions]]' if n in {i.name for i in protocol.intrusions} else '[[jumps]]'}: '{n}' is made "
        "twice; put its trials into one entry"
        for n in twice
    ]
    problems += [
        f"{where}: duration = {header.duration:g}: the motor of '{j.name}' stops at {j.law.stop:.4g} s; record longer"
        for j in [j for j in protocol.jumps if j.law.stop >= header.duration][:1]
    ]
    if header.ground == "hard":
        sandy = ("bed_image", "grain_film", "crater_image", "intrusion_log")
        problems += [f"{where}: [record.{n}]: needs ground = 'granular'" for n in sandy if getattr(records, n)]
        problems += [f"{where}: [[intrusions]]: need ground = 'granular'"] if protocol.intrusions else []
    for phi in dict.fromkeys(e.volume_fraction for e in protocol.experiments):
        at, values = f"{where}: [truth] at volume fraction {phi:g}:", values_at(protocol.parameters, phi)
        density = phi * protocol.bed.grain_density
        try:
            if protocol.jumps or records.intrusion_log:  # craters alone need no force
                truth_of(protocol.robot, protocol.terms, values, ground=header.ground, bed_density=density)
        except ValueError as e:
            problems.append(f"{at} {e}")
        if values.get("saw", 0.0) < 0:
            problems.append(f"{at} saw = {values['saw']:.4g}: must be >= 0 N")
        if crater := records.crater_image:
            bowl = math.pi * crater.depth * protocol.robot.foot_radius**2
            if "crater_volume" not in values:
                problems.append(f"{at} crater_volume: missing; [record.crater_image] needs it (m^3)")
            elif values["crater_volume"] < -bowl:
                problems.append(
                    f"{at} crater_volume = {values['crater_volume']:.3g}: must be >= {-bowl:.3g} m^3, the bowl's own; "
                    "give [record.crater_image] a greater depth"
                )
    twice = [t for t in protocol.terms if protocol.motor and t in UNLOGGED]
    problems += [f"{where}: [truth] terms: {t!r} beside [motor]; leave one of them out" for t in twice]
    used = {n: getattr(protocol.cameras, n) for record, n in FILMED_BY.items() if getattr(records, record)}
    if any(c.calibrated for c in used.values()) and len({(c.k1, c.k2) for c in used.values()}) > 1:
        problems.append(
            f"{where}: [{'], ['.join(used)}]: calibrated, but k1, k2 differ; a folder's one [calibration] holds for "
            "all its films and pictures"
        )
    return problems
