"""Closed-form flow of the jumper where it is linear: in the air and at rest on the ground, without lag, rail friction
or hardening of the spring.

With q = y - x_f, r = m_m/M and the stretch q - r X_m: q'' + (c/m) q' + (k/m) (q - r X_m) - (c/m) r X_m' = -G, where
in the air 1/m = 1/M + 1/m_f and G = 0, while the mass centre of the whole robot falls freely; at rest m = M and G = g.
The particular solution is of the form of the forcing (sinusoid or cubic), the rest a damped oscillation.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from jumpvision.physics.granular import AIR, INTRUDE, SINE, VF, XF, W, X, Y

Array = NDArray[np.float64]

RESONANT = 1e-6  # |1 - (forcing / natural frequency)^2| and damping both below: the form divides by zero
STEPS_PER_PERIOD = 4  # of the oscillation in q: events are looked for twice a step, and between by a parabola


@njit
def oscillator(mode: int, p: Any) -> tuple[float, float]:
    """k/m [1/s^2] and c/m [1/s] of the oscillation in q."""
    inverse = 1.0 / p.M + (1.0 / p.m_f if mode == AIR and p.massless == 0 else 0.0)
    return p.k_s * inverse, p.c_s * inverse


@njit
def longest_step(mode: int, kind: int, row: Array, p: Any) -> float:
    """Step [s] to look for events with, or 0 where the closed form does not hold."""
    if mode == INTRUDE or p.k_3 > 0.0 or p.c_v > 0.0 or p.F_c > 0.0 or p.tau > 0.0:
        return 0.0
    stiff, damp = oscillator(mode, p)
    if damp * damp >= 3.9 * stiff:
        return 0.0
    if kind == SINE:
        share = row[4] * row[4] / stiff
        if row[3] != 0.0 and abs(1.0 - share) + damp * math.sqrt(share / stiff) < RESONANT:
            return 0.0
    return 2.0 * math.pi / math.sqrt(stiff) / STEPS_PER_PERIOD


@njit
def particular(t: float, mode: int, kind: int, row: Array, p: Any) -> tuple[float, float]:
    """A solution q(t), q'(t) that moves as the forcing does."""
    stiff, damp = oscillator(mode, p)
    ratio = p.m_m / p.M
    fall = p.g if mode != AIR else 0.0
    if kind == SINE:
        q, v = ratio * row[2] - fall / stiff, 0.0
        if row[3] != 0.0:
            omega = row[4]
            angle, gap, loss = omega * (t - row[0]) + row[5], stiff - omega * omega, damp * omega
            scale = ratio * row[3] / (gap * gap + loss * loss)
            a, b = scale * (stiff * gap + loss * loss), -scale * loss * omega * omega
            sin, cos = math.sin(angle), math.cos(angle)
            q += a * sin + b * cos
            v += omega * (a * cos - b * sin)
        return q, v
    h = t - row[0]
    q3 = ratio * row[2]
    q2 = ratio * row[3]
    q1 = ratio * row[4] - 6.0 * q3 / stiff
    q0 = ratio * row[5] + (ratio * damp * row[4] - damp * q1 - 2.0 * q2 - fall) / stiff
    return ((q3 * h + q2) * h + q1) * h + q0, (3.0 * q3 * h + 2.0 * q2) * h + q1


@njit
def flow(t: float, s: Array, h: float, mode: int, kind: int, row: Array, p: Any, out: Array) -> None:
    """Writes the state at t + h, exact to rounding."""
    out[X] = s[X]
    if p.massless == 1 and mode == AIR:
        out[Y], out[W] = s[Y] + (s[W] - 0.5 * p.g * h) * h, s[W] - p.g * h
        out[XF], out[VF] = s[XF], s[VF]
        return
    stiff, damp = oscillator(mode, p)
    q0, v0 = particular(t, mode, kind, row, p)
    q1, v1 = particular(t + h, mode, kind, row, p)
    half = 0.5 * damp
    omega = math.sqrt(stiff - half * half)
    a = s[Y] - s[XF] - q0
    rate = s[W] - s[VF] - v0
    b = (rate + half * a) / omega
    fade, cos, sin = math.exp(-half * h), math.cos(omega * h), math.sin(omega * h)
    q = q1 + fade * (a * cos + b * sin)
    v = v1 + fade * (rate * cos - (stiff * a + half * rate) / omega * sin)
    if mode == AIR:
        share = p.m_f / (p.M + p.m_f)
        z = (1.0 - share) * s[Y] + share * s[XF]
        u = (1.0 - share) * s[W] + share * s[VF]
        z += (u - 0.5 * p.g * h) * h
        u -= p.g * h
        out[Y], out[W] = z + share * q, u + share * v
        out[XF], out[VF] = z - (1.0 - share) * q, u - (1.0 - share) * v
    else:
        out[XF], out[VF] = s[XF], 0.0
        out[Y], out[W] = s[XF] + q, v
