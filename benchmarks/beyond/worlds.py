"""Campaigns of 24 single jumps with a law in them that is in no library: drawn, simulated by `motion`, sealed.

The declared model is right but for the hidden law, its values wrong within their stated sigmas; exponents, lengths and
strengths are drawn, not round. Beside the 24 jumps stand FRESH further ones that nobody is shown: what a found law
predicts of them is its held-out error.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jumpvision.laboratory.seal import Answer, seal

from jumpvision.laboratory import write

from . import motion as mo
from .motion import Array, Command, Jumper, Law, Motion

START, DURATION, RATE, ENCODER = 0.2, 1.8, 200.0, (1000.0, 6.25e-6)  # s, s, 1/s, (1/s, m)
PHI, DENSITY = 0.57, 1000.0
NOISES = (5e-5, 2e-4)  # m
ROBOTS = {
    "granular": {"motor_mass": 1.125, "rod_mass": 0.175, "foot_mass": 0.04, "spring_stiffness": 3300.0,
                 "spring_damping": 1.2, "foot_radius": 0.0381, "gravity": 9.81},
    "hard": {"motor_mass": 1.003, "rod_mass": 0.175, "foot_mass": 0.0, "spring_stiffness": 5760.6,
             "spring_damping": 1.368, "foot_radius": 0.0381, "gravity": 2.70756},
}  # fmt: skip
AMPLITUDE = {"granular": 0.01875, "hard": 0.004}
SWEEPS = {  # kind, jumps, frequencies [Hz]
    "granular": (("single", 12, (4.5, 10.0)), ("stutter", 8, (4.5, 6.0)), ("delayed_stutter", 4, (6.0, 7.0))),
    "hard": (("single", 12, (9.0, 19.0)), ("stutter", 12, (6.5, 11.0))),
}
FRESH = {"single": 3, "stutter": 2, "delayed_stutter": 1}
DELAYS = (0.06, 0.16)  # s


class Family(NamedTuple):
    """Laws of one form. words: in symbols; body of `motion`, or 0 for an instrument. shape: names of the exponents
    ("p", absolute error) and of the lengths, speeds and times (relative error), behind the strength.
    arguments: what the force depends on; memory: also on the past. active: it gives energy."""

    words: str
    acts_on: str
    which: int
    shape: tuple[str, ...]
    arguments: frozenset[str]
    draw: Callable[[np.random.Generator], tuple[float, ...]]
    grounds: tuple[str, ...] = ("granular",)
    memory: bool = False
    active: bool = False


BODIES = {"foot": mo.FOOT, "carriage": mo.CARRIAGE, "spring": mo.SPRING}
EXPONENTS = ("p", "q")


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def _power(rng: np.random.Generator) -> tuple[float, ...]:
    p = float(rng.uniform(0.4, 1.8))
    return _log(rng, 1.5, 4.0) / 0.5**p, p


def _depth_power(rng: np.random.Generator) -> tuple[float, ...]:
    q = float(rng.uniform(0.4, 1.6))
    return _log(rng, 1.5, 4.0) / (0.02**q * 0.5), q


def _arm(rng: np.random.Generator) -> tuple[float, ...]:
    return _log(rng, 40.0, 150.0), _log(rng, 0.008, 0.05)


BOTH = ("granular", "hard")
ZU, U, Z, RAIL, STRETCH = (frozenset(x) for x in (("z", "v"), ("v",), ("z",), ("x_m", "v_m"), ("stretch", "rate")))
FAMILIES = {
    "speed_power": Family("a |v|^p", "foot", mo.POWER, ("p",), U, _power),
    "depth_power": Family("a z^q |v|", "foot", mo.DEPTH_POWER, ("q",), ZU, _depth_power),
    "depth_decay": Family(
        "a exp(-z/l)", "foot", mo.DECAY, ("l",), Z,
        lambda r: (_log(r, 4.0, 10.0), _log(r, 0.008, 0.025)),
    ),
    "saturating": Family(
        "a |v|/(|v| + v0)", "foot", mo.SATURATING, ("v0",), U,
        lambda r: (_log(r, 2.0, 5.0), _log(r, 0.08, 0.5)),
    ),
    "since_contact": Family(
        "a z exp(-(t - t_landing)/tau)", "foot", mo.SINCE, ("tau",), frozenset({"z", "since"}),
        lambda r: (_log(r, 150.0, 500.0), _log(r, 0.015, 0.08)), memory=True,
    ),
    "relaxing": Family(
        "m, m' = a |v| - m/tau", "foot", mo.RELAXING, ("tau",), frozenset({"v", "m"}),
        lambda r: (_log(r, 150.0, 500.0), _log(r, 0.015, 0.1)), memory=True,
    ),
    "spring_arm": Family(
        "-a m, m' = stretch' - m/tau", "spring", mo.ARM, ("tau",), frozenset({"rate", "m"}), _arm, BOTH, memory=True,
    ),
    "spring_dry": Family(
        "-a |stretch| sign(stretch')", "spring", mo.DRY, (), STRETCH,
        lambda r: (_log(r, 25.0, 100.0),), BOTH,
    ),
    "rail_rising": Family(
        "-a exp(x_m/l) v_m", "carriage", mo.RISING, ("l",), RAIL,
        lambda r: (_log(r, 0.15, 0.5), _log(r, 0.02, 0.06)), BOTH,
    ),
    "rail_patch": Family(
        "-a exp(-((x_m - x0)/w)^2) v_m", "carriage", mo.PATCH, ("x0", "w"), RAIL,
        lambda r: (_log(r, 0.6, 2.0), r.uniform(0.005, 0.025), r.uniform(0.008, 0.02)), BOTH,
    ),
    "clock": Family(
        "t' = t + a t", "film_time", 0, (), frozenset({"time"}),
        lambda r: (_log(r, 0.0015, 0.006) * r.choice([-1.0, 1.0]),), BOTH,
    ),
    "lens_radial": Family(
        "h' = h + a (h - h0)^3", "film_height", 1, ("h0",), frozenset({"height"}),
        lambda r: (_log(r, 12.0, 30.0) * r.choice([-1.0, 1.0]), r.uniform(-0.02, 0.02)), BOTH,
    ),
    "lens_tilted": Family(
        "h' = h + a h^2", "film_height", 2, (), frozenset({"height"}),
        lambda r: (_log(r, 0.4, 1.2) * r.choice([-1.0, 1.0]),), BOTH,
    ),
    "active_damping": Family(
        "a v_m", "carriage", mo.PUSH, (), frozenset({"v_m"}), lambda r: (_log(r, 0.2, 0.6),), BOTH, active=True,
    ),
    "active_push": Family(
        "a v_m/(|v_m| + v0)", "carriage", mo.SHOVE, ("v0",), frozenset({"v_m"}),
        lambda r: (_log(r, 0.15, 0.4), _log(r, 0.01, 0.05)), BOTH, active=True,
    ),
    "active_drag": Family(
        "-a |v|^p", "foot", mo.POWER, ("p",), U,
        lambda r: (lambda a, p: (-0.5 * a, p))(*_power(r)), active=True,
    ),
    "active_spring": Family(
        "a |stretch| sign(stretch')", "spring", mo.DRY, (), STRETCH,
        lambda r: (-_log(r, 15.0, 40.0),), BOTH, active=True,
    ),
}  # fmt: skip
PLAN = (  # family, campaigns: 24 of the bar, then those that give energy
    ("speed_power", 4), ("depth_power", 3), ("depth_decay", 3), ("saturating", 3), ("since_contact", 2),
    ("relaxing", 1), ("spring_arm", 1), ("spring_dry", 1), ("rail_rising", 1), ("rail_patch", 1), ("clock", 2),
    ("lens_radial", 1), ("lens_tilted", 1),
    ("active_damping", 2), ("active_push", 2), ("active_drag", 2), ("active_spring", 2),
)  # fmt: skip
NAMES = tuple(name for name, n in PLAN for _ in range(n))
BARRED = 24  # of NAMES count for the bars of forms


class Shot(NamedTuple):
    """One jump: its kind and command."""

    kind: str
    command: Command


@dataclass(frozen=True)
class World:
    """A campaign with its truth. p: strength and shape of the family's law. jumper: the true robot and ground.

    declared: values of [model]; free: ranges that may be fitted; sigma: standard uncertainties, `robot.` before those
    of the robot. nominal: the robot and ground as declared.
    """

    number: int
    family: str
    p: tuple[float, ...]
    ground: str
    noise: float
    jumper: Jumper
    nominal: Jumper
    terms: tuple[str, ...]
    declared: dict[str, float]
    free: dict[str, tuple[float, float]]
    sigma: dict[str, float]
    shots: tuple[Shot, ...]
    fresh: tuple[Shot, ...]
    true: dict[str, float] = field(default_factory=dict)

    @property
    def form(self) -> Family:
        return FAMILIES[self.family]

    @property
    def name(self) -> str:
        return f"{self.number:02d}-{self.family}-{self.ground}"

    @property
    def law(self) -> Law:
        """As `motion` needs it; nothing for an instrument."""
        if self.form.acts_on not in BODIES:
            return Law()
        return Law(BODIES[self.form.acts_on], self.form.which, tuple([*self.p, 0.0, 0.0][:3]))  # type: ignore[arg-type]


def world(number: int, *, noise: float | None = None) -> World:
    """Campaign `number` (0 to 23 count; to 31 they give energy): the same whenever it is asked for."""
    family = NAMES[number]
    form = FAMILIES[family]
    rng = np.random.default_rng([20, number])
    first = NAMES.index(family)
    ground = form.grounds[(number - first + len(family)) % len(form.grounds)]
    noise = NOISES[number % 2] if noise is None else noise
    robot = ROBOTS[ground]
    truth = dict(robot)
    sigma = {"robot.spring_stiffness": 0.005 * robot["spring_stiffness"]}
    truth["spring_stiffness"] += sigma["robot.spring_stiffness"] * rng.normal()
    declared: dict[str, float]
    free: dict[str, tuple[float, float]]
    if ground == "granular":
        terms = ("linear_penetration", "depth_drag", "added_mass")
        true = {"k": rng.uniform(1900.0, 2400.0), "b": rng.uniform(8.0, 18.0), "C": rng.uniform(2.2, 3.2)}
        true |= {"mu": 2.0, "theta": math.pi / 3}
        sigma |= {"k": round(0.01 * true["k"], 1), "C": round(0.03 * true["C"], 3)}
        declared = {n: round(true[n] + sigma[n] * rng.normal(), 4) for n in ("k", "C")}
        declared |= {"b": 12.0, "mu": 2.0, "theta": round(math.pi / 3, 9)}
        free = {"b": (0.6, 40.0)}
    else:
        terms, true, declared, free = ("landing_loss",), {"e": rng.uniform(0.2, 0.4)}, {"e": 0.3}, {"e": (0.0, 0.8)}
    p = tuple(float(x) for x in form.draw(rng))
    return World(
        number, family, p, ground, noise, jumper_of(ground, truth | true), jumper_of(ground, robot | declared), terms,
        declared, free, sigma, *_shots(ground, rng), {k: float(v) for k, v in {**truth, **true}.items()},
    )  # fmt: skip


def jumper_of(ground: str, values: Mapping[str, float]) -> Jumper:
    """Robot and ground from values under their names in campaign.toml."""
    q = values
    base = Jumper(
        q["motor_mass"], q["motor_mass"] + q["rod_mass"], q["foot_mass"], q["spring_stiffness"], q["spring_damping"],
        q["gravity"], ground == "hard",
    )  # fmt: skip
    if ground == "hard":
        return base._replace(keep=math.sqrt(1.0 - q["e"]))
    return base._replace(
        k1=q["k"], b=q["b"], cone=q["C"] * PHI * DENSITY, mu=q["mu"], tan_theta=math.tan(q["theta"]), R=q["foot_radius"]
    )


def _shots(ground: str, rng: np.random.Generator) -> tuple[tuple[Shot, ...], tuple[Shot, ...]]:
    """The jumps of the campaign, evenly spread with a jitter, and the fresh ones, anywhere between."""
    seen, fresh = [], []
    for kind, n, (low, high) in SWEEPS[ground]:
        gap = (high - low) / (n - 1)
        spread = np.clip(np.linspace(low, high, n) + gap * rng.uniform(-0.4, 0.4, n), low, high)
        for out, frequencies in ((seen, spread), (fresh, rng.uniform(low + 0.3, high - 0.3, FRESH[kind]))):
            for f in frequencies:
                delay = round(float(rng.uniform(*DELAYS)), 3) if kind == "delayed_stutter" else 0.0
                phase = round((1.5 if kind == "single" else 0.5) * math.pi, 8)
                out.append(Shot(kind, Command(AMPLITUDE[ground], round(float(f), 3), phase, START, delay)))
    return tuple(seen), tuple(fresh)


# --------------------------------------------------------------------------------------------------------------- tracks
def times() -> Array:
    """Stamps of the film [s]."""
    return np.arange(round(DURATION * RATE)) / RATE


def moved(w: World, shot: Shot, t: Array | None = None) -> Motion:
    """The true motion at the times t, by default those that the stamps show."""
    t = times() if t is None else t
    return mo.follow(w.jumper, shot.command, w.law, t * (1.0 + w.p[0]) if w.family == "clock" else t)


def filmed(w: World, motion: Motion) -> Array:
    """Height above rest (n,) [m] as the film shows it, without noise."""
    h = motion.rod - motion.rod[0]
    return h + w.p[0] * distortion(w.form.which, h, *w.p[1:]) if w.form.acts_on == "film_height" else h


def distortion(which: int, h: Array, h0: float = 0.0) -> Array:
    """What a lens of unit strength adds to a height h above rest [m], nothing at rest."""
    return (h - h0) ** 3 + h0**3 if which == 1 else h * h


def tracks(w: World, shots: tuple[Shot, ...] | None = None, *, clean: bool = False) -> list[Array]:
    """Filmed heights (n,) [m] at `times`, less their mean before the start, of the campaign's jumps or of others."""
    shots = w.shots if shots is None else shots
    rng = np.random.default_rng([21, w.number, int(shots is w.fresh), round(1e7 * w.noise)])
    out = []
    for shot in shots:
        y = filmed(w, moved(w, shot))
        if not clean:
            y = y + w.noise * rng.standard_normal(y.size)
        out.append(y - y[times() < START].mean())
    return out


