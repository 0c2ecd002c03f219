"""The hopper driven without end while the frequency goes up and down, and jumps from a start not quite at rest."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import AnyArray, Array
from jumpvision.jumper.physics.forcing import Segments

from .jump import HardRobot, hard_jump, hard_sweep, sine_rows

PHASE = 1.5 * math.pi  # the motor is at rest between cycles: a change of frequency makes no velocity step


def cycles_in_a_row(frequencies: ArrayLike, *, amplitude: float, cycles: int) -> Segments:
    """`cycles` whole cycles at each of the frequencies (n,) [Hz], one after the other; phase 3 pi/2."""
    f = np.asarray(frequencies, float)
    if cycles < 1 or cycles != int(cycles):
        raise ValueError(f"cycles = {cycles} must be a whole number >= 1: the motor stands still between whole cycles")
    edges = np.concatenate([[0.0], np.cumsum(cycles / f)])
    same = np.full(f.shape, 1.0)
    columns = (edges[:-1], edges[1:], amplitude * same, amplitude * same, 2 * np.pi * f, PHASE * same)
    return Segments(np.stack(columns, axis=-1))


def apexes(
    frequencies: ArrayLike,
    *,
    robot: HardRobot,
    amplitude: float,
    settle: int,
    keep: int,
) -> tuple[Array, NDArray[np.int64]]:
    """Apex heights of the hops [m] at each frequency, (n, keep), NaN-padded, and their numbers (n,).

    An apex is the greatest height of the centre of mass y above its rest in one flight, of y at the lift-off where it
    already falls. frequencies: (n,) [Hz] in the order of the sweep; settle cycles are left out at each, then the
    flights of `keep` cycles are taken (at most `keep` of them, the last).
    """
    f = np.asarray(frequencies, float)
    law = cycles_in_a_row(f, amplitude=amplitude, cycles=settle + keep)
    flights = hard_jump(**robot._asdict(), forcing=law, t=None, t_end=law.stop)
    at = flights.lift_off
    motion = hard_jump(**robot._asdict(), forcing=law, t=at, t_end=law.stop)
    position, rate = law(at)
    share = robot.motor_mass / robot.mass
    rise = motion.rod_velocity + share * rate
    rest = robot.mass * robot.gravity / robot.stiffness
    height = motion.rod + share * position + rest + np.maximum(rise, 0.0) ** 2 / (2.0 * robot.gravity)
    out, count = np.full((f.size, keep), np.nan), np.zeros(f.size, np.int64)
    for i, (start, stop, *_) in enumerate(law.rows):
        inside = height[(at >= start + settle / f[i]) & (at < stop)][-keep:]
        count[i] = inside.size
        out[i, : inside.size] = inside
    return out, count


def distinct(heights: Array, *, tolerance: float) -> NDArray[np.int64]:
    """How many different apex heights each row (n, m) holds, heights nearer than tolerance [m] being one."""
    ordered = np.sort(heights, axis=1)  # NaN last
    gaps = np.diff(ordered, axis=1) > tolerance
    return np.isfinite(ordered[:, 0]).astype(np.int64) + np.sum(gaps, axis=1)


def ringing_rows(law: Array, ringing: ArrayLike, pause: ArrayLike, *, share: float, f0: float) -> Array:
    """A law of one row, (..., 1, 6), after a start-up ringing: (..., 3, 6).

    ringing: amplitude of the rod's ringing [m] without damping; pause > 0 [s] between its making and the law.
    share: m_m/M. From rest at resonance one cycle of amplitude a leaves the rod ringing with pi (m_m/M) a.
    """
    a, wait = np.asarray(ringing, float) / (np.pi * share), np.asarray(pause, float)
    shape = np.broadcast_shapes(law.shape[:-2], a.shape, wait.shape)
    a, wait = np.broadcast_to(a, shape), np.broadcast_to(wait, shape)
    out = np.zeros((*shape, 3, 6))
    w = 2.0 * np.pi * f0
    # phase pi/2: the cycle begins and ends with the motor at rest, X_m = a (cos - 1)
    for j, v in enumerate((0.0, 1.0 / f0, -a, a, w, 0.5 * np.pi)):
        out[..., 0, j] = v
    out[..., 1, 0], out[..., 1, 1] = 1.0 / f0, 1.0 / f0 + wait
    out[..., 2, :] = law[..., 0, :]
    out[..., 2, :2] += (1.0 / f0 + wait)[..., None]
    return out


def scattered(
    frequencies: ArrayLike,
    phases: ArrayLike,
    *,
    robot: HardRobot,
    ringing: float,
    trials: int,
    rng: np.random.Generator,
    amplitude: float,
    cycles: float,
) -> dict[str, AnyArray]:
    """hard_map's results, (nf, np, trials), of jumps that start from a ringing spring.

    ringing [m]: standard deviation of the rod's displacement, and of its velocity over w_0, at the start of the law.
    lift_off_s counts from the law's start; a spring that leaves the ground before it gives a negative one.
    """
    f0 = robot.f0
    f = np.asarray(frequencies, float)[:, None, None]
    ph = np.asarray(phases, float)[None, :, None]
    shape = (f.size, ph.size, trials)
    a = ringing * np.hypot(rng.standard_normal(shape), rng.standard_normal(shape))
    pause = (0.5 + rng.uniform(size=shape)) / f0
    laws = ringing_rows(sine_rows(f, amplitude, ph, cycles), a, pause, share=robot.motor_mass / robot.mass, f0=f0)
    out = hard_sweep(laws, **robot._asdict())
    return out | {"lift_off_s": out["lift_off_s"] - laws[..., 2, 0]}
