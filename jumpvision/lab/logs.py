"""What the motor's controller and the contact sensor log of a simulated jump."""

from __future__ import annotations

import math
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from .jumper import Motion

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


def rod_track(
    motion: Motion,
    *,
    rate: float,
    noise: float,
    zero: float,
    rng: np.random.Generator,
    scale: float = 1.0,
    dt: float = 0.0,
    rho: float = 0.0,
    step: float = 0.0,
) -> dict[str, Array]:
    """Columns time_s, height_m, sigma_m: the rod as a tracker reports it, at `rate` [1/s].

    noise: its standard deviation [m]; rho: its correlation from one sample to the next (0: white), falling as rho^n;
    zero: height of the camera's origin [m]; scale: reported / true height (camera_scale); dt: a frame stamped t shows
    t + dt [s] (time_offset); step: heights are rounded to multiples of it [m], and sigma_m holds that too.
    """
    t = _ticks(motion, rate)
    error = rng.normal(0.0, noise, len(t))
    if rho:
        error[1:] *= math.sqrt(1 - rho * rho)
        error = np.fromiter(accumulate(error, lambda before, fresh: rho * before + fresh), float, len(t))
    height = scale * (motion.at("rod", t + dt) - zero) + error
    if step:
        height = np.rint(height / step) * step
    return {"time_s": t, "height_m": height, "sigma_m": np.full(len(t), math.sqrt(noise**2 + step**2 / 12))}
