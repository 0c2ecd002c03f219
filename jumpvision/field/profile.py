"""Downward speed of the grains in the central column under the foot."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.field.correlation import overlap

Array = NDArray[np.float64]


def central_column(
    v: ArrayLike, v_sigma: ArrayLike, valid: ArrayLike, x: ArrayLike, *, half_width: float, correlation_length: float
) -> tuple[Array, Array]:
    """(speed, sigma) [m/s], positive DOWN, shape (ny,): the weighted mean over |x| <= half_width in each row.

    v, v_sigma [m/s], v positive up, valid [bool]: (ny, nx); x (nx,) [m] from the axis. correlation_length: window
    width / grid step (`field.correlation`): errors of neighbours in a row are alike, and sigma holds it exactly. NaN
    in rows without a valid vector. Raises ValueError where no vector lies in the column.
    """
    x = np.asarray(x, float)
    near = np.flatnonzero(np.abs(x) <= half_width)
    if near.size == 0:
        raise ValueError(f"half_width = {half_width:g} m: no vector so close to the foot's axis; give a larger one")
    ok = np.asarray(valid, bool)[:, near]
    s = np.where(ok, np.asarray(v_sigma, float)[:, near], 1.0)
    weight = np.where(ok, s**-2.0, 0.0)
    total = weight.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        speed = -(weight * np.where(ok, np.asarray(v, float)[:, near], 0.0)).sum(axis=1) / total
        part = weight * s / total[:, None]
    rho = overlap(
        np.abs(np.subtract.outer(np.arange(near.size), np.arange(near.size))).astype(float), correlation_length
    )
    return speed, np.sqrt(np.einsum("yi,ij,yj->y", part, rho, part))
