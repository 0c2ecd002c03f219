"""A body in one dimension as a system that can be questioned: a falling ball, a swinging pendulum.

    x'' = -g - W sin(x) - c v - q |v| v - f u

g: gravity [unit of x / s^2]; W: stiffness (g over the reduced length) [1/s^2]; c: viscous, q: quadratic drag; f: dry
friction, u = sign(v), set-valued at rest; with presliding (Dahl 1968) u relaxes to sign(v) over the distance delta
after a reversal. A record shows y = scale x + level; a clock's offset is a part of the start.

Where a body starts differs from record to record and is no part of the model: speed, level and (where a force depends
on x) position at the start are fitted to each record for every prediction, held-out ones included.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from jumpvision.base.arrays import Array
from jumpvision.engine.noise.noise import Noise, Stretch, powers, whiten
from jumpvision.engine.system import Candidate, Observation, Parameter
from jumpvision.estimate.decay import resistance

LAW = ("gravity", "stiffness", "viscous", "quadratic", "coulomb", "presliding")
SENSOR = {"scale": 1.0}  # value at which each does nothing
MOST_STEPS = 100_000  # between two frames, reversals counted
LONGEST = 2e-3  # s, of a step of a body with a restoring force
WANDER = 1e-4  # step of a derivative by what wanders


@njit(cache=True, error_model="numpy")
def acceleration(x: float, v: float, s: float, x_turn: float, u_turn: float, p: Array) -> float:
    """x'' with the sign of motion s since the last reversal at x_turn, where dry friction was u_turn of its limit."""
    u = s
    if p[5] > 0.0:
        u = s + (u_turn - s) * math.exp(-abs(x - x_turn) / p[5])
    return -p[0] - p[1] * math.sin(x) - resistance(v, u, p[2], p[3], p[4])


@njit(cache=True, error_model="numpy")
def path(x: float, v: float, times: Array, p: Array, longest: float) -> Array:
    """x at the times (n,) [s] from x, v at the first: Runge-Kutta's fourth order between exact reversals of v.

    A body whose reversals follow each other at once trembles within its presliding: it rests until the next time. NaN
    from where more than MOST_STEPS would be needed between two times, or x is no number any more.
    """
    out = np.full(times.size, np.nan)
    out[0] = x
    s = 1.0 if v > 0.0 else -1.0
    pull = -p[0] - p[1] * math.sin(x)
    if v == 0.0:
        s = -1.0 if pull < 0.0 else 1.0
    x_turn, u_turn, held = x, s, False
    if v == 0.0 and p[4] > 0.0:  # dry friction at rest balances what it can
        u_turn = min(max(pull / p[4], -1.0), 1.0)
    for i in range(1, times.size):
        left = times[i] - times[i - 1]
        if not left <= MOST_STEPS * longest:
            return out
        n = max(4, math.ceil(left / longest))  # steps within a frame, at least
        step, turns, steps = left / n, 0, 0
        while left > 1e-12 * step and turns < 3:  # so many reversals make a body rest
            steps += 1
            if steps > MOST_STEPS or not abs(x) + abs(v) < math.inf:
                return out
            if held:
                break
            h = min(step, left)
            x1, v1 = _step(x, v, h, s, x_turn, u_turn, p)
            if v1 * s < 0.0:  # a reversal: the moment by the regula falsi on v, then on with the other sign
                low, high, v_low, v_high = 0.0, h, v, v1
                for _ in range(40):
                    h = low - v_low * (high - low) / (v_high - v_low)
                    x1, v1 = _step(x, v, h, s, x_turn, u_turn, p)
                    if abs(v1) < 1e-13 or high - low < 1e-15:
                        break
                    if v1 * s > 0.0:
                        low, v_low, v_high = h, v1, 0.5 * v_high
                    else:
                        high, v_high, v_low = h, v1, 0.5 * v_low
                v1 = 0.0
                if p[5] > 0.0:
                    u_turn = s + (u_turn - s) * math.exp(-abs(x1 - x_turn) / p[5])
                elif abs(p[0] + p[1] * math.sin(x1)) <= p[4]:
                    held = True
                x_turn, s = x1, -s
                turns = turns + 1 if h < 1e-6 * step else 0  # a reversal at once
            x, v = x1, v1
            left -= h
        out[i] = x
    return out


@njit(cache=True, error_model="numpy")
def _step(x: float, v: float, h: float, s: float, x_turn: float, u_turn: float, p: Array) -> tuple[float, float]:
    a = acceleration(x, v, s, x_turn, u_turn, p)
    v2 = v + 0.5 * h * a
    b = acceleration(x + 0.5 * h * v, v2, s, x_turn, u_turn, p)
    v3 = v + 0.5 * h * b
    c = acceleration(x + 0.5 * h * v2, v3, s, x_turn, u_turn, p)
    v4 = v + h * c
    d = acceleration(x + h * v3, v4, s, x_turn, u_turn, p)
    return x + h * (v + 2.0 * v2 + 2.0 * v3 + v4) / 6.0, v + h * (a + 2.0 * b + 2.0 * c + d) / 6.0


@dataclass
class Body:
    """System of records of one body. given: values of LAW that are not fitted; noise: of the records, from `quiet`.

    baseline, candidates: parameters by the names of LAW and SENSOR. wander: what of SENSOR differs from record
    to record (`scatter`).
    """

    observations: Sequence[Observation]
    noise: Noise
    given: Mapping[str, float]
    baseline: tuple[Parameter, ...]
    candidates: Mapping[str, Candidate]
    wander: tuple[str, ...] = ()  # what of SENSOR differs from record to record
    starts: list[Array] = field(default_factory=list)

    def __post_init__(self) -> None:
        names = {*self.given, *(p.name for p in self.baseline)}
        self.swings = "stiffness" in names
        if not self.starts:
            self.starts = [self._guess(o) for o in self.observations]
            self._follow_all({**self.given, **{q.name: q.start for q in self.baseline}})

    def _guess(self, o: Observation) -> Array:
        n = min(max(o.t.size // 12, 6), o.t.size)
        slope, height = np.polyfit(o.t[:n] - o.t[0], o.y[:n], 1)
        return np.array([slope, height - np.mean(o.y)] if self.swings else [slope])

    def _follow_all(self, values: Mapping[str, float]) -> None:
        """ValueError where a record cannot be followed with the values that a fit begins with."""
        p = np.array([values.get(n, 0.0) for n in LAW])
        for i, o in enumerate(self.observations):
            x = path(*self._first(self.starts[i]), o.t, p, self.longest)
            if not np.all(np.isfinite(x)):
                law = ", ".join(f"{n} = {v:g}" for n, v in zip(LAW, p, strict=True))
                raise ValueError(
                    f"record {i}: the motion cannot be followed at {o.t[np.argmin(np.isfinite(x))]:g} s within "
                    f"{MOST_STEPS} steps a sample with {law}; give other values, or times in s that lie closer"
                )

    def _first(self, start: Array) -> tuple[float, float]:
        """x, v that a record begins with."""
        return float(start[1]) if self.swings else 0.0, float(start[0])

    @property
    def longest(self) -> float:
        """Longest step [s]."""
        return LONGEST if self.swings else math.inf

    def predict(self, mechanisms: tuple[str, ...], values: Mapping[str, float], which: Sequence[int]) -> list[Array]:
        """y of these records from the starts that suit them best; NaN where there is no motion."""
        all_values = {**self.given, **values}
        p = np.array([all_values.get(n, 0.0) for n in LAW])
        sensor = {n: all_values.get(n, v) for n, v in SENSOR.items()}
        return [self._best(i, p, **sensor) for i in which]

    def _best(self, i: int, p: Array, scale: float) -> Array:
        o, start = self.observations[i], self.starts[i]

        def shown(start: Array) -> Array:
            return scale * path(*self._first(start), o.t, p, self.longest)

        weights = self.noise.weights(o.t, o.spread)

        def white(y: Array) -> Array:
            return whiten(*weights, y)

        level = white(np.ones(o.t.size))
        at = shown(start)
        matrix, last = None, math.inf
        for _ in range(12):
            if not np.all(np.isfinite(at)):
                return np.full(o.t.size, np.nan)
            if matrix is None:
                columns = [level]
                for k in range(start.size):
                    moved = start.copy()
                    moved[k] += 1e-5
                    columns.append(white((shown(moved) - at) / 1e-5))
                matrix = np.stack(columns, axis=1)
            change = np.linalg.lstsq(matrix, white(o.y - at), rcond=None)[0]
            start = start + change[1:]
            at = shown(start)
            moved_by = float(np.max(np.abs(change[1:])))
            if moved_by < 1e-9:  # in parts of a start's typical size: its fit has converged
                break
            # derivatives that made a step ten times shorter than the last one will do again
            if moved_by > 0.1 * last:  # else the derivatives of before are good enough
                matrix = None
            last = moved_by
        r = white(o.y - at)
        self.starts[i] = start
        return at + float(level @ r) / float(level @ level)

    def scatter(
        self, mechanisms: tuple[str, ...], values: Mapping[str, float], which: Sequence[int]
    ) -> dict[str, list[Array]]:
        """d(y)/d(what wanders); the start differs too, but that is fitted."""
        at = self.predict(mechanisms, values, which)
        out = {}
        for name in self.wander:
            moved = {**values, name: values.get(name, SENSOR[name]) + WANDER}
            out[name] = [(b - a) / WANDER for a, b in zip(at, self.predict(mechanisms, moved, which))]
        return out


def quiet(tracks: Sequence[tuple[Array, Array]], window: float, degree: int) -> list[Stretch]:
    """Tracks (t, y) cut into windows [s] over which the true course is a polynomial of this degree."""
    out = []
    for t, y in tracks:
        pieces = max(1, round(float(t[-1] - t[0]) / window))
        for part in np.array_split(np.arange(t.size), pieces):
            out.append(Stretch(t[part], y[part], powers(t[part], degree)))
    return out
