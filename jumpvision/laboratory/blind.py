"""Hidden effects: a campaign whose declared model lacks, or does not lack, something that is drawn at random.

The engine of the hidden-effect game and of tests of the diagnosis: `draw` a setting, `campaign` its tracks and motor
logs as arrays. The nuisance is drawn too: noise, its correlation, rounding, and declared values that are wrong within
their stated uncertainty or may be fitted again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError, read

from . import recordings as logs
from .campaign import jump_of
from .jumper import OUTSIDE, STATIC, UNLOGGED, Robot
from .protocol import Protocol, checked
from .protocol_keys import BedValues, Header, Jump, JumpSweep, MotorLog, Records, RodTrack, jumps_of
from .recordings import Errors
from .write import Table

DT, EVERY = 1e-5, 50  # s: rod within 0.01 mm of dt = 1e-6, a fifth of the smallest noise (tests/test_lab_blind.py)
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
_ROD = {"foot_radius": 0.0381, "rod_mass": 0.175}
ROBOTS = {
    "granular": Robot(
        motor_mass=1.125, foot_mass=0.04, spring_stiffness=3300.0, spring_damping=1.2, gravity=9.81, **_ROD
    ),
    "hard": Robot(
        motor_mass=1.003, foot_mass=0.0, spring_stiffness=5760.6, spring_damping=1.368, gravity=2.70756, **_ROD
    ),
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
    """Errors of the tracks, by the keys of [record.rod_track]; noise [m], rho, step [m]: None to draw them."""

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
        given = asdict(replace(self, noise=noise, rho=rho, step=step))
        track, problems = read(RodTrack, given, "the drawn setting: [record.rod_track]")
        if problems:
            raise InputError(problems)
        return cast(RodTrack, track)


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
        return track_of(self.protocol)


def track_of(protocol: Protocol) -> RodTrack:
    """[record.rod_track] of a protocol that has it."""
    if protocol.records.rod_track is None:
        raise ValueError(f"{protocol.file}: [record.rod_track]: missing; the hidden effect is looked for in tracks")
    return protocol.records.rod_track


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


def sweeps(ground: str, trials: int = 1, jumps: str = "full") -> list[JumpSweep]:
    """[[jumps]] of a campaign. jumps = "full": 24 different ones, or 12 that are made `trials` times each; "few": 4
    different ones, or 2 that are made `trials` times each."""
    if trials < 1 or jumps not in ("full", "few"):
        raise ValueError(f"trials = {trials}, jumps = {jumps!r}: must be at least 1, and 'full' or 'few'")
    made = FEW[ground, trials > 1] if jumps == "few" else (REPEATED if trials > 1 else ONCE)[ground]
    amplitude = (AMPLITUDE[ground],)
    return [JumpSweep(kind, f, amplitude, delay=(delay,), trials=trials) for kind, f, delay in made]


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


class Model(NamedTuple):
    """The declared model: values, ranges that may be fitted, standard uncertainties of values."""

    terms: list[str]
    values: dict[str, float]
    fit: dict[str, list[float]]
    sigma: dict[str, float]

    def table(self) -> Table:
        """[model] of a protocol."""
        more: Table = {"fit": self.fit, "sigma": self.sigma}
        return {"terms": self.terms, **self.values, **{k: v for k, v in more.items() if v}}


def _protocol(
    ground: str,
    hidden: tuple[str, ...],
    true: dict[str, float],
    track: RodTrack,
    sweeps: list[JumpSweep],
    rng: np.random.Generator,
) -> Protocol:
    """A truth with the hidden effects, and a declared model without them."""
    robot, sigma = ROBOTS[ground], {}
    dk = 0.0  # the spring's own error, within its stated uncertainty
    if "spring_stiffness" not in hidden:
        sigma = {"spring_stiffness": 0.005 * robot.spring_stiffness}
        dk = robot.spring_stiffness + sigma["spring_stiffness"] * rng.normal() - robot.spring_stiffness
    terms: list[str] = []
    truth: dict[str, float] = {}
    model = Model([], {}, {}, {})
    if ground == "hard" and "landing_loss" not in hidden:
        terms, truth = ["landing_loss"], {"e": float(rng.uniform(0.2, 0.4))}
        model = Model(["landing_loss"], {"e": 0.3}, {"e": [0.0, 0.8]}, {})
    if ground == "granular":
        terms, truth, model = _sand(hidden, rng)
    truth |= true
    terms += [h for h in hidden if h not in terms]
    if "spring_stiffness" not in terms:
        terms, truth = [*terms, "spring_stiffness"], truth | {"dk": dk}
    header = Header("A campaign with, perhaps, a hidden effect", ground, 1.8)
    protocol = Protocol(
        header,
        robot,
        None,
        BedValues(),
        tuple(terms),
        truth,
        {},
        jumps_of(sweeps, start=header.start, ground=ground, part="", first=0),
        (),
        # what the motor makes of its command shows only where the command drives the model
        Records(rod_track=track, motor_log=MotorLog() if not UNLOGGED & {*hidden} else None),
        model=model.table(),
        robot_sigma=sigma,
        file=Path("the drawn setting"),
    )
    return checked(protocol, "the drawn setting")


def _sand(hidden: tuple[str, ...], rng: np.random.Generator) -> tuple[list[str], dict[str, float], Model]:
    """Terms and parameters of the true bed, and the model declared of it, before the hidden effects are added."""
    stiffness = float(rng.uniform(1900.0, 2400.0))
    sigma = 0.01 * stiffness
    declared = stiffness + sigma * float(rng.normal())
    if "two_resistance" in hidden:
        terms: list[str] = []
        truth: dict[str, float] = {}
        model = Model(["linear_penetration"], {"k": 2200.0}, {"k": [1000.0, 5000.0]}, {})
    elif "rft_cone" in hidden:
        terms, truth = [], {"k1": stiffness}
        fit = {"k1": [1000.0, 5000.0], "k2": [500.0, 6000.0]}
        model = Model(["two_resistance"], {"k1": declared, "k2": declared, "delta": 0.012}, fit, {})
    else:
        terms, truth = ["two_resistance"], {"k1": stiffness, "k2": 0.8 * stiffness, "delta": 0.012}
        values = {"k1": declared, "k2": 0.8 * stiffness, "delta": 0.012}
        model = Model(["two_resistance"], values, {}, {"k1": sigma})
    if "inertial_drag" not in hidden:
        terms, truth = [*terms, "inertial_drag"], truth | {"alpha": float(rng.uniform(40.0, 90.0))}
        model.terms.append("inertial_drag")
        model.values["alpha"] = 60.0
        model.fit["alpha"] = [0.0, 300.0]
    return terms, truth, model


def campaign(setting: Setting, rng: np.random.Generator, *, dt: float = DT) -> list[Recorded]:
    """Every jump of the setting as arrays: under a second for 24 jumps. dt [s]: step of the laboratory's integrator."""
    protocol = setting.protocol
    track, log = track_of(protocol), protocol.records.motor_log
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
        motor = logs.motor_log(motion, rate=log.rate, force_noise=log.force_noise, rng=rng) if log else None
        out.append(Recorded(jump, phi, seen.columns, motor, seen.error, seen.sigma))
    return out
