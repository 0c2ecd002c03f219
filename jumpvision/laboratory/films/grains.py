"""The side-wall film of the grains under the foot: shaded discs carried by the prescribed flow, and the dark half foot.

Pixel coordinates as everywhere (column x, row y down, centres at integers); heights y [m] up from the undisturbed
surface, which lies at `surface_row`. Compile time about 3 s; about 10 frames of 400 x 460 px a second.

`QuickGrainScene` is some five times as quick: grains are carried by the closed-form solution of the flow over a step
instead of by many midpoint steps, discs are drawn in single precision over a padded picture so that the processor draws
several pixels at a time, and within an exposure grains move on straight lines.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array

from .flow import ABOVE, Flow
from .optics import blur, texture

SKY, SOIL, HOLE = 198.0, 14.0, 46.0  # grey: back-light above the bed, gaps between grains, shadow behind the foot
FOOT_HEIGHT, NECK = 0.012, 0.007  # m: thickness of the foot's disc, half width of the strut above it


@dataclass(frozen=True)
class View:
    """shape (rows, columns); scale [m/px]; surface_row, axis_column [px]."""

    shape: tuple[int, int]
    scale: float
    surface_row: float
    axis_column: float

    def row(self, y: Array | float) -> Array | float:
        """Row of a height y [m]."""
        return self.surface_row - y / self.scale


@dataclass
class Grains:
    """Discs in painter's order (back to front): x [m] from the axis, y [m], radius [m], grey; moved in place."""

    x: Array
    y: Array
    radius: Array
    grey: Array


def pack(view: View, flow: Flow, z: float, *, diameter: float, spread: float, rng: np.random.Generator) -> Grains:
    """Grains that fill the bed below the surface and below a foot at depth z [m].

    A front layer of discs that hardly overlap over a dark random layer that fills the gaps. diameter [m]: mean;
    spread: its relative standard deviation.
    """
    left = -(view.axis_column + 8) * view.scale
    right = (view.shape[1] + 8 - view.axis_column) * view.scale
    bottom = -(view.shape[0] + 8 - view.surface_row) * view.scale - 0.02
    area = (right - left) * -bottom

    def discs(n: int) -> tuple[Array, Array, Array]:
        radius = 0.5 * diameter * np.clip(rng.normal(1.0, spread, n), 0.5, 1.5)
        return rng.uniform(left, right, n), rng.uniform(bottom, 0.0, n), radius

    back = discs(int(3.5 * area / diameter**2))
    front = discs(int(12 * area / diameter**2))
    kept = _spaced(*front, 0.86, diameter, left, bottom, right)
    x, y, radius = (np.concatenate([b, f[kept]]) for b, f in zip(back, front))
    n_back = len(back[0])
    grey = np.clip(rng.normal(112.0, 30.0, len(x)), 45.0, 190.0)
    grey[:n_back] *= 0.5
    inside = np.abs(x) < flow.R
    bed = y < np.where(inside, -z, 0.0) - 0.6 * radius
    return Grains(x[bed], y[bed], radius[bed], grey[bed])


@nb.njit(cache=True)
def _spaced(x, y, radius, share, cell, left, bottom, right):  # type: ignore[no-untyped-def]
    """Which discs to keep, in order, so that no two centres are nearer than share (r1 + r2)."""
    nx = int((right - left) / cell) + 3
    ny = int(-bottom / cell) + 3
    first = np.full((nx, ny), -1)
    following = np.full(len(x), -1)
    keep = np.zeros(len(x), np.bool_)
    for i in range(len(x)):
        a, b = int((x[i] - left) / cell) + 1, int((y[i] - bottom) / cell) + 1
        free = True
        for p in range(max(a - 2, 0), min(a + 3, nx)):
            for q in range(max(b - 2, 0), min(b + 3, ny)):
                j = first[p, q]
                while j >= 0 and free:
                    reach = share * (radius[i] + radius[j])
                    free = (x[i] - x[j]) ** 2 + (y[i] - y[j]) ** 2 >= reach * reach
                    j = following[j]
        if free:
            keep[i] = True
            following[i] = first[a, b]
            first[a, b] = i
    return keep


