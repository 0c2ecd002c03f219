"""Inside one step of the jumper: its state at any time, roots of the guards, and the greatest height."""

from __future__ import annotations

import math

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.jumper.physics.forcing import sincos

from .granular import AIR, SINE, STUCK, VF, XF, W, Y, motor_force, rhs, rod
from .kernel import kernel, number
from .modes import guards
from .packed import Packed
from .step import HALF, OMEGA, P1, P2, SHARE, SWING, between, flow, middle

Triple = tuple[float, float, float]

ROOT = 1e-14  # s, width of the bracket at which an event is found
SAMPLES = 60  # of the motor force in a period of the forcing
TURN = 1e-8  # of the greatest rate in a step: the height is the greatest to the square of it
MARGIN = 0.05  # of a guard's range over a step: how near to zero its parabola may come

N_OUT = 7
ROD, FOOT, MOTOR, ROD_VELOCITY, FOOT_VELOCITY, GROUND_FORCE, SPRING_FORCE = range(N_OUT)


@kernel
def inside(
    theta: float,
    t: float,
    s: Array,
    h: float,
    wide: float,
    exact: bool,
    q: Array,
    mode: int,
    p: Packed,
    out: Array,
) -> None:
    """Writes the state at the share theta of the h [s] that began at s; wide [s]: of the step that q is of."""
    if exact:
        flow(t + theta * h, mode, p, out)
    else:
        between(s, q, theta * h / wide, out)


@kernel
def dips(a: float, b: float, c: float) -> bool:
    """Whether a guard, positive at the begin, middle and end of a step, may reach zero between (parabola)."""
    bend, slope = 2.0 * (a - 2.0 * b + c), 4.0 * b - 3.0 * a - c
    if not 0.0 < -slope < 2.0 * bend:
        return False
    return a - slope * slope / (4.0 * bend) < MARGIN * (max(a, b, c) - min(a, b, c))


@kernel
def inverse(a: float, f_a: float, b: float, f_b: float, c: float, f_c: float) -> float:
    """Where the parabola x(f) through three points is at f = 0; b: the nearest. NaN or inf where there is none."""
    r, s, t = f_b / f_c, f_b / f_a, f_a / f_c
    return b + s * (t * (r - t) * (c - b) - (1.0 - r) * (b - a)) / ((t - 1.0) * (r - 1.0) * (s - 1.0))


@kernel
def locate(
    i: int,
    early: bool,
    ends: tuple[float, float, float],
    t: float,
    s: Array,
    h: float,
    wide: float,
    exact: bool,
    q: Array,
    work: Array,
    mode: int,
    slip: int,
    p: Packed,
) -> float:
    """Share of the step where guard i reaches zero, in its first half (early) or its second; ends: at the begin, middle
    and end of the step. By inverse parabolas (Brent's method less its bookkeeping)."""
    if early:
        lo, hi, old, g_lo, g_hi, g_old = 0.0, 0.5, 1.0, ends[0], ends[1], ends[2]
    else:
        lo, hi, old, g_lo, g_hi, g_old = 0.5, 1.0, 0.0, ends[1], ends[2], ends[0]
    if g_lo <= 0.0:
        return lo
    for n in range(100):
        if (hi - lo) * h <= ROOT or g_hi == 0.0:
            break
        if g_lo < -g_hi:
            theta = inverse(hi, g_hi, lo, g_lo, old, g_old)
        else:
            theta = inverse(lo, g_lo, hi, g_hi, old, g_old)
        if n % 4 == 3 or not lo < theta < hi:
            theta = 0.5 * (lo + hi)
        # not nearer to an end than the width asked for, so that the bracket closes
        theta = min(max(theta, lo + 0.9 * ROOT / h), hi - 0.9 * ROOT / h)
        inside(theta, t, s, h, wide, exact, q, mode, p, work)
        g = guards(t + theta * h, work, mode, slip, p)[i]
        if g > 0.0:
            old, g_old, lo, g_lo = lo, g_lo, theta, g
        else:
            old, g_old, hi, g_hi = hi, g_hi, theta, g
    return hi


