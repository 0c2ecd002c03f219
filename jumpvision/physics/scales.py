"""Relations between a robot's values and its dimensionless numbers (PHYSICS.md section 1)."""

from __future__ import annotations

from typing import Any

import numpy as np


def natural_frequency(stiffness: Any, mass: Any) -> Any:
    """f_0 = sqrt(k/M) / (2 pi) [Hz]; mass M = m_m + m_r [kg]."""
    return np.sqrt(stiffness / mass) / (2.0 * np.pi)


def damping_of(zeta: Any, stiffness: Any, mass: Any) -> Any:
    """c = 2 zeta sqrt(k M) [N s/m]."""
    return 2.0 * zeta * np.sqrt(stiffness * mass)


def amplitude_of(alpha: Any, stiffness: Any, mass: Any, gravity: Any) -> Any:
    """A = M g / (k alpha) [m]."""
    return mass * gravity / (stiffness * alpha)


def gravity_of(alpha: Any, stiffness: Any, mass: Any, amplitude: Any) -> Any:
    """g = alpha k A / M [m/s^2]."""
    return alpha * stiffness * amplitude / mass
