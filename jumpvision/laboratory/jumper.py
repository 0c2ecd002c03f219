"""The laboratory's jumper: small fixed steps (RK4), with any set of the mechanisms that it can hide in a jump."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array

from .drive import AFTER, DRIVE, RATE, performed
from .jumper_kernel import _command, integrate


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
    every flight [s] (the last may be cut by the end). jump_height (docs/physics.md section 1) from `motor_stop` on.
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


def motion_of(
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

    law: the command, or None for a motor at rest. terms: mechanisms in force
    (MECHANISMS; those at the camera are ignored), with their `parameters` under the names of the contract (SI, rad).
    ground: "hard" or "granular" (needs a static force and a foot with mass). bed_density: phi rho [kg/m^3], for
    added_mass and depth_drag. dt [s]: the step; every: samples are kept each `every` steps. motor: the feedback loop
    that follows the law; None: the motor is where the law
    says. Raises ValueError for an impossible set.
    """
    q = truth_of(robot, terms, parameters, ground=ground, bed_density=bed_density)
    if law is None:
        law = Law(1.0, 0.0, 0.0, 0.0, 0.0)
    command = _commanded(law)
    if faults := {n: float(parameters[n]) for t in terms for n in DRIVE.get(t, ())}:
        if motor is not None:
            raise ValueError(f"{', '.join(t for t in terms if t in DRIVE)}: leave it out beside the motor's loop")
        when = np.arange(law.start, law.stop + AFTER, 1.0 / RATE)
        asked = np.array([_command(x, math.sin(command[2]), command)[0] for x in when])
        command = _commanded(Samples(performed(asked, faults), RATE, law.start))
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


def _commanded(law: Law | Samples) -> tuple[Any, ...]:
    """A law as the kernel needs it."""
    if isinstance(law, Samples):
        return 0.0, 0.0, 0.0, law.start, law.stop, 0.0, law.stop, 1.0, np.array(law.position, float), law.rate
    half = law.start + (0.5 / law.frequency if law.delay > 0 else law.cycles / law.frequency)
    w, none = 2 * math.pi * law.frequency, np.empty(0)
    return law.amplitude, w, law.phase, law.start, half, law.delay, law.stop, law.dwell_gain, none, 0.0


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


# mechanism (docs/physics.md section 6) -> the parameters it needs
MECHANISMS: dict[str, tuple[str, ...]] = {
    "linear_penetration": ("k",),
    "two_resistance": ("k1", "k2", "delta"),
    "rft_cone": ("k1", "sigma_cone", "mu", "theta"),
    "inertial_drag": ("alpha",),
    "depth_drag": ("b", "C", "mu", "theta"),
    "added_mass": ("C", "mu", "theta"),
    "foot_mass": ("dm_f",),
    "reintrusion_overshoot": ("s", "lam"),
    "stop_go_overshoot": ("s_p", "lam"),
    "compaction": ("factor",),
    "viscous_friction": ("c_v",),
    "coulomb_friction": ("F_c",),
    "spring_hardening": ("k_3",),
    "spring_damping": ("dc",),
    "spring_stiffness": ("dk",),
    "payload": ("dm",),
    "tilt": ("dg",),
    "landing_loss": ("e",),
    "motor_lag": ("tau",),
    **DRIVE,
}
# what no vocabulary of causes holds, for the hidden-effect game: it must not be named as something else
OUTSIDE: dict[str, tuple[str, ...]] = {
    "rail_drag_by_height": ("c_x",),  # -c_x |x_r| v_m on the carriage [N s/m^2]
    "depth_rate_drag": ("d_zv",),  # d_zv z |v| against the foot's motion while it intrudes [N s/m^2]
}
KNOWN = MECHANISMS | OUTSIDE
UNLOGGED = {"motor_lag", *DRIVE}  # between the command and the carriage, whose motion a motor log has
MAY_BE = {"carry": "stop_go_overshoot"}  # 0 where it is not given
AT_THE_CAMERA = ("camera_scale", "time_offset")  # they change the record, not the motion
STATIC = ("linear_penetration", "two_resistance", "rft_cone")


class Robot(NamedTuple):
    """kg, N/m, N s/m, m, m/s^2; foot_mass 0 on hard ground is the robot of thesis chapter II."""

    motor_mass: float
    rod_mass: float
    foot_mass: float
    spring_stiffness: float
    spring_damping: float
    foot_radius: float
    gravity: float


class Law(NamedTuple):
    """X_m = A [sin(2 pi f u + phase) - sin(phase)], u [s] from `start` on, held for `delay` at half a cycle."""

    frequency: float
    amplitude: float
    phase: float
    start: float
    cycles: float = 1.0
    delay: float = 0.0
    dwell_gain: float = 1.0  # position gain during the delay / normal gain, where the motor has a feedback loop

    @property
    def stop(self) -> float:
        return self.start + self.cycles / self.frequency + self.delay


