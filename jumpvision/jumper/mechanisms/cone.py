"""The jammed cone that grows under a flat foot, its mechanisms (docs/physics.md section 3; thesis eqs. 23-28, 32-34).

A front of jammed grains runs ahead of the foot at mu times its depth z; shear bands at the angle theta narrow it, so
the flat face shrinks as r = R - mu z / tan(theta) and the rest of the foot becomes the mantle of a cone, complete at
mu z = R tan(theta). Depths z >= 0 [m].
"""

from __future__ import annotations

import math

from jumpvision.engine.laws.expression import Expression, parse

from .ground import K1, SAND
from .record import Body, Mechanism, Parameter, Prior

CONE = {
    "r": "maximum(R - mu / tan(theta) * z, 0)",  # until the cone is complete (23), m
    "A_flat": "pi * r**2",  # (24), m^2
    "V_flat": "pi * tan(theta) / (3 * mu) * (R**3 - r**3)",  # integral of A_flat from the surface to z, m^3
    "A_cone": "(pi * R**2 - A_flat) * sqrt(1 + tan(theta)**2)",  # of the mantle (25), m^2
    "V_cone": "(pi * R**2 * z - V_flat) * sqrt(1 + tan(theta)**2)",  # integral of A_cone, m^3
    "m_a": "C * phi * rho * mu * V_flat",  # (33): constant once the cone is complete, kg
    "m_a_slope": "C * phi * rho * mu * A_flat",  # dm_a/dz (32), greatest at the surface, kg/m
}
"""Parts of the cone's laws, by name."""


def _of_cone(part: str) -> Expression:
    names = ("z", "mu", "theta", "R", "C", "phi", "rho")
    return parse(part, dict(zip(names, names)), CONE)


CONE_RADIUS = _of_cone("r")
flat_area, cone_area = _of_cone("A_flat"), _of_cone("A_cone")
flat_volume, cone_volume = _of_cone("V_flat"), _of_cone("V_cone")
cone_mass, cone_mass_slope = _of_cone("m_a"), _of_cone("m_a_slope")

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
    "k1 / (pi * R**2) * V_flat + sigma_cone * V_cone",
    CONE,
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
    "b * m_a_slope * v**2",
    CONE,
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
    "m_a",
    CONE,
    grounds=SAND,
    goes_with=("depth_drag",),
)
