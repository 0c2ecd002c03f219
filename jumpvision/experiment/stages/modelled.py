"""Which one wrong entry makes a track of the declared model: robot and ground are declared, the motor is logged, and
the model is played with them. Where it misses the track, and one other number makes it follow, that number is doubted.

A model that is wrong otherwise (another ground, a hidden force) misses too, but no single number makes it follow.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from jumpvision.base.arrays import Array
from jumpvision.base.schema import StageWarning
from jumpvision.estimate.push import first_motion
from jumpvision.experiment.inputs.experiment import Experiment
from jumpvision.experiment.inputs.model import ModelSpec
from jumpvision.experiment.inputs.parameters import SimulateParams
from jumpvision.experiment.inputs.sections import Actuation, Bed, Motor, MotorLog, Robot
from jumpvision.experiment.results.tables import RodMotion
from jumpvision.experiment.results.values import BedHeight

from .simulate import build_model, driver, moved

BEYOND = 0.3  # s after the motor's stop until which motions are compared: later bounces repeat every error
FEWEST = 30  # samples of a track to compare
MISSED = 0.05  # of the motion, from which the robot's numbers are tried, which takes seconds
LEFT = 0.25  # of the misfit, that a scale may leave
FOUND = 0.08  # that another number may: hidden friction, lags and limits of a motor leave 0.1 to 0.25
PROMISING = 0.5  # at the nearest of FACTORS, from where the best is looked for
NEAR = 0.05  # of the motion, within which a model follows
CONFIRMS = 0.02  # of the motion: a clock off by 3 ms misses by 5 %
FACTORS = np.geomspace(1.0 / 12.0, 12.0, 17)  # of a robot's number; refined between
PACES = np.geomspace(0.25, 4.0, 71)  # of the track's clock
SHIFTS = np.linspace(-0.03, 0.03, 31)  # s, of its first motion
ROBOT = {"spring_stiffness": "N/m", "motor_mass": "kg"}
OTHER = 1.3  # factor on them that other causes may mimic
OTHER_PACE = 1.1  # of times, likewise: a mass off by 15 % is 4 %
OTHER_SCALE = 1.03  # of heights

Motion = tuple[Array, Array]  # s, m


@dataclass(frozen=True)
class Played:
    """A track h (n,) [m], zero at rest, at t [s], and what the model makes of a robot, from begin until `until`."""

    t: Array
    h: Array
    begin: float
    until: float
    model: Callable[[Robot], Motion]

    @property
    def early(self) -> Motion:
        """The part of the track that is compared as it is."""
        near = self.t < self.until
        return self.t[near], self.h[near]

    @property
    def size(self) -> float:
        """Of the motion [m]."""
        return float(np.ptp(self.early[1]))

    def misfit(self, robot: Robot) -> float:
        """rms [m] between track and model; inf where it has no solution."""
        t, h = self.early
        try:
            return rms(h - np.interp(t, *self.model(robot)))
        except (ValueError, RuntimeError):
            return math.inf

    def scaled(self, robot: Robot) -> tuple[float, float]:
        """(misfit [m], factor on the heights at which it is least)."""
        t, h = self.early
        y = np.interp(t, *self.model(robot))
        q = float(h @ y / max(float(h @ h), 1e-30))
        return rms(q * h - y), q

    def other(self, robot: Robot, key: str) -> tuple[float, float]:
        """(misfit [m], factor on a robot's number at which it is least)."""
        from scipy.optimize import minimize_scalar

        value = getattr(robot, key)

        def at(log_q: float) -> float:
            return self.misfit(replace(robot, **{key: value * math.exp(log_q)}))

        logs = np.log(FACTORS)
        coarse = [at(q) for q in logs]
        k = int(np.argmin(coarse))
        if not coarse[k] < PROMISING * at(0.0):
            return coarse[k], float(FACTORS[k])
        step = logs[1] - logs[0]
        fine = minimize_scalar(at, bounds=(logs[k] - step, logs[k] + step), method="bounded", options={"xatol": 3e-3})
        return float(fine.fun), math.exp(float(fine.x))

    def paced(self, robot: Robot) -> tuple[float, float]:
        """(misfit [m], factor on the track's times from its first motion on at which it is least)."""
        from scipy.optimize import minimize

        clock, y = self.model(robot)
        here, there = first_motion(self.t, self.h), first_motion(clock, y)

        def at(pace_shift: Array) -> float:
            tau = there + pace_shift[0] * (self.t - here) + pace_shift[1]
            near = (tau > self.begin) & (tau < self.until)
            if near.sum() < FEWEST:
                return math.inf
            apart = self.h[near] - np.interp(tau[near], clock, y)
            return rms(apart - np.median(apart))  # rest was sought before the motor starts by a wrong clock

        coarse = [(at(np.array([p, s])), p, s) for p in PACES for s in SHIFTS]
        fine = minimize(at, min(coarse)[1:], method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-7})
        return float(fine.fun), float(fine.x[0])


def rms(x: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(x**2)))


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
    span = RodMotion(pd.DataFrame({"time_s": [t[0], until], "height_m": 0.0, "sigma_m": 1.0}))
    known = spec

    def model(robot: Robot) -> Motion:
        table = moved(build_model(e, robot, known, section, bed), forcing, stop, span, p).table
        return table.time_s.to_numpy(), (table.rod_m - table.rod_m.iloc[0]).to_numpy()

    return Played(t[good], h[good] - np.median(h[rest]), law.start - 0.1, until, model)


def modelled(name: str, e: Experiment, rod: RodMotion, bed: BedHeight | None) -> tuple[bool, list[StageWarning]]:
    """(whether the declared model confirms the heights of the track, section `name`; what to doubt where it does not).
    Not confirmed and no doubt: nothing is known."""
    robot = e.section(Robot)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a run says what its simulation warns of
        try:
            found = played(e, rod, bed)
            missed = found.misfit(robot) if found and robot else math.inf
        except ValueError:
            return False, []
        if found is None or robot is None or not math.isfinite(missed):
            return False, []
        left, q = found.scaled(robot)
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
    off, pace = found.paced(robot)
    tried = []
    for key in ROBOT:
        left, q = found.other(robot, key)
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
