"""The jump as it unfolds: adaptive steps, events located in each, and the rules that follow an event (`events`).

Where the jumper is linear a step is the closed form (`linear_flow`), else one of order 8 (`step`). An event is the
root of a guard (`modes.guards`), found inside the step to 1e-14 s by its dense output, which gives the state there
too; a step also ends on a kink of a law (`engine.laws.derivative.kinks`), so that each is of a smooth motion. Each
piece of the forcing is entered and left exactly.

No accumulation of events (Zeno) is possible: granular contact rests under the set-valued yield rule, a massless foot
on hard ground stays for at least half a period of the spring, and a foot with mass does not bounce. A run of more
than MAX_EVENTS events therefore means wrong parameters and is reported as a failure. Where a run is stands in its
packed model (`granular.CONSTANTS`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numba.extending import register_jitable
from numpy.typing import NDArray

from jumpvision.base.arrays import Array

from .events import RAIL_SLIP, RAIL_STICK, RESOLVE, STILL, begins, happen, note
from .granular import (
    AIR,
    ASKED,
    CONTACT,
    FLOOR,
    IMPULSE,
    INTRUDE,
    N_MOTION,
    NEVER,
    SINE,
    STUCK,
    VF,
    XF,
    Guards,
    V,
    W,
    X,
    Y,
    kinetic,
    lagged,
    motor,
    motor_force,
    prepare,
    rhs,
    rod,
    settling,
)
from .kernel import OPTIONS, inlined, kernel, kernel_of, number
from .modes import depth, grip, guards, limit, room, settle, squeeze
from .packed import Packed
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
from .trial import above, first_step, foot_rate, holds, positive, share_to_bend, time_to_bend
from .within import dips, efforts, fastest, heights, inside, locate, paces, peak, sample, spares

MAX_EVENTS = 4000
OK, TOO_MANY_EVENTS, STEP_TOO_SMALL, CANNOT_CARRY = 0, 1, 2, 3
NONE, UNRESOLVED = -1, -2  # of an event in a step: look again in shorter ones


Marks = NDArray[np.bool_]
Modes = NDArray[np.int64]


class Space(NamedTuple):
    """Arrays that a run writes to: its state (n,), its tolerance, and what its steps need.

    Functions that take these at every step are `inlined`: as calls a jump took 1.5 times as long (benchmarks.granular).
    """

    s: Array
    tolerance: Array
    s1: Array
    work: Array
    q: Array
    slopes: Array
    spare: Array
    armed: Marks
    late: Array


@register_jitable(error_model="numpy")
def workspace(n: int, pieces: int) -> Space:
    """Of a run of n states; serves any number of runs, one at a time. pieces: of a forcing that the motor lags, else
    0."""
    return Space(
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.empty((N_DENSE, n)),
        np.empty((N_SLOPES, n)),
        np.empty((1, n)),
        np.empty(4, np.bool_),
        np.empty((pieces, 8)),
    )


@kernel
def states(p: Packed) -> int:
    """How many states a motion has; those of the ledger come on top."""
    return N_MOTION if p.led == 1 or p.inner != 0 else X


@kernel
def at_rest(p: Packed) -> bool:
    """Sets height and depth of the robot at rest before it jumps; False where the bed cannot carry it."""
    prepare(p)
    p.deep = depth(p)
    p.height = -squeeze(p) - p.deep
    return not math.isnan(p.deep)


@kernel
def tolerances(p: Packed, atol: float, out: Array) -> float:
    """Writes atol [m] of the states: of velocities times the rate [1/s] at which the spring swings what moves with
    them, of the foot its own, of energies times the weight; returns the spring's rate."""
    rate = math.sqrt(p.k_s / p.M)
    for i in range(out.size):
        out[i] = atol
        if i == W or V <= i < N_MOTION:
            out[i] *= rate
        elif i >= N_MOTION:
            out[i] *= p.M * p.g
    out[VF] *= foot_rate(p.k_s, p.M, p.m_f)
    return rate


