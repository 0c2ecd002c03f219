"""Laws that no other part of the code knows, and a robot on hard ground that obeys them: an integrator of its own.

State: q = x_r + (m_m / M) X_m and its rate (no second derivative of the command is needed); Runge-Kutta's fourth order
at DT. Forces act on the carriage, the spring, the contact or the rod; the last two laws are the camera's.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
DT = 2e-5  # s


class Law(NamedTuple):
    """weak, strong: of its amplitude, drawn log-uniformly; other: its second constant."""

    weak: float
    strong: float
    other: float
    words: str


LAWS = {
    "stribeck": Law(0.1, 0.6, 0.05, "-a exp(-|v_m| / b) sign(v_m) on the carriage [N; m/s]"),
    "cogging": Law(0.1, 0.6, 0.003, "a sin(2 pi x_m / b) on the carriage, along the rail [N; m]"),
    "softening": Law(0.01, 0.06, 0.0, "a spring that loses a share a of its stiffness a second [1/s]"),
    "adhesion": Law(0.2, 1.5, 0.0005, "the ground holds the foot: -a exp(x_r / b) in contact [N; m]"),
    "root_drag": Law(0.1, 0.6, 0.5, "-a |v_m|^b sign(v_m) on the carriage"),
    "cable": Law(3.0, 30.0, 0.008, "a cable that is taut above b: -a (x_r - b) [N/m; m]"),
    "perspective": Law(0.2, 2.0, 0.0, "the camera shows y (1 + a y) [1/m]"),
    "rolling_shutter": Law(0.01, 0.1, 0.0, "a frame shows the rod at t + a y [s/m]"),
}
NAMES = tuple(LAWS)


@njit(cache=True, error_model="numpy")
def _command(t: float, a: float, w: float, phase: float, stop: float) -> tuple[float, float]:
    if t <= 0.0:
        return 0.0, 0.0
    if t >= stop:
        return a * (math.sin(w * stop + phase) - math.sin(phase)), 0.0
    return a * (math.sin(w * t + phase) - math.sin(phase)), a * w * math.cos(w * t + phase)


@njit(cache=True, error_model="numpy")
def _rate(t: float, q: float, v: float, law: int, a: float, b: float, robot: Array, drive: Array) -> float:
    m_m, m, g, k, c = robot[0], robot[1], robot[2], robot[3], robot[4]
    x, rate = _command(t, drive[0], drive[1], drive[2], drive[3])
    x_r, v_r = q - m_m / m * x, v - m_m / m * rate
    x_m, v_m = x_r + x, v_r + rate
    force = 0.0
    if law == 2:
        k *= 1.0 - a * max(t, 0.0)
    if x_r <= 0.0:
        force = -k * x_r - c * v_r
        if law == 3:
            force -= a * math.exp(x_r / b)
    sign = math.tanh(v_m / 1e-3)
    if law == 0:
        force -= a * math.exp(-abs(v_m) / b) * sign
    elif law == 1:
        force += a * math.sin(2.0 * math.pi * x_m / b)
    elif law == 4:
        force -= a * abs(v_m) ** b * sign
    elif law == 5:
        force -= a * max(x_r - b, 0.0)
    return force / m - g


@njit(cache=True, error_model="numpy")
def rod(end: float, law: int, a: float, b: float, e: float, robot: Array, drive: Array) -> Array:
    """Height of the rod above rest (n,) [m] at steps of DT from the motor's start on; e: lost at touchdown."""
    n = int(end / DT) + 1
    out = np.empty(n)
    rest = -robot[1] * robot[2] / robot[3]
    share = robot[0] / robot[1]
    q, v = rest, 0.0
    flying = False
    for i in range(n):
        t = i * DT
        x, rate = _command(t, drive[0], drive[1], drive[2], drive[3])
        x_r = q - share * x
        out[i] = x_r - rest
        if flying and x_r <= 0.0:
            v_r = v - share * rate
            if v_r < 0.0:
                v += (math.sqrt(1.0 - e) - 1.0) * v_r
        flying = x_r > 0.0
        k1 = _rate(t, q, v, law, a, b, robot, drive)
        k2 = _rate(t + DT / 2, q + DT / 2 * v, v + DT / 2 * k1, law, a, b, robot, drive)
        k3 = _rate(t + DT / 2, q + DT / 2 * (v + DT / 2 * k1), v + DT / 2 * k2, law, a, b, robot, drive)
        k4 = _rate(t + DT, q + DT * (v + DT / 2 * k2), v + DT * k3, law, a, b, robot, drive)
        q += DT * v + DT * DT / 6.0 * (k1 + k2 + k3)
        v += DT / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return out


def seen(name: str, a: float, t: Array, law: Any, robot: Array, e: float) -> Array:
    """Height above rest (n,) [m] that the camera reports at t (n,) [s] of a jump driven by `law`, a sinusoid."""
    drive = np.array([law.amplitude, 2 * math.pi * law.frequency, law.phase, law.cycles / law.frequency])
    own = rod(float(t[-1] - law.start) + 0.1, NAMES.index(name), a, LAWS[name].other, e, robot, drive)
    after = np.arange(own.size) * DT

    def at(time: Array) -> Array:
        return np.interp(time - law.start, after, own, left=0.0)

    if name == "perspective":
        return at(t) * (1.0 + a * at(t))
    return at(t + a * at(t)) if name == "rolling_shutter" else at(t)
