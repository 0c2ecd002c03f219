"""Two cameras to positions in space: a pinhole each from marks of known places, then what both saw of one body.

The camera (OpenCV's model): a place X [m] lies at R X + T = (a, b, c) before the camera, and
is seen at column f a/c d + c_x, row f b/c d + c_y, with d = 1 + k1 (a^2 + b^2)/c^2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import scipy
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array
from jumpvision.films.calibration import CLICKED_MARK

FOCAL, CENTRE, BENT, TURN, SHIFT = 0, slice(1, 3), 3, slice(4, 7), slice(7, 10)  # places in p of a Pinhole
LEAST_MARKS = 6  # marks of a camera, not in one plane
FAR = 5.5  # sigma by which the rays of one body miss each other: chance 4e-8


@dataclass(frozen=True)
class Pinhole:
    """A camera from its marks. p: (10,) f, c_x, c_y [px], k1, rotation vector (3,), T (3,) [m].

    covariance: (10, 10) of p, zero for what was not fitted. residual_px: rms of a coordinate; NaN with none to spare.
    """

    p: Array
    covariance: Array
    residual_px: float

    def sees(self, place: Array, radius: float = 0.0) -> Array:
        """(..., 2) column, row [px] of places (..., 3) [m]; of a ball of `radius` [m] the centre of its outline."""
        return projected(self.p, place, radius)


def projected(p: Array, place: Array, radius: float = 0.0) -> Array:
    """(..., 2) column, row [px] of places (..., 3) [m] by the camera p (10,), as in `Pinhole`.

    The outline of a ball of `radius` [m] is an ellipse about a c/(c^2 - radius^2), not about a/c: the tangent cone.
    """
    rotation = scipy.spatial.transform.Rotation.from_rotvec(p[TURN]).as_matrix()
    a, b, c = np.moveaxis(np.asarray(place) @ rotation.T + p[SHIFT], -1, 0)
    x, y = (q * c / (c * c - radius * radius) for q in (a, b))
    scale = p[FOCAL] * (1.0 + p[BENT] * (x * x + y * y))
    return np.stack([scale * x, scale * y], axis=-1) + p[CENTRE]


def pinhole(pixel: ArrayLike, place: ArrayLike, *, lens: bool = False) -> Pinhole:
    """The camera that sees marks at `place` (n, 3) [m] in `pixel` (n, 2) column, row [px], by least squares.

    lens: fit the distortion k1 too. The places count as exact; what is left of the pixels over the spare coordinates is
    their uncertainty, or CLICKED_MARK where none or too few (below 3) are to spare. Raises ValueError for fewer than
    LEAST_MARKS marks, marks in one plane, or none that a camera could see so.
    """
    pixel, place = np.asarray(pixel, float), np.asarray(place, float)
    if pixel.shape != (len(place), 2) or place.shape != (len(place), 3):
        raise ValueError(f"marks: pixels {pixel.shape} and places {place.shape}: give (n, 2) and (n, 3)")
    if not (np.isfinite(pixel).all() and np.isfinite(place).all()):
        raise ValueError("marks: a coordinate is not a finite number")
    if len(place) < LEAST_MARKS:
        raise ValueError(f"marks: {len(place)}; a camera needs {LEAST_MARKS} or more, not all in one plane")
    size = np.linalg.svd(place - place.mean(axis=0), compute_uv=False)
    if size[2] < 1e-2 * size[0]:
        raise ValueError("marks: they lie in one plane (or nearly); add some before or behind it")
    start = _start(pixel, place)
    free = np.array([True, True, True, lens, *[True] * 6])

    def off(q: Array) -> Array:
        p = start.copy()
        p[free] = q
        return np.asarray((projected(p, place) - pixel).ravel())

    found = scipy.optimize.least_squares(off, start[free], x_scale="jac", method="trf", xtol=1e-14, ftol=1e-14)
    spare = pixel.size - int(free.sum())
    residual = math.sqrt(2.0 * found.cost / spare) if spare > 0 else math.nan
    p, covariance = start.copy(), np.zeros((10, 10))
    p[free] = found.x
    depth = place @ scipy.spatial.transform.Rotation.from_rotvec(p[TURN]).as_matrix()[2] + p[SHIFT][2]
    if not (p[FOCAL] > 0.0 and (depth > 0.0).all()):
        raise ValueError("marks: no camera sees them so; are pixels and places in the same order, rows counted down?")
    noise = residual if spare >= 3 else CLICKED_MARK.value
    scale = np.linalg.norm(found.jac, axis=0)
    covariance[np.ix_(free, free)] = noise**2 * np.linalg.pinv((found.jac / scale).T @ (found.jac / scale))
    covariance[np.ix_(free, free)] /= np.outer(scale, scale)
    return Pinhole(p, covariance, residual)


def _start(pixel: Array, place: Array) -> Array:
    """p (10,) of the direct linear transformation (Abdel-Aziz & Karara 1971), in normalised coordinates."""
    m, s = pixel.mean(axis=0), pixel.std()
    centre, spread = place.mean(axis=0), place.std()
    u, w = (pixel - m) / s, np.column_stack([(place - centre) / spread, np.ones(len(place))])
    zero = np.zeros_like(w)
    rows = np.vstack([np.hstack([w, zero, -u[:, :1] * w]), np.hstack([zero, w, -u[:, 1:] * w])])
    matrix = np.linalg.svd(rows)[2][-1].reshape(3, 4)
    back = np.array([[s, 0.0, m[0]], [0.0, s, m[1]], [0.0, 0.0, 1.0]])
    shift = np.eye(4)
    shift[:3] = np.column_stack([np.eye(3) / spread, -centre / spread])
    matrix = back @ matrix @ shift
    matrix = matrix * np.sign(np.mean(np.column_stack([place, np.ones(len(place))]) @ matrix[2]))
    inner, turn, _ = cv2.decomposeProjectionMatrix(matrix)[:3]
    inner = inner / inner[2, 2]
    turn = turn * np.sign(np.linalg.det(turn))
    if inner[0, 0] < 0.0:  # the decomposition may turn two axes of both
        inner, turn = inner @ np.diag([-1.0, -1.0, 1.0]), np.diag([-1.0, -1.0, 1.0]) @ turn
    focal = float(np.sqrt(abs(inner[0, 0] * inner[1, 1])))
    shift3 = np.linalg.lstsq(inner @ np.eye(3), matrix[:, 3] / np.linalg.norm(matrix[2, :3]), rcond=None)[0]
    rotation = scipy.spatial.transform.Rotation.from_matrix(turn).as_rotvec()
    return np.concatenate([[focal, inner[0, 2], inner[1, 2], 0.0], rotation, shift3])


@dataclass(frozen=True)
class Places:
    """Positions (n, 3) [m] with two sigmas (n, 3) [m]: of the pixels, independent from frame to frame, and of the two
    cameras, shared by all. miss: (n,) by how many sigma of both the two rays miss each other, without sign."""

    place: Array
    sigma: Array
    common: Array
    miss: Array


def triangulate(
    cameras: tuple[Pinhole, Pinhole], pixels: tuple[Array, Array], sigmas: tuple[Array, Array], radius: float = 0.0
) -> Places:
    """The places of one body from what both cameras saw: the most likely ones, by Gauss and Newton.

    pixels: of each camera (n, 2) column, row [px], NaN where it saw nothing; sigmas: (n,) [px] of either coordinate.
    radius [m]: of a ball whose outline was measured, 0 of a point.
    """
    seen, weight = np.concatenate(pixels, axis=1), 1.0 / np.repeat(np.stack(sigmas, axis=1), 2, axis=1)

    def view(place: Array) -> Array:
        return np.concatenate([c.sees(place, radius) for c in cameras], axis=-1)

    place = _crossing(cameras, pixels)
    for _ in range(12):  # Gauss-Newton; each squares the error
        slope = _slope(view, place)
        step = _solved(slope * weight[:, :, None], (seen - view(place)) * weight)
        place = place + step
        if not np.nanmax(np.abs(step), initial=0.0) > 1e-12 * max(np.nanmax(np.abs(place), initial=0.0), 1e-6):
            break
    slope = _slope(view, place)
    scaled = slope * weight[:, :, None]
    good = np.isfinite(scaled).all(axis=(1, 2))
    inverse = np.full((len(place), 3, 3), np.nan)
    inverse[good] = np.linalg.inv(np.swapaxes(scaled[good], 1, 2) @ scaled[good])
    beside = np.full((len(place), 4), np.nan)  # the direction of pixels that no place explains
    beside[good] = np.linalg.svd(scaled[good])[0][:, :, 3]
    common, apart = np.zeros((len(place), 3)), np.ones(len(place))
    for k, camera in enumerate(cameras):
        own = slice(2 * k, 2 * k + 2)
        by = weight[:, own, None] * _by_parameter(camera, place, radius)
        moved = inverse @ np.swapaxes(scaled[:, own], 1, 2) @ by
        common += np.einsum("nij,jk,nik->ni", moved, camera.covariance, moved)
        parted = np.einsum("ni,nij->nj", beside[:, own], by)
        apart += np.einsum("nj,jk,nk->n", parted, camera.covariance, parted)
    miss = np.abs(np.sum(beside * (seen - view(place)) * weight, axis=1)) / np.sqrt(apart)
    return Places(place, np.sqrt(np.diagonal(inverse, axis1=1, axis2=2)), np.sqrt(common), miss)


def _crossing(cameras: tuple[Pinhole, Pinhole], pixels: tuple[Array, Array]) -> Array:
    """(n, 3) where the two rays are nearest, the distortion taken out to first order."""
    normal, right = np.zeros((len(pixels[0]), 3, 3)), np.zeros((len(pixels[0]), 3))
    for camera, pixel in zip(cameras, pixels):
        p = camera.p
        rotation = scipy.spatial.transform.Rotation.from_rotvec(p[TURN]).as_matrix()
        x = (pixel - p[CENTRE]) / p[FOCAL]
        x = x / (1.0 + p[BENT] * np.sum(x * x, axis=1, keepdims=True))
        ray = np.column_stack([x, np.ones(len(x))]) @ rotation
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        across = np.eye(3) - ray[:, :, None] * ray[:, None, :]
        normal += across
        right += across @ (-rotation.T @ p[SHIFT])
    out = np.full_like(right, np.nan)
    good = np.isfinite(normal).all(axis=(1, 2))
    out[good] = np.linalg.solve(normal[good], right[good][..., None])[..., 0]
    return out


def _slope(view: Callable[[Array], Array], place: Array) -> Array:
    """(n, 4, 3) of the four pixel coordinates by place [px/m]."""
    step = 1e-5 * max(float(np.nanmax(np.abs(place), initial=0.0)), 1e-3)
    sides = [(view(place + step * e) - view(place - step * e)) / (2.0 * step) for e in np.eye(3)]
    return np.stack(sides, axis=-1)


def _by_parameter(camera: Pinhole, place: Array, radius: float) -> Array:
    """(n, 2, 10) of a camera's pixel coordinates by its parameters."""
    sides = []
    for k in range(10):
        step = np.zeros(10)
        step[k] = 1e-6 * max(abs(camera.p[k]), 1e-2)  # of the parameter's own scale
        up, down = (projected(camera.p + s * step, place, radius) for s in (1, -1))
        sides.append((up - down) / (2.0 * step[k]))
    return np.stack(sides, axis=-1)


