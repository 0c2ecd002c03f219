"""Jumps that a muscle limits, by technique: squat, countermovement and catapult (thesis Fig 14)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.progress import watch
from jumpvision.jumper.physics.hard.muscle import TECHNIQUES, Leap, Muscle, leap

from .compute import RESULTS, Variable, dataset
from .study import Found, Row, Sweep, study

STRENGTHS = {"human": 2.3, "bush baby": 12.0, "insect": 58.0}  # ground force in weights, thesis section 1.2.2
COMPLIANCE = np.linspace(0.02, 0.98, 33)  # F_0 / (k travel): the spring's stretch under the muscle's whole force
SPEEDS = np.geomspace(1.5, 20.0, 24)  # v_max / sqrt(g travel)
SPEED = 5.0  # of the curves over the compliance; thesis tells none
SPRING = 0.5  # compliance of the curves over the power


@dataclass(frozen=True)
class Limited:
    """What the curves keep: v_max / sqrt(g travel) over the compliance, the compliance over the power; the travel."""

    speed: float
    compliance: float
    travel_m: float


@study("muscle", "hard", source="Fig 14", values=("amplitude",))
def muscle(s: Sweep) -> Found:
    """Squat, countermovement and catapult jumps of a muscle in series with a spring, over compliance and power.

    The robot's mass and gravity, its travel 2 A; without damping and mass of the leg.
    """
    travel = 2.0 * float(s.setup.values["amplitude"])
    rate = math.sqrt(s.robot.gravity * travel)
    weight = s.robot.mass * s.robot.gravity
    points = [(c, SPEED) for c in COMPLIANCE] + [(SPRING, v) for v in SPEEDS]
    found = {
        (name, technique): [_leap(s, technique, n * weight, v * rate, c, travel) for c, v in points]
        for name, n in watch(list(STRENGTHS.items()), "strengths")
        for technique in TECHNIQUES
    }
    shape = (len(STRENGTHS), len(TECHNIQUES), len(points))
    whole = {n: np.array([[getattr(x, n) for x in row] for row in found.values()]).reshape(shape) for n in Leap._fields}
    first, rest = np.split(np.arange(len(points)), [COMPLIANCE.size])
    own = _results({n: v[..., first] for n, v in whole.items()}, s.robot.gravity, SPEED * rate)
    power = np.array([[Muscle(n * weight, v * rate).power for v in SPEEDS] for n in STRENGTHS.values()])
    over = ("strength", "technique")
    extra: dict[str, Variable] = {
        "relative_height": ((*over, "compliance"), whole["height"][..., first] / travel, "1", "com_height / travel"),
        "height_by_speed": ((*over, "speed"), whole["height"][..., rest] / travel, "1", "com_height / travel"),
        "power_W": (("strength", "speed"), power, "W", "the greatest of the muscle"),
        "used_power_W": ((*over, "speed"), whole["peak_power"][..., rest], "W", "the greatest that the jump takes"),
    }
    data = dataset(
        s,
        {"strength": list(STRENGTHS), "technique": list(TECHNIQUES), "compliance": COMPLIANCE, "speed": SPEEDS},
        (*over, "compliance"),
        own,
        extra,
        facts=Limited(SPEED, SPRING, travel),
    )
    return data, _table(s, whole["height"][..., first] / travel)


def _leap(s: Sweep, technique: str, force: float, speed: float, compliance: float, travel: float) -> Leap:
    given = {"mass": s.robot.mass, "gravity": s.robot.gravity, "stiffness": force / (compliance * travel)}
    return leap(technique, Muscle(force, speed), **given, travel=travel)


def _results(own: dict[str, Array], gravity: float, speed: float) -> dict[str, Array]:
    """By the names of RESULTS; the foot has no mass, so that what rises is the body."""
    jumps = np.isfinite(own["height"])
    rise = np.where(jumps, own["speed"] ** 2 / (2.0 * gravity), np.nan)
    given = {"com_height_m": own["height"], "jump_height_m": own["height"], "flight_height_m": rise}
    given |= {"lift_off_s": own["lift_off"], "peak_power_W": own["peak_power"], "peak_force_N": own["peak_force"]}
    given |= {"n_jumps": jumps.astype(float), "peak_motor_speed": np.full(jumps.shape, speed)}
    return {n: given[n] for n in RESULTS}


def _table(s: Sweep, height: Array) -> list[Row]:
    """Which technique is the highest, in means over the compliances at which all jump. height: over travel."""
    thesis = {
        "human": "the squat the lowest; catapult and countermovement alike",
        "bush baby": "the squat the lowest; the catapult above the countermovement",
        "insect": "the catapult the highest by far",
    }
    rows = []
    for name, h in zip(STRENGTHS, height):
        all_jump = np.isfinite(h).all(axis=0)
        mean = h[:, all_jump].mean(axis=1)
        lowest = (h[0, all_jump] <= h[1:, all_jump].min(axis=0) + 1e-3 * h[0, all_jump]).mean()
        text = f"{mean[0]:.2f}, {mean[1]:.2f}, {mean[2]:.2f}; squat the lowest at {lowest:.0%} of the compliances"
        rows.append(s.number(f"{name}, {STRENGTHS[name]:g} weights: squat, countermovement, catapult / travel", text))
        rows[-1]["thesis"] = thesis[name] if s.setup.thesis else ""
    return rows
