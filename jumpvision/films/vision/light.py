"""What light does to the edge of a back-lit bed: above it the camera saturates, below it grains shine through."""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.films.calibration import CLIPPED_EDGE, VISIBLE_GLOW

REACH = 8  # px, rows on each side of the edge
PER_PIXEL = 4  # bins a pixel
LEAST_COLUMNS = 32  # columns, below which no profile is made
NAN = float("nan")


def clipped_columns(grey: Array, row: Array, saturation: float) -> NDArray[np.bool_]:
    """Columns of an image (rows, n) in which half the pixels 4 to 8 rows above the edge `row` (n,) [px] are clipped."""
    above = np.nan_to_num(np.rint(row), nan=REACH).astype(int)[:, None] - np.arange(4, REACH + 1)
    y = grey[np.clip(above, 0, len(grey) - 1), np.arange(row.size)[:, None]]
    return np.asarray((np.mean(y >= saturation, axis=1) >= 0.5) & np.isfinite(row))


def clipped_shift(grey: Array, row: Array, saturation: float) -> tuple[float, float]:
    """(shift, sigma) [px, rows down] to add to the edges `row` (n,) [px] of clipped columns, NaN = not one of them.

    An error function with a free upper level is fitted to the mean profile where hardly a pixel is clipped and not far
    below the edge. NaN where there are too few columns, or nothing of the edge is left to see.
    """
    column = np.flatnonzero(np.isfinite(row) & (row > REACH + 1) & (row < len(grey) - REACH - 2))
    if column.size < LEAST_COLUMNS:
        return NAN, NAN
    rows = np.rint(row[column]).astype(int)[:, None] + np.arange(-REACH, REACH + 1)
    y = grey[rows, column[:, None]]
    bins = np.round(PER_PIXEL * (rows - row[column][:, None])).astype(int)
    at = (bins - (low := int(bins.min()))).ravel()
    count = np.bincount(at)
    kept = (count >= 8) & (np.bincount(at, (y >= saturation).ravel()) < 0.01 * count)
    t, weight = (np.flatnonzero(kept) + low) / PER_PIXEL, np.sqrt(count[kept])
    mean = np.bincount(at, y.ravel())[kept] / count[kept] / saturation
    # px under the clipped edge: further down grains and light between them bend the profile;
    deep, edge = t > 4.5, t < 1.5  # from 4.5 px on it is the dark of the bed
    if deep.sum() < 4 or edge.sum() < 6:
        return NAN, NAN
    dark, t, mean, weight = float(np.average(mean[deep], weights=weight[deep] ** 2)), t[edge], mean[edge], weight[edge]
    fit = scipy.optimize.least_squares(
        lambda p: weight * (dark + (p[0] - dark) * scipy.special.ndtr(-(t - p[1]) / p[2]) - mean),
        [1.2, -0.3, 1.2],
        bounds=([0.8, -3.0, 0.3], [4.0, 1.0, 4.0]),
    )
    variance = 2.0 * fit.cost / (t.size - 3) * np.linalg.pinv(fit.jac.T @ fit.jac)[1, 1]
    return float(fit.x[1]), math.hypot(math.sqrt(max(0.0, float(variance))), CLIPPED_EDGE.value * float(fit.x[1]))


def glow_shift(grey: Array, row: Array) -> tuple[float, float]:
    """(shift, sigma) [px, rows down] to add to the edges `row` (n,) [px] of an image (rows, n), NaN = no edge.

    Fitted to the mean profile is dark + (light - dark) Phi(-(t - shift)/s) + glow E(t - shift), with E an exponential
    decay below the edge blurred by the same s. Zero where a profile without glow fits nearly as well (VISIBLE_GLOW):
    grain texture bends the profile too, and a glow that is not there would be fitted to it.
    """
    ny = grey.shape[0]
    column = np.flatnonzero(np.isfinite(row) & (row > REACH + 1) & (row < ny - REACH - 2))
    if column.size < LEAST_COLUMNS:
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
        tail = np.exp(np.clip(0.5 * (s / depth) ** 2 - u / depth, -50.0, 50.0)) * scipy.special.ndtr(u / s - s / depth)
        return np.asarray(bottom + (top - bottom) * scipy.special.ndtr(-u / s) + glow * tail)

    start, low_p, high_p = (
        [0.0, 1.0, 0.05, 2.0, 1.0, 0.0],
        [-2.0, 0.3, 0.0, 0.5, 0.5, -0.5],
        [2.0, 4.0, 0.4, 6.0, 1.5, 0.5],
    )
    fit = scipy.optimize.least_squares(lambda p: weight * (model(p) - mean), start, bounds=(low_p, high_p))
    without = [True, True, False, False, True, True]  # the same without a glow
    plain = scipy.optimize.least_squares(
        lambda q: weight * (model(np.concatenate([q[:2], [0.0, 1.0], q[2:]])) - mean),
        np.compress(without, start),
        bounds=(np.compress(without, low_p), np.compress(without, high_p)),
    )
    if plain.cost < VISIBLE_GLOW.value * fit.cost:
        return 0.0, 0.0
    variance = 2.0 * fit.cost / max(1, t.size - 6) * np.linalg.pinv(fit.jac.T @ fit.jac)[0, 0]
    return float(fit.x[0]), math.sqrt(max(0.0, float(variance)))
