"""What drives the jumper: the motor position relative to the rod, X_m(t) [m], and its rate V = X_m' [m/s].

Two forms, both piecewise: sinusoidal `segments` (the commanded law; exact flows need it) and a cubic `spline` (a
measured encoder log). Before the first piece X_m = 0 and V = 0; after the last X_m stays at its final value and V = 0.
A law may start with a velocity step; the solvers turn it into the impulse of PHYSICS.md section 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Segments:
    """X_m = c + A sin(omega (t - t0) + phase) on t0 <= t < t1.

    rows: shape (n, 6), columns t0 [s], t1 [s], c [m], A [m], omega [rad/s], phase [rad]; contiguous and increasing.
    """

    rows: Array

    @property
    def start(self) -> float:
        return float(self.rows[0, 0])

    @property
    def stop(self) -> float:
        return float(self.rows[-1, 1])

    def __call__(self, t: ArrayLike) -> tuple[Array, Array]:
        """X_m [m] and V [m/s] at the times t [s], shape (n,); right-continuous at a velocity step."""
        t = np.atleast_1d(np.asarray(t, dtype=float))
        return _sample_segments(self.rows, t)


@dataclass(frozen=True)
class Spline:
    """Piecewise cubic X_m = sum c[j, i] (t - t_i)^(3-j), as in scipy.interpolate.PPoly.

    knots: (n+1,) [s] increasing. c: (4, n) [m/s^3, m/s^2, m/s, m].
    sigma: standard uncertainty of X_m [m].
    """

    knots: Array
    c: Array
    sigma: float = 0.0

    @property
    def start(self) -> float:
        return float(self.knots[0])

    @property
    def stop(self) -> float:
        return float(self.knots[-1])

    def __call__(self, t: ArrayLike) -> tuple[Array, Array]:
        """X_m [m] and V [m/s] at the times t [s], shape (n,)."""
        t = np.atleast_1d(np.asarray(t, dtype=float))
        return _sample_spline(self.knots, self.c, t)


Forcing = Segments | Spline


@nb.njit(cache=True)
def segment_xv(row: Array, t: float) -> tuple[float, float]:
    """X_m, V of one segment row at time t (not checked to lie inside)."""
    angle = row[4] * (t - row[0]) + row[5]
    return row[2] + row[3] * math.sin(angle), row[3] * row[4] * math.cos(angle)


@nb.njit(cache=True)
def segments_xv(rows: Array, t: float) -> tuple[float, float]:
    """X_m, V of the whole law at time t."""
    if t < rows[0, 0]:
        return 0.0, 0.0
    for i in range(rows.shape[0]):
        if t < rows[i, 1]:
            return segment_xv(rows[i], t)
    return segment_xv(rows[-1], rows[-1, 1])[0], 0.0


@nb.njit(cache=True)
def spline_xv(knots: Array, c: Array, t: float) -> tuple[float, float]:
    """X_m, V of a spline at time t."""
    n = c.shape[1]
    if t < knots[0]:
        return c[3, 0], 0.0
    if t >= knots[n]:
        h = knots[n] - knots[n - 1]
        return ((c[0, n - 1] * h + c[1, n - 1]) * h + c[2, n - 1]) * h + c[3, n - 1], 0.0
    i = min(np.searchsorted(knots, t, side="right") - 1, n - 1)
    h = t - knots[i]
    x = ((c[0, i] * h + c[1, i]) * h + c[2, i]) * h + c[3, i]
    return x, (3.0 * c[0, i] * h + 2.0 * c[1, i]) * h + c[2, i]


@nb.njit(cache=True)
def _sample_segments(rows: Array, t: Array) -> tuple[Array, Array]:
    x, v = np.empty(t.size), np.empty(t.size)
    for i in range(t.size):
        x[i], v[i] = segments_xv(rows, t[i])
    return x, v


@nb.njit(cache=True)
def _sample_spline(knots: Array, c: Array, t: Array) -> tuple[Array, Array]:
    x, v = np.empty(t.size), np.empty(t.size)
    for i in range(t.size):
        x[i], v[i] = spline_xv(knots, c, t[i])
    return x, v


def sinusoid(frequency: float, amplitude: float, phase: float, cycles: float = 1.0, start: float = 0.0) -> Segments:
    """X_m = A [sin(2 pi f (t - start) + phase) - sin(phase)] for `cycles` cycles, from rest (PHYSICS.md section 1)."""
    return Segments(
        np.array(
            [
                [
                    start,
                    start + cycles / frequency,
                    -amplitude * math.sin(phase),
                    amplitude,
                    2 * math.pi * frequency,
                    phase,
                ]
            ]
        )
    )


def delayed(frequency: float, amplitude: float, phase: float, delay: float, start: float = 0.0) -> Segments:
    """One cycle with a pause of `delay` seconds after its first half, X_m held there (delayed stutter jump)."""
    half = 0.5 / frequency
    offset, omega = -amplitude * math.sin(phase), 2 * math.pi * frequency
    pause, second = start + half, start + half + delay
    held = offset + amplitude * math.sin(phase + math.pi)
    return Segments(
        np.array(
            [
                [start, pause, offset, amplitude, omega, phase],
                [pause, second, held, 0.0, 0.0, 0.0],
                [second, second + half, offset, amplitude, omega, phase + math.pi],
            ]
        )
    )


def from_log(time: ArrayLike, position: ArrayLike, sigma: float) -> Spline:
    """A measured X_m log as a smoothing spline whose residual rms equals sigma [m], the log's standard uncertainty.

    time: (n,) [s], strictly increasing; position: (n,) [m]. For an encoder of step q, sigma = q/sqrt(12).
    """
    from scipy.interpolate import PPoly, UnivariateSpline

    t, x = np.asarray(time, float), np.asarray(position, float)
    s = UnivariateSpline(t, x, w=np.full(t.size, 1.0 / sigma), s=t.size, k=3)
    pp = PPoly.from_spline(s._eval_args)
    inside = np.flatnonzero(np.diff(pp.x) > 0)  # UnivariateSpline repeats the end knots
    return Spline(np.append(pp.x[inside], pp.x[inside[-1] + 1]), np.ascontiguousarray(pp.c[:, inside]), sigma)
