"""The simulation's own error as a random walk, learned from how repeats differ, each less its own simulation.

Small random faults of the forces add up in a simulation that is never set right by a measurement: over a long record
they exceed the noise of any instrument, and a fit that takes them for independent readings believes far too much. What
a model lacks is the same in both repeats of a motion and drops out of the difference of their residuals; what a
candidate would do differently in the two, as a drift, is taken off.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError
from jumpvision.engine.document.values import NoiseSource
from jumpvision.engine.fitting import Fit
from jumpvision.engine.noise.noise import Noise

from .learn import Readings, together
from .system import Studied

MEMORY = 20.0  # records: a walk as an autoregression that hardly forgets


@dataclass(frozen=True)
class Difference:
    """Of two repeats: residuals (n,) of a channel at the times t (n,), over root 2; what candidates may do (n, k)."""

    t: Array
    y: Array
    design: Array


def with_walks(system: Studied, base: Fit) -> Readings:
    """The noise of the channels, those with `process` as random walks. base: the baseline, fitted.

    Raises InputError where no recording was repeated.
    """
    channels, readings = system.study.channels, system.readings
    noises, sources = list(readings.channels), list(readings.sources)
    for k, c in enumerate(channels):
        if not c.process:
            continue
        found = differences(system, base, k)
        if not found:
            raise InputError(
                [
                    f"channel {c.name!r}: process=True learns from repeats, and no two recordings of one `group` have "
                    "the same times (from their first); give noise= and correlation= near 1 instead"
                ]
            )
        coefficient, free = walk(found)
        length = float(np.median([r.t[-1] - r.t[0] for r in system.recordings]))
        frame = float(np.median(np.concatenate([np.diff(r.t) for r in system.recordings])))
        noises[k] = as_walk(coefficient, free, length, frame)
        sources[k] = {"random walk [per sqrt(s)]": NoiseSource(coefficient, math.sqrt(0.5 / free), free)}
    samples = [sum(int(m[:, k].sum()) for m in system.masks) for k in range(len(channels))]
    total = noises[0] if len(noises) == 1 else together(noises, samples)
    return replace(readings, channels=tuple(noises), noise=total, sources=tuple(sources))


def as_walk(coefficient: float, free: int, length: float, frame: float) -> Noise:
    """A random walk [unit per sqrt(s)] over records of a length [s], sampled every `frame` [s]."""
    memory = MEMORY * length
    sigma = coefficient * math.sqrt(0.5 * memory)
    return Noise(
        sigma, math.exp(-frame / memory), frame, log_sigma=math.sqrt(2.0 / free), log_power=math.sqrt(2 / free)
    )


def differences(system: Studied, base: Fit, channel: int) -> list[Difference]:
    """Of each recording and the next of its group that has the same times from its first one on."""
    every = range(len(system.recordings))
    at = system.predict((), base.named, every)
    effects = _effects(system, base)
    out = []
    for i in every:
        j = next((j for j in every[i + 1 :] if _alike(system, i, j)), None)
        if j is None:
            continue
        here, there = (_block(system, k, channel) for k in (i, j))
        if here is None or there is None:
            continue
        n = min(here.stop - here.start, there.stop - there.start)
        a, b = slice(here.start, here.start + n), slice(there.start, there.start + n)
        unit = system.units[channel]
        y = (system.observations[j].y - at[j])[b] - (system.observations[i].y - at[i])[a]
        columns = [unit * (e[j][b] - e[i][a]) for e in effects if _differs(e[i][a], e[j][b])]
        design = np.stack(columns, axis=1) / math.sqrt(2.0) if columns else np.zeros((n, 0))
        out.append(Difference(system.observations[i].t[a], unit * y / math.sqrt(2.0), design))
    return out


def walk(found: Sequence[Difference]) -> tuple[float, int]:
    """(coefficient of a random walk [unit per sqrt(s)], increments it was learned from).

    At the lag at which it is greatest, of those that leave enough increments: the faults of forces are no white noise,
    and what matters to a model's parameters is their power at low frequencies.
    """
    best = (0.0, 1)
    lag = 1
    while True:
        power, free = 0.0, 0
        for d in found:
            y, design, time = np.diff(d.y[::lag]), np.diff(d.design[::lag], axis=0), np.diff(d.t[::lag])
            if y.size <= design.shape[1]:
                continue
            scale = np.sqrt(time)
            y, design = y / scale, design / scale[:, None]
            y = y - design @ np.linalg.lstsq(design, y, rcond=None)[0]
            power, free = power + float(y @ y), free + y.size - design.shape[1]
        if free < 5:  # increments beyond what is taken off, by which a walk is learned
            return best
        best = max(best, (math.sqrt(power / free), free))
        lag *= 2


def _effects(system: Studied, base: Fit) -> list[list[Array]]:
    """d(readings)/d(parameter) of the baseline's parameters and of every candidate's strength, by recording."""
    every = range(len(system.recordings))
    out: list[list[Array]] = []
    for mechanisms in [(), *((m,) for m, c in system.candidates.items() if not c.replaces)]:
        candidate = system.candidates[mechanisms[0]] if mechanisms else None
        free = candidate.parameters[:1] if candidate else system.baseline
        shape = {p.name: p.start for p in candidate.parameters[1:]} if candidate else {}
        absent = {free[0].name: candidate.null} if candidate else {}
        columns = system.derivatives(mechanisms, free, {**base.named, **shape, **absent}, every)
        out += [[c[:, k] for c in columns] for k in range(len(free))]
    return out


def _differs(a: Array, b: Array) -> bool:
    """Whether an effect is another one in a repeat."""
    size = float(np.linalg.norm(a) + np.linalg.norm(b))
    # less than half an effect between repeats is no difference of theirs
    return size > 0.0 and float(np.linalg.norm(b - a)) > 0.25 * size


def _alike(system: Studied, i: int, j: int) -> bool:
    """Whether two recordings repeat one motion: one group, the same times from their first."""
    a, b = system.recordings[i], system.recordings[j]
    n = min(a.t.size, b.t.size)
    close = np.allclose(a.t[:n] - a.t[0], b.t[:n] - b.t[0], atol=0.1 * float(np.median(np.diff(a.t))), rtol=0.0)
    return system.observations[i].group == system.observations[j].group and bool(close)


def _block(system: Studied, i: int, channel: int) -> slice | None:
    """Where an observation's readings of a channel are; None where it has none."""
    read = [k for k, m in enumerate(system.masks[i].T) if m.sum() >= 2]
    return system.observations[i].blocks[read.index(channel)].readings if channel in read else None
