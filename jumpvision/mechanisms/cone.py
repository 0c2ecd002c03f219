"""The jammed cone that grows under a flat foot (docs/physics.md section 3; thesis eqs. 23-28, 32, 33).

A front of jammed grains runs ahead of the foot at mu times its depth z; shear bands at the angle theta narrow it, so
the flat face shrinks as r = R - mu z / tan(theta) and the rest of the foot becomes the mantle of a cone, complete at
mu z = R tan(theta). Depths z >= 0 [m], scalar or array; `xp` is the array namespace (numpy or one like it). The same
functions run as plain Python and inside compiled code.
"""

from __future__ import annotations

import math
from typing import Any

from numba.extending import register_jitable


@register_jitable
def flat_radius(xp: Any, z: Any, mu: float, theta: float, R: float) -> Any:
    """r = R - mu z / tan(theta) until the cone is complete, then 0 [m] (23)."""
    return xp.maximum(R - mu * z / xp.tan(theta), 0.0)


@register_jitable
def flat_area(xp: Any, z: Any, mu: float, theta: float, R: float) -> Any:
    """A_flat = pi r^2 [m^2] (24)."""
    r = flat_radius(xp, z, mu, theta, R)
    return math.pi * r * r


@register_jitable
def cone_area(xp: Any, z: Any, mu: float, theta: float, R: float) -> Any:
    """A_cone = (pi R^2 - A_flat) / cos(theta) [m^2] (25)."""
    return (math.pi * R * R - flat_area(xp, z, mu, theta, R)) * (1.0 + xp.tan(theta) ** 2) ** 0.5


@register_jitable
def flat_volume(xp: Any, z: Any, mu: float, theta: float, R: float) -> Any:
    """Integral of A_flat from the surface to z [m^3]: pi (R^3 - r^3) tan(theta) / (3 mu)."""
    r = flat_radius(xp, z, mu, theta, R)
    return math.pi * (R**3 - r**3) * xp.tan(theta) / (3.0 * mu)


@register_jitable
def cone_volume(xp: Any, z: Any, mu: float, theta: float, R: float) -> Any:
    """Integral of A_cone from the surface to z [m^3]."""
    return (math.pi * R * R * z - flat_volume(xp, z, mu, theta, R)) * (1.0 + xp.tan(theta) ** 2) ** 0.5


@register_jitable
def cone_mass(xp: Any, z: Any, C: float, mu: float, theta: float, R: float, phi: float, rho: float) -> Any:
    """m_a = C phi rho mu (integral of A_flat) [kg] (33): constant once the cone is complete."""
    return C * phi * rho * mu * flat_volume(xp, z, mu, theta, R)


@register_jitable
def cone_mass_slope(xp: Any, z: Any, C: float, mu: float, theta: float, R: float, phi: float, rho: float) -> Any:
    """dm_a/dz = C phi rho mu A_flat [kg/m] (32), greatest at the surface."""
    return C * phi * rho * mu * flat_area(xp, z, mu, theta, R)
