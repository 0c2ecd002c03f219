"""From pixels to metres: lens distortion, marks, the direction of the rail. The one place where the two meet."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import Array
from jumpvision.films.calibration import CLICKED_MARK

UP = {"-y": 1j, "+y": -1j, "-x": -1.0, "+x": 1.0}  # image directions as complex numbers, x right, y up
OFF = 0.3  # px rms, by which marks are missed when they are clicked: less is no sign of perspective
SURE = 0.01  # chance of calling marks on a plane seen straight on a perspective view


@dataclass(frozen=True)
class Camera:
    """Map from seen pixels to metres: z_m = a z_px + b after undistortion, in complex numbers x + i y (x right, y up).

    a, b: [m/px], [m]. k1, k2: radial distortion [1/px^2], [1/px^4] about `centre` (column, row) [px].
    rail: unit vector of the rail's upward direction. homography: (3, 3), (column, row, 1) to (x, y, 1) w in metres, in
    place of a and b where the marks show perspective (a is then the mean scale).
    residual_px: rms distance of the marks from where the map puts them [px]; NaN where it has none to spare.
    scale_sigma: standard uncertainty of the scale [m/px], the same in every picture of this camera.
    """

    a: complex
    b: complex
    rail: complex
    k1: float
    k2: float
    centre: tuple[float, float]
    homography: Array | None = None
    residual_px: float = math.nan
    scale_sigma: float = 0.0

    @property
    def scale_share(self) -> float:
        """Relative standard uncertainty of the scale."""
        return self.scale_sigma / self.scale

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
        return np.real(self._plane(x, y) * np.conj(self.rail))

    def across(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Position across the rail [m], to the right of its upward direction, of seen columns x and rows y [px]."""
        return np.real(self._plane(x, y) * np.conj(-1j * self.rail))

    def _plane(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.complex128]:
        column, row = self.undistorted(x, y)
        if self.homography is None:
            return np.asarray(self.a * (column - 1j * row) + self.b)
        h = self.homography
        w = h[2, 0] * column + h[2, 1] * row + h[2, 2]
        first, second = (h[k, 0] * column + h[k, 1] * row + h[k, 2] for k in (0, 1))
        return np.asarray((first + 1j * second) / w)


def camera(
    *,
    scale: float | None,
    up: str,
    tilt: float,
    marks: ArrayLike,
    k1: float,
    k2: float,
    centre: tuple[float, float],
    scale_sigma: float = 0.0,
) -> Camera:
    """The camera of a film.

    scale, scale_sigma: [m/px], not needed with marks, which measure both (`marks_share`). up: image direction of
    physical up, "-y" | "+y" | "-x" | "+x". tilt: angle of the rail against that direction, counter-clockwise [rad].
    marks: (n, 4) px, py [px], x, y [m] (y up); a similarity is fitted to two or more of them, and `up` is then +y. From
    four marks on it gives way to a homography (perspective) where it leaves more than OFF px rms and, from five on,
    where the homography is better by an F test at SURE.
    Raises ValueError without scale and marks.
    """
    turn = np.exp(1j * tilt)
    bare = Camera(scale or 1.0, 0.0, UP[up] * turn, k1, k2, centre, scale_sigma=scale_sigma)
    known = np.asarray(marks, float)
    if known.size:
        column, row = bare.undistorted(known[:, 0], known[:, 1])
        design = np.column_stack([column - 1j * row, np.ones(len(known))])
        (a, b), *_ = np.linalg.lstsq(design, known[:, 2] + 1j * known[:, 3], rcond=None)
        if abs(a) == 0 or not np.isfinite(a):
            raise ValueError("[calibration] marks: the points do not define a scale; give two different points")
        true = known[:, 2] + 1j * known[:, 3]
        off = np.abs(design @ [a, b] - true) / abs(a)
        spare = 2 * len(known) - 4
        left = float(np.sqrt(np.sum(off**2) / spare)) if spare else math.nan
        spread = abs(a) * marks_share(column - 1j * row, left)
        flat = Camera(complex(a), complex(b), 1j * turn, k1, k2, centre, None, left, spread)
        if len(known) < 4 or left <= OFF:
            return flat
        h = _homography(np.column_stack([column, row]), known[:, 2:])
        if h is None:
            return flat
        spread = abs(a) * marks_share(column - 1j * row, math.nan)
        tilted = Camera(complex(a), complex(b), 1j * turn, k1, k2, centre, h, scale_sigma=spread)
        rest = float(np.sum(np.abs(tilted._plane(known[:, 0], known[:, 1]) - true) ** 2)) / abs(a) ** 2
        spare -= 4
        if spare == 0:
            return tilted
        gain = (float(np.sum(off**2)) - rest) / 4.0 / max(rest / spare, 1e-300)
        if scipy.special.fdtrc(4, spare, gain) >= SURE:
            return flat
        left = math.sqrt(rest / spare)
        return replace(tilted, residual_px=left, scale_sigma=abs(a) * marks_share(column - 1j * row, left))
    if scale is None:
        raise ValueError("scale: missing; give the metres per pixel, or two marks in [calibration]")
    return bare


def marks_share(place: NDArray[np.complex128], residual: float) -> float:
    """Relative standard uncertainty of the scale of marks at `place` (n,) [px], from the least squares of a similarity.

    residual [px]: of each coordinate, from more marks than the map needs; NaN without any to spare (two marks): then
    CLICKED_MARK. The known distances count as exact.
    """
    noise = residual if math.isfinite(residual) else CLICKED_MARK.value
    return noise / float(np.sqrt(np.sum(np.abs(place - place.mean()) ** 2)))


def _homography(pixel: Array, metre: Array) -> Array | None:
    """(3, 3) with (column, row, 1) -> (x, y, 1) w of least algebraic error, normalised (Hartley 1997); None for places
    in one line. OpenCV's is refined to the least distances in metres, while the clicks err in pixels."""
    from skimage.transform import estimate_transform  # here: its import takes a quarter of a second

    found = getattr(estimate_transform("projective", pixel, metre), "params", None)
    return found if found is not None and np.isfinite(found).all() else None


def straight_points(view: Camera, shape: tuple[int, int], scale: float, x: Array, y: Array) -> tuple[Array, Array]:
    """Column, row in the straight picture of seen columns x, rows y [px]; x right, y up, `scale` [m/px].

    shape: (rows, columns) of both pictures; what is seen at the middle of the one lies at the middle of the other.
    """
    middle = np.array([(shape[1] - 1) / 2]), np.array([(shape[0] - 1) / 2])
    right, up = (f(x, y) - f(*middle) for f in (view.across, view.height))
    return middle[0] + right / scale, middle[1] - up / scale


def straight_map(view: Camera, shape: tuple[int, int], scale: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the seen (column, row) of every pixel of the straight picture, shape (rows, columns) each."""
    row, column = np.mgrid[: shape[0], : shape[1]].astype(float)
    x, y = column.copy(), row.copy()
    for _ in range(50):  # a fixed point; a strong lens takes ten rounds
        c, r = straight_points(view, shape, scale, x, y)
        x, y = x + (column - c), y + (row - r)
        if max(np.abs(column - c).max(), np.abs(row - r).max()) < 1e-4:  # px
            break
    c, r = straight_points(view, shape, scale, x, y)
    off = float(np.max(np.hypot(column - c, row - r)))
    if not off < 0.01:
        raise ValueError(
            f"[calibration]: the picture cannot be straightened ({off:.3g} px left over): the lens or the view is too "
            "far from a straight one; check k1, k2 and marks"
        )
    return x.astype(np.float32), y.astype(np.float32)
