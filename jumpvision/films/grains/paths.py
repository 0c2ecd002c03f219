"""Paths of material points through velocity fields, step by step, with what they are uncertain by."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.films.calibration import OWN_NOISE, ROUNDED_OFF, SUDDEN_NOISE

from .steady import Velocities

UNDER_WAY, OUTSIDE, UNSEEN, REPLACED, FOOT, LOST = range(6)
REASONS = {
    UNDER_WAY: "",
    OUTSIDE: "left the vectors",
    UNSEEN: "came to where nothing is measured",
    REPLACED: "came to a replaced vector",
    FOOT: "reached the foot",
    LOST: "the field turns too fast for its step",
}


NO_FOOT = np.nan, np.nan, np.nan


class Grid(NamedTuple):
    """Places of the vectors: x (nx,), y (ny,), both rising; window: side of what each was matched in."""

    x: Array
    y: Array
    window: float


class Step(NamedTuple):
    """A field and the time [s] for which it carries; foot: left, right, and the height at which the foot's face is then
    (NaN: none)."""

    field: Velocities
    lasts: float
    foot: tuple[float, float, float] = NO_FOOT


class Carried(NamedTuple):
    """Of n points over T steps, from where they start: x, y and their standard uncertainties (T + 1, n), NaN from
    where they end; why (n,) keys of REASONS, 0 for those that never do."""

    x: Array
    y: Array
    x_sigma: Array
    y_sigma: Array
    why: NDArray[np.int8]


class Surface:
    """A field between its vectors: bicubic splines; NaN is filled by the nearest, since paths end there."""

    def __init__(self, grid: Grid, f: Velocities) -> None:
        there = np.isfinite(f.u) & np.isfinite(f.v)
        near = scipy.ndimage.distance_transform_edt(~there, return_distances=False, return_indices=True)
        self.from_edge = scipy.ndimage.distance_transform_edt(np.pad(there, 1))[1:-1, 1:-1] - 1.0
        self.grid = grid
        self.of = [scipy.interpolate.RectBivariateSpline(grid.y, grid.x, a[tuple(near)]) for a in f[:2]]

    def at(self, x: Array, y: Array) -> Array:
        """u, v (2, n)."""
        return np.stack([s.ev(y, x) for s in self.of])

    def gradient(self, x: Array, y: Array) -> Array:
        """[[u_x, u_y], [v_x, v_y]] (n, 2, 2)."""
        return np.stack([np.stack([s.ev(y, x, dy=1), s.ev(y, x, dx=1)], -1) for s in self.of], -2)

    def rounded_off(self, x: Array, y: Array) -> Array:
        """What the vectors are about too slow or too fast by, (n, 2)."""
        bent = self.grid.window**2 * np.stack([s.ev(y, x, dy=2) + s.ev(y, x, dx=2) for s in self.of], -1)
        share = ROUNDED_OFF.value
        return np.interp(between(self.grid, self.from_edge, x, y), range(len(share)), share)[:, None] * bent


def carried(grid: Grid, steps: Iterable[Step], x: Array, y: Array) -> Carried:
    """Points x, y (n,) carried by one field after the other, each touching the one before in time.

    A field holds half-way in time: x1 = x0 + d((x0 + x1)/2), d = (u, v) lasts, by its fixed point. Places and
    velocities in one unit of length.

    Of a displacement's error the part (1 - OWN_NOISE) is the noise of its two frames, w1 - w0, and the next pair begins
    with the frame that this one ends with, so that along a path all but the first and the last cancel; what is the
    pair's own adds in squares. What the vectors round off (ROUNDED_OFF) is a matter of place and adds with its sign.
    Each is carried on by the flow's deformation.
    """
    place, n = np.stack([x, y]).astype(float), x.size
    why = np.zeros(n, np.int8)
    first, own, end = (np.zeros((n, 2, 2)) for _ in range(3))  # covariances
    off_by, plain = np.zeros((n, 2)), np.full((n, 2), np.inf)
    places, sigmas = [place], [np.zeros((2, n))]
    near = 1e-4 * abs(float(grid.x[1] - grid.x[0]))
    for k, (f, lasts, foot) in enumerate(steps):
        go = np.flatnonzero(why == UNDER_WAY)
        place, surface = np.where(why == UNDER_WAY, place, np.nan), Surface(grid, f)
        at, moved, off = place[:, go], np.zeros((2, go.size)), np.zeros(go.size)
        for _ in range(60):  # a fixed point
            once_more = lasts * surface.at(*(at + 0.5 * moved))
            off, moved = np.abs(once_more - moved).max(axis=0), once_more
            if not (off > near).any():
                break
        middle = at + 0.5 * moved
        place[:, go] = at + moved
        now = ended(grid, f.measured, np.isfinite(f.u), middle, place[:, go], foot)
        why[go] = np.where((off > near) & (now == UNDER_WAY), LOST, now)
        variance = lasts**2 * np.stack([between(grid, with_largest(s), *middle) ** 2 for s in f[2:4]], -1)
        plain[go] = np.minimum(variance, SUDDEN_NOISE.value * plain[go])
        noise = np.eye(2) * (0.5 * (1.0 - OWN_NOISE.value) * plain[go][:, None])
        half = 0.5 * lasts * surface.gradient(*middle)
        turned = np.linalg.solve(np.eye(2) - half, np.eye(2) + half)
        bias = np.linalg.solve(np.eye(2) - half, lasts * surface.rounded_off(*middle)[..., None])[..., 0]
        off_by[go] = (turned @ off_by[go][..., None])[..., 0] + bias
        if k == 0:
            first[go] = noise
        first[go], own[go] = (turned @ a[go] @ turned.swapaxes(1, 2) for a in (first, own))
        own[go] += np.eye(2) * ((variance - (1.0 - OWN_NOISE.value) * plain[go])[:, None])
        end[go] = noise
        stopped = why != UNDER_WAY
        place[:, stopped] = np.nan
        total = np.sqrt(np.diagonal(first + own + end, axis1=1, axis2=2) + off_by**2).T
        places.append(place)
        sigmas.append(np.where(stopped, np.nan, total))
    (xs, ys), (x_sigma, y_sigma) = np.stack(places, 1), np.stack(sigmas, 1)
    return Carried(xs, ys, x_sigma, y_sigma, why)


def ended(
    grid: Grid,
    measured: NDArray[np.bool_],
    known: NDArray[np.bool_],
    middle: Array,
    after: Array,
    foot: tuple[float, float, float],
) -> NDArray[np.int8]:
    """Why points do not come through a step, by where they are half-way and after it, both (2, n); 0: they do.

    They end in a cell of four vectors of which one is NaN, and where the nearest was replaced.
    """
    (x, y), (nx, ny) = middle, (grid.x.size, grid.y.size)
    inside = np.ones(x.shape, bool)
    for a, b in (middle, after):
        inside &= (a >= grid.x[0]) & (a <= grid.x[-1]) & (b >= grid.y[0]) & (b <= grid.y[-1])
    i, j = (np.clip(np.searchsorted(g, a) - 1, 0, m - 2) for g, a, m in ((grid.x, x, nx), (grid.y, y, ny)))
    cell = known[j, i] & known[j + 1, i] & known[j, i + 1] & known[j + 1, i + 1]
    right, up = x - grid.x[i] > grid.x[i + 1] - x, y - grid.y[j] > grid.y[j + 1] - y
    left_edge, right_edge, face = foot
    pushed = (after[1] > face) & (after[0] >= left_edge) & (after[0] <= right_edge)
    why = np.where(measured[j + up, i + right], UNDER_WAY, REPLACED)
    return np.select([pushed, ~inside, ~cell], [FOOT, OUTSIDE, UNSEEN], why).astype(np.int8)


def with_largest(sigma: Array) -> Array:
    """Uncertainties with the largest in place of NaN."""
    there = np.isfinite(sigma)
    return np.where(there, sigma, np.max(sigma, where=there, initial=0.0))


def between(grid: Grid, values: Array, x: Array, y: Array) -> Array:
    """Values (ny, nx) at points (n,), by straight lines."""
    at = scipy.interpolate.RegularGridInterpolator((grid.y, grid.x), values, bounds_error=False, fill_value=None)
    return np.asarray(at((y, x)))
