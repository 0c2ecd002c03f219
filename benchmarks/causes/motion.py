"""A third writing of the jumper, for laws that neither the analysis nor the laboratory has: RK4, events by bisection.

Positions up, SI. State: y = x_r + (m_m/M) X_m, its rate w, foot x_f, v_f, and one internal state m of the hidden law.
The rules are docs/physics.md section 1: aerial, at rest, intruding; landing where the foot reaches the hole's floor,
with the momentum that the foot shares with the cone that stands there. A hidden law acts

- on the foot while it intrudes, as a resistance (positive up) of depth z and speed u = -v_f >= 0. Its limit at u = 0 is
  part of what a resting foot must overcome, and of what the robot settles on before anything has moved;
- on the carriage: a force (positive up) of its height x_r + X_m and its velocity v_m;
- in the spring: a force on the rod (positive up) of stretch and stretch rate.

Nothing is imported from the analysis, nor from the laboratory.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

AIR, REST, INTRUDING = 0, 1, 2
NOTHING, FOOT, CARRIAGE, SPRING = 0, 1, 2, 3
STEP = 5e-5  # s
HALVINGS = 45  # of a step, to find an event: 1e-18 s
NEVER = -1e9  # s: time of the last landing before the first
STILL = 0.002  # m/s: over which a dry law changes its sign

# laws, by number
POWER, DEPTH_POWER, DECAY, SATURATING, SINCE, RELAXING = range(6)  # of the foot
RISING, PATCH, PUSH, SHOVE = 1, 2, 3, 4  # of the carriage
ARM, DRY = 1, 2  # of the spring


class Jumper(NamedTuple):
    """Robot and known ground: kg, N/m, N s/m, m; keep: share of v_r kept at a touchdown on hard ground."""

    m_m: float
    M: float
    m_f: float
    k: float
    c: float
    g: float
    hard: bool
    keep: float = 1.0
    k1: float = 0.0  # N/m, to the depth delta, k2 below
    k2: float = 0.0
    delta: float = 1.0
    alpha: float = 0.0  # kg/m
    b: float = 0.0
    cone: float = 0.0  # C phi rho [kg/m^3]
    mu: float = 2.0
    tan_theta: float = 1.7320508
    R: float = 0.0381


class Law(NamedTuple):
    """What is hidden: on which body, which law, its numbers."""

    body: int = NOTHING
    which: int = 0
    p: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Command(NamedTuple):
    """X_m = A [sin(w t + phase) - sin(phase)] for one cycle from `start`, held for `delay` after the first half."""

    amplitude: float
    frequency: float
    phase: float
    start: float
    delay: float = 0.0

    @property
    def edges(self) -> tuple[float, float, float, float]:
        """Start, middle, second start, stop [s]."""
        half = self.start + 0.5 / self.frequency
        return self.start, half, half + self.delay, half + self.delay + 0.5 / self.frequency


# `_nrt`: without counted references small functions cost a fifth; then they must make no arrays
compiled = nb.njit(cache=True, error_model="numpy", _nrt=False)


@compiled
def _motor(t, piece, command, edges):  # type: ignore[no-untyped-def]
    """X_m and X_m' on a piece: before, first half, held, second half, after."""
    A, f, phase = command[0], command[1], command[2]
    w = 2.0 * math.pi * f
    if piece == 0:
        return 0.0, 0.0
    if piece == 1 or piece == 3:
        angle = w * (t - edges[0]) + phase if piece == 1 else w * (t - edges[2]) + phase + math.pi
        return A * (math.sin(angle) - math.sin(phase)), A * w * math.cos(angle)
    turn = math.pi if piece == 2 else 2.0 * math.pi
    return A * (math.sin(turn + phase) - math.sin(phase)), 0.0


@compiled
def _cone(z, j):  # type: ignore[no-untyped-def]
    """Mass of the jammed cone [kg] per C phi rho, and its rate with depth."""
    h = j.mu * z
    top = j.R * j.tan_theta
    if h >= top:
        return math.pi * j.R**2 * top / 3.0, 0.0
    rest = 1.0 - h / top  # the frustum: a cone less its tip
    return math.pi * j.R**2 * top / 3.0 * (1.0 - rest**3), j.mu * math.pi * j.R**2 * rest**2


@compiled
def _static(z, j):  # type: ignore[no-untyped-def]
    return j.k1 * z if z < j.delta else j.k1 * j.delta + j.k2 * (z - j.delta)


