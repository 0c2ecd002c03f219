"""One step of the jumper: Dormand-Prince 5(4) with its dense output, or the closed form where the flow is linear."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from jumpvision.base.arrays import Array

from .granular import AIR, INTRUDE, SINE, VF, XF, W, Y, dry_frictions, is_still, rhs, settling
from .kernel import kernel

ORDER = 5
N_SLOPES = 7
NODES = (0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0)
# one name a stage: constants that the compiler sees
A1 = (1 / 5,)
A2 = (3 / 40, 9 / 40)
A3 = (44 / 45, -56 / 15, 32 / 9)
A4 = (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729)
A5 = (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656)
A6 = (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84)
ERROR = (-71 / 57600, 0.0, 71 / 16695, -71 / 1920, 17253 / 339200, -22 / 525, 1 / 40)
DENSE = np.array(
    [
        [1, -8048581381 / 2820520608, 8663915743 / 2820520608, -12715105075 / 11282082432],
        [0, 0, 0, 0],
        [0, 131558114200 / 32700410799, -68118460800 / 10900136933, 87487479700 / 32700410799],
        [0, -1754552775 / 470086768, 14199869525 / 1410260304, -10690763975 / 1880347072],
        [0, 127303824393 / 49829197408, -318862633887 / 49829197408, 701980252875 / 199316789632],
        [0, -282668133 / 205662961, 2019193451 / 616988883, -1453857185 / 822651844],
        [0, 40617522 / 29380423, -110615467 / 29380423, 69997945 / 29380423],
    ]
)


@kernel
def step(
    t: float,
    s: Array,
    h: float,
    mode: int,
    slip: int,
    memory: Array,
    kind: int,
    row: Array,
    p: Any,
    k: Array,
    s1: Array,
    rtol: float,
    atol: Array,
) -> float:
    """Writes s1 = s(t + h); returns the error over its tolerance (<= 1: accept).

    k: (N_SLOPES, n); k[0] = ds/dt at t on entry, the others are filled; k[6] = ds/dt at t + h.
    """
    n = s.size
    for i in range(1, N_SLOPES):  # one call of rhs: written out, it would be compiled six times
        for j in range(n):
            if i == 1:
                slope = A1[0] * k[0, j]
            elif i == 2:
                slope = A2[0] * k[0, j] + A2[1] * k[1, j]
            elif i == 3:
                slope = A3[0] * k[0, j] + A3[1] * k[1, j] + A3[2] * k[2, j]
            elif i == 4:
                slope = A4[0] * k[0, j] + A4[1] * k[1, j] + A4[2] * k[2, j] + A4[3] * k[3, j]
            elif i == 5:
                slope = A5[0] * k[0, j] + A5[1] * k[1, j] + A5[2] * k[2, j] + A5[3] * k[3, j] + A5[4] * k[4, j]
            else:
                slope = A6[0] * k[0, j] + A6[2] * k[2, j] + A6[3] * k[3, j] + A6[4] * k[4, j] + A6[5] * k[5, j]
            s1[j] = s[j] + h * slope
        rhs(t + NODES[i] * h, s1, mode, slip, memory, kind, row, p, k, i)
    worst = 0.0
    for j in range(n):
        total = ERROR[0] * k[0, j] + ERROR[2] * k[2, j] + ERROR[3] * k[3, j]
        total += ERROR[4] * k[4, j] + ERROR[5] * k[5, j] + ERROR[6] * k[6, j]
        error = abs(h * total) / (atol[j] + rtol * max(abs(s[j]), abs(s1[j])))
        if not math.isfinite(error):
            return math.inf
        worst = max(worst, error)
    return worst


@kernel
def dense(k: Array, h: float, q: Array) -> None:
    """Writes the coefficients q (n, 4) of s(t + theta h) = s + q[:, 0] theta + ... + q[:, 3] theta^4."""
    for j in range(q.shape[0]):
        for n in range(4):
            total = 0.0
            for m in range(N_SLOPES):
                total += k[m, j] * DENSE[m, n]
            q[j, n] = h * total


@kernel
def between(s: Array, q: Array, theta: float, out: Array) -> None:
    """Writes the state at the share theta of the step that began at s."""
    for j in range(s.size):
        out[j] = s[j] + theta * (q[j, 0] + theta * (q[j, 1] + theta * (q[j, 2] + theta * q[j, 3])))


@kernel
def middle(s: Array, s1: Array, k: Array, h: float, out: Array) -> None:
    """Writes the state halfway from its values and slopes at both ends (cubic Hermite; third order, for signs)."""
    for j in range(s.size):
        out[j] = 0.5 * (s[j] + s1[j]) + 0.125 * h * (k[0, j] - k[N_SLOPES - 1, j])


RESONANT = 1e-6  # |1 - (forcing / natural frequency)^2| and damping both below: the form divides by zero
STEPS_PER_PERIOD = 8  # of the oscillation in q: events are looked for twice a step, and between by a parabola

# An arc: start, cosine and sine part of the oscillation, its decay and frequency, four numbers of the particular
# solution (level, sine, cosine; or a cubic) and what follows a lag's transient in it, height and rate of the mass
# centre, its acceleration downwards, share of the foot in the mass
N_ARC = 15
T0, COS, SIN, HALF, OMEGA, P0, P1, P2, P3, LATE, Z, U, PULL, SHARE, FOOT = range(N_ARC)


@kernel
def oscillator(mode: int, p: Any) -> tuple[float, float]:
    """k/m [1/s^2] and c/m [1/s] of the oscillation in q."""
    inverse = 1.0 / p.M + (1.0 / p.m_f if mode == AIR and p.massless == 0 else 0.0)
    return p.k_s * inverse, p.c_s * inverse


@kernel
def longest_step(mode: int, slip: int, kind: int, row: Array, p: Any) -> float:
    """Step [s] to look for events with, or 0 where the closed form does not hold."""
    if mode == INTRUDE or p.linear == 0 or slip == 0:
        return 0.0
    stiff, damp = oscillator(mode, p)
    if damp * damp >= 3.9 * stiff:
        return 0.0
    if kind == SINE:
        share = row[4] * row[4] / stiff
        if row[3] != 0.0 and abs(1.0 - share) + damp * math.sqrt(share / stiff) < RESONANT:
            return 0.0
    return 2.0 * math.pi / math.sqrt(stiff) / STEPS_PER_PERIOD


@kernel
def particular(t: float, kind: int, row: Array, p: Any, arc: Array) -> tuple[float, float]:
    """The solution q(t), q'(t) that moves as the motor does."""
    left, fall = 0.0, 0.0
    if settling(t, row, p):
        left = arc[LATE] * math.exp(-(t - row[7]) / p.tau)
        fall = left / p.tau
    if kind == SINE:
        if row[3] == 0.0:
            return arc[P0] + left, -fall
        angle = row[4] * (t - row[0]) + row[5]
        sin, cos = math.sin(angle), math.cos(angle)
        return arc[P0] + arc[P1] * sin + arc[P2] * cos + left, row[4] * (arc[P1] * cos - arc[P2] * sin) - fall
    h = t - row[0]
    value = ((arc[P3] * h + arc[P2]) * h + arc[P1]) * h + arc[P0]
    return value + left, (3.0 * arc[P3] * h + 2.0 * arc[P2]) * h + arc[P1] - fall