@kernel
def launch(kind: int, before: float, atol: float, peaks: Array, s: Array, tolerance: Array, p: Packed) -> None:
    """Everything as it is before the forcing; before [m]: where the motor stands."""
    p.kind, p.rest = kind, p.height + before
    p.longest = 2.0 * math.pi / tolerances(p, atol, tolerance) / 4  # of the spring: events are looked for twice a step
    s[:] = 0.0
    s[Y], s[XF] = p.height + p.ratio * before, -p.deep
    if s.size > X:
        s[X] = before
    p.memory[:] = 0.0
    p.memory[FLOOR], p.memory[CONTACT] = p.deep, NEVER
    if peaks.size > 0:
        peaks[:] = 0.0
        peaks[0] = peaks[3] = p.m_m * p.g
    p.mode, p.slip, p.watched, p.events, p.sampled = STUCK, 1, 1, 0, 0
    p.h, p.held, p.after, p.v_old = np.inf, -np.inf, 0.0, 0.0
    p.rod_before = p.rod_after = p.com = -np.inf
    p.lowest = 0.0


@kernel
def enter(piece: int, rows: Array, edges: Array, stop: float, s: Array, peaks: Array, log: Array, p: Packed) -> None:
    """Begins a piece of the forcing: an impulse where its rate jumps, and what then no longer holds."""
    t = edges[piece]
    p.t, p.fresh = t, 1
    for i in range(rows.shape[1]):
        p.row[i] = rows[piece, i]
    p.row[ASKED] = np.nan
    if s.size > N_MOTION and p.kp == 0.0:
        s[IMPULSE] += kinetic(s, motor(t, s, p)[1], 0.0, p) - kinetic(s, p.v_old, 0.0, p)
    if peaks.size > 0 and t < stop and p.kind == SINE and p.led == 0 and p.tau == 0.0:
        peaks[2] = max(peaks[2], fastest(t, min(edges[piece + 1], stop), p))
    p.next = settle(t, s, p) if p.mode == STUCK else p.mode
    if p.kp > 0.0 and (p.memory[3] == 0.0 or not room(t, s, p.next, p.slip, p) > 0.0):
        limit(t, s, p.next, p.slip, p)
    was = p.slip
    p.slip = grip(t, s, p.mode, p, STILL)
    if p.slip != was and piece > 0:
        note(t, RAIL_STICK if p.slip == 0 else RAIL_SLIP, p, log)


@kernel
def begin_mode(
    most: float, stop: float, s: Array, slopes: Array, armed: Marks, peaks: Array, log: Array, p: Packed
) -> None:
    """After an event or with a piece of the forcing: other equations hold. most [s]: longest step."""
    if p.next != p.mode and p.mode == STUCK:  # else logged where it happened
        begins(s, p, log)
    p.mode = mode = p.next
    t, slip = p.t, p.slip
    if slip == 0:
        s[W] -= rod(t, s, p)[2]
    longest = longest_step(mode, slip, p) if s.size == VF + 1 else 0.0
    p.exact = 1 if longest > 0.0 else 0
    if p.exact == 1:
        p.h = p.longest = min(longest, most)
        begin(t, s, mode, slip, p)
    else:
        p.longest = most
        if p.kp > 0.0:  # longer, and rounding grows until the error shows it
            mass = p.m_m * p.m_r / p.M
            # decays along the real axis: from 6.1 on a step grows
            p.longest = min(most, 5.0 / max(np.sqrt(p.kp / mass), p.kd / mass))
        rhs(t, s, mode, slip, p, slopes, number(0))
        if mode == INTRUDE:
            p.h = min(p.h, first_step(s, slopes[0, VF], p))
    p.here[0], p.here[1], p.here[2], p.here[3] = heights(t, s, p)
    if peaks.size > 0 and t < stop:
        p.force[0], p.force[1], p.force[2] = motor_force(t, s, mode, slip, p)
        p.pace[0], p.pace[1] = paces(mode, p)
        p.watched = 0 if p.exact == 1 and mode == AIR and spares(peaks, p) else 1
    now = guards(t, s, mode, slip, p)
    for i in range(4):
        p.now[i], armed[i] = now[i], now[i] > 0.0
    p.fresh = 0


