"""The jumps that could be made next with a robot, within what its motor can do, as motions not yet measured."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.diagnosis.fitting import Problem
from jumpvision.diagnosis.jumper.jumper import Jumper
from jumpvision.diagnosis.jumper.jumps import Jump
from jumpvision.inputs.sections import PHASES, Actuation, Motor
from jumpvision.mechanisms.record import Mechanism
from jumpvision.stages.rod import commanded
from jumpvision.stages.simulate import feedback

START, AFTER = 0.2, 0.8  # s: of rest before the motor, recorded after it
FINE = 4001  # times at which a command is looked at
ROUND = 1.001  # limits of what was run, for rounded frequencies
DELAYS = (0.05, 0.1, 0.2)  # s
ALIKE = 0.004  # volume fractions nearer than this are one packing
PLACES = 3  # grounds, feet and packings of a campaign that jumps are offered on: a proposal's time goes with them
HALF_CYCLE = ("single", "stutter", "delayed_stutter")


@dataclass(frozen=True)
class Limits:
    """What the motor can do: travel [m], speed [m/s], acceleration [m/s^2]. said: by what, for messages."""

    travel: float
    speed: float
    acceleration: float
    said: str = "of the jumps that were run"

    def broken(self, law: Actuation) -> list[str]:
        """What of a command the motor cannot do, in words."""
        travel, speed, acceleration = asked_of_motor(law)
        rows = (
            ("travel", travel, self.travel, "m"),
            ("speed", speed, self.speed, "m/s"),
            ("acceleration", acceleration, self.acceleration, "m/s^2"),
        )
        return [
            f"{name} {x:.3g} {unit}: at most {most:.3g} {unit} ({self.said})"
            for name, x, most, unit in rows
            if x > ROUND * most
        ]


def asked_of_motor(law: Actuation) -> tuple[float, float, float]:
    """Travel [m], greatest speed [m/s] and acceleration [m/s^2] of a command; steps of its speed are not counted."""
    motion = commanded(law)
    x, v = motion(np.linspace(motion.start, motion.stop, FINE)[:-1])
    omega = 2 * math.pi * (law.frequency or 0.0)
    return float(np.ptp(x)), float(np.max(np.abs(v))), (law.amplitude or 0.0) * omega**2


def limits_of(laws: Sequence[Actuation], motor: Motor | None, mass: float | None = None, weight: float = 0.0) -> Limits:
    """Those of [motor] where they are given, else what was run. mass [kg], weight [N]: of what its
    force moves."""
    run = np.max([asked_of_motor(law) for law in laws], axis=0)
    given = motor or Motor()
    force = given.max_force
    by_force = max(force - weight, 0.0) / mass if force is not None and mass else None
    most = [g if g is not None else float(r) for g, r in zip((given.stroke, given.max_speed, by_force), run)]
    said = "of [motor] and of the jumps that were run" if (given.stroke or given.max_speed or by_force) else Limits.said
    return Limits(most[0], most[1], most[2], said)


def usual(laws: Sequence[Actuation], *, start: float = START) -> list[Actuation]:
    """Half-cycle jumps of the campaign's amplitude over kinds, frequencies about those done, and delays."""
    known = [law for law in laws if law.frequency and law.amplitude]
    if not known:
        return []
    amplitude = float(np.median([law.amplitude for law in known if law.amplitude]))
    return [_law(k, f, amplitude, 1.0, d, start) for k in HALF_CYCLE for f in _frequencies(known) for d in _delays(k)]


def every(laws: Sequence[Actuation], limits: Limits, *, start: float = START) -> list[Actuation]:
    """Jumps of all motions that the motor can do: the usual ones with other amplitudes, more cycles, other phases."""
    known = [law for law in laws if law.frequency and law.amplitude]
    if not known:
        return []
    most, f = max(law.amplitude or 0.0 for law in known), _frequencies(known)
    out = list(usual(laws, start=start))
    for share in (0.5, 0.75, 1.5):
        out += [_law(k, x, share * most, 1.0, 0.0, start) for k in ("single", "stutter") for x in f[::2]]
    out += [_law(k, x, most, 2.0, 0.0, start) for k in ("single", "stutter") for x in f[::2]]
    out += [_law("sine", x, most, c, 0.0, start) for x in f[::2] for c in (1.0, 3.0)]
    return [law for law in dict.fromkeys(out) if not limits.broken(law)]


