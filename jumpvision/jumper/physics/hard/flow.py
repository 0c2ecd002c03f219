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

from jumpvision.base.arrays import Array
from jumpvision.jumper.physics.forcing import INLINE, KERNEL, sincos

from .arc import (
    AMP,
    ARC_SIZE,
    D0,
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
    drive,
    evaluate,
    make_arc,
)

Best = tuple[float, float, float]

GRAZE = 1e-6  # m/s
HEIGHT, FORCE, POWER = 0, 1, 2
END, CROSSING, SETTLED = 0, 1, 2


@nb.njit(**INLINE)
def _newton(f: float, f1: float, c2: float, c3: float, h: float) -> float:
    """A root of the cubic f + f1 h + c2 h^2 + c3 h^3 from h, where the iteration is monotone after its first step."""
    for _ in range(100):
        slope = f1 + h * (2.0 * c2 + h * (3.0 * c3))
        if slope <= 0.0:
            break
        step = (f + h * (f1 + h * (c2 + h * c3))) / slope
        h -= step
        if abs(step) <= 1e-7 * abs(h):  # the error is its square
            break
    return h


@nb.njit(**INLINE)
def safe_step(f: float, f1: float, f2: float, j: float, cap: float) -> float:
    """The first positive root of f + f1 h + f2 h^2/2 + j h^3/6 (f <= 0, j >= 0), or cap if that comes first."""
    c2, c3 = 0.5 * f2, j * (1.0 / 6.0)
    humped = f1 > 0.0 and f2 < 0.0
    beyond = f + cap * (f1 + cap * (c2 + cap * c3)) > 0.0
    if not humped and not beyond:
        return cap
    start = math.inf
    disc = f1 * f1 - 2.0 * f * f2
    if disc >= 0.0 and (f1 > 0.0 or f2 > 0.0):  # without j the root comes later, and the cubic rises from here to there
        start = -2.0 * f / (f1 + math.sqrt(disc)) if f1 > 0.0 else (math.sqrt(disc) - f1) / f2
    if start > cap and humped:
        disc = f2 * f2 - 2.0 * j * f1
        h = 2.0 * f1 / (-f2 + math.sqrt(disc)) if disc > 0.0 else math.inf
        # no hump, or one above zero at h: the root lies before it; else beyond the dip that follows
        if disc <= 0.0 or f + h * (f1 + h * (c2 + h * c3)) >= 0.0:
            start = 0.0
    if start > cap and not beyond:
        return cap
    return min(_newton(f, f1, c2, c3, min(start, cap)), cap)


@nb.njit(**KERNEL)
def quantity(arc: Arc, s: float, which: int, q: float, g: float) -> tuple[float, float, float]:
    """A height (x + q X), F_m / m_m or F_m X_m' / m_m, and its first two derivatives."""
    x, v, a, mx, mv, ma, mj = evaluate(arc, s, q, g)
    if which == HEIGHT:
        return x + q * mx, v + q * mv, a + q * ma
    om = arc[OMEGA]
    ms = om * om * (6.0 * arc[D3] * s + 2.0 * arc[D2] - ma)  # of the sinusoid, X'''' = -omega^2 X''
    jerk = -q * mj - 2.0 * arc[GAMMA] * a - arc[W2] * v
    force, rate, bend = a + ma + g, jerk + mj, (1.0 - q) * ms - 2.0 * arc[GAMMA] * jerk - arc[W2] * a
    if which == FORCE:
        return force, rate, bend
    return force * mv, rate * mv + force * ma, bend * mv + 2.0 * rate * ma + force * mj


@nb.njit(**KERNEL)
def _crest(
    arc: Arc, lo: float, hi: float, ends: tuple[float, float, float, float], which: int, q: float, g: float, best: float
) -> float:
    """The greater of best and the maximum of a quantity on a step at whose ends its rate changes from + to -."""
    y0, r0, y1, r1 = ends
    h = hi - lo
    # Newton's steps from the crest of the cubic through the ends, halving where they leave the bracket
    c = 6.0 * (y1 - y0) / h - 3.0 * (r0 + r1)
    b = r1 - r0 + c
    root = math.sqrt(max(b * b + 4.0 * c * r0, 0.0))
    m = lo + h * min(2.0 * r0 / (root - b) if b < 0.0 else (root + b) / (2.0 * c), 1.0)
    for _ in range(60):
        y, r, bend = quantity(arc, m, which, q, g)
        best = max(best, y)
        if r > 0.0:
            lo = m
        else:
            hi = m
        step = -r / bend if bend < 0.0 else math.inf
        if abs(step) <= 3e-5 * h:  # the parabola's crest is then right to 1e-14 of the rise
            return max(best, y + 0.5 * r * step)
        m += step
        if not lo < m < hi:
            m = 0.5 * (lo + hi)
    return best