@inlined
def planned(end: float, stop: float, s: Array, slopes: Array, armed: Marks, p: Packed) -> tuple[float, bool, bool]:
    """Step [s] to try, whether it ends the piece, whether no event can be in it."""
    t, p.h, clear = p.t, min(p.h, p.longest), False
    if settling(t, p):
        p.h = min(p.h, t - p.row[7] + 0.5 * p.tau)
    if p.exact == 1 and armed[0] and (p.mode == AIR or armed[1]):
        free = clear_until(t, s, p.mode, p, p.rod_after if t >= stop else p.rod_before, p.com) - t
        clear = free > p.h
        p.h = max(p.h, free)
    last = t + 1.000001 * p.h >= end
    trial = end - t if last else p.h
    if p.mode == INTRUDE:
        ahead = time_to_bend(s, slopes[0, VF], p)
        if ahead < trial:
            p.after = max(p.after, trial)
            trial, last = ahead, False
    return trial, last, clear


@inlined
def tried(trial: float, rtol: float, space: Space, p: Packed) -> tuple[float, bool]:
    """Writes the state after the step to s1: its error over its tolerance, and whether it stands; else p.h shrinks."""
    s, s1 = space.s, space.s1
    if p.exact == 1:
        flow(p.t + trial, p.mode, p, s1)
        error = 0.0
    else:
        error = step(p.t, s, trial, p.mode, p.slip, p, space.slopes, s1, rtol, space.tolerance)
    # times the tolerance: where such a step ends says nothing of the kinks on the way
    if p.mode == INTRUDE and error < 100.0:
        share = share_to_bend(s, s1, trial, p)
        if share < 1.0:
            p.h, p.after = share * trial, max(p.after, trial)
            return error, False
    if error <= 1.0:
        return error, True
    p.h = trial * (max(0.2, 0.9 * error ** (-1.0 / ORDER)) if error < 1e12 else 0.1)
    return error, False


@inlined
def first_event(trial: float, final: Guards, space: Space, p: Packed) -> tuple[int, float, bool]:
    """Which guard falls first in a step, looked at in the middle and at the end: (guard or NONE or UNRESOLVED, share of
    the step, whether its dense output is written). final: guards at its end."""
    s, s1, work, q, slopes, armed = space.s, space.s1, space.work, space.q, space.slopes, space.armed
    t, mode, slip, exact = p.t, p.mode, p.slip, p.exact == 1
    now = (p.now[0], p.now[1], p.now[2], p.now[3])
    known, event, theta, unresolved = exact, NONE, 1.0, False
    if exact and holds(now, final, p.arc[BOW] * trial * trial, mode, p):
        return event, theta, known
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
    for i in range(4):
        if half[i] > 0.0 and final[i] > 0.0:
            if armed[i] and dips(now[i], half[i], final[i]) and trial > RESOLVE:
                unresolved = True
            continue
        if not armed[i] and half[i] <= 0.0:  # not begun yet, or late in the step
            if final[i] <= 0.0:
                if trial > RESOLVE:
                    unresolved = True
                # a guard that starts at zero is rounded to 1e-14 m or m/s
                elif final[i] < -1e-14 and theta > 0.0 and not (mode == STUCK and t < p.held):
                    event, theta = i, 0.0
            continue
        if not known:
            dense(t, s, trial, mode, slip, p, slopes, s1, work, q)
            known = True
        ends = (now[i], half[i], final[i])
        at = locate(i, half[i] <= 0.0, ends, t, s, trial, trial, exact, q, work, mode, slip, p)
        if at < theta or event < 0:
            event, theta = i, at
    return UNRESOLVED if unresolved else event, theta, known


