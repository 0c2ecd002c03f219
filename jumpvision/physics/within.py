"""Inside one step of the jumper: its state at any time, roots of the guards, and the greatest height."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jumpvision.physics.granular import AIR, SINE, VF, XF, W, Y, guards, motor_force, rhs, rod
from jumpvision.physics.kernel import kernel
from jumpvision.physics.linear_flow import flow
from jumpvision.physics.runge_kutta import between

Array = NDArray[np.float64]

ROOT = 1e-14  # s, width of the bracket at which an event is found
SAMPLES = 60  # of the motor force in a period of the forcing
MARGIN = 0.05  # of a guard's range over a step: how near to zero its parabola may come

N_OUT = 7
ROD, FOOT, MOTOR, ROD_VELOCITY, FOOT_VELOCITY, GROUND_FORCE, SPRING_FORCE = range(N_OUT)


@kernel
def inside(
    theta: float, t: float, s: Array, h: float, exact: bool, arc: Array, q: Array, mode: int, kind: int, row: Array,
    p: Any, out: Array,
) -> None:  # fmt: skip
    """Writes the state at the share theta of the step that began at s."""
    if exact:
        flow(t + theta * h, mode, kind, row, p, arc, out)
    else:
        between(s, q, theta, out)


@kernel
def dips(a: float, b: float, c: float) -> bool:
    """Whether a guard, positive at the begin, middle and end of a step, may reach zero between (parabola)."""
    bend, slope = 2.0 * (a - 2.0 * b + c), 4.0 * b - 3.0 * a - c
    if not 0.0 < -slope < 2.0 * bend:
        return False
    return a - slope * slope / (4.0 * bend) < MARGIN * (max(a, b, c) - min(a, b, c))


@kernel
def locate(
    i: int, lo: float, hi: float, g_lo: float, g_hi: float, t: float, s: Array, h: float, exact: bool, arc: Array,
    q: Array, work: Array, mode: int, slip: int, memory: Array, kind: int, row: Array, p: Any,
) -> float:  # fmt: skip
    """Share of the step where guard i, g_lo > 0 at lo and g_hi <= 0 at hi, reaches zero (Illinois method)."""
    if g_lo <= 0.0:
        return lo
    side = 0
    for n in range(100):
        if (hi - lo) * h <= ROOT or g_hi == 0.0:
            break
        theta = (lo * g_hi - hi * g_lo) / (g_hi - g_lo) if n % 8 != 7 and g_hi < 0.0 else 0.5 * (lo + hi)
        inside(theta, t, s, h, exact, arc, q, mode, kind, row, p, work)
        g = guards(t + theta * h, work, mode, slip, memory, kind, row, p)[i]
        if g > 0.0:
            lo, g_lo = theta, g
            if side == 1:
                g_hi *= 0.5
            side = 1
        else:
            hi, g_hi = theta, g
            if side == -1:
                g_lo *= 0.5
            side = -1
    return hi


@kernel
def heights(t: float, s: Array, kind: int, row: Array, p: Any) -> tuple[float, float, float, float]:
    """Height and rate of the rod, then of the centre of mass of the whole robot."""
    x_r, v_r, _, _, _ = rod(t, s, kind, row, p)
    mass = p.M + p.m_f
    return x_r, v_r, (p.M * s[Y] + p.m_f * s[XF]) / mass, (p.M * s[W] + p.m_f * s[VF]) / mass


@kernel
def peak(
    which: int, t: float, s: Array, h: float, exact: bool, arc: Array, q: Array, work: Array, mode: int, kind: int,
    row: Array, p: Any,
) -> float:  # fmt: skip
    """Greatest height within a step over which its rate turns from up to down. which: 0 rod, 2 centre of mass."""
    lo, hi = 0.0, 1.0
    best = -np.inf
    for _ in range(25):  # height is of second order in the remaining 1e-8 of the step
        theta = 0.5 * (lo + hi)
        inside(theta, t, s, h, exact, arc, q, mode, kind, row, p, work)
        now = heights(t + theta * h, work, kind, row, p)
        best = max(best, now[which])
        if now[which + 1] > 0.0:
            lo = theta
        else:
            hi = theta
    return best


@kernel
def sample(
    t: float, s: Array, mode: int, slip: int, memory: Array, kind: int, row: Array, p: Any, k: Array, out: Array
) -> None:
    """Writes one row of the output."""
    x_r, v_r, _, x, _ = rod(t, s, kind, row, p)
    force = rhs(t, s, mode, slip, memory, kind, row, p, k, 0)
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
def efforts(
    t: float, s: Array, h: float, exact: bool, arc: Array, q: Array, work: Array, mode: int, slip: int, memory: Array,
    kind: int, row: Array, p: Any, k: Array, peaks: Array,
) -> None:  # fmt: skip
    """Raises peaks, the greatest motor force [N] and power [W], to those within a step.

    Sampled SAMPLES times a period of the forcing or the spring, the faster, with a parabola through the highest: right
    to about (2 pi / SAMPLES)^4 of the peak.
    """
    rate = math.sqrt(p.k_s * (1.0 / p.M + (1.0 / p.m_f if mode == AIR and p.massless == 0 else 0.0)))
    if kind == SINE:
        rate = max(rate, row[4])
    n = 2 + int(SAMPLES * rate * h / (2.0 * math.pi))
    for which in range(2):
        a, b = -np.inf, -np.inf
        for i in range(n + 1):
            inside(i / n, t, s, h, exact, arc, q, mode, kind, row, p, work)
            c = motor_force(t + i / n * h, work, mode, slip, memory, kind, row, p, k)[which]
            best = c
            if b > a and b >= c:  # a turn at b
                best = b - 0.125 * (c - a) * (c - a) / (a - 2.0 * b + c) if a > -np.inf else b
            peaks[which] = max(peaks[which], best)
            a, b = b, c