def _solved(design: Array, off: Array) -> Array:
    """(n, 3) least squares of design (n, 4, 3), off (n, 4); NaN where something is."""
    out = np.full((len(off), 3), np.nan)
    good = np.isfinite(design).all(axis=(1, 2)) & np.isfinite(off).all(axis=1)
    turned = np.swapaxes(design[good], 1, 2)
    out[good] = np.linalg.solve(turned @ design[good], turned @ off[good][..., None])[..., 0]
    return out


def at_times(time: Array, values: Array, sigma: Array, wanted: Array) -> tuple[Array, Array]:
    """(values, sigma) at the times wanted (m,): cubics through the four samples about each (n, k), sigma (n,) of each.

    NaN outside the samples and where one of the four is NaN; a sample at the very time is itself.
    """
    first = np.clip(np.searchsorted(time, wanted) - 2, 0, max(len(time) - 4, 0))
    near = np.clip(first[:, None] + np.arange(min(4, len(time))), 0, len(time) - 1)
    t = time[near]
    share = np.ones_like(t)
    for i in range(t.shape[1]):
        for j in range(t.shape[1]):
            if i != j:
                share[:, i] *= (wanted - t[:, j]) / (t[:, i] - t[:, j])
    used = share != 0.0  # a sample at the very time needs no other
    out = np.sum(np.where(used[..., None], share[..., None] * values[near], 0.0), axis=1)
    spread = np.sqrt(np.sum(np.where(used, share * sigma[near], 0.0) ** 2, axis=1))
    outside = (wanted < time[0]) | (wanted > time[-1])
    return np.where(outside[:, None], np.nan, out), np.where(outside, np.nan, spread)
