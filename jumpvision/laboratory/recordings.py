"""What a protocol records of one jump; logs of motor and contact, noise of tracks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.laboratory.films.bed import bed_height, bed_picture
from jumpvision.laboratory.films.flow import Cone
from jumpvision.laboratory.films.grain_record import Glass, write_grain_film
from jumpvision.laboratory.films.grains import View
from jumpvision.laboratory.films.optics import BedCamera, exposed, seen_places
from jumpvision.laboratory.films.rod import write_rod_film

from . import write
from .jumper import Motion
from .protocol import Bed, Protocol, RodTrack
from .write import Recording, Table


@dataclass(frozen=True)
class TrackTruth:
    """What is true of rod_track.csv [m]: the standard deviation of its noise, with its rounding (sigma) and without,
    the frames that hold outliers, the slow wander of its frames."""

    sigma_m: float
    noise_m: float
    outliers: NDArray[np.int64]
    drift_m: Array | None = None


def recordings_of(
    folder: Path,
    protocol: Protocol,
    motion: Motion,
    phi: float,
    parameters: Mapping[str, float],
    rng: np.random.Generator,
) -> Iterator[Recording]:
    """Write what the protocol records of a jump into `folder`, one recording after the other."""
    records, bed = protocol.records, protocol.bed
    scale, dt = parameters.get("scale", 1.0), parameters.get("dt", 0.0)
    if track := records.rod_track:
        zero = rng.uniform(-0.05, 0.05)
        seen = seen_rod(motion, track, zero=zero, rng=rng, scale=scale, dt=dt)
        write.table(folder / "rod_track.csv", seen.columns)
        error = seen.error
        true = TrackTruth(seen.sigma, error.noise, error.outliers, error.wander if track.drift else None)
        yield Recording({"rod_track": {"file": "rod_track.csv"}}, {"camera_zero_m": zero, "track": true})
    if film := records.rod_film:
        yield write_rod_film(folder, motion, film, protocol.camera, rng, scale=scale, dt=dt)
    if log := records.motor_log:
        columns = motor_log(motion, rate=log.rate, force_noise=log.force_noise, step=log.step, rng=rng)
        write.table(folder / "motor.csv", columns)
        yield Recording({"motor_log": {"file": "motor.csv"}})
    if contact := records.contact_log:
        write.table(folder / "contact.csv", contact_log(motion, rate=contact.rate))
        yield Recording({"contact_log": {"file": "contact.csv"}})
    if picture := records.bed_image:
        yield write_bed_image(folder, bed, phi, picture.scale, protocol.bed_camera, rng)
    if grains := records.grain_film:
        length = grains.frames / grains.rate + 0.01
        if not len(motion.lift_offs) or motion.lift_offs[0] + motion.flights[0] > motion.t[-1] - length:
            yield Recording({}, {"grain_film": "none: no landing within the recording"})
            return
        yield write_grain_film(
            folder,
            motion,
            phi * bed.grain_density,
            rng,
            radius=protocol.robot.foot_radius,
            diameter=bed.grain_diameter,
            # where the truth has no cone, the film shows the samples'
            cone=Cone(**{name: parameters.get(name, value) for name, value in Cone()._asdict().items()}),
            film=grains,
            camera=protocol.grain_camera,
            quick=True,
        )


def write_bed_image(
    folder: Path, bed: Bed, phi: float, scale: float, camera: BedCamera, rng: np.random.Generator
) -> Recording:
    """Write bed.png of a bed of volume fraction phi; scale [m/px]."""
    height = bed_height(phi, solid_volume=bed.solid_volume, length=bed.length, width=bed.width)
    floor = float(round(height / scale) + 66)
    glass = Glass(View((int(floor) + 36, 420), scale, floor, 0.5 * 419), camera)
    mean, _ = bed_picture(
        height,
        scale=scale,
        floor_row=glass.wide.surface_row,
        shape=glass.wide.shape,
        grain_diameter=bed.grain_diameter,
        rng=rng,
    )
    write.picture(folder / "bed.png", exposed(glass(mean), camera, rng))
    row, _ = seen_places(np.array([floor]), glass.view.axis_column, glass.lens)
    section: Table = {
        "file": "bed.png",
        "scale": scale * (1 + camera.scale_error),
        "floor_row": round(float(row[0]), 3),
    }
    return Recording({"bed_image": section}, {"bed": {"height_m": height}})


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
    """Columns of `seen_rod`. how: the other fields of RodTrack: rho, step, family, drift, ratio, stated, ..."""
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
