"""The jump as it unfolds: adaptive steps, events located in each, and the rules that follow an event.

Where the jumper is linear a step is the closed form (`linear_flow`), else one of order 8 (`step`). An event is the
root of a guard (`modes.guards`), found inside the step to 1e-14 s by its dense output, which gives the state there
too; a step also ends on a kink of a law (`Mechanism.bend`), so that each is of a smooth motion. Each
piece of the forcing is entered and left exactly.

No accumulation of events (Zeno) is possible: granular contact rests under the set-valued yield rule, a massless foot
on hard ground stays for at least half a period of the spring, and a foot with mass does not bounce. A run of more
than MAX_EVENTS events therefore means wrong parameters and is reported as a failure.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit
from numba.extending import register_jitable
from numpy.typing import NDArray

from jumpvision.base.arrays import Array

from .granular import (
    AIR,
    ASKED,
    CONTACT,
    IMPULSE,
    INTRUDE,
    LEFT,
    N_MOTION,
    NEVER,
    SINE,
    STUCK,
    VF,
    XF,
    V,
    W,
    Y,
    foot_inertia,
    kinetic,
    lagged,
    left_law,
    motor,
    motor_force,
    prepare,
    rhs,
    rod,
    settling,
)
from .kernel import OPTIONS, kernel_of, number
from .modes import grip, guards, held_between, holding_force, limit, room, settle
from .step import (
    BOW,
    END,
    N_DENSE,
    N_SLOPES,
    ORDER,
    PULL,
    U,
    Z,
    begin,
    between,
    clear_until,
    dense,
    flow,
    longest_step,
    middle,
    step,
)
from .trial import above, first_step, holds, positive, share_to_bend, time_to_bend
from .within import dips, efforts, fastest, heights, inside, locate, paces, peak, sample, spares

LIFT_OFF, LANDING, YIELD, STOP, RAIL_STICK, RAIL_SLIP, MOTOR_HELD, MOTOR_FREE = range(8)
KINDS = ("lift_off", "landing", "intrude", "stop", "rail_stick", "rail_slip", "motor_held", "motor_free")
MAX_EVENTS = 4000
MAX_STEPS = 30_000  # a second, and as many beside: thirty times those of a jump; a motion that runs away has more
RESOLVE = 1e-6  # s, a motion not seen to begin within this time has not begun
ASTRAY = 100.0  # error of a step over its tolerance: where it ends says nothing of the kinks on the way
SMALL = 1e-6  # error of a step over its tolerance: the next may be five times as long
NOISE = 1e-14  # m or m/s, rounding of a guard that starts at zero
STABLE = 5.0  # decays along the real axis in which a step does not grow: 6.1
STILL = 1e-9  # m/s, a slower carriage is at rest when the forcing changes piece
OK, TOO_MANY_EVENTS, STEP_TOO_SMALL, CANNOT_CARRY = 0, 1, 2, 3


@register_jitable(error_model="numpy")
def workspace(n: int, pieces: int) -> Any:
    """Arrays that a run of n states writes to; serves any number of runs, one at a time. pieces: of a forcing that the
    motor lags, else 0."""
    return (
        np.empty(n),
        np.empty(n),
        np.empty((N_DENSE, n)),
        np.empty((N_SLOPES, n)),
        np.empty((1, n)),
        np.empty(4, np.bool_),
        np.empty((pieces, 8)),
    )


@kernel_of
def compiled_run(key: str) -> Callable[..., Any]:
    """`run` compiled for all that follow jumps; key: of all that it is made of, a part of numba's."""

    @njit(**{**OPTIONS, "cache": True, "nogil": True, "no_cpython_wrapper": False})
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
        peaks: Array,
        space: Any,
    ) -> tuple[int, int, float, float, float, float]:
        """Status, number of events, greatest depth, rod height until `stop` and after it, and rise of the mass centre.

        constants: (1,) CONSTANTS. rows: (n, 6) pieces of the forcing (`granular.drive`), valid between edges (n + 1,).
        s: (n,) state at rest at edges[0]. t_out: increasing times >= edges[0]; out (n, N_OUT) or (n, 1), modes (n,) and
        log (MAX_EVENTS, 2: time, kind) are filled; s ends as the state at edges[n]. max_step [s]. space: `workspace`.
        peaks: (6,) greatest, then least motor force [N], power [W] and speed [m/s] until `stop`, without impulses; or
        (0,).
        """
        key  # noqa: B018
        p, size = constants[0], s.size
        s1, work, q, slopes, spare, armed, late = space
        prepare(p)
        p.kind = kind
        if p.tau > 0.0:
            lagged(kind, rows, edges, p.tau, late)
            rows = late
        p.memory[:] = 0.0
        p.memory[0], p.memory[CONTACT] = floor, NEVER
        if peaks.size > 0:
            peaks[:] = 0.0
            peaks[0] = peaks[3] = p.m_m * p.g
        mode, slip, h, n_out, n_log = number(STUCK), number(1), np.inf, 0, 0
        after = 0.0  # s, the step to go on with after one that ends on a kink
        v_old = 0.0  # the motor's rate before an impulse
        longest, exact, now = max_step, False, (1.0, 1.0, 1.0, 1.0)
        rod_before, rod_after, com, low = -np.inf, -np.inf, -np.inf, 0.0
        held, force, pace, watched = -np.inf, (0.0, 0.0, 0.0), (0.0, 0.0), True
        for piece in range(rows.shape[0]):
            t, end = edges[piece], edges[piece + 1]
            for i in range(rows.shape[1]):
                p.row[i] = rows[piece, i]
            p.row[ASKED] = np.nan
            if size > N_MOTION and p.kp == 0.0:
                v_new = motor(t, s, p)[1]
                s[IMPULSE] += kinetic(s, v_new, 0.0, p) - kinetic(s, v_old, 0.0, p)
            if peaks.size > 0 and t < stop and kind == SINE and p.led == 0 and p.tau == 0.0:
                peaks[2] = max(peaks[2], fastest(t, min(end, stop), p))
            fresh = True  # the equations changed: a forcing piece or a mode begins
            new_mode = settle(t, s, p) if mode == STUCK else mode
            if p.kp > 0.0 and (p.memory[3] == 0.0 or not room(t, s, new_mode, slip, p) > 0.0):
                limit(t, s, new_mode, slip, p)
            was, slip = slip, grip(t, s, mode, p, STILL)
            if slip != was and piece > 0:
                log[n_log, 0], log[n_log, 1] = t, RAIL_STICK if slip == 0 else RAIL_SLIP
                n_log += 1
            steps = 0
            while True:
                if fresh:
                    if n_log >= log.shape[0] - 4:
                        return TOO_MANY_EVENTS, n_log, p.memory[0], rod_before, rod_after, com - low
                    if new_mode != mode and mode == STUCK:  # else logged where it happened
                        log[n_log, 0], log[n_log, 1] = t, LIFT_OFF if new_mode == AIR else YIELD
                        n_log += 1
                        if new_mode == AIR:
                            p.memory[1], p.memory[2], p.memory[LEFT] = p.memory[0], 0.0, 0.0
                    mode = new_mode
                    if slip == 0:
                        v_m = rod(t, s, p)[2]
                        s[W] -= v_m
                    longest = longest_step(mode, slip, p) if size == VF + 1 else 0.0
                    exact = longest > 0.0
                    if exact:
                        h = longest = min(longest, max_step)
                        begin(t, s, mode, slip, p)
                    else:
                        longest = max_step
                        if p.kp > 0.0:  # longer, and rounding grows until the error shows it
                            mass = p.m_m * p.m_r / p.M
                            longest = min(longest, STABLE / max(np.sqrt(p.kp / mass), p.kd / mass))
                        rhs(t, s, mode, slip, p, slopes, number(0))
                        if mode == INTRUDE:
                            h = min(h, first_step(s, slopes[0, VF], p))
                    here = heights(t, s, p)
                    if peaks.size > 0 and t < stop:
                        force, pace = motor_force(t, s, mode, slip, p), paces(mode, p)
                        watched = not (exact and mode == AIR and spares(peaks, p))
                    if piece == 0 and steps == 0:
                        low = here[2]
                    now = guards(t, s, mode, slip, p)
                    for i in range(4):
                        armed[i] = now[i] > 0.0
                    fresh = False
                if t >= end:
                    v_old = motor(t, s, p)[1]
                    break
                steps += 1
                if steps > MAX_STEPS * (1.0 + end - edges[0]):
                    return STEP_TOO_SMALL, n_log, p.memory[0], rod_before, rod_after, com - low
                h, clear = min(h, longest), False
                if settling(t, p):
                    h = min(h, t - p.row[7] + 0.5 * p.tau)
                if exact and armed[0] and (mode == AIR or armed[1]):
                    best = rod_after if t >= stop else rod_before
                    free = clear_until(t, s, mode, p, best, com) - t
                    clear = free > h
                    h = max(h, free)
                last = t + 1.000001 * h >= end
                trial = end - t if last else h
                if mode == INTRUDE:
                    ahead = time_to_bend(s, slopes[0, VF], p)
                    if ahead < trial:
                        trial, last, after = ahead, False, max(after, trial)
                if exact:
                    flow(t + trial, mode, p, s1)
                    error = 0.0
                else:
                    error = step(t, s, trial, mode, slip, p, slopes, s1, rtol, atol)
                if mode == INTRUDE and error < ASTRAY:
                    share = share_to_bend(s, s1, trial, p)
                    if share < 1.0:
                        h, after = share * trial, max(after, trial)
                        continue
                if not error <= 1.0:
                    h = trial * (max(0.2, 0.9 * error ** (-1.0 / ORDER)) if error < 1e12 else 0.1)
                    if h < 1e-13:
                        return STEP_TOO_SMALL, n_log, p.memory[0], rod_before, rod_after, com - low
                    continue
                # Which guard falls first? Looked at in the middle and at the end of the step.
                final = guards(t + trial, s1, mode, slip, p)
                known, event, theta = exact, -1, 1.0
                if not (clear or (exact and holds(now, final, p.arc[BOW] * trial * trial, mode, p))):
                    if exact:
                        flow(t + 0.5 * trial, mode, p, work)
                    else:
                        middle(s, s1, slopes, trial, work)
                    half = guards(t + 0.5 * trial, work, mode, slip, p)
                    if not (exact or (positive(now) and positive(final) and above(half, now, final))):
                        dense(t, s, trial, mode, slip, p, slopes, s1, work, q)
                        known = True
                        between(s, q, 0.5, work)
                        half = guards(t + 0.5 * trial, work, mode, slip, p)
                    unresolved = False
                    for i in range(4):
                        if half[i] > 0.0 and final[i] > 0.0:
                            if armed[i] and dips(now[i], half[i], final[i]) and trial > RESOLVE:
                                unresolved = True
                            continue
                        if not armed[i] and half[i] <= 0.0:  # not begun yet, or late in the step
                            if final[i] <= 0.0:
                                if trial > RESOLVE:
                                    unresolved = True
                                elif final[i] < -NOISE and theta > 0.0 and not (mode == STUCK and t < held):
                                    event, theta = i, 0.0
                            continue
                        if not known:
                            dense(t, s, trial, mode, slip, p, slopes, s1, work, q)
                            known = True
                        ends = (now[i], half[i], final[i])
                        at = locate(i, half[i] <= 0.0, ends, t, s, trial, trial, exact, q, work, mode, slip, p)
                        if at < theta or event < 0:
                            event, theta = i, at
                    if unresolved:
                        h = 0.25 * trial
                        continue
                taken, wide = trial, trial  # wide: of the step that the dense output is of
                if event >= 0:
                    taken = theta * trial
                    if exact:
                        flow(t + taken, mode, p, s1)
                    elif known:
                        between(s, q, theta, s1)
                    else:
                        step(t, s, taken, mode, slip, p, slopes, s1, rtol, atol)
                        known, wide = False, taken
                else:
                    now = final
                    for i in range(4):
                        armed[i] = armed[i] or final[i] > 0.0
                # The step stands: heights and output along it.
                a, b = here, heights(t + taken, s1, p)
                here = b
                top = max(a[0], b[0])
                best = rod_after if t >= stop else rod_before  # an arch lies below its tangents: can it be the highest?
                rod_turns = not clear and a[1] > 0.0 >= b[1] and min(a[0] + a[1] * taken, b[0] - b[1] * taken) > best
                com_turns = a[3] > 0.0 >= b[3] and min(a[2] + a[3] * taken, b[2] - b[3] * taken) > com
                reached = end if last and event < 0 else t + taken
                effort = watched and peaks.size > 0 and t < stop
                if not known and (rod_turns or com_turns or (n_out < t_out.size and t_out[n_out] <= reached)):
                    known = True
                    dense(t, s, taken, mode, slip, p, slopes, s1, work, q)
                if rod_turns:
                    top = max(top, peak(number(0), t, s, taken, wide, b, exact, q, work, mode, p))
                if t >= stop:
                    rod_after = max(rod_after, top)
                else:
                    rod_before = max(rod_before, top)
                com = max(com, a[2], b[2])
                if com_turns and exact and mode == AIR:
                    com = max(com, p.arc[Z] + 0.5 * p.arc[U] * p.arc[U] / p.arc[PULL])
                elif com_turns:
                    com = max(com, peak(number(2), t, s, taken, wide, b, exact, q, work, mode, p))
                while effort:
                    found, done = efforts(
                        t,
                        s,
                        taken,
                        wide,
                        s1,
                        force,
                        pace,
                        exact,
                        known,
                        q,
                        work,
                        mode,
                        slip,
                        p,
                        slopes,
                        peaks,
                    )
                    if done:
                        force, effort = found, False
                    else:
                        dense(t, s, taken, mode, slip, p, slopes, s1, work, q)
                        known = True
                while n_out < t_out.size and t_out[n_out] <= reached:
                    share = (t_out[n_out] - t) / taken if taken > 0.0 else 0.0
                    inside(share, t, s, taken, wide, exact, q, mode, p, work)
                    sample(t_out[n_out], work, mode, slip, p, spare, out[n_out])
                    modes[n_out] = mode
                    n_out += 1
                t = reached
                for j in range(size):
                    s[j] = s1[j]
                    slopes[0, j] = slopes[END, j]
                if event < 0:
                    if last or after > 0.0:
                        h, after = max(trial, after), 0.0
                    else:
                        h = trial * (min(5.0, 0.8 * error ** (-1.0 / ORDER)) if error > SMALL else 5.0)
                    continue
                after = 0.0
                # Rules of the event.
                fresh, new_mode = True, mode
                if event == 3:
                    before = kinetic(s, s[V], 0.0, p)
                    limit(t, s, mode, slip, p)
                    if size > N_MOTION:  # what the end of the travel takes
                        s[IMPULSE] += kinetic(s, s[V], 0.0, p) - before
                    log[n_log, 0], log[n_log, 1] = t, MOTOR_FREE if p.memory[3] == 0.0 else MOTOR_HELD
                    n_log += 1
                    slip = grip(t, s, mode, p, STILL)
                elif event == 2:
                    if slip != 0:
                        slip = grip(t, s, mode, p, np.inf)
                    else:
                        least, most = held_between(t, s, p)
                        slip = -1 if holding_force(t, s, mode, p) > 0.5 * (least + most) else 1
                    log[n_log, 0], log[n_log, 1] = t, RAIL_STICK if slip == 0 else RAIL_SLIP
                    n_log += 1
                elif mode == STUCK:
                    if p.massless == 1:
                        s[XF], s[VF] = 0.0, 0.0
                    new_mode = AIR if event == 0 else INTRUDE
                elif mode == INTRUDE:
                    if taken == 0.0:  # an intrusion over before it could be seen: the foot rests meanwhile
                        held = t + RESOLVE
                    p.memory[0] = max(p.memory[0], -s[XF])
                    if p.left != 0 and p.memory[0] > p.memory[2]:  # else the same pause goes on
                        p.memory[LEFT] = left_law(p, (p.memory[0], p.memory[2], p.memory[LEFT]))
                    p.memory[2] = p.memory[0]
                    s[XF], s[VF] = -p.memory[0], 0.0
                    log[n_log, 0], log[n_log, 1] = t, STOP
                    n_log += 1
                    mode = STUCK
                    new_mode = STUCK if t < held else settle(t, s, p)
                else:
                    log[n_log, 0], log[n_log, 1] = t, LANDING
                    n_log += 1
                    mode, p.memory[CONTACT] = STUCK, t
                    v = motor(t, s, p)[1] if size > N_MOTION else 0.0
                    before = kinetic(s, v, p.m_f, p)
                    if p.sand == 0:
                        x_r, v_r, v_m, _, _ = rod(t, s, p)
                        s[W] += (np.sqrt(1.0 - p.e) - 1.0) * v_r
                        s[XF], s[VF] = 0.0, 0.0
                        if p.massless == 1:
                            s[Y] -= x_r
                        new_mode = settle(t, s, p)
                    else:
                        s[XF] = -p.memory[0]
                        s[VF] *= p.m_f / foot_inertia(t, p.memory[0], s, p)
                        if s[VF] < 0.0:
                            mode, new_mode = INTRUDE, INTRUDE
                        else:
                            s[VF] = 0.0
                            new_mode = settle(t, s, p)
                    if size > N_MOTION:
                        mass = p.m_f if p.sand == 0 else foot_inertia(t, p.memory[0], s, p)
                        s[size - 1] += before - kinetic(s, v, mass, p)
                    if p.dry == 1:
                        slip = grip(t, s, new_mode, p, STILL)
        if mode == INTRUDE:
            p.memory[0] = max(p.memory[0], -s[XF])
        return OK, n_log, p.memory[0], rod_before, rod_after, com - low

    return run
