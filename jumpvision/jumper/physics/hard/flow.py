"""From event to event: one jump of the hard-ground jumper, and what is counted on the way.

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
    acceleration,
    evaluate,
    make_arc,
    motor_at,
)

State = tuple[float, float, float, float, float, float, float]  # x, x', x'' of the rod, X, X', X'', X''' of the motor
Derived = tuple[float, float, float, float]  # a quantity and three derivatives
Peaks = tuple[float, float, float]  # greatest y [m], F_m / m_m and F_m X_m' / m_m
HEIGHT, FORCE, POWER = 0.0, 1.0, 2.0  # what `crest` looks at; of an integer it would be compiled once for each

GRAZE = 1e-6  # m/s


@nb.njit(**KERNEL)
def motor(piece: Array | tuple[float, ...], tau: float) -> tuple[float, float, float]:
    """Return X_m [m] and its first two derivatives at tau [s] into a piece."""
    sin, cos = sincos(piece[7] * tau + piece[8])
    sin, cos = piece[6] * sin, piece[6] * piece[7] * cos
    mx = ((piece[5] * tau + piece[4]) * tau + piece[3]) * tau + piece[2] + sin
    mv = (3.0 * piece[5] * tau + 2.0 * piece[4]) * tau + piece[3] + cos
    return mx, mv, 6.0 * piece[5] * tau + 2.0 * piece[4] - piece[7] * piece[7] * sin


@nb.njit(**INLINE)
def cubic(f: float, f1: float, f2: float, j: float, h: float) -> float:
    """Return f + f1 h + f2 h^2/2 + j h^3/6."""
    return f + h * (f1 + h * (0.5 * f2 + h * (j * (1.0 / 6.0))))


@nb.njit(**INLINE)
def safe_step(f: float, f1: float, f2: float, j: float, cap: float) -> float:
    """Return the first positive root of the cubic (f <= 0, j >= 0), or `cap` where that comes first."""
    humped = f1 > 0.0 and f2 < 0.0
    if cubic(f, f1, f2, j, cap) <= 0.0 and (not humped or f1 * f1 <= 2.0 * f2 * (f + j * (1.0 / 6.0) * cap**3)):
        return cap  # a hump stays below zero also where it is lifted by all that j adds
    h, disc = cap, f1 * f1 - 2.0 * f * f2
    if disc >= 0.0 and (f1 > 0.0 or f2 > 0.0):  # without j the root comes later, and the cubic rises from here to there
        root = math.sqrt(disc)
        h = min(cap, -2.0 * f / (f1 + root) if f1 > 0.0 else (root - f1) / f2)
    elif humped:
        disc = f2 * f2 - 2.0 * j * f1
        top = 2.0 * f1 / (-f2 + math.sqrt(max(disc, 0.0)))
        if disc <= 0.0 or cubic(f, f1, f2, j, top) >= 0.0:
            h = 0.0  # the root lies before the top, else beyond the dip that follows
        elif cubic(f, f1, f2, j, cap) <= 0.0:
            return cap
    for _ in range(100):  # Newton's steps do not pass a hump, and come down to a root behind a dip from above
        slope = f1 + h * (f2 + h * (0.5 * j))
        if not slope > 0.0:
            break
        value, bend = cubic(f, f1, f2, j, h), 0.0 if humped else f2 + h * j
        step = value * slope / (slope * slope - 0.5 * value * bend)
        h -= step
        if abs(step) <= (1e-7 if humped else 1e-5) * abs(h):  # the error is its square, or third power
            break
    return min(max(h, 0.0), cap)


@nb.njit(**INLINE)
def height_at(at: State, arc: Arc, q: float) -> Derived:
    """Return x + q X with three derivatives."""
    x, v, a, mx, mv, ma, _ = at
    return x + q * mx, v + q * mv, a + q * ma, -2.0 * arc[GAMMA] * a - arc[W2] * v


@nb.njit(**INLINE)
def force_at(at: State, s: float, arc: Arc, q: float, g: float) -> Derived:
    """Return F_m / m_m = x'' + X'' + g with three derivatives."""
    _, v, a, _, _, ma, mj = at
    c, w, om2 = 2.0 * arc[GAMMA], arc[W2], arc[OMEGA] * arc[OMEGA]
    # of a sinusoid X, the fourth derivative is -omega^2 X''; the fifth likewise
    m4, m5 = om2 * (6.0 * arc[D3] * s + 2.0 * arc[D2] - ma), om2 * (6.0 * arc[D3] - mj)
    jerk = -q * mj - c * a - w * v
    fourth = -q * m4 - c * jerk - w * a
    return a + ma + g, jerk + mj, fourth + m4, (1.0 - q) * m5 - c * fourth - w * jerk


@nb.njit(**INLINE)
def power_at(force: Derived, at: State, s: float, arc: Arc) -> Derived:
    """Return F_m X_m' / m_m with three derivatives, of the force's."""
    f, f1, f2, f3 = force
    _, _, _, _, mv, ma, mj = at
    m4 = arc[OMEGA] * arc[OMEGA] * (6.0 * arc[D3] * s + 2.0 * arc[D2] - ma)
    return f * mv, f1 * mv + f * ma, f2 * mv + 2.0 * f1 * ma + f * mj, f3 * mv + 3.0 * (f2 * ma + f1 * mj) + f * m4


@nb.njit(**INLINE)
def raise_maximum(
    best: float, which: float, arc: Arc, q: float, g: float, start: float, end: float, before: Derived, after: Derived
) -> float:
    """Return `best`, or the maximum of a quantity on the step from start to end [s] where that is greater."""
    (y0, r0, b0, _), (y1, r1, b1, _), h = before, after, end - start
    best, steepest, fall = max(best, y1), max(r0, -r1), r0 - r1
    # twice the rise under a straight rate is above the best
    if not (r0 > 0.0 > r1 and h * steepest * steepest > (best - max(y0, y1)) * fall):
        return best
    m, c, d = r0 / fall, -3.0 * fall - h * (2.0 * b0 + b1), 2.0 * fall + h * (b0 + b1)
    for _ in range(2):  # of the rate: the cubic with these values and slopes at both ends, of the step as 1
        m -= (r0 + m * (h * b0 + m * (c + m * d))) / (h * b0 + m * (2.0 * c + m * 3.0 * d))
    return crest(best, which, arc, q, g, start, end, start + min(max(m, 0.0), 1.0) * h)


@nb.njit(**KERNEL)
def crest(best: float, which: float, arc: Arc, q: float, g: float, start: float, end: float, m: float) -> float:
    """Return `best`, or the maximum of a quantity between two times [s] with a rate > 0 and < 0, from near m [s]."""
    lo, hi, h = start, end, end - start
    for _ in range(60):
        at = evaluate(arc, m, q, g)
        y, r, bend, third = height_at(at, arc, q) if which == HEIGHT else force_at(at, m, arc, q, g)
        if which == POWER:
            y, r, bend, third = power_at((y, r, bend, third), at, m, arc)
        best = max(best, y)
        if r > 0.0:
            lo = m
        else:
            hi = m
        move = -r / bend if bend < 0.0 else math.inf
        if abs(move) <= 4e-4 * h:  # the crest of the cubic is then right to 1e-14 of the rise
            return max(best, y + move * (0.5 * r + move * move * third / 6.0))
        m += move
        if not lo < m < hi:
            m = 0.5 * (lo + hi)
    return best


@nb.njit(**INLINE)
def _rounding(arc: Arc, s: float) -> float:
    """Return how far from zero x [m] may come out where it is zero."""
    poly = abs(arc[P0]) + s * (abs(arc[P1]) + s * (abs(arc[P2]) + s * abs(arc[P3])))
    return 1e-15 * (poly + abs(arc[PS]) + abs(arc[PC]) + abs(arc[HA]) + s * abs(arc[HB]))


@nb.njit(**KERNEL)
def _is_still(x: float, v: float, w2: float, g: float) -> bool:
    """Return whether the grounded rod swings by less than 1e-10 m."""
    return v * v + w2 * (x + g / w2) ** 2 < w2 * 1e-10**2


@nb.njit(**KERNEL)
def _most(arc: Arc, length: float) -> tuple[float, float]:
    """Return bounds of |X''| and |X'| for `length` [s]."""
    accel = 6.0 * abs(arc[D3]) * length + 2.0 * abs(arc[D2]) + arc[AMP] * arc[OMEGA] * arc[OMEGA]
    speed = (3.0 * abs(arc[D3]) * length + 2.0 * abs(arc[D2])) * length + abs(arc[D1]) + arc[AMP] * arc[OMEGA]
    return accel, speed


