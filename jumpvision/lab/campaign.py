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

from jumpvision.progress import watch
from jumpvision.schema import InputError

from . import logs, write
from .bed_picture import bed_height, bed_picture
from .grain_record import film_brief, write_grain_film
from .jumper import Motion, simulate
from .mechanisms import Law
from .protocol import Jump, Protocol, read_protocol
from .rod_record import write_rod_film
from .sensor import record

PROTOCOL, TRUTH = "protocol.toml", "truth.json"
CONE = {"mu": 2.0, "theta": np.pi / 3, "C": 2.7}  # of the grain film, where the truth has no cone


def write_campaign(file: Path, out: Path, *, seed: int, workers: int = 1) -> int:
    """Carries out the protocol `file` below `out`; returns how many experiments were made now.

    `out` may hold the unfinished campaign of the same protocol and seed: what is missing is made. Raises InputError
    for a bad protocol, or where `out` holds anything else.
    """
    protocol = read_protocol(file)
    text = f"# seed {seed}\n" + Path(file).read_text(encoding="utf-8-sig")
    if out.exists():
        copy = out / PROTOCOL
        if not copy.exists() or copy.read_text(encoding="utf-8") != text:
            raise InputError([f"synth: {out} exists and is not this campaign; give another folder or remove it"])
        if (out / TRUTH).exists():
            raise InputError([f"synth: {out} is finished already; give another folder or remove it"])
    out.mkdir(parents=True, exist_ok=True)
    (out / PROTOCOL).write_text(text, encoding="utf-8", newline="\n")
    missing = [j for j in protocol.jumps if not (out / j.name).exists()]
    carry_out(protocol, missing, out, seed=seed, workers=workers)
    write.toml(out / "campaign.toml", defaults(protocol), comment=f"{protocol.header.name}; the truth is in {TRUTH}.")
    true = {j.name: json.loads((out / j.name / TRUTH).read_text(encoding="utf-8")) for j in protocol.jumps}
    hidden = {"terms": protocol.terms, "parameters": protocol.parameters}
    long = ("film", "bed", "grain_film")
    brief = {name: {k: v for k, v in t.items() if k not in long} for name, t in true.items()}
    write.truth(out / TRUTH, {**hidden, "experiments": brief})
    return len(missing)


