"""The jumper as a hybrid system: equations of motion in each mode (the rules that change it: `modes`).

State s = [y, w, x_f, v_f(, X, V, u)]: y = x_r + (m_m/M) X_m, the height of the centre of mass of motor and rod [m],
and its rate w; the foot x_f, v_f; X and V, the motor's position and rate, only where a feedback loop drives it; u, the
internal state of a law of the user's own; behind them WORKS, where the energy ledger asks for them. In y the motor
enters through X_m and X_m' alone (docs/physics.md section 1), so a velocity step of X_m needs no special treatment: y
and w are continuous, and v_r = w - (m_m/M) X_m' jumps by the impulse on the rod.

Modes: AIR; STUCK (the foot rests on the ground); INTRUDE (granular only: the foot moves down). A massless foot (hard
ground) follows the rod in the air, F_s = 0, and stands at 0 while x_r <= 0. The rail is `slip` = +1 or -1 (sign of
the carriage's velocity v_m) or 0: held by Coulomb friction.

Force thresholds carry the width `p.slack` (1e-9 M g), so that a
mode that begins does so with an acceleration of definite sign.

Everything here is compiled into `events.compiled_run`; `p` is one record of CONSTANTS.
"""

from __future__ import annotations

import math
from itertools import accumulate
from typing import Any

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.jumper.mechanisms.record import Body
from jumpvision.jumper.mechanisms.registry import MECHANISMS, PARAMETERS, acting
from jumpvision.jumper.mechanisms.robot import spring
from jumpvision.jumper.physics.forcing import NEAR as NEAR_ZERO
from jumpvision.jumper.physics.forcing import segment_xv, sincos_near

from .kernel import chosen, each, inlined, kernel, running, summed
from .program import ARRAYS, BODIES, FIELDS, REST, value

Guards = tuple[float, float, float, float]

AIR, STUCK, INTRUDE = 0, 1, 2
HARD = 0  # of p.static; else the number of the static force, from 1
SINE, CUBIC = 0, 1
Y, W, XF, VF, X, V, INNER = range(7)
N_MOTION = INNER + 1
ASKED, N_ROW = 8, 12  # in a piece of the forcing: when the motor was last asked for [s], and where it was
NEAR = 1e-6  # m, over which the slope of a law of the user's own is taken
FLOOR, HOLE, PAUSE, HELD, CONTACT, LEFT, N_MEMORY = range(7)
"""What a run remembers: depths of the floor, of the last lift-off and the last pause; what holds the motor; when the
foot last came down [s]; `z_left` of the last pause."""
BENDS = 4  # mechanisms of the ground that have a kink and act together
N_ARC = 17  # numbers of an arc in closed form (`step`)
N_NODES = 16  # of a step, in which the motor is looked up beforehand
OVER = 40.0  # time constants after which nothing of a lag's transient is left: exp(-OVER) < 1e-17
AT = 1e-9  # m or m/s: so near to a limit the motor is at it
LOST = (Body.OVERSHOOT, Body.DRAG, Body.FOOT, Body.INERTIA, Body.CARRIAGE, Body.RAIL, Body.SPRING)
LOSSES = [[m for m in acting(body) if not m.energy] for body in LOST]
WORKS = ("motor", "impulse", "spring_damping", "static", *(m.name for body in LOSSES for m in body), "landing", *BODIES)
"""Energies [J] integrated along with the motion where it is asked for, in the states after N_MOTION."""
OVERSHOOT, DRAG, FORCE, INERTIA, FRICTION, DRY, SPRING, LANDED = accumulate(map(len, LOSSES), initial=N_MOTION + 4)

SWITCHES = tuple(m.name for m in MECHANISMS.values() if m.law and m.acts_on is not Body.STATIC)
ROBOT = ("m_m", "m_r", "M", "per_M", "ratio", "m_f", "k_s", "c_s", "g", "R", "phi", "rho", "slack", "hold", "stiffer")
LOOP = ("kp", "kd", "max_force", "max_speed", "low", "high")
CONSTANTS = np.dtype(
    [(n, np.int64) for n in ("static", "massless", "linear", *SWITCHES)]
    + [(n, np.float64) for n in (*ROBOT, *PARAMETERS, *LOOP, "rest")]
    + [("bends", np.float64, (BENDS,)), ("kind", np.int64), ("row", np.float64, (N_ROW,))]
    + [("memory", np.float64, (N_MEMORY,)), ("arc", np.float64, (N_ARC,))]
    + [("ahead", np.float64, (3, N_NODES))]
    + FIELDS
    + ARRAYS
)
"""Numbers of one jumper. static: the number of its static force, from 1. SWITCHES: which other laws act in it; the
parameters of mechanisms that it has not are 0, and theta is the tangent of the angle. linear: spring and rail are, but
for dry friction. ratio: m_m / M. hold: the dry friction of the rail [N]. stiffer: the factor under an earlier
footprint. rest: of the carriage [m], for x_m. bends: depths of kinks in the laws [m], 0 where there is none. Of a run,
and here because handing over an array costs as much as a small function: kind and row of the forcing's piece, memory
and arc. FIELDS, ARRAYS: laws of the user's own (`program`)."""

