"""The shape of a noise: its kurtosis, and the tails of a Student's t where they are heavier than a normal one's."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from .noise import Noise, Stretch, whitened

Array = NDArray[np.float64]

NORMAL = 3.0  # log-likelihood by which tails must be better than a normal distribution's to be told
DEGREES = np.geomspace(1.5, 50.0, 40)  # of freedom of Student's t


def kurtosis(stretches: Sequence[Stretch], noise: Noise) -> float:
    """Fourth moment of the whitened noise over its variance squared, not below that of a normal one."""
    z = _normalised(stretches, noise)
    return max(3.0, float(np.mean(z**4) / np.mean(z**2) ** 2)) if z.size else 3.0


def _normalised(stretches: Sequence[Stretch], noise: Noise) -> Array:
    """All noise of some stretches as independent numbers of about unit variance (their courses taken off)."""
    out = []
    for x in stretches:
        free = x.t.size - x.design.shape[1]
        if free > 2:
            out.append(whitened(x, noise.rho, noise.frame)[0] / noise.s * math.sqrt(x.t.size / free))
    return np.concatenate(out) if out else np.zeros(0)


def half_width(stretches: Sequence[Stretch], noise: Noise) -> tuple[float, float]:
    """(half width that holds 68 % of the errors, degrees of freedom of a Student's t; inf: normal)."""
    z = []
    for x in stretches:
        free = x.t.size - x.design.shape[1]
        if free > 2 and x.spread is not None:  # each reading at its own size again, the track's factor left off
            own = x.spread / float(np.median(x.spread))
            z.append(whitened(x, noise.rho, noise.frame)[0] / noise.s * own * math.sqrt(x.t.size / free))
    if not z:
        return noise.s, math.inf
    every = np.concatenate(z)
    normal = float(np.sum(stats.norm.logpdf(every, scale=np.sqrt(np.mean(every**2)))))
    best = (normal + NORMAL, math.inf, 1.0)
    for nu in DEGREES:
        scale = _scale_of(every, float(nu))
        score = float(np.sum(stats.t.logpdf(every / scale, nu))) - every.size * math.log(scale)
        best = max(best, (score, float(nu), scale * float(stats.t.ppf(0.841345, nu))))
    return noise.s * best[2], best[1]


def _scale_of(z: Array, nu: float) -> float:
    """Scale of a Student's t by maximum likelihood, its fixed point iterated."""
    square = float(np.median(z**2)) / 0.4549
    for _ in range(30):
        square = float(np.mean((nu + 1.0) * z**2 / (nu + z**2 / square)))
    return math.sqrt(square)
