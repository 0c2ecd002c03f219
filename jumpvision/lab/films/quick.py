"""The grain film quickly: the same scene as `grains`, some five times as many frames a second.

Grains are carried by the closed-form solution of the flow over a step instead of by many midpoint steps, discs are
drawn in single precision over a padded picture so that the processor draws several pixels at a time, and within an
exposure grains move on straight lines.
"""

from __future__ import annotations

import math
from itertools import pairwise

import cv2
import numba as nb
import numpy as np

from jumpvision.base.arrays import Array

from .flow import ABOVE, Flow
from .grains import GrainScene

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
