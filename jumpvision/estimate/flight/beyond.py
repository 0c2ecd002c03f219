"""What is beyond the edges of a flight: the spring, the foot that hangs from it, the motor that pulls at it.

On the ground the body follows x'' = -g - w^2 (x + lag x') from the spring's free length. A foot of mass m_f stays until
the spring pulls by m_f g: the body leaves later than the spring lets go, and from then on swings about the common
parabola with what it had; at the landing the foot stops and the body goes on with its swing. A motor that moves adds
the response to w^2 (o + lag o'), o = (m_m/M) X_m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import NDArray

from jumpvision.base.arrays import Array

KEPT = 16  # parts of edges that were just asked for


@dataclass(frozen=True)
class Ring:
    """What a hanging foot does to the body in flight: it swings at `frequency` [rad/s], decaying at `decay` [1/s].

    share: m_f/(M + m_f), of the foot in the whole mass; where it is known (> 0) the swing follows from the lift-off.
    """

    frequency: float
    decay: float
    share: float = 0.0

    @property
    def lag(self) -> float:
        """c/k [s] of the damper that makes it decay, beside the spring that makes it swing."""
        return 2.0 * self.decay / self.frequency**2

    def columns(self, t: Array) -> Array:
        """(n, 2), t [s] from the lift-off."""
        fallen = np.exp(-self.decay * np.clip(t, 0.0, None))
        return np.stack([fallen * np.cos(self.frequency * t), fallen * np.sin(self.frequency * t)], axis=1)


@njit(cache=True)
def _swing(u: float, w: float, gamma: float) -> tuple[float, float]:
    """(from a displacement of 1, from a speed of 1 m/s), u [s] after the start, of x'' = -w^2 x - 2 gamma x'."""
    wd = math.sqrt(max(w * w - gamma * gamma, 1e-6 * w * w))
    fall = math.exp(min(max(-gamma * u, -50.0), 50.0))
    sine = fall * math.sin(wd * u) / wd
    return fall * math.cos(wd * u) + gamma * sine, sine


@njit(cache=True)
def _held(u: float, edge: float, w: float, lag: float, stretch: Array, speed: Array, out: Array) -> None:
    """Writes what is added on the spring, u [s] from the edge, beside the parabola and the stretch (k,) that there is
    at the edge, as the body comes with this speed (k,), in the columns (k,) of `Beyond.added`."""
    cosine, sine = _swing(u, w, 0.5 * w * w * lag)
    for c in range(out.size):
        out[c] = sine * speed[c] + cosine * stretch[c]
    out[0] -= u
    out[1] += u * edge + 0.5 * u * u - (1.0 - cosine) / (w * w)


@njit(cache=True)
def swing(u: Array, w: float, gamma: float) -> Array:
    """`_swing` of times (n,), (n, 2)."""
    out = np.empty((u.size, 2))
    for i in range(u.size):
        out[i, 0], out[i, 1] = _swing(u[i], w, gamma)
    return out


@njit(cache=True)
def held(u: Array, edge: float, w: float, lag: float, stretch: Array, speed: Array) -> Array:
    """`_held` of times (n,), (n, k)."""
    out = np.empty((u.size, speed.size))
    for i in range(u.size):
        _held(u[i], edge, w, lag, stretch, speed, out[i])
    return out


@njit(cache=True)
def alone(tau: Array, sides: NDArray[np.int64], where: Array, w: Array, lag: float) -> Array:
    """`Beyond.added` (n, 3) with neither foot nor motor."""
    out, still, slope = np.zeros((tau.size, 3)), np.zeros(3), np.zeros(3)
    for k in range(sides.size):
        slope[0], slope[1] = 1.0, -where[k]
        for i in range(tau.size):
            if sides[k] * (tau[i] - where[k]) > 0.0:
                _held(tau[i] - where[k], where[k], w[k], lag, still, slope, out[i])
    return out


