"""How far a step may be tried: to the kinks of the laws, and while the guards of its mode stay above zero."""

from __future__ import annotations

import numpy as np

from jumpvision.base.arrays import Array

from .granular import AIR, VF, XF, Guards
from .kernel import kernel
from .laws import BENDS
from .packed import Packed

NEAR = 0.05  # of a guard at the ends of a step: a middle value below it is looked at with the dense output
ON = 1e-9  # m, so near to a kink of a law a step begins or ends on it


@kernel
def foot_rate(k_s: float, M: float, m_f: float) -> float:
    """Rate [1/s] at which the spring swings the foot against the rest; that of the rest without a foot's mass."""
    return np.sqrt(k_s * (1.0 / M + 1.0 / m_f) if m_f > 0.0 else k_s / M)


@kernel
def positive(g: Guards) -> bool:
    """Whether no guard has fallen."""
    return g[0] > 0.0 and g[1] > 0.0 and g[2] > 0.0 and g[3] > 0.0


@kernel
def holds(a: Guards, b: Guards, fall: float, mode: int, p: Packed) -> bool:
    """Whether the guards of an arc, a and b at the ends of a step, stay above zero: between, they are at most `fall`
    below the straight line."""
    return min(a[0], b[0]) > fall and (mode == AIR or p.sand == 0 or min(a[1], b[1]) > fall)


@kernel
def above(half: Guards, a: Guards, b: Guards) -> bool:
    """Whether the guards in the middle of a step are well above zero, measured by those at its ends."""
    return (
        half[0] > NEAR * max(a[0], b[0])
        and half[1] > NEAR * max(a[1], b[1])
        and half[2] > NEAR * max(a[2], b[2])
        and half[3] > NEAR * max(a[3], b[3])
    )


@kernel
def time_to_bend(s: Array, acceleration: float, p: Packed) -> float:
    """When [s] the foot will reach the first kink of a law, as it slows down now; inf without one."""
    z, v, at = -s[XF], -s[VF], np.inf
    for i in range(BENDS):
        if z + ON < p.bends[i] < at:
            at = p.bends[i]
    root = v * v - 2.0 * acceleration * (at - z)
    return 2.0 * (at - z) / (v + np.sqrt(root)) if 0.0 <= root < np.inf else np.inf


@kernel
def share_to_bend(s: Array, s1: Array, h: float, p: Packed) -> float:
    """Share of a step from s to s1 at which the foot reaches the first kink of a law, by the cubic through both; 1.0
    without one."""
    z, z1, at = -s[XF], -s1[XF], np.inf
    for i in range(BENDS):
        if z + ON < p.bends[i] < min(z1 - ON, at):
            at = p.bends[i]
    if at == np.inf:
        return 1.0
    lo, hi, rise, a, b = 0.0, 1.0, z1 - z, -h * s[VF], -h * s1[VF]
    for _ in range(30):
        share = 0.5 * (lo + hi)
        if z + share * (a + share * (3.0 * rise - 2.0 * a - b + share * (a + b - 2.0 * rise))) < at:
            lo = share
        else:
            hi = share
    return hi


@kernel
def first_step(s: Array, acceleration: float, p: Packed) -> float:
    """Step [s] to begin an intrusion with: a share of the time in which drag stops the foot or a spring would."""
    swing = 0.6 * np.sqrt(p.m_f / p.k_s)
    return min(swing, 2.0 * abs(s[VF] / acceleration)) if s[VF] < 0.0 and acceleration > 0.0 else swing