@kernel
def heights(t: float, s: Array, p: Packed) -> tuple[float, float, float, float]:
    """Height and rate of the rod, then of the centre of mass of the whole robot."""
    x_r, v_r, _, _, _ = rod(t, s, p)
    mass = p.M + p.m_f
    return x_r, v_r, (p.M * s[Y] + p.m_f * s[XF]) / mass, (p.M * s[W] + p.m_f * s[VF]) / mass


@kernel
def peak(
    which: int,
    t: float,
    s: Array,
    h: float,
    wide: float,
    end: tuple[float, float, float, float],
    exact: bool,
    q: Array,
    work: Array,
    mode: int,
    p: Packed,
) -> float:
    """Greatest height within a step over which its rate turns from up to down. which: 0 rod, 2 centre of mass;
    end: `heights` at its end."""
    lo, hi, side = 0.0, 1.0, 0
    up, down = heights(t, s, p)[which + 1], end[which + 1]
    best = -np.inf
    for _ in range(25):  # Illinois method on the rate; height is of second order in what remains
        theta = (lo * down - hi * up) / (down - up)
        inside(theta, t, s, h, wide, exact, q, mode, p, work)
        now = heights(t + theta * h, work, p)
        best, rate = max(best, now[which]), now[which + 1]
        if abs(rate) <= TURN * max(up, -down) or hi - lo <= TURN:
            break
        if rate > 0.0:
            lo, up, down, side = theta, rate, 0.5 * down if side == 1 else down, 1
        else:
            hi, down, up, side = theta, rate, 0.5 * up if side == -1 else up, -1
    return best


@kernel
def sample(t: float, s: Array, mode: int, slip: int, p: Packed, k: Array, out: Array) -> None:
    """Writes one row of the output, or of it the height of the rod alone."""
    x_r, v_r, _, x, _ = rod(t, s, p)
    if out.size == 1:
        out[ROD] = x_r
        return
    force = rhs(t, s, mode, slip, p, k, number(0))
    out[ROD], out[MOTOR], out[ROD_VELOCITY], out[SPRING_FORCE] = x_r, x_r + x, v_r, force
    if p.massless == 1 and mode == AIR:
        out[FOOT], out[FOOT_VELOCITY] = x_r, v_r
    else:
        out[FOOT], out[FOOT_VELOCITY] = s[XF], s[VF]
    if mode == AIR:
        out[GROUND_FORCE] = 0.0
    else:  # m_f a_f = -m_f g - F_s + F_GM
        out[GROUND_FORCE] = force + p.m_f * (p.g + k[0, VF])


@kernel
def turning(a: float, b: float, c: float, peak: float) -> bool:
    """Whether a quantity, a, b, c at the begin, middle and end of a piece, turns in it above its peak (parabola)."""
    bend = a - 2.0 * b + c
    if bend >= 0.0 or not abs(c - a) < -2.4 * bend:  # 0.1 of the piece or more outside it
        return False
    return b - 0.125 * (c - a) * (c - a) / bend + MARGIN * (max(a, b, c) - min(a, b, c)) > peak


@kernel
def paces(mode: int, p: Packed) -> tuple[float, float]:
    """Rates [rad/s] of the forcing or the spring, the faster, as it is looked at and with the foot free to move."""
    light = 1.0 / p.m_f if mode != STUCK and p.massless == 0 else 0.0
    fast = math.sqrt(p.k_s * (1.0 / p.M + light))
    rate = fast if mode == AIR else math.sqrt(p.k_s / p.M)
    return (max(rate, p.row[4]) if p.kind == SINE else rate), fast


@kernel
def fastest(start: float, end: float, p: Packed) -> float:
    """Greatest |X_m'| [m/s] of a sinusoid from start to end [s]."""
    a, b = p.row[4] * (start - p.row[0]) + p.row[5], p.row[4] * (end - p.row[0]) + p.row[5]
    if math.floor(b / math.pi) >= math.ceil(a / math.pi):
        return p.row[3] * p.row[4]
    return p.row[3] * p.row[4] * max(abs(sincos(a)[1]), abs(sincos(b)[1]))


