"""The jumper as a hybrid system: equations of motion in each mode (the rules that change it: `modes`).

State s = [y, w, x_f, v_f(, X, V, u)]: y = x_r + (m_m/M) X_m, the height of the centre of mass of motor and rod [m],
and its rate w; the foot x_f, v_f; X and V, the motor's position and rate, only where a feedback loop or a law leads
it; u, the internal state of a law; behind them energies (from MOTOR_WORK on), where the ledger asks for them. In y the
motor enters through X_m and X_m' alone (docs/physics.md section 1), so a velocity step of X_m needs no special
treatment: y and w are continuous, and v_r = w - (m_m/M) X_m' jumps by the impulse on the rod.

Modes: AIR; STUCK (the foot rests on the ground); INTRUDE (granular only: the foot moves down). A massless foot (hard
ground) follows the rod in the air, F_s = 0, and stands at 0 while x_r <= 0. The rail is `slip` = +1 or -1 (sign of
the carriage's velocity v_m) or 0: held by Coulomb friction.

Force thresholds carry the width `p.slack` (1e-9 M g), so that a
mode that begins does so with an acceleration of definite sign.

Everything here is compiled into `events.compiled_run`; `p` is one record of CONSTANTS.
"""

from __future__ import annotations

import math

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.jumper.mechanisms.record import LONG_AGO
from jumpvision.jumper.physics.forcing import NEAR as NEAR_ZERO
from jumpvision.jumper.physics.forcing import segment_xv, sincos_near

from .kernel import inlined, kernel, law, listed
from .laws import ALL, BENDS, LOSSES, NUMBERS, REST, ROUTINES, WHEN
from .packed import Packed

Guards = tuple[float, float, float, float]

AIR, STUCK, INTRUDE = 0, 1, 2
SINE, CUBIC = 0, 1
Y, W, XF, VF, X, V, INNER = range(7)
N_MOTION = INNER + 1
ASKED, N_ROW = 8, 12  # in a piece of the forcing: when the motor was last asked for [s], and where it was
FLOOR, HOLE, PAUSE, HELD, CONTACT, LEFT, N_MEMORY = range(7)
"""What a run remembers: depths of the floor, of the last lift-off and the last pause; what holds the motor; when the
foot last came down [s]; `z_left` of the last pause."""
N_ARC = 17  # numbers of an arc in closed form (`step`)
N_NODES = 16  # of a step, in which the motor is looked up beforehand
MOTOR_WORK, IMPULSE, DAMPED, LOST = range(N_MOTION, N_MOTION + 4)
"""Energies [J] integrated along with the motion where it is asked for, in the states after N_MOTION: of the motor, of
its impulses, of the spring's damping; from LOST on of the laws (`laws.Laws.lost`), and last of landings."""
NEVER = -LONG_AGO  # s, of the last contact before the first

ROBOT = ("m_m", "m_r", "M", "per_M", "ratio", "m_f", "k_s", "c_s", "g", "slack", "tau", "e")
LOOP = ("kp", "kd", "max_force", "max_speed", "low", "high")
CONSTANTS = np.dtype(
    [(n, np.int64) for n in ("sand", "massless", "linear", "dry", "ages", "led", "lost", *ROUTINES)]
    + [(n, np.float64) for n in (*ROBOT, *LOOP, "rest")]
    + [("number", np.float64, (NUMBERS,)), ("bends", np.float64, (BENDS,))]
    + [("asked", np.float64, (len(ALL) + len(WHEN),)), ("losses_W", np.float64, (LOSSES,))]
    + [("kind", np.int64), ("row", np.float64, (N_ROW,))]
    + [("memory", np.float64, (N_MEMORY,)), ("arc", np.float64, (N_ARC,))]
    + [("ahead", np.float64, (3, N_NODES))]
    + [(n, np.int64) for n in ("mode", "next", "slip", "exact", "fresh", "watched", "events", "sampled")]
    + [(n, np.float64) for n in ("t", "h", "after", "taken", "longest", "held", "v_old")]
    + [(n, np.float64) for n in ("height", "deep", "rod_before", "rod_after", "com", "lowest")]
    + [("now", np.float64, (4,)), ("here", np.float64, (4,)), ("force", np.float64, (3,)), ("pace", np.float64, (2,))]
)
"""Numbers of one jumper. linear: spring and rail are, but for dry friction. dry: the rail may hold the carriage. ages:
what the ground carries changes while nothing moves. led: the motor's position is a state, of a loop or of a law. lost:
how many laws take energy. ROUTINES: addresses of its laws (0: none), number: their constants. ratio: m_m / M. tau: of
the lag in closed form, e: of the landing on hard ground. rest: of the carriage [m], for x_m. bends: depths of kinks in
the laws [m], 0 where there is none. Of a run, and here because handing over an array costs as much as a small function:
what the ledger asks and is told, kind and row of the forcing's piece, memory and arc; then where the run is: its mode
and the one that follows, slip, whether the flow is exact, whether equations changed, whether the motor's effort is
watched, events and rows of output written; time, step, the step to go on with after one that ends on a kink, the part
that was taken, the longest; until when a foot rests; the motor's rate before an impulse; x_r [m] at rest, depth of the
foot there, greatest heights until the motor stops and after, of the mass centre, and its lowest; guards, heights, the
motor's effort at t and its pace."""

