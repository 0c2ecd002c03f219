"""Where to start from: a sinusoidal thrust that the simulator carries out, cut at its events into the plan's phases."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.physics.forcing import Forcing, Loop, Segments, sinusoid
from jumpvision.physics.sand.jump import simulate

from .jumper import AIR, INTRUDE, STUCK, Jumper
from .transcription import SHORTEST, Guess

END = {
    STUCK: {AIR: "lift_off", INTRUDE: "intrude"},
    INTRUDE: {STUCK: "stop"},
    AIR: {STUCK: "landing", INTRUDE: "landing"},
}
STEP = 5e-4  # s
ONE_THRUST = ((1, 1.0, (0.8, 1.2, 0.6, 1.6)), (1, 1.6, (0.8, 1.2, 1.6)))  # cycles, size, paces (of the spring's)
PUMPED = ((2, 0.3, (0.8, 1.0, 1.2)), (3, 0.3, (0.8, 1.0)))
PUSH, PULL = 1.5 * math.pi, 0.5 * math.pi  # start phases [rad]: a single thrust, and a pull before it


def starts(jumper: Jumper, apex: float, stroke: float) -> Iterator[Segments]:
    """Commands to start from, 24, the likeliest first: one thrust with or without a pull, then two or three in a row.

    X_c = A [sin(2 pi f t + phase) - sin(phase)]; the first amplitude gives about the apex [m]. On hard ground, and
    under a power limit, the highest jumps pump the spring over some cycles, which no start from one thrust finds.
    """
    m = jumper.model
    rate = math.sqrt(m.k_s / m.M)
    usual = min(0.7 * math.sqrt(2.0 * m.g * apex) / rate, 0.45 * stroke)
    for cycles, size, paces in ONE_THRUST[:1] + PUMPED + ONE_THRUST[1:]:
        for pace in paces:
            for phase in (PUSH, PULL):
                yield sinusoid(pace * rate / (2 * math.pi), min(size * usual, 0.5 * stroke), phase, cycles)


def guessed(jumper: Jumper, sequence: tuple[str, ...], command: Forcing) -> Guess:
    """The guess that a command makes: its simulated motion, cut at the events into the phases of the sequence.

    An event that does not come in order gives its phase the shortest duration.
    """
    d, m = jumper.drive, jumper.model
    swing = 2 * math.pi * math.sqrt(m.M / m.k_s)
    t = np.arange(0.0, command.stop + 3 * swing, STEP)
    motion = simulate(m, Loop(command, d.kp, d.kd) if d.kp > 0 else command, t=t, rtol=1e-7, atol=1e-9)
    X = motion.motor - motion.rod
    speed, ratio = np.gradient(X, t), m.m_m / m.M

    def sample(at: Array) -> Mapping[str, Array]:
        x_c, v_c = command(at)
        a_c = (command(at + STEP)[1] - command(np.maximum(at - STEP, 0.0))[1]) / (2 * STEP)
        x, v, rod, rod_rate, x_f, v_f = (
            np.interp(at, t, a) for a in (X, speed, motion.rod, motion.rod_velocity, motion.foot, motion.foot_velocity)
        )
        return {
            "y": rod + ratio * x,
            "w": rod_rate + ratio * v,
            "X": x,
            "V": v,
            "x_f": x_f,
            "v_f": v_f,
            "x_c": x_c,
            "v_c": v_c,
            "a_c": a_c,
        }

    phases: list[tuple[float, float]] = []
    now, first = 0.0, 0
    for mode, following in zip(sequence, (*sequence[1:], None)):
        end = now + SHORTEST
        if following is None:
            end = max(command.stop, now + 0.5 * swing)
        elif mode == AIR and following == AIR:
            falls = np.flatnonzero((t > now) & (motion.rod_velocity <= 0))
            end = max(float(t[falls[0]]) if falls.size else 0.0, end)
        else:
            for n in range(first, len(motion.events)):
                if motion.events[n]["kind"] == END[mode][following]:
                    end, first = max(float(motion.events[n]["time"]), end), n + 1
                    break
        phases.append((now, end))
        now = end
    return Guess(phases, sample)