@kernel
def spares(peaks: Array, p: Packed) -> bool:
    """Whether force and power of the motor surely stay below their peaks on a flight in closed form, driven by a
    sinusoid whose `fastest` is among the peaks."""
    if p.kind != SINE or p.dry == 1 or p.tau > 0.0 or p.drive != 0:
        return False
    rate, stiff = p.row[4], p.arc[OMEGA] * p.arc[OMEGA] + p.arc[HALF] * p.arc[HALF]
    forced = rate * rate * math.sqrt(p.arc[P1] * p.arc[P1] + p.arc[P2] * p.arc[P2])
    most = p.ratio * (p.M * p.arc[SHARE] * (stiff * p.arc[SWING] + forced) + p.m_r * p.row[3] * rate * rate)
    return most <= peaks[0] and most * p.row[3] * rate <= peaks[1]


@kernel
def efforts(
    t: float,
    s: Array,
    h: float,
    wide: float,
    s1: Array,
    f0: Triple,
    pace: tuple[float, float],
    exact: bool,
    known: bool,
    q: Array,
    work: Array,
    mode: int,
    slip: int,
    p: Packed,
    k: Array,
    peaks: Array,
) -> tuple[Triple, bool]:
    """Raises peaks, the greatest motor force [N], power [W] and speed [m/s], to those within a step to s1.

    known: whether q is; k: slopes of the step. peaks: (6,), behind them the least seen. f0: `motor_force` at the begin
    of the step; returns it at the end, and whether all has been looked at: else call again with q. pace: `paces`.

    A step is looked at in pieces of at most an eighth of a period of the forcing or the spring, the faster: a sinusoid
    rises above both ends of a piece of x rad by at most x^2/8 of its amplitude. Where that may pass the peak so far, by
    the parabola through begin, middle and end; where this turns above the peak (or nearly does), the piece is sampled
    SAMPLES times a period, with a parabola through the highest: right to about (2 pi / SAMPLES)^4 of the peak.
    """
    rate, fast = pace
    pieces = max(1, math.ceil(8.0 * rate * h / (2.0 * math.pi) - 1e-6))
    n = 2 + int(SAMPLES * rate * h / pieces / (2.0 * math.pi))
    x = max(rate, fast) * h / pieces
    rise = 2.0 * 0.125 * x * x  # within a piece it may rise by twice what a sinusoid of the range seen would
    for i in range(pieces):
        if i + 1 < pieces:
            if not known:
                return f0, False
            inside((i + 1) / pieces, t, s, h, wide, exact, q, mode, p, work)
            f2 = motor_force(t + (i + 1) / pieces * h, work, mode, slip, p)
        else:
            f2 = motor_force(t + h, s1, mode, slip, p)
        near = False
        for which in range(3):
            top = max(f0[which], f2[which])
            peaks[which] = max(peaks[which], top)
            peaks[3 + which] = min(peaks[3 + which], min(f0[which], f2[which]))
            near = near or top + rise * (peaks[which] - peaks[3 + which]) > peaks[which]
        if near:
            if known:
                inside((i + 0.5) / pieces, t, s, h, wide, exact, q, mode, p, work)
            else:  # of third order: enough to tell whether it turns
                middle(s, s1, k, h, work)
            f1 = motor_force(t + (i + 0.5) / pieces * h, work, mode, slip, p)
            for which in range(3):
                a = f0[which]
                if not turning(a, f1[which], f2[which], peaks[which]):
                    continue
                if not known:
                    return f0, False
                before, now = -np.inf, a
                for j in range(1, n + 1):
                    theta = (i + j / n) / pieces
                    inside(theta, t, s, h, wide, exact, q, mode, p, work)
                    after = motor_force(t + theta * h, work, mode, slip, p)[which]
                    top, turn = after, before - 2.0 * now + after
                    # it turns within the three; at its middle where a loop's limits may cut it
                    reach = -2.0 if p.kp == 0.0 else -1.0
                    if -np.inf < turn < 0.0 and abs(after - before) <= reach * turn:
                        top = max(top, now - 0.125 * (after - before) * (after - before) / turn)
                    peaks[which] = max(peaks[which], top)
                    before, now = now, after
        f0 = f2
    return f0, True
