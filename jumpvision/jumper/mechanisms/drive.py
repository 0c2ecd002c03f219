"""The drive between command and carriage: play, ends of travel and speed, a loop that rings.

Each turns one motion X(t) of pieces sum c[j, i] (t - t_i)^(3-j), knots (n+1,) [s] and c (4, n), into another such one.
"""

from __future__ import annotations

import math
from functools import partial

import numba as nb
import numpy as np

from jumpvision.base.arrays import Array

from .record import Body, Mechanism, Parameter, Prior

PLAY, STROKE, SPEED = 0, 1, 2
TINY = 1e-13  # m, m/s: less beyond a bound is rounding
FINE = 1e-8  # m, to which a ringing is laid into cubics
SHORT = 1e-9  # s, of pieces that are left out

Cubic = tuple[float, float, float, float]


@nb.njit(cache=True)
def _at(p: Cubic, u: float) -> float:
    return ((p[0] * u + p[1]) * u + p[2]) * u + p[3]


@nb.njit(cache=True)
def _about(p: Cubic, u: float) -> Cubic:
    """The same polynomial from another origin."""
    return p[0], 3.0 * p[0] * u + p[1], (3.0 * p[0] * u + 2.0 * p[1]) * u + p[2], _at(p, u)


@nb.njit(cache=True)
def _rises(q: Cubic, s: float, h: float) -> float:
    """First u in [s, h] from which q is above 0; inf: none."""
    if _at(q, s) > TINY:
        return s
    a, b, c = 3.0 * q[0], 2.0 * q[1], q[2]
    root = math.sqrt(max(b * b - 4.0 * a * c, 0.0))
    half = -0.5 * (b + (root if b >= 0.0 else -root))
    one, two = half / a if a != 0.0 else h, c / half if half != 0.0 else h
    low = s
    for end in (min(one, two), max(one, two), h):
        high = min(max(end, low), h)
        if _at(q, high) > TINY:
            for _ in range(60):  # bisections, to a bit
                middle = 0.5 * (low + high)
                if _at(q, middle) > 0.0:
                    high = middle
                else:
                    low = middle
            return high
        low = high
    return math.inf


@nb.njit(cache=True)
def _rule(kind: int, mode: int, p: Cubic, y: float, x0: float, up: float, down: float) -> tuple[Cubic, Cubic, Cubic]:
    """What a drive makes of a piece p of its command, and what rises above 0 where it goes to mode + 1 and - 1.

    PLAY: at a flank (+1, -1) X = p - up or p + down until p turns, else at rest between. STROKE: X = p within
    x0 + up and x0 - down. SPEED: X' = up or -down until p is met again, else X = p.
    """
    never = (0.0, 0.0, 0.0, -1.0)
    if kind == PLAY:
        if mode == 0:
            held = (0.0, 0.0, 0.0, y)
            return held, (p[0], p[1], p[2], p[3] - up - y), (-p[0], -p[1], -p[2], y - down - p[3])
        moved = (p[0], p[1], p[2], p[3] - up if mode > 0 else p[3] + down)
        back = (0.0, -mode * 3.0 * p[0], -mode * 2.0 * p[1], -mode * p[2])
    elif kind == STROKE:
        over, under = (p[0], p[1], p[2], p[3] - x0 - up), (-p[0], -p[1], -p[2], x0 - down - p[3])
        if mode == 0:
            return p, over, under
        moved = (0.0, 0.0, 0.0, x0 + up if mode > 0 else x0 - down)
        beyond = over if mode > 0 else under
        back = (-beyond[0], -beyond[1], -beyond[2], -beyond[3])
    else:
        if mode == 0:
            rate = (3.0 * p[0], 2.0 * p[1], p[2])
            return p, (0.0, rate[0], rate[1], rate[2] - up), (0.0, -rate[0], -rate[1], -rate[2] - down)
        moved = (0.0, 0.0, up if mode > 0 else -down, y)
        back = (-mode * p[0], -mode * p[1], mode * (moved[2] - p[2]), mode * (y - p[3]))
    return (moved, never, back) if mode > 0 else (moved, back, never)


