"""Safe steps along arcs of the hard-ground jumper, LANES arcs at a time.

Lift-off and touchdown are found by steps that cannot pass a root: with f <= 0 and |f'''| <= J on the arc, f stays
below the cubic f + f' h + f'' h^2/2 + J h^3/6, so a step to the first positive root of that cubic is safe, and near a
simple root the steps converge with third order. No contact is missed, however short, down to rounding (about 1e-18 m
here). Maxima between steps are the changes of sign of a rate, refined to rounding.

What all arcs do in a step has no branches, so that a processor takes several at once. A number of a lane stands in
st[NAME + lane], st (SIZE,): LLVM finds that these do not overlap, as it does not for rows of an array.
"""

from __future__ import annotations

import math

import numba as nb

from jumpvision.base.arrays import Array
from jumpvision.jumper.physics.forcing import INLINE, KERNEL, sincos_near

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
    OMEGA_D,
    P0,
    P1,
    P2,
    P3,
    PC,
    PHASE,
    PS,
    W2,
    Arc,
    acceleration,
    evaluate,
    is_odd,
    motor_at,
    rod_near,
)

State = tuple[float, float, float, float, float, float, float]  # x, x', x'' of the rod, X, X', X'', X''' of the motor
Derived = tuple[float, float, float, float]  # a quantity and three derivatives
LANES = 16  # at most; with 8, rows of st lie too near for a loop to take several lanes at once
HEIGHT, FORCE, POWER = 0, LANES, 2 * LANES
# three rows each: the quantities with two derivatives, now and a step before, the greatest so far, whether crests count
VALUE, RATE, BEND, VALUE_BEFORE, RATE_BEFORE, BEND_BEFORE, BEST, WATCHED = (
    ARC_SIZE * LANES + 3 * LANES * k for k in range(8)
)
_ROWS = range(WATCHED + 3 * LANES, WATCHED + 26 * LANES, LANES)
Q, G, BUSY, MOVING, SIGN, ODD, LEFT, CAP, S, S_BEFORE, X, V, V_BEFORE, A, MX, MV, MA, MJ, ENDED, F, F1, F2, H = _ROWS
SIZE = H + LANES
# what ENDED adds up: crests to be refined, and how an arc ends, where it does
CREST, CROSSING, SETTLED, END = 1, 8, 16, 32


@nb.njit(**INLINE)
def arc_of(st: Array, lane: int) -> Arc:
    """The arc of a lane."""
    return (
        st[lane],
        st[LANES + lane],
        st[2 * LANES + lane],
        st[3 * LANES + lane],
        st[4 * LANES + lane],
        st[5 * LANES + lane],
        st[6 * LANES + lane],
        st[7 * LANES + lane],
        st[8 * LANES + lane],
        st[9 * LANES + lane],
        st[10 * LANES + lane],
        st[11 * LANES + lane],
        st[12 * LANES + lane],
        st[13 * LANES + lane],
        st[14 * LANES + lane],
        st[15 * LANES + lane],
        st[16 * LANES + lane],
        st[17 * LANES + lane],
        st[18 * LANES + lane],
        st[19 * LANES + lane],
    )


@nb.njit(**INLINE)
def put_arc(st: Array, lane: int, arc: Arc) -> None:
    """Puts an arc into a lane; a loop over a tuple is a jump through a table."""
    (
        st[lane],
        st[LANES + lane],
        st[2 * LANES + lane],
        st[3 * LANES + lane],
        st[4 * LANES + lane],
        st[5 * LANES + lane],
        st[6 * LANES + lane],
        st[7 * LANES + lane],
        st[8 * LANES + lane],
        st[9 * LANES + lane],
        st[10 * LANES + lane],
        st[11 * LANES + lane],
        st[12 * LANES + lane],
        st[13 * LANES + lane],
        st[14 * LANES + lane],
        st[15 * LANES + lane],
        st[16 * LANES + lane],
        st[17 * LANES + lane],
        st[18 * LANES + lane],
        st[19 * LANES + lane],
    ) = arc


@nb.njit(**INLINE)
def cubic(f: float, f1: float, f2: float, j: float, h: float) -> float:
    """f + f1 h + f2 h^2/2 + j h^3/6."""
    return f + h * (f1 + h * (0.5 * f2 + h * (j * (1.0 / 6.0))))


