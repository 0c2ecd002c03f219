"""The laboratory's jumper: PHYSICS section 1 integrated by small fixed steps (RK4), with any set of mechanisms.

Nothing here is shared with `jumpvision.physics`: films and logs made from this motion test the analysis without its own
solver on both sides. SI units, x up. x_r rod, x_f foot, X_m motor relative to the rod; depth z = -x_f.
Integrated is y = x_r + (m_m/M) X_m, whose acceleration needs no X_m'': velocity steps of the law are then the right
impulses on the rod without being put in by hand.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .jumper_kernel import integrate
from .mechanisms import Law, Motor, Robot, Samples, truth_of

Array = NDArray[np.float64]


class Loop(NamedTuple):
    """Motor with its travel as X_m [m] from low to high; kp = 0: no loop, the motor follows its law."""

    kp: float
    kd: float
    max_force: float
    max_speed: float
    low: float
    high: float


MIN_FLIGHT = 0.03  # s: shorter flights are the ring-down, not jumps
FIELDS = ("rod", "rod_rate", "foot", "foot_rate", "motor", "motor_rate", "motor_force", "ground_force", "added_mass")


@dataclass(frozen=True)
class Motion:
    """A simulated jump at the times t, shape (n,) [s], on the clock of the law.

    Arrays (n,): rod x_r, foot x_f, motor X_m [m] and their rates [m/s]; motor_force F_m, ground_force F_GM on the foot
    [N]; added_mass [kg]; contact (bool). rest: rod height before the start [m]. lift_offs, flights: start and length of
    every flight [s] (the last may be cut by the end). jump_height as PHYSICS names it, from `motor_stop` on.
    """

    t: Array
    rod: Array
    rod_rate: Array
    foot: Array
    foot_rate: Array
    motor: Array
    motor_rate: Array
    motor_force: Array
    ground_force: Array
    added_mass: Array
    contact: NDArray[np.bool_]
    lift_offs: Array
    flights: Array
    motor_stop: float

    @property
    def rest(self) -> float:
        return float(self.rod[0])

    @property
    def jump_height(self) -> float:
        return float(self.rod[self.t >= self.motor_stop].max() - self.rest)

    @property
    def n_jumps(self) -> int:
        """Flights of at least MIN_FLIGHT."""
        return int(np.sum(self.flights >= MIN_FLIGHT))

    def at(self, name: str, t: Array) -> Array:
        """The array `name` at other times t [s], any shape: linear between samples, held beyond the ends."""
        out = np.interp(np.asarray(t, dtype=float).ravel(), self.t, getattr(self, name))
        return np.asarray(out.reshape(np.shape(t)), dtype=np.float64)


def simulate(
    robot: Robot,
    law: Law | Samples | None,
    terms: Sequence[str],
    parameters: Mapping[str, float],
    *,
    ground: str,
    duration: float,
    bed_density: float = 0.0,
    dt: float = 2e-6,
    every: int = 50,
    motor: Motor | None = None,
) -> Motion:
    """The jump from settled rest at t = 0 to `duration` [s].

    law: the command (Samples need the feedback loop), or None for a motor at rest. terms: mechanisms in force
    (MECHANISMS; those at the camera are ignored), with their `parameters` under the names of the contract (SI, rad).
    ground: "hard" or "granular" (needs a static force and a foot with mass). bed_density: phi rho [kg/m^3], for
    added_mass and depth_drag. dt [s]: the step; every: samples are kept each `every` steps. motor: the feedback loop
    that follows the law; None: the motor is where the law
    says. Raises ValueError for an impossible set.
    """
    q = truth_of(robot, terms, parameters, ground=ground, bed_density=bed_density)
    if law is None:
        law = Law(1.0, 0.0, 0.0, 0.0, 0.0)
    command: tuple[Any, ...]
    if isinstance(law, Samples):
        command = (0.0, 0.0, 0.0, law.start, law.stop, 0.0, law.stop, 1.0, np.asarray(law.position, float), law.rate)
    else:
        half = law.start + (0.5 / law.frequency if law.delay > 0 else law.cycles / law.frequency)
        command = (law.amplitude, 2 * math.pi * law.frequency, law.phase, law.start, half, law.delay, law.stop,
                   law.dwell_gain, np.empty(0), 0.0)  # fmt: skip
    loop = _loop(motor, law, q.tau)
    n = round(duration / (dt * every)) + 1
    out, contact, lift_offs, landings = integrate(q, command, loop, dt, every, n)
    t: Array = np.arange(n, dtype=np.float64) * (dt * every)
    ends = np.append(landings, t[-1])[: len(lift_offs)]
    return Motion(
        t=t,
        **dict(zip(FIELDS, out)),
        contact=contact,
        lift_offs=lift_offs,
        flights=ends - lift_offs,
        motor_stop=law.stop,
    )


def _loop(motor: Motor | None, law: Law | Samples, tau: float) -> Loop:
    """Gains and limits as the kernel needs them: the travel's ends lie evenly about the range of the law."""
    if motor is None:
        return Loop(0.0, 0.0, math.inf, math.inf, -math.inf, math.inf)
    if not (motor.kp > 0 and motor.kd >= 0 and min(motor.max_force, motor.max_speed, motor.stroke) > 0):
        raise ValueError(f"{motor}: needs kp > 0, kd >= 0 and limits > 0")
    if tau > 0:
        raise ValueError("motor_lag: leave it out where the motor's feedback loop is simulated")
    if math.isinf(motor.stroke):
        return Loop(*motor[:4], -math.inf, math.inf)
    if isinstance(law, Samples):
        X = law.position
    else:
        turn = 2 * math.pi * np.linspace(0.0, law.cycles, 1001)
        X = law.amplitude * (np.sin(turn + law.phase) - math.sin(law.phase))
    low = min(max(0.5 * float(X.max() + X.min() - motor.stroke), -motor.stroke), 0.0)
    return Loop(*motor[:4], low, low + motor.stroke)
