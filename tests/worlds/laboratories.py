"""The campaigns: each recording with what was true of it, followed by the laboratory's own solver.

How large a fault is follows from what could be seen of it: `detectable` is the size at which chi^2 of the declared
model, its free numbers re-fitted, would fall by THRESHOLD if the number that varies were left free as it varies.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from scipy.signal import lfilter

from jumpvision.base.arrays import Array
from jumpvision.engine.system import Circumstances
from jumpvision.jumper.question.jumps import Jump as Question
from jumpvision.laboratory import recordings as logs
from jumpvision.laboratory.blind import EFFECTS, Nuisance, Recorded, Setting, draw
from jumpvision.laboratory.jumper import Law, Motion, Robot, Samples, motion_of
from jumpvision.laboratory.protocol import Jump, MotorLog, Records, RodTrack
from jumpvision.laboratory.recordings import seen_rod

from .faults import NOISE, Entry, Truth, name_of, ordered, plain
from .hidden import drawn
from .hidden import made as plain_made
from .jumps import Task, jumps_of

THRESHOLD = 30.0
FINE, COARSE = (5e-6, 20), (1e-5, 10)  # s, steps between samples: 0.1 ms, straight lines between them to 1e-7 m
PLAYED = 2e4  # 1/s, samples of a command through play
MS10 = 0.01  # s: a start that varies by 1 does so by this
VIBRATION = np.array([1.0, -1.2, 0.6])  # e_n = 1.2 e_(n-1) - 0.6 e_(n-2) + fresh: a stand that rings
RHO = {"AR 0.6": 0.6}
FREE = {  # of the declared model: name -> relative standard uncertainty that is stated of it
    "granular": {"k1": 0.01, "alpha": math.inf, "spring": 0.005},
    "hard": {"landing": math.inf, "spring": 0.005},
}


@dataclass(frozen=True)
class Shot:
    """One recording. jump: as its experiment.toml says; law: what drove it, through `play` [m]; parameters: true;
    scale: of the camera, reported over true height."""

    jump: Jump
    law: Law
    robot: Robot
    parameters: dict[str, float]
    scale: float = 1.0
    play: float = 0.0
    slack: float = 0.5


@dataclass(frozen=True)
class World:
    """A campaign made. task: what the analysis gets; size: of the fault; shots with it; ruler: what measured that."""

    truth: Truth
    setting: Setting
    task: Task
    size: float
    shots: tuple[Shot, ...] = ()
    ruler: Ruler | None = None


def made(t: Truth, seed: int) -> World:
    """Campaign `t`, with its fault."""
    rng = np.random.default_rng([seed, 511, t.number])
    if t.part == "plain":
        setting, recorded = plain_made(plain(t.number, seed), seed)
        return World(t, setting, task_of(t, setting, recorded), 0.0)
    setting = setting_of(t, rng)
    clean = shots(setting)
    ruler = Ruler.of(t, setting, clean) if t.factor else None
    size = t.factor * detectable(ruler) if ruler else t.scatter
    faulty = put(t, clean, size)
    recorded = [filmed(t, setting, s, i, rng) for i, s in enumerate(faulty)]
    return World(t, setting, task_of(t, setting, recorded), size, tuple(faulty), ruler)


def setting_of(t: Truth, rng: np.random.Generator) -> Setting:
    """The robot, the sand and the declared model, drawn by the laboratory's game; the campaign's own jumps."""
    hidden = (t.force,) if t.force else ()
    setting = draw(rng, ground=t.ground, hidden=hidden, strength=0.5, nuisance=Nuisance(NOISE, 0.0, 0.0))
    values = drawn(t.force, t.level, setting) if t.force else {}
    log = MotorLog() if t.logged else None
    p = replace(
        setting.protocol, jumps=tuple(ordered(t)), parameters={**setting.protocol.parameters, **values},
        records=Records(rod_track=track_of(t), motor_log=log),
    )  # fmt: skip
    return replace(setting, protocol=p, parameters={**setting.parameters, **values})


def track_of(t: Truth) -> RodTrack:
    """What the instrument does; the noise of the ringing stand is not the laboratory's."""
    family = t.instrument if t.instrument in ("t3", "outliers") else "white"
    noise = 0.0 if t.instrument == "vibration" else NOISE
    return RodTrack(t.rate, noise, RHO.get(t.instrument, 0.0), family=family, stated=t.stated)


def shots(setting: Setting) -> list[Shot]:
    """The campaign without its fault."""
    p = setting.protocol
    true = {n: v for n, v in p.parameters.items() if isinstance(v, float)}
    return [Shot(j, j.law, p.robot, true) for j in p.jumps if isinstance(j.law, Law)]


# ------------------------------------------------------------------------------------------------------------- faults
def put(t: Truth, clean: Sequence[Shot], size: float) -> list[Shot]:
    """The shots with what varies at a size: relative changes, of a start in units of 10 ms; of play its width [m]."""
    if t.slack is not None:
        return [replace(s, play=size, slack=t.slack) for s in clean]
    out = list(clean)
    for name, change in (t.changes or {}).items():
        out = [changed(s, name, size * c) if c else s for s, c in zip(out, change)]
    held = dict(t.filed)
    return [replace(s, law=clean[held[i]].law) if i in held else s for i, s in enumerate(out)]


