"""From pixels to metres: lens distortion, marks, the direction of the rail. The one place where the two meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
UP = {"-y": 1j, "+y": -1j, "-x": -1.0, "+x": 1.0}  # image directions as complex numbers, x right, y up


@dataclass(frozen=True)
class Camera:
    """Linear map z_m = a z_px + b after undistortion, in complex numbers x + i y (x right, y up).

    a, b: [m/px], [m]. k1, k2: radial distortion [1/px^2], [1/px^4] about `centre` (column, row) [px].
    rail: unit vector of the rail's upward direction.
    """

    a: complex
    b: complex
    rail: complex
    k1: float
    k2: float
    centre: tuple[float, float]

    @property
    def scale(self) -> float:
        """Metres per pixel."""
        return abs(self.a)

    def undistorted(self, x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
        """True pixel position of seen columns x and rows y: offset from the centre x (1 + k1 r^2 + k2 r^4)."""
        dx, dy = np.asarray(x, float) - self.centre[0], np.asarray(y, float) - self.centre[1]
        r2 = dx**2 + dy**2
        factor = 1 + self.k1 * r2 + self.k2 * r2**2
        return self.centre[0] + dx * factor, self.centre[1] + dy * factor

    def height(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Position along the rail [m], up positive, of seen columns x and rows y (down) [px]."""
        column, row = self.undistorted(x, y)
        z = self.a * (column - 1j * row) + self.b
        return np.real(z * np.conj(self.rail))


def camera(
    *,
    scale: float | None,
    up: str,
    tilt: float,
    marks: ArrayLike,
    k1: float,
    k2: float,
    centre: tuple[float, float],
) -> Camera:
    """The camera of a film.

    scale: [m/px], not needed with marks. up: image direction of physical up, "-y" | "+y" | "-x" | "+x".
    tilt: angle of the rail against that direction, counter-clockwise [rad].
    marks: (n, 4) px, py [px], x, y [m] (y up); a similarity is fitted to two or more of them, and `up` is then +y.
    Raises ValueError without scale and marks.
    """
    turn = np.exp(1j * tilt)
    bare = Camera(scale or 1.0, 0.0, UP[up] * turn, k1, k2, centre)
    known = np.asarray(marks, float)
    if known.size:
        column, row = bare.undistorted(known[:, 0], known[:, 1])
        design = np.column_stack([column - 1j * row, np.ones(len(known))])
        (a, b), *_ = np.linalg.lstsq(design, known[:, 2] + 1j * known[:, 3], rcond=None)
        if abs(a) == 0 or not np.isfinite(a):
            raise ValueError("[calibration] marks: the points do not define a scale; give two different points")
        return Camera(complex(a), complex(b), 1j * turn, k1, k2, centre)
    if scale is None:
        raise ValueError("scale: missing; give the metres per pixel, or two marks in [calibration]")
    return bare
