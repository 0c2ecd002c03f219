"""What acts on the robot, and what a film has wrong of it: rail, spring, values other than assumed, motor, camera."""

from __future__ import annotations

import math

from .record import Body, Mechanism, Parameter, Prior, Robot


def _impedance(m: Robot) -> float:
    """sqrt(k M) [N s/m], the size of a damping that matters."""
    return math.sqrt(m.k_s * m.M)


C_V = Parameter(
    "c_v",
    "N s/m",
    "viscous friction of the rail",
    lambda m: Prior(0.0, 0.0, _impedance(m), 0.02 * _impedance(m)),
    lo=0,
)
F_C = Parameter(
    "F_c", "N", "Coulomb friction of the rail", lambda m: Prior(0.0, 0.0, m.M * m.g, 0.05 * m.M * m.g), lo=0
)
K_3 = Parameter(
    "k_3", "N/m^3", "cubic hardening of the spring", lambda m: Prior(0.0, 0.0, 1e4 * m.k_s, 100.0 * m.k_s), lo=0
)
DC = Parameter(
    "dc", "N s/m", "extra damping of the spring", lambda m: Prior(0.0, -m.c_s, _impedance(m), 0.02 * _impedance(m))
)
DK = Parameter(
    "dk", "N/m", "extra stiffness of the spring", lambda m: Prior(0.0, -0.6 * m.k_s, 1.5 * m.k_s, 0.03 * m.k_s)
)
DM = Parameter("dm", "kg", "extra mass on the motor body", lambda m: Prior(0.0, -0.6 * m.m_m, 1.5 * m.m_m, 0.03 * m.M))
DM_F = Parameter("dm_f", "kg", "extra mass of the foot", lambda m: Prior(0.0, -0.95 * m.m_f, 0.5, 0.01))
DG = Parameter("dg", "m/s^2", "extra gravity along the rail", lambda m: Prior(0.0, -0.6 * m.g, 1.5 * m.g, 0.03 * m.g))
E = Parameter(
    "e", "", "share of the rod's kinetic energy lost at touchdown", lambda m: Prior(0.0, 0.0, 0.99, 0.1), lo=0, hi=1
)
TAU = Parameter(
    "tau", "s", "time constant of the motor's lag", lambda m: Prior(1e-7, 1e-7, 0.05, 2e-3), lo=0, open_lo=True
)
SCALE = Parameter(
    "scale", "", "reported height / true height", lambda m: Prior(1.0, 0.7, 1.4, 0.02), lo=0, open_lo=True
)
DT = Parameter("dt", "s", "a frame stamped t shows t + dt", lambda m: Prior(0.0, -0.05, 0.05, 2e-3))

FOOT_MASS = Mechanism(
    "foot_mass",
    Body.ROBOT,
    (DM_F,),
    "foot heavier than assumed",
    "the right mass of the foot",
    "the constant twin of the added mass",
    corrects="foot_mass",
    possible=lambda m: bool(m.m_f > 0.0),
)
VISCOUS_FRICTION = Mechanism(
    "viscous_friction",
    Body.CARRIAGE,
    (C_V,),
    "viscous friction of the rail on the carriage",
    "viscous friction on the rail",
    "docs/physics.md section 1",
    "c_v v_m",
    "-c_v * v_m",
)
COULOMB_FRICTION = Mechanism(
    "coulomb_friction",
    Body.RAIL,
    (F_C,),
    "Coulomb friction of the rail on the carriage",
    "dry friction on the rail",
    "docs/physics.md section 1",
    "F_c sign(v_m)",
    "-F_c * sign(v_m)",
)
SPRING_HARDENING = Mechanism(
    "spring_hardening",
    Body.SPRING,
    (K_3,),
    "cubic stiffening of the spring",
    "the stiffening of the spring",
    "docs/physics.md section 6",
    "k_3 stretch^3",
    "-k_3 * stretch**3",
)
SPRING_DAMPING = Mechanism(
    "spring_damping",
    Body.ROBOT,
    (DC,),
    "damping of the spring other than assumed",
    "the right damping of the spring",
    "docs/physics.md section 6",
    corrects="spring_damping",
)
SPRING_STIFFNESS = Mechanism(
    "spring_stiffness",
    Body.ROBOT,
    (DK,),
    "stiffness of the spring other than assumed",
    "the right stiffness of the spring",
    "docs/physics.md section 6",
    corrects="spring_stiffness",
)
PAYLOAD = Mechanism(
    "payload",
    Body.ROBOT,
    (DM,),
    "extra mass on the motor body",
    "the right mass on the motor",
    "docs/physics.md section 6",
    corrects="motor_mass",
)
TILT = Mechanism(
    "tilt",
    Body.ROBOT,
    (DG,),
    "gravity along the rail other than assumed",
    "the right gravity along the rail (a tilt)",
    "docs/physics.md section 6",
    corrects="gravity",
)
LANDING_LOSS = Mechanism(
    "landing_loss",
    Body.LANDING,
    (E,),
    "loss at touchdown, v_r -> sqrt(1 - e) v_r",
    "the loss at touchdown",
    "thesis section 2.4, restitution",
    grounds=("hard",),
)
MOTOR_LAG = Mechanism(
    "motor_lag",
    Body.MOTOR,
    (TAU,),
    "motor follows its command with a lag, tau X' + X = command",
    "the lag of the motor",
    "docs/physics.md section 6",
    law="(X_c - X) / tau - V_c",
    of_command=True,
)
CAMERA_SCALE = Mechanism(
    "camera_scale",
    Body.HEIGHT,
    (SCALE,),
    "reported height is not the true height",
    "the right scale of the camera",
    "docs/physics.md section 6",
    law="(scale - 1) * h",
)
TIME_OFFSET = Mechanism(
    "time_offset",
    Body.TIME,
    (DT,),
    "a frame stamped t shows t + dt",
    "the right clock of the camera",
    "docs/physics.md section 6",
    law="dt",
)