springs = summed(Body.SPRING, "stretch, stretch_rate")
static_law = chosen(Body.STATIC, "z")
overshoots = summed(Body.OVERSHOOT, "z, z_g, z_stop, z_left")
drags = summed(Body.DRAG, "z", at="v=1.0")
forces = summed(Body.FOOT, "z, v, z_g, z_stop")
inertias = summed(Body.INERTIA, "z", at="a=-1.0")
frictions = summed(Body.CARRIAGE, "v_m")
dry_frictions = summed(Body.RAIL, "v_m")
write_overshoots = each(LOSSES[0], "z, z_g, z_stop, z_left")
write_drags = running(LOSSES[1], "z", at="v=1.0")
write_forces = each(LOSSES[2], "z, v, z_g, z_stop")
write_slopes = each(LOSSES[3], "z", part="slope")
write_frictions = each(LOSSES[4], "v_m")
write_dry = each(LOSSES[5], "v_m")
write_springs = each(LOSSES[6], "stretch, stretch_rate")


@inlined
def drive(kind: int, row: Array, t: float) -> tuple[float, float, float]:
    """Command X_m, X_m', X_m'' at t on one piece: a row of `Segments`, or (t0, t1, c3, c2, c1, c0) of a `Spline`."""
    if kind == SINE:
        if row[3] == 0.0:
            return row[2], 0.0, 0.0
        x, v = segment_xv(row, t)
        return x, v, -row[4] * row[4] * (x - row[2])
    h = t - row[0]
    x = ((row[2] * h + row[3]) * h + row[4]) * h + row[5]
    return x, (3.0 * row[2] * h + 2.0 * row[3]) * h + row[4], 6.0 * row[2] * h + 2.0 * row[3]


@kernel
def lagged(kind: int, rows: Array, edges: Array, tau: float, out: Array) -> None:
    """Writes the pieces (n, 8) of a motor that lags its command, tau X' + X = command, in closed form: what goes on as
    the command does, as a piece of the same kind, and its transient row[6] exp(-(t - row[7]) / tau)."""
    x = 0.0 if kind == SINE else rows[0, 5]  # the motor before its command begins
    for i in range(rows.shape[0]):
        own, row = out[i], rows[i]
        for j in range(6):
            own[j] = row[j]
        if kind == SINE:
            turn = row[4] * tau
            own[3], own[5] = row[3] / math.sqrt(1.0 + turn * turn), row[5] - math.atan(turn)
        else:  # x + tau x' = the cubic, power by power
            own[3] -= 3.0 * tau * own[2]
            own[4] -= 2.0 * tau * own[3]
            own[5] -= tau * own[4]
        own[6], own[7] = x - drive(kind, own, edges[i])[0], edges[i]
        if i + 1 < rows.shape[0]:
            end = edges[i + 1]
            x = drive(kind, own, end)[0] + own[6] * math.exp(-(end - edges[i]) / tau)


@inlined
def settling(t: float, p: Any) -> bool:
    """Whether the transient of a lag is not over."""
    return p.tau > 0.0 and p.row[6] != 0.0 and t - p.row[7] < OVER * p.tau


@kernel
def is_still(t: float, p: Any) -> bool:
    """Whether the motor stands still on this piece from t on."""
    if settling(t, p):
        return False
    return p.row[3] == 0.0 if p.kind == SINE else p.row[2] == 0.0 and p.row[3] == 0.0 and p.row[4] == 0.0


@inlined
def motor(t: float, s: Array, p: Any) -> tuple[float, float, float]:
    """X_m [m], the motor relative to the rod, with its two rates, after the lag (`lagged`) or the loop."""
    if p.kp > 0.0:
        return s[X], s[V], np.nan  # the loop's acceleration depends on the force of the spring: `rhs`
    if p.row[ASKED] == t:  # the end of a step is asked for again and again
        return p.row[ASKED + 1], p.row[ASKED + 2], p.row[ASKED + 3]
    x, v, a = drive(p.kind, p.row, t)
    if settling(t, p):
        left = p.row[6] * math.exp(-(t - p.row[7]) / p.tau)
        x, v, a = x + left, v - left / p.tau, a + left / (p.tau * p.tau)
    p.row[ASKED], p.row[ASKED + 1], p.row[ASKED + 2], p.row[ASKED + 3] = t, x, v, a
    return x, v, a


