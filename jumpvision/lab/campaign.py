"""A protocol carried out: experiment folders with their truth, in parallel, the same for a seed however many workers.

Each jump draws from its own random stream (seed, number of the jump), is written aside and put in place when whole, so
that an interrupted campaign is taken up where it stopped.
"""

from __future__ import annotations

import json
import multiprocessing
import shutil
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from jumpvision.base.progress import watch
from jumpvision.base.schema import InputError
from jumpvision.lab.films.discs import Runner
from jumpvision.lab.films.grain_record import film_brief

from . import write
from .jumper import Law, Motion, motion_of
from .protocol import Protocol, critical_fraction, read_parts
from .protocol_keys import FILMED_BY, Intrusion, Jump
from .recordings import of_intrusion, of_jump

PROTOCOL, TRUTH = "protocol.toml", "truth.json"
# truth of recordings that the campaign's truth.json leaves out
LONG = ("film", "track", "bed", "grain_film", "crater", "fits")


def write_campaign(file: Path, out: Path, *, seed: int, workers: int = 1, discs: Runner | None = None) -> int:
    """Carries out the protocol `file` below `out`; returns how many experiments were made now.

    `out` may hold the unfinished campaign of the same protocol and seed: what is missing is made. discs: simulates the
    grains of films with source = "discs" (`jumpvision.dem.under_foot.discs_under_foot`), a function of a module.
    Raises InputError for a bad protocol, or where `out` holds anything else.
    """
    parts = read_parts(file)
    for p in parts:
        if discs is None and getattr(p.records.get("grain_film"), "source", "") == "discs":
            raise InputError([f"{p.file}: [record.grain_film] source = 'discs': needs what simulates them (discs=...)"])
    text = f"# seed {seed}\n" + Path(file).read_text(encoding="utf-8-sig")
    for p in parts if len(parts) > 1 or parts[0].part else ():
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
    told = [hidden(p) for p in parts]
    named = told[0] if whole else {"parts": {p.part.removesuffix("-"): t for p, t in zip(parts, told)}}
    true = {
        e.name: json.loads((out / e.name / TRUTH).read_text(encoding="utf-8")) for p in parts for e in p.experiments
    }
    brief = {name: {k: v for k, v in t.items() if k not in LONG} for name, t in true.items()}
    write.truth(out / TRUTH, {**named, "experiments": brief})
    return len(work)


def hidden(protocol: Protocol) -> dict[str, Any]:
    """Terms and parameters of a protocol's truth."""
    out: dict[str, Any] = {"terms": protocol.terms, "parameters": protocol.parameters}
    phi_c = critical_fraction(protocol.parameters.get("crater_volume"))
    return out if phi_c is None else out | {"phi_c": phi_c}


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
    content: dict[str, Any] = defaults(protocol) if protocol.part else {}
    content["group"] = experiment.group
    if isinstance(experiment, Jump):
        motion, phi, parameters = jump_of(protocol, experiment, rng)
        content["actuation"] = actuation(experiment.kind, experiment.law)
        sections, seen = of_jump(aside, protocol, motion, phi, parameters, rng, discs)
        true = jump_truth(motion, seen)
    else:
        phi, parameters = protocol.truth(experiment.volume_fraction, rng)
        content["robot"] = content.get("robot", {}) | {"foot_radius": experiment.foot_radius}
        sections, seen = of_intrusion(aside, protocol, experiment, phi, parameters, rng)
        true = {"summary": {}, "foot_radius_m": experiment.foot_radius}
    if protocol.header.ground == "granular":
        true["summary"]["volume_fraction"] = phi
        if "bed_image" not in protocol.records:
            content["bed"] = content.get("bed", {}) | {"volume_fraction": round(phi, 6)}
    write.toml(aside / "experiment.toml", content | sections | calibration(protocol))
    if not sealed:
        write.truth(aside / TRUTH, {**true, "volume_fraction": phi, "parameters": parameters, **seen})
    aside.rename(out / experiment.name)


def jump_truth(motion: Motion, seen: dict[str, Any]) -> dict[str, Any]:
    """The true numbers of a jump; `summary`: those that summary.json should say."""
    summary: dict[str, Any] = {"jump_height_m": motion.jump_height, "n_jumps": motion.n_jumps}
    if isinstance(seen.get("grain_film"), dict):
        summary |= film_brief(seen["grain_film"])
    return {
        "summary": summary,
        "z_0_m": -motion.foot[0],
        "rest_rod_m": motion.rest,
        "jump_height_m": motion.jump_height,
        "lift_offs_s": motion.lift_offs,
        "flight_times_s": motion.flights,
    }


def calibration(protocol: Protocol) -> dict[str, Any]:
    """[calibration], where a camera whose recording there is declares its lens (all such have the same)."""
    for record, name in FILMED_BY.items():
        camera = protocol.cameras[name]
        if record in protocol.records and camera.calibrated:
            return {"calibration": {"k1": camera.k1, "k2": camera.k2}}
    return {}


def defaults(protocol: Protocol) -> dict[str, Any]:
    """campaign.toml: what the campaign declares; the model is the protocol's [model], not its truth."""
    tables = protocol.tables
    robot = _values(protocol.robot) if protocol.jumps else {"foot_radius": protocol.robot.foot_radius}
    out: dict[str, Any] = {"ground": protocol.header.ground, "robot": robot}
    if "robot.sigma" in tables:
        out["robot.sigma"] = tables["robot.sigma"]
    if protocol.motor:
        out["motor"] = {k: v for k, v in _values(protocol.motor).items() if v < 1e9}
    if protocol.header.ground == "granular":
        out["bed"] = {f: getattr(protocol.bed, f) for f in protocol.bed.__dataclass_fields__}
    if model := tables.get("model"):
        out["model"] = {k: v for k, v in model.items() if k not in ("fit", "sigma")}
        out |= {f"model.{part}": model[part] for part in ("fit", "sigma") if part in model}
    return out


def _values(record: Any) -> dict[str, float]:
    return {name: round(value, 9) for name, value in record._asdict().items()}


def actuation(kind: str, law: Law) -> dict[str, Any]:
    """[actuation] of a jump."""
    if kind == "none":
        return {"kind": kind, "start": law.start}
    out = {"kind": kind, "frequency": law.frequency, "amplitude": law.amplitude, "phase": round(law.phase, 8)}
    out |= {"start": law.start, "cycles": law.cycles, "delay": law.delay, "dwell_gain": law.dwell_gain}
    return {k: v for k, v in out.items() if (k, v) not in (("cycles", 1.0), ("delay", 0.0), ("dwell_gain", 1.0))}
