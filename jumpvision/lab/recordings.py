"""What [record] asks for of one experiment: files, their sections of experiment.toml, and their truth."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from . import logs, write
from .bed_picture import bed_height, bed_picture
from .crater_record import write_crater
from .disc_record import Runner, write_disc_film
from .grain_film import View
from .grain_record import GRAIN_RATE, Glass, write_grain_film
from .intrusion_record import scaled, write_intrusion_log
from .jumper import Motion
from .lens import seen_places
from .protocol import Protocol
from .protocol_keys import chip_of
from .protocol_sweeps import Intrusion
from .rod_record import write_rod_film
from .sensor import record

CONE = {"mu": 2.0, "theta": np.pi / 3, "C": 2.7}  # of the grain film, where the truth has no cone
Both = tuple[dict[str, Any], dict[str, Any]]


def of_jump(
    folder: Path,
    protocol: Protocol,
    motion: Motion,
    phi: float,
    parameters: dict[str, float],
    rng: np.random.Generator,
    discs: Runner | None,
) -> Both:
    """Sections and truth of a jump; discs: what simulates the grains of a film with source = "discs"."""
    sections: dict[str, Any] = {}
    true: dict[str, Any] = {}
    records = protocol.records
    at_camera = {"scale": parameters.get("scale", 1.0), "dt": parameters.get("dt", 0.0)}
    if track := records.get("rod_track"):
        true["camera_zero_m"] = rng.uniform(-0.05, 0.05)
        seen = logs.seen_rod(motion, track, zero=true["camera_zero_m"], rng=rng, **at_camera)
        true["track"] = {"sigma_m": seen.sigma, "noise_m": seen.error.noise, "outliers": seen.error.outliers}
        if track.drift:
            true["track"]["drift_m"] = seen.error.wander
        write.table(folder / "rod_track.csv", seen.columns)
        sections["rod_track"] = {"file": "rod_track.csv"}
    if film := records.get("rod_film"):
        more, true["film"] = write_rod_film(folder, motion, film, protocol.cameras["camera"], rng, **at_camera)
        sections |= more
    if log := records.get("motor_log"):
        columns = logs.motor_log(motion, rate=log.rate, force_noise=log.force_noise, step=log.step, rng=rng)
        write.table(folder / "motor.csv", columns)
        sections["motor_log"] = {"file": "motor.csv"}
    if log := records.get("contact_log"):
        write.table(folder / "contact.csv", logs.contact_log(motion, rate=log.rate))
        sections["contact_log"] = {"file": "contact.csv"}
    of_bed(folder, protocol, phi, parameters, rng, sections, true)
    if grains := records.get("grain_film"):
        length = grains.frames / GRAIN_RATE + 0.01
        if not len(motion.lift_offs) or motion.lift_offs[0] + motion.flights[0] > motion.t[-1] - length:
            true["grain_film"] = "none: no landing within the recording"
            return sections, true
        density, camera = phi * protocol.bed.grain_density, protocol.cameras["grain_camera"]
        given: dict[str, Any] = {
            "radius": protocol.robot.foot_radius,
            "diameter": protocol.bed.grain_diameter,
            "camera": camera,
        }
        if grains.source == "discs":
            if discs is None:
                raise ValueError("source = 'discs': needs what simulates them (discs=...)")
            made = write_disc_film(folder, motion, density, rng, discs, film=grains, **given)
        else:
            cone: dict[str, Any] = {name: parameters.get(name, value) for name, value in CONE.items()}
            made = write_grain_film(
                folder, motion, density, rng, n=grains.frames, shape=(grains.rows, grains.columns), scale=grains.scale,
                quick=True, **cone, **given,
            )  # fmt: skip
        sections["grain_video"], depth, true["grain_film"] = made
        sections["params.flow"] = {"initial_depth": round(depth, 6)}
    return sections, true


def of_intrusion(
    folder: Path,
    protocol: Protocol,
    intrusion: Intrusion,
    phi: float,
    parameters: Mapping[str, float],
    rng: np.random.Generator,
) -> Both:
    """Sections and truth of a slow intrusion; parameters: at the robot's own foot."""
    sections: dict[str, Any] = {}
    true: dict[str, Any] = {}
    size = intrusion.foot_radius / protocol.robot.foot_radius
    if log := protocol.records.get("intrusion_log"):
        sections, true = write_intrusion_log(
            folder, intrusion.moves, log, protocol.terms, scaled(parameters, size), rng, robot=protocol.robot, size=size
        )
    of_bed(folder, protocol, phi, parameters, rng, sections, true, size=size)
    return sections, true


def of_bed(
    folder: Path,
    protocol: Protocol,
    phi: float,
    parameters: Mapping[str, float],
    rng: np.random.Generator,
    sections: dict[str, Any],
    true: dict[str, Any],
    *,
    size: float = 1.0,
) -> None:
    """What is recorded of any bed, added to the sections and the truth; size: foot / the robot's."""
    bed = protocol.bed
    if picture := protocol.records.get("bed_image"):
        camera = protocol.cameras["bed_camera"]
        height = bed_height(phi, solid_volume=bed.solid_volume, length=bed.length, width=bed.width)
        floor = float(round(height / picture.scale) + 66)
        glass = Glass(View((int(floor) + 36, 420), picture.scale, floor, 0.5 * 419), camera)
        mean, _ = bed_picture(
            height, scale=picture.scale, floor_row=glass.wide.surface_row, shape=glass.wide.shape,
            grain_diameter=bed.grain_diameter, rng=rng,
        )  # fmt: skip
        write.picture(folder / "bed.png", record(glass(mean), rng=rng, **chip_of(camera)))
        row, _ = seen_places(np.array([floor]), glass.view.axis_column, glass.lens)
        sections["bed_image"] = {"file": "bed.png", "scale": picture.scale * (1 + camera.scale_error),
                                 "floor_row": round(float(row[0]), 3)}  # fmt: skip
        true["bed"] = {"height_m": height}
    if crater := protocol.records.get("crater_image"):
        section, true["crater"] = write_crater(
            folder, scaled(parameters, size)["crater_volume"], crater, rng, size=size,
            foot_radius=protocol.robot.foot_radius * size, grain_diameter=bed.grain_diameter,
        )  # fmt: skip
        sections |= section
