"""What the motor did: its commanded law and its encoder log, on the common clock."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..logs import read_log
from ..physics.forcing import Forcing, delayed, sinusoid
from ..sections import Actuation, MotorLog, need

Array = NDArray[np.float64]


def commanded(law: Actuation) -> Forcing:
    """The law of [actuation]."""
    frequency, amplitude = need(law, "frequency", "amplitude")
    if law.delay:
        return delayed(frequency, amplitude, law.start_phase, law.delay, law.start)
    return sinusoid(frequency, amplitude, law.start_phase, law.cycles, law.start)


def read_motor(log: MotorLog, law: Actuation | None) -> tuple[Array, Array]:
    """time [s] and X_m [m] of the encoder, zero at rest before the motor starts."""
    d = read_log(log.path, "time_s", "position_m", at_least=8)
    time, position = d.time_s.to_numpy(), d.position_m.to_numpy()
    before = time < law.start if law else np.arange(time.size) < 5
    return time, position - (np.median(position[before]) if before.any() else position[0])


def position_at(t: Array, law: Actuation | None, log: MotorLog | None) -> Array | None:
    """X_m [m] at the times t (n,) [s], from the log where there is one, else from the law; None without both."""
    if log is not None:
        return np.interp(t, *read_motor(log, law))
    if law is not None and law.kind == "none":
        return np.zeros_like(t)
    if law is not None and law.moves:
        return commanded(law)(t)[0]
    return None
