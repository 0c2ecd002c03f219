"""What [record] asks for of one experiment: files, sections and truth; logs of motor and contact, track noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.lab.films.bed import bed_height, bed_picture, write_crater
from jumpvision.lab.films.discs import Runner, write_disc_film
from jumpvision.lab.films.grain_record import GRAIN_RATE, Glass, write_grain_film
from jumpvision.lab.films.grains import View
from jumpvision.lab.films.optics import record, seen_places
from jumpvision.lab.films.rod import write_rod_film

from . import recordings as logs
from . import write
from .intrusions import scaled, write_intrusion_log
from .jumper import Motion
from .protocol import Protocol
from .protocol_keys import Intrusion, RodTrack, chip_of

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
                folder,
                motion,
                density,
                rng,
                n=grains.frames,
                shape=(grains.rows, grains.columns),
                scale=grains.scale,
                quick=True,
                **cone,
                **given,
            )
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
            height,
            scale=picture.scale,
            floor_row=glass.wide.surface_row,
            shape=glass.wide.shape,
            grain_diameter=bed.grain_diameter,
            rng=rng,
        )
        write.picture(folder / "bed.png", record(glass(mean), rng=rng, **chip_of(camera)))
        row, _ = seen_places(np.array([floor]), glass.view.axis_column, glass.lens)
        sections["bed_image"] = {
            "file": "bed.png",
            "scale": picture.scale * (1 + camera.scale_error),
            "floor_row": round(float(row[0]), 3),
        }
        true["bed"] = {"height_m": height}
    if crater := protocol.records.get("crater_image"):
        section, true["crater"] = write_crater(
            folder,
            scaled(parameters, size)["crater_volume"],
            crater,
            rng,
            size=size,
            foot_radius=protocol.robot.foot_radius * size,
            grain_diameter=bed.grain_diameter,
        )
        sections |= section


ENCODER_STEP = 6.25e-6  # m


def _ticks(motion: Motion, rate: float) -> Array:
    return np.arange(int(motion.t[-1] * rate + 1e-6) + 1) / rate


def motor_log(
    motion: Motion, *, rate: float, force_noise: float, rng: np.random.Generator, step: float = ENCODER_STEP
) -> dict[str, Array]:
    """Columns time_s, position_m (X_m as the encoder counts it, in steps [m]; 0: exactly), force_N (with white noise
    [N]), at `rate` [1/s]."""
    t = _ticks(motion, rate)
    position = motion.at("motor", t)
    if step:
        position = np.rint(position / step) * step
    force = motion.at("motor_force", t) + rng.normal(0.0, force_noise, len(t))
    return {"time_s": t, "position_m": position, "force_N": force}


def contact_log(motion: Motion, *, rate: float) -> dict[str, Array]:
    """Columns time_s, contact (0/1) at `rate` [1/s]."""
    t = _ticks(motion, rate)
    return {"time_s": t, "contact": (motion.at("contact", t) > 0.5).astype(float)}


@dataclass(frozen=True)
class Seen:
    """A rod as a tracker reports it. columns: time_s, height_m and, where it is stated, sigma_m. error: its truth.

    sigma: standard deviation of this track [m], rounding included, wander and outliers not: what sigma_m states.
    """

    columns: dict[str, Array]
    error: Errors
    sigma: float


def seen_rod(
    motion: Motion, how: RodTrack, *, zero: float, rng: np.random.Generator, scale: float = 1.0, dt: float = 0.0
) -> Seen:
    """The rod's track and what is wrong with it.

    zero: height of the camera's origin [m]; scale: reported / true height (camera_scale); dt: a frame stamped t shows
    t + dt [s] (time_offset); scale and clock errors of `how` come on top.
    """
    t = _ticks(motion, how.rate)
    error = errors(t.size, how, rng)
    shown = t + dt + how.clock_offset + how.clock_drift * t
    height = scale * (1.0 + how.scale_error) * (motion.at("rod", shown) - zero) + error.jitter + error.wander
    if how.step:
        height = np.rint(height / how.step) * how.step
    sigma = math.sqrt(error.noise**2 + how.step**2 / 12)
    columns = {"time_s": t, "height_m": height} | ({"sigma_m": np.full(t.size, sigma)} if how.stated else {})
    return Seen(columns, error, sigma)


def rod_track(
    motion: Motion,
    *,
    rate: float,
    noise: float,
    zero: float,
    rng: np.random.Generator,
    scale: float = 1.0,
    dt: float = 0.0,
    **how: Any,
) -> dict[str, Array]:
    """Columns of `seen_rod`. how: the other keys of [record.rod_track]: rho, step, family, drift, ratio, stated, ..."""
    return seen_rod(motion, RodTrack(rate, noise, **how), zero=zero, rng=rng, scale=scale, dt=dt).columns


NU = 3.0  # degrees of freedom of the family "t3"; its variance is NU / (NU - 2) of its scale's square
SHARE, NEAR, FAR = 0.005, 8.0, 60.0  # outliers: their share of the frames, their size in standard deviations
WAVES = 3  # sines of a wander
PERIODS = 0.8, 4.0  # of a sine, in lengths of the record


@dataclass(frozen=True)
class Errors:
    """The errors of one track [m], before rounding; jitter, wander (n,): what to add to the heights.

    noise: standard deviation of this track's jitter, outliers aside [m]; outliers: the frames that hold one.
    """

    jitter: Array
    wander: Array
    noise: float
    outliers: NDArray[np.int64]


def errors(n: int, how: RodTrack, rng: np.random.Generator) -> Errors:
    """Errors of a track of n frames, as `how` has them."""
    noise = how.noise * factor(how.ratio, rng)
    jitter = noise * correlated(unit(n, how.family, rng), how.rho)
    outliers = np.flatnonzero(rng.random(n) < SHARE) if how.family == "outliers" else np.zeros(0, np.int64)
    if outliers.size:
        size = rng.uniform(NEAR, FAR, outliers.size) * rng.choice([-1.0, 1.0], outliers.size)
        jitter[outliers] = noise * size
    wander = how.drift * slow(n, rng) if how.drift else np.zeros(n)
    return Errors(jitter, wander, noise, outliers)


def factor(ratio: float, rng: np.random.Generator) -> float:
    """A track's own noise over the nominal one: log-uniform from 1/sqrt(ratio) to sqrt(ratio)."""
    if ratio <= 1.0:
        return 1.0
    return math.exp(rng.uniform(-0.5, 0.5) * math.log(ratio))