@dataclass(frozen=True)
class Drive:
    """o [m] of the motor at times t (n,) [s], increasing."""

    t: Array
    o: Array

    @cached_property
    def rate(self) -> Array:
        """Of o [m/s]."""
        return np.asarray(np.gradient(self.o, self.t))

    def near(self, t: Array, origin: float) -> Drive | None:
        """On a fine grid over the times t, from `origin` on; None where the motor rests."""
        if self.t.size < 3 or np.ptp(np.interp(t, self.t, self.o)) == 0.0:
            return None
        fine = np.linspace(t[0], t[-1], 2 * t.size + 1)
        inside = (self.t >= t[0] - (t[-1] - t[0])) & (self.t <= 2.0 * t[-1] - t[0])
        course = np.interp if inside.sum() < 4 else _smooth
        return Drive(fine - origin, course(fine, self.t[inside], self.o[inside]))

    def at(self, u: float) -> tuple[float, float]:
        """(o, its rate [m/s])."""
        return float(np.interp(u, self.t, self.o)), float(np.interp(u, self.t, self.rate))

    def response(self, u: Array, start: float, w: float, gamma: float, still: float) -> Array:
        """z (n,) [m] at times u of z'' = w^2 (o - still - z) + 2 gamma (o' - z'), from rest at `start`."""
        wd = math.sqrt(max(w * w - gamma * gamma, 1e-6 * w * w))
        pull = w * w * (self.o - still) + 2.0 * gamma * self.rate
        turn = np.exp((gamma - 1j * wd) * self.t) * pull
        upto = self._integral(turn, np.append(u, start))
        return np.asarray((np.exp((1j * wd - gamma) * u) * (upto[:-1] - upto[-1])).imag / wd)

    @cached_property
    def steps(self) -> Array:
        """Between its times [s]."""
        return np.diff(self.t)

    def _integral(self, y: Array, u: Array) -> Array:
        """Of y (n,) up to times u, straight between those of the grid: smooth where an edge passes them."""
        rise = y[1:] - y[:-1]
        total = np.zeros_like(y)
        np.cumsum(self.steps * (y[:-1] + 0.5 * rise), out=total[1:])
        k = np.minimum(np.maximum(self.t.searchsorted(u, side="right") - 1, 0), self.steps.size - 1)
        h = u - self.t[k]
        return np.asarray(total[k] + h * (y[k] + 0.5 * h * rise[k] / self.steps[k]))


def _smooth(x: Array, t: Array, y: Array) -> Array:
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(t, y)(x))


