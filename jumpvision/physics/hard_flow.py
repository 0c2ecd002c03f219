"""From arc to arc: the exact events of the hard-ground jumper and what is counted on the way.

Lift-off and touchdown are found by steps that cannot pass a root: with f <= 0 and |f'''| <= J on the arc, f stays below
the cubic f + f' h + f'' h^2/2 + J h^3/6, so a step to the first positive root of that cubic is safe; near a simple root
the steps converge with third order. No contact is missed, however short, down to rounding (about 1e-18 m here).

Zeno: with a massless foot there is no accumulation of contacts in finite time (velocity is continuous but for the loss at
touchdown, which never turns it round, and the acceleration is bounded), so nothing has to be stopped. Contacts are lost
and regained at grazing speed, though: a flight that leaves AND lands slower than GRAZE (it rises less than about 1e-12 m)
is integrated like any other, but not counted as a jump.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

from jumpvision.physics.hard_arc import (
    AIR,
    AMP,
    D1,
    D2,
    D3,
    GAMMA,
    HA,
    HB,
    JERK,
    OMEGA,
    P0,
    P1,
    P2,
    P3,
    PC,
    PS,
    W2,
    Arc,
    evaluate,
    make_arc,
)

GRAZE = 1e-6  # m/s
STRIDE = 0.7  # rad of the fastest oscillation in a step: extrema between steps show as a change of sign of the rate
ROUNDING = 1e-15
ARC_SIZE = 20
HEIGHT, FORCE, POWER = 0, 1, 2

# simulate() returns these
N_ARCS, N_FLIGHTS, N_JUMPS, FIRST_LIFT, COM, ROD, FLIGHT, PEAK_POWER, PEAK_FORCE, LANDED = range(10)


@nb.njit(cache=True)
def _newton(f: float, f1: float, f2: float, j: float, h: float) -> float:
    """A root of the cubic f + f1 h + f2 h^2/2 + j h^3/6 from h, where the iteration is monotone."""
    for _ in range(100):
        p = f + h * (f1 + h * (f2 / 2.0 + h * j / 6.0))
        slope = f1 + h * (f2 + h * j / 2.0)
        if slope <= 0.0:
            break
        step = p / slope
        h -= step
        if abs(step) <= 1e-9 * abs(h):
            break
    return h


@nb.njit(cache=True)
def safe_step(f: float, f1: float, f2: float, j: float, cap: float) -> float:
    """The first positive root of f + f1 h + f2 h^2/2 + j h^3/6 (f <= 0, j >= 0), or cap if that comes first."""
    if f1 > 0.0:
        disc = f2 * f2 - 2.0 * j * f1
        if f2 < 0.0 and disc > 0.0:  # a hump at h1: the root lies before it, or beyond the dip that follows
            h1 = 2.0 * f1 / (-f2 + math.sqrt(disc))
            if f + h1 * (f1 + h1 * (f2 / 2.0 + h1 * j / 6.0)) >= 0.0:
                return min(_newton(f, f1, f2, j, 0.0), cap)
        else:
            return min(_newton(f, f1, f2, j, 0.0), cap)
    if f + cap * (f1 + cap * (f2 / 2.0 + cap * j / 6.0)) <= 0.0:
        return cap
    return _newton(f, f1, f2, j, cap)


@nb.njit(cache=True)
def quantity(arc: Arc, s: float, which: int, q: float, g: float) -> tuple[float, float]:
    """A height (x + q X), F_m / m_m or F_m X_m' / m_m, and its rate."""
    x, v, a, mx, mv, ma, mj = evaluate(arc, s, q, g)
    if which == HEIGHT:
        return x + q * mx, v + q * mv
    force, rate = a + ma + g, (1.0 - q) * mj - 2.0 * arc[GAMMA] * a - arc[W2] * v
    if which == FORCE:
        return force, rate
    return force * mv, rate * mv + force * ma


@nb.njit(cache=True)
def top(arc: Arc, lo: float, hi: float, y0: float, r0: float, y1: float, r1: float, which: int, q: float, g: float,
        best: float) -> float:  # fmt: skip
    """The greater of best and the maximum of a quantity between two steps where its rate turns from r0 > 0 to r1 < 0."""
    if max(y0 + r0 * (hi - lo), y1 - r1 * (hi - lo)) <= best and max(y0, y1) + 0.2 * (hi - lo) * (r0 - r1) <= best:
        return best
    a, b, fa, fb = lo, hi, r0, r1
    for _ in range(60):  # Illinois
        m = (a * fb - b * fa) / (fb - fa)
        y, r = quantity(arc, m, which, q, g)
        best = max(best, y)
        if abs(r) <= 1e-8 * (r0 - r1):  # the height is then right to 1e-16 of its rise in the step
            break
        if r > 0.0:
            a, fa, fb = m, r, (0.5 * fb if b != hi or fb != r1 else fb)
        else:
            b, fb, fa = m, r, (0.5 * fa if a != lo or fa != r0 else fa)
    return best
