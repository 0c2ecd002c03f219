"""Free oscillation with three dampings at once, integrated in time: what the decay laws are told apart with."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
PHASE_STEP = 0.12  # rad of the oscillation a Runge-Kutta step may cover


@njit(cache=True)
def _acceleration(y: float, v: float, w2: float, kappa: float, gamma: float, beta: float, dry: float) -> float:
    return -w2 * (y + kappa * y * y * y) - 2.0 * gamma * v - beta * abs(v) * v - dry


@njit(cache=True)
def _step(
    y: float, v: float, h: float, w2: float, kappa: float, gamma: float, beta: float, dry: float
) -> tuple[float, float]:
    a1 = _acceleration(y, v, w2, kappa, gamma, beta, dry)
    v2 = v + 0.5 * h * a1
    a2 = _acceleration(y + 0.5 * h * v, v2, w2, kappa, gamma, beta, dry)
    v3 = v + 0.5 * h * a2
    a3 = _acceleration(y + 0.5 * h * v2, v3, w2, kappa, gamma, beta, dry)
    v4 = v + h * a3
    a4 = _acceleration(y + h * v3, v4, w2, kappa, gamma, beta, dry)
    return y + h * (v + 2.0 * v2 + 2.0 * v3 + v4) / 6.0, v + h * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0


@njit(cache=True)
def swing(t: Array, y: float, v: float, w: float, kappa: float, gamma: float, beta: float, dry: float) -> Array:
    """y at the times t (n,) [s] of y'' = -w^2 (y + kappa y^3) - 2 gamma y' - beta |y'| y' - dry sign(y').

    y, v are those at t[0].
    Coulomb friction holds the body where the spring is weaker than it; steps end where the velocity passes zero.
    """
    out = np.empty(t.size)
    out[0] = y
    w2, stuck = w * w, False
    for i in range(1, t.size):
        left = t[i] - t[i - 1]
        count = max(1, math.ceil(left * w / PHASE_STEP))
        full = left / count
        while left > 1e-14 and not stuck:
            h = min(full, left)
            side = 1.0 if v > 0.0 else -1.0
            if v == 0.0:
                pull = -w2 * (y + kappa * y * y * y)
                if abs(pull) <= dry:
                    stuck = True
                    break
                side = 1.0 if pull > 0.0 else -1.0
            y1, v1 = _step(y, v, h, w2, kappa, gamma, beta, dry * side)
            if dry > 0.0 and v1 * side < 0.0:  # turned within the step: end it at the turning point
                low, high = 0.0, h
                for _ in range(30):
                    h = 0.5 * (low + high)
                    y1, v1 = _step(y, v, h, w2, kappa, gamma, beta, dry * side)
                    if v1 * side < 0.0:
                        high = h
                    else:
                        low = h
                v1 = 0.0
            left -= h
            y, v = y1, v1
        out[i] = y
    return out
