"""How the track of a camera errs: white or correlated, with heavy tails or outliers, wandering, each track its own.

Only the laboratory knows these; the analysis models a part of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from .protocol_keys import RodTrack

Array = NDArray[np.float64]

NU = 3.0  # degrees of freedom of the family "t3"; its variance is NU / (NU - 2) of its scale's square
SHARE, NEAR, FAR = 0.005, 8.0, 60.0  # outliers: their share of the frames, their size in standard deviations
WAVES = 3  # sines of a wander
PERIODS = 0.8, 4.0  # of a sine, in lengths of the record


@dataclass(frozen=True)
class Errors:
    """The errors of one track [m], before rounding; jitter, wander (n,): what to add to the heights.

    noise: standard deviation of this track's jitter, outliers aside [m]; outliers: the frames that hold one.
    """

    jitter: Array
    wander: Array
    noise: float
    outliers: NDArray[np.int64]


def errors(n: int, how: RodTrack, rng: np.random.Generator) -> Errors:
    """Errors of a track of n frames, as `how` has them."""
    noise = how.noise * factor(how.ratio, rng)
    jitter = noise * correlated(unit(n, how.family, rng), how.rho)
    outliers = np.flatnonzero(rng.random(n) < SHARE) if how.family == "outliers" else np.zeros(0, np.int64)
    if outliers.size:
        size = rng.uniform(NEAR, FAR, outliers.size) * rng.choice([-1.0, 1.0], outliers.size)
        jitter[outliers] = noise * size
    wander = how.drift * slow(n, rng) if how.drift else np.zeros(n)
    return Errors(jitter, wander, noise, outliers)


def factor(ratio: float, rng: np.random.Generator) -> float:
    """A track's own noise over the nominal one: log-uniform from 1/sqrt(ratio) to sqrt(ratio)."""
    if ratio <= 1.0:
        return 1.0
    return math.exp(rng.uniform(-0.5, 0.5) * math.log(ratio))


def unit(n: int, family: str, rng: np.random.Generator) -> Array:
    """(n,) independent numbers of unit variance: Gaussian, or Student's t with NU degrees of freedom."""
    if family == "t3":
        return rng.standard_t(NU, n) * math.sqrt((NU - 2.0) / NU)
    return rng.standard_normal(n)


def correlated(fresh: Array, rho: float) -> Array:
    """e[n] = rho e[n - 1] + sqrt(1 - rho^2) fresh[n]: the variance stays that of the fresh ones."""
    if not rho:
        return fresh
    fresh = np.concatenate([fresh[:1], fresh[1:] * math.sqrt(1 - rho * rho)])
    return np.fromiter(accumulate(fresh, lambda before, new: rho * before + new), float, fresh.size)


def slow(n: int, rng: np.random.Generator) -> Array:
    """(n,) a smooth wander over a record, no polynomial: WAVES sines, of mean 0 and root mean square 1 on it."""
    u = np.arange(n) / max(n - 1, 1)
    periods, phases = rng.uniform(*PERIODS, WAVES), rng.uniform(0.0, 2.0 * math.pi, WAVES)
    x = np.sin(2.0 * math.pi * u[:, None] / periods + phases).sum(axis=1)
    x -= x.mean()
    return np.asarray(x / math.sqrt(float(np.mean(x * x))))
