"""Forces and powers of a jump without rail friction along its motion (PHYSICS.md section 1, thesis Figs 29-31, 33)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jumpvision.physics.forcing import Forcing, Segments
from jumpvision.physics.hard import HardMotion
from jumpvision.physics.jump import Motion

Array = NDArray[np.float64]


def acceleration(law: Forcing, t: Array) -> Array:
    """X_m'' [m/s^2] at the times t (n,) [s], without the impulses of velocity steps; 0 outside the law."""
    inside = (t >= law.start) & (t < law.stop)
    if isinstance(law, Segments):
        row = np.clip(np.searchsorted(law.rows[:, 0], t, side="right") - 1, 0, len(law.rows) - 1)
        t0, _, _, amp, w, phase = law.rows[row].T
        return np.where(inside, -amp * w * w * np.sin(w * (t - t0) + phase), 0.0)
    piece = np.clip(np.searchsorted(law.knots, t, side="right") - 1, 0, law.c.shape[1] - 1)
    return np.where(inside, 6.0 * law.c[0, piece] * (t - law.knots[piece]) + 2.0 * law.c[1, piece], 0.0)


def powers(
    motion: HardMotion | Motion, law: Forcing, *, motor_mass: float, rod_mass: float, gravity: float
) -> dict[str, Array]:
    """Velocities [m/s], forces [N] and powers [W] at motion.t, each (n,); x up.

    motor_force F_m = m_m (a_m + g). internal F_m X_m' (deformation), external F_ext v_com with F_ext = F_s - M g,
    absolute F_m v_m. The impulses of velocity steps are not in them: motion.impulse_work_J.
    """
    mass = motor_mass + rod_mass
    rate, accel = law(motion.t)[1], acceleration(law, motion.t)
    share = motor_mass / mass
    v_com, v_motor = motion.rod_velocity + share * rate, motion.rod_velocity + rate
    # a_r = F_s/M - g - (m_m/M) X_m''
    force = motor_mass * (motion.spring_force / mass + (1.0 - share) * accel)
    external = motion.spring_force - mass * gravity
    return {
        "motor_velocity": v_motor,
        "relative_velocity": rate,
        "com_velocity": v_com,
        "motor_force": force,
        "external_force": external,
        "internal_power": force * rate,
        "external_power": external * v_com,
        "absolute_power": force * v_motor,
    }
