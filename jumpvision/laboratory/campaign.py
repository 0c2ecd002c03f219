"""A protocol carried out: experiment folders with their truth, in parallel, the same for a seed however many workers.

Each jump draws from its own random stream (seed, number of the jump), is written aside and put in place when whole, so
that an interrupted campaign is taken up where it stopped.
"""

from __future__ import annotations

import json
import math
import multiprocessing
import re
import shutil
import tomllib
from collections.abc import Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.progress import watch
from jumpvision.base.schema import InputError
from jumpvision.laboratory.films.discs import Runner

from . import write
from .jumper import Law, Motion, Motor, Robot, Samples, motion_of
from .protocol import Points, Protocol, critical_fraction, protocol_of, read_parts
from .protocol_keys import FILMED_BY, Intrusion, Jump
from .recordings import of_intrusion, of_jump
from .write import Recording, Table

PROTOCOL, TRUTH = "protocol.toml", "truth.json"
# truth of recordings that the campaign's truth.json leaves out
LONG = ("film", "track", "bed", "grain_film", "crater", "fits")


def write_campaign(file: Path, out: Path, *, seed: int, workers: int = 1, discs: Runner | None = None) -> int:
    """Carries out the protocol `file` below `out`; returns how many experiments were made now.

    `out` may hold the unfinished campaign of the same protocol and seed: what is missing is made. discs: simulates the
    grains of films with source = "discs" (`jumpvision.laboratory.dem.motion.discs_under_foot`), a function of a module.
    Raises InputError for a bad protocol, or where `out` holds anything else.
    """
    parts = read_parts(file)
    for p in parts:
        if discs is None and p.records.grain_film and p.records.grain_film.source == "discs":
            raise InputError([f"{p.file}: [record.grain_film] source = 'discs': needs what simulates them (discs=...)"])
    text = f"# seed {seed}\n" + Path(file).read_text(encoding="utf-8-sig")
    for p in parts if parts[0].part else ():
        text += f"\n# {p.part}\n" + p.file.read_text(encoding="utf-8-sig")
    if out.exists():
        copy = out / PROTOCOL
        if not copy.exists() or copy.read_text(encoding="utf-8") != text:
            raise InputError([f"synth: {out} exists and is not this campaign; give another folder or remove it"])
        if (out / TRUTH).exists():
            raise InputError([f"synth: {out} is finished already; give another folder or remove it"])
    out.mkdir(parents=True, exist_ok=True)
    (out / PROTOCOL).write_text(text, encoding="utf-8", newline="\n")
    work = [(p, e) for p in parts for e in p.experiments if not (out / e.name).exists()]
    carry_out(work, out, seed=seed, workers=workers, discs=discs)
    whole = not parts[0].part
    comment = f"{parts[0].header.name if whole else file.stem}; the truth is in {TRUTH}."
    write.toml(out / "campaign.toml", defaults(parts[0]) if whole else {}, comment=comment)
    concealed = hidden(parts[0]) if whole else {"parts": {p.part.removesuffix("-"): hidden(p) for p in parts}}
    true = {
        e.name: json.loads((out / e.name / TRUTH).read_text(encoding="utf-8")) for p in parts for e in p.experiments
    }
    brief = {name: {k: v for k, v in t.items() if k not in LONG} for name, t in true.items()}
    write.truth(out / TRUTH, concealed, {"experiments": brief})
    return len(work)


def written(out: Path) -> list[Protocol]:
    """The protocols by which a campaign was written, of its copy; several of one in parts."""
    file = out / PROTOCOL
    rest = file.read_text(encoding="utf-8")
    named = re.search(r"^parts *= *\[([^]]*)\]", rest, re.MULTILINE)
    if named is None:
        return [protocol_of(tomllib.loads(rest), str(file))]
    stems = [Path(n).stem for n in re.findall(r"""["']([^"']+)["']""", named[1])]
    parts: list[Protocol] = []
    for stem, after in zip(stems, [*stems[1:], ""]):
        rest = rest.partition(f"\n# {stem}-\n")[2]
        own = rest.partition(f"\n# {after}-\n")[0] if after else rest
        first = sum(len(p.experiments) for p in parts)
        parts.append(protocol_of(tomllib.loads(own), f"{file}: {stem}", part=f"{stem}-", first=first))
    return parts


