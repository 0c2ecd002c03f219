"""Differences of trials made alike: noise, and what differs from trial to trial, without trusting the model."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .jumper import Jumper
from .jumps import Jump
from .noise import Stretch, powers

Array = NDArray[np.float64]

STEPS = {"start": 1e-5, "bed": 1e-3}  # of the derivatives by what scatters
FEWEST = 12  # samples that two trials share
SLOW = 3  # degree of the wander that is taken off where the noise is learned


def differences(system: Jumper, factors: Sequence[Array]) -> list[Stretch]:
    """n - 1 independent differences of n trials of a group, each with the noise of one trial.

    factors: by jump, (n,) on the noise of every reading. Design: the zero level, then what scatters, until the motor
    has stopped (later it depends too much on the model).
    """
    jumps = system.jumps
    start = {p.name: p.start for p in system.baseline}
    groups: dict[str, list[int]] = {}
    for i, j in enumerate(jumps):
        groups.setdefault(j.group, []).append(i)
    out = []
    for trials in groups.values():
        first = jumps[trials[0]]
        for k in range(1, len(trials)):
            tracks = [_at(first.t, jumps[i], jumps[i].y) for i in trials[: k + 1]]
            noisy = [_at(first.t, jumps[i], factors[i]) for i in trials[: k + 1]]
            good = np.all(np.isfinite(tracks), axis=0) & (first.t < first.stop + 0.05)
            if good.sum() < FEWEST:
                continue
            t = first.t[good]
            y = (tracks[k] - np.mean(tracks[:k], axis=0))[good]
            spread = np.sqrt(noisy[k] ** 2 + np.sum(np.square(noisy[:k]), axis=0) / k**2)[good]
            typical = math.sqrt(1.0 + 1.0 / k)
            effects = [system.height(first, t, (), {**start, n: h}) for n, h in STEPS.items()]
            at = system.height(first, t, (), start)
            columns = [(e - at) / h / typical for e, h in zip(effects, STEPS.values())]
            usable = columns[: 2 if system.model.ground == "granular" else 1]
            design = np.column_stack([np.ones(t.size), *(np.nan_to_num(c) for c in usable)])
            out.append(Stretch(t, y / typical, design, spread / typical, trials[k]))
    return out


def steadied(x: Stretch) -> Stretch:
    """A stretch whose course may also wander slowly."""
    design = np.column_stack([x.design, powers(x.t, SLOW)[:, 1:]])
    return Stretch(x.t, x.y, design, x.spread, x.track)


def _at(t: Array, jump: Jump, values: Array) -> Array:
    """What a trial has (n,) at the frames t of another, NaN where it has no frame within 2e-6 s."""
    i = np.clip(np.searchsorted(jump.t, t - 1e-6), 0, jump.t.size - 1)
    return np.where(np.abs(jump.t[i] - t) < 2e-6, values[i], np.nan)