@inlined
def cut(
    event: int, theta: float, trial: float, known: bool, rtol: float, space: Space, p: Packed
) -> tuple[float, bool]:
    """Writes the state at an event to s1: the step [s] that the dense output is of, and whether it is written."""
    p.taken = theta * trial
    if p.exact == 1:
        flow(p.t + p.taken, p.mode, p, space.s1)
    elif known:
        between(space.s, space.q, theta, space.s1)
    else:
        step(p.t, space.s, p.taken, p.mode, p.slip, p, space.slopes, space.s1, rtol, space.tolerance)
        return p.taken, False
    return trial, known


@inlined
def rises(wide: float, clear: bool, known: bool, asked: bool, stop: float, space: Space, p: Packed) -> bool:
    """Raises the greatest heights to those along a step that stands, p.taken from p.t to s1; whether its dense output
    is written then. asked: it is needed anyway."""
    s, s1, work, q = space.s, space.s1, space.work, space.q
    t, taken, mode, exact = p.t, p.taken, p.mode, p.exact == 1
    a = (p.here[0], p.here[1], p.here[2], p.here[3])
    b = heights(t + taken, s1, p)
    p.here[0], p.here[1], p.here[2], p.here[3] = b
    best = p.rod_after if t >= stop else p.rod_before  # an arch lies below its tangents: can it be the highest?
    rod_turns = not clear and a[1] > 0.0 >= b[1] and min(a[0] + a[1] * taken, b[0] - b[1] * taken) > best
    com_turns = a[3] > 0.0 >= b[3] and min(a[2] + a[3] * taken, b[2] - b[3] * taken) > p.com
    if not known and (rod_turns or com_turns or asked):
        known = True
        dense(t, s, taken, mode, p.slip, p, space.slopes, s1, work, q)
    top = max(a[0], b[0])
    if rod_turns:
        top = max(top, peak(number(0), t, s, taken, wide, b, exact, q, work, mode, p))
    if t >= stop:
        p.rod_after = max(p.rod_after, top)
    else:
        p.rod_before = max(p.rod_before, top)
    p.com = max(p.com, a[2], b[2])
    if com_turns and exact and mode == AIR:
        p.com = max(p.com, p.arc[Z] + 0.5 * p.arc[U] * p.arc[U] / p.arc[PULL])
    elif com_turns:
        p.com = max(p.com, peak(number(2), t, s, taken, wide, b, exact, q, work, mode, p))
    return known


@inlined
def strains(wide: float, known: bool, peaks: Array, space: Space, p: Packed) -> None:
    """Raises the motor's peaks to those along the step."""
    s, s1, work, q, slopes = space.s, space.s1, space.work, space.q, space.slopes
    t, h, mode, slip, exact = p.t, p.taken, p.mode, p.slip, p.exact == 1
    f, pace = (p.force[0], p.force[1], p.force[2]), (p.pace[0], p.pace[1])
    while True:
        end, done = efforts(t, s, h, wide, s1, f, pace, exact, known, q, work, mode, slip, p, slopes, peaks)
        if done:
            p.force[0], p.force[1], p.force[2] = end
            return
        dense(t, s, h, mode, slip, p, slopes, s1, work, q)
        known = True


@inlined
def write(reached: float, wide: float, t_out: Array, out: Array, modes: Modes, space: Space, p: Packed) -> None:
    """Rows of output along the step."""
    while p.sampled < t_out.size and t_out[p.sampled] <= reached:
        at, exact = t_out[p.sampled], p.exact == 1
        share = (at - p.t) / p.taken if p.taken > 0.0 else 0.0
        inside(share, p.t, space.s, p.taken, wide, exact, space.q, p.mode, p, space.work)
        sample(at, space.work, p.mode, p.slip, p, space.spare, out[p.sampled])
        modes[p.sampled] = p.mode
        p.sampled += 1


