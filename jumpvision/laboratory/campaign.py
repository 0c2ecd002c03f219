"""A protocol carried out: experiment folders with their truth, each drawn from its own random stream."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path

import numpy as np

from jumpvision.base.progress import watch
from jumpvision.base.schema import InputError

from . import write
from .jumper import Law, Motion, Motor, Robot, Samples, motion_of
from .protocol import Jump, Protocol
from .recordings import recordings_of
from .write import Table, Value

TRUTH = "truth.json"


def write_campaign(out: Path, protocol: Protocol, *, seed: int, sealed: bool = False) -> None:
    """Write the protocol's experiments and campaign.toml into the new folder `out`; sealed: without any truth.json.

    The same seed gives the same bytes. Raises InputError where `out` exists.
    """
    if out.exists():
        raise InputError([f"{out}: exists; give another folder or remove it"])
    out.mkdir(parents=True)
    for number, jump in enumerate(watch(protocol.jumps, "experiments")):
        write_jump(out / jump.name, protocol, jump, np.random.default_rng([seed, number]), sealed=sealed)
    write.toml(out / "campaign.toml", declared(protocol))
    if not sealed:
        constant = {n: v for n, v in protocol.parameters.items() if not callable(v)}
        write.truth(out / TRUTH, {"terms": protocol.terms, "parameters": constant})


def jump_of(
    protocol: Protocol, jump: Jump, rng: np.random.Generator, *, dt: float = 2e-6, every: int = 50
) -> tuple[Motion, float, dict[str, float]]:
    """The motion of one jump with its volume fraction and its true parameters; dt, every as in `motion_of`."""
    phi, parameters = protocol.draw_truth(jump.volume_fraction, rng)
    motion = motion_of(
        protocol.robot,
        jump.law if jump.kind != "none" else None,
        protocol.terms,
        parameters,
        ground=protocol.ground,
        duration=protocol.duration,
        bed_density=phi * protocol.bed.grain_density,
        motor=protocol.motor if jump.kind != "none" else None,
        dt=dt,
        every=every,
    )
    return motion, phi, parameters


def write_jump(folder: Path, protocol: Protocol, jump: Jump, rng: np.random.Generator, *, sealed: bool = False) -> None:
    """One experiment folder; sealed: without truth.json."""
    folder.mkdir()
    motion, phi, parameters = jump_of(protocol, jump, rng)
    tables: dict[str, Table] = {"actuation": actuation(jump.kind, jump.law)}
    summary = {"jump_height_m": motion.jump_height, "n_jumps": motion.n_jumps}
    if protocol.ground == "granular":
        summary["volume_fraction"] = phi
        if protocol.records.bed_image is None:
            tables["bed"] = {"volume_fraction": round(phi, 6)}
    truth: dict[str, object] = {}
    for recording in recordings_of(folder, protocol, motion, phi, parameters, rng):
        tables |= recording.tables
        summary |= recording.summary
        truth |= recording.truth
    write.toml(folder / "experiment.toml", {"group": jump.group, **tables, **calibration(protocol)})
    if not sealed:
        heights = {"z_0_m": -motion.foot[0], "rest_rod_m": motion.rest, "jump_height_m": motion.jump_height}
        flights = {"lift_offs_s": motion.lift_offs, "flight_times_s": motion.flights}
        known = {"volume_fraction": phi, "parameters": parameters}
        write.truth(folder / TRUTH, {"summary": summary}, heights, flights, known, truth)


def calibration(protocol: Protocol) -> dict[str, Table]:
    """[calibration], where a camera whose recording there is declares its lens (all such have the same)."""
    records = protocol.records
    filmed = (records.rod_film, protocol.camera), (records.grain_film, protocol.grain_camera)
    for recorded, camera in (*filmed, (records.bed_image, protocol.bed_camera)):
        if recorded and camera.calibrated:
            return {"calibration": {"k1": camera.k1, "k2": camera.k2, "sensor": "whole"}}
    return {}


def declared(protocol: Protocol) -> Table:
    """campaign.toml: what the campaign declares; the model is the protocol's own, not its truth."""
    out: dict[str, Value] = {"ground": protocol.ground, "robot": numbers_of(protocol.robot)}
    if protocol.robot_sigma:
        out["robot.sigma"] = dict(protocol.robot_sigma)
    if protocol.motor:
        out["motor"] = numbers_of(protocol.motor)
    if protocol.ground == "granular":
        out["bed"] = asdict(protocol.bed)
    if model := protocol.model:
        out["model"] = {k: v for k, v in model.items() if k not in ("fit", "sigma")}
        out |= {f"model.{part}": model[part] for part in ("fit", "sigma") if model.get(part)}
    return out


def numbers_of(record: Robot | Motor) -> Table:
    """Its numbers, those that are no limits."""
    return {name: round(value, 9) for name, value in record._asdict().items() if math.isfinite(value)}


def actuation(kind: str, law: Law | Samples) -> Table:
    """[actuation] of a jump."""
    if isinstance(law, Samples) or kind == "none":
        return {"kind": kind, "start": law.start}
    out: Table = {"kind": kind, "frequency": law.frequency, "amplitude": law.amplitude, "phase": round(law.phase, 8)}
    out |= {"start": law.start, "cycles": law.cycles, "delay": law.delay, "dwell_gain": law.dwell_gain}
    return {k: v for k, v in out.items() if (k, v) not in (("cycles", 1.0), ("delay", 0.0), ("dwell_gain", 1.0))}
