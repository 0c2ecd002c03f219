"""Pictures of simulated discs behind glass, from their places."""

from __future__ import annotations

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array

from .grains import View
from .optics import texture

GAP, BEHIND = 22.0, 46.0  # grey: dark between the grains, shadow above the foot and the bed
LIT = 0.5, -0.10, -0.16  # share of a disc's light that comes from its bulge, and across and down its face


class DiscCamera:
    """Draws noise-free frames of discs in a window of shape (rows, columns).

    scale [m/px]; surface_row, axis_column [px]: where y = 0 and x = 0 lie. radius (n,) [m] of the discs. half_width,
    height [m] of the foot's body. glare [grey]: greatest brightness of the reflection on the glass.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        radius: Array,
        *,
        scale: float,
        surface_row: float,
        axis_column: float,
        half_width: float,
        height: float,
        glare: float,
        rng: np.random.Generator,
    ):
        self.shape, self.scale, self.surface_row, self.axis_column = shape, scale, surface_row, axis_column
        self.half_width, self.height = half_width / scale, height / scale
        n = len(radius)
        self.look = np.empty((n, 8), np.float32)  # radius [px], grey, pattern of six harmonics
        self.look[:, 0] = np.asarray(radius) / scale
        self.look[:, 1] = np.clip(rng.normal(120.0, 26.0, n), 60.0, 190.0)
        self.look[:, 2:] = rng.normal(0.0, 0.16, (n, 6))
        self.body = np.float32(56.0 + 14.0 * texture((round(self.height) + 4, shape[1]), sigma=1.2, rng=rng))
        down, across = (np.linspace(-1.0, 1.0, k)[:, None] for k in shape)
        self.light = np.float32(1.0 - 0.06 * across.T - 0.05 * down - 0.05 * (across.T**2 + down**2))
        spot = np.exp(-((across.T - 0.55) ** 2) / 0.08 - (down + 0.3) ** 2 / 0.15)
        self.glare = np.float32(glare * spot)

    def frame(self, x: Array, y: Array, foot_y: Array) -> NDArray[np.float32]:
        """Mean image (row, column) [grey] of an exposure: x, y (instant, n) [m], foot_y (instant,) [m]."""
        total = np.full(self.shape, 0.0, np.float32)
        one = np.empty(self.shape, np.float32)
        for k in range(len(foot_y)):
            one[:] = GAP
            columns, rows = self.axis_column + x[k] / self.scale, self.surface_row - y[k] / self.scale
            draw_discs(one, columns, rows, self.look)
            face = self.surface_row - foot_y[k] / self.scale
            draw_foot(one, face, face - self.height, self.axis_column, self.half_width, self.body)
            total += one
        return soften(total / np.float32(len(foot_y)), 0.55) * self.light + self.glare

    def record(
        self, mean: NDArray[np.float32], *, electrons_per_grey: float, read_noise: float, rng: np.random.Generator
    ) -> NDArray[np.uint8]:
        """Grey levels 0..255: variance mean/electrons_per_grey + read_noise^2 + 1/12.

        Normal in place of Poisson numbers: at more than 500 electrons a pixel they differ by less than the rounding.
        """
        noise = rng.standard_normal(mean.shape, dtype=np.float32)
        noise *= np.sqrt(np.maximum(mean, np.float32(0.0)) / np.float32(electrons_per_grey) + np.float32(read_noise**2))
        return np.asarray(np.clip(np.rint(mean + noise), 0, 255), dtype=np.uint8)


def soften(image: NDArray[np.float32], sigma: float) -> NDArray[np.float32]:
    """The lens: Gaussian blur by sigma [px] over 7 x 7 px, edges repeated."""
    taps = np.exp(-0.5 * (np.arange(-3, 4) / sigma) ** 2)
    out = np.empty_like(image)
    _soften(image, np.float32(taps / taps.sum()), out)
    return out


@nb.njit(cache=True, fastmath=True)
def _soften(image, taps, out):  # type: ignore[no-untyped-def]
    rows, columns = image.shape
    line = np.empty(columns + 6, np.float32)
    for i in range(rows):
        line[:] = 0.0
        for k in range(7):
            source, tap = image[min(max(i + k - 3, 0), rows - 1)], taps[k]
            for j in range(columns):
                line[j + 3] += tap * source[j]
        line[:3], line[columns + 3 :] = line[3], line[columns + 2]
        for j in range(columns):
            total = np.float32(0.0)
            for k in range(7):
                total += taps[k] * line[j + k]
            out[i, j] = total


@nb.njit(cache=True, fastmath=True)
def draw_discs(image, column, row, look):  # type: ignore[no-untyped-def]
    """Draw the discs over `image` in place; pixels on a rim are covered in proportion to the area inside."""
    height, width = image.shape
    bulge, across, below = LIT
    for g in range(len(column)):
        r, grey = look[g, 0], look[g, 1]
        c1, c2, c3, c4, c5, c6 = look[g, 2], look[g, 3], look[g, 4], look[g, 5], look[g, 6], look[g, 7]
        c0, r0 = np.float32(column[g]), np.float32(row[g])
        if not (-r - 1 < c0 < width + r and -r - 1 < r0 < height + r):
            continue
        inner, outer, by = (
            max(r - np.float32(0.5), np.float32(0.0)) ** 2,
            (r + np.float32(0.5)) ** 2,
            np.float32(1.0) / r,
        )
        for i in range(max(int(np.ceil(r0 - r - 0.5)), 0), min(int(np.floor(r0 + r + 0.5)) + 1, height)):
            b = np.float32(i) - r0
            left = outer - b * b
            if left <= 0.0:
                continue
            half = np.sqrt(left)
            for j in range(max(int(np.ceil(c0 - half)), 0), min(int(np.floor(c0 + half)) + 1, width)):
                a = np.float32(j) - c0
                square = a * a + b * b
                u, v, s = a * by, b * by, square * by * by
                p, q = u * u - v * v, np.float32(2.0) * u * v
                mark = (
                    c1 * u
                    + c2 * v
                    + c3 * p
                    + c4 * q
                    + c5 * u * (p - np.float32(2.0) * v * v)
                    + c6 * v * (p + np.float32(2.0) * u * u)
                )
                tone = grey * (
                    np.float32(1.0) - np.float32(bulge) * s + np.float32(across) * u + np.float32(below) * v + mark
                )
                if square > inner:
                    cover = min(r + np.float32(0.5) - np.sqrt(square), np.float32(1.0))
                    image[i, j] += cover * (tone - image[i, j])
                else:
                    image[i, j] = tone


@nb.njit(cache=True)
def draw_foot(image, face, top, axis, half_width, body):  # type: ignore[no-untyped-def]
    """The foot's body between the rows `top` and `face`, its texture moving with it, and the shadow above it."""
    height, width = image.shape
    for i in range(height):
        share = min(max(face - i + 0.5, 0.0), 1.0)
        if share == 0.0:
            break
        lit = min(max(i + 0.5 - top, 0.0), 1.0)
        at = min(max(i - top + 1.0, 0.0), len(body) - 1.001)
        k, part = int(at), at - int(at)
        for j in range(max(int(axis - half_width) - 1, 0), min(int(axis + half_width) + 3, width)):
            inside = min(max(half_width - abs(j - axis) + 0.5, 0.0), 1.0)
            tone = BEHIND + lit * (body[k, j] * (1.0 - part) + body[k + 1, j] * part - BEHIND)
            image[i, j] += inside * share * (tone - image[i, j])