@nb.njit(cache=True)
def splat(image, column, row, radius, grey):  # type: ignore[no-untyped-def]
    """Draw shaded discs (all in px) over `image` in place, in order; edges are covered in proportion."""
    height, width = image.shape
    for g in range(len(column)):
        r = radius[g]
        c0, r0 = column[g], row[g]
        for i in range(max(int(r0 - r), 0), min(int(r0 + r) + 2, height)):
            dy = i - r0
            for j in range(max(int(c0 - r), 0), min(int(c0 + r) + 2, width)):
                dx = j - c0
                square = dx * dx + dy * dy
                if square < (r + 0.5) ** 2:  # lit from the upper left in front
                    rho = math.sqrt(square)
                    cover = min(r + 0.5 - rho, 1.0)
                    up = math.sqrt(max(1.0 - (rho / r) ** 2, 0.0))
                    tone = grey[g] * (0.45 + 0.6 * up - 0.16 * (dx + 1.4 * dy) / r)
                    image[i, j] += cover * (tone - image[i, j])


class GrainScene:
    """Draws noise-free frames; the grains are carried along, so frames must be asked for in the order of time."""

    def __init__(self, view: View, flow: Flow, z: float, *, diameter: float, spread: float, rng: np.random.Generator):
        """z: greatest depth of the foot so far [m]; the grains lie as `pack` puts them."""
        self.view, self.flow, self.deepest = view, flow, z
        self.grains = pack(view, flow, z, diameter=diameter, spread=spread, rng=rng)
        self.columns: Array = (np.arange(view.shape[1], dtype=np.float64) - view.axis_column) * view.scale
        self.surface = np.zeros(view.shape[1])
        rows = round(FOOT_HEIGHT / view.scale) + 4
        self.foot = 52.0 + 13.0 * texture((rows, view.shape[1]), sigma=1.2, rng=rng)
        across, down = np.meshgrid(*(np.linspace(-1, 1, n) for n in view.shape[::-1]))
        self.light = 1.0 - 0.07 * across - 0.05 * down - 0.06 * (across**2 + down**2)

    def frame(self, depths: Array) -> Array:
        """Mean image (row, column) [grey] over foot depths (sub-exposure,) [m], in order of time."""
        total = np.zeros(self.view.shape)
        for z in depths:
            if z > self.deepest:
                self.flow.advect(self.grains.x, self.grains.y, self.deepest, z)
                outside = np.abs(self.columns) >= self.flow.R
                self._sink(outside, z)
                self.deepest = float(z)
            total += self._still(float(z))
        return blur(total / len(depths), 0.55) * self.light

    def _sink(self, outside: NDArray[np.bool_], z: float) -> None:
        y: Array = self.surface[outside]
        self.flow.advect(self.columns[outside], y, self.deepest, z)
        self.surface[outside] = y

    def _still(self, z: float) -> Array:
        """The scene at one instant."""
        v = self.view
        face, top = float(v.row(-z)), float(v.row(FOOT_HEIGHT - z))
        edges = np.asarray(v.row(self.surface))
        lowest = max(float(edges.max()), float(v.row(-self.deepest)), face)
        rows = np.arange(min(max(int(lowest) + 2, 1), v.shape[0]))[:, None]  # below them there are only grains

        def below(edge: Array | float) -> Array:
            return np.clip(rows + 0.5 - edge, 0.0, 1.0)

        inside = np.clip((self.flow.R - np.abs(self.columns)) / v.scale + 0.5, 0.0, 1.0)
        bed = below(edges)
        image = np.full(v.shape, SOIL)
        upper = image[: len(rows)]
        upper[:] = SKY + (SOIL - SKY) * bed
        hole = inside * bed * (1.0 - below(v.row(-self.deepest)))
        upper += hole * (HOLE - upper)
        self._draw_grains(image)

        neck = np.clip((NECK - np.abs(self.columns)) / v.scale + 0.5, 0.0, 1.0) * (1.0 - below(top))
        upper += neck * (38.0 - upper)
        body = inside * below(top) * (1.0 - below(face))
        seen = slice(max(int(top) - 1, 0), max(int(face) + 2, 0))
        upper[seen] += body[seen] * (self._foot(rows[seen, 0], top) - upper[seen])
        return image

    def _foot(self, rows: NDArray[np.int64], top: float) -> Array:
        """The foot's texture, moving with it."""
        at = np.clip(rows - top + 1.0, 0.0, len(self.foot) - 1.001)
        i = at.astype(int)
        part = (at - i)[:, None]
        return np.asarray(self.foot[i] * (1 - part) + self.foot[i + 1] * part)

    def _draw_grains(self, image: Array) -> None:
        v, g = self.view, self.grains
        splat(image, v.axis_column + g.x / v.scale, np.asarray(v.row(g.y)), g.radius / v.scale, g.grey)


