"""The robot at rest: M g on the spring, (M + m_f) g on the ground."""

from __future__ import annotations

import math
from typing import Any

from jumpvision.mechanisms.record import Body

from .granular import HARD, static_force
from .kernel import kernel, summed

DEEPEST = 1e3  # m
springs = summed(Body.SPRING, "stretch, stretch_rate")
slopes = summed(Body.SPRING, "stretch, stretch_rate", part="slope")


@kernel
def squeeze(p: Any) -> float:
    """Compression of the spring e [m] under M g, by Newton from above: a spring that hardens only lets it fall."""
    e = p.M * p.g / p.k_s
    for _ in range(100):
        change = (p.k_s * e + springs(0.0, -e, 0.0, p) - p.M * p.g) / (p.k_s + slopes(0.0, -e, 0.0, p))
        e -= change
        if change <= 1e-16 * e:
            break
    return e


@kernel
def depth(p: Any) -> float:
    """Depth z [m] where the bed carries the robot, F_p(z) = (M + m_f) g; NaN where it cannot."""
    if p.static == HARD:
        return 0.0
    load = (p.M + p.m_f) * p.g
    lo, hi = 0.0, 1e-3
    while static_force(hi, 0.0, 0.0, p) < load:
        lo, hi = hi, 2.0 * hi
        if hi > DEEPEST:
            return math.nan
    f_lo, f_hi = static_force(lo, 0.0, 0.0, p) - load, static_force(hi, 0.0, 0.0, p) - load
    for n in range(200):  # regula falsi, every third step a bisection
        if hi - lo <= 1e-17 + 4e-16 * hi or f_hi == 0.0:
            break
        z = (lo * f_hi - hi * f_lo) / (f_hi - f_lo) if n % 3 else 0.5 * (lo + hi)
        f = static_force(z, 0.0, 0.0, p) - load
        if f < 0.0:
            if z == lo:  # the root to the last bit; the far end of the bracket is not
                return lo
            lo, f_lo = z, f
        else:
            if z == hi:
                break
            hi, f_hi = z, f
    return hi
