"""Which one wrong entry makes a track of the declared model: robot and ground are declared, the motor is logged, and
the model is played with them. Where it misses the track, and one other number makes it follow, that number is doubted.

A model that is wrong otherwise (another ground, a hidden force) misses too, but no single number makes it follow.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from jumpvision.base.schema import StageWarning
from jumpvision.estimate.slip import FEWEST, Motion, Played
from jumpvision.experiment.inputs.experiment import Experiment
from jumpvision.experiment.inputs.model import ModelSpec
from jumpvision.experiment.inputs.parameters import SimulateParams
from jumpvision.experiment.inputs.sections import Actuation, Bed, Motor, MotorLog, Robot
from jumpvision.experiment.results.tables import RodMotion
from jumpvision.experiment.results.values import BedHeight

from .simulate import build_model, courses, driver

BEYOND = 0.3  # s after the motor's stop until which motions are compared: later bounces repeat every error
MISSED = 0.05  # of the motion, from which the robot's numbers are tried, which takes seconds
LEFT = 0.25  # of the misfit, that a scale may leave
FOUND = 0.08  # that another number may: hidden friction, lags and limits of a motor leave 0.1 to 0.25
NEAR = 0.05  # of the motion, within which a model follows
CONFIRMS = 0.02  # of the motion: a clock off by 3 ms misses by 5 %
ROBOT = {"spring_stiffness": "N/m", "motor_mass": "kg"}
OTHER = 1.3  # factor on them that other causes may mimic
OTHER_PACE = 1.1  # of times, likewise: a mass off by 15 % is 4 %
OTHER_SCALE = 1.03  # of heights


def played(e: Experiment, rod: RodMotion, bed: BedHeight | None) -> Played | None:
    """The model of [model] over the time of the track until BEYOND after the motor's stop; None without one whose
    values are all given, or without a rest to begin at."""
    robot, spec, law, log = e.section(Robot), e.section(ModelSpec), e.section(Actuation), e.section(MotorLog)
    if robot is None or spec is None or spec.fit.keys() - spec.parameters.keys() or not (law and law.moves):
        return None
    p, section = SimulateParams(), e.section(Bed)
    forcing, stop = driver(log, law, e.section(Motor), p, sand=e.ground == "granular")
    until = stop + BEYOND
    t, h = rod.arrays[:2]
    good = np.isfinite(t) & np.isfinite(h)
    rest = good & (t < law.start)
    if rest.sum() < 3 or (good & ~rest & (t < until)).sum() < FEWEST:
        return None
    span, known, declared = np.array([t[0], until]), spec, robot

    def model(numbers: Mapping[str, float]) -> Motion:
        changed: dict[str, Any] = dict(numbers)
        other = replace(declared, **changed)
        times, height, *_ = courses(build_model(e, other, known, section, bed), forcing, stop, span, p)
        return times, height - height[0]

    return Played(t[good], h[good] - np.median(h[rest]), law.start - 0.1, until, model)


def modelled(name: str, e: Experiment, rod: RodMotion, bed: BedHeight | None) -> tuple[bool, list[StageWarning]]:
    """(whether the declared model confirms the heights of the track, section `name`; what to doubt where it does not).
    Not confirmed and no doubt: nothing is known."""
    robot = e.section(Robot)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a run says what its simulation warns of
        try:
            found = played(e, rod, bed)
            missed = found.misfit() if found else math.inf
        except ValueError:
            return False, []
        if found is None or robot is None or not math.isfinite(missed):
            return False, []
        left, q = found.scaled()
        off = not 1.0 / OTHER_SCALE < q < OTHER_SCALE
        if not off and missed < CONFIRMS * found.size:
            return True, []
        most = min(LEFT * missed, NEAR * found.size)
        if off and left < most * min(abs(q), 1.0):
            return False, [_scale(name, missed, left, q)]
        most = min(FOUND * missed, NEAR * found.size)
        return False, _otherwise(name, found, robot, missed, most) if missed > MISSED * found.size else []


def _missed(name: str, missed: float) -> str:
    return f"[{name}] the declared model misses the height by {1e3 * missed:.3g} mm (rms)"


def _scale(name: str, missed: float, left: float, q: float) -> StageWarning:
    remedy = "heights that point down, or a negated motor?" if q < 0.0 else "scale, or another unit?"
    said = f"{_missed(name, missed)}, and by {1e3 * left:.2g} mm where the heights are taken {q:.3g} times: {remedy}"
    values = {"missed_m": missed, "left_m": left, "factor": q}
    return StageWarning("sign" if q < 0.0 else "scale", said, name, values)


def _otherwise(name: str, found: Played, robot: Robot, missed: float, most: float) -> list[StageWarning]:
    """Another clock, or another number of [robot], by which the model follows: what fits best."""
    off, pace = found.paced()
    tried = []
    for key in ROBOT:
        left, q = found.other(key, getattr(robot, key))
        if left < most and not 1.0 / OTHER < q < OTHER:
            tried.append((left, key, q * getattr(robot, key)))
    tried.sort()
    if off < min([most, *(left for left, _, _ in tried)]) and not 1.0 / OTHER_PACE < pace < OTHER_PACE:
        said = (
            f"{_missed(name, missed)}, and by {1e3 * off:.2g} mm where its times are taken {pace:.3g} times as long: "
            f"is the frame rate {1.0 / pace:.3g} times what is stated?"
        )
        return [StageWarning("clock", said, name, {"missed_m": missed, "left_m": off, "pace": pace})]
    if not tried:
        return []
    fits = " or ".join(f"{key} = {value:.3g} {ROBOT[key]} (to {1e3 * left:.2g} mm)" for left, key, value in tried)
    values = {"missed_m": missed} | {key: value for _, key, value in tried}
    return [StageWarning("differs", f"{_missed(name, missed)}; with {fits} it follows: check [robot]", "robot", values)]