@inlined
def motors(t: float, h: float, nodes: Array, p: Any) -> None:
    """Writes X_m and its two rates at the nodes of a step, shares of the h [s] from t, to p.ahead."""
    if p.kp > 0.0:
        return
    x, v, a = p.ahead[0], p.ahead[1], p.ahead[2]
    start, step = p.row[4] * (t - p.row[0]) + p.row[5], p.row[4] * h
    if p.kind == SINE and p.row[3] != 0.0 and abs(start) + step < NEAR_ZERO:
        level, amplitude, rate = p.row[2], p.row[3], p.row[4]
        for i in range(N_NODES):
            sin, cos = sincos_near(start + nodes[i] * step)
            x[i], v[i], a[i] = level + amplitude * sin, amplitude * rate * cos, -amplitude * rate * rate * sin
    else:
        for i in range(N_NODES):
            x[i], v[i], a[i] = drive(p.kind, p.row, t + nodes[i] * h)
    if settling(t, p):
        for i in range(N_NODES):
            left = p.row[6] * math.exp(-(t + nodes[i] * h - p.row[7]) / p.tau)
            x[i], v[i], a[i] = x[i] + left, v[i] - left / p.tau, a[i] + left / (p.tau * p.tau)


@kernel
def rod(t: float, s: Array, p: Any) -> tuple[float, float, float, float, float]:
    """x_r [m], v_r [m/s], v_m = v_r + X_m' [m/s], X_m [m], X_m'' [m/s^2]."""
    x, v, a = motor(t, s, p)
    return s[Y] - p.ratio * x, s[W] - p.ratio * v, s[W] + (1.0 - p.ratio) * v, x, a


@inlined
def spring_force(x_r: float, v_r: float, s: Array, mode: int, p: Any) -> float:
    """F_s [N], positive upwards on the rod."""
    if p.massless == 1 and mode == AIR:
        return 0.0
    stretch, rate = x_r - s[XF], v_r - s[VF]
    force = springs(spring(stretch, rate, p.k_s, p.c_s), stretch, rate, p)
    if p.own_spring > 0:
        force += own_spring(stretch, rate, s, p)
    return force


@inlined
def static_force(z: float, z_g: float, z_stop: float, z_left: float, p: Any) -> float:
    """F_p(z) [N] with its overshoots, also the yield threshold. z_g: last lift-off; z_stop, z_left: last pause."""
    factor = p.stiffer if z_g > 0.0 else 1.0
    return overshoots(static_law(p.static, factor, z, p), z, z_g, z_stop, z_left, p)


@inlined
def foot_inertia(z: float, p: Any) -> float:
    """m_f + m_a(z) [kg]."""
    mass = inertias(p.m_f, z, p)
    if p.own_mass > 0:
        mass += own_mass(z, p)
    return mass


# The sums of the user's own laws, each where its field of `p` is > 0.