@dataclass(frozen=True)
class Beyond:
    """What is added to the parabola p + s tau - g tau^2 / 2 of a flight, tau (n,) [s], by what is at its edges.

    edges: of (-1, lift-off; +1, landing). first [s]: from when on a ring swings whose lift-off is not among them.
    """

    tau: Array
    edges: tuple[int, ...]
    lag: float
    ring: Ring | None
    drive: Drive | None
    first: float
    _known: dict[tuple[float, ...], tuple[NDArray[np.bool_], Array]] = field(default_factory=dict, compare=False)

    @cached_property
    def _sides(self) -> NDArray[np.int64]:
        return np.array(self.edges, np.int64)

    @property
    def tied(self) -> bool:
        """Whether the foot's swing follows from the lift-off."""
        return self.ring is not None and self.ring.share > 0.0 and -1 in self.edges

    @property
    def free(self) -> int:
        """Numbers of a swing that is fitted beside."""
        return 2 if self.ring is not None and not self.tied else 0

    def added(self, where: Array, w: Array) -> Array:
        """(n, 3 + free): for every m/s of s, for every m/s^2 of g, in any case, and for the numbers of the swing.
        where: the edges [s], w: the springs [rad/s]."""
        if self.ring is None and self.drive is None:
            return np.asarray(alone(self.tau, self._sides, where, w, self.lag))
        out = np.zeros((self.tau.size, 3 + self.free))
        if self.free and self.ring:
            out[:, 3:] = self.ring.columns(self.tau - self.first)
        start = 0.0
        for edge, side, stiff in zip(where, self.edges, w):
            if side < 0:
                start = edge
            key = side, edge, stiff, start
            if key not in self._known:  # slopes of a fit move one edge at a time
                if len(self._known) > KEPT:
                    self._known.clear()
                self._known[key] = self._at(*key)
            rows, those = self._known[key]
            out[rows] = those
        return out

    def _at(self, side: int, edge: float, stiff: float, start: float) -> tuple[NDArray[np.bool_], Array]:
        """What an edge makes of the flight and of what is beyond it: (its rows, (m, 3 + free)). start: the lift-off."""
        beyond = side * (self.tau - edge) > 0.0
        if side < 0:
            stretch, speed, still = self._lifted(edge)
        else:
            stretch, speed, still = self._landed(edge, start)
            speed = speed + self._slope(edge)
        u = self.tau[beyond] - edge
        there = held(u, edge, stiff, self.lag, stretch, speed) + (self._share() - 1.0) * stretch
        if self.drive is not None:
            there[:, 2] += self.drive.response(u + edge, edge, stiff, 0.5 * stiff * stiff * self.lag, still)
        if not (side < 0 and self.tied):
            return beyond, there
        out = np.empty((self.tau.size, 3 + self.free))
        out[beyond] = there
        out[~beyond] = self._swinging(self.tau[~beyond] - edge, edge, stretch, speed, still)
        return np.ones_like(beyond), out

    def pulled(self, edge: float, stiff: float) -> Array:
        """What is added in any case, (n,), by the motor at an only edge without ring and damper."""
        assert self.drive is not None
        out = np.zeros(self.tau.size)
        beyond = self.edges[0] * (self.tau - edge) > 0.0
        out[beyond] = self.drive.response(self.tau[beyond] - edge + edge, edge, stiff, 0.0, self.drive.at(edge)[0])
        return out

    def _share(self) -> float:
        """Of the foot; 1 where it is not known, so that its swing stretches no spring."""
        return self.ring.share or 1.0 if self.ring else 1.0

    def _slope(self, edge: float) -> Array:
        """The parabola's slope as (3 + free,) numbers."""
        out = np.zeros(3 + self.free)
        out[:2] = 1.0, -edge
        return out

    def _lifted(self, edge: float) -> tuple[Array, Array, float]:
        """(stretch of the spring, speed of the body, o) at the lift-off."""
        slope, still = self._slope(edge), 0.0
        stretch, rate = np.zeros_like(slope), 0.0
        if self.drive is not None:
            still, rate = self.drive.at(edge)
        if self.tied and self.ring:
            slope = slope / (1.0 - self.ring.share)
            stretch = -self.lag * slope
            stretch[1] += 1.0 / ((1.0 - self.ring.share) * self.ring.frequency**2)
            stretch[2] += self.lag * rate
        return stretch, slope, still

    def _swinging(self, u: Array, edge: float, stretch: Array, speed: Array, still: float) -> Array:
        """In flight, u [s] after the lift-off."""
        assert self.ring is not None
        cosine, sine = swing(u, self.ring.frequency, self.ring.decay).T
        out = cosine[:, None] * stretch + sine[:, None] * speed
        if self.drive is not None:
            out[:, 2] += self.drive.response(u + edge, edge, self.ring.frequency, self.ring.decay, still)
        return np.asarray(self.ring.share * out)

    def _landed(self, edge: float, start: float) -> tuple[Array, Array, float]:
        """(stretch, speed beside the parabola's, o) at the landing."""
        still = self.drive.at(start if self.tied else edge)[0] if self.drive is not None else 0.0
        if self.ring is None:
            return np.zeros(3), np.zeros(3), still
        step = 1e-3 / self.ring.frequency
        u = np.array([edge, edge + step])
        if self.tied:
            swung = self._swinging(u - start, start, *self._lifted(start)[:2], still)
        else:
            swung = np.zeros((2, 3 + self.free))
            swung[:, 3:] = self.ring.columns(u - self.first)
        return swung[0] / self._share(), (swung[1] - swung[0]) / step, still