@nb.njit(**KERNEL)
def follow_arc(
    arc: Arc, turn: tuple[float, float], up: bool, moving: bool, left: float, x: float, v: float, q: float, g: float,
    peaks: Peaks,
) -> tuple[float, float, float, bool, Peaks]:  # fmt: skip
    """Follow an arc from x [m], v [m/s], in the air or not, for `left` [s] at most: time, x, v, contact changed, peaks.

    turn: sine and cosine of its phase. A free ring-down ends at its first crest, which is its highest.
    """
    top, force_peak, power_peak = peaks
    mx, mv, ma, mj = motor_at(arc, 0.0, turn[0], turn[1])
    a = acceleration(arc, x, v, ma, q, g)
    at = (x, v, a, mx, mv, ma, mj)
    height, force = height_at(at, arc, q), force_at(at, 0.0, arc, q, g)
    power = power_at(force, at, 0.0, arc)
    top = max(top, height[0])
    rate, watched = math.sqrt(arc[W2]) + arc[OMEGA], moving
    if moving:
        force_peak, power_peak = max(force_peak, force[0]), max(power_peak, power[0])
    else:
        if _is_still(x, v, arc[W2], g):
            return left, x, v, False, (top, force_peak, power_peak)
    if up:  # F_m = (m_m - q m_m) X'': most often it cannot reach what it was on the ground
        accel, speed = _most(arc, left)
        watched = (1.0 - q) * accel > force_peak or (1.0 - q) * accel * speed > power_peak
    # at most 3 rad of any sinusoid, a power's too: extrema between steps show as a change of sign of the rate
    cap, sign, s = (1.5 if moving else 3.0) / rate if watched or not up else left, (-1.0 if up else 1.0), 0.0
    while True:
        start, v_before = s, v
        h = safe_step(min(sign * x, 0.0), sign * v, sign * a, arc[JERK], min(cap, left - s))
        if arc[JERK] * h**3 <= 3.0 * _rounding(arc, s) and s + h < left:  # Taylor's series is right to rounding
            v_after = v + h * (a - 0.5 * h * (q * at[6] + 2.0 * arc[GAMMA] * a + arc[W2] * v))
            if sign * v_after > 0.0:
                if not up:
                    top = max(top, cubic(*height, h))
                if watched:
                    force_peak, power_peak = max(force_peak, cubic(*force, h)), max(power_peak, cubic(*power, h))
                return s + h, 0.0, v_after, True, (top, force_peak, power_peak)
        s = min(max(s + h, s * (1.0 + 4e-16) + 1e-18), left)
        at = evaluate(arc, s, q, g)
        x, v, a, _, _, _, _ = at
        if not up:
            before, height = height, height_at(at, arc, q)
            top = raise_maximum(top, HEIGHT, arc, q, g, start, s, before, height)
        if watched:
            before, force = force, force_at(at, s, arc, q, g)
            force_peak = raise_maximum(force_peak, FORCE, arc, q, g, start, s, before, force)
            before, power = power, power_at(force, at, s, arc)
            power_peak = raise_maximum(power_peak, POWER, arc, q, g, start, s, before, power)
        if sign * v > 0.0 and sign * x >= -_rounding(arc, s):
            return s, x, v, True, (top, force_peak, power_peak)
        if s >= left or (not moving and ((v_before > 0.0 and v <= 0.0) or _is_still(x, v, arc[W2], g))):
            return s, x, v, False, (top, force_peak, power_peak)


