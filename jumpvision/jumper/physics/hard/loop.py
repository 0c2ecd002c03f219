"""Time to lift off with the motor's feedback loop: until then motor, rod and spring are one linear system."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from jumpvision.base.arrays import AnyArray, Array
from jumpvision.jumper.physics.oscillator import best_jump

from .analysis import Search
from .jump import HardRobot

SAMPLES = 64  # of a forcing cycle; a parabola about the highest is right to 1e-6 of it


class LoopGains(NamedTuple):
    """Of F_m = kp (X_c - X_m) + kd (X_c' - X_m') + m_m g: N/m and N s/m."""

    kp: float
    kd: float


def looped_amplitude(
    frequencies: ArrayLike, phase: float, *, robot: HardRobot, loop: LoopGains, cycles: float
) -> Array:
    """Least amplitude [m] of a sinusoidal command that lifts off within `cycles` cycles, the motor held by its loop.

    frequencies (n,) [Hz]; phase [rad]. Returns (n,); NaN where the rod does not rise. From rest, x of the rod and X of
    the motor on it, without weights, which rest on the spring: m_m (x'' + X'') = F, m_r x'' = -F - k x - c x',
    F = kp (X_c - X) + kd (X_c' - X'). It lifts off where x exceeds M g / k. Closed form, SAMPLES a cycle.
    """
    m_m, m_r, k, c = robot.motor_mass, robot.rod_mass, robot.stiffness, robot.damping
    kp, kd = loop
    rod = np.array([-k, -c, kp, kd]) / m_r
    motor = np.array([0.0, 0.0, -kp, -kd]) / m_m - rod
    a = np.array([[0.0, 1.0, 0.0, 0.0], rod, [0.0, 0.0, 0.0, 1.0], motor])
    b = np.array([0.0, -1.0 / m_r, 0.0, 1.0 / m_m + 1.0 / m_r])
    rates, shapes = np.linalg.eig(a)
    held = np.linalg.solve(a, b) * kp * math.sin(phase)  # the constant part of the command
    least = []
    for f in np.atleast_1d(np.asarray(frequencies, float)):
        w = 2.0 * math.pi * f
        steady = np.linalg.solve(1j * w * np.eye(4) - a, b * (kp + 1j * w * kd)) * np.exp(1j * phase)
        free = np.linalg.solve(shapes, -(steady.imag + held))
        t = np.linspace(0.0, cycles / f, math.ceil(SAMPLES * cycles) + 1)
        x = (steady[0] * np.exp(1j * w * t)).imag + held[0] + (np.exp(np.outer(t, rates)) @ (shapes[0] * free)).real
        least.append(robot.mass * robot.gravity / robot.stiffness / _top(x))
    return np.array(least)


def _top(x: Array) -> float:
    """Greatest value of equal samples, by the parabola about it; NaN where none is above 0."""
    i = int(np.argmax(x))
    if x[i] <= 0.0:
        return math.nan
    if not 0 < i < x.size - 1:
        return float(x[i])
    left, right = x[i] - x[i - 1], x[i] - x[i + 1]
    return float(x[i] + 0.125 * (left - right) ** 2 / (left + right)) if left + right > 0.0 else float(x[i])


def easiest_looped(
    phase: float, *, robot: HardRobot, loop: LoopGains, cycles: float, search: Search
) -> tuple[float, float]:
    """f_N / f_0 and the amplitude [m] there, as `easiest_frequency` has them of a motor that is where the law says."""

    def jumps(at: list[Array]) -> dict[str, AnyArray]:
        return {"amplitude": -looped_amplitude(at[0] * robot.f0, phase, robot=robot, loop=loop, cycles=cycles)}

    at, best = best_jump(
        jumps, [search.lowest], [search.highest], points=search.points, rounds=search.rounds, key="amplitude"
    )
    return float(at[0]), -float(best["amplitude"])
