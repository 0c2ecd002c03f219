"""Experiments handed to an apparatus: protocol and motor table, a folder that waits for its recordings, the return.

A folder of the campaign is prepared whole and put in place at once. Until its recordings are there it is excluded, so
that the campaign can be run meanwhile; what is excluded says why.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError, Toml, read
from jumpvision.base.storage import write_aside
from jumpvision.experiment.inputs.experiment import EXPERIMENT, Experiment, merged
from jumpvision.experiment.inputs.logs import read_log
from jumpvision.experiment.inputs.sections import Actuation, MotorLog, RodTrack
from jumpvision.experiment.stages.rod import commanded, read_motor

from .offers import AFTER, Changes, Limits, Way, asked_of_motor, played

PROTOCOL, TABLE = "protocol.toml", "motor_command.csv"
WAITS, LIVE = "waits for", "#: "  # of the reason to exclude; lines that hold once the recordings are there
RECORDED = ("rod_video", "rod_track", "motor_log", "bed_image")  # sections of a jump whose files are asked for
LOG = {"file": "motor.csv"}  # of a motion that only it tells
# beside jumps: sections whose files are asked for, and what to do
TESTS: Mapping[str, tuple[Mapping[str, Toml], str]] = {
    "spring test": (
        {"spring_log": {"file": "spring.csv"}},
        "Press the spring alone step by step to its greatest travel and back, three times; "
        "spring.csv has displacement_m,force_N, one row a step, at least 20 rows.",
    ),
    "ring-down": (
        {"rod_track": {"file": "ringdown.csv"}},
        "Motor at rest, foot on hard ground: press the rod down by less than its weight bends the spring, let go, "
        "record until it is still; "
        "ringdown.csv has time_s,height_m.",
    ),
    "slow intrusion": (
        {"intrusion_log": {"file": "intrusion.csv"}},
        "Press the robot's foot into a bed prepared as for the jumps, slowly (1 cm/s or less), as deep as jumps reach; "
        "intrusion.csv has time_s,depth_m,force_N.",
    ),
    "grain film": (
        {"grain_video": {"file": "grains.mkv", "frame_rate": 0.0, "scale": 0.0, "foot": "half"}},
        "Film the grains beside a half foot at the wall during the jump of [actuation]; give the film's frame_rate "
        "[1/s] and scale [m/px].",
    ),
}
TICK = 1e-3  # s, of the motor's table


@dataclass(frozen=True)
class Returned:
    """A prepared folder. missing: recordings not there yet; differs: why they are not those of its protocol."""

    folder: Path
    missing: tuple[str, ...] = ()
    differs: str = ""

    @property
    def good(self) -> bool:
        return not self.missing and not self.differs


def prepare(
    like: Experiment, way: Way, name: str, limits: Limits, why: Sequence[str] = (), changes: Changes | None = None
) -> Path:
    """The folder of a jump beside another of its campaign: experiment.toml, protocol.toml, motor_command.csv.

    why: lines on what it is for; changes: of [bed] and [robot] of the other. Raises InputError for a command that the
    motor cannot do, or a folder that exists.
    """
    folder, law, forcing = like.path.parent / name, way.law, way.motion or commanded(way.law)
    if broken := limits.broken(law, way.motion):
        raise InputError([f"{folder}: the motor cannot do it: {b}; ask for a slower or smaller motion" for b in broken])
    motion = _actuation(law)
    protocol = {"name": name, "like": like.name, "duration": round(forcing.stop + AFTER, 3), "start": law.start}
    tables = {"actuation": motion, **(changes or {})}
    text = "\n\n".join([_lines(protocol), *(f"[{k}]\n{_lines(v)}" for k, v in tables.items())]) + "\n"
    t = np.arange(0.0, forcing.stop + TICK, TICK)
    table = io.StringIO()
    np.savetxt(
        table,
        np.column_stack([t, *forcing(t)]),
        fmt=["%.4f", "%.8f", "%.6f"],
        delimiter=",",
        comments="",
        header="time_s,position_m,speed_m_per_s",
        newline="\n",
    )
    files = {
        EXPERIMENT: _experiment(like, motion, why, changes or {}, table.getvalue()),
        PROTOCOL: "".join(f"# {w}\n" for w in why) + text,
        TABLE: table.getvalue(),
    }
    return _placed(folder, files)


def prepare_test(like: Experiment, kind: str, name: str, why: Sequence[str] = ()) -> Path:
    """The folder of one of TESTS beside a jump of its campaign: experiment.toml, protocol.toml. Raises InputError for a
    folder that exists."""
    sections, what = TESTS[kind]
    own = _declared(like)
    law = like.section(Actuation) if kind == "grain film" else None
    kept = {k: v for k, v in own.items() if k in ("robot", "bed", "model")}
    asked: Mapping[str, Toml] = sections
    plain = _plain(own)
    if kind == "ring-down":
        plain, kept = {**plain, "ground": "hard"}, {"robot": own["robot"]} if "robot" in own else {}
        kept["actuation"] = {"kind": "none"}
    if law is not None:
        kept["actuation"] = _actuation(law)
        asked = {**sections, **{k: v for k, v in own.items() if k in RECORDED}}
    text = _waiting(plain, kept, asked, [*why, what])
    protocol = "".join(f"# {w}\n" for w in [*why, what]) + _lines({"name": name, "experiment": kind}) + "\n"
    return _placed(like.path.parent / name, {EXPERIMENT: text, PROTOCOL: protocol})


def _placed(folder: Path, files: Mapping[str, str]) -> Path:
    """A folder put in place whole. Raises InputError where it exists."""
    if folder.exists():
        raise InputError([f"{folder}: exists already; remove it, or give the new experiment another name"])
    aside = folder.with_name(f".{folder.name}.part")
    shutil.rmtree(aside, ignore_errors=True)
    aside.mkdir()
    for name, text in files.items():
        (aside / name).write_text(text, encoding="utf-8", newline="\n")
    os.replace(aside, folder)
    return folder


def _actuation(law: Actuation) -> Mapping[str, str | float]:
    if law.kind == "custom":
        return {"kind": law.kind, "start": law.start}
    keys = ("kind", "frequency", "amplitude", "phase", "cycles", "delay", "start")
    return {k: v for k in keys if (v := getattr(law, k)) is not None and (k, v) != ("delay", 0.0)}


def _experiment(like: Experiment, motion: Toml, why: Sequence[str], changes: Changes, command: str) -> str:
    """experiment.toml: what the other experiment declares, this motion, the recordings under `LIVE`; a motion without a
    law has a motor log among them, a bed that is measured no declared packing. Trials of one command at one place are a
    group."""
    own = _declared(like)
    asked = {k: v for k, v in own.items() if k in RECORDED}
    if motion["kind"] == "custom":
        asked = {MotorLog.name: LOG} | asked
    if "bed_image" in asked:
        changes = {t: {k: v for k, v in x.items() if (t, k) != ("bed", "volume_fraction")} for t, x in changes.items()}
    own = merged(own, {t: x for t, x in changes.items() if x})
    kept = {k: v for k, v in own.items() if isinstance(v, Mapping) and "file" not in v and k != "actuation"}
    parts = [str(v) for v in motion.values()]
    parts += [hashlib.sha256(command.encode()).hexdigest()[:8]] if motion["kind"] == "custom" else []
    there = own.get("bed", {}).get("volume_fraction"), own.get("robot", {}).get("foot_radius")
    plain = {**_plain(own), "group": "-".join([*parts, like.ground, *(str(v) for v in there if v is not None)])}
    return _waiting(plain, kept | {"actuation": motion}, asked, why)


def _declared(like: Experiment) -> Toml:
    return tomllib.loads((like.path / EXPERIMENT).read_text(encoding="utf-8-sig"))


def _plain(own: Toml) -> Toml:
    """What stands before the sections, but for what is the experiment's alone."""
    return {k: v for k, v in own.items() if not isinstance(v, Mapping) and k not in ("name", "group", "exclude")}


