"""Closed-form flow of the jumper where it is linear: in the air and at rest on the ground, without lag, rail friction
or hardening of the spring.

With q = y - x_f, r = m_m/M and the stretch q - r X_m: q'' + (c/m) q' + (k/m) (q - r X_m) - (c/m) r X_m' = -G, where
in the air 1/m = 1/M + 1/m_f and G = 0, while the mass centre of the whole robot falls freely; at rest m = M and G = g.
The particular solution is of the form of the forcing (sinusoid or cubic), the rest a damped oscillation. What does
not depend on time is found once at the start of an arc (`begin`); the state at any later time costs three to five
transcendental functions (`flow`).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jumpvision.physics.granular import AIR, CARRIAGE, INTRUDE, SINE, VF, XF, W, Y, is_still
from jumpvision.physics.kernel import kernel

Array = NDArray[np.float64]

RESONANT = 1e-6  # |1 - (forcing / natural frequency)^2| and damping both below: the form divides by zero
STEPS_PER_PERIOD = 4  # of the oscillation in q: events are looked for twice a step, and between by a parabola

# An arc: start, cosine and sine part of the oscillation, its decay and frequency, four numbers of the particular
# solution (level, sine, cosine; or a cubic), height and rate of the mass centre, share of the foot in the mass
N_ARC = 13
T0, COS, SIN, HALF, OMEGA, P0, P1, P2, P3, Z, U, SHARE, FOOT = range(N_ARC)


@kernel
def oscillator(mode: int, p: Any) -> tuple[float, float]:
    """k/m [1/s^2] and c/m [1/s] of the oscillation in q."""
    inverse = 1.0 / p.M + (1.0 / p.m_f if mode == AIR and p.massless == 0 else 0.0)
    return p.k_s * inverse, p.c_s * inverse


@kernel
def longest_step(mode: int, kind: int, row: Array, p: Any) -> float:
    """Step [s] to look for events with, or 0 where the closed form does not hold."""
    if mode == INTRUDE or p.k_3 > 0.0 or p.c_v > 0.0 or p.F_c > 0.0 or p.tau > 0.0:
        return 0.0
    if p.r != 0.0 and p.r_on == CARRIAGE:
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
def particular(t: float, kind: int, row: Array, arc: Array) -> tuple[float, float]:
    """The solution q(t), q'(t) that moves as the forcing does."""
    if kind == SINE:
        if row[3] == 0.0:
            return arc[P0], 0.0
        angle = row[4] * (t - row[0]) + row[5]
        sin, cos = math.sin(angle), math.cos(angle)
        return arc[P0] + arc[P1] * sin + arc[P2] * cos, row[4] * (arc[P1] * cos - arc[P2] * sin)
    h = t - row[0]
    value = ((arc[P3] * h + arc[P2]) * h + arc[P1]) * h + arc[P0]
    return value, (3.0 * arc[P3] * h + 2.0 * arc[P2]) * h + arc[P1]


@kernel
def begin(t: float, s: Array, mode: int, kind: int, row: Array, p: Any, arc: Array) -> None:
    """Writes the arc (N_ARC,) that starts from the state s at t."""
    arc[T0], arc[FOOT] = t, s[XF]
    if p.massless == 1 and mode == AIR:
        arc[Z], arc[U] = s[Y], s[W]
        return
    stiff, damp = oscillator(mode, p)
    ratio = p.m_m / p.M
    fall = p.g if mode != AIR else 0.0
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
    q, v = particular(t, kind, row, arc)
    arc[HALF] = 0.5 * damp
    arc[OMEGA] = math.sqrt(stiff - 0.25 * damp * damp)
    arc[COS] = s[Y] - s[XF] - q
    arc[SIN] = (s[W] - s[VF] - v + arc[HALF] * arc[COS]) / arc[OMEGA]
    arc[SHARE] = share = p.m_f / (p.M + p.m_f)
    arc[Z], arc[U] = (1.0 - share) * s[Y] + share * s[XF], (1.0 - share) * s[W] + share * s[VF]


@kernel
def flow(t: float, mode: int, kind: int, row: Array, p: Any, arc: Array, out: Array) -> None:
    """Writes the state at t on the arc, exact to rounding."""
    h = t - arc[T0]
    if p.massless == 1 and mode == AIR:
        out[Y], out[W] = arc[Z] + (arc[U] - 0.5 * p.g * h) * h, arc[U] - p.g * h
        out[XF], out[VF] = arc[FOOT], 0.0
        return
    q, v = particular(t, kind, row, arc)
    half, omega = arc[HALF], arc[OMEGA]
    fade, angle = math.exp(-half * h), omega * h
    cos, sin = fade * math.cos(angle), fade * math.sin(angle)
    q += arc[COS] * cos + arc[SIN] * sin
    v += (omega * arc[SIN] - half * arc[COS]) * cos - (omega * arc[COS] + half * arc[SIN]) * sin
    if mode == AIR:
        share = arc[SHARE]
        z, u = arc[Z] + (arc[U] - 0.5 * p.g * h) * h, arc[U] - p.g * h
        out[Y], out[W] = z + share * q, u + share * v
        out[XF], out[VF] = z - (1.0 - share) * q, u - (1.0 - share) * v
    else:
        out[XF], out[VF] = arc[FOOT], 0.0
        out[Y], out[W] = arc[FOOT] + q, v


@kernel
def clear_until(t: float, mode: int, kind: int, row: Array, p: Any, arc: Array, floor: float, best: float) -> float:
    """Time until which the foot surely stays above the hole and the rod below its peak or below `best` (t: unknown).

    In flight with the motor still, q stays within a fading amplitude of its level, so that the free fall of the mass
    centre bounds foot and rod: the steps of a long flight need not be looked at one by one.
    """
    if mode != AIR or p.massless == 1 or not is_still(kind, row):
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
