"""Campaigns of the laboratory that hide none to four mechanisms, or a law of no list, drawn from a seed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from jumpvision.laboratory.blind import EFFECTS, Nuisance, Recorded, Setting, campaign, choices, draw

from .camera_and_rail import LAWS, NAMES, seen

SEED, CASES = 21, 240
KINDS = (
    "none",
    "one",
    "two",
    "three",
    "four",
    "outside",
    "instrument",
    "single trial",
)  # in turn, by the case's number
INSTRUMENTS = {"none": {}, "AR 0.7": {"rho": 0.7}, "t3": {"family": "t3"}, "rounded": {"step": 1e-4}}
NOISES = {**INSTRUMENTS, "outliers": {"family": "outliers"}}
STATIC = ("two_resistance", "rft_cone")


@dataclass(frozen=True)
class Truth:
    """hidden: mechanisms, () for none; outside: a law of no vocabulary; strengths: 0 weak .. 1 strong of each."""

    number: int
    kind: str
    ground: str
    hidden: tuple[str, ...]
    outside: str
    strengths: tuple[float, ...]
    amplitude: float
    noise: float
    instrument: str


def truth(number: int, seed: int = SEED) -> Truth:
    """What campaign `number` hides."""
    rng = np.random.default_rng([seed, 210, number])
    kind = KINDS[number % len(KINDS)]
    ground = ("hard", "granular")[number // len(KINDS) % 2]
    noise = (5e-5, 2e-4)[number // (2 * len(KINDS)) % 2]
    count = {"one": 1, "two": 2, "three": 3, "four": 4, "instrument": 1, "single trial": 2}.get(kind, 0)
    instrument = str(rng.choice([n for n in INSTRUMENTS if n != "none"])) if kind == "instrument" else "none"
    if kind == "outside":
        name = NAMES[number // len(KINDS) % len(NAMES)]
        law = LAWS[name]
        amplitude = law.weak * (law.strong / law.weak) ** float(rng.uniform())
        return Truth(number, kind, "hard", (), name, (), amplitude, noise, instrument)
    allowed = [h for h in choices(ground) if h not in STATIC and h not in LATER]
    for _ in range(1000):
        hidden = tuple(str(h) for h in rng.choice(allowed, count, replace=False))
        # a lag can be seen only where the command drives the model, an offset of the clock is then its twin
        if not {"motor_lag", "time_offset"} <= set(hidden):
            break
    return Truth(number, kind, ground, hidden, "", tuple(rng.uniform(0.4, 0.9, count).tolist()), 0.0, noise, instrument)


LATER = ("drive_play", "stroke_limit", "speed_limit", "loop_bandwidth")  # came after the truths were sealed


def made(t: Truth, seed: int = SEED) -> tuple[Setting, list[Recorded]]:
    """The campaign's declared model and its recordings."""
    rng = np.random.default_rng([seed, 211, t.number])
    nuisance = Nuisance(t.noise, **{"rho": 0.0, "step": 0.0} | NOISES[t.instrument])
    setting = draw(rng, ground=t.ground, hidden=t.hidden, strength=0.5, nuisance=nuisance)
    values = {n: v for h, s in zip(t.hidden, t.strengths) for n, v in drawn(h, s, setting).items()}
    p = setting.protocol
    p = replace(p, parameters={**p.parameters, **values})
    setting = replace(setting, protocol=p, parameters={**setting.parameters, **values}, strength=t.strengths)
    recorded = campaign(setting, rng)
    return setting, [_foreign(t, setting, r, rng) for r in recorded] if t.outside else recorded


def drawn(name: str, level: float, setting: Setting) -> dict[str, float]:
    """An effect's parameters at its own level, of the sign that the setting has drawn."""
    out = {}
    for key, (weak, strong, _) in EFFECTS[name].drawn.items():
        origin = 1.0 if key in ("factor", "scale") else 0.0
        weak, strong = (weak - 1.0, strong - 1.0) if key == "factor" else (weak, strong)
        sign = math.copysign(1.0, setting.parameters[key] - origin)
        out[key] = origin + sign * weak * (strong / weak) ** level
    return out


def _foreign(t: Truth, setting: Setting, r: Recorded, rng: np.random.Generator) -> Recorded:
    """The recording of a jump that obeys a law of no vocabulary."""
    p, robot = setting.protocol, setting.protocol.robot
    stiffness = robot.spring_stiffness + p.parameters.get("dk", 0.0)
    mass = robot.motor_mass + robot.rod_mass
    values = np.array([robot.motor_mass, mass, robot.gravity, stiffness, robot.spring_damping])
    time_s = r.track["time_s"]
    y = seen(t.outside, t.amplitude, time_s, r.jump.law, values, p.parameters.get("e", 0.0))
    return replace(r, track={**r.track, "height_m": y + t.noise * rng.standard_normal(y.size)})
