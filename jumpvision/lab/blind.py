"""Hidden effects: a campaign whose declared model lacks, or does not lack, something that is drawn at random.

The engine of the hidden-effect game and of tests of the diagnosis: `draw` a setting, `campaign` its tracks and motor
logs as arrays. The nuisance is drawn too: noise, its correlation, rounding, and declared values that are wrong within
their stated uncertainty or may be fitted again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jumpvision.base.arrays import Array

from . import recordings as logs
from .campaign import jump_of
from .jumper import OUTSIDE, STATIC
from .protocol import Protocol, protocol_of
from .protocol_keys import Jump
from .recordings import Errors

DT, EVERY = 1e-5, 50  # s: rod within 0.01 mm of dt = 1e-6, a fifth of the smallest noise (tests/test_lab_blind.py)
EITHER = "either"  # of both signs

# mechanism: grounds, {parameter: (weak, strong[, EITHER])} drawn log-uniformly, {parameter: fixed value}
_BOTH, _SAND, _HARD = ("hard", "granular"), ("granular",), ("hard",)
_CONE = {"mu": 2.0, "theta": math.pi / 3}
EFFECTS: dict[str, tuple[tuple[str, ...], dict[str, tuple[Any, ...]], dict[str, float]]] = {
    "two_resistance": (_SAND, {"k1": (2300.0, 3600.0)}, {"k2": 2000.0, "delta": 0.012}),
    "rft_cone": (_SAND, {"sigma_cone": (4e4, 4e5)}, _CONE),
    "inertial_drag": (_SAND, {"alpha": (0.8, 100.0)}, {}),
    "depth_drag": (_SAND, {"b": (0.4, 25.0)}, _CONE | {"C": 2.7}),
    "added_mass": (_SAND, {"C": (0.08, 3.5)}, _CONE),
    "foot_mass": (_SAND, {"dm_f": (0.0008, 0.04)}, {}),
    "reintrusion_overshoot": (_SAND, {"s": (30.0, 4000.0)}, {"lam": 0.005}),
    "stop_go_overshoot": (_SAND, {"s_p": (20.0, 2000.0)}, {"lam": 0.005}),
    "compaction": (_SAND, {"factor": (1.006, 1.6)}, {}),
    "viscous_friction": (_BOTH, {"c_v": (0.01, 2.0)}, {}),
    "coulomb_friction": (_BOTH, {"F_c": (0.006, 1.0)}, {}),
    "spring_hardening": (_BOTH, {"k_3": (3e4, 8e6)}, {}),
    "spring_damping": (_BOTH, {"dc": (0.03, 4.0)}, {}),
    "spring_stiffness": (_BOTH, {"dk": (8.0, 400.0, EITHER)}, {}),
    "payload": (_BOTH, {"dm": (0.002, 0.15, EITHER)}, {}),
    "tilt": (_BOTH, {"dg": (0.008, 0.4, EITHER)}, {}),
    "landing_loss": (_HARD, {"e": (0.004, 0.5)}, {}),
    "motor_lag": (_BOTH, {"tau": (0.0003, 0.008)}, {}),
    "camera_scale": (_BOTH, {"scale": (0.0015, 0.06, EITHER)}, {}),  # about 1
    "time_offset": (_BOTH, {"dt": (0.0003, 0.01, EITHER)}, {}),
    "rail_drag_by_height": (_BOTH, {"c_x": (0.6, 60.0)}, {}),
    "depth_rate_drag": (_SAND, {"d_zv": (50.0, 3000.0)}, {}),
}
ROBOTS = {
    "granular": {
        "motor_mass": 1.125,
        "rod_mass": 0.175,
        "foot_mass": 0.04,
        "spring_stiffness": 3300.0,
        "spring_damping": 1.2,
        "foot_radius": 0.0381,
        "gravity": 9.81,
    },
    "hard": {
        "motor_mass": 1.003,
        "rod_mass": 0.175,
        "spring_stiffness": 5760.6,
        "spring_damping": 1.368,
        "gravity": 2.70756,
    },
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
class Setting:
    """A campaign with what it hides. hidden: mechanisms, none for an adequate model; parameters: their true values;
    strength: 0 weak .. 1 strong, of each; nuisance: the track's errors, by the keys of [record.rod_track].
    protocol.tables["model"] is the declared model."""

    hidden: tuple[str, ...]
    parameters: dict[str, float]
    strength: tuple[float, ...]
    nuisance: dict[str, Any]
    protocol: Protocol

    @property
    def outside(self) -> bool:
        """Whether nothing in the vocabulary is the right answer."""
        return any(h in OUTSIDE for h in self.hidden)


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
    return [h for h, (grounds, _, _) in EFFECTS.items() if ground in grounds and (h in OUTSIDE) == outside]


def draw(
    rng: np.random.Generator,
    *,
    ground: str = "granular",
    hidden: Sequence[str] | None = None,
    strength: float | None = None,
    noise: float | None = None,
    rho: float | None = None,
    step: float | None = None,
    family: str = "white",
    drift: float = 0.0,
    ratio: float = 1.0,
    stated: bool = True,
    trials: int = 1,
    jumps: str = "full",
) -> Setting:
    """A setting at random. hidden: the effects, () for none; by default none (15 %), one (55 %), two (20 %) or one
    outside the vocabulary (10 %). strength: 0 weak .. 1 strong. noise [m], rho, step [m] (rounding): of the track; by
    default 0.05 to 0.5 mm, 0 to 0.7 and 0 to 0.1 mm; family, drift [m], ratio, stated: as in [record.rod_track].
    trials, jumps: see `sweeps`. Raises ValueError for effects that cannot act here or together."""
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
    nuisance: dict[str, Any] = {
        "noise": float(np.exp(rng.uniform(math.log(5e-5), math.log(5e-4)))) if noise is None else noise,
        "rho": float(rng.choice([0.0, rng.uniform(0.0, 0.7)])) if rho is None else rho,
        "step": float(rng.choice([0.0, 5e-5, 1e-4])) if step is None else step,
        "family": family,
        "drift": drift,
        "ratio": ratio,
        "stated": stated,
    }
    table = _table(ground, effects, true, nuisance, sweeps(ground, trials, jumps), rng)
    return Setting(effects, true, levels, nuisance, protocol_of(table, "the drawn setting"))


def sweeps(ground: str, trials: int = 1, jumps: str = "full") -> list[dict[str, Any]]:
    """[[jumps]] of a campaign. jumps = "full": 24 different ones, or 12 that are made `trials` times each; "few": 4
    different ones, or 2 that are made `trials` times each."""
    if trials < 1 or jumps not in ("full", "few"):
        raise ValueError(f"trials = {trials}, jumps = {jumps!r}: must be at least 1, and 'full' or 'few'")
    made = FEW[ground, trials > 1] if jumps == "few" else (REPEATED if trials > 1 else ONCE)[ground]
    return [
        {"kind": kind, "frequency": list(f), "amplitude": AMPLITUDE[ground], "delay": delay, "trials": trials}
        for kind, f, delay in made
    ]


def _pick(ground: str, rng: np.random.Generator) -> tuple[str, ...]:
    number = rng.choice(["none", "one", "two", "outside"], p=[0.15, 0.55, 0.2, 0.1])
    pool = choices(ground, outside=bool(number == "outside"))
    size = {"none": 0, "two": 2}.get(str(number), 1)
    return tuple(str(h) for h in rng.choice(pool, size, replace=False))


def _possible(effects: tuple[str, ...], true: dict[str, float]) -> bool:
    """One static force at most, and enough drag for the cone not to create energy (alpha > (1/2) dm_a/dz)."""
    if sum(e in STATIC for e in effects) > 1:
        return False
    growth = true.get("C", 0.0) * 570.0 * true.get("mu", 0.0) * math.pi * ROBOTS["granular"]["foot_radius"] ** 2
    return not {"added_mass", "inertial_drag"} <= set(effects) or true["alpha"] > 0.6 * growth


def _values(name: str, level: float, rng: np.random.Generator) -> dict[str, float]:
    _, drawn, fixed = EFFECTS[name]
    out = dict(fixed)
    for key, (weak, strong, *either) in drawn.items():
        origin = 1.0 if key == "factor" else 0.0  # a ratio: its distance from 1 counts
        value = origin + (weak - origin) * ((strong - origin) / (weak - origin)) ** level
        sign = float(rng.choice([-1.0, 1.0])) if either else 1.0
        out[key] = 1.0 + sign * value if key == "scale" else sign * value
    return out


def _table(
    ground: str,
    hidden: tuple[str, ...],
    true: dict[str, float],
    nuisance: dict[str, Any],
    jumps: list[dict[str, Any]],
    rng: np.random.Generator,
) -> dict[str, Any]:
    """The protocol: a truth with the hidden effects, and a declared model without them."""
    robot: dict[str, Any] = dict(ROBOTS[ground])
    robot["sigma"] = {}
    if "spring_stiffness" not in hidden:
        sigma = 0.005 * robot["spring_stiffness"]
        true_stiffness = robot["spring_stiffness"] + sigma * rng.normal()
        robot["sigma"]["spring_stiffness"] = sigma
    else:
        true_stiffness = robot["spring_stiffness"]
    model: dict[str, Any] = {"terms": [], "fit": {}, "sigma": {}}
    truth: dict[str, Any] = {}
    terms: list[str] = []
    if ground == "hard" and "landing_loss" not in hidden:
        terms, truth = ["landing_loss"], {"e": float(rng.uniform(0.2, 0.4))}
        model |= {"terms": ["landing_loss"], "e": 0.3, "fit": {"e": [0.0, 0.8]}}
    if ground == "granular":
        terms, truth, model = _sand(hidden, rng)
    truth |= true
    terms += [h for h in hidden if h not in terms]
    record: dict[str, Any] = {"rod_track": nuisance}
    if "motor_lag" not in hidden:  # a lag shows only where the command drives the model
        record["motor_log"] = {}
    return {
        "name": "A campaign with, perhaps, a hidden effect",
        "ground": ground,
        "duration": 1.8,
        "robot": robot,
        "truth": {"terms": terms, **truth} | _corrected(terms, truth, true_stiffness - robot["spring_stiffness"]),
        "jumps": jumps,
        "record": record,
        "model": {k: v for k, v in model.items() if v != {}},
    }


def _corrected(terms: list[str], truth: dict[str, Any], dk: float) -> dict[str, Any]:
    """The spring's own error, within its stated uncertainty, as the laboratory's mechanism."""
    return {"terms": [*terms, "spring_stiffness"], "dk": dk} if "spring_stiffness" not in terms else {}


def _sand(hidden: tuple[str, ...], rng: np.random.Generator) -> tuple[list[str], dict[str, Any], dict[str, Any]]:
    """Terms and parameters of the true bed, and the model declared of it, before the hidden effects are added."""
    stiffness = float(rng.uniform(1900.0, 2400.0))
    sigma = 0.01 * stiffness
    declared = stiffness + sigma * float(rng.normal())
    model: dict[str, Any] = {"fit": {}, "sigma": {}}
    if "two_resistance" in hidden:
        static: list[str] = []
        truth: dict[str, Any] = {}
        model |= {"terms": ["linear_penetration"], "k": 2200.0, "fit": {"k": [1000.0, 5000.0]}}
    elif "rft_cone" in hidden:
        static, truth = [], {"k1": stiffness}
        model |= {"terms": ["two_resistance"], "k1": declared, "k2": declared, "delta": 0.012}
        model["fit"] = {"k1": [1000.0, 5000.0], "k2": [500.0, 6000.0]}
    else:
        static, truth = ["two_resistance"], {"k1": stiffness, "k2": 0.8 * stiffness, "delta": 0.012}
        model |= {"terms": ["two_resistance"], "k1": declared, "k2": 0.8 * stiffness, "delta": 0.012}
        model["sigma"] = {"k1": sigma}
    if "inertial_drag" not in hidden:
        static, truth = [*static, "inertial_drag"], truth | {"alpha": float(rng.uniform(40.0, 90.0))}
        model["terms"] = [*model["terms"], "inertial_drag"]
        model |= {"alpha": 60.0}
        model["fit"] = model["fit"] | {"alpha": [0.0, 300.0]}
    return static, truth, model


def campaign(setting: Setting, rng: np.random.Generator, *, dt: float = DT) -> list[Recorded]:
    """Every jump of the setting as arrays: under a second for 24 jumps. dt [s]: step of the laboratory's integrator."""
    protocol = setting.protocol
    track = protocol.records["rod_track"]
    out = []
    for jump in protocol.jumps:
        motion, phi, parameters = jump_of(protocol, jump, rng, dt=dt, every=EVERY)
        seen = logs.seen_rod(
            motion,
            track,
            zero=rng.uniform(-0.05, 0.05),
            rng=rng,
            scale=parameters.get("scale", 1.0),
            dt=parameters.get("dt", 0.0),
        )
        log = protocol.records.get("motor_log")
        motor = logs.motor_log(motion, rate=log.rate, force_noise=log.force_noise, rng=rng) if log else None
        out.append(Recorded(jump, phi, seen.columns, motor, seen.error, seen.sigma))
    return out
