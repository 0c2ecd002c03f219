"""From arc to arc: the jumps of the hard-ground jumper and what is counted on the way; their events come from `lanes`.

Zeno: with a massless foot contacts do not accumulate in finite time: the acceleration is bounded, the velocity
continuous but for the loss at touchdown, which never turns it round. Nothing has to be stopped. But contacts are lost
and regained at grazing speed: a flight that leaves AND lands slower than GRAZE (it rises less than 1e-12 m at 1 m/s^2)
is integrated like any other, but not counted and not listed.

Numbers of a jump stand in its lane of `st` too, counts as floats.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numba as nb
import numpy as np
from numba.core import cgutils, types
from numba.extending import intrinsic

from jumpvision.base.arrays import Array
from jumpvision.jumper.physics.forcing import INLINE, KERNEL, sincos

from .arc import ARC_SIZE, D0, make_arc
from .lanes import (
    BEST,
    BUSY,
    CREST,
    CROSSING,
    END,
    ENDED,
    FORCE,
    HEIGHT,
    LANES,
    POWER,
    RATE,
    SETTLED,
    SIZE,
    VALUE,
    G,
    Q,
    S,
    V,
    X,
    crest,
    lay,
    step,
)

if TYPE_CHECKING:
    from llvmlite.ir import IRBuilder, Value
    from numba.core.base import BaseContext
    from numba.core.typing.context import BaseContext as Typing
    from numba.core.typing.templates import Signature

GRAZE = 1e-6  # m/s
RAW = 10  # numbers of a jump, as `follow_jumps` has them
_ROWS = range(SIZE, SIZE + 21 * LANES, LANES)
ROOM = _ROWS.stop
# number among the laws and the piece it is in (-1: none); counts; 1 in the air
JUMP, PIECE, N_ARCS, N_FLIGHTS, N_JUMPS, AIRBORNE = _ROWS[:6]
W2, GAM, KEEP = _ROWS[6:9]  # w0^2, gamma, sqrt(1 - e)
TAU, LENGTH, MOTOR_V = _ROWS[9:12]  # time into the piece, its length [s]; the motor's speed at the end of the last
REST, COM = _ROWS[12:14]  # y at rest, greatest rise of y while the law runs [m]
FIRST, LONGEST, LIFT, LIFT_V, LANDING_V = _ROWS[14:19]  # first and last lift-off, longest flight [s]; speeds [m/s]
START_Y, START_YV = _ROWS[19:]  # of the arc
_FROM_ZERO = (N_ARCS, N_FLIGHTS, N_JUMPS, AIRBORNE, TAU, LENGTH, MOTOR_V, LONGEST, LIFT, LIFT_V, LANDING_V)


def _unowned(typing: Typing, array: types.Array) -> tuple[Signature, Callable[..., Value]]:
    """The array without its count of owners, which every inlined call that is given it would move up and down: a fifth
    of the time. Whoever made it holds it meanwhile."""

    def code(context: BaseContext, builder: IRBuilder, signature: Signature, args: Sequence[Value]) -> Value:
        view = cgutils.create_struct_proxy(array)(context, builder, value=args[0])
        view.meminfo, view.parent = (cgutils.get_null_value(v.type) for v in (view.meminfo, view.parent))
        return view._getvalue()

    return array(array), code


unowned: Callable[[Array], Array] = intrinsic(_unowned)  # type: ignore[assignment]


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


@nb.njit(**INLINE)
def _set_up(st: Array, lane: int, i: int, laws: Array, robots: Array, t_end: float, pieces: Array) -> None:
    """Jump i of follow_jumps, from rest, in a lane: its numbers in st, its law in rows lane (r + 1) on of pieces."""
    n, columns, at, j = laws.shape[1], laws.shape[2], lane * (laws.shape[1] + 1), min(i, robots.shape[1] - 1)
    for k in range(n):
        for m in range(3):
            pieces[at + k, m], pieces[at + k, 6 + m] = laws[i, k, m], laws[i, k, columns - 3 + m]
            pieces[at + k, 3 + m] = laws[i, k, 3 + m] if columns == 9 else 0.0
    for m in range(9):  # the motor at rest
        pieces[at + n, m] = 0.0
    pieces[at + n, 0], pieces[at + n, 1] = pieces[at + n - 1, 1], t_end
    mass = robots[0, j] + robots[1, j]
    q, g, w2 = robots[0, j] / mass, robots[4, j], robots[2, j] / mass
    st[Q + lane], st[G + lane], st[W2 + lane] = q, g, w2
    st[GAM + lane], st[KEEP + lane] = 0.5 * robots[3, j] / mass, math.sqrt(1.0 - robots[5, j])
    for k in _FROM_ZERO:
        st[k + lane] = 0.0
    for k in (HEIGHT, FORCE, POWER):
        st[BEST + k + lane] = -math.inf
    st[X + lane], st[V + lane], st[BUSY + lane] = -g / w2, 0.0, 1.0
    st[JUMP + lane], st[PIECE + lane], st[FIRST + lane] = i, -1, math.nan


@nb.njit(**INLINE)
def _on_to_the_next_piece(st: Array, lane: int, pieces: Array, at: int, n: int) -> None:
    i, q, motor_v = int(st[PIECE + lane]), st[Q + lane], 0.0
    if i >= 0:
        pieces[at + n, 2], motor_v, _ = motor(row(pieces, at + i), st[LENGTH + lane])
    piece = row(pieces, at + i + 1)
    mx, mv = piece[2], 0.0
    if i + 1 < n:
        mx, mv, _ = motor(piece, 0.0)
    st[V + lane] -= q * (mv - motor_v)  # y' does not jump
    y = st[X + lane] + q * mx
    if i == -1:
        st[REST + lane] = y
    if i + 1 == n:
        st[COM + lane], st[BEST + HEIGHT + lane] = st[BEST + HEIGHT + lane] - st[REST + lane], y
    st[PIECE + lane], st[TAU + lane], st[LENGTH + lane] = i + 1, 0.0, piece[1] - piece[0]


@nb.njit(**INLINE)
def _land(st: Array, lane: int, now: float, free: bool, flights: Array) -> None:
    """Counts a flight that is over; free: the motor stands still."""
    k = int(st[N_FLIGHTS + lane])
    if k < flights.shape[0]:
        flights[k, 1] = now
    if k == 0:
        st[FIRST + lane] = st[LIFT + lane]
    st[N_FLIGHTS + lane] = k + 1
    if free:
        st[LONGEST + lane] = max(st[LONGEST + lane], now - st[LIFT + lane])
        if st[N_JUMPS + lane] == 0.0:
            st[N_JUMPS + lane] = k + 1


@nb.njit(**INLINE)
def _end_arc(st: Array, lane: int, up: bool, s: float, crossed: bool) -> None:
    """The arc of a lane is over after s [s]: x and v stand in the lane."""
    if up:  # y'' = -g, whatever the motor does
        g, speed = st[G + lane], st[START_YV + lane]
        rise = max(min(speed / g, s), 0.0)
        st[BEST + HEIGHT + lane] = max(st[BEST + HEIGHT + lane], st[START_Y + lane] + rise * (speed - 0.5 * g * rise))
    st[TAU + lane] = st[TAU + lane] + s if crossed else st[LENGTH + lane]
    if crossed:
        st[X + lane] = 0.0
        if up:
            st[LANDING_V + lane] = -st[V + lane]
            st[V + lane] *= st[KEEP + lane]


@nb.njit(**INLINE)
def _proceed(st: Array, lane: int, pieces: Array, n: int, rows: Array, flights: Array) -> bool:
    """On to the next arc that has to be followed by steps; False: the jump is over."""
    at, q, g = lane * (n + 1), st[Q + lane], st[G + lane]
    while True:
        while st[TAU + lane] >= st[LENGTH + lane]:
            if st[PIECE + lane] == n:
                return False
            _on_to_the_next_piece(st, lane, pieces, at, n)
        i, tau, x, v = int(st[PIECE + lane]), st[TAU + lane], st[X + lane], st[V + lane]
        piece, moving, left, was_up = row(pieces, at + i), i < n, st[LENGTH + lane] - tau, st[AIRBORNE + lane] == 1.0
        now = piece[0] + tau
        up = x > 0.0 or (x == 0.0 and (v > 0.0 or (v == 0.0 and -g - q * motor(piece, tau)[2] > 0.0)))
        if up and not was_up:
            st[LIFT + lane], st[LIFT_V + lane], k = now, v, int(st[N_FLIGHTS + lane])
            if k < flights.shape[0]:
                flights[k, 0], flights[k, 1] = now, math.nan
        if was_up and not up and max(st[LIFT_V + lane], st[LANDING_V + lane]) > GRAZE:
            _land(st, lane, now, not moving, flights)
            if not moving and st[LIFT + lane] >= piece[0] and math.isinf(piece[1]):
                st[AIRBORNE + lane] = 0.0
                return False
        st[AIRBORNE + lane] = 1.0 if up else 0.0
        sin, cos = sincos(piece[7] * tau + piece[8]) if piece[6] != 0.0 else (0.0, 0.0)
        arc = make_arc(not up, piece, tau, left, (sin, cos), x, v, q, g, st[W2 + lane], st[GAM + lane])
        k = int(st[N_ARCS + lane])
        if k < rows.shape[0]:
            rows[k, 0] = now
            for j in range(ARC_SIZE):
                rows[k, 1 + j] = arc[j]
        st[N_ARCS + lane] = k + 1
        if up and not moving:  # a parabola
            s = min((v + math.sqrt(v * v + 2.0 * g * max(x, 0.0))) / g, left)
            st[START_Y + lane], st[START_YV + lane] = x + q * arc[D0], v
            st[X + lane], st[V + lane] = x + s * (v - 0.5 * g * s), v - g * s
            _end_arc(st, lane, True, s, s != left)
        elif lay(st, lane, arc, (sin, cos), up, moving, left):
            st[START_Y + lane], st[START_YV + lane] = st[VALUE + HEIGHT + lane], st[RATE + HEIGHT + lane]
            return True
        else:
            _end_arc(st, lane, False, left, False)


@nb.njit(**INLINE)
def _after_step(st: Array, lane: int) -> bool:
    """Crests of the last step; False: the lane's arc is over."""
    todo = int(st[ENDED + lane])
    crests, which = todo & 7 * CREST, HEIGHT
    while crests:
        if crests & CREST:
            crest(st, lane, which)
        crests, which = crests >> 1, which + LANES
    if not todo & (CROSSING | SETTLED | END):
        return True
    _end_arc(st, lane, st[AIRBORNE + lane] == 1.0, st[S + lane], todo & CROSSING != 0)
    return False


