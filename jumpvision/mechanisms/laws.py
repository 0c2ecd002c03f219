"""Every force law of the jumper, written once: a plain function of its symbols (docs/physics.md sections 1 and 3).

The first argument `xp` is the array namespace; the others are symbols: measured quantities (STATE) or model
parameters (`parameters.ModelParameters`). Each law returns a force [N], positive up, of the shape of its arrays. Laws
of the ground act on the foot while it intrudes (v < 0, z >= 0); the caller says when that is. The same functions run
on measured tracks (numpy) and inside the compiled integrator.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from numba.extending import register_jitable

from .cone import cone_mass, cone_mass_slope, cone_volume, flat_volume

STATE: dict[str, tuple[str, str]] = {
    "z": ("m", "depth of the foot below the undisturbed surface, -x_f"),
    "v": ("m/s", "velocity of the foot, positive up"),
    "a": ("m/s^2", "acceleration of the foot, positive up"),
    "z_g": ("m", "depth of the hole at the last lift-off, 0 before the first"),
    "z_stop": ("m", "depth of the last pause of the intrusion, 0 before the first"),
    "v_m": ("m/s", "velocity of the carriage, v_r + X_m'"),
    "stretch": ("m", "extension of the spring, x_r - x_f"),
    "stretch_rate": ("m/s", "rate of extension of the spring, v_r - v_f"),
    "R": ("m", "radius of the foot"),
    "phi": ("", "volume fraction of the bed"),
    "rho": ("kg/m^3", "density of a grain"),
}
"""Symbol -> (unit, meaning) of what is not a model parameter."""


@register_jitable
def linear_penetration(xp: Any, z: Any, k: float) -> Any:
    """k z (15)."""
    return k * z


@register_jitable
def two_resistance(xp: Any, z: Any, k1: float, k2: float, delta: float) -> Any:
    """k1 z to the depth delta, k2 per metre below it."""
    return k1 * xp.minimum(z, delta) + k2 * xp.maximum(z - delta, 0.0)


@register_jitable
def rft_cone(xp: Any, z: Any, k1: float, sigma_cone: float, mu: float, theta: float, R: float) -> Any:
    """(k1 / pi R^2) int A_flat dz + sigma_z(30 deg, 90 deg) int A_cone dz: resistive force theory (26)-(28)."""
    flat = k1 * flat_volume(xp, z, mu, theta, R) / (math.pi * R * R)
    return flat + sigma_cone * cone_volume(xp, z, mu, theta, R)


@register_jitable
def inertial_drag(xp: Any, v: Any, alpha: float) -> Any:
    """alpha v^2 (15), momentum given to displaced grains."""
    return alpha * v * v


@register_jitable
def depth_drag(
    xp: Any, z: Any, v: Any, b: float, C: float, mu: float, theta: float, R: float, phi: float, rho: float
) -> Any:
    """b (dm_a/dz) v^2 (34)."""
    return b * cone_mass_slope(xp, z, C, mu, theta, R, phi, rho) * v * v


@register_jitable
def added_mass(xp: Any, z: Any, a: Any, C: float, mu: float, theta: float, R: float, phi: float, rho: float) -> Any:
    """-m_a(z) a (34), inertia of the jammed cone."""
    return -cone_mass(xp, z, C, mu, theta, R, phi, rho) * a


@register_jitable
def reintrusion_overshoot(xp: Any, z: Any, z_g: Any, s: float, lam: float) -> Any:
    """s z_g exp(-(z - z_g) / lambda) for z >= z_g after a lift-off at z_g."""
    return s * z_g * xp.exp(-(z - z_g) / lam)


@register_jitable
def stop_go_overshoot(xp: Any, z: Any, z_stop: Any, s_p: float, lam: float) -> Any:
    """s_p z_stop exp(-(z - z_stop) / lambda) after a pause at z_stop without lift-off: the law of a re-intrusion."""
    return reintrusion_overshoot(xp, z, z_stop, s_p, lam)


@register_jitable
def viscous_friction(xp: Any, v_m: Any, c_v: float) -> Any:
    """-c_v v_m, on the carriage."""
    return -c_v * v_m


@register_jitable
def coulomb_friction(xp: Any, v_m: Any, F_c: float) -> Any:
    """-F_c sign(v_m), on the carriage; at v_m = 0 the rail holds any force up to F_c (0 is returned)."""
    return F_c * (xp.where(v_m < 0.0, 1.0, 0.0) - xp.where(v_m > 0.0, 1.0, 0.0))


@register_jitable
def spring_hardening(xp: Any, stretch: Any, k_3: float) -> Any:
    """-k_3 stretch^3, on the rod."""
    return -k_3 * stretch * stretch * stretch


@register_jitable
def spring(stretch: Any, stretch_rate: Any, k_s: float, c_s: float) -> Any:
    """-k_s stretch - c_s stretch', on the rod (always there: not a named mechanism)."""
    return -k_s * stretch - c_s * stretch_rate


TERMS: dict[str, Callable[..., Any]] = {
    law.__name__: law
    for law in (
        linear_penetration,
        two_resistance,
        rft_cone,
        inertial_drag,
        depth_drag,
        added_mass,
        reintrusion_overshoot,
        stop_go_overshoot,
        viscous_friction,
        coulomb_friction,
        spring_hardening,
    )
}
"""Mechanism id -> its force law. Mechanisms without a law change the robot, the bed or what is observed."""

STATIC = ("linear_penetration", "two_resistance", "rft_cone")
"""The static forces F_p: exactly one of them on granular ground."""