PAD = 16  # px around the picture; discs are smaller
STREAK = 0.5  # px: how far the foot may move between two instants of an exposure
STEP = 4e-4  # m: over which the cut-off width w(z) is taken at its middle


class QuickGrainScene(GrainScene):
    """GrainScene with a quicker `frame`."""

    def frame(self, depths: Array) -> Array:
        """Mean image (row, column) [grey] over foot depths (sub-exposure,) [m], in order of time."""
        start, low, high = self.deepest, float(np.min(depths)), float(np.max(depths))
        low = max(low, start)
        self._carry(low)
        before, surface_before = self.grains.y.copy(), self.surface.copy()
        self._carry(high)
        after, surface_after = self.grains.y, self.surface
        n = max(math.ceil(float(np.ptp(depths)) / self.view.scale / STREAK), 1)
        parts = (np.arange(len(depths)) + 0.5) / len(depths)
        total = np.zeros(self.view.shape)
        for z in np.interp((np.arange(n) + 0.5) / n, parts, depths):
            share = min(max((z - low) / (high - low), 0.0), 1.0) if high > low else 1.0
            self.grains.y = before + share * (after - before)
            self.surface = surface_before + share * (surface_after - surface_before)
            self.deepest = max(float(z), start)
            total += self._still(float(z))
        self.grains.y, self.surface, self.deepest = after, surface_after, max(high, start)
        taps = np.exp(-0.5 * (np.arange(-3, 4) / 0.55) ** 2)
        taps /= taps.sum()
        blurred = cv2.sepFilter2D(total / n, -1, taps, taps, borderType=cv2.BORDER_REPLICATE)
        return np.asarray(blurred * self.light)

    def _carry(self, z: float) -> None:
        """Grains and surface as the foot sinks to z [m]."""
        if z > self.deepest:
            carry(self.flow, self.grains.x, self.grains.y, self.deepest, z)
            outside = np.abs(self.columns) >= self.flow.R
            y: Array = self.surface[outside]
            carry(self.flow, self.columns[outside], y, self.deepest, z)
            self.surface[outside] = y
            self.deepest = z

    def _draw_grains(self, image: Array) -> None:
        v, g = self.view, self.grains
        padded = np.zeros((v.shape[0] + 2 * PAD, v.shape[1] + 2 * PAD), np.float32)
        inner = padded[PAD:-PAD, PAD:-PAD]
        inner[:] = image
        row = np.asarray(v.row(g.y), np.float64)
        seen = (row > -PAD / 2) & (row < v.shape[0] + PAD / 2)
        column = v.axis_column + g.x / v.scale
        seen &= (column > -PAD / 2) & (column < v.shape[1] + PAD / 2)
        radius = (g.radius / v.scale)[seen]
        if len(radius) and radius.max() > PAD / 2 - 2:
            raise ValueError(f"scale: a grain of {radius.max():.1f} px is too large for the quick grain film")
        _stamp(padded, column[seen] + PAD, row[seen] + PAD, radius.astype(np.float32), g.grey[seen].astype(np.float32))
        image[:] = inner