@compiled
def hidden(q, u, m, since, law):  # type: ignore[no-untyped-def]
    """The hidden force, and the rate of its internal state; since: the last landing [s]."""
    p0, p1, p2 = law.p
    if law.body == FOOT:
        if law.which == POWER:
            return p0 * max(u, 0.0) ** p1, 0.0
        if law.which == DEPTH_POWER:
            return p0 * max(q, 0.0) ** p1 * u, 0.0
        if law.which == DECAY:
            return p0 * math.exp(-q / p1), 0.0
        if law.which == SATURATING:
            return p0 * u / (abs(u) + p1), 0.0
        if law.which == SINCE:
            return p0 * q * math.exp(-min(since, 1e3) / p1), 0.0
        return m, p0 * u - m / p1
    if law.body == CARRIAGE:
        if law.which == RISING:
            return -p0 * math.exp(q / p1) * u, 0.0
        if law.which == PATCH:
            return -p0 * math.exp(-(((q - p1) / p2) ** 2)) * u, 0.0
        if law.which == PUSH:
            return p0 * u, 0.0
        return p0 * u / (abs(u) + p1), 0.0
    if law.which == ARM:
        return -p0 * m, u - m / p1
    return -p0 * abs(q) * math.tanh(u / STILL), 0.0


@compiled
def _spring(e, rate, m, mode, j, law):  # type: ignore[no-untyped-def]
    if j.hard and mode == AIR:
        return 0.0
    F = -j.k * e - j.c * rate
    if law.body == SPRING:
        F += hidden(e, rate, m, 0.0, law)[0]
    return F


@compiled
def _resist(z, u, m, since, j, law):  # type: ignore[no-untyped-def]
    F = _static(z, j) + (j.alpha + j.b * j.cone * _cone(z, j)[1]) * u * u
    if law.body == FOOT:
        F += hidden(z, u, m, since, law)[0]
    return F


@compiled
def _slopes(t, s, mode, landed, piece, command, edges, j, law, out):  # type: ignore[no-untyped-def]
    X, V = _motor(t, piece, command, edges)
    ratio = j.m_m / j.M
    x_r, v_r = s[0] - ratio * X, s[1] - ratio * V
    v_f = s[3] if mode != REST else 0.0
    x_f = s[2]
    if j.hard:
        x_f, v_f = (x_r, v_r) if mode == AIR else (0.0, 0.0)
    e, rate = x_r - x_f, v_r - v_f
    F = _spring(e, rate, s[4], mode, j, law)
    rail = hidden(x_r + X, v_r + V, s[4], 0.0, law)[0] if law.body == CARRIAGE else 0.0
    out[0] = s[1]
    out[1] = -j.g + (F + rail) / j.M
    out[2] = 0.0
    out[3] = 0.0
    if not j.hard and mode == AIR:
        out[2] = v_f
        out[3] = -j.g - F / j.m_f
    elif mode == INTRUDING:
        z, u = -x_f, -v_f
        resist = _resist(z, u, s[4], t - landed, j, law)
        out[2] = v_f
        out[3] = (resist - F - j.m_f * j.g) / (j.m_f + j.cone * _cone(z, j)[0])
    out[4] = 0.0
    if law.body == FOOT:
        out[4] = hidden(-x_f, -v_f if mode == INTRUDING else 0.0, s[4], 0.0, law)[1]
    elif law.body == SPRING:
        out[4] = hidden(e, rate, s[4], 0.0, law)[1]


@compiled
def _rk4(t, h, s, mode, landed, piece, command, edges, j, law, k, mid, out):  # type: ignore[no-untyped-def]
    _slopes(t, s, mode, landed, piece, command, edges, j, law, k[0])
    for n in range(5):
        mid[n] = s[n] + 0.5 * h * k[0, n]
    _slopes(t + 0.5 * h, mid, mode, landed, piece, command, edges, j, law, k[1])
    for n in range(5):
        mid[n] = s[n] + 0.5 * h * k[1, n]
    _slopes(t + 0.5 * h, mid, mode, landed, piece, command, edges, j, law, k[2])
    for n in range(5):
        mid[n] = s[n] + h * k[2, n]
    _slopes(t + h, mid, mode, landed, piece, command, edges, j, law, k[3])
    for n in range(5):
        out[n] = s[n] + h / 6.0 * (k[0, n] + 2.0 * k[1, n] + 2.0 * k[2, n] + k[3, n])


@compiled
def _next(t, s, mode, floor, landed, piece, command, edges, j, law):  # type: ignore[no-untyped-def]
    """The mode that follows in this state."""
    X, V = _motor(t, piece, command, edges)
    ratio = j.m_m / j.M
    x_r, v_r = s[0] - ratio * X, s[1] - ratio * V
    if j.hard:
        return AIR if x_r > 0.0 else REST
    if mode == AIR:
        return INTRUDING if s[2] < -floor and s[3] < 0.0 else AIR
    if mode == INTRUDING:
        return REST if s[3] >= 0.0 else INTRUDING
    push = _spring(x_r - s[2], v_r, s[4], mode, j, law) + j.m_f * j.g
    slack = 1e-9 * j.M * j.g
    if push < -slack:
        return AIR
    return INTRUDING if push > _resist(-s[2], 0.0, s[4], t - landed, j, law) + slack else REST