@kernel
def begin(t: float, s: Array, mode: int, slip: int, kind: int, row: Array, p: Any, arc: Array) -> None:
    """Writes the arc (N_ARC,) that starts from the state s at t; dry friction of the rail is a constant force on it."""
    arc[T0], arc[FOOT] = t, s[XF]
    rail = dry_frictions(0.0, float(slip), p) / p.M
    if p.massless == 1 and mode == AIR:
        arc[Z], arc[U], arc[PULL] = s[Y], s[W], p.g - rail
        return
    stiff, damp = oscillator(mode, p)
    ratio = p.m_m / p.M
    fall = (p.g if mode != AIR else 0.0) - rail
    if kind == SINE:
        arc[P0], arc[P1], arc[P2] = ratio * row[2] - fall / stiff, 0.0, 0.0
        if row[3] != 0.0:
            rate, gap, loss = row[4], stiff - row[4] * row[4], damp * row[4]
            scale = ratio * row[3] / (gap * gap + loss * loss)
            arc[P1], arc[P2] = scale * (stiff * gap + loss * loss), -scale * loss * rate * rate
    else:
        arc[P3], arc[P2] = ratio * row[2], ratio * row[3]
        arc[P1] = ratio * row[4] - 6.0 * arc[P3] / stiff
        arc[P0] = ratio * row[5] + (ratio * damp * row[4] - damp * arc[P1] - 2.0 * arc[P2] - fall) / stiff
    if p.tau > 0.0:
        fast = 1.0 / p.tau
        arc[LATE] = ratio * row[6] * (stiff - damp * fast) / (fast * (fast - damp) + stiff)
    q, v = particular(t, kind, row, p, arc)
    arc[HALF] = 0.5 * damp
    arc[OMEGA] = math.sqrt(stiff - 0.25 * damp * damp)
    arc[COS] = s[Y] - s[XF] - q
    arc[SIN] = (s[W] - s[VF] - v + arc[HALF] * arc[COS]) / arc[OMEGA]
    arc[SHARE] = share = p.m_f / (p.M + p.m_f)
    arc[PULL] = p.g - (1.0 - share) * rail
    arc[Z], arc[U] = (1.0 - share) * s[Y] + share * s[XF], (1.0 - share) * s[W] + share * s[VF]


