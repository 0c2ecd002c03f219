"""Whether a rod is pushed when its motor moves: what is said of the clocks of track and motor."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.schema import StageWarning
from jumpvision.estimate.push import FARTHEST, TICK, Push, Pushed, first_push
from jumpvision.experiment.inputs.sections import Actuation, MotorLog, Robot

from .rod import position_at, total_mass

LAG = 0.012  # s by which a motor may lag behind its law
LEAST = 0.003  # s by which a log may be off without a word
PACE = 0.3  # of the misfit that is left at another pace, from which this is it
BETTER = 2.0  # times: how much better another clock must fit


def pushes(name: str, t: Array, h: Array, robot: Robot, law: Actuation, log: MotorLog | None) -> Iterator[StageWarning]:
    """The clocks of the track, section `name`, and of what moves the motor."""
    mass = total_mass(robot)
    if not mass or not robot.motor_mass or not robot.spring_stiffness or not law.moves or not law.frequency:
        return
    good = np.isfinite(t) & np.isfinite(h)
    t, h = t[good], h[good]
    time = np.arange(min(t[0], law.start) - 2.0 * FARTHEST, max(t[-1], law.stop) + FARTHEST, TICK)
    x = position_at(time, law, log)
    if t.size < 20 or np.ptp(h) == 0.0 or x is None or np.ptp(x) == 0.0:
        return
    rate = math.sqrt(robot.spring_stiffness / mass)
    motor = Pushed(time, x, robot.motor_mass / mass, rate, 1.0 / law.frequency, robot.gravity / rate**2)
    found = motor.push(t, h)
    if found is None:
        return
    if not found.explained:
        yield from _mirrored(name, motor.push(t, -h), found)
        yield from _pace(name, motor, t, h, law, found)
        return
    yield from _clock(name, found, log is not None)


def _clock(name: str, found: Push, logged: bool) -> Iterator[StageWarning]:
    if abs(found.shift) < (LEAST if logged else LAG) or found.misfit < BETTER * found.best:
        return
    of = "motor_log" if logged else "actuation"
    yield StageWarning(
        "clock",
        f"[{of}] the rod of [{name}] is pushed {1e3 * abs(found.shift):.0f} ms "
        f"{'after' if found.shift > 0.0 else 'before'} the motor moves (rms {1e3 * found.misfit:.2g} mm as it is, "
        f"{1e3 * found.best:.2g} mm with the shift): are both on the common clock? Its times {found.shift:+.3f} s fit",
        of,
        {"shift_s": found.shift, "misfit_m": found.misfit, "shifted_m": found.best},
    )


def _mirrored(name: str, mirror: Push | None, as_is: Push) -> Iterator[StageWarning]:
    if mirror is not None and mirror.explained and mirror.best < PACE * as_is.best:
        yield StageWarning(
            "sign",
            f"[{name}] follows its motor upside down (rms {1e3 * mirror.best:.2g} mm, {1e3 * as_is.best:.2g} mm as it "
            "is): heights that point down, or a motor's position that is negated?",
            name,
            {"misfit_m": as_is.best, "mirrored_m": mirror.best},
        )


def _pace(name: str, motor: Pushed, t: Array, h: Array, law: Actuation, as_is: Push) -> Iterator[StageWarning]:
    """Where the rod follows its motor at another pace alone: twice or half of the frame rate."""
    near, before = first_push(t, h, motor.period, motor.slack)
    begin = float(t[near & ~before][0])
    for q in (2.0, 0.5):
        found = motor.push(law.start + q * (t - begin), h)
        if found is not None and found.best < PACE * as_is.best:
            yield StageWarning(
                "clock",
                f"[{name}] follows its motor only where its times are taken {q:g} times as long (rms "
                f"{1e3 * found.best:.2g} mm, {1e3 * as_is.best:.2g} mm as they are): is the frame rate {1 / q:g} times "
                "what is stated?",
                name,
                {"pace": q, "misfit_m": as_is.best, "stretched_m": found.best},
            )
            return
