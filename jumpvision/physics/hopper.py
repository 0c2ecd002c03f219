"""The hopper driven without end: apex heights of its long-run motion while the frequency goes up, then down.

The motor never stops; the frequency changes by small steps between whole cycles, so that each begins with the motion
of the one before and coexisting motions (hysteresis) show as a difference between the two ways (thesis section 2.4.1).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.physics.forcing import Segments
from jumpvision.physics.hard import hard_jump

Array = NDArray[np.float64]
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
    amplitude: float,
    settle: int,
    keep: int,
    motor_mass: float,
    rod_mass: float,
    stiffness: float,
    damping: float,
    gravity: float,
    landing_loss: float,
) -> tuple[Array, NDArray[np.int64]]:
    """Apex heights of the hops [m] at each frequency, (n, keep), NaN-padded, and their numbers (n,).

    An apex is the greatest height of the centre of mass y above its rest in one flight, of y at the lift-off where it
    already falls. frequencies: (n,) [Hz] in the order of the sweep; settle cycles are left out at each, then the
    flights of `keep` cycles are taken (at most `keep` of them, the last).
    """
    robot = {"motor_mass": motor_mass, "rod_mass": rod_mass, "stiffness": stiffness, "damping": damping,
             "gravity": gravity, "landing_loss": landing_loss}  # fmt: skip
    f = np.asarray(frequencies, float)
    law = cycles_in_a_row(f, amplitude=amplitude, cycles=settle + keep)
    flights = hard_jump(**robot, forcing=law, t=None, t_end=law.stop)
    at = flights.lift_off
    motion = hard_jump(**robot, forcing=law, t=at, t_end=law.stop)
    position, rate = law(at)
    share = motor_mass / (motor_mass + rod_mass)
    rise = motion.rod_velocity + share * rate
    rest = (motor_mass + rod_mass) * gravity / stiffness
    height = motion.rod + share * position + rest + np.maximum(rise, 0.0) ** 2 / (2.0 * gravity)
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
