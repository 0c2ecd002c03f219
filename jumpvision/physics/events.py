"""The jump as it unfolds: adaptive steps, events located in each, and the rules that follow an event.

Where the jumper is linear a step is the closed form (`linear_flow`), else one of Dormand and Prince. An event is the
root of a guard (`granular.guards`), found inside the step to 1e-14 s; the step is then taken again to end there, so the
state at an event has the accuracy of a step. Each piece of the forcing is entered and left exactly.

No accumulation of events (Zeno) is possible: granular contact rests under the set-valued yield rule, a massless foot
on hard ground stays for at least half a period of the spring, and a foot with mass does not bounce. A run of more
than MAX_EVENTS events therefore means wrong parameters and is reported as a failure.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from jumpvision.physics.granular import (
    AIR,
    HARD,
    INTRUDE,
    N_STATE,
    STUCK,
    VF,
    XF,
    W,
    Y,
    foot_inertia,
    grip,
    guards,
    rail_force,
    rhs,
    rod,
    settle,
)
from jumpvision.physics.linear_flow import flow, longest_step
from jumpvision.physics.runge_kutta import ORDER, between, dense, step

Array = NDArray[np.float64]

LIFT_OFF, LANDING, YIELD, STOP, RAIL_STICK, RAIL_SLIP = range(6)
KINDS = ("lift_off", "landing", "intrude", "stop", "rail_stick", "rail_slip")
MAX_EVENTS = 4000
MAX_STEPS = 10_000_000
ROOT = 1e-14  # s, width of the bracket at which an event is found
RESOLVE = 1e-6  # s, a motion not seen to begin within this time has not begun
MARGIN = 0.05  # of a guard's range over a step: how near to zero its parabola may come
NOISE = 1e-14  # m or m/s, rounding of a guard that starts at zero
STILL = 1e-9  # m/s, a slower carriage is at rest when the forcing changes piece
OK, TOO_MANY_EVENTS, STEP_TOO_SMALL = 0, 1, 2

N_OUT = 7
ROD, FOOT, MOTOR, ROD_VELOCITY, FOOT_VELOCITY, GROUND_FORCE, SPRING_FORCE = range(N_OUT)


@njit
def sample(
    t: float, s: Array, mode: int, slip: int, memory: Array, kind: int, row: Array, p: Any, ds: Array, out: Array
) -> None:
    """Writes one row of the output."""
    x_r, v_r, _, x, _ = rod(t, s, kind, row, p)
    force = rhs(t, s, mode, slip, memory, kind, row, p, ds)
    out[ROD], out[MOTOR], out[ROD_VELOCITY], out[SPRING_FORCE] = x_r, x_r + x, v_r, force
    if p.massless == 1 and mode == AIR:
        out[FOOT], out[FOOT_VELOCITY] = x_r, v_r
    else:
        out[FOOT], out[FOOT_VELOCITY] = s[XF], s[VF]
    if mode == AIR:
        out[GROUND_FORCE] = 0.0
    else:  # m_f a_f = -m_f g - F_s + F_GM
        out[GROUND_FORCE] = force + p.m_f * (p.g + ds[VF])


@njit
def inside(
    theta: float, t: float, s: Array, h: float, exact: bool, q: Array, mode: int, kind: int, row: Array, p: Any,
    out: Array,
) -> None:  # fmt: skip
    """Writes the state at the share theta of the step that began at s."""
    if exact:
        flow(t, s, theta * h, mode, kind, row, p, out)
    else:
        between(s, q, theta, out)


@njit
def dips(a: float, b: float, c: float) -> bool:
    """Whether a guard, positive at the begin, middle and end of a step, may reach zero between (parabola)."""
    bend, slope = 2.0 * (a - 2.0 * b + c), 4.0 * b - 3.0 * a - c
    if not 0.0 < -slope < 2.0 * bend:
        return False
    return a - slope * slope / (4.0 * bend) < MARGIN * (max(a, b, c) - min(a, b, c))


@njit
def guard_at(
    i: int, theta: float, t: float, s: Array, h: float, exact: bool, q: Array, work: Array, mode: int, slip: int,
    memory: Array, kind: int, row: Array, p: Any,
) -> float:  # fmt: skip
    """Guard i at the share theta of a step."""
    inside(theta, t, s, h, exact, q, mode, kind, row, p, work)
    return guards(t + theta * h, work, mode, slip, memory, kind, row, p)[i]


@njit
def locate(
    i: int, lo: float, hi: float, t: float, s: Array, h: float, exact: bool, q: Array, work: Array, mode: int,
    slip: int, memory: Array, kind: int, row: Array, p: Any,
) -> float:  # fmt: skip
    """Share of the step where guard i, positive at lo and not at hi, reaches zero (Illinois method)."""
    g_lo = guard_at(i, lo, t, s, h, exact, q, work, mode, slip, memory, kind, row, p)
    g_hi = guard_at(i, hi, t, s, h, exact, q, work, mode, slip, memory, kind, row, p)
    if g_lo <= 0.0:
        return lo
    side = 0
    for n in range(100):
        if (hi - lo) * h <= ROOT or g_hi == 0.0:
            break
        theta = (lo * g_hi - hi * g_lo) / (g_hi - g_lo) if n % 8 != 7 and g_hi < 0.0 else 0.5 * (lo + hi)
        g = guard_at(i, theta, t, s, h, exact, q, work, mode, slip, memory, kind, row, p)
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


@njit
def heights(t: float, s: Array, kind: int, row: Array, p: Any) -> tuple[float, float, float, float]:
    """Height and rate of the rod, then of the centre of mass of the whole robot."""
    x_r, v_r, _, _, _ = rod(t, s, kind, row, p)
    mass = p.M + p.m_f
    return x_r, v_r, (p.M * s[Y] + p.m_f * s[XF]) / mass, (p.M * s[W] + p.m_f * s[VF]) / mass


@njit
def peak(
    which: int, t: float, s: Array, h: float, exact: bool, q: Array, work: Array, mode: int, kind: int, row: Array,
    p: Any,
) -> float:  # fmt: skip
    """Greatest height within a step over which its rate turns from up to down. which: 0 rod, 2 centre of mass."""
    lo, hi = 0.0, 1.0
    best = -np.inf
    for _ in range(25):  # height is of second order in the remaining 1e-8 of the step
        theta = 0.5 * (lo + hi)
        inside(theta, t, s, h, exact, q, mode, kind, row, p, work)
        now = heights(t + theta * h, work, kind, row, p)
        best = max(best, now[which])
        if now[which + 1] > 0.0:
            lo = theta
        else:
            hi = theta
    return best


@njit
def run(
    constants: Any,
    kind: int,
    rows: Array,
    edges: Array,
    s: Array,
    floor: float,
    stop: float,
    t_out: Array,
    out: Array,
    modes: NDArray[np.int64],
    log: Array,
    rtol: float,
    atol: Array,
    max_step: float,
) -> tuple[int, int, float, float, float, float]:
    """Status, number of events, greatest depth, rod height until `stop` and after it, and height of the mass centre.

    constants: (1,) CONSTANTS. rows: (n, 6) pieces of the forcing (`granular.drive`), valid between edges (n + 1,).
    s: (N_STATE,) state at rest at edges[0]. t_out: increasing times >= edges[0]; out (n, N_OUT), modes (n,) and log
    (MAX_EVENTS, 2: time, kind) are filled. max_step [s].
    """
    p = constants[0]
    memory = np.array([floor, 0.0, 0.0])
    s1, work, ds, q = np.empty(N_STATE), np.empty(N_STATE), np.empty(N_STATE), np.empty((N_STATE, 4))
    slopes = np.empty((7, N_STATE))
    armed = np.empty(3, np.bool_)
    mode, slip, h, n_out, n_log = STUCK, 1, 1e-4, 0, 0
    longest, exact, now = max_step, False, (1.0, 1.0, 1.0)
    rod_before, rod_after, com = -np.inf, -np.inf, -np.inf
    for piece in range(rows.shape[0]):
        t, end, row = edges[piece], edges[piece + 1], rows[piece]
        fresh = True  # the equations changed: a forcing piece or a mode begins
        new_mode = settle(t, s, memory, kind, row, p) if mode == STUCK else mode
        was, slip = slip, grip(t, s, mode, kind, row, p, STILL)
        if slip != was and piece > 0:
            log[n_log, 0], log[n_log, 1] = t, RAIL_STICK if slip == 0 else RAIL_SLIP
            n_log += 1
        steps = 0
        while True:
            if fresh:
                if n_log >= log.shape[0] - 4:
                    return TOO_MANY_EVENTS, n_log, memory[0], rod_before, rod_after, com
                if new_mode != mode and mode == STUCK:  # else logged where it happened
                    log[n_log, 0], log[n_log, 1] = t, LIFT_OFF if new_mode == AIR else YIELD
                    n_log += 1
                    if new_mode == AIR:
                        memory[1], memory[2] = memory[0], 0.0
                mode = new_mode
                if slip == 0:
                    v_m = rod(t, s, kind, row, p)[2]
                    s[W] -= v_m
                rhs(t, s, mode, slip, memory, kind, row, p, slopes[0])
                longest = longest_step(mode, kind, row, p)
                exact = longest > 0.0
                longest = min(longest, max_step) if exact else max_step
                now = guards(t, s, mode, slip, memory, kind, row, p)
                armed[0], armed[1], armed[2] = now[0] > 0.0, now[1] > 0.0, now[2] > 0.0
                fresh = False
            if t >= end:
                break
            steps += 1
            if steps > MAX_STEPS:
                return STEP_TOO_SMALL, n_log, memory[0], rod_before, rod_after, com
            h = min(h, longest)
            last = t + 1.000001 * h >= end
            trial = end - t if last else h
            if exact:
                flow(t, s, trial, mode, kind, row, p, s1)
                error = 0.0
            else:
                error = step(t, s, trial, mode, slip, memory, kind, row, p, slopes, s1, rtol, atol)
            if not error <= 1.0:
                h = trial * (max(0.2, 0.9 * error ** (-1.0 / ORDER)) if error < 1e12 else 0.1)
                if h < 1e-13:
                    return STEP_TOO_SMALL, n_log, memory[0], rod_before, rod_after, com
                continue
            # Which guard falls first? Looked at in the middle and at the end of the step.
            if not exact:
                dense(slopes, trial, q)
            inside(0.5, t, s, trial, exact, q, mode, kind, row, p, work)
            middle = guards(t + 0.5 * trial, work, mode, slip, memory, kind, row, p)
            final = guards(t + trial, s1, mode, slip, memory, kind, row, p)
            event, theta, unresolved = -1, 1.0, False
            for i in range(3):
                if armed[i] and middle[i] > 0.0 and final[i] > 0.0:
                    if dips(now[i], middle[i], final[i]) and trial > RESOLVE:
                        unresolved = True
                    continue
                if not armed[i] and middle[i] <= 0.0 and final[i] <= 0.0:
                    if trial > RESOLVE:
                        unresolved = True
                    elif final[i] < -NOISE and theta > 0.0:
                        event, theta = i, 0.0
                    continue
                if middle[i] > 0.0 and final[i] > 0.0:
                    continue
                lo, hi = (0.5, 1.0) if middle[i] > 0.0 else (0.0, 0.5)
                if not armed[i] and middle[i] <= 0.0:
                    continue  # it begins late in the step
                at = locate(i, lo, hi, t, s, trial, exact, q, work, mode, slip, memory, kind, row, p)
                if at < theta or event < 0:
                    event, theta = i, at
            if unresolved:
                h = 0.25 * trial
                continue
            taken = trial
            if event >= 0:
                taken = theta * trial
                if exact:
                    flow(t, s, taken, mode, kind, row, p, s1)
                else:
                    step(t, s, taken, mode, slip, memory, kind, row, p, slopes, s1, rtol, atol)
                    dense(slopes, taken, q)
            else:
                now = final
                for i in range(3):
                    armed[i] = armed[i] or final[i] > 0.0
            # The step stands: heights and output along it.
            a, b = heights(t, s, kind, row, p), heights(t + taken, s1, kind, row, p)
            top = max(a[0], b[0])
            best = rod_after if t >= stop else rod_before  # an arch lies below its tangents: can it be the highest?
            if a[1] > 0.0 >= b[1] and min(a[0] + a[1] * taken, b[0] - b[1] * taken) > best:
                top = max(top, peak(0, t, s, taken, exact, q, work, mode, kind, row, p))
            if t >= stop:
                rod_after = max(rod_after, top)
            else:
                rod_before = max(rod_before, top)
            com = max(com, a[2], b[2])
            if a[3] > 0.0 >= b[3] and min(a[2] + a[3] * taken, b[2] - b[3] * taken) > com:
                com = max(com, peak(2, t, s, taken, exact, q, work, mode, kind, row, p))
            reached = end if last and event < 0 else t + taken
            while n_out < t_out.size and t_out[n_out] <= reached:
                share = (t_out[n_out] - t) / taken if taken > 0.0 else 0.0
                inside(share, t, s, taken, exact, q, mode, kind, row, p, work)
                sample(t_out[n_out], work, mode, slip, memory, kind, row, p, ds, out[n_out])
                modes[n_out] = mode
                n_out += 1
            t = reached
            for j in range(N_STATE):
                s[j] = s1[j]
                slopes[0, j] = slopes[6, j]
            if event < 0:
                h = trial * min(5.0, 0.9 * max(error, 1e-10) ** (-1.0 / ORDER)) if not last else max(h, trial)
                continue
            # Rules of the event.
            fresh, new_mode = True, mode
            if event == 2:
                if slip != 0:
                    slip = grip(t, s, mode, kind, row, p, np.inf)
                else:
                    slip = -1 if rail_force(t, s, mode, kind, row, p) > 0.0 else 1
                log[n_log, 0], log[n_log, 1] = t, RAIL_STICK if slip == 0 else RAIL_SLIP
                n_log += 1
            elif mode == STUCK:
                if p.massless == 1:
                    s[XF], s[VF] = 0.0, 0.0
                new_mode = AIR if event == 0 else INTRUDE
            elif mode == INTRUDE:
                memory[0] = max(memory[0], -s[XF])
                memory[2] = memory[0]
                s[XF], s[VF] = -memory[0], 0.0
                log[n_log, 0], log[n_log, 1] = t, STOP
                n_log += 1
                mode = STUCK
                new_mode = settle(t, s, memory, kind, row, p)
            else:
                log[n_log, 0], log[n_log, 1] = t, LANDING
                n_log += 1
                mode = STUCK
                if p.static == HARD:
                    x_r, v_r, v_m, _, _ = rod(t, s, kind, row, p)
                    s[W] += (np.sqrt(1.0 - p.e) - 1.0) * v_r
                    s[XF], s[VF] = 0.0, 0.0
                    if p.massless == 1:
                        s[Y] -= x_r
                    new_mode = settle(t, s, memory, kind, row, p)
                else:
                    s[XF] = -memory[0]
                    s[VF] *= p.m_f / foot_inertia(memory[0], p)
                    if s[VF] < 0.0:
                        mode, new_mode = INTRUDE, INTRUDE
                    else:
                        s[VF] = 0.0
                        new_mode = settle(t, s, memory, kind, row, p)
                if p.F_c > 0.0:
                    slip = grip(t, s, new_mode, kind, row, p, STILL)
    if mode == INTRUDE:
        memory[0] = max(memory[0], -s[XF])
    return OK, n_log, memory[0], rod_before, rod_after, com
