"""What the laboratory can hide in a jump: the mechanisms of PHYSICS section 4, with the robot and the law; SI units."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

# mechanism (PHYSICS section 4) -> the parameters it needs
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
}
# what no vocabulary of causes holds, for the hidden-effect game: it must not be named as something else
OUTSIDE: dict[str, tuple[str, ...]] = {
    "rail_drag_by_height": ("c_x",),  # -c_x |x_r| v_m on the carriage [N s/m^2]
    "depth_rate_drag": ("d_zv",),  # d_zv z |v| against the foot's motion while it intrudes [N s/m^2]
}
KNOWN = MECHANISMS | OUTSIDE
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
    """The numbers of a run (see `simulate`), checked."""
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

    p: dict[str, float] = {name: float(parameters[name]) for name in need}
    if "linear_penetration" in terms:
        p |= {"k1": p["k"], "k2": 0.0, "delta": math.inf}
    m_m = robot.motor_mass + p.get("dm", 0.0)
    m_f = robot.foot_mass + p.get("dm_f", 0.0)
    inertia = p.get("C", 0.0) * bed_density
    values: dict[str, Any] = {
        "m_m": m_m,
        "M": m_m + robot.rod_mass,
        "m_f": m_f,
        "k": robot.spring_stiffness + p.get("dk", 0.0),
        "c": robot.spring_damping + p.get("dc", 0.0),
        "g": robot.gravity + p.get("dg", 0.0),
        "R": robot.foot_radius,
        "inertia": inertia if "added_mass" in terms else 0.0,
        "drag_inertia": inertia if "depth_drag" in terms else 0.0,
        "tan_theta": math.tan(p.get("theta", 1.0)),
        "loss": math.sqrt(1.0 - p.get("e", 0.0)),
        "lam": p.get("lam", 1.0),
        "factor": p.get("factor", 1.0),
        "hard": ground == "hard",
        "rft": "rft_cone" in terms,
    }
    others = (
        "k_3",
        "k1",
        "k2",
        "delta",
        "sigma_cone",
        "alpha",
        "b",
        "mu",
        "s",
        "s_p",
        "c_v",
        "F_c",
        "tau",
        "c_x",
        "d_zv",
    )
    values |= {name: p.get(name, 0.0) for name in others}
    q = Truth(**values)
    if ground == "granular" and m_f <= 0:
        raise ValueError(f"foot_mass = {m_f}: granular ground needs a foot with mass > 0 kg")
    if (q.inertia or q.drag_inertia) and not bed_density > 0:
        raise ValueError(f"bed_density = {bed_density}: added_mass and depth_drag need phi rho > 0 kg/m^3")
    steepest = q.mu * math.pi * q.R**2  # dm_a/dz per C phi rho, at the surface
    if q.alpha + (q.b * q.drag_inertia - 0.5 * q.inertia) * steepest < 0:
        raise ValueError(f"b = {q.b}, alpha = {q.alpha}: alpha + (b - 1/2) dm_a/dz < 0 would create energy")
    return q
