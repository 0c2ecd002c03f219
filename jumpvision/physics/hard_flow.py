"""From arc to arc: the exact events of the hard-ground jumper and what is counted on the way.

Lift-off and touchdown are found by steps that cannot pass a root: with f <= 0 and |f'''| <= J on the arc, f stays
below the cubic f + f' h + f'' h^2/2 + J h^3/6, so a step to the first positive root of that cubic is safe, and near a
simple root the steps converge with third order. No contact is missed, however short, down to rounding (about 1e-18 m
here). Maxima between steps are the changes of sign of a rate, refined to rounding.

Zeno: with a massless foot contacts do not accumulate in finite time: the acceleration is bounded, the velocity
continuous but for the loss at touchdown, which never turns it round. Nothing has to be stopped. But contacts are lost
and regained at grazing speed: a flight that leaves AND lands slower than GRAZE (it rises less than 1e-12 m at 1 m/s^2)
is integrated like any other, but not counted and not listed.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

from jumpvision.physics.hard_arc import (
    ARC_SIZE,
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
STRIDE = 1.0  # rad of the fastest oscillation in a step: extrema between steps show as a change of sign of the rate
ROUNDING = 1e-15
SETTLED_RISE = 1e-10  # m
HEIGHT, FORCE, POWER = 0, 1, 2
END, CROSSING, SETTLED = 0, 1, 2


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
def top(
    arc: Arc, lo: float, hi: float, ends: tuple[float, float, float, float], which: int, q: float, g: float, best: float
) -> float:
    """The greater of best and the maximum of a quantity on a step; ends: value and rate at lo, then at hi."""
    y0, r0, y1, r1 = ends
    best = max(best, y1)
    if r0 <= 0.0 or r1 >= 0.0:
        return best
    if max(y0, y1) + (hi - lo) * max(r0, -r1) ** 2 / (r0 - r1) <= best:  # twice the rise under a straight rate
        return best
    a, b, fa, fb, side = lo, hi, r0, r1, 0
    for _ in range(60):  # regula falsi after Illinois
        m = (a * fb - b * fa) / (fb - fa)
        y, r = quantity(arc, m, which, q, g)
        best = max(best, y)
        if abs(r) <= 1e-7 * (r0 - r1):  # the value is then right to 1e-14 of its rise
            break
        if r > 0.0:
            a, fa = m, r
            if side == 1:
                fb *= 0.5
            side = 1
        else:
            b, fb = m, r
            if side == -1:
                fa *= 0.5
            side = -1
    return best


@nb.njit(cache=True)
def _rounding(arc: Arc, s: float) -> float:
    """How far from zero x [m] may come out where it is zero."""
    poly = abs(arc[P0]) + s * (abs(arc[P1]) + s * (abs(arc[P2]) + s * abs(arc[P3])))
    return ROUNDING * (poly + abs(arc[PS]) + abs(arc[PC]) + abs(arc[HA]) + s * abs(arc[HB]))


@nb.njit(cache=True)
def follow(
    arc: Arc, up: bool, left: float, moving: bool, best: NDArray, q: float, g: float
) -> tuple[float, int, float, float]:
    """Follow an arc to its event or for `left` [s]: how long, how it ended, x and v there.

    best: (3,) greatest HEIGHT, FORCE and POWER so far, updated. An arc ends by CROSSING x = 0, at the END of its piece,
    or SETTLED: grounded with the motor stopped and no way to leave the ground again.
    """
    x, v, a, mx, mv, ma, mj = evaluate(arc, 0.0, q, g)
    y, yv = x + q * mx, v + q * mv
    best[HEIGHT] = max(best[HEIGHT], y)
    if up and not moving:  # a parabola
        s = min((v + math.sqrt(v * v + 2.0 * g * max(x, 0.0))) / g, left)
        rise = max(min(v / g, s), 0.0)
        best[HEIGHT] = max(best[HEIGHT], y + rise * (v - 0.5 * g * rise))
        return s, (END if s == left else CROSSING), x + s * (v - 0.5 * g * s), v - g * s
    f_m, f_r = a + ma + g, (1.0 - q) * mj - 2.0 * arc[GAMMA] * a - arc[W2] * v
    if moving:
        best[FORCE], best[POWER] = max(best[FORCE], f_m), max(best[POWER], f_m * mv)
    sign = -1.0 if up else 1.0
    pace = math.sqrt(arc[W2]) + arc[OMEGA]
    cap = STRIDE / pace if pace > 0.0 else left
    s = 0.0
    while s < left:
        if not moving and v * v + arc[W2] * (x + g / arc[W2]) ** 2 < arc[W2] * SETTLED_RISE**2:
            return left, SETTLED, x, v
        h = safe_step(min(sign * x, 0.0), sign * v, sign * a, arc[JERK], min(cap, left - s))
        s0, s = s, min(max(s + h, s * (1.0 + 4e-16) + 1e-18), left)
        y0, yv0, f0, fr0, p0, pr0 = y, yv, f_m, f_r, f_m * mv, f_r * mv + f_m * ma
        v0 = v
        x, v, a, mx, mv, ma, mj = evaluate(arc, s, q, g)
        y, yv = x + q * mx, v + q * mv
        best[HEIGHT] = top(arc, s0, s, (y0, yv0, y, yv), HEIGHT, q, g, best[HEIGHT])
        f_m, f_r = a + ma + g, (1.0 - q) * mj - 2.0 * arc[GAMMA] * a - arc[W2] * v
        if moving:
            best[FORCE] = top(arc, s0, s, (f0, fr0, f_m, f_r), FORCE, q, g, best[FORCE])
            ends = (p0, pr0, f_m * mv, f_r * mv + f_m * ma)
            best[POWER] = top(arc, s0, s, ends, POWER, q, g, best[POWER])
        if sign * v > 0.0 and sign * x >= -_rounding(arc, s):
            return s, CROSSING, x, v
        if not moving and v0 > 0.0 >= v:  # the first crest of a free ring-down is its highest
            return left, SETTLED, x, v
    return left, END, x, v


@nb.njit(cache=True)
def motor(piece: NDArray, tau: float) -> tuple[float, float, float]:
    """X_m [m] and its first two derivatives at tau [s] into a piece."""
    angle = piece[7] * tau + piece[8]
    sin, cos = piece[6] * math.sin(angle), piece[6] * piece[7] * math.cos(angle)
    mx = ((piece[5] * tau + piece[4]) * tau + piece[3]) * tau + piece[2] + sin
    mv = (3.0 * piece[5] * tau + 2.0 * piece[4]) * tau + piece[3] + cos
    return mx, mv, 6.0 * piece[5] * tau + 2.0 * piece[4] - piece[7] * piece[7] * sin


@nb.njit(cache=True)
def simulate(
    pieces: NDArray,
    q: float,
    g: float,
    w2: float,
    gam: float,
    keep: float,
    t_end: float,
    rows: NDArray,
    flights: NDArray,
) -> tuple[int, int, int, float, float, float, float, float, float, bool]:
    """One jump from rest.

    pieces: (n, 9) forcing rows of hard_arc.make_arc. keep: sqrt(1 - e). t_end [s]: not before the forcing ends; inf:
    the landing of the first flight that begins after the forcing, or when none can follow. rows (m, 2 + ARC_SIZE):
    start, end and fields of the arcs; flights (m, 2): lift-off and landing [s]; both are filled as far as they go.

    Returns the numbers of arcs, of flights and of jumps (flights up to the first that ends after the forcing), the
    first lift-off [s] (NaN if none), the greatest y - y_rest and, after the forcing, x_r + M g/k [m], the
    duration of the longest flight that ends after the forcing [s], the peaks of F_m/m_m and F_m X_m'/m_m during the
    forcing, and whether the robot is in the air at the end.
    """
    n = pieces.shape[0]
    free = np.zeros(9)
    free[0], free[1] = pieces[n - 1, 1], t_end
    best = np.full(3, -math.inf)
    x, v, motor_v = -g / w2, 0.0, 0.0
    rest = x + q * motor(pieces[0], 0.0)[0]
    n_arcs, n_flights, n_jumps = 0, 0, 0
    first, longest, com = math.nan, 0.0, 0.0
    airborne, lift, lift_v, landing_v = False, 0.0, 0.0, 0.0
    for i in range(n + 1):
        piece = pieces[i] if i < n else free
        if i == n:
            free[2] = motor(pieces[n - 1], pieces[n - 1, 1] - pieces[n - 1, 0])[0]
        mv = motor(piece, 0.0)[1]
        v -= q * (mv - motor_v)  # y' does not jump
        if i == n:
            com, best[HEIGHT] = best[HEIGHT] - rest, x + q * free[2]
        tau, length = 0.0, piece[1] - piece[0]
        while tau < length:
            now = piece[0] + tau
            up = x > 0.0 or (x == 0.0 and (v > 0.0 or (v == 0.0 and -g - q * motor(piece, tau)[2] > 0.0)))
            if up and not airborne:
                lift, lift_v = now, v
                if n_flights < flights.shape[0]:
                    flights[n_flights, 0], flights[n_flights, 1] = now, math.nan
            if airborne and not up and max(lift_v, landing_v) > GRAZE:
                if n_flights < flights.shape[0]:
                    flights[n_flights, 1] = now
                n_flights += 1
                if n_flights == 1:
                    first = lift
                if i == n:
                    longest = max(longest, now - lift)
                    if n_jumps == 0:
                        n_jumps = n_flights
                if i == n and lift >= free[0] and math.isinf(t_end):
                    airborne = False
                    break
            airborne = up
            arc = make_arc(not up, piece, tau, length - tau, x, v, q, g, w2, gam)
            s, ended, x, v = follow(arc, up, length - tau, i < n, best, q, g)
            if n_arcs < rows.shape[0]:
                rows[n_arcs, 0], rows[n_arcs, 1] = now, now + s
                for j in range(ARC_SIZE):
                    rows[n_arcs, 2 + j] = arc[j]
            n_arcs += 1
            tau = length if ended != CROSSING else tau + s
            if ended == CROSSING:
                x = 0.0
                if up:
                    landing_v = -v
                    v *= keep
        motor_v = motor(piece, length)[1] if i < n else 0.0
    if airborne:
        n_flights += 1
        if n_flights == 1:
            first = lift
    if n_jumps == 0:
        n_jumps = n_flights
    com = max(com, best[HEIGHT] - rest)
    rod = best[HEIGHT] - q * free[2] + g / w2
    return n_arcs, n_flights, n_jumps, first, com, rod, longest, best[POWER], best[FORCE], airborne