@dataclass(frozen=True)
class Hidden:
    """Terms and parameters of a protocol's truth; phi_c: where its craters have no volume, if there is such a place."""

    terms: tuple[str, ...]
    parameters: Mapping[str, float | Points]
    phi_c: float | None = None


def hidden(protocol: Protocol) -> Hidden:
    """What the protocol's recordings are to be questioned for."""
    phi_c = critical_fraction(protocol.parameters.get("crater_volume"))
    return Hidden(protocol.terms, protocol.parameters, phi_c)


def carry_out(
    work: Iterable[tuple[Protocol, Jump | Intrusion]],
    out: Path,
    *,
    seed: int,
    workers: int,
    sealed: bool = False,
    discs: Runner | None = None,
) -> None:
    """The folders of the experiments below `out`; sealed: without their truth."""
    work = list(work)
    one = partial(write_experiment, out=out, seed=seed, sealed=sealed, discs=discs)
    if workers <= 1 or len(work) <= 1:
        for protocol, experiment in watch(work, "experiments"):
            one(protocol, experiment)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(workers, len(work)), mp_context=context, initializer=_worker) as pool:
        futures = [pool.submit(one, protocol, experiment) for protocol, experiment in work]
        try:
            for future in watch(as_completed(futures), "experiments", len(futures)):
                future.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _worker() -> None:
    """One thread a worker: the processes are the parallel work."""
    import cv2

    cv2.setNumThreads(1)


def jump_of(
    protocol: Protocol, jump: Jump, rng: np.random.Generator, *, dt: float = 2e-6, every: int = 50
) -> tuple[Motion, float, dict[str, float]]:
    """The motion of one jump with its volume fraction and its true parameters; dt, every as in `motion_of`."""
    phi, parameters = protocol.truth(jump.volume_fraction, rng)
    motion = motion_of(
        protocol.robot,
        jump.law if jump.kind != "none" else None,
        protocol.terms,
        parameters,
        ground=protocol.header.ground,
        duration=protocol.header.duration,
        bed_density=phi * protocol.bed.grain_density,
        motor=protocol.motor if jump.kind != "none" else None,
        dt=dt,
        every=every,
    )
    return motion, phi, parameters


def write_experiment(
    protocol: Protocol,
    experiment: Jump | Intrusion,
    *,
    out: Path,
    seed: int,
    sealed: bool = False,
    discs: Runner | None = None,
) -> None:
    """One experiment folder, written aside first; sealed: without truth.json."""
    rng = np.random.default_rng([seed, experiment.number])
    aside = out / f".{experiment.name}.part"
    shutil.rmtree(aside, ignore_errors=True)
    aside.mkdir()
    keys: Table = {"ground": protocol.header.ground} if protocol.part else {}
    tables = declared(protocol) if protocol.part else {}
    keys["group"] = experiment.group
    true: JumpTruth | IntrusionTruth
    if isinstance(experiment, Jump):
        motion, phi, parameters = jump_of(protocol, experiment, rng)
        tables["actuation"] = actuation(experiment.kind, experiment.law)
        if protocol.preparation and experiment.pulses is not None:
            air = protocol.preparation.air_speed
            tables["preparation"] = {"pulses": experiment.pulses, "air_speed": air, "shaking": experiment.shaking}
        made = list(of_jump(aside, protocol, motion, phi, parameters, rng, discs))
        true = jump_truth(motion, made)
    else:
        phi, parameters = protocol.truth(experiment.volume_fraction, rng)
        tables.setdefault("robot", {})["foot_radius"] = experiment.foot_radius
        made = list(of_intrusion(aside, protocol, experiment, phi, parameters, rng))
        true = IntrusionTruth({}, experiment.foot_radius)
    if protocol.header.ground == "granular":
        true.summary["volume_fraction"] = phi
        if protocol.records.bed_image is None:
            tables.setdefault("bed", {})["volume_fraction"] = round(phi, 6)
    for recording in made:
        tables |= recording.tables
    write.toml(aside / "experiment.toml", {**keys, **tables, **calibration(protocol)})
    if not sealed:
        known = {"volume_fraction": phi, "parameters": parameters}
        write.truth(aside / TRUTH, true, known, *(recording.truth for recording in made))
    aside.rename(out / experiment.name)