@nb.njit(cache=True)
def _switched(kind: int, knots: Array, c: Array, up: float, down: float) -> tuple[Array, Array]:
    """A motion as a drive of this kind makes it."""
    n = c.shape[1]
    at, out = np.empty(16 * n + 8), np.empty((4, 16 * n + 8))
    k, mode, y = 0, 0, c[3, 0]
    x0 = y
    for i in range(n):
        s, h = 0.0, knots[i + 1] - knots[i]
        piece = (c[0, i], c[1, i], c[2, i], c[3, i])
        for turn in range(15):  # changes of mode within a piece
            left = h - s
            made, more, less = _rule(kind, mode, _about(piece, s), y, x0, up, down)
            rise, fall = (math.inf, math.inf) if turn == 14 else (_rises(more, 0.0, left), _rises(less, 0.0, left))
            end = min(rise, fall, left)
            if end > SHORT or end == left:
                at[k] = knots[i] + s
                out[0, k], out[1, k], out[2, k], out[3, k] = made
                k += 1
            y, s = _at(made, end), s + end
            if rise > left and fall > left:
                break
            mode += 1 if rise <= fall else -1
    at[k] = knots[n]
    last = c[:, n - 1]
    rest = _at((last[0], last[1], last[2], last[3]), knots[n] - knots[n - 1])
    if kind == SPEED and mode != 0 and abs(rest - y) > TINY:  # it comes after
        rate = up if mode > 0 else -down
        out[0, k], out[1, k], out[2, k], out[3, k] = 0.0, 0.0, rate, y
        at[k + 1] = at[k] + (rest - y) / rate
        k += 1
    return at[: k + 1], out[:, :k]


def play(knots: Array, c: Array, b: float, flank: float) -> tuple[Array, Array]:
    """Play b [m]; flank: where in the gap it begins, 1 at the flank that is met on the way up, -1 at the other."""
    if b <= 0.0:
        return knots, c
    return _switched(PLAY, knots, c, 0.5 * (1.0 - flank) * b, 0.5 * (1.0 + flank) * b)


def stroke(knots: Array, c: Array, reach: float) -> tuple[Array, Array]:
    """No further than `reach` [m] from the start."""
    return _switched(STROKE, knots, c, reach, reach)


def speed(knots: Array, c: Array, top: float) -> tuple[Array, Array]:
    """No faster than `top` [m/s]; what is left behind is caught up at that speed."""
    return _switched(SPEED, knots, c, top, top)


