"""What the motor's controller and the contact sensor log of a simulated jump."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .jumper import Motion

Array = NDArray[np.float64]

ENCODER_STEP = 6.25e-6  # m


def _ticks(motion: Motion, rate: float) -> Array:
    return np.arange(int(motion.t[-1] * rate + 1e-6) + 1) / rate


def motor_log(motion: Motion, *, rate: float, force_noise: float, rng: np.random.Generator) -> dict[str, Array]:
    """Columns time_s, position_m (X_m as the encoder counts it), force_N (with white noise [N]), at `rate` [1/s]."""
    t = _ticks(motion, rate)
    position = np.rint(motion.at("motor", t) / ENCODER_STEP) * ENCODER_STEP
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
) -> dict[str, Array]:
    """Columns time_s, height_m, sigma_m: the rod as a tracker reports it, at `rate` [1/s].

    noise: white, its standard deviation [m]; zero: height of the camera's origin [m]; scale: reported / true height
    (camera_scale); dt: a frame stamped t shows t + dt [s] (time_offset).
    """
    t = _ticks(motion, rate)
    height = scale * (motion.at("rod", t + dt) - zero) + rng.normal(0.0, noise, len(t))
    return {"time_s": t, "height_m": height, "sigma_m": np.full(len(t), noise)}