class Samples(NamedTuple):
    """A command as a controller plays it: X_m in equal steps of 1/rate from `start` on, straight lines between."""

    position: NDArray[np.float64]  # m, from 0
    rate: float  # 1/s
    start: float

    @property
    def stop(self) -> float:
        return self.start + (len(self.position) - 1) / self.rate


class Motor(NamedTuple):
    """Feedback loop F_m = kp (command - X_m) + kd (command' - X_m') + m_m g and its limits: N/m, N s/m, N, m/s, m.

    The load that rests on the motor is fed forward, so that it starts without sag. stroke: travel of X_m.
    """

    kp: float
    kd: float
    max_force: float = math.inf
    max_speed: float = math.inf
    stroke: float = math.inf


class Truth(NamedTuple):
    """All numbers of one run as the kernel needs them; an absent mechanism has the value that switches it off."""

    m_m: float
    M: float
    m_f: float
    k: float
    k_3: float
    c: float
    g: float
    R: float
    k1: float
    k2: float
    delta: float
    sigma_cone: float
    alpha: float
    b: float
    inertia: float  # C phi rho with added_mass, else 0
    drag_inertia: float  # C phi rho with depth_drag, else 0
    mu: float
    tan_theta: float
    s: float
    s_p: float
    carry: float
    lam: float
    c_v: float
    F_c: float
    loss: float  # sqrt(1 - e)
    tau: float
    factor: float  # k1 under an earlier footprint / k1
    c_x: float
    d_zv: float
    hard: bool
    rft: bool


def truth_of(
    robot: Robot, terms: Sequence[str], parameters: Mapping[str, float], *, ground: str, bed_density: float = 0.0
) -> Truth:
    """The numbers of a run (see `motion_of`), checked."""
    problems = [
        f"terms: unknown mechanism {t!r}; allowed: {', '.join((*KNOWN, *AT_THE_CAMERA))}"
        for t in terms
        if t not in KNOWN and t not in AT_THE_CAMERA
    ]
    need = {name: t for t in terms for name in KNOWN.get(t, ())}
    problems += [f"parameters: {t!r} needs {name} = ..." for name, t in need.items() if name not in parameters]
    static = [t for t in terms if t in STATIC]
    if ground not in ("hard", "granular"):
        problems.append(f"ground = {ground!r}: must be 'hard' or 'granular'")
    if ground == "granular" and len(static) != 1:
        problems.append(f"terms: granular ground needs exactly one of {', '.join(STATIC)}, not {static}")
    if problems:
        raise ValueError("; ".join(problems))

    may = [name for name, t in MAY_BE.items() if t in terms and name in parameters]
    p: dict[str, float] = {name: float(parameters[name]) for name in (*need, *may)}
    if "linear_penetration" in terms:
        p |= {"k1": p["k"], "k2": 0.0, "delta": math.inf}
    m_m = robot.motor_mass + p.get("dm", 0.0)
    m_f = robot.foot_mass + p.get("dm_f", 0.0)
    inertia = p.get("C", 0.0) * bed_density
    q = Truth._make(p.get(name, 0.0) for name in Truth._fields)._replace(
        m_m=m_m,
        M=m_m + robot.rod_mass,
        m_f=m_f,
        k=robot.spring_stiffness + p.get("dk", 0.0),
        c=robot.spring_damping + p.get("dc", 0.0),
        g=robot.gravity + p.get("dg", 0.0),
        R=robot.foot_radius,
        inertia=inertia if "added_mass" in terms else 0.0,
        drag_inertia=inertia if "depth_drag" in terms else 0.0,
        tan_theta=math.tan(p.get("theta", 1.0)),
        loss=math.sqrt(1.0 - p.get("e", 0.0)),
        lam=p.get("lam", 1.0),
        factor=p.get("factor", 1.0),
        hard=ground == "hard",
        rft="rft_cone" in terms,
    )
    if ground == "granular" and m_f <= 0:
        raise ValueError(f"foot_mass = {m_f}: granular ground needs a foot with mass > 0 kg")
    if (q.inertia or q.drag_inertia) and not bed_density > 0:
        raise ValueError(f"bed_density = {bed_density}: added_mass and depth_drag need phi rho > 0 kg/m^3")
    steepest = q.mu * math.pi * q.R**2  # dm_a/dz per C phi rho, at the surface
    if q.alpha + (q.b * q.drag_inertia - 0.5 * q.inertia) * steepest < 0:
        raise ValueError(f"b = {q.b}, alpha = {q.alpha}: alpha + (b - 1/2) dm_a/dz < 0 would create energy")
    return q