@nb.njit(**INLINE)
def first_guess(f: float, f1: float, f2: float, j: float, cap: float) -> tuple[float, bool]:
    """From where `nearer` comes to the first positive root of the cubic (f <= 0, j >= 0); cap and False if that comes
    first."""
    humped = (f1 > 0.0) & (f2 < 0.0)
    beyond = cubic(f, f1, f2, j, cap) > 0.0
    disc = f1 * f1 - 2.0 * f * f2
    root = math.sqrt(max(disc, 0.0))
    # without j the root comes later, and the cubic rises from here to there
    start = -2.0 * f / (f1 + root) if f1 > 0.0 else (root - f1) / f2
    start = start if (disc >= 0.0) & ((f1 > 0.0) | (f2 > 0.0)) else math.inf
    disc = f2 * f2 - 2.0 * j * f1
    h = 2.0 * f1 / (-f2 + math.sqrt(max(disc, 0.0)))
    # no hump, or one above zero at h: the root lies before it; else beyond the dip that follows
    before = (start > cap) & humped & ((disc <= 0.0) | (cubic(f, f1, f2, j, h) >= 0.0))
    start = 0.0 if before else start
    is_cap = (not beyond) & ((not humped) | (start > cap))
    return (cap if is_cap else min(start, cap)), not is_cap


@nb.njit(**INLINE)
def nearer(f: float, f1: float, f2: float, j: float, h: float) -> tuple[float, bool]:
    """A step from h, and whether another one is needed: Halley's; Newton's, which cannot pass a hump, before one."""
    value, slope, bend = cubic(f, f1, f2, j, h), f1 + h * (f2 + h * (0.5 * j)), f2 + h * j
    bend = 0.0 if (f1 > 0.0) & (f2 < 0.0) else bend
    rises = slope > 0.0
    step = value * slope / (slope * slope - 0.5 * value * bend) if rises else 0.0
    h -= step
    # the error is its square, or third power
    return h, rises & (abs(step) > (1e-7 if bend == 0.0 else 1e-5) * abs(h))


@nb.njit(**INLINE)
def height_at(at: State, arc: Arc, q: float) -> Derived:
    """x + q X with three derivatives."""
    x, v, a, mx, mv, ma, _ = at
    return x + q * mx, v + q * mv, a + q * ma, -2.0 * arc[GAMMA] * a - arc[W2] * v


@nb.njit(**INLINE)
def force_at(at: State, s: float, arc: Arc, q: float, g: float) -> Derived:
    """F_m / m_m = x'' + X'' + g with three derivatives."""
    _, v, a, _, _, ma, mj = at
    c, w, om2 = 2.0 * arc[GAMMA], arc[W2], arc[OMEGA] * arc[OMEGA]
    # of a sinusoid X, the fourth derivative is -omega^2 X''; the fifth likewise
    m4, m5 = om2 * (6.0 * arc[D3] * s + 2.0 * arc[D2] - ma), om2 * (6.0 * arc[D3] - mj)
    jerk = -q * mj - c * a - w * v
    fourth = -q * m4 - c * jerk - w * a
    return a + ma + g, jerk + mj, fourth + m4, (1.0 - q) * m5 - c * fourth - w * jerk


@nb.njit(**INLINE)
def power_at(force: Derived, at: State, s: float, arc: Arc) -> Derived:
    """F_m X_m' / m_m with three derivatives, of the force's."""
    f, f1, f2, f3 = force
    _, _, _, _, mv, ma, mj = at
    m4 = arc[OMEGA] * arc[OMEGA] * (6.0 * arc[D3] * s + 2.0 * arc[D2] - ma)
    return f * mv, f1 * mv + f * ma, f2 * mv + 2.0 * f1 * ma + f * mj, f3 * mv + 3.0 * (f2 * ma + f1 * mj) + f * m4


@nb.njit(**INLINE)
def _rounding(arc: Arc, s: float) -> float:
    """How far from zero x [m] may come out where it is zero."""
    poly = abs(arc[P0]) + s * (abs(arc[P1]) + s * (abs(arc[P2]) + s * abs(arc[P3])))
    return 1e-15 * (poly + abs(arc[PS]) + abs(arc[PC]) + abs(arc[HA]) + s * abs(arc[HB]))


@nb.njit(**INLINE)
def _is_still(x: float, v: float, w2: float, g: float) -> bool:
    """Whether the grounded rod swings by less than 1e-10 m."""
    return v * v + w2 * (x + g / w2) ** 2 < w2 * 1e-10**2


@nb.njit(**INLINE)
def _may_hold_a_crest(st: Array, which: int, lane: int, known: Derived) -> float:
    """Keeps a quantity; 1.0 where the greatest value so far may be a crest within the step."""
    k, (y1, r1, bend, _) = which + lane, known
    y0, r0 = st[VALUE + k], st[RATE + k]
    st[VALUE_BEFORE + k], st[RATE_BEFORE + k], st[BEND_BEFORE + k] = y0, r0, st[BEND + k]
    st[VALUE + k], st[RATE + k], st[BEND + k] = y1, r1, bend
    watched, best, steepest = st[WATCHED + k] > 0.0, st[BEST + k], max(r0, -r1)
    best = max(best, y1) if watched else best
    st[BEST + k] = best
    # twice the rise under a straight rate is above the best
    may_be = (st[S + lane] - st[S_BEFORE + lane]) * steepest * steepest > (best - max(y0, y1)) * (r0 - r1)
    return 1.0 if watched & (r0 > 0.0) & (r1 < 0.0) & may_be else 0.0


