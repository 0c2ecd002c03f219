"""Which vectors disagree with their neighbours, and what the neighbours would put in their place."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NOISE_FLOOR = 0.1  # px: disagreement that is never an outlier by itself (Westerweel & Scarano 2005)
MIN_NEIGHBOURS = 3


def neighbours(f: Array, reach: int) -> Array:
    """Values around each vector without its own, shape ((2 reach + 1)^2 - 1, ny, nx); NaN outside the grid."""
    ny, nx = f.shape
    p = np.pad(f, reach, constant_values=np.nan)
    side = range(2 * reach + 1)
    return np.stack([p[j : j + ny, i : i + nx] for j in side for i in side if (j, i) != (reach, reach)])


def nanmedian(f: Array) -> Array:
    """Median over the first axis without NaN; NaN where nothing is left."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # all-NaN slices are values here
        return np.nanmedian(f, axis=0)


def normalised_median(u: Array, v: Array) -> Array:
    """Residual of each vector against the median of its 8 neighbours, over their own scatter.

    u, v: (ny, nx) [px], NaN = no vector. Above about 2 is an outlier. NaN with fewer than 3 neighbours or no vector.
    Westerweel & Scarano 2005, doi:10.1007/s00348-005-0016-6, eq. (2), both components together.
    """
    total = np.zeros(u.shape)
    for f in (u, v):
        near = neighbours(f, 1)
        middle = nanmedian(near)
        scatter = nanmedian(np.abs(near - middle))
        total += ((f - middle) / (scatter + NOISE_FLOOR)) ** 2
    few = np.isfinite(neighbours(u, 1)).sum(0) < MIN_NEIGHBOURS
    return np.where(few, np.nan, np.sqrt(total))


def local_median(f: Array) -> tuple[Array, Array]:
    """Median of the neighbours (3 x 3, else 5 x 5) and their robust scatter; NaN with fewer than 3 of them."""
    middle, scatter = np.full(f.shape, np.nan), np.full(f.shape, np.nan)
    for reach in (2, 1):
        near = neighbours(f, reach)
        enough = np.isfinite(near).sum(0) >= MIN_NEIGHBOURS
        m = nanmedian(near)
        middle = np.where(enough, m, middle)
        scatter = np.where(enough, 1.4826 * nanmedian(np.abs(near - m)), scatter)
    return middle, scatter
