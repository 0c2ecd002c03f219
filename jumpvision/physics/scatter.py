"""Trial-to-trial scatter of the jump from a start that is not quite at rest (thesis Fig 27, text).

A robot that waits for the spring to come to rest still rings a little when the motor starts. The ringing is put in
through the motor: one cycle at f_0 of a tiny amplitude, then a pause of random length, then the law.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.physics.hard import hard_sweep, sine_rows
from jumpvision.physics.scales import natural_frequency

Array = NDArray[np.float64]


def ringing_rows(law: Array, ringing: ArrayLike, pause: ArrayLike, *, share: float, f0: float) -> Array:
    """A law of one row, (..., 1, 6), after a start-up ringing: (..., 3, 6).

    ringing: amplitude of the rod's ringing [m] without damping; pause > 0 [s] between its making and the law.
    share: m_m/M. From rest at resonance one cycle of amplitude a leaves the rod ringing with pi (m_m/M) a.
    """
    a, wait = np.asarray(ringing, float) / (np.pi * share), np.asarray(pause, float)
    shape = np.broadcast_shapes(law.shape[:-2], a.shape, wait.shape)
    a, wait = np.broadcast_to(a, shape), np.broadcast_to(wait, shape)
    out = np.zeros((*shape, 3, 6))
    w = 2.0 * np.pi * f0
    # phase pi/2: the cycle begins and ends with the motor at rest, X_m = a (cos - 1)
    for j, v in enumerate((0.0, 1.0 / f0, -a, a, w, 0.5 * np.pi)):
        out[..., 0, j] = v
    out[..., 1, 0], out[..., 1, 1] = 1.0 / f0, 1.0 / f0 + wait
    out[..., 2, :] = law[..., 0, :]
    out[..., 2, :2] += (1.0 / f0 + wait)[..., None]
    return out


def scattered(
    frequencies: ArrayLike,
    phases: ArrayLike,
    *,
    ringing: float,
    trials: int,
    rng: np.random.Generator,
    amplitude: float,
    cycles: float,
    motor_mass: float,
    rod_mass: float,
    stiffness: float,
    damping: float,
    gravity: float,
    landing_loss: float,
) -> dict[str, NDArray]:
    """hard_map's results, (nf, np, trials), of jumps that start from a ringing spring.

    ringing [m]: standard deviation of the rod's displacement, and of its velocity over w_0, at the start of the law.
    lift_off_s counts from the law's start; a spring that leaves the ground before it gives a negative one.
    """
    mass = motor_mass + rod_mass
    f0 = float(natural_frequency(stiffness, mass))
    f = np.asarray(frequencies, float)[:, None, None]
    ph = np.asarray(phases, float)[None, :, None]
    shape = (f.size, ph.size, trials)
    a = ringing * np.hypot(rng.standard_normal(shape), rng.standard_normal(shape))
    pause = (0.5 + rng.uniform(size=shape)) / f0
    laws = ringing_rows(sine_rows(f, amplitude, ph, cycles), a, pause, share=motor_mass / mass, f0=f0)
    out = hard_sweep(
        laws, motor_mass=motor_mass, rod_mass=rod_mass, stiffness=stiffness, damping=damping, gravity=gravity,
        landing_loss=landing_loss,
    )  # fmt: skip
    return out | {"lift_off_s": out["lift_off_s"] - laws[..., 2, 0]}