def unit(n: int, family: str, rng: np.random.Generator) -> Array:
    """(n,) independent numbers of unit variance: Gaussian, or Student's t with NU degrees of freedom."""
    if family == "t3":
        return rng.standard_t(NU, n) * math.sqrt((NU - 2.0) / NU)
    return rng.standard_normal(n)


def correlated(fresh: Array, rho: float) -> Array:
    """e[n] = rho e[n - 1] + sqrt(1 - rho^2) fresh[n]: the variance stays that of the fresh ones."""
    if not rho:
        return fresh
    fresh = np.concatenate([fresh[:1], fresh[1:] * math.sqrt(1 - rho * rho)])
    return np.fromiter(accumulate(fresh, lambda before, new: rho * before + new), float, fresh.size)


def slow(n: int, rng: np.random.Generator) -> Array:
    """(n,) a smooth wander over a record, no polynomial: WAVES sines, of mean 0 and root mean square 1 on it."""
    u = np.arange(n) / max(n - 1, 1)
    periods, phases = rng.uniform(*PERIODS, WAVES), rng.uniform(0.0, 2.0 * math.pi, WAVES)
    x = np.sin(2.0 * math.pi * u[:, None] / periods + phases).sum(axis=1)
    x -= x.mean()
    return np.asarray(x / math.sqrt(float(np.mean(x * x))))
