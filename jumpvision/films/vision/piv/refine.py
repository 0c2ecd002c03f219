"""Affine matching of all windows of two frames at once by Gauss-Newton, symmetric in the frames, with covariance.

A displacement D of every pixel through the vectors found so far brings both frames half-way together,

    a(x) = A(x - D(x) / 2),    b(x) = B(x + D(x) / 2),    m = (a + b) / 2,    r = a - b,

and every window corrects d and its gradient G, with offset and gain of the grey, by the least weighted squares of
r - grad m . (d + G xi) - c0 - c1 m. D is a smooth surface through all vectors, so what a window cannot hold (its
curvature) is there already. Reading both frames half-way puts the vector at mid-time and makes the noise of grad m
independent of r, so that noise does not bias d.

Uncertainty: to first order the error of the parameters is H^-1 sum w J r over the noise part of r. Its variance is
taken from the residuals themselves, with the correlation between those less than LAG / 2 px apart (as the correlation
statistics of Wieneke 2015, doi:10.1088/0957-0233/26/7/074002, do for a pure shift), so it holds the noise of both
frames, the smoothing by the interpolation and any mismatch that changes within the box; `noise` tells what the other
windows and the repeated steps make of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array, Float32

from .deform import half_way
from .frame import Frame, taper
from .moments import FIRST, OF_PICTURES, OF_PLANES, gradient, moments, moments_of
from .scatter import AROUND, scatter, within
from .solve import STEPPED, covariances, steps
from .surface import at_vectors, axis, lightly_smoothed, of_columns, of_rows, pixel_spline
from .validate import LAG, beyond_chance

BAND = 4_000_000  # px of a frame that are worked on at a time: some 80 bytes each
STENCIL = 2  # px on either side of a gradient
APART = np.tile([1.0, 2.0, 2.0, 4.0, 4.0, 4.0], 3)  # of the moments of such planes: their pixels are 2 px apart
ALONG = np.array([0, 3, 1, 2, 4, 5])  # places of d_x, d_y, u_x, u_y, v_x, v_y among the unknowns of a step


ALL = slice(0, None)


class Grid(NamedTuple):
    """Where the vectors of a pair sit [px], and their window."""

    x: Array
    y: Array
    step: int
    window: int
    stiffness: float


Pairs = list[tuple[Frame, Frame]]


class Match(NamedTuple):
    """One step of all windows: p (6, ny, nx) d_x, d_y [px], u_x, u_y, v_x, v_y [1]; sigma likewise, or None.

    Before `noise.factors`.
    """

    p: Array
    sigma: Array | None
    finer: Array | None  # (4, ny, nx) see `scatter.within`
    clumping: float  # how much the squared gradient of the texture is concentrated, 1 = not at all; NaN without sigma
    quality: Array  # (ny, nx) correlation
    rest: Array  # (ny, nx) [grey^2] what the step leaves of the difference of the frames
    jump: Array | None  # (ny, nx) where the start jumped, see `surface.lightly_smoothed`; None: nowhere
    state: NDArray[np.int64]  # (ny, nx)


def refine(
    pairs: Pairs,
    grid: Grid,
    start: Array,
    texture: float,
    matched: NDArray[np.bool_] | None,
    errors: bool,
    foreign: float | None,
    only: slice = ALL,
) -> Match:
    """One Gauss-Newton step of all windows from the displacements u, v = start (2, ny, nx) [px], finite everywhere.

    Several pairs share one displacement: their normal equations are added (ensemble).
    matched: (ny, nx) True where the start was matched before, so that its steps are the field's; None: nowhere.
    foreign: [grey] see `half_way`; None: jumps of the field are not heeded. only: rows of windows; others take no step.
    """
    shape = pairs[0][0].weight.shape
    ny, nx = start.shape[1:]
    pad = pairs[0][0].pad
    rows, columns = (
        axis(n, q[0] + pad, grid.step, len(q), grid.stiffness, grid.window) for n, q in zip(shape, (grid.y, grid.x))
    )
    start, found = lightly_smoothed(rows, columns, start, matched)
    jump = None if foreign is None else found
    g = taper(grid.window)
    at_x, at_y = (grid.x + pad).astype(np.intp), (grid.y + pad).astype(np.intp)
    half = grid.window // 2
    bands = bands_of(at_y, half, shape) if only is ALL else [_band_of(only, at_y, half + STENCIL, shape)]

    def pictures(band: Band) -> Iterator[tuple[Float32, Float32, Float32]]:
        moved = pixel_spline(rows.pixels(band.top, band.bottom), columns, start, jump)
        return (half_way(a, b, moved, band.top, foreign or math.inf) for a, b in pairs)

    sums, held = (np.empty if only is ALL else np.zeros)((ny, nx, FIRST[-1])), []
    for band in bands:
        own = sums[band.first : band.end]
        for k, together in enumerate(pictures(band)):
            part = own if k == 0 else np.empty_like(own)
            moments(len(part), *together, *_gradient(together[0]), at_x, band.rows(at_y), g, OF_PICTURES, part)
            if k > 0:
                own += part
            if errors and len(bands) == 1:
                held.append(together)
    step, (quality, rest), state = np.empty((ny * nx, 8)), np.empty((2, ny * nx)), np.empty(ny * nx, np.int64)
    sums = sums.reshape(ny * nx, -1)
    steps(ny * nx, sums, len(pairs) * float(g.sum()) ** 2, texture, step, quality, rest, state)

    change = step.T.reshape(8, ny, nx)
    (ux, vx), (uy, vy) = of_rows(columns.slope, columns, start), of_columns(rows.slope, rows, start)
    smooth = np.stack([*at_vectors(rows, columns, start, jump), ux, uy, vx, vy])
    p = smooth + change[ALONG]
    sigma, finer, clumping = None, None, np.nan
    if errors:
        sigma, finer, textures = np.empty((ny * nx, 6)), np.empty((4, ny, nx)), []
        # rounding is there where equal frames leave no residual; the frames of an ensemble share all but two of it
        rounding = (pairs[0][0].rounding + pairs[-1][1].rounding) / len(pairs)
        least = rounding * float((g**2).sum() / g.sum()) ** 2
        for band in bands:
            moved = pixel_spline(rows.pixels(band.top, band.bottom), columns, change[[6, 7, 0, 3]])
            places, count = (at_x, band.rows(at_y)), band.end - band.first
            rows_of_planes = slice((band.own_top - band.top + 1) // 2, (band.own_bottom - band.top + 1) // 2)
            of_pixels = scatter(held or pictures(band), moved, places[::-1], rows_of_planes)
            spread, noise = np.empty((2, count, nx, 18))
            of_two = np.ascontiguousarray(g[grid.window // 2 % 2 :: 2])  # the planes hold every second pixel
            halves = [q // 2 for q in places]
            moments_of(count, of_pixels.zz, *halves, of_two * of_two, OF_PLANES, spread)
            moments_of(count, of_pixels.ss, *halves, of_two, OF_PLANES, noise)
            spread *= of_pixels.ratio[:, :, None] * APART
            noise *= APART
            textures.append(of_pixels.energy)
            finer[:, band.first : band.end] = within(of_pixels, grid.window, (halves[0], halves[1]), rounding)
            there = slice(band.first * nx, band.end * nx)
            of_windows = (sums[there], noise.reshape(-1, 18), spread.reshape(-1, 18))
            covariances(count * nx, *of_windows, beyond_chance(quality[there], grid.window), least, sigma[there])
        # every other row; in one sum, so that bands do not change its last bit
        mean, clumped = 2 * np.concatenate(textures, axis=1).sum(1) / (shape[0] * shape[1])
        clumping = float(clumped / max(mean**2, 1e-12))
        sigma = sigma[:, ALONG].T.reshape(6, ny, nx)
    state = state.reshape(ny, nx)
    p = np.where(state == STEPPED, p, np.nan)
    return Match(p, sigma, finer, clumping, quality.reshape(ny, nx), rest.reshape(ny, nx), found, state)


class Band(NamedTuple):
    """Rows of windows first to end - 1, and the rows of the padded frame that they need, top to bottom - 1; of these
    own_top to own_bottom - 1 are no other band's."""

    first: int
    end: int
    top: int
    bottom: int
    own_top: int
    own_bottom: int

    def rows(self, y: NDArray[np.intp]) -> NDArray[np.intp]:
        """Of the centres y of all windows in the frame, those of the band's in its pictures."""
        return y[self.first : self.end] - self.top


