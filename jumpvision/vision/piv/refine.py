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

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array, Float32
from jumpvision.base.threads import shared

from .deform import half_way
from .frame import Frame, taper
from .moments import FIRST, OF_PICTURES, OF_PLANES, gradient, moments, moments_of, slopes
from .solve import STEPPED, covariances, steps
from .surface import axis, everywhere, lightly_smoothed
from .validate import LAG

AROUND = 33  # px, side of the region over which the correlation of neighbouring residuals is averaged
BAND = 4_000_000  # px of a frame that are worked on at a time: some 80 bytes each
STENCIL = 2  # px on either side of a gradient
LEAST_RATIO = 0.2  # of the variance with to that without correlation: less is chance
ALONG = np.array([0, 3, 1, 2, 4, 5])  # places of d_x, d_y, u_x, u_y, v_x, v_y among the unknowns of a step


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
    clumping: float  # how much the squared gradient of the texture is concentrated, 1 = not at all; NaN without sigma
    quality: Array  # (ny, nx) correlation
    state: NDArray[np.int64]  # (ny, nx)


def refine(
    pairs: Pairs, grid: Grid, start: Array, texture: float, matched: NDArray[np.bool_] | None, errors: bool
) -> Match:
    """One Gauss-Newton step of all windows from the displacements u, v = start (2, ny, nx) [px], finite everywhere.

    Several pairs share one displacement: their normal equations are added (ensemble).
    matched: (ny, nx) True where the start was matched before, so that its steps are the field's; None: nowhere.
    """
    shape = pairs[0][0].weight.shape
    ny, nx = start.shape[1:]
    pad = pairs[0][0].pad
    rows, columns = (axis(n, q[0] + pad, grid.step, len(q), grid.stiffness) for n, q in zip(shape, (grid.y, grid.x)))
    start = lightly_smoothed(rows, columns, start, matched)
    g = taper(grid.window)
    at_x, at_y = (grid.x + pad).astype(np.intp), (grid.y + pad).astype(np.intp)
    bands = bands_of(at_y, grid.window // 2, shape)

    def pictures(band: Band) -> Iterator[tuple[Float32, Float32, Float32]]:
        dx, dy = (everywhere(rows.pixels(band.top, band.bottom), columns, f) for f in start)
        return (half_way(a, b, dx, dy, band.top) for a, b in pairs)

    sums, held = np.zeros((ny, nx, FIRST[-1])), []
    for band in bands:
        part = np.empty((band.end - band.first, nx, FIRST[-1]))
        for together in pictures(band):
            moments(len(part), *together, *_gradient(together[0]), at_x, band.rows(at_y), g, OF_PICTURES, part)
            sums[band.first : band.end] += part
            if errors and len(bands) == 1:
                held.append(together)
    step, quality, state = np.empty((ny * nx, 8)), np.empty(ny * nx), np.empty(ny * nx, np.int64)
    sums = sums.reshape(ny * nx, -1)
    steps(ny * nx, sums, len(pairs) * float(g.sum()) ** 2, texture, step, quality, state)

    change = step.T.reshape(8, ny, nx)
    smooth = np.stack(
        [
            *start,
            *(q for f in start for q in (f @ columns.slope.T, rows.slope @ f)),
        ]
    )
    p = smooth + change[ALONG]
    sigma, clumping = None, np.nan
    if errors:
        sigma, texture_of = np.empty((ny * nx, 6)), np.zeros(2)
        # rounding is there where equal frames leave no residual; the frames of an ensemble share all but two of it
        least = (pairs[0][0].rounding + pairs[-1][1].rounding) / len(pairs) * float((g**2).sum() / g.sum()) ** 2
        for band in bands:
            there = [everywhere(rows.pixels(band.top, band.bottom), columns, change[q]) for q in (6, 7, 0, 3)]
            places, count = (at_x, band.rows(at_y)), band.end - band.first
            zz, ss, ratio, energy = _scatter(held or pictures(band), there, places[::-1], band)
            scatter, noise = np.empty((2, count, nx, 18))
            moments_of(count, zz, *places, g * g, OF_PLANES, scatter)
            moments_of(count, ss, *places, g, OF_PLANES, noise)
            scatter *= ratio[:, :, None]
            texture_of += energy
            own = slice(band.first * nx, band.end * nx)
            of_windows = (sums[own], noise.reshape(-1, 18), scatter.reshape(-1, 18))
            covariances(count * nx, *of_windows, least, sigma[own])
        mean, clumped = texture_of / (shape[0] * shape[1])
        clumping = float(clumped / max(mean**2, 1e-12))
        sigma = sigma[:, ALONG].T.reshape(6, ny, nx)
    state = state.reshape(ny, nx)
    p = np.where(state == STEPPED, p, np.nan)
    return Match(p, sigma, clumping, quality.reshape(ny, nx), state)


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
    reach = max(half, AROUND // 2 + LAG // 2) + STENCIL
    count = min(len(y), -(-shape[0] * shape[1] // BAND))
    ends = np.linspace(0, len(y), count + 1).astype(int)
    own = [0, *((y[k - 1] + y[k]) // 2 for k in ends[1:-1]), shape[0]]
    least = LAG // 2 + STENCIL  # what a pixel of its own needs around it
    return [
        Band(
            int(first),
            int(end),
            int(max(0, min(y[first] - reach, top - least) if first else 0)),
            int(min(shape[0], max(y[end - 1] + reach + 1, bottom + least) if end < len(y) else shape[0])),
            int(top),
            int(bottom),
        )
        for first, end, top, bottom in zip(ends[:-1], ends[1:], own[:-1], own[1:])
    ]


def _gradient(f: Float32) -> tuple[Float32, Float32]:
    gx, gy = np.empty_like(f), np.empty_like(f)
    gradient(len(f), f, gx, gy)
    return gx, gy


@shared(fastmath={"contract"})
def _forces(first, last, m, r, keep, change, z, ss, energy):  # type: ignore[no-untyped-def]
    """Adds grad m times what the step (ex, ey), offset and gain of the grey leave of r; |grad m|^2; grad r grad r."""
    rows, cols = m.shape
    offset, gain, ex, ey = change
    gx, gy, left = np.empty(cols, np.float32), np.empty(cols, np.float32), np.empty(cols, np.float32)
    for j in range(max(first, 2), min(last, rows - 2)):
        slopes(m, j, gx, gy)
        _left(keep[j], r[j], offset[j], gain[j], m[j], gx, ex[j], gy, ey[j], left)
        _add(z[0, j], gx, left)
        _add(z[1, j], gy, left)
        _add(energy[j], gx, gx)
        _add(energy[j], gy, gy)
        slopes(r, j, gx, gy)
        for i in range(cols):
            left[i] = keep[j, i] * gx[i]
        _add(ss[0, j], left, gx)
        _add(ss[1, j], left, gy)
        for i in range(cols):
            left[i] = keep[j, i] * gy[i]
        _add(ss[2, j], left, gy)


@nb.njit(cache=True, fastmath={"contract"})
def _left(keep, r, offset, gain, m, gx, ex, gy, ey, left):  # type: ignore[no-untyped-def]
    for i in range(len(left)):
        left[i] = keep[i] * (r[i] - offset[i] - gain[i] * m[i] - gx[i] * ex[i] - gy[i] * ey[i])


@nb.njit(cache=True, fastmath={"contract"})
def _add(total, a, b):  # type: ignore[no-untyped-def]
    for i in range(len(total)):
        total[i] += a[i] * b[i]


def _scatter(
    pictures: Iterable[tuple[Float32, Float32, Float32]],
    change: Sequence[Float32],
    at: tuple[NDArray[np.intp], ...],
    band: Band,
) -> tuple[Float32, Float32, Array, Array]:
    """Variance that each pixel alone brings to sum w J r (xx, xy, yy: (3, H, W)), and what noise adds to grad m grad m.

    Also the ratio of the variance with a pixel's neighbours to that without, at the rows and columns `at`, and two sums
    over the band's own rows: of the squared gradient of the texture, and of its product with that of its neighbours.
    z = grad m r of a pixel, summed over the pairs (m, r, keep), as consecutive ones share a frame's noise; the ratio is
    that of sum z (sum of z over the box) to sum z^2 around. change: offset and gain of the grey and the step in x and
    y, everywhere.
    """
    shape = change[0].shape
    z, ss, energy = np.zeros((2, *shape), np.float32), np.zeros((3, *shape), np.float32), np.zeros(shape, np.float32)
    for together in pictures:
        _forces(len(z[0]), *together, tuple(change), z, ss, energy)
    box = (LAG, LAG)
    around = (AROUND, AROUND)
    together = sum(cv2.multiply(q, cv2.boxFilter(q, -1, box, normalize=False)) for q in z)
    zz = np.empty((3, *shape), np.float32)
    for q, (f, g) in zip(zz, ((z[0], z[0]), (z[0], z[1]), (z[1], z[1]))):
        cv2.multiply(f, g, q)
    around_all, around_alone = (cv2.boxFilter(q, -1, around)[np.ix_(*at)] for q in (together, zz[0] + zz[2]))
    ratio = np.maximum(around_all, LEAST_RATIO * around_alone) / np.maximum(around_alone, 1e-9)
    own = slice(band.own_top - band.top, band.own_bottom - band.top)
    clumped = cv2.multiply(energy, cv2.boxFilter(energy, -1, box))
    # OpenCV's own sums differ in the last bit from run to run
    return zz, ss, ratio, np.array([np.sum(q[own], dtype=np.float64) for q in (energy, clumped)])