@nb.njit(**INLINE)
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
    return _crest(arc, lo, hi, ends, which, q, g, best)


@nb.njit(**INLINE)
def _rounding(arc: Arc, s: float) -> float:
    """How far from zero x [m] may come out where it is zero."""
    poly = abs(arc[P0]) + s * (abs(arc[P1]) + s * (abs(arc[P2]) + s * abs(arc[P3])))
    return 1e-15 * (poly + abs(arc[PS]) + abs(arc[PC]) + abs(arc[HA]) + s * abs(arc[HB]))


@nb.njit(**KERNEL)
def _most(arc: Arc, length: float) -> tuple[float, float]:
    """Bounds of |X''| and |X'| for `length` [s]."""
    accel = 6.0 * abs(arc[D3]) * length + 2.0 * abs(arc[D2]) + arc[AMP] * arc[OMEGA] * arc[OMEGA]
    speed = (3.0 * abs(arc[D3]) * length + 2.0 * abs(arc[D2])) * length + abs(arc[D1]) + arc[AMP] * arc[OMEGA]
    return accel, speed


@nb.njit(**INLINE)
def follow(
    arc: Arc, up: bool, left: float, moving: bool, x: float, v: float, best: Best, q: float, g: float
) -> tuple[float, int, float, float, Best]:
    """Follow an arc from x, v to its event or for `left` [s]: how long, how it ended, x, v and best there.

    best: greatest HEIGHT, FORCE and POWER so far. An arc ends by CROSSING x = 0, at the END of its piece, or SETTLED:
    grounded with the motor stopped and no way to leave the ground again.
    """
    sign = -1.0 if up else 1.0
    height, force, power = best
    if up and not moving:  # a parabola
        s = min((v + math.sqrt(v * v + 2.0 * g * max(x, 0.0))) / g, left)
        rise = max(min(v / g, s), 0.0)
        crest = x + q * arc[D0] + rise * (v - 0.5 * g * rise)
        end = END if s == left else CROSSING
        return s, end, x + s * (v - 0.5 * g * s), v - g * s, (max(height, crest), force, power)
    mx, mv, ma, mj, _, _ = drive(arc, 0.0)
    a = -g - q * ma - 2.0 * arc[GAMMA] * v - arc[W2] * x
    y, yv = x + q * mx, v + q * mv
    height = max(height, y)
    start_y, start_yv = y, yv
    f_m, f_r = a + ma + g, (1.0 - q) * mj - 2.0 * arc[GAMMA] * a - arc[W2] * v
    p, p_r = f_m * mv, f_r * mv + f_m * ma
    pace, watch = math.sqrt(arc[W2]) + arc[OMEGA], moving
    if moving:
        force, power = max(force, f_m), max(power, p)
    else:
        pace /= 3.0  # rad of a free oscillation, whose extrema are pi or more apart
    if up:  # F_m = (m_m - q m_m) X'': most often it cannot reach what it was on the ground
        accel, speed = _most(arc, left)
        watch = (1.0 - q) * accel > force or (1.0 - q) * accel * speed > power
        if not watch:
            pace = 0.0
    cap = 1.0 / pace if pace > 0.0 else left  # rad: extrema between steps show as a change of sign of the rate
    s, ended = 0.0, END
    while s < left:
        if not moving and v * v + arc[W2] * (x + g / arc[W2]) ** 2 < arc[W2] * 1e-10**2:  # m
            ended = SETTLED
            break
        h = safe_step(min(sign * x, 0.0), sign * v, sign * a, arc[JERK], min(cap, left - s))
        s0, s = s, min(max(s + h, s * (1.0 + 4e-16) + 1e-18), left)
        v0, y0, yv0, f0, fr0, p0, pr0 = v, y, yv, f_m, f_r, p, p_r
        x, v, a, mx, mv, ma, mj = evaluate(arc, s, q, g)
        if not up:
            y, yv = x + q * mx, v + q * mv
            height = top(arc, s0, s, (y0, yv0, y, yv), HEIGHT, q, g, height)
        if watch:
            f_m, f_r = a + ma + g, (1.0 - q) * mj - 2.0 * arc[GAMMA] * a - arc[W2] * v
            p, p_r = f_m * mv, f_r * mv + f_m * ma
            force = top(arc, s0, s, (f0, fr0, f_m, f_r), FORCE, q, g, force)
            power = top(arc, s0, s, (p0, pr0, p, p_r), POWER, q, g, power)
        if sign * v > 0.0 and sign * x >= -_rounding(arc, s):
            ended = CROSSING
            break
        if not moving and v0 > 0.0 >= v:  # the first crest of a free ring-down is its highest
            ended = SETTLED
            break
    if up:  # y'' = -g, whatever the motor does
        rise = max(min(start_yv / g, s), 0.0)
        height = max(height, start_y + rise * (start_yv - 0.5 * g * rise))
    return (left if ended == SETTLED else s), ended, x, v, (height, force, power)


