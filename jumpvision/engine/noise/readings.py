"""What readings do beside white noise: single ones that stand off, heavy tails, slow wander."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy

from jumpvision.base.arrays import MAD, Array

from .noise import Noise, Stretch, solved, whitened

BULK = 2.5  # robust sigmas beyond which a reading's weight falls, as Huber (1964) has it
LISTED = 5.0  # from which it is called an outlier
ROUNDS = 12
NEAR = 7  # readings of a running median, which two that stand off do not move
OWN = math.sqrt(1.0 + 34.0 / 36.0)  # white noise of 1 makes deviations of this


def deviation(r: Array) -> Array:
    """r (n,) less the cubic through its four neighbours; the first two less the median of the next five, the last 0."""
    out = np.zeros_like(r)
    if r.size >= 8:
        out[2:-2] = r[2:-2] - (4.0 * (r[1:-3] + r[3:-1]) - r[:-4] - r[4:]) / 6.0
        for k in (0, 1):
            out[k] = r[k] - np.median(r[k + 1 : k + 6])
    return out


def factors(r: Array, least: float) -> tuple[Array, Array]:
    """(factor on the noise of every reading (n,) >= 1, how far it stands off in robust sigmas (n,)).

    r (n,): measured minus roughly predicted, evenly sampled; least: smallest standard deviation of a reading
    (rounding). The readings that stand off most are moved to the edge of the bulk, again and again, so that they are
    not held against their neighbours.
    """
    calm = r.copy()
    sigma = max(float(np.median(np.abs(deviation(r)[2:-2]))) / MAD if r.size > 8 else 0.0, OWN * least)
    if not sigma > 0.0:
        return np.ones_like(r), np.zeros_like(r)
    bulk = max(float(np.median(np.abs(r - scipy.ndimage.median_filter(r, NEAR)))) / MAD, least)
    for _ in range(ROUNDS):
        off = deviation(calm)
        # a reading between two that stand off deviates from the cubic, but not from the median about it
        size = np.where(np.abs(calm - scipy.ndimage.median_filter(calm, NEAR)) > BULK * bulk, np.abs(off), 0.0)
        peak = (size > BULK * sigma) & (size >= np.maximum(np.roll(size, 1), np.roll(size, -1)))
        if not peak.any():
            break
        calm[peak] -= off[peak] - np.sign(off[peak]) * BULK * sigma
    moved = np.abs(r - calm) / sigma
    return 1.0 + moved / BULK, np.where(moved > 0.0, moved + BULK, 0.0)


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
    normal = float(np.sum(scipy.stats.norm.logpdf(every, scale=np.sqrt(np.mean(every**2)))))
    best = (normal + NORMAL, math.inf, 1.0)
    for nu in DEGREES:
        scale = _scale_of(every, float(nu))
        score = float(np.sum(scipy.stats.t.logpdf(every / scale, nu))) - every.size * math.log(scale)
        best = max(best, (score, float(nu), scale * float(scipy.stats.t.ppf(0.841345, nu))))
    return noise.s * best[2], best[1]


def _scale_of(z: Array, nu: float) -> float:
    """Scale of a Student's t by maximum likelihood, its fixed point iterated."""
    square = float(np.median(z**2)) / 0.4549
    for _ in range(30):
        square = float(np.mean((nu + 1.0) * z**2 / (nu + z**2 / square)))
    return math.sqrt(square)


SHARE = 5.0  # a track's wander remembers a fifth of the record
GRID = np.concatenate([[0.0], np.geomspace(0.05, 30.0, 60)])  # d in units of the noise


def reach_of(times: Sequence[Array]) -> float:
    """Memory of the wander [s]: a fixed share of the records' median length."""
    return float(np.median([t[-1] - t[0] for t in times])) / SHARE


def shapes(t: Array, reach: float) -> Array:
    """Columns (n, k) whose sum with independent coefficients of unit variance is the wander of rms 1."""
    knots = np.linspace(t[0], t[-1], max(4, int(np.ceil(3.0 * (t[-1] - t[0]) / reach)) + 2))
    kernel = np.exp(-0.5 * ((knots[:, None] - knots) / reach) ** 2)
    w, v = np.linalg.eigh(kernel)
    kept = w > 1e-5 * w[-1]  # directions that hold less of the wander's variance are left out
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
