"""Exact jumps on hard ground (docs/physics.md section 2, m_f = 0): one jump in full, or the results of millions.

Between lift-offs and landings the flow is linear and known in closed form (`arc`); only event times are iterated
(`flow`). Velocity steps of the law are impulses: the centre of mass y = x_r + (m_m/M) X_m and its velocity do
not jump, the rod's velocity jumps by -(m_m/M) times the step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import ArrayLike

from jumpvision.base.arrays import AnyArray, Array
from jumpvision.base.threads import shared
from jumpvision.jumper.physics.forcing import KERNEL, Forcing, Segments
from jumpvision.jumper.physics.oscillator import natural_frequency

from .arc import AIR, ARC_SIZE, KIND, evaluate
from .flow import follow_jump, motor

# name: unit, lowest, whether the lowest itself is allowed
RANGES = {
    "motor_mass": ("kg", 0.0, False),
    "rod_mass": ("kg", 0.0, True),
    "stiffness": ("N/m", 0.0, False),
    "damping": ("N s/m", 0.0, True),
    "gravity": ("m/s^2 (along the rail)", 0.0, False),
    "landing_loss": ("", 0.0, True),
    "amplitude": ("m", 0.0, False),
    "cycles": ("", 0.0, False),
    "frequency": ("Hz", 0.0, False),
    "phase": ("rad", -math.inf, True),
}


class HardRobot(NamedTuple):
    """The values of a robot on hard ground: keyword arguments of hard_jump and hard_sweep."""

    motor_mass: float  # kg
    rod_mass: float  # kg
    stiffness: float  # N/m
    damping: float  # N s/m
    gravity: float  # m/s^2, along the rail
    landing_loss: float = 0.0  # e

    @property
    def mass(self) -> float:
        """M [kg]."""
        return self.motor_mass + self.rod_mass

    @property
    def f0(self) -> float:
        """Natural frequency [Hz]."""
        return float(natural_frequency(self.stiffness, self.mass))

    @property
    def zeta(self) -> float:
        """Damping ratio c / (2 sqrt(k M))."""
        return float(self.damping / (2.0 * np.sqrt(self.stiffness * self.mass)))

    @property
    def rod_share(self) -> float:
        """m_r / M."""
        return self.rod_mass / self.mass


RESULTS = (
    "com_height_m",
    "flight_height_m",
    "jump_height_m",
    "n_jumps",
    "lift_off_s",
    "peak_power_W",
    "peak_force_N",
    "peak_motor_speed",
)


OF_SEGMENT = [0, 1, 2, 6, 7, 8]  # columns of a piece (arc.make_arc) that a row of Segments fills


@dataclass(frozen=True)
class HardMotion:
    """One jump. Arrays over the asked times, shape (n,); x up, zero where the spring is relaxed; right-continuous.

    t [s]; rod x_r and motor x_m = x_r + X_m [m]; rod_velocity [m/s]; spring_force on the rod [N] (upwards positive).
    lift_off, landing: (m,) [s] of every flight until t_end; a landing after t_end is NaN.
    n_jumps: flights up to and including the first that ends after the forcing (what follows are bounces); all flights
    where none does. A single jump has one, a stutter jump two.
    com_height [m]: greatest rise of y above rest. jump_height [m]: greatest rise of the rod above rest after the motor
    stops. flight_height [m]: g t_f^2 / 8 of the longest flight that ends after the forcing, 0 without one, NaN when
    t_end cuts the only one.
    peak_power_W, peak_force_N: greatest F_m X_m' and F_m = m_m (x_m'' + g) while the law runs, without the impulses of
    velocity steps; impulse_work_J: work of those at the start and at the end. peak_motor_speed: greatest |X_m'| [m/s].
    """

    t: Array
    rod: Array
    rod_velocity: Array
    motor: Array
    spring_force: Array
    lift_off: Array
    landing: Array
    n_jumps: int
    com_height: float
    jump_height: float
    flight_height: float
    peak_power_W: float
    peak_force_N: float
    peak_motor_speed: float
    impulse_work_J: tuple[float, float]

    @property
    def ground_force(self) -> Array:
        """Force of the ground on the spring [N], shape (n,): the spring force, the foot being massless."""
        return self.spring_force


def hard_jump(
    *,
    motor_mass: float,
    rod_mass: float,
    stiffness: float,
    damping: float,
    gravity: float,
    landing_loss: float,
    forcing: Forcing,
    t: ArrayLike | None,
    t_end: float,
) -> HardMotion:
    """The jump of a settled robot (x_r = -M g/k) under a law or a log, exact to rounding.

    motor_mass, rod_mass [kg]; stiffness [N/m]; damping [N s/m]; gravity [m/s^2] along the rail; landing_loss: e in
    v_r -> sqrt(1 - e) v_r at touchdown; t: (n,) [s], at most t_end, times of the returned motion (None: none);
    t_end [s], not before the forcing ends. Grazing contacts and Zeno: see `flow`. ValueError for a bad argument.
    """
    robot = {
        "motor_mass": motor_mass,
        "rod_mass": rod_mass,
        "stiffness": stiffness,
        "damping": damping,
        "gravity": gravity,
        "landing_loss": landing_loss,
    }
    for name, value in robot.items():
        _check(name, value)
    pieces = _pieces(forcing)
    stop = pieces[-1, 1]
    if not stop <= t_end < math.inf:
        raise ValueError(f"t_end = {t_end} must be finite and not before the forcing ends, {stop:g} s")
    times = np.atleast_1d(np.asarray([] if t is None else t, dtype=float))
    if times.ndim != 1 or not np.all(times <= t_end):
        raise ValueError(f"t must be a 1-D array of times up to t_end = {t_end:g} s, without NaN")

    mass = motor_mass + rod_mass
    q, w2, gam = motor_mass / mass, stiffness / mass, damping / (2.0 * mass)
    values, size = np.array(list(robot.values())), 64 + 8 * len(pieces)
    while True:
        rows, flights = np.empty((size, 1 + ARC_SIZE)), np.empty((size, 2))
        n_arcs, n_flights, n_jumps, _, com, rod, longest, power, force, airborne = follow_jump(
            pieces, values, float(t_end), rows, flights
        )
        if n_arcs <= size:
            break
        size = n_arcs
    flights = flights[:n_flights]
    x, v, x_motor, f_s = _sample(rows[:n_arcs], pieces[0], times, q, gravity, w2, gam)
    cut = airborne and longest == 0.0
    step_in, step_out = motor(pieces[0], 0.0)[1], motor(pieces[-1], stop - pieces[-1, 0])[1]
    reduced = motor_mass * rod_mass / mass
    return HardMotion(
        t=times,
        rod=x,
        rod_velocity=v,
        motor=x_motor,
        spring_force=f_s * mass,
        lift_off=flights[:, 0].copy(),
        landing=flights[:, 1].copy(),
        n_jumps=n_jumps,
        com_height=com,
        jump_height=rod,
        flight_height=math.nan if cut else gravity * longest**2 / 8.0,
        peak_power_W=motor_mass * power,
        peak_force_N=motor_mass * force,
        peak_motor_speed=max(_peak_speed(tuple(p)) for p in pieces.tolist()),
        impulse_work_J=(0.5 * reduced * step_in**2, -0.5 * reduced * step_out**2),
    )


def hard_sweep(
    laws: ArrayLike,
    *,
    motor_mass: ArrayLike,
    rod_mass: ArrayLike,
    stiffness: ArrayLike,
    damping: ArrayLike,
    gravity: ArrayLike,
    landing_loss: ArrayLike,
) -> dict[str, AnyArray]:
    """The results of one jump for every law, in parallel.

    laws: shape (..., r, 6), the rows of a forcing.Segments for every point. The other arguments, as in hard_jump,
    broadcast against (...). Returns arrays of shape (...): com_height_m, flight_height_m, jump_height_m, n_jumps,
    lift_off_s (first lift-off after the start, NaN without one), peak_power_W, peak_force_N, peak_motor_speed, as in
    HardMotion with t_end beyond the first landing of a free flight. ValueError for a bad argument.
    """
    laws = np.asarray(laws, dtype=float)
    if laws.ndim < 2 or laws.shape[-1] != 6 or laws.shape[-2] == 0:
        raise ValueError(f"laws must have the shape (..., rows, 6), not {laws.shape}")
    _check_rows(laws)
    values = {
        "motor_mass": motor_mass,
        "rod_mass": rod_mass,
        "stiffness": stiffness,
        "damping": damping,
        "gravity": gravity,
        "landing_loss": landing_loss,
    }
    for name, value in values.items():
        _check(name, value)
    shape = np.broadcast_shapes(laws.shape[:-2], *(np.shape(v) for v in values.values()))
    one = all(np.size(v) == 1 for v in values.values())
    each = [np.broadcast_to(np.asarray(v, float), (1,) * len(shape) if one else shape) for v in values.values()]
    robots = np.stack([v.ravel() for v in each], axis=-1)
    pieces = np.zeros((*shape, laws.shape[-2], 9))
    pieces[..., OF_SEGMENT] = laws
    pieces = pieces.reshape(-1, *pieces.shape[-2:])
    out = np.empty((len(RESULTS), len(pieces)))
    _sweep(len(pieces), pieces, robots, out)
    result: dict[str, AnyArray] = {name: column.reshape(shape) for name, column in zip(RESULTS, out)}
    result["n_jumps"] = result["n_jumps"].astype(np.int64)
    return result


def sine_rows(frequency: ArrayLike, amplitude: ArrayLike, phase: ArrayLike, cycles: ArrayLike) -> Array:
    """The laws forcing.sinusoid(frequency, amplitude, phase, cycles), shape (..., 1, 6); the arguments broadcast."""
    for name, value in {"frequency": frequency, "amplitude": amplitude, "phase": phase, "cycles": cycles}.items():
        _check(name, value)
    f, amp, ph, n = np.broadcast_arrays(*(np.asarray(v, float) for v in (frequency, amplitude, phase, cycles)))
    columns = (np.zeros(f.shape), n / f, -amp * np.sin(ph), amp, 2.0 * np.pi * f, ph)
    return np.stack(columns, axis=-1)[..., None, :]


def half_cycle_rows(
    frequency: ArrayLike, frequency2: ArrayLike, amplitude: ArrayLike, phase: ArrayLike, delay: ArrayLike
) -> Array:
    """Rows of a forcing.Segments, shape (..., 3, 6): half a cycle, a pause of `delay` seconds, half a cycle.

    frequency, frequency2 [Hz] of the first and second half, amplitude [m], phase [rad] at the start, delay >= 0 [s];
    the arguments broadcast. X_m = A [sin(angle) - sin(phase)], angle running over phase..phase + pi..phase + 2 pi; with
    cos(phase) != 0 and two frequencies the velocity steps between the halves. Without a pause the second half stands
    in two rows. ValueError for a bad argument.
    """
    sine_rows(frequency, amplitude, phase, 1.0)  # refuses what no law may hold
    f1, f2, amp, ph, wait = np.broadcast_arrays(
        *(np.asarray(v, float) for v in (frequency, frequency2, amplitude, phase, delay))
    )
    if not (np.isfinite(f2).all() and (f2 > 0.0).all()):
        raise ValueError(f"frequency2 = {f2[~(f2 > 0.0)].flat[:1]} must be a finite number > 0 Hz")
    if not (np.isfinite(wait).all() and (wait >= 0.0).all()):
        raise ValueError(f"delay = {wait[~(wait >= 0.0)].flat[:1]} must be a finite number >= 0 s")
    w1, w2, base, half = 2 * np.pi * f1, 2 * np.pi * f2, -amp * np.sin(ph), 0.5 / f1
    paused = wait > 0.0
    middle = np.where(paused, half + wait, half + 0.25 / f2)
    end = half + wait + 0.5 / f2
    zero = np.zeros(f1.shape)
    first = (zero, half, base, amp, w1, ph)
    pause = (
        half,
        middle,
        np.where(paused, base + amp * np.sin(ph + np.pi), base),
        np.where(paused, 0.0, amp),
        np.where(paused, 0.0, w2),
        np.where(paused, 0.0, ph + np.pi),
    )
    second = (middle, end, base, amp, w2, np.where(paused, ph + np.pi, ph + 1.5 * np.pi))
    return np.stack([np.stack(row, axis=-1) for row in (first, pause, second)], axis=-2)


def hard_map(
    frequencies: ArrayLike,
    phases: ArrayLike,
    *,
    amplitude: float,
    cycles: float,
    motor_mass: float,
    rod_mass: float,
    stiffness: float,
    damping: float,
    gravity: float,
    landing_loss: float,
) -> dict[str, AnyArray]:
    """hard_sweep over the sinusoidal law: frequencies (nf,) [Hz], phases (np,) [rad]; results of shape (nf, np)."""
    f, ph = np.asarray(frequencies, float)[:, None], np.asarray(phases, float)[None, :]
    return hard_sweep(
        sine_rows(f, amplitude, ph, cycles),
        motor_mass=motor_mass,
        rod_mass=rod_mass,
        stiffness=stiffness,
        damping=damping,
        gravity=gravity,
        landing_loss=landing_loss,
    )


def _check(name: str, value: ArrayLike) -> None:
    """ValueError naming the parameter, its first bad value and its range."""
    unit, low, closed = RANGES[name]
    a = np.asarray(value, dtype=float)
    good = np.isfinite(a) & ((a >= low) if closed else (a > low))
    allowed = "a finite number" if low == -math.inf else f"{'>=' if closed else '>'} {low:g}"
    if name == "landing_loss":
        good &= a < 1.0
        allowed = "in [0, 1)"
    if not good.all():
        raise ValueError(f"{name} = {a[~good].flat[0]} must be {allowed}{unit and ' ' + unit}")


def _check_rows(rows: Array) -> None:
    """ValueError unless (..., r, 6) rows of a law are finite, contiguous and continuous, with A, omega >= 0."""
    if not np.isfinite(rows).all():
        raise ValueError("forcing: every row must be finite; remove NaN and infinite entries")
    if not (rows[..., 1] > rows[..., 0]).all():
        raise ValueError("forcing: every row must end after it starts, t1 > t0")
    if not (rows[..., 3] >= 0).all() or not (rows[..., 4] >= 0).all():
        raise ValueError("forcing: amplitude A must be >= 0 m (0: a pause) and omega >= 0 rad/s; shift the phase by pi")
    before, after = rows[..., :-1, :], rows[..., 1:, :]
    last = before[..., 4] * (before[..., 1] - before[..., 0]) + before[..., 5]
    gap = np.abs(after[..., 0] - before[..., 1])
    jump = np.abs(
        after[..., 2] + after[..., 3] * np.sin(after[..., 5]) - before[..., 2] - before[..., 3] * np.sin(last)
    )
    if (gap > 1e-9).any() or (jump > 1e-9).any():
        raise ValueError("forcing: rows must be contiguous in time and X_m continuous, to 1e-9 s and 1e-9 m")


def _pieces(forcing: Forcing) -> Array:
    """The (n, 9) rows of arc.make_arc."""
    if isinstance(forcing, Segments):
        rows = np.asarray(forcing.rows, float)
        _check_rows(rows)
        out = np.zeros((len(rows), 9))
        out[:, OF_SEGMENT] = rows
    else:
        if not (
            np.isfinite(forcing.c).all() and np.isfinite(forcing.knots).all() and np.all(np.diff(forcing.knots) > 0)
        ):
            raise ValueError("forcing: the spline must be finite, its knots increasing")
        out = np.zeros((forcing.c.shape[1], 9))
        out[:, 0], out[:, 1] = forcing.knots[:-1], forcing.knots[1:]
        out[:, 2:6] = forcing.c[::-1].T
    out[:-1, 1] = out[1:, 0]
    return out


@nb.njit(**KERNEL)
def _peak_speed(p: tuple[float, ...]) -> float:
    """Greatest |X_m'| [m/s] of a piece, a sinusoid or a cubic."""
    peak, length = 0.0, p[1] - p[0]
    if math.floor((p[7] * length + p[8]) / math.pi) >= math.ceil(p[8] / math.pi):  # |cos| = 1 inside
        peak = p[6] * p[7]
    if peak < p[6] * p[7] + abs(p[3]) or p[4] != 0.0 or p[5] != 0.0:
        peak = max(peak, abs(motor(p, 0.0)[1]), abs(motor(p, length)[1]))
    if p[5] != 0.0 and 0.0 < -p[4] / (3.0 * p[5]) < length:  # a crest of the parabola
        peak = max(peak, abs(p[3] - p[4] * p[4] / (3.0 * p[5])))
    return peak