@nb.njit(cache=True, fastmath=True)
def _stamp(image, column, row, radius, grey):  # type: ignore[no-untyped-def]
    """`grains.splat` in single precision; every disc lies whole in `image`."""
    half, one, zero = np.float32(0.5), np.float32(1.0), np.float32(0.0)
    offsets = np.arange(PAD).astype(np.float32)
    for g in range(len(column)):
        r = radius[g]
        reach = r + half
        top, left = int(row[g] - reach) + 1, int(column[g] - reach) + 1
        n = int(reach + reach) + 1
        y0, x0 = np.float32(row[g] - top), np.float32(column[g] - left)
        inverse = one / r
        tone0 = grey[g] * np.float32(0.45)
        bright = grey[g] * np.float32(0.6)
        slope = grey[g] * np.float32(0.16) * inverse
        for i in range(n):
            dy = offsets[i] - y0
            chord = reach * reach - dy * dy
            if chord <= zero:
                continue
            chord = np.sqrt(chord)
            for j in range(int(x0 - chord + one), int(x0 + chord) + 1):
                dx = offsets[j] - x0
                square = dx * dx + dy * dy
                cover = min(max(reach - np.sqrt(square), zero), one)
                up = np.sqrt(max(one - square * inverse * inverse, zero))
                tone = tone0 + bright * up - slope * (dx + np.float32(1.4) * dy)
                before = image[top + i, left + j]
                image[top + i, left + j] = before + cover * (tone - before)


def carry(flow: Flow, r: Array, y: Array, z0: float, z1: float) -> None:
    """`Flow.advect` in closed form: moves grains at r, height y [m] in place while the face sinks z0 to z1 [m].

    Below the cone's surface, at the depth u, du/dz = c exp(-u/fade) - 1 - m with the cut-off c and the growth m of the
    cone above the grain (mu, or 0 where it is full grown): exp(u/fade) relaxes exponentially to c/(1 + m). Inside the
    cone a grain goes with the foot. Beside the foot above its face exp(-u/ABOVE) does likewise.
    """
    steps = math.ceil((z1 - z0) / STEP)
    zs = np.linspace(z0, z1, steps + 1) if steps > 0 else np.empty(1)
    at = np.abs(r)
    for a, b in pairwise(zs):
        _carry(at, y, a, b, flow.width(0.5 * (a + b)), flow.constants)


@nb.njit(cache=True)
def _below(u, c, step, fade, m):  # type: ignore[no-untyped-def]
    """Depth u below the cone's surface after `step` [m] and the part of the step [m] left when it is reached."""
    c = c / (1.0 + m)
    e = math.exp(u / fade)
    after = c + (e - c) * math.exp(-(1.0 + m) * step / fade)
    if after > 1.0 or c >= 1.0:
        return fade * math.log(max(after, 1.0)), 0.0
    return 0.0, step - fade / (1.0 + m) * math.log((e - c) / (1.0 - c))


@nb.njit(cache=True)
def _carry(r, y, z0, z1, w, constants):  # type: ignore[no-untyped-def]
    R, mu, tan_theta, fade = constants
    for i in range(len(r)):
        x = (r[i] / w) * (r[i] / w)
        if x * x * x > 40.0:  # slower than 1e-17 of the foot
            continue
        c = math.exp(-x * x * x)
        z, at = z0, y[i]
        if r[i] >= R:
            left = z1 - z0
            u = -at - z
            if u > 0.0:
                u, left = _below(u, c, left, fade, 0.0)
            if left > 0.0:
                u = -ABOVE * math.log(c + (math.exp(-u / ABOVE) - c) * math.exp(left / ABOVE))
            y[i] = -u - z1
            continue
        full = (R - r[i]) * tan_theta
        while z < z1:
            grows = mu * z < full
            m = mu if grows else 0.0
            end = min(z1, full / mu) if grows else z1
            if end <= z:
                end = z1
            top = mu * z if grows else full
            u = -at - z - top
            left = end - z
            if u > 0.0:
                u, left = _below(u, c, left, fade, m)
                at = -(u + end - left + top + m * (end - z - left))
            at -= left
            z = end
        y[i] = at
