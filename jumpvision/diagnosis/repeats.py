"""Noise and scatter of a campaign of jumps, from repeated trials, rest and flight: where no model is in question."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .jumper import Jumper
from .jumps import Jump
from .noise import Noise, Stretch, coefficients, estimate, frame_of, of_rounded, powers, rounding_step, spread_of

Array = NDArray[np.float64]

ENOUGH_REPEATED = 400  # samples of differences that are worth more than rest and flight
FALL = 0.3  # of g: how near to free fall a stretch must be to be called a flight


def learn_noise(system: Jumper) -> tuple[Noise, dict[str, float]]:
    """(noise of the tracks, scatter from trial to trial), from where no model is needed or a rough one will do.

    From differences of trials made alike: what scatter could do to them (`Jumper.scatter` of the model as given) is
    fitted to each. With few trials, from rest and flight, and no scatter is known.
    Raises ValueError where there is too little of all that.
    """
    jumps = system.jumps
    step = max(rounding_step(j.y) for j in jumps)
    frame = frame_of([j.t for j in jumps])
    pairs = differences(system)
    if sum(x.t.size for x in pairs) < ENOUGH_REPEATED:
        return estimate([*pairs, *quiet(jumps)], frame, floor=step / math.sqrt(12.0)), {}
    noise = estimate(pairs, frame)
    if step > 0:
        noise = replace(noise, s=of_rounded(noise.s, step))
    found = [coefficients(noise, x) for x in pairs]
    names = list(system.scatter((), {p.name: p.start for p in system.baseline}, [0]))
    scatter = {n: spread_of([(c[k + 1], v[k + 1]) for c, v in found]) for k, n in enumerate(names)}
    return noise, scatter


def differences(system: Jumper) -> list[Stretch]:
    """n - 1 independent differences of n trials of a group (Helmert), each with the variance of one trial.

    Design: the zero level, then what scatters, until the motor has stopped (later it depends too much on the model).
    """
    jumps = system.jumps
    start = {p.name: p.start for p in system.baseline}
    groups: dict[str, list[int]] = {}
    for i, j in enumerate(jumps):
        if j.spread == 1.0:  # of the campaign's common noise
            groups.setdefault(j.group, []).append(i)
    out = []
    for trials in groups.values():
        first = jumps[trials[0]]
        for k in range(1, len(trials)):
            tracks = [_at(first.t, jumps[i]) for i in trials[: k + 1]]
            good = np.all(np.isfinite(tracks), axis=0) & (first.t < first.stop + 0.05)
            if good.sum() < 12:
                continue
            t = first.t[good]
            y = (tracks[k] - np.mean(tracks[:k], axis=0))[good] / math.sqrt(1.0 + 1.0 / k)
            effects = [system.height(first, t, (), {**start, n: h}) for n, h in (("start", 1e-5), ("bed", 1e-3))]
            at = system.height(first, t, (), start)
            columns = [(e - at) / h for e, h in zip(effects, (1e-5, 1e-3))]
            usable = columns[: 2 if system.model.ground == "granular" else 1]
            out.append(Stretch(t, y, np.column_stack([np.ones(t.size), *(np.nan_to_num(c) for c in usable)])))
    return out


def quiet(jumps: Sequence[Jump]) -> list[Stretch]:
    """Stretches of single tracks whose course needs no model: rest and flight."""
    rounded = any(rounding_step(j.y) > 0 for j in jumps)
    out: list[Stretch] = []
    for j in (j for j in jumps if j.spread == 1.0):
        rest = j.t < j.forcing.start
        if rest.sum() >= 6 and not rounded:
            out.append(Stretch(j.t[rest], j.y[rest], np.ones((int(rest.sum()), 1))))
        out += _flights(j)
    return out


def _at(t: Array, jump: Jump) -> Array:
    """A trial's heights at the frames t of another, NaN where it has no frame within 1e-6 s."""
    i = np.clip(np.searchsorted(jump.t, t - 1e-6), 0, jump.t.size - 1)
    return np.where(np.abs(jump.t[i] - t) < 2e-6, jump.y[i], np.nan)


def _flights(jump: Jump) -> list[Stretch]:
    """The longest flight after the motor stopped, found in the track itself by its curvature -g.

    Its course: a polynomial of degree 4 and the ring of the foot on its spring.
    """
    m = jump.model
    after = np.flatnonzero(jump.t > jump.stop)
    if after.size < 16:
        return []
    t, y = jump.t[after], jump.y[after]
    top = int(np.argmax(y))
    best: Stretch | None = None
    for half in range(8, 60, 2):
        window = slice(max(top - half, 0), min(top + half + 1, t.size))
        if t[window].size < 16:
            continue
        curve = 2.0 * np.polyfit(t[window] - t[top], y[window], 2)[0]
        if abs(curve / m.g + 1.0) > FALL:
            break
        inner = slice(window.start + 2, window.stop - 2)
        design = powers(t[inner], 4)
        if m.m_f > 0:
            ring = math.sqrt(m.k_s * (1.0 / m.m_f + 1.0 / m.M))
            decay = np.exp(-0.5 * m.c_s * (1.0 / m.m_f + 1.0 / m.M) * (t[inner] - t[inner][0]))
            phase = ring * t[inner]
            design = np.column_stack([design, decay * np.cos(phase), decay * np.sin(phase)])
        if t[inner].size > design.shape[1] + 4:
            best = Stretch(t[inner], y[inner], design)
    return [best] if best is not None else []