@nb.njit(**KERNEL)
def step(st: Array, lanes: int) -> None:
    """One safe step of every lane that is used; ENDED says what is to be done about it then."""
    for lane in range(lanes):
        sign, cap = st[SIGN + lane], min(st[CAP + lane], st[LEFT + lane] - st[S + lane])
        st[F + lane], st[F1 + lane], st[F2 + lane] = (
            min(sign * st[X + lane], 0.0),
            sign * st[V + lane],
            sign * st[A + lane],
        )
        h, going = first_guess(st[F + lane], st[F1 + lane], st[F2 + lane], st[JERK * LANES + lane], cap)
        st[H + lane], st[ENDED + lane] = h, 1.0 if going else 0.0
    for _ in range(100):
        some = 0
        for lane in range(lanes):
            h, again = nearer(st[F + lane], st[F1 + lane], st[F2 + lane], st[JERK * LANES + lane], st[H + lane])
            going = st[ENDED + lane] > 0.0
            st[H + lane] = h if going else st[H + lane]
            going = going & again
            st[ENDED + lane] = 1.0 if going else 0.0
            some |= 1 if going else 0
        if not some:
            break
    for lane in range(lanes):
        arc, s0, left = arc_of(st, lane), st[S + lane], st[LEFT + lane]
        h = min(st[H + lane], min(st[CAP + lane], left - s0))
        s = min(max(s0 + h, s0 * (1.0 + 4e-16) + 1e-18), left)
        st[S_BEFORE + lane], st[S + lane], st[V_BEFORE + lane] = s0, s, st[V + lane]
        sin, cos = sincos_near(arc[OMEGA] * s + arc[PHASE])
        st[MX + lane], st[MV + lane], st[MA + lane], st[MJ + lane] = motor_at(arc, s, sin, cos)
        st[X + lane], st[V + lane] = rod_near(arc, s, sin, cos)
    for lane in range(lanes):
        if st[ODD + lane] != 0.0:
            x, v, _, mx, mv, ma, mj = evaluate(arc_of(st, lane), st[S + lane], st[Q + lane], st[G + lane])
            st[X + lane], st[V + lane] = x, v
            st[MX + lane], st[MV + lane], st[MA + lane], st[MJ + lane] = mx, mv, ma, mj
    for lane in range(lanes):
        arc, q, g, sign, s = arc_of(st, lane), st[Q + lane], st[G + lane], st[SIGN + lane], st[S + lane]
        x, v, mv, ma, mj = st[X + lane], st[V + lane], st[MV + lane], st[MA + lane], st[MJ + lane]
        a = acceleration(arc, x, v, ma, q, g)
        st[A + lane] = a
        at = (x, v, a, st[MX + lane], mv, ma, mj)
        force = force_at(at, s, arc, q, g)
        todo = float(CREST) * _may_hold_a_crest(st, HEIGHT, lane, height_at(at, arc, q))
        todo += 2.0 * CREST * _may_hold_a_crest(st, FORCE, lane, force)
        todo += 4.0 * CREST * _may_hold_a_crest(st, POWER, lane, power_at(force, at, s, arc))
        crossed = (sign * v > 0.0) & (sign * x >= -_rounding(arc, s))
        # the first crest of a free ring-down is its highest
        settled = (st[MOVING + lane] == 0.0) & (
            ((st[V_BEFORE + lane] > 0.0) & (v <= 0.0)) | _is_still(x, v, arc[W2], g)
        )
        todo += (float(CROSSING) if crossed else 0.0) + (float(SETTLED) if settled else 0.0)
        todo += float(END) if s >= st[LEFT + lane] else 0.0
        st[ENDED + lane] = todo * st[BUSY + lane]


@nb.njit(**INLINE)
def crest(st: Array, lane: int, which: int) -> None:
    """Puts the maximum of a quantity on the last step, at whose ends its rate changes from + to -, into its best."""
    arc, q, g, start, end = arc_of(st, lane), st[Q + lane], st[G + lane], st[S_BEFORE + lane], st[S + lane]
    best, h, lo, hi, k = st[BEST + which + lane], end - start, start, end, which + lane
    m = start + h * _crest_of_quintic(
        st[VALUE + k] - st[VALUE_BEFORE + k],
        (st[RATE_BEFORE + k] * h, st[RATE + k] * h),
        (st[BEND_BEFORE + k] * h * h, st[BEND + k] * h * h),
    )
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
            best = max(best, y + move * (0.5 * r + move * move * third / 6.0))
            break
        m += move
        if not lo < m < hi:
            m = 0.5 * (lo + hi)
    st[BEST + k] = best