@compiled
def _run(times, keep, pieces, command, edges, j, law, work, out):  # type: ignore[no-untyped-def]
    """Follows the motion over `times`, writes a row of `out` where `keep`; returns how many rows."""
    s, new, mid, k = work[0], work[1], work[2], work[3:]
    floor = 0.0
    if not j.hard:  # the bed carries the weight, the law at rest and long after any contact included
        deepest = 0.2
        for _ in range(60):
            half = 0.5 * (floor + deepest)
            if _resist(half, 0.0, 0.0, -NEVER, j, law) < (j.M + j.m_f) * j.g:
                floor = half
            else:
                deepest = half
    s[2] = -floor
    s[0] = -floor - j.M * j.g / j.k
    mode, landed, row = REST, NEVER, 0
    for i in range(times.size):
        if keep[i]:
            X, V = _motor(times[i], pieces[i], command, edges)
            x_r, v_r = s[0] - j.m_m / j.M * X, s[1] - j.m_m / j.M * V
            x_f, v_f = s[2], s[3] if mode != REST else 0.0
            if j.hard:
                x_f, v_f = (x_r, v_r) if mode == AIR else (0.0, 0.0)
            values = (x_r, v_r, x_f, v_f, X, V, s[4], times[i] - landed, float(mode))
            for n in range(9):
                out[row, n] = values[n]
            row += 1
        if i + 1 == times.size:
            break
        t, piece, tries = times[i], pieces[i], 0
        while t < times[i + 1]:
            tries += 1
            if tries > 200:
                return -1
            h = times[i + 1] - t
            _rk4(t, h, s, mode, landed, piece, command, edges, j, law, k, mid, new)
            after = _next(t + h, new, mode, floor, landed, piece, command, edges, j, law)
            if after == mode:
                for n in range(5):
                    s[n] = new[n]
                break
            low, high = 0.0, 1.0
            for _ in range(HALVINGS):
                half = 0.5 * (low + high)
                _rk4(t, half * h, s, mode, landed, piece, command, edges, j, law, k, mid, new)
                if _next(t + half * h, new, mode, floor, landed, piece, command, edges, j, law) == mode:
                    low = half
                else:
                    high = half
            _rk4(t, high * h, s, mode, landed, piece, command, edges, j, law, k, mid, new)
            t += high * h
            for n in range(5):
                s[n] = new[n]
            after = _next(t, s, mode, floor, landed, piece, command, edges, j, law)
            if mode == AIR and after != AIR:
                landed = t
                if j.hard:
                    v_r = s[1] - j.m_m / j.M * _motor(t, piece, command, edges)[1]
                    s[1] -= (1.0 - j.keep) * v_r
                else:
                    s[2] = -floor
                    s[3] *= j.m_f / (j.m_f + j.cone * _cone(floor, j)[0])
            elif mode == INTRUDING and after == REST:
                floor, s[3] = max(floor, -s[2]), 0.0
            mode = after
    return row


class Motion(NamedTuple):
    """Arrays (n,) at the times t [s]: rod, foot, motor X_m [m] and their rates; m: internal state of the law;
    since: time since the last landing [s]; mode: AIR, REST, INTRUDING."""

    t: Array
    rod: Array
    rod_rate: Array
    foot: Array
    foot_rate: Array
    motor: Array
    motor_rate: Array
    m: Array
    since: Array
    mode: Array


def follow(jumper: Jumper, command: Command, law: Law, t: Array, *, step: float = STEP) -> Motion:
    """The motion at the times t (n,) [s], increasing, from rest at or before t[0] >= 0. step [s]: the longest."""
    edges = np.array(command.edges)
    ends = np.unique(np.concatenate([[0.0], t, edges[edges < t[-1]]]))
    steps = np.maximum(np.ceil(np.diff(ends) / step - 1e-9), 1.0).astype(int)
    first = np.append(0, np.cumsum(steps))  # where the ends lie among the times
    share = (np.arange(first[-1]) - np.repeat(first[:-1], steps)) / np.repeat(steps, steps)
    times = np.append(np.repeat(ends[:-1], steps) + share * np.repeat(np.diff(ends), steps), ends[-1])
    keep = np.zeros(times.size, bool)
    keep[first[np.searchsorted(ends, t)]] = True
    middle = np.append(0.5 * (times[:-1] + times[1:]), times[-1] + 1e-12)
    pieces = np.searchsorted(edges, middle, side="right")
    out = np.empty((t.size, 9))
    rows = _run(times, keep, pieces, tuple(map(float, command)), edges, jumper, law, np.zeros((7, 5)), out)
    if rows != t.size:
        raise RuntimeError(f"motion: the foot chatters without end, {jumper}, {law.p}")
    return Motion(t, *np.ascontiguousarray(out.T))
