"""The vocabulary of causes: every model parameter with unit, range and meaning, and the mechanisms that use them.

Keys of `[model]`: docs/keys.md; equations: docs/physics.md sections 1 and 3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from jumpvision.base.schema import param


@dataclass(frozen=True)
class ModelParameters:
    """Parameters of the mechanisms; None where a value is needed but has no default."""

    k: float | None = param(None, "N/m", "penetration resistance of the linear static force", lo=0, open_lo=True)
    k1: float | None = param(None, "N/m", "penetration resistance near the surface", lo=0, open_lo=True)
    k2: float | None = param(None, "N/m", "penetration resistance below delta", lo=0)
    delta: float | None = param(None, "m", "depth where k1 becomes k2", lo=0)
    sigma_cone: float | None = param(None, "N/m^3", "vertical stress per depth on the cone's mantle (RFT)", lo=0)
    alpha: float | None = param(None, "kg/m", "inertial drag coefficient", lo=0)
    b: float | None = param(None, "", "scale of the depth-dependent drag", lo=0)
    C: float | None = param(None, "", "scale of the added mass", lo=0)
    mu: float = param(2.2, "", "growth of the jammed front per depth", lo=0, open_lo=True)
    theta: float = param(math.pi / 3, "", "angle of the cone's mantle, rad", lo=0.01, hi=1.56)
    s: float | None = param(None, "N/m", "overshoot on re-intrusion per depth of the hole", lo=0)
    lam: float | None = param(None, "m", "length over which an overshoot decays (lambda)", lo=0, open_lo=True)
    s_p: float | None = param(None, "N/m", "overshoot after a pause per depth of the pause", lo=0)
    factor: float | None = param(None, "", "k1 under an earlier footprint / k1", lo=0, open_lo=True)
    c_v: float | None = param(None, "N s/m", "viscous friction of the rail", lo=0)
    F_c: float | None = param(None, "N", "Coulomb friction of the rail", lo=0)
    k_3: float | None = param(None, "N/m^3", "cubic hardening of the spring", lo=0)
    e: float | None = param(None, "", "share of the rod's kinetic energy lost at touchdown", lo=0, hi=1)
    tau: float | None = param(None, "s", "time constant of the motor's lag", lo=0, open_lo=True)
    dm: float | None = param(None, "kg", "extra mass on the motor body")
    dm_f: float | None = param(None, "kg", "extra mass of the foot")
    dg: float | None = param(None, "m/s^2", "extra gravity along the rail")
    dk: float | None = param(None, "N/m", "extra stiffness of the spring")
    dc: float | None = param(None, "N s/m", "extra damping of the spring")
    scale: float | None = param(None, "", "reported height / true height", lo=0, open_lo=True)
    dt: float | None = param(None, "s", "a frame stamped t shows t + dt")


@dataclass(frozen=True)
class Mechanism:
    """What a mechanism adds, its parameters (ModelParameters fields) and the grounds where it applies."""

    meaning: str
    parameters: tuple[str, ...]
    grounds: tuple[str, ...] = ("hard", "granular")


_SAND = ("granular",)
_CONE = ("C", "mu", "theta")

MECHANISMS: dict[str, Mechanism] = {
    "linear_penetration": Mechanism("static force k z", ("k",), _SAND),
    "two_resistance": Mechanism("static force with a bend at delta", ("k1", "k2", "delta"), _SAND),
    "rft_cone": Mechanism("static force of a growing cone by RFT", ("k1", "sigma_cone", "mu", "theta"), _SAND),
    "inertial_drag": Mechanism("drag alpha v^2, constant alpha", ("alpha",), _SAND),
    "depth_drag": Mechanism("drag b (dm_a/dz) v^2", ("b", *_CONE), _SAND),
    "added_mass": Mechanism("inertia m_a(z) a of the jammed cone", _CONE, _SAND),
    "foot_mass": Mechanism("foot heavier than assumed", ("dm_f",)),
    "reintrusion_overshoot": Mechanism("extra force on landing in an existing hole", ("s", "lam"), _SAND),
    "stop_go_overshoot": Mechanism("extra force after a pause while intruding", ("s_p", "lam"), _SAND),
    "compaction": Mechanism("k1 (or k) raised under an earlier footprint", ("factor",), _SAND),
    "viscous_friction": Mechanism("viscous friction of the rail on the carriage", ("c_v",)),
    "coulomb_friction": Mechanism("Coulomb friction of the rail on the carriage", ("F_c",)),
    "spring_hardening": Mechanism("cubic stiffening of the spring", ("k_3",)),
    "spring_damping": Mechanism("damping of the spring other than assumed", ("dc",)),
    "spring_stiffness": Mechanism("stiffness of the spring other than assumed", ("dk",)),
    "payload": Mechanism("extra mass on the motor body", ("dm",)),
    "tilt": Mechanism("gravity along the rail other than assumed", ("dg",)),
    "landing_loss": Mechanism("loss at touchdown, v_r -> sqrt(1 - e) v_r", ("e",), ("hard",)),
    "motor_lag": Mechanism("motor follows its command with a lag, tau X' + X = command", ("tau",)),
    "camera_scale": Mechanism("reported height is not the true height", ("scale",)),
    "time_offset": Mechanism("a frame stamped t shows t + dt", ("dt",)),
}