@dataclass(frozen=True)
class JumpTruth:
    """The true numbers of a jump; `summary`: those that summary.json should say."""

    summary: dict[str, float]
    z_0_m: float
    rest_rod_m: float
    jump_height_m: float
    lift_offs_s: Array
    flight_times_s: Array


@dataclass(frozen=True)
class IntrusionTruth:
    """Likewise of a slow intrusion."""

    summary: dict[str, float]
    foot_radius_m: float


def jump_truth(motion: Motion, made: Iterable[Recording]) -> JumpTruth:
    """The true numbers of a jump, with what its recordings add to the summary."""
    summary = {"jump_height_m": motion.jump_height, "n_jumps": motion.n_jumps}
    for recording in made:
        summary |= recording.summary
    return JumpTruth(
        summary,
        z_0_m=-motion.foot[0],
        rest_rod_m=motion.rest,
        jump_height_m=motion.jump_height,
        lift_offs_s=motion.lift_offs,
        flight_times_s=motion.flights,
    )


def calibration(protocol: Protocol) -> dict[str, Table]:
    """[calibration], where a camera whose recording there is declares its lens (all such have the same)."""
    for record, name in FILMED_BY.items():
        camera = getattr(protocol.cameras, name)
        if getattr(protocol.records, record) and camera.calibrated:
            return {"calibration": {"k1": camera.k1, "k2": camera.k2, "sensor": "whole"}}
    return {}


def defaults(protocol: Protocol) -> Table:
    """campaign.toml: what the campaign declares; the model is the protocol's [model], not its truth."""
    return {"ground": protocol.header.ground, **declared(protocol)}


def declared(protocol: Protocol) -> dict[str, Table]:
    """The tables of `defaults`."""
    robot: Table = {"foot_radius": protocol.robot.foot_radius}
    out = {"robot": _values(protocol.robot) if protocol.jumps else robot}
    if protocol.robot_sigma:
        out["robot.sigma"] = dict(protocol.robot_sigma)
    if protocol.motor:
        out["motor"] = _values(protocol.motor, below=1e9)
    if protocol.header.ground == "granular":
        out["bed"] = asdict(protocol.bed)
    if model := protocol.model:
        out["model"] = {k: v for k, v in model.items() if k not in ("fit", "sigma")}
        out |= {f"model.{part}": cast(Table, model[part]) for part in ("fit", "sigma") if part in model}
    return out


def _values(record: Robot | Motor, below: float = math.inf) -> Table:
    """Its numbers, those that are no limits."""
    return {name: round(value, 9) for name, value in record._asdict().items() if value < below}


def actuation(kind: str, law: Law | Samples) -> Table:
    """[actuation] of a jump."""
    if isinstance(law, Samples) or kind == "none":
        return {"kind": kind, "start": law.start}
    out: Table = {"kind": kind, "frequency": law.frequency, "amplitude": law.amplitude, "phase": round(law.phase, 8)}
    out |= {"start": law.start, "cycles": law.cycles, "delay": law.delay, "dwell_gain": law.dwell_gain}
    return {k: v for k, v in out.items() if (k, v) not in (("cycles", 1.0), ("delay", 0.0), ("dwell_gain", 1.0))}
