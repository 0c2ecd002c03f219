"""What the motor's controller and the contact sensor log of a simulated jump."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .jumper import Motion
from .protocol_keys import RodTrack
from .track_noise import Errors, errors

Array = NDArray[np.float64]

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