def changed(s: Shot, name: str, by: float) -> Shot:
    """A shot with one number relatively greater by so much."""
    p, law = s.parameters, s.law
    match name:
        case "amplitude":
            return replace(s, law=law._replace(amplitude=law.amplitude * (1.0 + by)))
        case "frequency":
            return replace(s, law=law._replace(frequency=law.frequency * (1.0 + by)))
        case "start":
            return replace(s, law=law._replace(start=law.start + MS10 * by))
        case "scale":
            return replace(s, scale=s.scale * (1.0 + by))
        case "spring":
            return replace(s, parameters={**p, "dk": p["dk"] + by * (s.robot.spring_stiffness + p["dk"])})
        case "bed":
            return replace(s, parameters={**p, "k1": p["k1"] * (1.0 + by), "k2": p["k2"] * (1.0 + by)})
    key = {"landing": "e"}.get(name, name)
    return replace(s, parameters={**p, key: p[key] * (1.0 + by)})


def played(law: Law, width: float, slack: float) -> Samples:
    """What goes through play: it stands still until the drive has crossed it. slack: where in it the drive begins."""
    x = command(law)(law.start + np.arange(math.ceil((law.stop - law.start) * PLAYED) + 1) / PLAYED)
    out = np.empty_like(x)
    at = 0.0
    for i, drive in enumerate(x):  # it is pushed by one flank or the other
        at = min(max(at, drive - (1.0 - slack) * width), drive + slack * width)
        out[i] = at
    return Samples(out, PLAYED, law.start)


def command(law: Law) -> Callable[[Array], Array]:
    """X_m [m] at times (n,) [s], held during the delay and after the stop."""
    half = 0.5 / law.frequency

    def at(t: Array) -> Array:
        u = np.clip(t - law.start, 0.0, law.cycles / law.frequency + law.delay)
        u = np.where(u < half, u, np.maximum(u - law.delay, half)) if law.delay else u
        return np.asarray(law.amplitude * (np.sin(2 * np.pi * law.frequency * u + law.phase) - np.sin(law.phase)))

    return at


# -------------------------------------------------------------------------------------------------------- recordings
def moved(setting: Setting, s: Shot, step: tuple[float, int] = FINE, duration: float = math.inf) -> Motion:
    """The motion of a shot, for as long as it is filmed, or for this long [s]."""
    p = setting.protocol
    return motion_of(
        s.robot, played(s.law, s.play, s.slack) if s.play else s.law, p.terms, s.parameters, ground=p.ground,
        duration=min(p.duration, duration), bed_density=s.jump.volume_fraction * p.bed.grain_density,
        dt=step[0], every=step[1],
    )  # fmt: skip


def filmed(t: Truth, setting: Setting, s: Shot, i: int, rng: np.random.Generator) -> Recorded:
    """Recording number i as its folder holds it: frames that are lost are missed by nobody."""
    motion, log = moved(setting, s), setting.protocol.records.motor_log
    seen = seen_rod(motion, track_of(t), zero=rng.uniform(-0.05, 0.05), rng=rng, scale=s.scale)
    track = dict(seen.columns)
    if t.instrument == "vibration":
        track["height_m"] = track["height_m"] + NOISE * ringing(track["time_s"].size, rng)
    for _, where, frames in (x for x in t.lost if x[0] == i):
        instant = s.law.start + where * (until(motion, s.law.stop) - s.law.start)
        gap = int(np.searchsorted(track["time_s"], instant))
        left = {n: np.delete(x, slice(gap, gap + frames)) for n, x in track.items()}
        track = left | {"time_s": track["time_s"][:-frames]}
    motor = logs.motor_log(motion, rate=log.rate, force_noise=log.force_noise, rng=rng) if log else None
    return Recorded(s.jump, s.jump.volume_fraction, track, motor, seen.error, seen.sigma)


def until(motion: Motion, stop: float) -> float:
    """The second landing after the motor's stop [s]: what follows is not questioned."""
    landings = motion.lift_offs + motion.flights
    after = landings[(landings > stop) & (landings < motion.t[-1])]
    return float(after[1] if after.size > 1 else min(stop + 0.3, motion.t[-1]))


def ringing(n: int, rng: np.random.Generator) -> Array:
    """(n,) noise of unit variance about the stand's own frequency, a tenth of the frame rate."""
    fresh = rng.standard_normal(n + 200) * fresh_share(VIBRATION)
    return np.asarray(lfilter([1.0], VIBRATION, fresh)[200:])


def fresh_share(whitener: Array) -> float:
    """Standard deviation of the fresh part of noise of unit variance."""
    pulse = np.zeros(400)
    pulse[0] = 1.0
    return float(1.0 / np.sqrt(np.sum(lfilter([1.0], whitener, pulse) ** 2)))