# --------------------------------------------------------------------------------------------------------------- folder
def write_folder(w: World, out: Path, *, fresh: bool = False) -> Path:
    """The campaign as `jumpvision diagnose` reads it below `out`, its sealed truth beside; fresh: the other jumps."""
    folder = out / (w.name + ("-fresh" if fresh else ""))
    shots = w.fresh if fresh else w.shots
    for n, (shot, y) in enumerate(zip(shots, tracks(w, shots))):
        kind, c = shot
        one = folder / f"{kind}-{c.frequency:g}Hz-{n:02d}"
        one.mkdir(parents=True)
        sigma = np.full(y.size, w.noise)
        write.table(one / "rod_track.csv", {"time_s": times(), "height_m": y, "sigma_m": sigma})
        t = np.arange(round(DURATION * ENCODER[0])) / ENCODER[0]
        X = mo.follow(w.nominal, c, Law(), t).motor
        write.table(one / "motor.csv", {"time_s": t, "position_m": np.rint(X / ENCODER[1]) * ENCODER[1]})
        law: write.Table = {
            "kind": kind, "frequency": c.frequency, "amplitude": c.amplitude, "phase": c.phase, "start": c.start,
        }  # fmt: skip
        if c.delay:
            law["delay"] = c.delay
        tables: write.Table = {"actuation": law, "rod_track": {"file": "rod_track.csv"}}
        tables["motor_log"] = {"file": "motor.csv"}
        if w.ground == "granular":
            tables["bed"] = {"volume_fraction": PHI}
        write.toml(one / "experiment.toml", tables)
    write.toml(folder / "campaign.toml", campaign_table(w))
    if not fresh:
        (out / f"{w.name}.sealed.json").write_text(json.dumps(seal(answer(w)), indent=1) + "\n", encoding="utf-8")
    return folder


def campaign_table(w: World) -> write.Table:
    """campaign.toml."""
    own = {k.removeprefix("robot."): v for k, v in w.sigma.items() if k.startswith("robot.")}
    more = {k: v for k, v in w.sigma.items() if not k.startswith("robot.")}
    out: write.Table = {"ground": w.ground, "robot": ROBOTS[w.ground], "robot.sigma": own}
    if w.ground == "granular":
        out["bed"] = {"grain_density": DENSITY}
    out |= {"model": {"terms": list(w.terms), **w.declared}}
    out["model.fit"] = {k: list(v) for k, v in w.free.items()}
    return out | ({"model.sigma": more} if more else {})


def answer(w: World) -> Answer:
    """What is hidden, as the hidden-effect game seals it."""
    values = dict(zip(("a", *w.form.shape), w.p))
    truth: dict[str, Any] = {"law": w.form.words, "acts_on": w.form.acts_on, "active": w.form.active, **w.true}
    return Answer((w.family,), True, values, truth=truth)


def quiet(w: World) -> World:
    """The same without the hidden law."""
    return replace(w, family="clock", p=(0.0,))
