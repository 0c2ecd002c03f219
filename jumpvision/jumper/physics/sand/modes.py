"""Rules of the hybrid system: where a mode ends, what a foot at rest and a held rail do next; the robot at rest.

Modes and states are those of `granular`; a guard is positive while a mode lasts.
"""

from __future__ import annotations

import math

from jumpvision.base.arrays import Array

from .granular import (
    AIR,
    INTRUDE,
    NEVER,
    STUCK,
    VF,
    XF,
    Guards,
    V,
    X,
    ground_law,
    loop_acceleration,
    rail_force,
    rod,
    spring_force,
    spring_law,
    spring_slope,
    yield_force,
)
from .kernel import kernel, number
from .laws import REST
from .packed import Packed


@kernel
def room(t: float, s: Array, mode: int, slip: int, p: Packed) -> float:
    """Positive while the motor is away from its limits, or while the loop presses it against the one that holds it.

    p.memory[3], what holds it: +-2 an end of the travel, where it stands; +-1 its greatest speed; 0 nothing.
    """
    held, distance = p.memory[3], min(p.high - s[X], s[X] - p.low)
    if held == 0.0:
        return min(distance, p.max_speed - abs(s[V]))
    x_r, v_r, v_m, _, _ = rod(t, s, p)
    pressed = loop_acceleration(t, s, spring_force(x_r, v_r, s, mode, p), x_r, v_m, slip, p)
    pressed = (pressed if held > 0.0 else -pressed) + p.slack / p.m_r
    return pressed if abs(held) == 2.0 else min(distance, pressed)


@kernel
def limit(t: float, s: Array, mode: int, slip: int, p: Packed) -> None:
    """Stops the motor at an end of its travel, holds it at its greatest speed, or lets it go: sets memory[3], X, V."""
    side = 1.0 if p.high - s[X] < s[X] - p.low else -1.0
    at = 1e-9  # m or m/s: so near to a limit the motor is at it
    if min(p.high - s[X], s[X] - p.low) <= at and side * s[V] >= 0.0 and abs(p.memory[3]) != 2.0:
        s[X], s[V] = p.high if side > 0.0 else p.low, 0.0  # between motor and rod: y and w go on
        p.memory[3] = 2.0 * side
    elif p.memory[3] == 0.0 and abs(s[V]) >= p.max_speed - at:
        p.memory[3] = 1.0 if s[V] > 0.0 else -1.0
        s[V] = p.memory[3] * p.max_speed
    else:
        p.memory[3] = 0.0
    if p.memory[3] != 0.0 and not room(t, s, mode, slip, p) > 0.0:
        p.memory[3] = 0.0


@kernel
def holding_force(t: float, s: Array, mode: int, p: Packed) -> float:
    """Force the rail must give [N] to hold the carriage still."""
    x_r, v_r, v_m, _, acceleration = rod(t, s, p)
    force = spring_force(x_r, v_r, s, mode, p)
    if p.kp > 0.0:
        acceleration = 0.0 if p.memory[3] != 0.0 else loop_acceleration(t, s, force, x_r, v_m, number(0), p)
    return p.M * p.g - force - p.m_r * acceleration


@kernel
def held_between(t: float, s: Array, p: Packed) -> tuple[float, float]:
    """Least and greatest force [N] of the rail on a carriage at rest: as it would begin to move up, and down."""
    x_r, _, _, x, _ = rod(t, s, p)
    return rail_force(t, s, x_r, x, REST, p), rail_force(t, s, x_r, x, -REST, p)