def carry_out(
    protocol: Protocol, jumps: Iterable[Jump], out: Path, *, seed: int, workers: int, sealed: bool = False
) -> None:
    """The experiment folders of `jumps` below `out`; sealed: without their truth."""
    jumps = list(jumps)
    one = partial(write_experiment, protocol, out=out, seed=seed, sealed=sealed)
    if workers <= 1 or len(jumps) <= 1:
        for jump in watch(jumps, "experiments"):
            one(jump)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(workers, len(jumps)), mp_context=context, initializer=_worker) as pool:
        futures = [pool.submit(one, jump) for jump in jumps]
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
    """The motion of one jump with its volume fraction and its true parameters; dt, every as in `simulate`."""
    phi, parameters = protocol.truth(jump.volume_fraction, rng)
    motion = simulate(
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


def write_experiment(protocol: Protocol, jump: Jump, *, out: Path, seed: int, sealed: bool = False) -> None:
    """One experiment folder, written aside first; sealed: without truth.json."""
    rng = np.random.default_rng([seed, jump.number])
    motion, phi, parameters = jump_of(protocol, jump, rng)
    aside = out / f".{jump.name}.part"
    shutil.rmtree(aside, ignore_errors=True)
    aside.mkdir()
    content: dict[str, Any] = {"group": jump.group, "actuation": actuation(jump.kind, jump.law)}
    if protocol.header.ground == "granular" and "bed_image" not in protocol.records:
        content["bed"] = {"volume_fraction": round(phi, 6)}
    sections, seen = _recordings(aside, protocol, motion, phi, parameters, rng)
    write.toml(aside / "experiment.toml", content | sections)
    if sealed:
        aside.rename(out / jump.name)
        return
    summary = {"jump_height_m": motion.jump_height, "n_jumps": motion.n_jumps}
    if protocol.header.ground == "granular":
        summary["volume_fraction"] = phi
    if isinstance(seen.get("grain_film"), dict):
        summary |= film_brief(seen["grain_film"])
    true = {
        "volume_fraction": phi,
        "parameters": parameters,
        "z_0_m": -motion.foot[0],
        "rest_rod_m": motion.rest,
        "jump_height_m": motion.jump_height,
        "lift_offs_s": motion.lift_offs,
        "flight_times_s": motion.flights,
    }
    write.truth(aside / TRUTH, {"summary": summary, **true, **seen})
    aside.rename(out / jump.name)


def _recordings(
    folder: Path,
    protocol: Protocol,
    motion: Motion,
    phi: float,
    parameters: dict[str, float],
    rng: np.random.Generator,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """What [record] asks for: sections and truth."""
    sections: dict[str, Any] = {}
    true: dict[str, Any] = {}
    records, bed = protocol.records, protocol.bed
    at_camera = {"scale": parameters.get("scale", 1.0), "dt": parameters.get("dt", 0.0)}
    if track := records.get("rod_track"):
        true["camera_zero_m"] = rng.uniform(-0.05, 0.05)
        columns = logs.rod_track(
            motion, rate=track.rate, noise=track.noise, zero=true["camera_zero_m"], rng=rng,
            rho=track.rho, step=track.step, **at_camera,
        )  # fmt: skip
        write.table(folder / "rod_track.csv", columns)
        sections["rod_track"] = {"file": "rod_track.csv"}
    if film := records.get("rod_film"):
        more, true["film"] = write_rod_film(folder, motion, film, protocol.camera, rng, **at_camera)
        sections |= more
    if log := records.get("motor_log"):
        columns = logs.motor_log(motion, rate=log.rate, force_noise=log.force_noise, step=log.step, rng=rng)
        write.table(folder / "motor.csv", columns)
        sections["motor_log"] = {"file": "motor.csv"}
    if log := records.get("contact_log"):
        write.table(folder / "contact.csv", logs.contact_log(motion, rate=log.rate))
        sections["contact_log"] = {"file": "contact.csv"}
    if picture := records.get("bed_image"):
        height = bed_height(phi, solid_volume=bed.solid_volume, length=bed.length, width=bed.width)
        floor = float(round(height / picture.scale) + 66)
        mean, _ = bed_picture(
            height, scale=picture.scale, floor_row=floor, shape=(int(floor) + 36, 420),
            grain_diameter=bed.grain_diameter, rng=rng,
        )  # fmt: skip
        write.picture(folder / "bed.png", record(mean, electrons_per_grey=40.0, read_noise=1.5, rng=rng))
        sections["bed_image"] = {"file": "bed.png", "scale": picture.scale, "floor_row": floor}
        true["bed"] = {"height_m": height}
    if grains := records.get("grain_film"):
        length = grains.frames / 500 + 0.01
        if not len(motion.lift_offs) or motion.lift_offs[0] + motion.flights[0] > motion.t[-1] - length:
            true["grain_film"] = "none: no landing within the recording"
            return sections, true
        cone = {name: parameters.get(name, value) for name, value in CONE.items()}
        sections["grain_video"], depth, true["grain_film"] = write_grain_film(
            folder, motion, phi * bed.grain_density, rng, radius=protocol.robot.foot_radius,
            diameter=bed.grain_diameter, n=grains.frames, shape=(grains.rows, grains.columns), quick=True, **cone,
        )  # fmt: skip
        sections["params.flow"] = {"initial_depth": round(depth, 6)}
    return sections, true


def defaults(protocol: Protocol) -> dict[str, Any]:
    """campaign.toml: what the campaign declares; the model is the protocol's [model], not its truth."""
    tables = protocol.tables
    out: dict[str, Any] = {"ground": protocol.header.ground, "robot": _values(protocol.robot)}
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
