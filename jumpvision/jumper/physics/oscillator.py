"""The loaded spring as an oscillator, its dimensionless numbers, and the best jump over parameters of a law."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from jumpvision.base.arrays import AnyArray, Array

RIPPLE = 3.0  # static deflections M g/k by which a foot swings at most after lift-off


def foot_frequency(k: float, m_f: float, M: float) -> float:
    """Frequency [Hz] of a foot hanging from the spring in flight, sqrt(k/m_f + k/M)/(2 pi); k [N/m], m_f, M [kg]."""
    return math.sqrt(k / m_f + k / M) / (2.0 * math.pi)


def lift_off_amplitude(k: float, M: float, g: float) -> float:
    """M g/k [m]: the largest oscillation on the ground that keeps the spring compressed; g [m/s^2] along the rail."""
    return M * g / k


def foot_ripple(k: float, m_f: float, M: float, g: float) -> float:
    """Amplitude [m] by which a foot, swinging on the spring in flight, shakes the rod at most.

    The rod answers a swing of the foot with m_f/(M + m_f) of it; the swing is allowed RIPPLE static deflections.
    """
    return m_f / (M + m_f) * RIPPLE * lift_off_amplitude(k, M, g)


Numbers = float | Array


def natural_frequency(stiffness: Numbers, mass: Numbers) -> Any:
    """f_0 = sqrt(k/M) / (2 pi) [Hz]; mass M = m_m + m_r [kg]."""
    return np.sqrt(stiffness / mass) / (2.0 * np.pi)


def damping_of(zeta: Numbers, stiffness: Numbers, mass: Numbers) -> Any:
    """c = 2 zeta sqrt(k M) [N s/m]."""
    return 2.0 * zeta * np.sqrt(stiffness * mass)


def amplitude_of(alpha: Numbers, stiffness: Numbers, mass: Numbers, gravity: Numbers) -> Any:
    """A = M g / (k alpha) [m]."""
    return mass * gravity / (stiffness * alpha)


def gravity_of(alpha: Numbers, stiffness: Numbers, mass: Numbers, amplitude: Numbers) -> Any:
    """g = alpha k A / M [m/s^2]."""
    return alpha * stiffness * amplitude / mass


Jumps = Callable[[list[Array]], dict[str, AnyArray]]


def best_jump(
    jumps: Jumps, low: ArrayLike, high: ArrayLike, *, points: int, rounds: int, key: str
) -> tuple[Array, dict[str, AnyArray]]:
    """Where jumps(...)[key] is greatest, and the results there.

    low, high: (..., d) corners of the boxes searched. jumps takes d arrays of shape (..., n) and returns arrays of
    that shape. Each of the `rounds` + 1 grids has points^d nodes; a smaller one spans two cells of the one before, so
    the answer is right to (high - low) (2 / (points - 1))^rounds / (points - 1), where the first grid finds the
    highest peak. Returns ((..., d), {name: (...)}). NaN counts as lowest. ValueError with fewer than 4 points.
    """
    if points < 4:
        raise ValueError(f"points = {points} must be >= 4, or the grids do not shrink")
    lo, hi = np.broadcast_arrays(np.asarray(low, float), np.asarray(high, float))
    first_lo, first_hi = lo, hi
    shape, d = lo.shape[:-1], lo.shape[-1]
    nodes = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, points)] * d, indexing="ij"), axis=-1).reshape(-1, d)
    for i in range(rounds + 1):
        where = lo[..., None, :] + nodes * (hi - lo)[..., None, :]
        found = jumps([where[..., k] for k in range(d)])
        best = np.argmax(np.where(np.isnan(found[key]), -np.inf, found[key]), axis=-1)
        at = np.take_along_axis(where, best[..., None, None], axis=-2)[..., 0, :]
        cell = (hi - lo) / (points - 1)
        if i < rounds:
            lo, hi = np.maximum(at - cell, first_lo), np.minimum(at + cell, first_hi)
    return at, {n: np.take_along_axis(v, best[..., None], axis=-1)[..., 0].reshape(shape) for n, v in found.items()}