def _waiting(plain: Toml, kept: Toml, asked: Mapping[str, Toml], why: Sequence[str]) -> str:
    """experiment.toml with the sections `kept`, those whose files are asked for under `LIVE`."""
    files = [v["file"] for v in asked.values()]
    head = ["# prepared by jumpvision explore: record, put the files here, run explore again", *(f"# {w}" for w in why)]
    top = _lines({**plain, "exclude": f"{WAITS} {', '.join(files)}"})
    parts = ["\n".join(head) + "\n" + top, *(_table(k, v) for k, v in kept.items())]
    live = "\n".join(_table(k, v) for k, v in asked.items())
    return "\n\n".join(parts) + "\n\n" + "\n".join(LIVE + x for x in live.splitlines()) + "\n"


def _table(name: str, values: Toml) -> str:
    inner = {k: v for k, v in values.items() if not isinstance(v, Mapping)}
    deeper = [_table(f"{name}.{k}", v) for k, v in values.items() if isinstance(v, Mapping)]
    return "\n".join([f"[{name}]", *([_lines(inner)] if inner else []), *deeper])


def _lines(values: Toml) -> str:
    return "\n".join(f"{k} = {json.dumps(v, ensure_ascii=False, default=str)}" for k, v in values.items())


def waiting(campaign: Path) -> list[Path]:
    """Prepared folders that are not yet part of the campaign, the first prepared first."""
    found = [f.parent for f in sorted(campaign.glob(f"*/{EXPERIMENT}")) if LIVE in f.read_text(encoding="utf-8-sig")]
    return [f for f in found if (f / PROTOCOL).exists()]