@nb.njit(cache=True)
def _sample(
    rows: Array, piece: Array, t: Array, q: float, g: float, w2: float, gam: float
) -> tuple[Array, Array, Array, Array]:
    """x_r, v_r, x_m and F_s/M at the times t; at rest before the first arc."""
    x, v, xm, f = np.empty(t.size), np.empty(t.size), np.empty(t.size), np.empty(t.size)
    for i in range(t.size):
        if t[i] < rows[0, 0]:
            x[i], v[i], f[i] = -g / w2, 0.0, g
            xm[i] = x[i] + (piece[2] + piece[6] * math.sin(piece[8]))  # not fused: zero where the law starts at zero
            continue
        row = rows[np.searchsorted(rows[:, 0], t[i], side="right") - 1]
        x[i], v[i], _, mx, _, _, _ = evaluate(row[1:], t[i] - row[0], q, g)
        xm[i] = x[i] + mx
        f[i] = 0.0 if row[1 + KIND] == AIR else -w2 * x[i] - 2.0 * gam * v[i]
    return x, v, xm, f


@shared(**KERNEL)
def _sweep(first: int, last: int, pieces: Array, robots: Array, out: Array) -> None:
    """hard_sweep, flat: pieces (n, r, 9), robots (n or 1, 6) in the order of its arguments, out (8, n) as RESULTS."""
    none = np.empty((0, 2))
    for i in range(first, last):
        robot = robots[min(i, robots.shape[0] - 1)]
        _, _, n_jumps, lifted, com, rod, longest, power, force, _ = follow_jump(pieces[i], robot, math.inf, none, none)
        out[0, i], out[1, i], out[2, i], out[3, i] = com, robot[4] * longest * longest / 8.0, rod, n_jumps
        out[4, i], out[5, i], out[6, i] = lifted - pieces[i, 0, 0], robot[0] * power, robot[0] * force
        out[7, i] = 0.0
        for p in pieces[i]:
            law = (p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8])
            out[7, i] = max(out[7, i], _peak_speed(law))