def bands_of(y: NDArray[np.intp], half: int, shape: tuple[int, ...]) -> list[Band]:
    """Bands of about BAND pixels of a padded frame: memory grows with them, not with the frame.

    y: centres of the windows, half: of their side.
    """
    reach = max(half, AROUND // 2 + LAG // 2 + 2) + STENCIL  # 2: sums of the noise are over pixels two and two
    count = min(len(y), -(-shape[0] * shape[1] // BAND))
    ends = np.linspace(0, len(y), count + 1).astype(int)
    own = [0, *((y[k - 1] + y[k]) // 2 for k in ends[1:-1]), shape[0]]
    least = LAG // 2 + STENCIL  # what a pixel of its own needs around it
    return [
        Band(
            int(first),
            int(end),
            int(max(0, min(y[first] - reach, top - least) if first else 0)) // 2 * 2,  # as in the whole frame
            int(min(shape[0], max(y[end - 1] + reach + 1, bottom + least) if end < len(y) else shape[0])),
            int(top),
            int(bottom),
        )
        for first, end, top, bottom in zip(ends[:-1], ends[1:], own[:-1], own[1:])
    ]


def _band_of(only: slice, y: NDArray[np.intp], reach: int, shape: tuple[int, ...]) -> Band:
    """Of some rows of windows alone, where no errors are asked for."""
    top, bottom = max(0, int(y[only.start]) - reach), min(shape[0], int(y[only.stop - 1]) + reach + 1)
    return Band(only.start, only.stop, top, bottom, top, bottom)


def _gradient(f: Float32) -> tuple[Float32, Float32]:
    gx, gy = np.empty_like(f), np.empty_like(f)
    gradient(len(f), f, gx, gy)
    return gx, gy
