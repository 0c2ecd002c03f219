"""How soon a robot lifts off, and the frequency at which N cycles do it with the least amplitude (thesis Fig 26)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.physics.analysis import minimum_amplitude
from jumpvision.physics.optimum import best_jump
from jumpvision.physics.scales import natural_frequency

Array = NDArray[np.float64]


def easiest_frequency(
    phase: float,
    *,
    cycles: float,
    lowest: float,
    highest: float,
    points: int,
    rounds: int,
    largest: float,
    resolution: float,
    motor_mass: float,
    rod_mass: float,
    stiffness: float,
    damping: float,
    gravity: float,
) -> tuple[float, float]:
    """f_N / f_0 and the amplitude [m] there: the least that lifts off within N = `cycles` cycles (no wait after them).

    phase [rad]; lowest, highest: f/f_0 searched; points, rounds: see optimum.best_jump; largest, resolution [m]: see
    analysis.minimum_amplitude. The resolution must be far below the differences of A_min that matter: near resonance
    A_min is flat.
    """
    f0 = natural_frequency(stiffness, motor_mass + rod_mass)

    def jumps(at: list[Array]) -> dict[str, NDArray]:
        least = minimum_amplitude(
            at[0] * f0, [phase], cycles=cycles, wait=0.0, largest=largest, resolution=resolution,
            motor_mass=motor_mass, rod_mass=rod_mass, stiffness=stiffness, damping=damping, gravity=gravity,
        )[:, 0]  # fmt: skip
        return {"amplitude": -least}

    at, best = best_jump(jumps, [lowest], [highest], points=points, rounds=rounds, key="amplitude")
    return float(at[0]), -float(best["amplitude"])


def inertial_peak(zeta: ArrayLike) -> Array:
    """f/f_0 where the steady response to inertial forcing is greatest: 1/sqrt(1 - 2 zeta^2), above f_0."""
    return 1.0 / np.sqrt(1.0 - 2.0 * np.asarray(zeta, float) ** 2)