@nb.njit(**INLINE)
def _count(st: Array, lane: int, motor_at_rest: float, i: int, out: Array) -> None:
    """The numbers of a jump that is over."""
    height, flights, airborne = st[BEST + HEIGHT + lane], st[N_FLIGHTS + lane], st[AIRBORNE + lane]
    out[0, i], out[1, i], out[9, i] = st[N_ARCS + lane], flights + airborne, airborne
    out[2, i] = st[N_JUMPS + lane] if st[N_JUMPS + lane] > 0.0 else flights + airborne
    out[3, i] = st[LIFT + lane] if flights == 0.0 and airborne == 1.0 else st[FIRST + lane]
    out[4, i] = max(st[COM + lane], height - st[REST + lane])
    out[5, i] = height - st[Q + lane] * motor_at_rest + st[G + lane] / st[W2 + lane]
    out[6, i], out[7, i], out[8, i] = st[LONGEST + lane], st[BEST + POWER + lane], st[BEST + FORCE + lane]


@nb.njit(**INLINE)
def numbers(out: Array, i: int) -> tuple[float, ...]:
    """Column i of what follow_jumps gives."""
    o = out
    return o[0, i], o[1, i], o[2, i], o[3, i], o[4, i], o[5, i], o[6, i], o[7, i], o[8, i], o[9, i]


