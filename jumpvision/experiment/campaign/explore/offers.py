"""The jumps that could be made next with a robot, within what its motor can do, as motions not yet measured: where, by
which command."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError, Toml, read
from jumpvision.engine.fitting import Problem
from jumpvision.experiment.campaign.jumps import spec_of
from jumpvision.experiment.inputs.experiment import Experiment
from jumpvision.experiment.inputs.logs import read_log
from jumpvision.experiment.inputs.sections import PHASES, Actuation, Bed, Motor, Robot
from jumpvision.experiment.stages.rod import commanded
from jumpvision.experiment.stages.simulate import build_model, feedback
from jumpvision.jumper.mechanisms.record import Mechanism
from jumpvision.jumper.physics.forcing import Spline
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.jumps import Jump

START, AFTER = 0.2, 0.8  # s: of rest before the motor, recorded after it
DELAYS = (0.05, 0.1, 0.2)  # s
PLACES = 3  # grounds, feet and packings of a campaign that jumps are offered on: a proposal's time goes with them
HALF_CYCLE = ("single", "stutter", "delayed_stutter")


@dataclass(frozen=True)
class Limits:
    """What the motor can do: travel [m], speed [m/s], acceleration [m/s^2]. said: by what, for messages."""

    travel: float
    speed: float
    acceleration: float
    said: str = "of the jumps that were run"

    def broken(self, law: Actuation, motion: Spline | None = None) -> list[str]:
        """What of a command, or of a motion in its place, the motor cannot do, in words."""
        travel, speed, acceleration = asked_of_motor(law, motion)
        rows = (
            ("travel", travel, self.travel, "m"),
            ("speed", speed, self.speed, "m/s"),
            ("acceleration", acceleration, self.acceleration, "m/s^2"),
        )
        return [
            f"{name} {x:.3g} {unit}: at most {most:.3g} {unit} ({self.said})"
            for name, x, most, unit in rows
            if x > 1.001 * most  # beyond what was run, but for rounded frequencies
        ]


def asked_of_motor(law: Actuation, motion: Spline | None = None) -> tuple[float, float, float]:
    """Travel [m], greatest speed [m/s] and acceleration [m/s^2] of a command, or of a table in its place, between its
    rows; steps of a law's speed are not counted."""
    if motion is not None:
        t, x = motion.knots, motion(motion.knots)[0]
        v = np.gradient(x, t)
        return float(np.ptp(x)), float(np.max(np.abs(v))), float(np.max(np.abs(np.gradient(v, t))))
    given = commanded(law)
    x, v = given(np.linspace(given.start, given.stop, 4001)[:-1])  # times enough for the extremes of a command
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
        if not far[0] and far[1] < 0.004:  # volume fractions nearer than this are one packing
            break
        taken.append(-i)
    return taken


Changes = Mapping[str, Toml]  # tables of experiment.toml, as --set has them


@dataclass(frozen=True)
class Place:
    """Where jumps are offered. base: a jump made there, or what it would be after `changes` of the bed or robot of the
    experiment `like` ("": the first jump's)."""

    base: Jump
    motor: Motor | None = None
    like: str = ""
    changes: Changes = field(default_factory=dict)

    @property
    def named(self) -> str:
        """In words, after the name of a jump; "" at the first jump's."""
        return (f" as {self.like}" if self.like else "") + (f" with {worded(self.changes)}" if self.changes else "")


def worded(changes: Changes) -> str:
    """bed.volume_fraction = 0.6, ..."""
    return ", ".join(f"{table}.{key} = {value}" for table, t in changes.items() for key, value in t.items())


