"""The loaded spring as an oscillator, and its dimensionless numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from jumpvision.base.arrays import Array

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
