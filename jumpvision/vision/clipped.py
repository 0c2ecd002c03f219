"""Light above a back-lit bed that saturates the camera, and what that does to the edge.

The top of the edge is cut off, so an error function fitted to all of it puts the surface too low, in all such columns
alike. What is not clipped still shows where the edge is steepest, which does not depend on how bright the light is.
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
FEWEST = 32  # columns, below which no profile is made
BELOW = 1.5  # px under the clipped edge: further down grains and light between them bend the profile
DEEP = 4.5  # px, from which on the profile is the dark of the bed
SHAPE = 0.14  # of the shift: by how much the unknown shape of the edge moves it, by drawn pictures
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
    if column.size < FEWEST:
        return NAN, NAN
    rows = np.rint(row[column]).astype(int)[:, None] + np.arange(-REACH, REACH + 1)
    y = grey[rows, column[:, None]]
    bins = np.round(PER_PIXEL * (rows - row[column][:, None])).astype(int)
    at = (bins - (low := int(bins.min()))).ravel()
    count = np.bincount(at)
    kept = (count >= 8) & (np.bincount(at, (y >= saturation).ravel()) < 0.01 * count)
    t, weight = (np.flatnonzero(kept) + low) / PER_PIXEL, np.sqrt(count[kept])
    mean = np.bincount(at, y.ravel())[kept] / count[kept] / saturation
    deep, edge = t > DEEP, t < BELOW
    if deep.sum() < 4 or edge.sum() < 6:
        return NAN, NAN
    dark, t, mean, weight = float(np.average(mean[deep], weights=weight[deep] ** 2)), t[edge], mean[edge], weight[edge]
    fit = least_squares(
        lambda p: weight * (dark + (p[0] - dark) * ndtr(-(t - p[1]) / p[2]) - mean),
        [1.2, -0.3, 1.2],
        bounds=([0.8, -3.0, 0.3], [4.0, 1.0, 4.0]),
    )
    variance = 2.0 * fit.cost / (t.size - 3) * np.linalg.pinv(fit.jac.T @ fit.jac)[1, 1]
    return float(fit.x[1]), math.hypot(math.sqrt(max(0.0, float(variance))), SHAPE * float(fit.x[1]))
