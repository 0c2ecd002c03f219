"""Slow wander of a track: a tripod that creeps, a lamp that warms, a table that leans.

A Gaussian process of zero mean, rms d and memory `reach`, cov(t, t') = d^2 exp(-(t - t')^2 / (2 reach^2)), the same
for all tracks, each with its own course. It is marginalised wherever residuals are whitened, and d is learned where no
model is needed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .noise import Noise, Stretch, solved

Array = NDArray[np.float64]

SHARE = 5.0  # a track's wander remembers a fifth of the record
GRID = np.concatenate([[0.0], np.geomspace(0.05, 30.0, 60)])  # d in units of the noise
LEAST = 1e-5  # share of the wander's variance that a direction must hold


def reach_of(times: Sequence[Array]) -> float:
    """Memory of the wander [s]: a fixed share of the records' median length."""
    return float(np.median([t[-1] - t[0] for t in times])) / SHARE


def shapes(t: Array, reach: float) -> Array:
    """Columns (n, k) whose sum with independent coefficients of unit variance is the wander of rms 1."""
    knots = np.linspace(t[0], t[-1], max(4, int(np.ceil(3.0 * (t[-1] - t[0]) / reach)) + 2))
    kernel = np.exp(-0.5 * ((knots[:, None] - knots) / reach) ** 2)
    w, v = np.linalg.eigh(kernel)
    kept = w > LEAST * w[-1]
    at = np.exp(-0.5 * ((t[:, None] - knots) / reach) ** 2)
    return np.asarray((at @ v[:, kept]) / np.sqrt(w[kept]))


def learn(stretches: Sequence[Stretch], noise: Noise, reach: float) -> float:
    """rms of the wander [unit of y] from stretches, its likelihood averaged over a half-Cauchy prior of width s.

    The root of the mean square, so that a wander that the data cannot exclude is allowed for.
    """
    score = np.log1p(GRID**2)  # -2 ln prior / 2
    for x in stretches:
        u = noise.whiten(x.t, shapes(x.t, reach), x.spread) * noise.s
        q, _ = np.linalg.qr(noise.whiten(x.t, x.design, x.spread))
        r = noise.whiten(x.t, x.y, x.spread)
        u, r = u - q @ (q.T @ u), r - q @ (q.T @ r)
        left, size, _ = np.linalg.svd(u, full_matrices=False)
        part = left.T @ r
        gain = 1.0 / (1.0 + (GRID[:, None] * size) ** 2)
        score += 0.5 * np.sum(-np.log(gain) + part**2 * gain, axis=1)
    weight = np.exp(-(score - score.min())) * np.gradient(GRID)
    return noise.s * float(np.sqrt(np.sum(weight * GRID**2) / np.sum(weight)))


def coefficients(noise: Noise, x: Stretch) -> tuple[Array, Array]:
    """Coefficients (k,) of a stretch's design by generalised least squares beside noise and wander, their variances."""
    y, design = noise.whiten(x.t, x.y, x.spread), noise.whiten(x.t, x.design, x.spread)
    slow = noise.whiten(x.t, shapes(x.t, noise.reach), x.spread) * noise.drift
    q, size, _ = np.linalg.svd(slow, full_matrices=False)
    shrink = 1.0 / np.sqrt(1.0 + size * size) - 1.0
    return solved(y + q @ (shrink * (q.T @ y)), design + q @ (shrink[:, None] * (q.T @ design)))