@kernel_of
def compiled_run(key: str) -> Callable[..., int]:
    """`run` compiled for all that follow jumps; key: of all that it is made of, a part of numba's."""

    @njit(**{**OPTIONS, "cache": True, "nogil": True, "no_cpython_wrapper": False})
    def run(
        constants: Sequence[Packed],
        kind: int,
        rows: Array,
        edges: Array,
        before: float,
        stop: float,
        t_out: Array,
        out: Array,
        modes: Modes,
        log: Array,
        rtol: float,
        atol: float,
        peaks: Array,
        space: Space,
    ) -> int:
        """Follows a robot from rest through its forcing; returns a status.

        What it found it leaves in the packed model: events, memory (greatest depth), height (at rest), rod_before and
        rod_after (until `stop`, and after it), com and lowest.

        constants: (1,) CONSTANTS. rows: (n, 6) pieces of the forcing (`granular.drive`), valid between edges (n + 1,).
        before [m]: where the motor stands before it. t_out: increasing times >= edges[0]; out (n, N_OUT) or (n, 1),
        modes (n,) and log (MAX_EVENTS, 2: time, kind) are filled; space: `workspace`, its s ends as the state at
        edges[n]. peaks: (6,) greatest, then least motor force [N], power [W] and speed [m/s] until `stop`, without
        impulses; or (0,).
        """
        key  # noqa: B018
        p, s = constants[0], space.s
        if not at_rest(p):
            return CANNOT_CARRY
        launch(kind, before, atol, peaks, s, space.tolerance, p)
        most = p.longest
        if p.tau > 0.0:
            lagged(kind, rows, edges, p.tau, space.late)
            rows = space.late
        for piece in range(rows.shape[0]):
            enter(piece, rows, edges, stop, s, peaks, log, p)
            end, steps = edges[piece + 1], 0
            while True:
                if p.fresh == 1:
                    if p.events >= log.shape[0] - 4:
                        return TOO_MANY_EVENTS
                    begin_mode(most, stop, s, space.slopes, space.armed, peaks, log, p)
                    if piece == 0 and steps == 0:
                        p.lowest = p.here[2]
                if p.t >= end:
                    p.v_old = motor(p.t, s, p)[1]
                    break
                steps += 1
                # a second, and as many beside: thirty times those of a jump; a motion that runs away has more
                if steps > 30_000 * (1.0 + end - edges[0]):
                    return STEP_TOO_SMALL
                trial, last, clear = planned(end, stop, s, space.slopes, space.armed, p)
                error, stands = tried(trial, rtol, space, p)
                if not stands:
                    if not error <= 1.0 and p.h < 1e-13:
                        return STEP_TOO_SMALL
                    continue
                final = guards(p.t + trial, space.s1, p.mode, p.slip, p)
                event, theta, known = NONE, 1.0, p.exact == 1
                if not clear:
                    event, theta, known = first_event(trial, final, space, p)
                if event == UNRESOLVED:
                    p.h = 0.25 * trial
                    continue
                p.taken, wide = trial, trial
                if event >= 0:
                    wide, known = cut(event, theta, trial, known, rtol, space, p)
                else:
                    for i in range(4):
                        p.now[i] = final[i]
                        space.armed[i] = space.armed[i] or final[i] > 0.0
                reached = end if last and event < 0 else p.t + p.taken
                asked = p.sampled < t_out.size and t_out[p.sampled] <= reached
                known = rises(wide, clear, known, asked, stop, space, p)
                if p.watched == 1 and peaks.size > 0 and p.t < stop:
                    strains(wide, known, peaks, space, p)
                write(reached, wide, t_out, out, modes, space, p)
                p.t = reached
                for j in range(s.size):
                    s[j] = space.s1[j]
                    space.slopes[0, j] = space.slopes[END, j]
                if event >= 0:
                    p.after, p.fresh, p.next = 0.0, 1, p.mode
                    happen(event, p.mode, s, p, log)
                elif last or p.after > 0.0:
                    p.h, p.after = max(trial, p.after), 0.0
                else:
                    # the error over its tolerance: the next may be five times as long
                    p.h = trial * (min(5.0, 0.8 * error ** (-1.0 / ORDER)) if error > 1e-6 else 5.0)
        if p.mode == INTRUDE:
            p.memory[FLOOR] = max(p.memory[FLOOR], -s[XF])
        return OK

    return run
