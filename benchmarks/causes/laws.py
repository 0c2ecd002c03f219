"""Campaigns of 24 single jumps with a law in them that is in no library: drawn, simulated by `motion`.

The declared model is right but for the hidden law, its values wrong within their stated sigmas; exponents, lengths and
strengths are drawn, not round.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jumpvision.experiment.inputs.sections import Actuation
from jumpvision.experiment.stages.rod import commanded
from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.question.jumps import Jump
from tests.worlds.jumps import Task

from . import motion as mo
from .motion import Array, Command, Jumper, Law, Motion

START, DURATION, RATE = 0.2, 1.8, 200.0  # s, s, 1/s
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
DELAYS = (0.06, 0.16)  # s


class Family(NamedTuple):
    """Laws of one form. words: in symbols; acts_on: a body of `motion`, or the film; which: its number there; draw:
    strength and shape; active: it gives energy."""

    words: str
    acts_on: str
    which: int
    draw: Callable[[np.random.Generator], tuple[float, ...]]
    grounds: tuple[str, ...] = ("granular",)
    active: bool = False


BODIES = {"foot": mo.FOOT, "carriage": mo.CARRIAGE, "spring": mo.SPRING}
BOTH = ("granular", "hard")


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def _power(rng: np.random.Generator) -> tuple[float, ...]:
    p = float(rng.uniform(0.5, 1.8))  # with less, steps of `motion` chatter where the foot comes to rest
    return _log(rng, 1.5, 4.0) / 0.5**p, p


def _depth_power(rng: np.random.Generator) -> tuple[float, ...]:
    q = float(rng.uniform(0.4, 1.6))
    return _log(rng, 1.5, 4.0) / (0.02**q * 0.5), q


def _active_power(rng: np.random.Generator) -> tuple[float, ...]:
    a, p = _power(rng)
    return -0.5 * a, p


def of(*ranges: tuple[float, float], sign: bool = False) -> Callable[[np.random.Generator], tuple[float, ...]]:
    """Draw numbers evenly in their logarithm; sign: the first of either sign."""

    def draw(rng: np.random.Generator) -> tuple[float, ...]:
        first, *rest = (_log(rng, *r) for r in ranges)
        return first * (float(rng.choice([-1.0, 1.0])) if sign else 1.0), *rest

    return draw


FAMILIES = {
    "speed_power": Family("a |v|^p", "foot", mo.POWER, _power),
    "depth_power": Family("a z^q |v|", "foot", mo.DEPTH_POWER, _depth_power),
    "depth_decay": Family("a exp(-z/l)", "foot", mo.DECAY, of((4.0, 10.0), (0.008, 0.025))),
    "saturating": Family("a |v|/(|v| + v0)", "foot", mo.SATURATING, of((2.0, 5.0), (0.08, 0.5))),
    "since_contact": Family("a z exp(-(t - t_landing)/tau)", "foot", mo.SINCE, of((150.0, 500.0), (0.015, 0.08))),
    "relaxing": Family("m, m' = a |v| - m/tau", "foot", mo.RELAXING, of((150.0, 500.0), (0.015, 0.1))),
    "spring_arm": Family("-a m, m' = stretch' - m/tau", "spring", mo.ARM, of((40.0, 150.0), (0.008, 0.05)), BOTH),
    "spring_dry": Family("-a |stretch| sign(stretch')", "spring", mo.DRY, of((25.0, 100.0)), BOTH),
    "rail_rising": Family("-a exp(x_m/l) v_m", "carriage", mo.RISING, of((0.15, 0.5), (0.02, 0.06)), BOTH),
    "rail_patch": Family(
        "-a exp(-((x_m - x0)/w)^2) v_m", "carriage", mo.PATCH, of((0.6, 2.0), (0.005, 0.025), (0.008, 0.02)), BOTH
    ),
    "clock": Family("t' = t + a t", "film_time", 0, of((0.0015, 0.006), sign=True), BOTH),
    "lens_radial": Family("h' = h + a (h - h0)^3", "film_height", 1, of((12.0, 30.0), (0.002, 0.02), sign=True), BOTH),
    "lens_tilted": Family("h' = h + a h^2", "film_height", 2, of((0.4, 1.2), sign=True), BOTH),
    "active_damping": Family("a v_m", "carriage", mo.PUSH, of((0.2, 0.6)), BOTH, active=True),
    "active_push": Family("a v_m/(|v_m| + v0)", "carriage", mo.SHOVE, of((0.15, 0.4), (0.01, 0.05)), BOTH, active=True),
    "active_drag": Family("-a |v|^p", "foot", mo.POWER, _active_power, active=True),
    "active_spring": Family(
        "a |stretch| sign(stretch')", "spring", mo.DRY, lambda rng: (-_log(rng, 15.0, 40.0),), BOTH, active=True
    ),
}
PLAN = (  # family, campaigns: 24, then those that give energy
    ("speed_power", 4), ("depth_power", 3), ("depth_decay", 3), ("saturating", 3), ("since_contact", 2),
    ("relaxing", 1), ("spring_arm", 1), ("spring_dry", 1), ("rail_rising", 1), ("rail_patch", 1), ("clock", 2),
    ("lens_radial", 1), ("lens_tilted", 1),
    ("active_damping", 2), ("active_push", 2), ("active_drag", 2), ("active_spring", 2),
)  # fmt: skip
NAMES = tuple(name for name, n in PLAN for _ in range(n))


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
    seed: int

    @property
    def form(self) -> Family:
        return FAMILIES[self.family]

    @property
    def law(self) -> Law:
        """As `motion` needs it; nothing for an instrument."""
        if self.form.acts_on not in BODIES:
            return Law()
        return Law(BODIES[self.form.acts_on], self.form.which, tuple([*self.p, 0.0, 0.0][:3]))  # type: ignore[arg-type]


def world(number: int, seed: int = 20) -> World:
    """Campaign `number` of 32 (from 24 on the laws give energy): the same whenever it is asked for."""
    family = NAMES[number]
    form = FAMILIES[family]
    rng = np.random.default_rng([seed, number])
    first = NAMES.index(family)
    ground = form.grounds[(number - first + len(family)) % len(form.grounds)]
    noise = NOISES[number % 2]
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
        declared, free, sigma, _shots(ground, rng), seed,
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


def _shots(ground: str, rng: np.random.Generator) -> tuple[Shot, ...]:
    """The jumps of the campaign, evenly spread with a jitter."""
    out = []
    for kind, n, (low, high) in SWEEPS[ground]:
        gap = (high - low) / (n - 1)
        for f in np.clip(np.linspace(low, high, n) + gap * rng.uniform(-0.4, 0.4, n), low, high):
            delay = round(float(rng.uniform(*DELAYS)), 3) if kind == "delayed_stutter" else 0.0
            phase = round((1.5 if kind == "single" else 0.5) * math.pi, 8)
            out.append(Shot(kind, Command(AMPLITUDE[ground], round(float(f), 3), phase, START, delay)))
    return tuple(out)


# --------------------------------------------------------------------------------------------------------------- tracks
def times() -> Array:
    """Stamps of the film [s]."""
    return np.arange(round(DURATION * RATE)) / RATE


def moved(w: World, shot: Shot) -> Motion:
    """The true motion at the times that the stamps of a film show."""
    t = times()
    return mo.follow(w.jumper, shot.command, w.law, t * (1.0 + w.p[0]) if w.family == "clock" else t)


def filmed(w: World, motion: Motion) -> Array:
    """Height above rest (n,) [m] as the film shows it, without noise."""
    h = motion.rod - motion.rod[0]
    return h + w.p[0] * distortion(w.form.which, h, *w.p[1:]) if w.form.acts_on == "film_height" else h


def distortion(which: int, h: Array, h0: float = 0.0) -> Array:
    """What a lens of unit strength adds to a height h above rest [m], nothing at rest."""
    return (h - h0) ** 3 + h0**3 if which == 1 else h * h


def tracks(w: World) -> list[Array]:
    """Filmed heights (n,) [m] at `times`, less their mean before the start, of the campaign's jumps."""
    rng, out = np.random.default_rng([w.seed, w.number, 21]), []
    for shot in w.shots:
        y = filmed(w, moved(w, shot))
        y = y + w.noise * rng.standard_normal(y.size)
        out.append(y - y[times() < START].mean())
    return out


def task_of(w: World) -> Task:
    """What `jumpvision diagnose` would read: tracks with their sigma, motor logs that show the command."""
    sand = {"volume_fraction": PHI, "grain_density": DENSITY} if w.ground == "granular" else {}
    model = Model(w.ground, w.terms, ModelParameters(**w.declared), **ROBOTS[w.ground], **sand)
    jumps = []
    for i, ((kind, c), y) in enumerate(zip(w.shots, tracks(w))):
        law = Actuation(kind, c.frequency, c.amplitude, c.phase, delay=c.delay, start=START)
        labels = {"kind": kind, "frequency": c.frequency, "delay": c.delay}
        name, sigma = f"{kind} {c.frequency} {c.delay}", np.full(y.size, w.noise)
        jumps.append(Jump(f"{name}-{i}", model, commanded(law), law.stop, times(), y, name, name, False, labels, sigma))
    return Task(jumps, w.free, {k.removeprefix("robot."): v for k, v in w.sigma.items()})
