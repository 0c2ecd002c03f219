"""Light that shines through the topmost grains, and what it does to the edge of a back-lit bed.

The dark side of the edge is then no plateau but decays with depth, and an error function fitted to it puts the edge too
low, in all columns alike. The profile of all columns, laid over each other at their edges, is sampled finely enough to
tell the blur of the edge from the glow below it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import ndtr

Array = NDArray[np.float64]

REACH = 8  # px, rows on each side of the edge
PER_PIXEL = 4  # bins a pixel
VISIBLE = 2.2  # chi2 without / with glow: up to 2.1 for textured grains without glow, above 2.2 with it
FEWEST = 32  # columns, below which no profile is made


def glow_shift(grey: Array, row: Array) -> tuple[float, float]:
    """(shift, sigma) [px, rows down] to add to the edges `row` (n,) [px] of an image (rows, n), NaN = no edge.

    Fitted to the mean profile is dark + (light - dark) Phi(-(t - shift)/s) + glow E(t - shift), with E an exponential
    decay below the edge blurred by the same s. Zero where a profile without glow fits nearly as well (VISIBLE): grain
    texture bends the profile too, and a glow that is not there would be fitted to it.
    """
    ny = grey.shape[0]
    column = np.flatnonzero(np.isfinite(row) & (row > REACH + 1) & (row < ny - REACH - 2))
    if column.size < FEWEST:
        return 0.0, 0.0
    middle = np.rint(row[column]).astype(int)
    rows = middle[:, None] + np.arange(-REACH, REACH + 1)
    y = grey[rows, column[:, None]]
    light, dark = y[:, :4].mean(axis=1), y[:, -4:].mean(axis=1)
    share = (y - dark[:, None]) / (light - dark)[:, None]
    bins = np.round(PER_PIXEL * (rows - row[column][:, None])).astype(int)
    low = int(bins.min())
    count = np.bincount((bins - low).ravel())
    total = np.bincount((bins - low).ravel(), weights=share.ravel())
    kept = count >= 8
    t, mean, weight = (np.flatnonzero(kept) + low) / PER_PIXEL, total[kept] / count[kept], np.sqrt(count[kept])

    def model(p: Array) -> Array:
        shift, s, glow, depth, top, bottom = p
        u = t - shift
        tail = np.exp(np.clip(0.5 * (s / depth) ** 2 - u / depth, -50.0, 50.0)) * ndtr(u / s - s / depth)
        return np.asarray(bottom + (top - bottom) * ndtr(-u / s) + glow * tail)

    start, low_p, high_p = (
        [0.0, 1.0, 0.05, 2.0, 1.0, 0.0],
        [-2.0, 0.3, 0.0, 0.5, 0.5, -0.5],
        [2.0, 4.0, 0.4, 6.0, 1.5, 0.5],
    )
    fit = least_squares(lambda p: weight * (model(p) - mean), start, bounds=(low_p, high_p))
    without = [True, True, False, False, True, True]  # the same without a glow
    plain = least_squares(
        lambda q: weight * (model(np.concatenate([q[:2], [0.0, 1.0], q[2:]])) - mean),
        np.compress(without, start),
        bounds=(np.compress(without, low_p), np.compress(without, high_p)),
    )
    if plain.cost < VISIBLE * fit.cost:
        return 0.0, 0.0
    variance = 2.0 * fit.cost / max(1, t.size - 6) * np.linalg.pinv(fit.jac.T @ fit.jac)[0, 0]
    return float(fit.x[0]), math.sqrt(max(0.0, float(variance)))