def task_of(t: Truth, setting: Setting, recorded: Sequence[Recorded]) -> Task:
    """What `jumpvision diagnose` would read of the folders, entered by somebody who errs where the truth says so."""
    if wrong := t.entry:
        recorded = [mistaken(r, wrong) if i == wrong.recording else r for i, r in enumerate(recorded)]
    jumps, ranges, priors = jumps_of(setting, list(recorded))
    out = []
    for i, (jump, r) in enumerate(zip(jumps, recorded)):
        condition = f"{r.jump.kind} {r.jump.law} {r.volume_fraction}"
        jump = replace(jump, name=name_of(i), condition=condition, group=condition)
        if wrong and wrong.quantity == "motor_mass" and i == wrong.recording:
            jump = replace(jump, model=replace(jump.model, motor_mass=jump.model.motor_mass * wrong.factor))
        out.append(told(jump, t.known[i]))
    return Task(out, ranges, priors)


def mistaken(r: Recorded, wrong: Entry) -> Recorded:
    """The recording with a wrong number in [actuation], or at a wrong frame rate."""
    if wrong.quantity == "frame_rate":
        return replace(r, track={**r.track, "time_s": r.track["time_s"] / wrong.factor})
    if wrong.quantity == "motor_mass":
        return r
    law: Any = r.jump.law
    law = law._replace(**{wrong.quantity: getattr(law, wrong.quantity) * wrong.factor})
    return replace(r, jump=r.jump._replace(law=law))


def told(jump: Question, known: Circumstances) -> Question:
    """The jump with what is known of its recording, where jumps carry it."""
    if "circumstances" not in {f.name for f in fields(jump)}:
        return jump
    more: dict[str, Any] = {"circumstances": known}
    return replace(jump, **more)


# -------------------------------------------------------------------------------------------------------------- sizes
@dataclass(frozen=True)
class Ruler:
    """Measures what could be seen. tracks: (n,) true heights over rest [m] of every shot; ends: how many of its frames
    are questioned; free: (all frames, k) whitened changes that the declared model can make, with what is stated."""

    t: Truth
    setting: Setting
    clean: Sequence[Shot]
    tracks: Sequence[Array]
    free: Array

    @classmethod
    def of(cls, t: Truth, setting: Setting, clean: Sequence[Shot]) -> Ruler:
        tracks = [height(t, setting, s) for s in clean]
        bare = cls(t, setting, clean, tracks, np.empty((0, 0)))
        stated = FREE[t.ground] | dict.fromkeys(EFFECTS[t.force].drawn if t.force else (), math.inf)
        columns = [bare.seen([changed(s, n, 1e-3) for s in clean]) / 1e-3 for n in stated]
        prior = np.diag([1.0 / sigma for sigma in stated.values()])
        return replace(bare, free=np.vstack([np.column_stack(columns), prior]))

    def seen(self, other: Sequence[Shot]) -> Array:
        """(all frames,) what the shots change, in sigmas of fresh noise, every zero unknown."""
        parts = []
        for s, o, y in zip(self.clean, other, self.tracks):
            alike = replace(o, scale=s.scale) == s  # but for the camera
            d = y * (o.scale / s.scale - 1.0) if alike else height(self.t, self.setting, o, y.size) - y
            parts.append(whitened(self.t, d))
        return np.concatenate(parts)

    def rest(self, change: Array) -> float:
        """chi^2 of a change that the declared model cannot make."""
        target = np.concatenate([change, np.zeros(self.free.shape[1])])
        norm = np.linalg.norm(self.free, axis=0)
        left = target - self.free @ (np.linalg.lstsq(self.free / norm, target, rcond=None)[0] / norm)
        return float(left @ left)


def height(t: Truth, setting: Setting, s: Shot, n: int | None = None) -> Array:
    """(n,) heights over rest that a camera without noise reports at its frames [m]; n: those that are questioned."""
    motion = moved(setting, s, COARSE, math.inf if n is None else (n + 1) / t.rate)
    if n is None:
        n = int(until(motion, s.law.stop) * t.rate) + 1
    return s.scale * (motion.at("rod", np.arange(n) / t.rate) - motion.rest)


def whitened(t: Truth, d: Array) -> Array:
    """A change of heights in sigmas of the fresh part of the noise, without what an unknown zero can make."""
    filter_ = VIBRATION if t.instrument == "vibration" else np.array([1.0, -RHO.get(t.instrument, 0.0)])
    sigma = NOISE * fresh_share(filter_)
    w, zero = lfilter(filter_, [1.0], d) / sigma, lfilter(filter_, [1.0], np.ones_like(d))
    return np.asarray(w - zero * (zero @ w) / (zero @ zero))


def detectable(ruler: Ruler, near: float = 0.1) -> float:
    """The size of the fault at which chi^2 would fall by THRESHOLD, to a part `near` in chi^2."""
    size = 1e-4 if ruler.t.slack is not None else 1e-3
    for _ in range(6):
        found = ruler.rest(ruler.seen(put(ruler.t, ruler.clean, size)))
        if abs(found / THRESHOLD - 1.0) < near:
            break
        size *= math.sqrt(THRESHOLD / max(found, 1e-3 * THRESHOLD))
    return size