@kernel
def own_mass(z: float, p: Any) -> float:
    """Mass that moves with the intruding foot [kg]."""
    return value(p, p.own_mass, z, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@kernel
def own_foot(t: float, z: float, v: float, s: Array, p: Any) -> float:
    """Force on the intruding foot [N]."""
    u, contact = s[INNER] if s.size > INNER else 0.0, t - p.memory[CONTACT]
    return value(p, p.own_foot, z, v, p.memory[HOLE], p.memory[PAUSE], contact, 0.0, 0.0, 0.0, 0.0, t, u, 0.0)


@kernel
def own_rail(t: float, x_r: float, x_m: float, v_m: float, s: Array, p: Any) -> float:
    """Force of the rail on the carriage [N]; x_m: not yet from its rest."""
    u = s[INNER] if s.size > INNER else 0.0
    return value(p, p.own_rail, 0.0, 0.0, 0.0, 0.0, 0.0, x_m - p.rest, v_m, 0.0, 0.0, t, u, x_r)


@kernel
def own_spring(stretch: float, rate: float, s: Array, p: Any) -> float:
    """Force of the spring on the rod [N]."""
    u = s[INNER] if s.size > INNER else 0.0
    return value(p, p.own_spring, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, stretch, rate, 0.0, u, 0.0)


@kernel
def yield_force(t: float, s: Array, p: Any) -> float:
    """What the ground carries at the floor before the foot moves [N]: static force, and own laws as motion begins."""
    force = static_force(p.memory[FLOOR], p.memory[HOLE], p.memory[PAUSE], p.memory[LEFT], p)
    if p.own_foot > 0:
        force += own_foot(t, p.memory[FLOOR], -REST, s, p)
    return force


@kernel
def rail_friction(t: float, s: Array, x_r: float, x: float, v_m: float, slip: int, p: Any) -> float:
    """Force of the rail on the sliding carriage [N]; x: X_m."""
    rail = dry_frictions(frictions(0.0, v_m, p), float(slip), p)
    if p.own_rail > 0:
        if p.own_dry == 1 and not v_m * slip > 0.0:
            v_m = slip * REST  # the side of the jump on which the mode goes on
        rail += own_rail(t, x_r, x_r + x, v_m, s, p)
    return rail


@kernel
def rhs(t: float, s: Array, mode: int, slip: int, p: Any, k: Array, i: int) -> float:
    """Writes ds/dt into row i of k; returns F_s [N]. i > 0: node of a step, see `motors`."""
    if i > 0 and p.kp == 0.0:
        x, v, acceleration = p.ahead[0, i], p.ahead[1, i], p.ahead[2, i]
        x_r, v_r, v_m = s[Y] - p.ratio * x, s[W] - p.ratio * v, s[W] + (1.0 - p.ratio) * v
    else:
        x_r, v_r, v_m, x, acceleration = rod(t, s, p)
    force = spring_force(x_r, v_r, s, mode, p)
    if p.kp > 0.0:
        acceleration = 0.0 if p.memory[3] != 0.0 else loop_acceleration(t, s, force, x_r, v_m, slip, p)
    k[i, Y] = s[W]
    if slip == 0:
        k[i, W] = -p.m_r / p.M * acceleration
    else:
        k[i, W] = -p.g + (force + rail_friction(t, s, x_r, x, v_m, slip, p)) * p.per_M
    k[i, XF] = s[VF]
    if mode == STUCK or p.massless == 1:
        k[i, XF] = 0.0
        k[i, VF] = 0.0
    elif mode == AIR:
        k[i, VF] = -p.g - force / p.m_f
    else:
        z = -s[XF]
        resist = static_force(z, p.memory[1], p.memory[2], p.memory[LEFT], p) + drags(0.0, z, p) * s[VF] * s[VF]
        resist = forces(resist, z, s[VF], p.memory[1], p.memory[2], p)
        if p.own_foot > 0:
            resist += own_foot(t, z, s[VF], s, p)
        k[i, VF] = (resist - force - p.m_f * p.g) * (1.0 / foot_inertia(z, p))
    if s.size > V:
        k[i, X], k[i, V] = 0.0, 0.0
    if p.kp > 0.0:
        k[i, X], k[i, V] = s[V], acceleration
    if s.size > INNER:
        k[i, INNER] = 0.0
        if p.own_rate > 0:
            z, v, stretch, rate = -s[XF], s[VF], x_r - s[XF], v_r - s[VF]
            if mode == AIR:
                v = 0.0  # what a bed remembers is of the foot that moves in it
            contact, at = t - p.memory[CONTACT], p.own_rate
            k[i, INNER] = value(
                p,
                at,
                z,
                v,
                p.memory[HOLE],
                p.memory[PAUSE],
                contact,
                x_r + x - p.rest,
                v_m,
                stretch,
                rate,
                t,
                s[INNER],
                x_r,
            )
    if s.size > N_MOTION:
        works(t, s, mode, slip, p, force, k, i)
    return force


@kernel
def loop_force(t: float, s: Array, p: Any) -> float:
    """F_m [N] of the motor's feedback loop: PD on the encoder plus the load m_m g, within max_force; p.row[6]
    is the gain of the piece over kp."""
    x, v, _ = drive(p.kind, p.row, t)
    effort = p.kp * p.row[6] * (x - s[X]) + p.kd * (v - s[V]) + p.m_m * p.g
    return min(max(effort, -p.max_force), p.max_force)


@kernel
def loop_acceleration(t: float, s: Array, force: float, x_r: float, v_m: float, slip: int, p: Any) -> float:
    """X_m'' [m/s^2] by the loop's force, were the motor not held at a limit."""
    effort = loop_force(t, s, p)
    if slip == 0:  # a_m = 0
        return p.g + (effort - force) / p.m_r
    # X'' = a_m - a_r, m_m a_m = -m_m g + F_m + rail, m_r a_r = -m_r g - F_m + F_s
    return effort * p.M / (p.m_m * p.m_r) + rail_friction(t, s, x_r, s[X], v_m, slip, p) / p.m_m - force / p.m_r


@kernel
def works(
    t: float,
    s: Array,
    mode: int,
    slip: int,
    p: Any,
    force: float,
    k: Array,
    i: int,
) -> None:
    """Writes the powers [W] of WORKS behind the slopes of the motion: the motor's into the jumper, losses out of it."""
    for j in range(N_MOTION, s.size):
        k[i, j] = 0.0
    x_r, v_r, v_m, x, acceleration = rod(t, s, p)
    acceleration = k[i, V] if p.kp > 0.0 else acceleration
    rail = p.M * (k[i, W] + p.g) - force
    # m_m a_m = -m_m g + F_m + rail
    k[i, N_MOTION] = (p.m_m * (k[i, W] + p.m_r / p.M * acceleration + p.g) - rail) * (v_m - v_r)
    if not (p.massless == 1 and mode == AIR):
        k[i, N_MOTION + 2] = p.c_s * (v_r - s[VF]) ** 2
        write_springs(k, i, SPRING, x_r - s[XF], v_r - s[VF], p)
        for j in range(SPRING, LANDED):
            k[i, j] *= s[VF] - v_r
        if p.own_spring > 0:
            k[i, LANDED + 4] = own_spring(x_r - s[XF], v_r - s[VF], s, p) * (s[VF] - v_r)
    if mode == INTRUDE:
        z, speed = -s[XF], -s[VF]
        write_overshoots(k, i, OVERSHOOT, z, p.memory[1], p.memory[2], p.memory[LEFT], p)
        write_drags(k, i, DRAG, z, p)
        write_forces(k, i, FORCE, z, s[VF], p.memory[1], p.memory[2], p)
        write_slopes(k, i, INERTIA, z, p)
        resist = static_force(z, p.memory[1], p.memory[2], p.memory[LEFT], p)
        for j in range(OVERSHOOT, DRAG):
            resist -= k[i, j]
            k[i, j] *= speed
        k[i, N_MOTION + 3] = resist * speed
        before = 0.0
        for j in range(DRAG, FORCE):
            k[i, j], before = (k[i, j] - before) * speed**3, k[i, j]
        for j in range(FORCE, INERTIA):
            k[i, j] *= speed
        for j in range(INERTIA, FRICTION):  # grains that join at the foot's speed bring half the energy that they take
            k[i, j] *= -0.5 * speed**3
        if p.own_foot > 0:
            k[i, LANDED + 1] = own_foot(t, z, s[VF], s, p) * speed
        if p.own_mass > 0:
            k[i, LANDED + 2] = -0.5 * (own_mass(z + NEAR, p) - own_mass(z, p)) / NEAR * speed**3
    if slip != 0:
        write_frictions(k, i, FRICTION, v_m, p)
        write_dry(k, i, DRY, float(slip), p)
        for j in range(FRICTION, SPRING):
            k[i, j] *= -v_m
        if p.own_rail > 0:
            k[i, LANDED + 3] = -v_m * own_rail(t, x_r, x_r + x, v_m, s, p)


@kernel
def kinetic(s: Array, v: float, mass: float, p: Any) -> float:
    """Kinetic energy [J] at the motor's rate v = X_m' with `mass` moving as the foot."""
    return 0.5 * p.M * s[W] * s[W] + 0.5 * p.m_m * p.m_r / p.M * v * v + 0.5 * mass * s[VF] * s[VF]


@kernel
def motor_force(t: float, s: Array, mode: int, slip: int, p: Any) -> tuple[float, float, float]:
    """F_m [N], its power F_m X_m' [W] and |X_m'| [m/s], from m_m a_m = -m_m g + F_m + rail."""
    x_r, v_r, v_m, x, acceleration = rod(t, s, p)
    if p.kp > 0.0:
        effort = loop_force(t, s, p)
        return effort, effort * (v_m - v_r), abs(v_m - v_r)
    force = spring_force(x_r, v_r, s, mode, p)
    if slip == 0:
        rail = p.M * p.g - force - p.m_r * acceleration
    else:
        rail = rail_friction(t, s, x_r, x, v_m, slip, p)
    # M a_m = -M g + F_s + rail + m_r X_m''
    effort = p.m_m / p.M * (force + rail + p.m_r * acceleration) - rail
    return effort, effort * (v_m - v_r), abs(v_m - v_r)