@nb.njit(cache=True)
def loop(knots: Array, c: Array, t_n: float, zeta: float) -> tuple[Array, Array]:
    """t_n^2 X'' + 2 zeta t_n X' + X = command, exactly on each piece of it."""
    at, out = [knots[0]], [(0.0, 0.0, 0.0, 0.0)]
    decay, beat = zeta / t_n, math.sqrt(max(1.0 - zeta * zeta, 1e-10)) / t_n
    lag, bend = 2.0 * zeta * t_n, t_n * t_n
    y, v, n = c[3, 0], 0.0, c.shape[1]
    for i in range(n + 1):
        if i < n:
            a, b, d, e = c[0, i], c[1, i], c[2, i], c[3, i]
            left = knots[i + 1] - knots[i]
        else:  # the command stands still and the loop settles
            left = knots[n] - knots[n - 1]
            a, b, d, e = 0.0, 0.0, 0.0, _at((c[0, n - 1], c[1, n - 1], c[2, n - 1], c[3, n - 1]), left)
            left = 20.0 / decay
        b = b - lag * 3.0 * a
        d = d - lag * 2.0 * b - bend * 6.0 * a
        e = e - lag * d - bend * 2.0 * b
        s = 0.0
        while left - s > SHORT:
            off, rate = y - e, v - d  # from what the piece alone would be
            h = left - s
            while True:
                fall, angle, half = math.exp(-decay * h), beat * h, 0.5 * beat * h
                side = (rate + decay * off) / beat
                gone = fall * (off * math.cos(angle) + side * math.sin(angle))
                slow = fall * (rate * math.cos(angle) - (off / bend + decay * rate) / beat * math.sin(angle))
                middle = math.exp(-0.5 * decay * h) * (off * math.cos(half) + side * math.sin(half))
                if h <= 4.0 * SHORT or abs(0.5 * (off + gone) + 0.125 * h * (rate - slow) - middle) < FINE:
                    break
                h *= 0.5
            slope = (gone - off) / h
            third, second = (rate + slow - 2.0 * slope) / h**2, (3.0 * slope - 2.0 * rate - slow) / h
            out.append((a + third, b + second, d + rate, e + off))
            b, d, e = 3.0 * a * h + b, (3.0 * a * h + 2.0 * b) * h + d, ((a * h + b) * h + d) * h + e
            y, v, s = e + gone, d + slow, s + h
            at.append(at[-1] + h)
    cubics = np.empty((4, len(out) - 1))
    for k in range(1, len(out)):
        for j in range(4):
            cubics[j, k - 1] = out[k][j]
    return np.array(at), cubics


B = Parameter(
    "play", "m", "play between motor and carriage", lambda m: Prior(0.0, 0.0, 0.5 * m.stroke, 0.01 * m.stroke), lo=0
)
FLANK = Parameter(
    "flank",
    "",
    "where in its play the drive begins: -1 at the lower flank, 1 at the upper",
    lambda m: Prior(0.0, -1.0, 1.0, 0.3, grid=(-1.0, 0.0, 1.0)),
    default=0.0,
    lo=-1,
    hi=1,
)
REACH = Parameter(
    "reach",
    "m",
    "greatest distance of the motor from its start",
    lambda m: Prior(m.stroke, 0.3 * m.stroke, m.stroke, 0.02 * m.stroke),
    lo=0,
    open_lo=True,
)
TOP_SPEED = Parameter(
    "top_speed",
    "m/s",
    "greatest speed of the motor",
    lambda m: Prior(m.speed, 0.3 * m.speed, m.speed, 0.02 * m.speed),
    lo=0,
    open_lo=True,
)
T_N = Parameter(
    "t_n",
    "s",
    "1 / (2 pi bandwidth) of the motor's loop",
    lambda m: Prior(1e-6, 1e-6, 0.02, 1e-3),
    lo=1e-6,
)
ZETA = Parameter(
    "zeta",
    "",
    "damping of the motor's loop",
    lambda m: Prior(0.6, 0.1, 1.0, 0.1, grid=(0.3, 0.7)),
    default=0.7,
    lo=0.05,
    hi=1,
)

_drive = partial(Mechanism, acts_on=Body.DRIVE, source="docs/physics.md section 6")
LOOP_BANDWIDTH = _drive(
    name="loop_bandwidth",
    parameters=(T_N, ZETA),
    meaning="motor follows its command as a loop of second order, t_n^2 X'' + 2 zeta t_n X' + X = command",
    lacks="the bandwidth of the motor's loop",
    operator=loop,
    of_command=True,
)
SPEED_LIMIT = _drive(
    name="speed_limit",
    parameters=(TOP_SPEED,),
    meaning="motor no faster than this; it catches up later",
    lacks="the greatest speed of the motor",
    operator=speed,
    of_command=True,
)
STROKE_LIMIT = _drive(
    name="stroke_limit",
    parameters=(REACH,),
    meaning="motor no further from its start than this",
    lacks="the end of the motor's travel",
    operator=stroke,
    of_command=True,
)
DRIVE_PLAY = _drive(
    name="drive_play",
    parameters=(B, FLANK),
    meaning="play between motor and carriage",
    lacks="the play of the drive",
    operator=play,
)
