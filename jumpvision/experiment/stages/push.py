"""Whether a rod is pushed when its motor moves: the clocks of track and motor, by the first push.

A motor of mass m_m that moves by X_m along a rod pushes it the other way: M y'' + c y' + k y = -m_m X_m'', with the
ground and the spring in k and c, which are fitted. In the Laplace plane y = -(m_m/M) s^2/(s^2 + (c/M) s + k/M) X_m.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.base.schema import StageWarning
from jumpvision.experiment.inputs.sections import Actuation, MotorLog, Robot

from .rod import position_at, total_mass

TICK = 5e-4  # s, of the motion that is filtered
FARTHEST = 0.08  # s by which clocks are tried to differ
LAG = 0.012  # s by which a motor may lag behind its law
LEAST = 0.003  # s by which a log may be off without a word
EXPLAINED = 0.1  # of the motion: a greater misfit, and it is not this motor that moves the rod
PACE = 0.3  # of the misfit that is left at another pace, from which this is it
BETTER = 2.0  # times: how much better another clock must fit


@dataclass(frozen=True)
class Push:
    """How a track follows its motor. shift [s]: what added to the motor's times fits best; misfit, best: rms [m] as the
    clocks are and at the best; size [m]: of the motion."""

    shift: float
    misfit: float
    best: float
    size: float

    @property
    def explained(self) -> bool:
        """Whether it is by this motor that the rod moves."""
        return self.best < EXPLAINED * self.size


@dataclass(frozen=True)
class Pushed:
    """A motor's X_m (m,) [m] at `time` [s], even to TICK, that moves share = m_m/M of the mass on a spring whose
    declared sqrt(k/M) is rate [rad/s]. period [s]: of its motion; slack [m]: height above rest where the spring
    is so."""

    time: Array
    x: Array
    share: float
    rate: float
    period: float
    slack: float

    def moved(self, w: float, damping: float) -> Array:
        """Height of the rod (m,) [m]."""
        from scipy.signal import bilinear, lfilter

        b, a = bilinear([self.share, 0.0, 0.0], [1.0, 2.0 * damping * w, w * w], 1.0 / TICK)
        return np.asarray(-lfilter(b, a, self.x - self.x[0]))

    def push(self, t: Array, h: Array) -> Push | None:
        """How a rod's height h (n,) [m] at t [s], from rest on, follows; None without a push or samples of it."""
        from scipy.optimize import least_squares

        near, before = _first(t, h, self.period, self.slack)
        if (near & ~before).sum() < 5 or before.sum() < 3:
            return None
        ts, y = t[near], h[near] - np.median(h[before])
        shifts, tried = np.arange(-FARTHEST, FARTHEST + 1e-9, 1e-3), []
        for w in self.rate * np.array([0.3, 0.5, 0.7, 0.9, 1.1, 1.4, 2.0]):
            for damping in (0.02, 0.2, 0.6):
                z = self.moved(w, damping)
                off = [float(np.sqrt(np.mean((y - np.interp(ts - s, self.time, z)) ** 2))) for s in shifts]
                k = int(np.argmin(off))
                tried.append((off[k], w, damping, float(shifts[k]), off[shifts.size // 2]))

        def residual(q: Array) -> Array:
            return np.asarray(y - np.interp(ts - q[2], self.time, self.moved(q[0], q[1])))

        low, high = [0.05 * self.rate, 0.0, -2.0 * FARTHEST], [4.0 * self.rate, 2.0, 2.0 * FARTHEST]
        fit = least_squares(residual, min(tried)[1:4], bounds=(low, high), x_scale=[self.rate, 1.0, 0.01])
        rms = math.sqrt(float(np.mean(fit.fun**2)))
        return Push(float(fit.x[2]), min(x[4] for x in tried), rms, float(np.ptp(y)))


def _first(t: Array, h: Array, period: float, slack: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(the samples of the rest and the first push, those of the rest), until the spring is slack."""
    begun = np.flatnonzero(np.abs(h - np.median(h[:5])) > 0.05 * np.ptp(h))
    begin = t[begun[0]] if begun.size else t[0]
    up = np.flatnonzero((h - np.median(h[:5]) > 0.8 * slack) & (t > begin))
    near = (t > begin - 0.1) & (t < begin + 0.3 * period) & (t < (t[up[0]] if up.size else math.inf))
    return near, near & (t < begin - 0.02)


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
    near, before = _first(t, h, motor.period, motor.slack)
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
