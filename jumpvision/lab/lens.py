"""Lens and glass of the laboratory's cameras: distortion, darker corners, a reflection that stands still."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Lens(NamedTuple):
    """Distortion: true offset from (row, column) = seen offset x (1 + k1 r^2 + k2 r^4), r the seen offset [px]."""

    k1: float
    k2: float
    row: float
    column: float


NO_LENS = Lens(0.0, 0.0, 0.0, 0.0)


@nb.njit(cache=True)
def true_place(row, column, lens):  # type: ignore[no-untyped-def]
    y, x = row - lens.row, column - lens.column
    r2 = x * x + y * y
    more = 1.0 + lens.k1 * r2 + lens.k2 * r2 * r2
    return lens.row + y * more, lens.column + x * more


@nb.njit(cache=True)
def seen_place(row, column, lens):  # type: ignore[no-untyped-def]
    """Inverse of `true_place`, by fixed-point steps; to 1e-9 px for distortions of some per cent."""
    y, x = row, column
    for _ in range(60):
        true_row, true_column = true_place(y, x, lens)
        y, x = y + row - true_row, x + column - true_column
    return y, x


def seen_places(rows: Array, column: float, lens: Lens) -> tuple[Array, Array]:
    """Rows and columns, each like `rows`, at which the lens shows points of an undistorted picture."""
    places = np.array([seen_place(r, column, lens) for r in np.ravel(rows)]).reshape(*np.shape(rows), 2)
    return places[..., 0], places[..., 1]


def lens_of(k1: float, k2: float, shape: tuple[int, int]) -> Lens:
    """The lens whose axis meets the middle of a picture of `shape` (rows, columns)."""
    return Lens(k1, k2, 0.5 * (shape[0] - 1), 0.5 * (shape[1] - 1))


def margin(shape: tuple[int, int], lens: Lens) -> int:
    """How many pixels a distorting lens sees beyond the borders of an undistorted picture of `shape`, and 6 more."""
    if lens.k1 == 0.0 and lens.k2 == 0.0:
        return 0
    row, column = true_place(0.0, 0.0, lens)
    return max(math.ceil(max(-row, -column)), 0) + 6


def distorted(wide: Array, lens: Lens, shape: tuple[int, int]) -> Array:
    """What the lens shows, of `shape`, of an undistorted picture with `margin` more pixels on every side.

    Cubic splines between pixels: a wave of 4 px is off by 2 % of its amplitude at most, one of 8 px by 0.1 %.
    """
    from scipy.ndimage import map_coordinates

    m = margin(shape, lens)
    if m == 0:
        return wide
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    y, x = y - lens.row, x - lens.column
    r2 = x * x + y * y
    more = 1.0 + lens.k1 * r2 + lens.k2 * r2 * r2
    places = [lens.row + y * more + m, lens.column + x * more + m]
    return np.asarray(map_coordinates(wide, places, order=3, mode="nearest"), dtype=np.float64)


def shade(shape: tuple[int, int], shading: float) -> Array:
    """Share of the light that reaches the pixels: 1 in the middle, 1 - shading in the corners."""
    down, across = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    return np.asarray(1.0 - 0.5 * shading * (across**2 + down**2))


def reflection(shape: tuple[int, int], glare: float) -> Array:
    """A soft spot on the glass right of the middle, `glare` grey levels at its brightest."""
    down, across = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    return np.asarray(glare * np.exp(-((across - 0.55) ** 2) / 0.08 - (down + 0.3) ** 2 / 0.15))
