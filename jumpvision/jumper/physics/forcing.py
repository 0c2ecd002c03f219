"""What drives the jumper: the motor position X_m(t) [m] as a law or a log, or a command that a loop's force follows."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any

import numba as nb
import numpy as np
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array


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


# x / 0 is inf, untested; no fastmath, for the reason in `base.compiling`
KERNEL: dict[str, Any] = {"cache": True, "error_model": "numpy"}
INLINE: dict[str, Any] = {**KERNEL, "forceinline": True}


@nb.njit(**INLINE)
def sincos(x: float) -> tuple[float, float]:
    """sin x and cos x to 1.2e-16, both for less than the price of a library's sine."""
    return sincos_near(x) if abs(x) < NEAR else (math.sin(x), math.cos(x))


NEAR = 1e6  # rad


@nb.njit(**INLINE)
def sincos_near(x: float) -> tuple[float, float]:
    """sin x and cos x for |x| < NEAR, without a branch, so that a loop may take several x at once.

    x less the nearest multiple of pi/2 (in two parts, Cody and Waite: exact for 2^20 of them), then the minimax
    polynomials of fdlibm's k_sin.c and k_cos.c, pair by pair: a third of the time less than term by term.
    """
    n = np.floor(x * 0.6366197723675814 + 0.5)
    r = (x - n * 1.5707963267341256) - n * 6.077100506506192e-11
    z = r * r
    w = z * z
    s = (-1.66666666666666324348e-01 + z * 8.33333333332248946124e-03) + w * (
        (-1.98412698298579493134e-04 + z * 2.75573137070700676789e-06)
        + w * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
    )
    s = r + r * z * s
    c = (4.16666666666666019037e-02 + z * -1.38888888888741095749e-03) + w * (
        (2.48015872894767294178e-05 + z * -2.75573143513906633035e-07)
        + w * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)
    )
    c = 1.0 - (0.5 * z - w * c)
    turn = np.int32(n) & 3
    if turn & 1:
        s, c = c, s
    return (-s if turn & 2 else s), (-c if (turn + 1) & 2 else c)


@nb.njit(**INLINE)
def segment_xv(row: Array, t: float) -> tuple[float, float]:
    """X_m, V of one segment row at time t (not checked to lie inside)."""
    sin, cos = sincos(row[4] * (t - row[0]) + row[5])
    return row[2] + row[3] * sin, row[3] * row[4] * cos


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
    """X_m = A [sin(2 pi f (t - start) + phase) - sin(phase)] for `cycles` cycles from rest (docs/physics.md, 1)."""
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


def from_motion(time: ArrayLike, position: ArrayLike, sigma: float) -> Spline:
    """`from_log` of a log from its last reading at rest before the motor first moves; it stands still until then.

    The ripples of a spline, of some sigma, would push a foot at rest on sand, which yields to any push, and leave it
    there as after a pause.
    """
    t, x = np.asarray(time, float), np.asarray(position, float)
    begin = min(first_motion(x, sigma), t.size - 4)  # a cubic needs four
    return from_log(t[begin:], x[begin:], sigma)


def first_motion(position: Array, sigma: float) -> int:
    """The last reading at rest before a motor first moves. position (n,) [m] with its standard uncertainty sigma."""
    away = np.abs(position - position[0])
    # 5 sigma from the first reading it has moved, by 2 not yet (an encoder of step q: 1.4, 0.6 q)
    still = np.flatnonzero(away[: int(np.argmax(away > 5.0 * sigma))] <= 2.0 * sigma)
    return int(still[-1]) if still.size else 0


RATE = 1000.0  # 1/s: samples of a command that a controller plays, straight lines between them


def as_played(command: Forcing) -> Spline:
    """A command as a controller plays its samples (`RATE`), to its end."""
    t = np.arange(math.ceil(command.stop * RATE) + 1) / RATE
    x, none = command(t)[0], np.zeros(t.size - 1)
    return Spline(t, np.array([none, none, np.diff(x) * RATE, x[:-1]]))


@dataclass(frozen=True)
class Loop:
    """F_m = kp G (X_c - X_m) + kd (X_c' - X_m') + m_m g, within +-max_force [N].

    X_c is the command, X_m the encoder's reading (motor relative to the rod): the loop sees nothing of rod or ground.
    The feed-forward m_m g carries the motor's weight, so that the robot rests without a sag at X_m = X_c. G is
    dwell_gain while the command pauses between two motions, else 1; kd is not lowered. Motor and rod move as
    m_m (a_r + X_m'') = -m_m g + F_m and m_r a_r = -m_r g - F_m + F_s. A velocity step of the command is a step of the
    force here, not an impulse. At +-max_speed [m/s] the motor X_m' keeps its speed, and at an end of its travel of
    `stroke` [m] it is stopped without rebound, as long as the loop presses it on; both act between motor and rod. The
    ends lie evenly about the range of the command, the position at rest between them.
    """

    command: Segments | Spline
    kp: float  # N/m
    kd: float  # N s/m
    max_force: float = math.inf  # N
    dwell_gain: float = 1.0
    max_speed: float = math.inf  # m/s
    stroke: float = math.inf  # m

    def __post_init__(self) -> None:
        if not (0 < self.kp < math.inf and 0 <= self.kd < math.inf):
            raise ValueError(f"Loop kp = {self.kp!r}, kd = {self.kd!r}: need kp > 0 N/m and kd >= 0 N s/m, finite")
        if not (self.max_force > 0 and 0 <= self.dwell_gain <= 1):
            raise ValueError(
                f"Loop max_force = {self.max_force!r}, dwell_gain = {self.dwell_gain!r}: need max_force > 0 N and "
                "0 <= dwell_gain <= 1"
            )
        if not (self.max_speed > 0 and self.stroke > 0):
            raise ValueError(f"Loop max_speed = {self.max_speed!r}, stroke = {self.stroke!r}: both must be > 0")

    @property
    def start(self) -> float:
        return self.command.start

    @property
    def stop(self) -> float:
        return self.command.stop

    @functools.cached_property
    def ends(self) -> tuple[float, float]:
        """Ends of the travel of X_m [m]."""
        if math.isinf(self.stroke):
            return -math.inf, math.inf
        # times at which the range of a command is looked for
        x = self.command(np.linspace(self.start, self.stop, 20001))[0]
        rest = float(self.command(self.start - 1.0)[0][0])
        low = min(max(0.5 * float(x.min() + x.max() - self.stroke), rest - self.stroke), rest)
        return low, low + self.stroke

    def __call__(self, t: ArrayLike) -> tuple[Array, Array]:
        """X_c [m] and X_c' [m/s] at the times t [s], shape (n,)."""
        return self.command(t)

    def gains(self, rows: Array) -> Array:
        """G of the pieces (n, 6) of a sinusoidal command that ends at rest: dwell_gain where it pauses."""
        out = np.ones(len(rows))
        moves = np.flatnonzero(rows[:, 3] != 0.0)
        if isinstance(self.command, Segments) and moves.size:
            between = np.arange(moves[0], moves[-1])
            out[between[rows[between, 3] == 0.0]] = self.dwell_gain
        return out
