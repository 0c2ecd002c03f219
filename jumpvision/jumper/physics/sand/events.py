"""What each event does in each mode. A new rule is a kernel and its line in RULES."""

from __future__ import annotations

import numpy as np

from jumpvision.base.arrays import Array

from .granular import (
    AIR,
    CONTACT,
    FLOOR,
    HOLE,
    IMPULSE,
    INTRUDE,
    LEFT,
    N_MOTION,
    PAUSE,
    STUCK,
    VF,
    XF,
    V,
    W,
    Y,
    foot_inertia,
    kinetic,
    left_law,
    motor,
    rod,
)
from .kernel import by_table, kernel
from .modes import grip, held_between, holding_force, limit, settle
from .packed import Packed

LIFT_OFF, LANDING, YIELD, STOP, RAIL_STICK, RAIL_SLIP, MOTOR_HELD, MOTOR_FREE = range(8)
KINDS = ("lift_off", "landing", "intrude", "stop", "rail_stick", "rail_slip", "motor_held", "motor_free")
LEAVES, MOVES, RAIL, MOTOR = range(4)
"""Guards that fall: the foot leaves ground or air; it yields or stops; the rail sticks or slips; the motor's limit."""
RESOLVE = 1e-6  # s, a motion not seen to begin within this time has not begun
STILL = 1e-9  # m/s, a slower carriage is at rest when the forcing changes piece


@kernel
def note(t: float, kind: int, p: Packed, log: Array) -> None:
    """Writes an event to the log."""
    log[p.events, 0], log[p.events, 1] = t, kind
    p.events += 1


@kernel
def motor_limit(s: Array, p: Packed, log: Array) -> None:
    """The motor meets a limit, or leaves it."""
    before = kinetic(s, s[V], 0.0, p)
    limit(p.t, s, p.mode, p.slip, p)
    if s.size > N_MOTION:  # what the end of the travel takes
        s[IMPULSE] += kinetic(s, s[V], 0.0, p) - before
    note(p.t, MOTOR_FREE if p.memory[3] == 0.0 else MOTOR_HELD, p, log)
    p.slip = grip(p.t, s, p.mode, p, STILL)


@kernel
def rail_turns(s: Array, p: Packed, log: Array) -> None:
    """The carriage comes to rest and is held or goes back; or it is held no longer."""
    if p.slip != 0:
        p.slip = grip(p.t, s, p.mode, p, np.inf)
    else:
        least, most = held_between(p.t, s, p)
        p.slip = -1 if holding_force(p.t, s, p.mode, p) > 0.5 * (least + most) else 1
    note(p.t, RAIL_STICK if p.slip == 0 else RAIL_SLIP, p, log)


@kernel
def lift_off(s: Array, p: Packed, log: Array) -> None:
    """The foot is pulled off the ground; logged as the mode begins."""
    if p.massless == 1:
        s[XF], s[VF] = 0.0, 0.0
    p.next = AIR


@kernel
def yields(s: Array, p: Packed, log: Array) -> None:
    """The ground gives way under the foot; logged as the mode begins."""
    if p.massless == 1:
        s[XF], s[VF] = 0.0, 0.0
    p.next = INTRUDE


@kernel
def stops(s: Array, p: Packed, log: Array) -> None:
    """An intrusion ends: the bed remembers its depth, and the foot rests there."""
    if p.taken == 0.0:  # an intrusion over before it could be seen: the foot rests meanwhile
        p.held = p.t + RESOLVE
    m = p.memory
    m[FLOOR] = max(m[FLOOR], -s[XF])
    if p.left != 0 and m[FLOOR] > m[PAUSE]:  # else the same pause goes on
        m[LEFT] = left_law(p, (m[FLOOR], m[PAUSE], m[LEFT]))
    m[PAUSE] = m[FLOOR]
    s[XF], s[VF] = -m[FLOOR], 0.0
    note(p.t, STOP, p, log)
    p.mode = STUCK
    p.next = STUCK if p.t < p.held else settle(p.t, s, p)


@kernel
def lands(s: Array, p: Packed, log: Array) -> None:
    """The foot comes down: stopped by hard ground, or on a bed with the grains that it takes along."""
    note(p.t, LANDING, p, log)
    p.mode, p.memory[CONTACT] = STUCK, p.t
    v = motor(p.t, s, p)[1] if s.size > N_MOTION else 0.0
    before = kinetic(s, v, p.m_f, p)
    if p.sand == 0:
        x_r, v_r, _, _, _ = rod(p.t, s, p)
        s[W] += (np.sqrt(1.0 - p.e) - 1.0) * v_r
        s[XF], s[VF] = 0.0, 0.0
        if p.massless == 1:
            s[Y] -= x_r
        p.next = settle(p.t, s, p)
        mass = p.m_f
    else:
        mass = foot_inertia(p.t, p.memory[FLOOR], s, p)
        s[XF] = -p.memory[FLOOR]
        s[VF] *= p.m_f / mass
        if s[VF] < 0.0:
            p.mode, p.next = INTRUDE, INTRUDE
        else:
            s[VF] = 0.0
            p.next = settle(p.t, s, p)
    if s.size > N_MOTION:
        s[s.size - 1] += before - kinetic(s, v, mass, p)
    if p.dry == 1:
        p.slip = grip(p.t, s, p.next, p, STILL)


@kernel
def begins(s: Array, p: Packed, log: Array) -> None:
    """A foot that was at rest moves: with what it leaves the ground, the bed remembers its hole."""
    note(p.t, LIFT_OFF if p.next == AIR else YIELD, p, log)
    if p.next == AIR:
        p.memory[HOLE], p.memory[PAUSE], p.memory[LEFT] = p.memory[FLOOR], 0.0, 0.0


RULES = {
    (LEAVES, STUCK): lift_off,
    (MOVES, STUCK): yields,
    (MOVES, INTRUDE): stops,
    (LEAVES, AIR): lands,
    **{(RAIL, mode): rail_turns for mode in (AIR, STUCK, INTRUDE)},
    **{(MOTOR, mode): motor_limit for mode in (AIR, STUCK, INTRUDE)},
}
"""(guard that falls, mode) -> what it does to state, mode, slip and memory: each sets p.next, the mode that follows."""
happen = by_table(RULES)