def disc_momentum(
    view: View, t: Array, x: Array, y: Array, face: Array, *, diameter: float, bed_density: float
) -> Array:
    """Downward momentum [kg m/s] of each pair of frames in view below the foot's face, (n - 1,), mean of both halves.

    x, y (n, disc) [m], face (n,) [m] at the times t (n,) [s].
    """
    from scipy.spatial import cKDTree

    left, right = (-0.5 - view.axis_column) * view.scale, (view.shape[1] - 0.5 - view.axis_column) * view.scale
    bottom = -(view.shape[0] - 0.5 - view.surface_row) * view.scale
    step = 0.25 * diameter
    gx = np.arange(left + 0.5 * step, right, step)
    out = []
    for k in range(len(t) - 1):
        speed = -(y[k + 1] - y[k]) / (t[k + 1] - t[k])
        top = 0.5 * (face[k] + face[k + 1])
        n = math.ceil((top - bottom) / step)
        gy = bottom + (np.arange(n) + 0.5) * (top - bottom) / n
        places = np.stack(np.meshgrid(gx, gy), axis=-1).reshape(-1, 2)
        near = cKDTree(0.5 * np.stack([x[k] + x[k + 1], y[k] + y[k + 1]], axis=1)).query(places)[1]
        cell = step * (top - bottom) / n
        out.append(0.5 * math.pi * bed_density * float(np.sum(speed[near] * np.abs(places[:, 0])) * cell))
    return np.array(out)
