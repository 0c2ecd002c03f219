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
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array, Float32
from jumpvision.base.threads import shared

from .deform import half_way
from .frame import Frame, taper
from .moments import FIRST, OF_PICTURES, OF_PLANES, gradient, moments, moments_of, slopes
from .solve import STEPPED, covariances, steps
from .surface import Drawn, at_vectors, axis, drawn, lightly_smoothed, line, times
from .validate import LAG

AROUND = 33  # px, side of the region over which the correlation of neighbouring residuals is averaged
BAND = 4_000_000  # px of a frame that are worked on at a time: some 80 bytes each
STENCIL = 2  # px on either side of a gradient
LEAST_RATIO = 0.2  # of the variance with to that without correlation: less is chance
APART = np.tile([1.0, 2.0, 2.0, 4.0, 4.0, 4.0], 3)  # of the moments of such planes: their pixels are 2 px apart
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
) -> Match:
    """One Gauss-Newton step of all windows from the displacements u, v = start (2, ny, nx) [px], finite everywhere.

    Several pairs share one displacement: their normal equations are added (ensemble).
    matched: (ny, nx) True where the start was matched before, so that its steps are the field's; None: nowhere.
    foreign: [grey] see `half_way`; None: jumps of the field are not heeded.
    """
    shape = pairs[0][0].weight.shape
    ny, nx = start.shape[1:]
    pad = pairs[0][0].pad
    rows, columns = (axis(n, q[0] + pad, grid.step, len(q), grid.stiffness) for n, q in zip(shape, (grid.y, grid.x)))
    start, found = lightly_smoothed(rows, columns, start, matched)
    jump = None if foreign is None else found
    g = taper(grid.window)
    at_x, at_y = (grid.x + pad).astype(np.intp), (grid.y + pad).astype(np.intp)
    bands = bands_of(at_y, grid.window // 2, shape)

    def pictures(band: Band) -> Iterator[tuple[Float32, Float32, Float32]]:
        moved = drawn(rows.pixels(band.top, band.bottom), columns, start, jump)
        return (half_way(a, b, moved, band.top, foreign or math.inf) for a, b in pairs)

    sums, held = np.zeros((ny, nx, FIRST[-1])), []
    for band in bands:
        part = np.empty((band.end - band.first, nx, FIRST[-1]))
        for together in pictures(band):
            moments(len(part), *together, *_gradient(together[0]), at_x, band.rows(at_y), g, OF_PICTURES, part)
            sums[band.first : band.end] += part
            if errors and len(bands) == 1:
                held.append(together)
    step, (quality, rest), state = np.empty((ny * nx, 8)), np.empty((2, ny * nx)), np.empty(ny * nx, np.int64)
    sums = sums.reshape(ny * nx, -1)
    steps(ny * nx, sums, len(pairs) * float(g.sum()) ** 2, texture, step, quality, rest, state)

    change = step.T.reshape(8, ny, nx)
    smooth = np.stack(
        [
            *(at_vectors(rows, columns, f, jump) for f in start),
            *(q for f in start for q in (times(f, columns.slope.T), times(rows.slope, f))),
        ]
    )
    p = smooth + change[ALONG]
    sigma, clumping = None, np.nan
    if errors:
        sigma, textures = np.empty((ny * nx, 6)), []
        # rounding is there where equal frames leave no residual; the frames of an ensemble share all but two of it
        least = (pairs[0][0].rounding + pairs[-1][1].rounding) / len(pairs) * float((g**2).sum() / g.sum()) ** 2
        for band in bands:
            there = drawn(rows.pixels(band.top, band.bottom), columns, change[[6, 7, 0, 3]])
            places, count = (at_x, band.rows(at_y)), band.end - band.first
            zz, ss, ratio, energy = _scatter(held or pictures(band), there, places[::-1], band)
            scatter, noise = np.empty((2, count, nx, 18))
            of_two = g[grid.window // 2 % 2 :: 2]  # the planes hold every second pixel
            halves = [q // 2 for q in places]
            moments_of(count, zz, *halves, of_two * of_two, OF_PLANES, scatter)
            moments_of(count, ss, *halves, of_two, OF_PLANES, noise)
            scatter *= ratio[:, :, None] * APART
            noise *= APART
            textures.append(energy)
            own = slice(band.first * nx, band.end * nx)
            of_windows = (sums[own], noise.reshape(-1, 18), scatter.reshape(-1, 18))
            covariances(count * nx, *of_windows, least, sigma[own])
        # every other row; in one sum, so that bands do not change its last bit
        mean, clumped = 2 * np.concatenate(textures, axis=1).sum(1) / (shape[0] * shape[1])
        clumping = float(clumped / max(mean**2, 1e-12))
        sigma = sigma[:, ALONG].T.reshape(6, ny, nx)
    state = state.reshape(ny, nx)
    p = np.where(state == STEPPED, p, np.nan)
    return Match(p, sigma, clumping, quality.reshape(ny, nx), rest.reshape(ny, nx), found, state)


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


def _gradient(f: Float32) -> tuple[Float32, Float32]:
    gx, gy = np.empty_like(f), np.empty_like(f)
    gradient(len(f), f, gx, gy)
    return gx, gy


def _scatter(
    pictures: Iterable[tuple[Float32, Float32, Float32]],
    change: Drawn,
    at: tuple[NDArray[np.intp], ...],
    band: Band,
) -> tuple[Float32, Float32, Array, Array]:
    """Variance that each pixel alone brings to sum w J r (xx, xy, yy), and what noise adds to grad m grad m.

    Both (3, H / 2, W / 2): sums about every second pixel, weights 1/2, 1, 1/2 along either axis. Also the ratio of the
    variance with a pixel's neighbours to that without, at the rows and columns `at`, and of every other of the band's
    own rows the sums of the squared gradient of the texture, and of its product with the mean of its neighbours'.
    z = grad m r of a pixel, summed over the pairs (m, r, keep), as consecutive ones share a frame's noise; the ratio is
    that of sum z (sum of z over the box) to sum z^2 around. change: offset and gain of the grey and the step in x and
    y, everywhere.
    """
    shape = len(change.knot), change.lines.shape[2]
    half = tuple(-(-n // 2) for n in shape)
    z, energy, ss = np.zeros((2, *shape), np.float32), np.zeros(shape, np.float32), np.zeros((3, *half), np.float32)
    for together in pictures:
        _forces(half[0], *together, change, z, ss, energy)
    zz, texture = np.zeros((5, *half), np.float32), np.zeros((2, half[0]))
    _products(half[0], z, energy, zz, texture)
    rows, columns = (q // 2 for q in at)
    sums = np.empty((2, len(rows), len(columns)))
    _around(len(rows), zz[3:], rows, columns, sums)
    around_alone, around_all = sums
    ratio = np.maximum(around_all, LEAST_RATIO * around_alone) / np.maximum(around_alone, 1e-9)
    own = slice((band.own_top - band.top + 1) // 2, (band.own_bottom - band.top + 1) // 2)
    return zz[:3], ss, ratio, texture[:, own]


@shared(fastmath={"contract"})
def _around(first, last, planes, rows, columns, out):  # type: ignore[no-untyped-def]
    """Sums of two planes of every second pixel over AROUND pixels about the places, the same in whatever band."""
    half = AROUND // 4
    down = np.empty((2, planes.shape[2]), np.float32)
    for j in range(first, last):
        down[:] = 0
        for q in range(max(0, rows[j] - half), min(planes.shape[1], rows[j] + half + 1)):
            _add(down[0], planes[0, q])
            _add(down[1], planes[1, q])
        for i in range(len(columns)):
            left, right = max(0, columns[i] - half), min(planes.shape[2], columns[i] + half + 1)
            alone, boxed = 0.0, 0.0
            for x in range(left, right):
                alone += down[0, x]
                boxed += down[1, x]
            out[0, j, i], out[1, j, i] = alone, boxed


@shared(fastmath={"contract"})
def _forces(first, last, m, r, keep, change, z, ss, energy):  # type: ignore[no-untyped-def]
    """Adds grad m times what the step (ex, ey), offset and gain of the grey leave of r; |grad m|^2; grad r grad r.

    Two rows at a time, whose first is the middle one of a sum over three of ss.
    """
    rows, cols = m.shape
    gx, gy, sums = np.empty(cols, np.float32), np.empty(cols, np.float32), np.zeros(cols + 3, np.float32)
    of = np.empty((4, cols), np.float32)
    three = np.zeros((3, 3, cols), np.float32)
    for pair in range(first, last):
        if pair == first:
            _noise(r, keep, 2 * pair - 1, gx, gy, three[0])
        else:
            _copy(three[2], three[0])
        for k in range(2):
            j = 2 * pair + k
            _noise(r, keep, j, gx, gy, three[1 + k])
            if 2 <= j < rows - 2:
                slopes(m, j, gx, gy)
                for q in range(4):
                    line(change, q, j, of[q])
                _add_forces((m[j], r[j], keep[j]), (of[0], of[1], of[2], of[3]), gx, gy, z[0, j], z[1, j], energy[j])
        for c in range(3):
            _halved(three[0, c], three[1, c], three[2, c], sums, ss[c, pair])


@nb.njit(cache=True)
def _copy(planes, out):  # type: ignore[no-untyped-def]
    """As out[:] = planes, which takes seconds to compile."""
    for c in range(planes.shape[0]):
        for i in range(planes.shape[1]):
            out[c, i] = planes[c, i]


@nb.njit(cache=True, fastmath={"contract"})
def _add_forces(pictures, change, gx, gy, zx, zy, energy):  # type: ignore[no-untyped-def]
    m, r, keep = pictures
    offset, gain, ex, ey = change
    for i in range(len(m)):
        left = keep[i] * (r[i] - offset[i] - gain[i] * m[i] - gx[i] * ex[i] - gy[i] * ey[i])
        zx[i] += gx[i] * left
        zy[i] += gy[i] * left
        energy[i] += gx[i] * gx[i] + gy[i] * gy[i]


@nb.njit(cache=True, fastmath={"contract"})
def _noise(r, keep, j, gx, gy, out):  # type: ignore[no-untyped-def]
    """Products of the slopes of r in row j, zero within 2 px of the edge."""
    if j < 2 or j >= len(r) - 2:
        out[:] = 0
        return
    slopes(r, j, gx, gy)
    _squares(gx, gy, keep[j], out[0], out[1], out[2])


@nb.njit(cache=True, fastmath={"contract"})
def _squares(x, y, weight, xx, xy, yy):  # type: ignore[no-untyped-def]
    for i in range(len(x)):
        xx[i] = weight[i] * x[i] * x[i]
        xy[i] = weight[i] * x[i] * y[i]
        yy[i] = weight[i] * y[i] * y[i]


@nb.njit(cache=True, fastmath={"contract"})
def _halved(above, middle, below, sums, out):  # type: ignore[no-untyped-def]
    """Adds to out the sums about every second column of three rows, weights 1/2, 1, 1/2 both ways; sums: room, with a
    zero at its end and one more."""
    half = np.float32(0.5)
    n = len(above)
    inside = sums[1:]
    for i in range(n):
        inside[i] = half * (above[i] + below[i]) + middle[i]
    for i in range(len(out)):
        out[i] += inside[2 * i] + half * (sums[2 * i] + inside[2 * i + 1])


@shared(fastmath={"contract"})
def _products(first, last, z, energy, out, texture):  # type: ignore[no-untyped-def]
    """z_x z_x, z_x z_y, z_y z_y, summed as `_halved` does. Of every other row alone, as means over regions are all that
    is asked of them: |z|^2, z times its sum over the box, and (texture: (2, H / 2)) the row's sums of the energy and of
    it times its mean over the box."""
    rows, cols = energy.shape
    reach = LAG // 2
    columns, sums, one = np.empty((3, cols), np.float32), np.zeros(cols + 3, np.float32), np.ones(cols, np.float32)
    alone, boxed, none = np.empty(cols, np.float32), np.empty(cols, np.float32), np.zeros(cols, np.float32)
    three = np.zeros((3, 3, cols), np.float32)
    for pair in range(first, last):
        for k in range(-1 if pair == first else 0, 2):
            j, of = 2 * pair + k, three[1 + k]
            if j < reach or j >= rows - reach:
                of[:] = 0
                continue
            _squares(z[0, j], z[1, j], one, of[0], of[1], of[2])
            if k == 0:
                columns[:] = 0
                for q in range(j - reach, j + reach + 1):
                    _add(columns[0], z[0, q])
                    _add(columns[1], z[1, q])
                    _add(columns[2], energy[q])
                alone[:] = 0
                boxed[:] = 0
                _add(alone, of[0])
                _add(alone, of[2])
                _add_times_box(z[0, j], columns[0], boxed[reach:])
                _add_times_box(z[1, j], columns[1], boxed[reach:])
                _halved(none, alone, none, sums, out[3, pair])
                _halved(none, boxed, none, sums, out[4, pair])
                boxed[:] = 0
                _add_times_box(energy[j], columns[2], boxed[reach:])
                texture[0, pair], texture[1, pair] = _sum(energy[j]), _sum(boxed) / LAG**2
        for c in range(3):
            _halved(three[0, c], three[1, c], three[2, c], sums, out[c, pair])
        _copy(three[2], three[0])


@nb.njit(cache=True, fastmath={"contract"})
def _sum(f):  # type: ignore[no-untyped-def]
    """Sum of f in sixteen parts, each in its order: one after the other every addition waits for the last."""
    parts = np.zeros(16)
    for k in range(len(f) // 16):
        block = f[16 * k :]
        for i in range(16):
            parts[i] += block[i]
    total = 0.0
    for i in range(16):
        total += parts[i]
    for i in range(len(f) // 16 * 16, len(f)):
        total += f[i]
    return total


@nb.njit(cache=True, fastmath={"contract"})
def _add(total, a):  # type: ignore[no-untyped-def]
    for i in range(len(total)):
        total[i] += a[i]


@nb.njit(cache=True, fastmath={"contract"})
def _add_times_box(f, columns, out):  # type: ignore[no-untyped-def]
    """Adds to out f times the sum of five columns about it, from the third column on."""
    middle = f[LAG // 2 :]
    for i in range(len(f) - LAG + 1):
        c = columns[i] + columns[i + 1] + columns[i + 2] + columns[i + 3] + columns[i + 4]
        out[i] += middle[i] * c