@nb.njit(**KERNEL)
def follow_jumps(
    first: int, last: int, laws: Array, robots: Array, t_end: float, rows: Array, flights: Array, out: Array
) -> None:
    """Jumps first to last - 1, from rest, LANES at a time.

    laws: (n, r, 6), rows of Segments, or (n, r, 9), as in arc.make_arc. robots (6, n or 1): the arguments of hard_jump
    in their order. t_end [s]: not before the forcing ends; inf: the landing of the first flight that begins after the
    forcing, or when none can follow. rows (m, 1 + ARC_SIZE): start and fields of the arcs; flights (m, 2): lift-off and
    landing [s]; both are for one jump alone, and filled as far as they go.

    out (RAW, last - first): the numbers of arcs, of flights and of jumps (flights up to the first that ends after the
    forcing), the first lift-off [s] (NaN if none), the greatest y - y_rest and, after the forcing, x_r + M g/k [m], the
    duration of the longest flight that ends after the forcing [s], the peaks of F_m X_m'/m_m and F_m/m_m during the
    forcing, and whether the robot is in the air at the end.
    """
    r, lanes = laws.shape[1], min(LANES, last - first)
    own_st, own_pieces = np.zeros(ROOM), np.zeros((lanes * (r + 1), 9))
    st, pieces, rows, flights = unowned(own_st), unowned(own_pieces), unowned(rows), unowned(flights)
    for lane in range(lanes):
        st[JUMP + lane], st[ENDED + lane] = -1, END  # a lane without a jump asks for one
    begun, busy = first, lanes
    while busy > 0:
        for lane in range(lanes):
            if st[ENDED + lane] == 0.0:
                continue
            going = st[JUMP + lane] >= 0.0 and _after_step(st, lane)
            while not going:
                if st[JUMP + lane] < 0.0:
                    if begun == last:
                        st[BUSY + lane], st[ENDED + lane] = 0.0, 0.0
                        busy -= 1
                        break
                    _set_up(st, lane, begun, laws, robots, t_end, pieces)
                    begun += 1
                going = _proceed(st, lane, pieces, r, rows, flights)
                if not going:
                    _count(st, lane, pieces[lane * (r + 1) + r, 2], int(st[JUMP + lane]) - first, out)
                    st[JUMP + lane] = -1
        if busy > 0:
            step(st, lanes)
    own_st[0], own_pieces[0, 0] = 0.0, 0.0  # held until here
