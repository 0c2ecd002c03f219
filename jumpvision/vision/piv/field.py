"""The result of one image pair: displacement vectors on a regular grid, each with uncertainty and reason."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

VALID, MASKED, NO_TEXTURE, LOW_CORRELATION, SECOND_PEAK, INTERPOLATED, EDGE_PEAK, NOT_CONVERGED = range(8)

REASONS: dict[int, str] = {
    VALID: "valid",
    MASKED: "masked: less than half of the window is usable",
    NO_TEXTURE: "no texture in the window",
    LOW_CORRELATION: "low correlation or uncertainty above 2 px, replaced by interpolation",
    SECOND_PEAK: "outlier, replaced by the second correlation peak or by a match started from its neighbours",
    INTERPOLATED: "outlier (normalised median), replaced by interpolation",
    EDGE_PEAK: "correlation peak at the edge of the search, replaced by interpolation",
    NOT_CONVERGED: "the match did not converge, replaced by interpolation",
}
MATCHED = (VALID, LOW_CORRELATION, SECOND_PEAK, INTERPOLATED, EDGE_PEAK, NOT_CONVERGED)  # windows with texture
MEASURED = (VALID, SECOND_PEAK)  # codes whose u, v are matches of the images and not an interpolation


@dataclass(frozen=True)
class VectorField:
    """Displacement between two frames, image axes: x = column to the right, y = row DOWN, pixel centres at integers.

    The material at (x, y) half-way in time between the frames moves by (u, v) px from the first frame to the second.
    Where `reason` is a replacement, u and v are the robust mean of the measured neighbours and u_sigma, v_sigma their
    scatter; without enough neighbours, and where masked or without texture, they are NaN.
    """

    x: Array  # (nx,) [px]
    y: Array  # (ny,) [px]
    u: Array  # (ny, nx) [px/frame pair], to the right
    v: Array  # (ny, nx) [px/frame pair], down
    u_sigma: Array  # (ny, nx) [px], standard uncertainty
    v_sigma: Array
    correlation: Array  # (ny, nx) normalised correlation of the matched windows, -1..1
    reason: NDArray[np.int8]  # (ny, nx) key of REASONS
    u_raw: Array  # (ny, nx) before replacement
    v_raw: Array
    gradient: Array  # (2, 2, ny, nx) [1], [[u_x, u_y], [v_x, v_y]] fitted inside the window, NaN where not measured
    gradient_sigma: Array  # (2, 2, ny, nx) [1], standard uncertainty
