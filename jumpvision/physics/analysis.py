"""What hard-ground jumps are compared with: the least amplitude that lifts off, estimates of the best frequency.

Estimates are for a massless rod and no damping, in the ratio r = f/f_0 and alpha = M g/(k A) (thesis section 2.5.1).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.physics.hard import hard_sweep, sine_rows

Array = NDArray[np.float64]


def minimum_amplitude(
    frequencies: ArrayLike,
    phases: ArrayLike,
    *,
    cycles: float,
    wait: float,
    largest: float,
    resolution: float,
    motor_mass: float,
    rod_mass: float,
    stiffness: float,
    damping: float,
    gravity: float,
) -> Array:
    """Least amplitude A [m] whose sinusoidal law lifts the settled robot off the ground, by bisection (thesis Fig 24).

    frequencies (nf,) [Hz], phases (np,) [rad].
    wait [s]: lift-off counts until the law's end plus this: 0, or one natural period.
    largest [m]: greatest amplitude tried. resolution [m]: width of the last bracket (encoder step: 6.25e-6).
    Returns (nf, np), the middle of the bracket, so right to resolution / 2; NaN where `largest` does not lift off.
    Until lift-off the flow is linear in A: there is one threshold. ValueError for a bad argument (see hard_sweep).
    """
    for name, value in (("largest", largest), ("resolution", resolution)):
        if not 0.0 < value < math.inf:
            raise ValueError(f"{name} = {value} must be > 0 m")
    if not 0.0 <= wait < math.inf:
        raise ValueError(f"wait = {wait} must be >= 0 s")
    f, phase = np.broadcast_arrays(np.asarray(frequencies, float)[:, None], np.asarray(phases, float)[None, :])

    def lifts(amplitude: Array) -> NDArray[np.bool_]:
        jumps = hard_sweep(
            sine_rows(f, amplitude, phase, cycles),
            motor_mass=motor_mass,
            rod_mass=rod_mass,
            stiffness=stiffness,
            damping=damping,
            gravity=gravity,
            landing_loss=0.0,
        )
        return np.asarray(jumps["lift_off_s"] <= cycles / f + wait)  # NaN, no lift-off, compares false

    low, high = np.zeros(f.shape), np.full(f.shape, largest)
    possible = lifts(high)
    for _ in range(max(0, math.ceil(math.log2(largest / resolution)))):
        middle = 0.5 * (low + high)
        up = lifts(middle)
        low, high = np.where(up, low, middle), np.where(up, middle, high)
    return np.where(possible, 0.5 * (low + high), np.nan)


def stutter_by_half_fall(alpha: ArrayLike) -> Array:
    """Eq. (8): r where the fall from 2 A takes half a cycle. alpha > 0."""
    return 0.5 * np.pi * np.sqrt(np.asarray(alpha, float))


def stutter_by_fall_and_push(alpha: ArrayLike) -> Array:
    """Eq. (10): r where the fall and half a natural period make one cycle. alpha > 0."""
    return 1.0 / (0.5 + 1.0 / (np.pi * np.sqrt(np.asarray(alpha, float))))


def stutter_by_three_parts(alpha: ArrayLike) -> Array:
    """Eq. (12): r where the time to the first lift-off, the fall and half a natural period make one cycle.

    The smaller root of a r^2 - b r + c = 0 in the form that stays regular where a = 0, at alpha = 4/(pi^2 + 2).
    NaN where there is no root; alpha > 0.
    """
    alpha = np.asarray(alpha, float)
    first = np.sqrt(alpha / 18.0)
    a, b, c = 0.25 - (2.0 - alpha) / (2.0 * alpha * np.pi**2), 1.0 - first, 1.0 + alpha / 16.0 - 2.0 * first
    disc = b * b - 4.0 * a * c
    return 2.0 * c / (b + np.sqrt(np.where(disc >= 0.0, disc, np.nan)))


def energy_after_one_cycle(ratio: ArrayLike) -> Array:
    """Eq. (13): r^4 / (1 - r^2)^2 (1 - cos(2 pi / r)), the energy (to a factor) that one grounded cycle leaves.

    Written without its removable singularity at r = 1; greatest at r = 1.194. ratio > 0.
    """
    r = np.asarray(ratio, float)
    return 2.0 * (np.pi * r * np.sinc(1.0 - 1.0 / r) / (1.0 + r)) ** 2