ground_law, rail_law, inner_law = law("ground", 2), law("rail"), law("inner")
spring_law, spring_slope, left_law, drive_law = law("spring"), law("spring_slope"), law("left"), law("drive", 2)
_prepare, _kinks = listed("prepare", "number"), listed("kinks", "number", "asked", "bends")
_losses = listed("losses", "number", "asked", "losses_W")


@kernel
def prepare(p: Packed) -> None:
    """What is made of a model's constants, once before a run."""
    if p.prepare != 0:
        _prepare(p)
    if p.kinks != 0:
        _kinks(p)


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
def settling(t: float, p: Packed) -> bool:
    """Whether the transient of a lag is not over."""
    # exp(-40) < 1e-17: nothing of the transient is left
    return p.tau > 0.0 and p.row[6] != 0.0 and t - p.row[7] < 40.0 * p.tau


@kernel
def is_still(t: float, p: Packed) -> bool:
    """Whether the motor stands still on this piece from t on."""
    if settling(t, p) or p.drive != 0:
        return False
    return p.row[3] == 0.0 if p.kind == SINE else p.row[2] == 0.0 and p.row[3] == 0.0 and p.row[4] == 0.0


@inlined
def motor(t: float, s: Array, p: Packed) -> tuple[float, float, float]:
    """X_m [m], the motor relative to the rod, with its two rates, after the lag (`lagged`) or the loop."""
    if p.kp > 0.0:
        return s[X], s[V], np.nan  # the loop's acceleration depends on the force of the spring: `rhs`
    if p.drive != 0:
        x, v, a = drive(p.kind, p.row, t)
        v, a = drive_law(p, (x, v, a, s[X], t))
        return s[X], v, a
    if p.row[ASKED] == t:  # the end of a step is asked for again and again
        return p.row[ASKED + 1], p.row[ASKED + 2], p.row[ASKED + 3]
    x, v, a = drive(p.kind, p.row, t)
    if settling(t, p):
        left = p.row[6] * math.exp(-(t - p.row[7]) / p.tau)
        x, v, a = x + left, v - left / p.tau, a + left / (p.tau * p.tau)
    p.row[ASKED], p.row[ASKED + 1], p.row[ASKED + 2], p.row[ASKED + 3] = t, x, v, a
    return x, v, a


@inlined
def motors(t: float, h: float, nodes: Array, p: Packed) -> None:
    """Writes X_m and its two rates at the nodes of a step, shares of the h [s] from t, to p.ahead."""
    if p.led == 1:
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
def rod(t: float, s: Array, p: Packed) -> tuple[float, float, float, float, float]:
    """x_r [m], v_r [m/s], v_m = v_r + X_m' [m/s], X_m [m], X_m'' [m/s^2]."""
    x, v, a = motor(t, s, p)
    return s[Y] - p.ratio * x, s[W] - p.ratio * v, s[W] + (1.0 - p.ratio) * v, x, a


@inlined
def spring_force(x_r: float, v_r: float, s: Array, mode: int, p: Packed) -> float:
    """F_s [N], positive upwards on the rod."""
    if p.massless == 1 and mode == AIR:
        return 0.0
    stretch, rate = x_r - s[XF], v_r - s[VF]
    force = -p.k_s * stretch - p.c_s * rate
    if p.spring != 0:
        force += spring_law(p, (stretch, rate, inner(s)))
    return force


@inlined
def inner(s: Array) -> float:
    """The internal state of a law."""
    return s[INNER] if s.size > INNER else 0.0


@inlined
def resistance(t: float, z: float, v: float, s: Array, p: Packed) -> tuple[float, float]:
    """Force of the ground on the intruding foot [N], and the mass that moves with it [kg], at the depth z [m]."""
    m = p.memory
    return ground_law(p, (z, v, m[HOLE], m[PAUSE], m[LEFT], t - m[CONTACT], t, inner(s)))


@kernel
def yield_force(t: float, s: Array, p: Packed) -> float:
    """What the ground carries at the floor before the foot moves [N]: its force as motion begins."""
    return resistance(t, p.memory[FLOOR], -REST, s, p)[0]


@kernel
def foot_inertia(t: float, z: float, s: Array, p: Packed) -> float:
    """m_f + m_a(z) [kg]."""
    return p.m_f + resistance(t, z, -REST, s, p)[1]