@kernel
def guards(t: float, s: Array, mode: int, slip: int, p: Packed) -> Guards:
    """Positive while mode, slip and hold last: leave the ground or air, yield or stop, rail, limits of the motor."""
    first, second, third = 1.0, 1.0, 1.0
    last = room(t, s, mode, slip, p) if p.kp > 0.0 else 1.0
    sticks = p.dry == 1
    if p.massless == 0 and not sticks and mode != STUCK:  # the forcing is not needed
        if mode == AIR:
            return s[XF] + p.memory[0], second, third, last
        return first, -s[VF], third, last
    x_r, v_r, v_m, _, _ = rod(t, s, p)
    if p.massless == 1:
        first = x_r if mode == AIR else -x_r
    elif mode == AIR:
        first = s[XF] + p.memory[0]
    elif mode == INTRUDE:
        second = -s[VF]
    else:
        push = spring_force(x_r, v_r, s, mode, p) + p.m_f * p.g
        first = push + p.slack
        if p.sand == 1:
            second = yield_force(t, s, p) + p.slack - push
    if sticks:
        if slip == 0:
            low, high = held_between(t, s, p)
            need = holding_force(t, s, mode, p)
            third = high + p.slack - need if need > 0.5 * (low + high) else need - (low - p.slack)
        else:
            third = slip * v_m
    return first, second, third, last


@kernel
def settle(t: float, s: Array, p: Packed) -> int:
    """Mode of a foot at rest on the ground: 0 <= push <= F_p holds it."""
    if p.massless == 1:
        return STUCK
    x_r, v_r, _, _, _ = rod(t, s, p)
    push = spring_force(x_r, v_r, s, number(STUCK), p) + p.m_f * p.g
    if push < -p.slack:
        return AIR
    if p.sand == 1 and push > yield_force(t, s, p) + p.slack:
        return INTRUDE
    return STUCK


@kernel
def grip(t: float, s: Array, mode: int, p: Packed, still: float) -> int:
    """Slip of the rail: the sign of v_m, or at |v_m| <= still 0 if the rail can hold, else the sign it will take."""
    if p.dry == 0:
        return 1
    v_m = rod(t, s, p)[2]
    if v_m > still:
        return 1
    if v_m < -still:
        return -1
    need = holding_force(t, s, mode, p)
    low, high = held_between(t, s, p)
    if need > high + p.slack:
        return -1
    return 1 if need < low - p.slack else 0


@kernel
def squeeze(p: Packed) -> float:
    """Compression of the spring e [m] under M g, by Newton from above: a spring that hardens only lets it fall."""
    e = p.M * p.g / p.k_s
    for _ in range(100):
        force, slope = p.k_s * e, p.k_s
        if p.spring != 0:
            force, slope = force + spring_law(p, (-e, 0.0, 0.0)), slope - spring_slope(p, (-e, 0.0, 0.0))
        change = (force - p.M * p.g) / slope
        e -= change
        if abs(change) <= 1e-16 * e:
            break
    return e


@kernel
def carried(z: float, p: Packed) -> float:
    """Force of the undisturbed bed on a foot at rest [N], long after any contact."""
    return ground_law(p, (z, -REST, 0.0, 0.0, 0.0, -NEVER, 0.0, 0.0))[0]


@kernel
def depth(p: Packed) -> float:
    """Depth z [m] where the bed carries the robot, F_p(z) = (M + m_f) g; NaN where it cannot. `prepare` first."""
    if p.sand == 0:
        return 0.0
    load = (p.M + p.m_f) * p.g
    lo, hi = 0.0, 1e-3
    while carried(hi, p) < load:
        lo, hi = hi, 2.0 * hi
        if hi > 1e3:  # m
            return math.nan
    f_lo, f_hi = carried(lo, p) - load, carried(hi, p) - load
    for n in range(200):  # regula falsi, every third step a bisection
        if hi - lo <= 1e-17 + 4e-16 * hi or f_hi == 0.0:
            break
        z = (lo * f_hi - hi * f_lo) / (f_hi - f_lo) if n % 3 else 0.5 * (lo + hi)
        f = carried(z, p) - load
        if f < 0.0:
            if z == lo:  # the root to the last bit; the far end of the bracket is not
                return lo
            lo, f_lo = z, f
        else:
            if z == hi:
                break
            hi, f_hi = z, f
    return hi
