"""Actuator: how the encoder follows the command, and what the motor gives."""

from __future__ import annotations

import math

import numpy as np

from ..fit.actuator import follow
from ..fit.estimate import Estimate
from ..fit.power import motor_power
from ..logs import read_log
from ..sections import Actuation, MotorLog, need
from .motor import commanded, read_motor


def actuator_fits(log: MotorLog, law: Actuation) -> dict[str, Estimate]:
    """Ratio, lag and time constant at the forcing frequency; peak power, work, speed and force where force is logged.

    The power is the internal one, F_m X_m'. The encoder's noise is that at rest, at least its resolution / sqrt(12).
    """
    t, position = read_motor(log, law)
    frequency = need(law, "frequency")[0]
    if t[0] > law.start or t[-1] < law.stop:
        return {}  # not from rest to rest
    steps = np.abs(np.diff(position))
    step = float(steps[steps > 1e-12].min()) if (steps > 1e-12).any() else 0.0
    rest = position[t < law.start]
    noise = math.hypot(float(rest.std()) if rest.size > 2 else 0.0, step / math.sqrt(12.0))
    out = follow(t, commanded(law)(t)[0], position, frequency=frequency, noise=noise)
    logged = read_log(log.path, "time_s", "position_m", optional=("force_N",))
    if "force_N" in logged:
        out |= motor_power(t, position, logged.force_N.to_numpy(), position_noise=noise, period=1.0 / frequency,
                           begin=law.start, end=law.stop)  # fmt: skip
    return out