def take_in(folder: Path) -> Returned:
    """Makes a prepared folder part of its campaign, where its recordings are there and are those of its protocol.

    experiment.toml then has their sections, and no reason to exclude; else that reason says what is wrong.
    """
    file = folder / EXPERIMENT
    text = file.read_text(encoding="utf-8-sig")
    live = "\n".join(x.removeprefix(LIVE).strip() if x.startswith(LIVE) else x for x in text.splitlines()) + "\n"
    live = "\n".join(x for x in live.splitlines() if not x.startswith("exclude = ")) + "\n"
    try:
        tables = tomllib.loads(live)
    except tomllib.TOMLDecodeError as e:
        raise InputError(
            [f"{file}: not valid TOML once its recordings are in: {e}; correct it, or prepare it again"]
        ) from e
    files = [v["file"] for v in tables.values() if isinstance(v, Mapping) and "file" in v]
    if missing := tuple(f for f in files if not (folder / f).exists()):
        return Returned(folder, missing)
    differs = mismatch(folder, tables)
    if differs:
        reason = f"exclude = {json.dumps(f'not its protocol: {differs}', ensure_ascii=False)}"
        kept = "\n".join(reason if x.startswith("exclude = ") else x for x in text.splitlines()) + "\n"
        write_aside(file, kept)
        return Returned(folder, differs=differs)
    write_aside(file, live)
    return Returned(folder)


def mismatch(folder: Path, tables: Toml) -> str:
    """How the recordings differ from [actuation]; "" where they are those of it, or nothing moves."""
    if tables.get("actuation", {}).get("kind", "none") == "none":
        return ""
    law, problems = read(Actuation, tables["actuation"], f"{folder / EXPERIMENT}: [actuation]")
    if problems:
        raise InputError(problems)
    table = None if law.moves else played(folder / TABLE, 0.0)
    motion = table or commanded(law)
    for cls in (MotorLog, RodTrack):
        if cls.name not in tables:
            continue
        section, problems = read(cls, tables[cls.name], f"{folder / EXPERIMENT}: [{cls.name}]")
        if problems:
            raise InputError(problems)
        section = replace(section, path=folder / section.file)
        t, x = read_motor(section, law) if cls is MotorLog else _track(section)
        if t[0] > law.start or t[-1] < motion.stop:
            return (
                f"{section.path.name} goes from {t[0]:.3g} to {t[-1]:.3g} s, the motion from {law.start:.3g} to "
                f"{motion.stop:.3g} s; record all of it"
            )
        most = 0.1 * asked_of_motor(law, table)[0]  # a motor may leave its command by a tenth of the travel
        if cls is MotorLog and (off := np.abs(x - motion(t)[0])).max() > most:
            return (
                f"{section.path.name}: the motor was up to {1e3 * off.max():.2f} mm from its command (at "
                f"{t[np.argmax(off)]:.3f} s; at most {1e3 * most:.2f} mm is taken for it); record again, or give "
                "[actuation] as it was"
            )
    return ""


def _track(section: RodTrack) -> tuple[Array, Array]:
    d = read_log(section, "time_s", "height_m", at_least=8)
    return d.time_s.to_numpy(), d.height_m.to_numpy()


def returned(campaign: Path) -> list[Returned]:
    """Every prepared folder, taken into the campaign where its recordings are there and right."""
    return [take_in(f) for f in waiting(campaign)]