@nb.njit(**INLINE)
def row(p: Array, i: int) -> tuple[float, ...]:
    """A forcing piece as a tuple: no counting of references."""
    return p[i, 0], p[i, 1], p[i, 2], p[i, 3], p[i, 4], p[i, 5], p[i, 6], p[i, 7], p[i, 8]


@nb.njit(**INLINE)
def motor(piece: Array | tuple[float, ...], tau: float) -> tuple[float, float, float]:
    """X_m [m] and its first two derivatives at tau [s] into a piece."""
    sin, cos = sincos(piece[7] * tau + piece[8])
    sin, cos = piece[6] * sin, piece[6] * piece[7] * cos
    mx = ((piece[5] * tau + piece[4]) * tau + piece[3]) * tau + piece[2] + sin
    mv = (3.0 * piece[5] * tau + 2.0 * piece[4]) * tau + piece[3] + cos
    return mx, mv, 6.0 * piece[5] * tau + 2.0 * piece[4] - piece[7] * piece[7] * sin


@nb.njit(**KERNEL)
def follow_jump(
    pieces: Array,
    q: float,
    g: float,
    w2: float,
    gam: float,
    keep: float,
    t_end: float,
    rows: Array,
    flights: Array,
) -> tuple[int, int, int, float, float, float, float, float, float, bool]:
    """One jump from rest.

    pieces: (n + 1, 9) forcing rows of hard_arc.make_arc; the last, for the motor at rest, is filled in here. keep:
    sqrt(1 - e). t_end [s]: not before the forcing ends; inf: the landing of the first flight that begins after the
    forcing, or when none can follow. rows (m, 2 + ARC_SIZE): start, end and fields of the arcs; flights (m, 2):
    lift-off and landing [s]; both are filled as far as they go.

    Returns the numbers of arcs, of flights and of jumps (flights up to the first that ends after the forcing), the
    first lift-off [s] (NaN if none), the greatest y - y_rest and, after the forcing, x_r + M g/k [m], the
    duration of the longest flight that ends after the forcing [s], the peaks of F_m/m_m and F_m X_m'/m_m during the
    forcing, and whether the robot is in the air at the end.
    """
    n = pieces.shape[0] - 1
    for j in range(9):
        pieces[n, j] = 0.0
    pieces[n, 0], pieces[n, 1] = pieces[n - 1, 1], t_end
    best = (-math.inf, -math.inf, -math.inf)
    x, v, motor_v = -g / w2, 0.0, 0.0
    rest = 0.0
    n_arcs, n_flights, n_jumps = 0, 0, 0
    first, longest, com = math.nan, 0.0, 0.0
    airborne, lift, lift_v, landing_v = False, 0.0, 0.0, 0.0
    for i in range(n + 1):
        piece = row(pieces, i)
        mx, mv, _ = motor(piece, 0.0) if i < n else (piece[2], 0.0, 0.0)
        v -= q * (mv - motor_v)  # y' does not jump
        if i == 0:
            rest = x + q * mx
        if i == n:
            com, best = best[HEIGHT] - rest, (x + q * mx, best[FORCE], best[POWER])
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
                if i == n and lift >= piece[0] and math.isinf(t_end):
                    airborne = False
                    break
            airborne = up
            arc = make_arc(not up, piece, tau, length - tau, x, v, q, g, w2, gam)
            s, ended, x, v, best = follow(arc, up, length - tau, i < n, x, v, best, q, g)
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
        if i < n:
            pieces[n, 2], motor_v, _ = motor(piece, length)
    if airborne:
        n_flights += 1
        if n_flights == 1:
            first = lift
    if n_jumps == 0:
        n_jumps = n_flights
    com = max(com, best[HEIGHT] - rest)
    rod = best[HEIGHT] - q * pieces[n, 2] + g / w2
    return n_arcs, n_flights, n_jumps, first, com, rod, longest, best[POWER], best[FORCE], airborne