def _law(kind: str, frequency: float, amplitude: float, cycles: float, delay: float, start: float) -> Actuation:
    phase = PHASES[kind]
    return Actuation(kind, frequency, round(amplitude, 6), round(phase, 8), cycles, delay, start=start)


def _frequencies(known: Sequence[Actuation]) -> list[float]:
    f = [law.frequency for law in known if law.frequency]
    return [float(x) for x in np.linspace(0.8 * min(f), 1.25 * max(f), 9).round(1)]


def _delays(kind: str) -> tuple[float, ...]:
    return DELAYS if kind == "delayed_stutter" else (0.0,)


def named(law: Actuation) -> str:
    """Of a jump, for folders: stutter-9Hz-4mm, with cycles and delay where they tell."""
    text = f"{law.kind}-{law.frequency:g}Hz-{1e3 * (law.amplitude or 0.0):.4g}mm"
    return text + (f"-{law.cycles:g}cycles" if law.cycles != 1.0 else "") + (f"-{law.delay:g}s" if law.delay else "")


def places(jumps: Sequence[Jump], most: int = PLACES) -> list[int]:
    """A jump of each ground, foot and packing of a campaign, the first one's first, then others of another ground or
    foot, then those of the packing farthest from all taken; at most so many."""
    taken = [0]

    def apart(i: int, k: int) -> tuple[bool, float]:
        a, b = jumps[i].model, jumps[k].model
        other = (a.ground, a.foot_radius) != (b.ground, b.foot_radius)
        return other, abs((a.volume_fraction or 0.0) - (b.volume_fraction or 0.0))

    while len(taken) < most:
        far, i = max((min(apart(i, k) for k in taken), -i) for i in range(len(jumps)))
        if not far[0] and far[1] < ALIKE:
            break
        taken.append(-i)
    return taken


def unmade(base: Jump, law: Actuation, motor: Motor | None = None, name: str = "") -> Jump:
    """A jump of this command with the robot, the ground and the apparatus of another, its track not yet there."""
    forcing = commanded(law)
    drives = feedback(forcing, law, motor) if base.law and motor and motor.kp is not None else forcing
    frame = float(np.median(np.diff(base.t)))
    t = np.arange(0.0, law.stop + AFTER, frame)
    labels = {"kind": law.kind, "frequency": law.frequency, "delay": law.delay}
    name = name or named(law)
    blank: Array = np.zeros(t.size)
    return replace(
        base,
        name=name,
        forcing=drives,
        stop=law.stop,
        t=t,
        y=blank,
        group=name,
        condition=name,
        labels=labels,
        sigma=None,
        shared=replace(base.shared, lens=None),
    )


class Way(NamedTuple):
    """A command, and the jump (its number in the system) on whose ground, with whose foot and [motor] it is offered."""

    law: Actuation
    place: int = 0
    motor: Motor | None = None


def offer(
    problem: Problem,
    system: Jumper,
    ways: Sequence[Way],
    ranges: Mapping[str, tuple[float, float]],
    priors: Mapping[str, float],
    own: Sequence[Mechanism] = (),
) -> tuple[Problem, list[int]]:
    """(the jumps made with these beside them, places of these): a system that foretells them with the same noise.

    ranges, priors, own: those that `system` was made with.
    """
    new = []
    for law, i, motor in ways:
        base = system.jumps[i]
        new.append(unmade(base, law, motor, f"{named(law)} as {base.name}" if i else ""))
    wider = Jumper([*system.jumps, *new], ranges, priors, system.workers, own)
    ones = [np.ones(j.t.size) for j in wider.jumps]
    asked = problem.asked_of(wider.weighted(ones, system.scattering))
    return asked, list(range(len(system.jumps), len(wider.jumps)))
