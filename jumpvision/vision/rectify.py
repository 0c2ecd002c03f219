"""A picture as a camera without lens errors, looking straight at the plane of the marks, would have seen it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jumpvision.vision.camera import Camera

Array = NDArray[np.float64]
ROUNDS = 50  # of the fixed-point inversion of lens and view, at most
CLOSE = 1e-4  # px, a change that ends it


def straight_points(view: Camera, shape: tuple[int, int], scale: float, x: Array, y: Array) -> tuple[Array, Array]:
    """Column, row in the straight picture of seen columns x, rows y [px]; x right, y up, `scale` [m/px].

    shape: (rows, columns) of both pictures; what is seen at the middle of the one lies at the middle of the other.
    """
    middle = np.array([(shape[1] - 1) / 2]), np.array([(shape[0] - 1) / 2])
    right, up = (f(x, y) - f(*middle) for f in (view.across, view.height))
    return middle[0] + right / scale, middle[1] - up / scale


def straight_map(view: Camera, shape: tuple[int, int], scale: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Seen (column, row) of every pixel of the straight picture, shape (rows, columns) each: the maps of cv2.remap."""
    row, column = np.mgrid[: shape[0], : shape[1]].astype(float)
    x, y = column.copy(), row.copy()
    for _ in range(ROUNDS):
        c, r = straight_points(view, shape, scale, x, y)
        x, y = x + (column - c), y + (row - r)
        if max(np.abs(column - c).max(), np.abs(row - r).max()) < CLOSE:
            break
    c, r = straight_points(view, shape, scale, x, y)
    off = float(np.max(np.hypot(column - c, row - r)))
    if not off < 0.01:
        raise ValueError(
            f"[calibration]: the picture cannot be straightened ({off:.3g} px left over): the lens or the view is too "
            "far from a straight one; check k1, k2 and marks"
        )
    return x.astype(np.float32), y.astype(np.float32)