def elsewhere(like: Experiment, base: Jump, changes: Changes, fitted: Sequence[str], first: bool) -> Place | str:
    """The place that changes of [bed] and [robot] of an experiment make; why a jump there cannot be weighed.

    fitted: parameters that the model fits. Raises InputError for changes that cannot be, and where nothing tells the
    bed's forces there.
    """
    where = f"explore --elsewhere {worded(changes)}"
    spec, problems, sections = spec_of(like), [], dict(like.sections)
    for table, values in changes.items():
        cls = {"bed": Bed, "robot": Robot}.get(table)
        if cls is None or (old := like.section(cls)) is None:
            has = ", ".join(n for n in ("bed", "robot") if n in like.sections)
            problems.append(f"{where}: [{table}]: must be a table of {like.name} that tells where it jumps: {has}")
            continue
        kept = {k: v for k, v in asdict(old).items() if v is not None and k != "sigma"}
        new, more = read(cls, {**kept, **values}, f"{where}: [{table}]")
        problems += more
        sections[table] = replace(new, sigma=old.sigma) if isinstance(old, Robot) and new else new
    bed = any(k in changes.get(t, {}) for t, k in (("bed", "volume_fraction"), ("robot", "foot_radius")))
    if bed and like.ground == "granular" and spec.laws is None:
        problems.append(
            f"{where}: [model.laws] of {like.name}: missing; nothing says what the forces of the bed are there: give "
            "the laws of the packing (docs/granular.md), or leave --elsewhere"
        )
    if problems:
        raise InputError(problems)
    if (section := sections.get("bed")) is not None and section.volume_fraction is None:  # measured
        sections["bed"] = replace(section, volume_fraction=base.model.volume_fraction)
    there = replace(like, sections=sections)
    robot = there.section(Robot)
    assert robot is not None  # a jump's
    try:
        model = build_model(there, robot, spec, there.section(Bed), None)
    except InputError as e:
        raise InputError([f"{where}: {p}" for p in e.problems]) from None
    for n in fitted:
        was, now = (getattr(m, n, None) or getattr(m.parameters, n, None) for m in (base.model, model))
        if was != now:
            return f"{worded(changes)}: {n} is fitted and would have another value there, of which nothing is known yet"
    return Place(replace(base, model=model), like.section(Motor), "" if first else like.name, changes)


def played(file: Path, first: float = START) -> Spline:
    """The motion of a planned command: time_s, and command_m (plan.csv) or position_m (motor_command.csv). first: when
    its first row is [s]. Raises InputError where it is none."""
    if not file.is_file():
        raise InputError([f"{file}: no such file; give a plan.csv, or a table with time_s and position_m"])
    with file.open(encoding="utf-8-sig", errors="replace") as head:
        column = "command_m" if "command_m" in head.readline() else "position_m"
    d = read_log(file, "time_s", column, at_least=8)
    t, x = d.time_s.to_numpy(), d[column].to_numpy()
    if np.ptp(x) == 0.0:
        raise InputError([f"{file}: {column}: nothing moves; give the motion of a jump"])
    shape = PchipInterpolator(t - t[0] + first, x - x[0])  # no ripples before the motion
    return Spline(shape.x, np.ascontiguousarray(shape.c))


class Way(NamedTuple):
    """A command and where it is offered (None: as the first jump); motion: what is played in place of the law; file: of
    which."""

    law: Actuation
    at: Place | None = None
    motion: Spline | None = None
    file: str = ""

    @property
    def named(self) -> str:
        """Of the jump, for folders."""
        return Path(self.file).stem.replace(" ", "-") if self.file else named(self.law)


def by_plan(file: Path, at: Place | None = None) -> Way:
    """The jump of a planned command. Raises InputError as `played`."""
    return Way(Actuation("custom", start=START), at, played(file), str(file.absolute()))


def unmade(base: Jump, way: Way, motor: Motor | None = None) -> Jump:
    """A jump of this command with the robot, the ground and the apparatus of another, its track not yet there. A motion
    without a law is logged when it is made."""
    law, forcing = way.law, way.motion or commanded(way.law)
    logged = way.motion is not None
    looped = (base.law or logged) and motor and motor.kp is not None
    drives = feedback(forcing, law, motor) if looped and motor else forcing
    frame = float(np.median(np.diff(base.t)))
    t = np.arange(0.0, forcing.stop + AFTER, frame)
    name = way.named + (way.at.named if way.at else "")
    blank: Array = np.zeros(t.size)
    return replace(
        base,
        name=name,
        forcing=drives,
        stop=forcing.stop,
        t=t,
        y=blank,
        group=name,
        condition=name,
        law=base.law and not logged,
        labels={"kind": law.kind, "frequency": law.frequency, "delay": law.delay},
        sigma=None,
        shared=replace(base.shared, lens=None),
    )


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
    new = [unmade(w.at.base if w.at else system.jumps[0], w, w.at.motor if w.at else None) for w in ways]
    wider = Jumper([*system.jumps, *new], ranges, priors, system.workers, own)
    ones = [np.ones(j.t.size) for j in wider.jumps]
    asked = problem.asked_of(wider.weighted(ones, system.scattering))
    return asked, list(range(len(system.jumps), len(wider.jumps)))
