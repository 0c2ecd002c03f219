"""The jammed cone that grows under a flat foot, its mechanisms (docs/physics.md section 3; thesis eqs. 23-28, 32-34).

A front of jammed grains runs ahead of the foot at mu times its depth z; shear bands at the angle theta narrow it, so
the flat face shrinks as r = R - mu z / tan(theta) and the rest of the foot becomes the mantle of a cone, complete at
mu z = R tan(theta). Depths z >= 0 [m], scalar or array; `xp` is the array namespace (numpy or one like it). The same
functions run as plain Python and inside compiled code.
"""

from __future__ import annotations

import math
from typing import Any

from .ground import K1, SAND
from .record import Body, Mechanism, Parameter, Prior, law


@law
def flat_radius(xp: Any, z: Any, mu: float, theta: float, R: float) -> Any:
    """r = R - mu z / tan(theta) until the cone is complete, then 0 [m] (23)."""
    return xp.maximum(R - mu / xp.tan(theta) * z, 0.0)


def complete(xp: Any, mu: float, theta: float, R: float) -> Any:
    """Depth where the cone is complete, R tan(theta) / mu [m]."""
    return R * xp.tan(theta) / mu


@law
def flat_area(xp: Any, z: Any, mu: float, theta: float, R: float) -> Any:
    """A_flat = pi r^2 [m^2] (24)."""
    r = flat_radius(xp, z, mu, theta, R)
    return math.pi * r * r


@law
def cone_area(xp: Any, z: Any, mu: float, theta: float, R: float) -> Any:
    """A_cone = (pi R^2 - A_flat) / cos(theta) [m^2] (25)."""
    return (math.pi * R * R - flat_area(xp, z, mu, theta, R)) * (1.0 + xp.tan(theta) ** 2) ** 0.5


@law
def flat_volume(xp: Any, z: Any, mu: float, theta: float, R: float) -> Any:
    """Integral of A_flat from the surface to z [m^3]: pi (R^3 - r^3) tan(theta) / (3 mu)."""
    r = flat_radius(xp, z, mu, theta, R)
    return math.pi * xp.tan(theta) / (3.0 * mu) * (R**3 - r**3)


@law
def cone_volume(xp: Any, z: Any, mu: float, theta: float, R: float) -> Any:
    """Integral of A_cone from the surface to z [m^3]."""
    return (math.pi * R * R * z - flat_volume(xp, z, mu, theta, R)) * (1.0 + xp.tan(theta) ** 2) ** 0.5


@law
def cone_mass(xp: Any, z: Any, C: float, mu: float, theta: float, R: float, phi: float, rho: float) -> Any:
    """m_a = C phi rho mu (integral of A_flat) [kg] (33): constant once the cone is complete."""
    return C * phi * rho * mu * flat_volume(xp, z, mu, theta, R)


@law
def cone_mass_slope(xp: Any, z: Any, C: float, mu: float, theta: float, R: float, phi: float, rho: float) -> Any:
    """dm_a/dz = C phi rho mu A_flat [kg/m] (32), greatest at the surface."""
    return C * phi * rho * mu * flat_area(xp, z, mu, theta, R)


@law
def rft_cone(xp: Any, z: Any, k1: float, sigma_cone: float, mu: float, theta: float, R: float) -> Any:
    """(k1 / pi R^2) int A_flat dz + sigma_z(30 deg, 90 deg) int A_cone dz: resistive force theory (26)-(28)."""
    flat = k1 * flat_volume(xp, z, mu, theta, R) / (math.pi * R * R)
    return flat + sigma_cone * cone_volume(xp, z, mu, theta, R)


@law
def depth_drag(
    xp: Any, z: Any, v: Any, b: float, C: float, mu: float, theta: float, R: float, phi: float, rho: float
) -> Any:
    """b (dm_a/dz) v^2 (34)."""
    return b * cone_mass_slope(xp, z, C, mu, theta, R, phi, rho) * v * v


@law
def added_mass(xp: Any, z: Any, a: Any, C: float, mu: float, theta: float, R: float, phi: float, rho: float) -> Any:
    """-m_a(z) a (34), inertia of the jammed cone."""
    return -cone_mass(xp, z, C, mu, theta, R, phi, rho) * a


SIGMA = Parameter(
    "sigma_cone",
    "N/m^3",
    "vertical stress per depth on the cone's mantle (RFT)",
    lambda m: Prior(1.3e5, 0.0, 2e6, 2e4),
    lo=0,
    stiffness=True,
)
MU = Parameter(
    "mu",
    "",
    "growth of the jammed front per depth",
    lambda m: Prior(m.parameters.mu, 0.3, 6.0, 0.2, 0.4, log=True),
    default=2.2,
    lo=0,
    open_lo=True,
)
THETA = Parameter(
    "theta",
    "",
    "angle of the cone's mantle, rad",
    lambda m: Prior(m.parameters.theta, 0.6, 1.45, 0.05, math.radians(5.0)),
    default=math.pi / 3,
    lo=0.01,
    hi=1.56,
)
B = Parameter("b", "", "scale of the depth-dependent drag", lambda m: Prior(0.0, 0.0, 500.0, 5.0, log=True), lo=0)
C = Parameter("C", "", "scale of the added mass", lambda m: Prior(0.0, 0.0, 20.0, 0.5, log=True), lo=0)

RFT_CONE = Mechanism(
    "rft_cone",
    Body.STATIC,
    (K1, SIGMA, MU, THETA),
    "static force of a growing cone by RFT",
    "the resistance of a growing cone",
    "thesis eqs. (23)-(28)",
    "k1/(pi R^2) int A_flat dz + sigma_cone int A_cone dz",
    rft_cone,
    bend=complete,
    grounds=SAND,
)
DEPTH_DRAG = Mechanism(
    "depth_drag",
    Body.DRAG,
    (B, C, MU, THETA),
    "drag b (dm_a/dz) v^2",
    "the drag of grains that join the cone",
    "thesis eqs. (32), (34)",
    "b m_a'(z) v^2",
    depth_drag,
    bend=complete,
    grounds=SAND,
    assumed={"C": 2.7},  # of the thesis: only the product b C shows without the added mass
)
ADDED_MASS = Mechanism(
    "added_mass",
    Body.INERTIA,
    (C, MU, THETA),
    "inertia m_a(z) a of the jammed cone",
    "the added mass of the jammed cone",
    "thesis eqs. (33), (34)",
    "m_a(z)",
    added_mass,
    slope=cone_mass_slope,
    bend=complete,
    grounds=SAND,
    goes_with=("depth_drag",),
)
