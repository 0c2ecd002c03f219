"""Whether a rod follows its motor: the clocks of both, by the first push.

A motor of mass m_m that moves by X_m along a rod pushes it the other way: M y'' + c y' + k y = -m_m X_m'', with the
ground and the spring in k and c, which are fitted. In the Laplace plane y = -(m_m/M) s^2/(s^2 + (c/M) s + k/M) X_m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array

TICK = 5e-4  # s, of the motion that is filtered
# s = 2/TICK (z - 1)/(z + 1), its factor shared by both; `scipy.signal.bilinear`, which does this, takes half of a fit
UP, DOWN = np.array([1.0, 1.0]) / math.sqrt(2.0 / TICK), np.array([1.0, -1.0]) * math.sqrt(2.0 / TICK)
FARTHEST = 0.08  # s by which clocks are tried to differ
EXPLAINED = 0.1  # of the motion: a greater misfit, and it is not this motor that moves the rod


@nb.njit(cache=True)
def filtered(b: Array, a: Array, x: Array) -> Array:
    """As `scipy.signal.lfilter` of order 2, a[0] = 1: its import takes longer than all that is filtered here."""
    out, first, second = np.empty_like(x), 0.0, 0.0
    for i in range(x.size):
        out[i] = first + b[0] * x[i]
        first = second + b[1] * x[i] - a[1] * out[i]
        second = b[2] * x[i] - a[2] * out[i]
    return out


@dataclass(frozen=True)
class Push:
    """How a track follows its motor. shift [s]: what added to the motor's times fits best; misfit, best: rms [m] as the
    clocks are and at the best; size [m]: of the motion."""

    shift: float
    misfit: float
    best: float
    size: float

    @property
    def explained(self) -> bool:
        """Whether it is by this motor that the rod moves."""
        return self.best < EXPLAINED * self.size


@dataclass(frozen=True)
class Pushed:
    """A motor's X_m (m,) [m] at `time` [s], even to TICK, that moves share = m_m/M of the mass on a spring whose
    declared sqrt(k/M) is rate [rad/s]. period [s]: of its motion; slack [m]: height above rest where the spring
    is so."""

    time: Array
    x: Array
    share: float
    rate: float
    period: float
    slack: float

    def moved(self, w: float, damping: float) -> Array:
        """Height of the rod (m,) [m]."""
        b = self.share * np.convolve(DOWN, DOWN)
        a = w * w * np.convolve(UP, UP) + np.convolve(2.0 * damping * w * UP, DOWN) + np.convolve(DOWN, DOWN)
        return -filtered(b / a[0], a / a[0], self.x - self.x[0])

    def push(self, t: Array, h: Array) -> Push | None:
        """How a rod's height h (n,) [m] at t [s], from rest on, follows; None without a push or samples of it."""
        from scipy.optimize import least_squares

        near, before = first_push(t, h, self.period, self.slack)
        if (near & ~before).sum() < 5 or before.sum() < 3:
            return None
        ts, y = t[near], h[near] - np.median(h[before])
        shifts, tried = np.arange(-FARTHEST, FARTHEST + 1e-9, 1e-3), []
        for w in self.rate * np.array([0.3, 0.5, 0.7, 0.9, 1.1, 1.4, 2.0]):
            for damping in (0.02, 0.2, 0.6):
                z = self.moved(w, damping)
                off = np.sqrt(np.mean((y - np.interp(ts - shifts[:, None], self.time, z)) ** 2, axis=1))
                k = int(np.argmin(off))
                tried.append((float(off[k]), w, damping, float(shifts[k]), float(off[shifts.size // 2])))

        def residual(q: Array) -> Array:
            return np.asarray(y - np.interp(ts - q[2], self.time, self.moved(q[0], q[1])))

        low, high = [0.05 * self.rate, 0.0, -2.0 * FARTHEST], [4.0 * self.rate, 2.0, 2.0 * FARTHEST]
        fit = least_squares(residual, min(tried)[1:4], bounds=(low, high), x_scale=[self.rate, 1.0, 0.01])
        rms = math.sqrt(float(np.mean(fit.fun**2)))
        return Push(float(fit.x[2]), min(x[4] for x in tried), rms, float(np.ptp(y)))


def first_push(t: Array, h: Array, period: float, slack: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(samples (n,) of the rest and the first push, until the spring is slack; those of the rest) of a track h [m]."""
    begin = first_motion(t, h)
    up = np.flatnonzero((h - np.median(h[:5]) > 0.8 * slack) & (t > begin))
    near = (t > begin - 0.1) & (t < begin + 0.3 * period) & (t < (t[up[0]] if up.size else math.inf))
    return near, near & (t < begin - 0.02)


def first_motion(t: Array, h: Array) -> float:
    """When a track h (n,) [m] at t [s] leaves its first rest [s]: three samples on end, as one may be wrong."""
    away = np.abs(h - np.median(h[:5])) > 0.05 * np.ptp(h)
    begun = np.flatnonzero(away[:-2] & away[1:-1] & away[2:])
    return float(t[begun[0]] if begun.size else t[0])