@kernel
def rail_force(t: float, s: Array, x_r: float, x: float, v_m: float, p: Packed) -> float:
    """Force of the rail on the carriage [N]; x: X_m."""
    return rail_law(p, (v_m, x_r + x - p.rest, x_r, t, inner(s)))


@inlined
def rail_friction(t: float, s: Array, x_r: float, x: float, v_m: float, slip: int, p: Packed) -> float:
    """The same on the sliding carriage."""
    if p.rail == 0:
        return 0.0
    if p.dry == 1 and not v_m * slip > 0.0:
        v_m = slip * REST  # the side of the jump on which the mode goes on
    return rail_force(t, s, x_r, x, v_m, p)


@kernel
def rhs(t: float, s: Array, mode: int, slip: int, p: Packed, k: Array, i: int) -> float:
    """Writes ds/dt into row i of k; returns F_s [N]. i > 0: node of a step, see `motors`."""
    if i > 0 and p.led == 0:
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
        resist, mass = resistance(t, -s[XF], s[VF], s, p)
        k[i, VF] = (resist - force - p.m_f * p.g) * (1.0 / (p.m_f + mass))
    if s.size > V:
        k[i, X], k[i, V] = 0.0, 0.0
    if p.kp > 0.0:
        k[i, X], k[i, V] = s[V], acceleration
    elif p.drive != 0:
        k[i, X] = v_m - v_r
    if s.size > INNER:
        k[i, INNER] = 0.0
        if p.inner != 0:
            m, at_speed = p.memory, s[VF]
            if mode == AIR:
                at_speed = 0.0  # what a bed remembers is of the foot that moves in it
            stretch, rate, contact = x_r - s[XF], v_r - s[VF], t - m[CONTACT]
            x_m, hole, pause, left = x_r + x - p.rest, m[HOLE], m[PAUSE], m[LEFT]
            asked = (-s[XF], at_speed, hole, pause, left, contact, v_m, x_m, x_r, stretch, rate, t, s[INNER])
            k[i, INNER] = inner_law(p, asked)
    if s.size > N_MOTION:
        works(t, s, mode, slip, p, force, k, i)
    return force


@kernel
def loop_force(t: float, s: Array, p: Packed) -> float:
    """F_m [N] of the motor's feedback loop: PD on the encoder plus the load m_m g, within max_force; p.row[6]
    is the gain of the piece over kp."""
    x, v, _ = drive(p.kind, p.row, t)
    effort = p.kp * p.row[6] * (x - s[X]) + p.kd * (v - s[V]) + p.m_m * p.g
    return min(max(effort, -p.max_force), p.max_force)


@kernel
def loop_acceleration(t: float, s: Array, force: float, x_r: float, v_m: float, slip: int, p: Packed) -> float:
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
    p: Packed,
    force: float,
    k: Array,
    i: int,
) -> None:
    """Writes powers [W] behind the slopes of the motion: the motor's into the jumper, those of the laws out of it."""
    for j in range(N_MOTION, s.size):
        k[i, j] = 0.0
    x_r, v_r, v_m, x, acceleration = rod(t, s, p)
    acceleration = k[i, V] if p.kp > 0.0 else acceleration
    rail = p.M * (k[i, W] + p.g) - force
    # m_m a_m = -m_m g + F_m + rail
    k[i, MOTOR_WORK] = (p.m_m * (k[i, W] + p.m_r / p.M * acceleration + p.g) - rail) * (v_m - v_r)
    pulls = not (p.massless == 1 and mode == AIR)
    stretch, rate, m = x_r - s[XF], v_r - s[VF], p.memory
    if pulls:
        k[i, DAMPED] = p.c_s * rate * rate
    if p.losses == 0:
        return
    side = slip * REST if p.dry == 1 and not v_m * slip > 0.0 else v_m
    asked = (-s[XF], s[VF], m[HOLE], m[PAUSE], m[LEFT], t - m[CONTACT], side, x_r + x - p.rest, x_r, stretch, rate, t)
    for j in range(len(asked)):
        p.asked[j] = asked[j]
    n = len(asked)
    p.asked[n] = inner(s)
    p.asked[n + 1] = 1.0 if mode == INTRUDE else 0.0
    p.asked[n + 2] = v_m if slip != 0 else 0.0
    p.asked[n + 3] = rate if pulls else 0.0
    _losses(p)
    for j in range(p.lost):
        k[i, LOST + j] = p.losses_W[j]


@kernel
def kinetic(s: Array, v: float, mass: float, p: Packed) -> float:
    """Kinetic energy [J] at the motor's rate v = X_m' with `mass` moving as the foot."""
    return 0.5 * p.M * s[W] * s[W] + 0.5 * p.m_m * p.m_r / p.M * v * v + 0.5 * mass * s[VF] * s[VF]


@kernel
def motor_force(t: float, s: Array, mode: int, slip: int, p: Packed) -> tuple[float, float, float]:
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