@kernel
def flow(t: float, mode: int, kind: int, row: Array, p: Any, arc: Array, out: Array) -> None:
    """Writes the state at t on the arc, exact to rounding."""
    h = t - arc[T0]
    if p.massless == 1 and mode == AIR:
        out[Y], out[W] = arc[Z] + (arc[U] - 0.5 * arc[PULL] * h) * h, arc[U] - arc[PULL] * h
        out[XF], out[VF] = arc[FOOT], 0.0
        return
    q, v = particular(t, kind, row, p, arc)
    half, omega = arc[HALF], arc[OMEGA]
    fade, angle = math.exp(-half * h), omega * h
    cos, sin = fade * math.cos(angle), fade * math.sin(angle)
    q += arc[COS] * cos + arc[SIN] * sin
    v += (omega * arc[SIN] - half * arc[COS]) * cos - (omega * arc[COS] + half * arc[SIN]) * sin
    if mode == AIR:
        share = arc[SHARE]
        z, u = arc[Z] + (arc[U] - 0.5 * arc[PULL] * h) * h, arc[U] - arc[PULL] * h
        out[Y], out[W] = z + share * q, u + share * v
        out[XF], out[VF] = z - (1.0 - share) * q, u - (1.0 - share) * v
    else:
        out[XF], out[VF] = arc[FOOT], 0.0
        out[Y], out[W] = arc[FOOT] + q, v


@kernel
def clear_until(t: float, mode: int, kind: int, row: Array, p: Any, arc: Array, floor: float, best: float) -> float:
    """Time until which the foot surely stays above the hole and the rod below its peak or below `best` (t: unknown).

    In flight with the motor still, q stays within a fading amplitude of its level, so that the free fall of the mass
    centre bounds foot and rod: the steps of a long flight need not be looked at one by one; with dry friction, which
    turns with the carriage, they are.
    """
    if mode != AIR or p.massless == 1 or p.hold > 0.0 or not is_still(t, kind, row, p):
        return t
    h, share, g = t - arc[T0], arc[SHARE], p.g
    swing = math.hypot(arc[COS], arc[SIN]) * math.exp(-arc[HALF] * h)
    least = (1.0 - share) * (arc[P0] + swing) - floor  # of the mass centre, while the foot is in the air for sure
    z = arc[Z] + (arc[U] - 0.5 * g * h) * h
    if z <= least:
        return t
    landing = (arc[U] + math.sqrt(arc[U] * arc[U] + 2.0 * g * (arc[Z] - least))) / g
    apex = arc[U] / g
    crest = z if h > apex else arc[Z] + 0.5 * arc[U] * apex
    position = row[2] if kind == SINE else row[5]
    if crest + share * (arc[P0] + swing) - p.m_m / p.M * position <= best:
        return arc[T0] + landing
    window = apex - math.sqrt(4.0 * share * swing / g)  # where the rod may be at its highest
    return arc[T0] + window if h < window < landing else t
