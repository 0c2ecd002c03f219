"""Which vectors disagree with their neighbours, and what the neighbours would put in their place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NOISE_FLOOR = 0.1  # px: disagreement that is never an outlier by itself (Westerweel & Scarano 2005)
MIN_NEIGHBOURS = 3


def neighbours(f: Array, reach: int, slope: tuple[Array, Array] | None = None) -> Array:
    """What the neighbours say about each vector, shape ((2 reach + 1)^2 - 1, ny, nx); NaN where there is none.

    f: (ny, nx). slope: its change per grid step (along x, along y), (ny, nx) each: every neighbour then speaks for the
    place of the vector instead of its own, so that a sheared flow along a wall or a mask is no disagreement. Without
    slopes the grid is continued linearly beyond its border.
    """
    ny, nx = f.shape
    side = range(-reach, reach + 1)
    shifts = [(j, i) for j in side for i in side if (j, i) != (0, 0)]

    def shifted(p: Array, j: int, i: int) -> Array:
        return p[reach + j : reach + j + ny, reach + i : reach + i + nx]

    if slope is None:
        p = np.pad(f, reach, mode="reflect", reflect_type="odd")
        return np.stack([shifted(p, j, i) for j, i in shifts])
    p, px, py = (np.pad(q, reach, constant_values=np.nan) for q in (f, *slope))
    return np.stack([shifted(p, j, i) - i * shifted(px, j, i) - j * shifted(py, j, i) for j, i in shifts])


def nanmedian(f: Array) -> Array:
    """Median over the first axis without NaN; NaN where nothing is left."""
    count = np.isfinite(f).sum(0)
    ordered = np.sort(f, axis=0)  # NaN last
    low, high = (np.maximum((count - 1) // 2, 0), np.minimum(count // 2, len(f) - 1))
    middle = [np.take_along_axis(ordered, q[None], 0)[0] for q in (low, high)]
    return 0.5 * (middle[0] + middle[1])


def normalised_median(
    u: Array, v: Array, slopes: tuple[tuple[Array, Array], tuple[Array, Array]] | None = None
) -> Array:
    """Residual of each vector against the median of its 8 neighbours, over their own scatter.

    u, v: (ny, nx) [px], NaN = no vector; slopes of u and of v as in `neighbours`. Above about 2 is an outlier. NaN
    with fewer than 3 neighbours or no vector. Westerweel & Scarano 2005, doi:10.1007/s00348-005-0016-6, eq. (2), both
    components together.
    """
    total = np.zeros(u.shape)
    few = np.zeros(u.shape, bool)
    for f, slope in zip((u, v), slopes or (None, None)):
        near = neighbours(f, 1, slope)
        middle = nanmedian(near)
        total += ((f - middle) / (nanmedian(np.abs(near - middle)) + NOISE_FLOOR)) ** 2
        few |= np.isfinite(near).sum(0) < MIN_NEIGHBOURS
    return np.where(few, np.nan, np.sqrt(total))


def local_median(f: Array, slope: tuple[Array, Array] | None = None) -> tuple[Array, Array]:
    """Median of the neighbours (3 x 3, else 5 x 5) and their robust scatter; NaN with fewer than 3 of them."""
    middle, scatter = np.full(f.shape, np.nan), np.full(f.shape, np.nan)
    for reach in (2, 1):
        near = neighbours(f, reach, slope)
        enough = np.isfinite(near).sum(0) >= MIN_NEIGHBOURS
        m = nanmedian(near)
        middle = np.where(enough, m, middle)
        scatter = np.where(enough, 1.4826 * nanmedian(np.abs(near - m)), scatter)
    return middle, scatter
