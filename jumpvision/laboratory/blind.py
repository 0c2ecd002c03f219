"""Hidden effects: a campaign whose declared model lacks, or does not lack, something that is drawn at random.

`draw` a setting, `campaign` its tracks and motor logs as arrays. The nuisance is drawn too: noise, its correlation,
rounding, and declared values that are wrong within their stated uncertainty or may be fitted again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from jumpvision.base.arrays import Array

from . import recordings as logs
from .campaign import jump_of
from .jumper import OUTSIDE, STATIC, UNLOGGED, Robot
from .protocol import Jump, MotorLog, Protocol, Records, RodTrack, jumps_of
from .recordings import Errors

DT, EVERY = 1e-5, 50  # s: rod within 0.01 mm of dt = 1e-6, a fifth of the smallest noise (test_lab_blind.py)
EITHER = True  # of both signs


class Drawn(NamedTuple):
    """A parameter drawn log-uniformly between weak and strong."""

    weak: float
    strong: float
    either: bool = False


class Effect(NamedTuple):
    """What can be hidden: the grounds it acts on, the parameters that are drawn, those that are fixed."""

    grounds: tuple[str, ...]
    drawn: dict[str, Drawn]
    fixed: Mapping[str, float] = {}


_BOTH, _SAND, _HARD = ("hard", "granular"), ("granular",), ("hard",)
_CONE = {"mu": 2.0, "theta": math.pi / 3}
EFFECTS = {
    "two_resistance": Effect(_SAND, {"k1": Drawn(2300.0, 3600.0)}, {"k2": 2000.0, "delta": 0.012}),
    "rft_cone": Effect(_SAND, {"sigma_cone": Drawn(4e4, 4e5)}, _CONE),
    "inertial_drag": Effect(_SAND, {"alpha": Drawn(0.8, 100.0)}),
    "depth_drag": Effect(_SAND, {"b": Drawn(0.4, 25.0)}, _CONE | {"C": 2.7}),
    "added_mass": Effect(_SAND, {"C": Drawn(0.08, 3.5)}, _CONE),
    "foot_mass": Effect(_SAND, {"dm_f": Drawn(0.0008, 0.04)}),
    "reintrusion_overshoot": Effect(_SAND, {"s": Drawn(30.0, 4000.0)}, {"lam": 0.005}),
    "stop_go_overshoot": Effect(_SAND, {"s_p": Drawn(20.0, 2000.0)}, {"lam": 0.005}),
    "compaction": Effect(_SAND, {"factor": Drawn(1.006, 1.6)}),
    "viscous_friction": Effect(_BOTH, {"c_v": Drawn(0.01, 2.0)}),
    "coulomb_friction": Effect(_BOTH, {"F_c": Drawn(0.006, 1.0)}),
    "spring_hardening": Effect(_BOTH, {"k_3": Drawn(3e4, 8e6)}),
    "spring_damping": Effect(_BOTH, {"dc": Drawn(0.03, 4.0)}),
    "spring_stiffness": Effect(_BOTH, {"dk": Drawn(8.0, 400.0, EITHER)}),
    "payload": Effect(_BOTH, {"dm": Drawn(0.002, 0.15, EITHER)}),
    "tilt": Effect(_BOTH, {"dg": Drawn(0.008, 0.4, EITHER)}),
    "landing_loss": Effect(_HARD, {"e": Drawn(0.004, 0.5)}),
    "motor_lag": Effect(_BOTH, {"tau": Drawn(0.0003, 0.008)}),
    "loop_bandwidth": Effect(_BOTH, {"t_n": Drawn(0.0005, 0.005)}, {"zeta": 0.6}),
    "speed_limit": Effect(_HARD, {"top_speed": Drawn(0.42, 0.15)}),
    "stroke_limit": Effect(_HARD, {"reach": Drawn(0.0078, 0.005)}),
    "drive_play": Effect(_BOTH, {"play": Drawn(3e-5, 1e-3)}, {"flank": 0.0}),
    "camera_scale": Effect(_BOTH, {"scale": Drawn(0.0015, 0.06, EITHER)}),  # about 1
    "time_offset": Effect(_BOTH, {"dt": Drawn(0.0003, 0.01, EITHER)}),
    "rail_drag_by_height": Effect(_BOTH, {"c_x": Drawn(0.6, 60.0)}),
    "depth_rate_drag": Effect(_SAND, {"d_zv": Drawn(50.0, 3000.0)}),
}
ROBOTS = {
    "granular": Robot(1.125, 0.175, 0.04, 3300.0, 1.2, 0.0381, 9.81),
    "hard": Robot(1.003, 0.175, 0.0, 5760.6, 1.368, 0.0381, 2.70756),
}
Sweeps = tuple[tuple[str, tuple[float, ...], float], ...]  # kind, frequencies [Hz], delay [s]
REPEATED: dict[str, Sweeps] = {  # 12 conditions
    "granular": (
        ("single", (4.5, 5.5, 6.5, 7.5, 8.5, 10.0), 0.0),
        ("stutter", (4.5, 5.0, 5.5, 6.0), 0.0),
        ("delayed_stutter", (6.0, 7.0), 0.1),
    ),
    "hard": (("single", (9.0, 11.0, 13.0, 15.0, 17.0, 19.0), 0.0), ("stutter", (6.5, 7.5, 8.0, 8.5, 9.5, 11.0), 0.0)),
}
ONCE: dict[str, Sweeps] = {  # 24 conditions over the same ranges
    "granular": (
        ("single", (4.5, 5.0, 5.5, 6.0, 6.5, 7.0, 7.5, 8.0, 8.5, 9.0, 9.5, 10.0), 0.0),
        ("stutter", (4.5, 4.7, 4.9, 5.1, 5.3, 5.5, 5.75, 6.0), 0.0),
        ("delayed_stutter", (6.0, 6.35, 6.65, 7.0), 0.1),
    ),
    "hard": (
        ("single", (9.0, 9.9, 10.8, 11.7, 12.6, 13.5, 14.5, 15.4, 16.3, 17.2, 18.1, 19.0), 0.0),
        ("stutter", (6.5, 7.0, 7.25, 7.5, 7.75, 8.0, 8.25, 8.5, 9.0, 9.5, 10.25, 11.0), 0.0),
    ),
}
FEW: dict[tuple[str, bool], Sweeps] = {  # 4 jumps: 4 conditions, or (True) 2 that are repeated
    ("granular", False): (("single", (5.5, 8.5), 0.0), ("stutter", (5.0,), 0.0), ("delayed_stutter", (6.0,), 0.1)),
    ("granular", True): (("single", (6.5,), 0.0), ("stutter", (5.0,), 0.0)),
    ("hard", False): (("single", (11.0, 17.0), 0.0), ("stutter", (7.5, 9.5), 0.0)),
    ("hard", True): (("single", (13.0,), 0.0), ("stutter", (8.0,), 0.0)),
}
AMPLITUDE = {"granular": 0.01875, "hard": 0.004}


@dataclass(frozen=True)
class Nuisance:
    """Errors of the tracks, as RodTrack has them; noise [m], rho, step [m]: None to draw them."""

    noise: float | None = None
    rho: float | None = None
    step: float | None = None
    family: str = "white"
    drift: float = 0.0
    ratio: float = 1.0
    stated: bool = True

    def drawn(self, rng: np.random.Generator) -> RodTrack:
        """With what is left open: 0.05 to 0.5 mm of noise, rho of 0 to 0.7, rounding to 0 to 0.1 mm."""
        noise = float(np.exp(rng.uniform(math.log(5e-5), math.log(5e-4)))) if self.noise is None else self.noise
        rho = float(rng.choice([0.0, rng.uniform(0.0, 0.7)])) if self.rho is None else self.rho
        step = float(rng.choice([0.0, 5e-5, 1e-4])) if self.step is None else self.step
        return RodTrack(**asdict(replace(self, noise=noise, rho=rho, step=step)))


@dataclass(frozen=True)
class Setting:
    """A campaign with what it hides. hidden: mechanisms, none for an adequate model; parameters: their true values;
    strength: 0 weak .. 1 strong, of each. protocol.model is the declared model."""

    hidden: tuple[str, ...]
    parameters: dict[str, float]
    strength: tuple[float, ...]
    protocol: Protocol

    @property
    def outside(self) -> bool:
        """Whether nothing in the vocabulary is the right answer."""
        return any(h in OUTSIDE for h in self.hidden)

    @property
    def nuisance(self) -> RodTrack:
        """The errors of the tracks."""
        assert self.protocol.records.rod_track is not None
        return self.protocol.records.rod_track


@dataclass(frozen=True)
class Recorded:
    """One experiment as arrays; track: time_s, height_m and, where stated, sigma_m; motor: time_s, position_m, force_N,
    or None where only the command is known. Truth: error of the track [m], and its standard deviation sigma [m],
    rounding included, wander and outliers not."""

    jump: Jump
    volume_fraction: float
    track: dict[str, Array]
    motor: dict[str, Array] | None
    error: Errors
    sigma: float


def choices(ground: str, *, outside: bool = False) -> list[str]:
    """The effects that can be hidden on a ground."""
    return [h for h, effect in EFFECTS.items() if ground in effect.grounds and (h in OUTSIDE) == outside]


def draw(
    rng: np.random.Generator,
    *,
    ground: str = "granular",
    hidden: Sequence[str] | None = None,
    strength: float | None = None,
    nuisance: Nuisance = Nuisance(),
    trials: int = 1,
    jumps: str = "full",
) -> Setting:
    """A setting at random. hidden: the effects, () for none; by default none (15 %), one (55 %), two (20 %) or one
    outside the vocabulary (10 %). strength: 0 weak .. 1 strong. trials, jumps: see `sweeps`. Raises ValueError for
    effects that cannot act here or together."""
    for _ in range(1000):
        effects = tuple(hidden) if hidden is not None else _pick(ground, rng)
        allowed = choices(ground) + choices(ground, outside=True)
        if bad := [h for h in effects if h not in allowed]:
            raise ValueError(f"hidden {', '.join(bad)}: does not act on {ground} ground; allowed: {', '.join(allowed)}")
        levels = tuple(float(rng.uniform()) if strength is None else strength for _ in effects)
        true: dict[str, float] = {}
        for name, level in zip(effects, levels):
            true |= _values(name, level, rng)
        if _possible(effects, true):
            break
    else:
        raise ValueError(f"hidden {', '.join(effects)}: cannot act together at this strength")
    track = nuisance.drawn(rng)
    return Setting(effects, true, levels, _protocol(ground, effects, true, track, sweeps(ground, trials, jumps), rng))


def sweeps(ground: str, trials: int = 1, jumps: str = "full") -> tuple[Jump, ...]:
    """Return the jumps of a campaign.

    jumps = "full": 24 different ones, or 12 of `trials` each; "few": 4 different ones, or 2 of `trials` each.
    """
    if trials < 1 or jumps not in ("full", "few"):
        raise ValueError(f"trials = {trials}, jumps = {jumps!r}: must be at least 1, and 'full' or 'few'")
    made = FEW[ground, trials > 1] if jumps == "few" else (REPEATED if trials > 1 else ONCE)[ground]
    each = (jumps_of(kind, f, (AMPLITUDE[ground],), delay=(delay,), trials=trials) for kind, f, delay in made)
    return tuple(jump for some in each for jump in some)


def _pick(ground: str, rng: np.random.Generator) -> tuple[str, ...]:
    number = rng.choice(["none", "one", "two", "outside"], p=[0.15, 0.55, 0.2, 0.1])
    pool = choices(ground, outside=bool(number == "outside"))
    size = {"none": 0, "two": 2}.get(str(number), 1)
    return tuple(str(h) for h in rng.choice(pool, size, replace=False))


def _possible(effects: tuple[str, ...], true: dict[str, float]) -> bool:
    """One static force at most, and enough drag for the cone not to create energy (alpha > (1/2) dm_a/dz)."""
    if sum(e in STATIC for e in effects) > 1:
        return False
    growth = true.get("C", 0.0) * 570.0 * true.get("mu", 0.0) * math.pi * ROBOTS["granular"].foot_radius ** 2
    return not {"added_mass", "inertial_drag"} <= set(effects) or true["alpha"] > 0.6 * growth


def _values(name: str, level: float, rng: np.random.Generator) -> dict[str, float]:
    effect = EFFECTS[name]
    out = dict(effect.fixed)
    for key, (weak, strong, either) in effect.drawn.items():
        origin = 1.0 if key == "factor" else 0.0  # a ratio: its distance from 1 counts
        value = origin + (weak - origin) * ((strong - origin) / (weak - origin)) ** level
        sign = float(rng.choice([-1.0, 1.0])) if either else 1.0
        out[key] = 1.0 + sign * value if key == "scale" else sign * value
    return out


def _protocol(
    ground: str,
    hidden: tuple[str, ...],
    true: dict[str, float],
    track: RodTrack,
    jumps: tuple[Jump, ...],
    rng: np.random.Generator,
) -> Protocol:
    """A truth with the hidden effects, and a declared model without them."""
    robot = ROBOTS[ground]
    spring, sigma = robot.spring_stiffness, {}
    if "spring_stiffness" not in hidden:  # its own error, within its stated uncertainty
        sigma = {"spring_stiffness": 0.005 * spring}
        spring += sigma["spring_stiffness"] * float(rng.normal())
    terms, truth, model = (_hard if ground == "hard" else _sand)(hidden, rng)
    return Protocol(
        robot,
        jumps,
        # what the motor makes of its command shows only where the command drives the model
        Records(rod_track=track, motor_log=None if UNLOGGED & {*hidden} else MotorLog()),
        terms=tuple(dict.fromkeys([*terms, *hidden, "spring_stiffness"])),
        parameters={"dk": spring - robot.spring_stiffness} | truth | true,
        ground=ground,
        model=model,
        robot_sigma=sigma,
    )


GroundTruth = tuple[
    list[str], dict[str, float], dict[str, Any]
]  # true terms and parameters before the hidden ones, [model]


def _hard(hidden: tuple[str, ...], rng: np.random.Generator) -> GroundTruth:
    if "landing_loss" in hidden:
        return [], {}, {"terms": []}
    model = {"terms": ["landing_loss"], "e": 0.3, "fit": {"e": [0.0, 0.8]}}
    return ["landing_loss"], {"e": float(rng.uniform(0.2, 0.4))}, model


def _sand(hidden: tuple[str, ...], rng: np.random.Generator) -> GroundTruth:
    stiffness = float(rng.uniform(1900.0, 2400.0))
    sigma = 0.01 * stiffness
    k1 = stiffness + sigma * float(rng.normal())  # as declared
    two: dict[str, Any] = {"terms": ["two_resistance"], "k1": k1, "k2": 0.8 * stiffness, "delta": 0.012}
    terms: list[str] = []
    truth: dict[str, float] = {}
    if "two_resistance" in hidden:
        model: dict[str, Any] = {"terms": ["linear_penetration"], "k": 2200.0, "fit": {"k": [1000.0, 5000.0]}}
    elif "rft_cone" in hidden:
        truth = {"k1": stiffness}
        model = two | {"k2": k1, "fit": {"k1": [1000.0, 5000.0], "k2": [500.0, 6000.0]}}
    else:
        terms, truth = ["two_resistance"], {"k1": stiffness, "k2": 0.8 * stiffness, "delta": 0.012}
        model = two | {"fit": {}, "sigma": {"k1": sigma}}
    if "inertial_drag" not in hidden:
        terms, truth = [*terms, "inertial_drag"], truth | {"alpha": float(rng.uniform(40.0, 90.0))}
        fit = model["fit"] | {"alpha": [0.0, 300.0]}
        model = model | {"terms": [*model["terms"], "inertial_drag"], "alpha": 60.0, "fit": fit}
    return terms, truth, model


def campaign(setting: Setting, rng: np.random.Generator, *, dt: float = DT) -> list[Recorded]:
    """Every jump of the setting as arrays: under a second for 24 jumps. dt [s]: step of the laboratory's integrator."""
    log = setting.protocol.records.motor_log
    out = []
    for jump in setting.protocol.jumps:
        motion, phi, true = jump_of(setting.protocol, jump, rng, dt=dt, every=EVERY)
        zero, scale = rng.uniform(-0.05, 0.05), true.get("scale", 1.0)
        seen = logs.seen_rod(motion, setting.nuisance, zero=zero, rng=rng, scale=scale, dt=true.get("dt", 0.0))
        motor = logs.motor_log(motion, rate=log.rate, force_noise=log.force_noise, rng=rng) if log else None
        out.append(Recorded(jump, phi, seen.columns, motor, seen.error, seen.sigma))
    return out
