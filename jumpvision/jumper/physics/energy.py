"""Powers of a jump along its motion, and where the motor's work goes: a ledger integrated along with the motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.jumper.mechanisms.record import Body, Mechanism
from jumpvision.jumper.physics.hard.jump import HardMotion
from jumpvision.jumper.physics.sand.granular import DAMPED, IMPULSE, INTRUDE, LOST, MOTOR_WORK, VF, XF, V, W, X, Y
from jumpvision.jumper.physics.sand.jump import Motion, follow, laws
from jumpvision.jumper.physics.sand.laws import elastic

from .drive import played
from .forcing import Forcing, Loop, Segments
from .model import Model


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


@dataclass(frozen=True)
class Ledger:
    """Energies [J] from rest to the end: motor + impulse = kinetic + potential + spring + the sum of losses.

    motor: int F_m X_m' dt, impulse: that of the velocity steps of the law and
    of the ends of a loop's travel; kinetic (the cone's included), potential
    and spring: what the jumper holds more at the end; losses: by the mechanism that took them, with `spring_damping`
    for all of c and `landing` for the momentum shared at touchdown. `added_mass` is negative: -1/2 int (dm_a/dz)
    |v|^3 dt, grains that join the cone, to be read with the drag that accelerates them.
    """

    motor: float
    impulse: float
    kinetic: float
    potential: float
    spring: float
    losses: dict[str, float]

    @property
    def residual(self) -> float:
        """What the ledger misses [J]."""
        held = self.kinetic + self.potential + self.spring
        return self.motor + self.impulse - held - sum(self.losses.values())

    @property
    def turnover(self) -> float:
        """Sum of all entries without sign [J]: the scale of the residual."""
        held = (self.motor, self.impulse, self.kinetic, self.potential, self.spring)
        return float(sum(map(abs, (*held, *self.losses.values()))))


def energy_ledger(
    model: Model, forcing: Forcing | Loop, *, end: float, rtol: float = 1e-9, atol: float = 1e-11
) -> Ledger:
    """The ledger of a jump from rest at forcing.start to `end` [s]; arguments and errors as in jump.simulate."""
    stop, forcing = forcing.stop, played(model, forcing)
    motion, s, rest = follow(model, forcing, np.array([forcing.start, end]), rtol, atol, stop, works=True)
    ratio = model.m_m / model.M
    position, rate = (float(x[0]) for x in forcing([end]))
    if isinstance(forcing, Loop):
        position, rate = s[X], s[V]
    elif motors := model.acting(Body.MOTOR):
        command, position = {"X_c": position, "V_c": rate}, float(motion.motor[-1] - motion.rod[-1])
        rate += sum(float(model.force(m, X=position, time_s=end, **command)) for m in motors)
    foot = model.m_f
    if motion.mode[-1] == INTRUDE:
        foot += sum(float(model.force(m, z=-s[XF], a=-1.0)) for m in model.acting(Body.INERTIA))
    elastic_laws = [m for m in model.acting(Body.SPRING) if elastic(m)]

    def spring(stretch: float) -> float:
        return 0.5 * model.k_s * stretch**2 + sum(stored(model, m, stretch) for m in elastic_laws)

    loose = model.m_f == 0.0 and motion.mode[-1] == 0  # a foot without mass hangs on the relaxed spring
    stretch = 0.0 if loose else s[Y] - ratio * position - s[XF]
    losses = dict(zip(laws(model).lost, map(float, s[LOST:])))
    return Ledger(
        motor=float(s[MOTOR_WORK]),
        impulse=float(s[IMPULSE]),
        kinetic=float(0.5 * model.M * s[W] ** 2 + 0.5 * ratio * model.rod_mass * rate**2 + 0.5 * foot * s[VF] ** 2),
        potential=float(model.g * (model.M * (s[Y] - rest[Y]) + model.m_f * (s[XF] - rest[XF]))),
        spring=float(spring(stretch) - spring(motion.rest - rest[XF])),
        losses={"spring_damping": float(s[DAMPED]), **losses, "landing": float(s[-1])},
    )


def stored(model: Model, m: Mechanism, stretch: float) -> float:
    """What a law of the spring that depends on its extension alone [m] has stored [J], by Gauss's rule."""
    at, weight = np.polynomial.legendre.leggauss(20)  # exact to a power of 39 of the extension
    force = model.force(m, stretch=0.5 * stretch * (at + 1.0))
    return float(-0.5 * stretch * np.sum(weight * force))