@nb.njit(**KERNEL)
def follow_jump(
    pieces: Array, robot: Array, t_end: float, rows: Array, flights: Array
) -> tuple[int, int, int, float, float, float, float, float, float, bool]:
    """Follow one jump from rest.

    pieces: (r, 9), as in arc.make_arc. robot (6,): the arguments of hard_jump in their order. t_end [s]: not before the
    forcing ends; inf: the landing of the first flight that begins after the forcing, or when none can follow. rows
    (m, 1 + ARC_SIZE): start and fields of the arcs; flights (k, 2): lift-off and landing [s]; both are filled as far
    as they go.

    Returns the numbers of arcs, of flights and of jumps (flights up to the first that ends after the forcing), the
    first lift-off [s] (NaN if none), the greatest y - y_rest and, after the forcing, x_r + M g/k [m], the duration of
    the longest flight that ends after the forcing [s], the peaks of F_m X_m'/m_m and F_m/m_m during the forcing, and
    whether the robot is in the air at the end.
    """
    n, mass = pieces.shape[0], robot[0] + robot[1]
    q, g, w2, gam, keep = robot[0] / mass, robot[4], robot[2] / mass, 0.5 * robot[3] / mass, math.sqrt(1.0 - robot[5])
    x, v, airborne, peaks = -g / w2, 0.0, False, (-math.inf, -math.inf, -math.inf)
    n_arcs, n_flights, n_jumps = 0, 0, 0
    first, lift, lift_v, landing_v, longest = math.nan, 0.0, 0.0, 0.0, 0.0
    motor_x, motor_v, rest, com = 0.0, 0.0, 0.0, 0.0
    for i in range(n + 1):
        moving, p = i < n, pieces[min(i, n - 1)]
        piece = (p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8])
        if not moving:
            piece = (p[1], t_end, motor_x, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        mx, mv, _ = motor(piece, 0.0) if moving else (motor_x, 0.0, 0.0)
        v -= q * (mv - motor_v)  # y' does not jump
        if i == 0:
            rest = x + q * mx
        if not moving:
            com, peaks = peaks[0] - rest, (x + q * mx, peaks[1], peaks[2])
        tau, length = 0.0, piece[1] - piece[0]
        while tau < length:
            now, left, was_up = piece[0] + tau, length - tau, airborne
            airborne = x > 0.0 or (x == 0.0 and (v > 0.0 or (v == 0.0 and -g - q * motor(piece, tau)[2] > 0.0)))
            if airborne and not was_up:
                lift, lift_v = now, v
                if n_flights < flights.shape[0]:
                    flights[n_flights, 0], flights[n_flights, 1] = now, math.nan
            if was_up and not airborne and max(lift_v, landing_v) > GRAZE:
                if n_flights < flights.shape[0]:
                    flights[n_flights, 1] = now
                if n_flights == 0:
                    first = lift
                n_flights += 1
                if not moving:
                    longest = max(longest, now - lift)
                    n_jumps = n_flights if n_jumps == 0 else n_jumps
                    if lift >= piece[0] and math.isinf(t_end):
                        break
            turn = sincos(piece[7] * tau + piece[8]) if piece[6] != 0.0 else (0.0, 0.0)
            arc = make_arc(not airborne, piece, tau, left, turn, x, v, q, g, w2, gam)
            if n_arcs < rows.shape[0]:
                rows[n_arcs, 0] = now
                for j in range(ARC_SIZE):
                    rows[n_arcs, 1 + j] = arc[j]
            n_arcs += 1
            mx, mv, _, _ = motor_at(arc, 0.0, turn[0], turn[1])
            y, y_rate = x + q * mx, v + q * mv
            if airborne and not moving:  # a parabola
                s = min((v + math.sqrt(v * v + 2.0 * g * max(x, 0.0))) / g, left)
                x, v, crossed = x + s * (v - 0.5 * g * s), v - g * s, s != left
            else:
                s, x, v, crossed, peaks = follow_arc(arc, turn, airborne, moving, left, x, v, q, g, peaks)
            if airborne:  # y'' = -g, whatever the motor does
                rise = max(min(y_rate / g, s), 0.0)
                peaks = (max(peaks[0], y + rise * (y_rate - 0.5 * g * rise)), peaks[1], peaks[2])
            tau = tau + s if crossed else length
            if crossed:
                x = 0.0
                if airborne:
                    landing_v = -v
                    v *= keep
        if moving:
            motor_x, motor_v, _ = motor(piece, length)
    height, flown = peaks[0], n_flights + airborne
    return (
        n_arcs,
        flown,
        n_jumps if n_jumps > 0 else flown,
        lift if n_flights == 0 and airborne else first,
        max(com, height - rest),
        height - q * motor_x + g / w2,
        longest,
        peaks[2],
        peaks[1],
        airborne,
    )