@nb.njit(**INLINE)
def _crest_of_quintic(rise: float, rates: tuple[float, float], bends: tuple[float, float]) -> float:
    """Where between 0 and 1 the quintic with these values and derivatives at both ends is about highest."""
    (r0, r1), (b0, b1) = rates, bends
    # where the cubic without the bends is
    c = 6.0 * rise - 3.0 * (r0 + r1)
    b = r1 - r0 + c
    root = math.sqrt(max(b * b + 4.0 * c * r0, 0.0))
    m = min(2.0 * r0 / (root - b) if b < 0.0 else (root + b) / (2.0 * c), 1.0)
    # r0 t + b0 t^2/2 + c3 t^3 + c4 t^4 + c5 t^5
    d, e, f = rise - r0 - 0.5 * b0, r1 - r0 - b0, 0.5 * (b1 - b0)
    c3, c4, c5 = 10.0 * d - 4.0 * e + f, -15.0 * d + 7.0 * e - 2.0 * f, 6.0 * d - 3.0 * e + f
    for _ in range(2):
        rate = r0 + m * (b0 + m * (3.0 * c3 + m * (4.0 * c4 + m * 5.0 * c5)))
        bend = b0 + m * (6.0 * c3 + m * (12.0 * c4 + m * 20.0 * c5))
        m = min(max(m - rate / bend, 0.0), 1.0) if bend < 0.0 else m
    return m


@nb.njit(**INLINE)
def _most(arc: Arc, length: float) -> tuple[float, float]:
    """Bounds of |X''| and |X'| for `length` [s]."""
    accel = 6.0 * abs(arc[D3]) * length + 2.0 * abs(arc[D2]) + arc[AMP] * arc[OMEGA] * arc[OMEGA]
    speed = (3.0 * abs(arc[D3]) * length + 2.0 * abs(arc[D2])) * length + abs(arc[D1]) + arc[AMP] * arc[OMEGA]
    return accel, speed


@nb.njit(**INLINE)
def lay(st: Array, lane: int, arc: Arc, turn: tuple[float, float], up: bool, moving: bool, left: float) -> bool:
    """Lays an arc, in the air or not, into a lane that has x and v of its start, for `left` [s] at most; turn: sine and
    cosine of its phase.

    False: it is at rest, and nothing comes of it.
    """
    q, g, x, v = st[Q + lane], st[G + lane], st[X + lane], st[V + lane]
    put_arc(st, lane, arc)
    mx, mv, ma, mj = motor_at(arc, 0.0, turn[0], turn[1])
    a = acceleration(arc, x, v, ma, q, g)
    at = (x, v, a, mx, mv, ma, mj)
    height, force = height_at(at, arc, q), force_at(at, 0.0, arc, q, g)
    power = power_at(force, at, 0.0, arc)
    st[BEST + HEIGHT + lane] = max(st[BEST + HEIGHT + lane], height[0])
    if moving:
        st[BEST + FORCE + lane] = max(st[BEST + FORCE + lane], force[0])
        st[BEST + POWER + lane] = max(st[BEST + POWER + lane], power[0])
    pace, watched = math.sqrt(arc[W2]) + arc[OMEGA], moving
    if not moving:
        pace /= 3.0  # rad of a free oscillation, whose extrema are pi or more apart
    if up:  # F_m = (m_m - q m_m) X'': most often it cannot reach what it was on the ground
        accel, speed = _most(arc, left)
        watched = (1.0 - q) * accel > st[BEST + FORCE + lane] or (1.0 - q) * accel * speed > st[BEST + POWER + lane]
        if not watched:
            pace = 0.0
    # 1 rad: extrema between steps show as a change of sign of the rate
    st[CAP + lane], st[LEFT + lane], st[S + lane] = (1.0 / pace if pace > 0.0 else left), left, 0.0
    st[MOVING + lane], st[SIGN + lane], st[A + lane] = (1.0 if moving else 0.0), (-1.0 if up else 1.0), a
    st[VALUE + HEIGHT + lane], st[RATE + HEIGHT + lane], st[BEND + HEIGHT + lane], _ = height
    st[VALUE + FORCE + lane], st[RATE + FORCE + lane], st[BEND + FORCE + lane], _ = force
    st[VALUE + POWER + lane], st[RATE + POWER + lane], st[BEND + POWER + lane], _ = power
    st[WATCHED + HEIGHT + lane] = 0.0 if up else 1.0
    st[WATCHED + FORCE + lane] = st[WATCHED + POWER + lane] = 1.0 if watched else 0.0
    # a free ring-down is over within a period
    st[ODD + lane] = 1.0 if is_odd(arc, left if moving else min(left, 7.0 / arc[OMEGA_D])) else 0.0
    return moving or not _is_still(x, v, arc[W2], g)
