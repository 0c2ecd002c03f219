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

from typing import NamedTuple

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array, Float32

from .frame import Frame, taper
from .moments import FIRST, OF_PICTURES, OF_PLANES, gradient, moments, moments_of, slopes
from .solve import STEPPED, covariances, steps
from .surface import axis, everywhere, lightly_smoothed
from .validate import LAG

EDGE = 2  # px at the border of the padded frame that the spline does not reach
LANES = 8  # pixels computed at a time; a run's last ones reach into the next run, which then overwrites them


def half_way(a: Frame, b: Frame, dx: Float32, dy: Float32) -> tuple[Float32, Float32, Float32]:
    """Mean m and difference r of the two frames brought half-way together, and the weight of their pixels.

    dx, dy: (H, W) [px] displacement from a to b at every pixel of the padded frame; keep is 0 or 1.
    """
    m, r, keep = (np.empty(a.weight.shape, np.float32) for _ in range(3))
    frame = (a.pad, a.pad + a.grey.shape[0], a.pad + a.grey.shape[1])
    _half_way(a.c, b.c, a.weight, b.weight, a.usable.all(), b.usable.all(), frame, a.fine, dx, dy, m, r, keep)
    return m, r, keep


@nb.njit(cache=True, parallel=True, fastmath=True)
def _half_way(ca, cb, wa, wb, clear_a, clear_b, frame, fine, dx, dy, m, r, keep):  # type: ignore[no-untyped-def]
    rows, cols = m.shape
    half = np.float32(0.5)
    for j in nb.prange(rows):
        part, grey = np.empty((2, cols + LANES), np.float32), np.empty((2, cols + LANES), np.float32)
        light, knot = np.empty((2, cols), np.float32), np.empty((2, cols), np.int32)
        _read(ca, wa, clear_a, frame, fine, dx[j], dy[j], -half, j, part, knot, grey[0], light[0])
        _read(cb, wb, clear_b, frame, fine, dx[j], dy[j], half, j, part, knot, grey[1], light[1])
        for i in range(cols):
            m[j, i] = half * (grey[0, i] + grey[1, i])
            r[j, i] = grey[0, i] - grey[1, i]
            keep[j, i] = light[0, i] * light[1, i]


@nb.njit(cache=True, fastmath=True)
def _read(c, weight, clear, frame, fine, dx, dy, sign, j, part, knot, out, keep):  # type: ignore[no-untyped-def]
    """Row j of the spline c (knots every pixel, or half pixel if `fine`) at (x, y) + sign (dx, dy), and its weight.

    clear: the weight is 1 in the whole frame, which ends at pad, bottom and right of the padded one.
    """
    rows, cols = weight.shape
    scale = 2 if fine else 1
    shift, half = np.float32(0.5 if fine else 0.0), np.float32(0.5)
    pad, bottom, right = np.float32(frame[0]), np.float32(frame[1]), np.float32(frame[2])
    # the last row is left out, as the last run reads beyond its end
    low, high = np.float32(EDGE - j), np.float32(rows - 2 - EDGE - j)
    for i in range(cols):
        x, y = sign * dx[i], sign * dy[i]
        qx = min(max(x, np.float32(EDGE - i)), np.float32(cols - 1 - EDGE - i))
        qy = min(max(y, low), high)
        px, py = np.float32(i) + x + half, np.float32(j) + y + half
        keep[i] = np.float32(1) if pad <= px < right and pad <= py < bottom else np.float32(0)
        ex, ey = np.float32(scale) * qx + shift, np.float32(scale) * qy + shift
        kx, ky = np.floor(ex), np.floor(ey)
        knot[0, i], knot[1, i] = np.int32(kx), np.int32(ky)
        part[0, i], part[1, i] = ex - kx, ey - ky
    if not clear:
        for i in range(cols):
            if keep[i] > 0:
                keep[i] = weight[j + int(np.floor(sign * dy[i] + half)), i + int(np.floor(sign * dx[i] + half))]
    first = 0
    while first < cols:
        kx, ky = knot[0, first], knot[1, first]
        end = first + 1
        while end < cols and knot[0, end] == kx and knot[1, end] == ky:
            end += 1
        y, x = scale * j + ky, scale * first + kx
        t, s, f = part[0, first:], part[1, first:], out[first:]
        n = (end - first + LANES - 1) // LANES * LANES
        if fine:
            _run(c[y - 1, x - 1 :], c[y, x - 1 :], c[y + 1, x - 1 :], c[y + 2, x - 1 :], 2, n, t, s, f)
        else:
            _run(c[y - 1, x - 1 :], c[y, x - 1 :], c[y + 1, x - 1 :], c[y + 2, x - 1 :], 1, n, t, s, f)
        first = end


@nb.njit(cache=True, fastmath=True, inline="always")
def _run(c0, c1, c2, c3, scale, n, t, s, out):  # type: ignore[no-untyped-def]
    """Cubic B-spline at the parts t, s of a knot's distance; c0 to c3: rows of knots from the one left of the first."""
    six, two3, half, one = np.float32(1 / 6), np.float32(2 / 3), np.float32(0.5), np.float32(1)
    for i in range(n):
        k = scale * i
        a, b = t[i], s[i]
        a1, b1 = one - a, one - b
        x0, x3 = a1 * a1 * a1 * six, a * a * a * six
        x1, x2 = two3 - half * a * a * (a1 + one), two3 - half * a1 * a1 * (a + one)
        y0, y3 = b1 * b1 * b1 * six, b * b * b * six
        y1, y2 = two3 - half * b * b * (b1 + one), two3 - half * b1 * b1 * (b + one)
        r0 = x0 * c0[k] + x1 * c0[k + 1] + x2 * c0[k + 2] + x3 * c0[k + 3]
        r1 = x0 * c1[k] + x1 * c1[k + 1] + x2 * c1[k + 2] + x3 * c1[k + 3]
        r2 = x0 * c2[k] + x1 * c2[k + 1] + x2 * c2[k + 2] + x3 * c2[k + 3]
        r3 = x0 * c3[k] + x1 * c3[k + 1] + x2 * c3[k + 2] + x3 * c3[k + 3]
        out[i] = y0 * r0 + y1 * r1 + y2 * r2 + y3 * r3


AROUND = 33  # px, side of the region over which the correlation of neighbouring residuals is averaged
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
    dx, dy = (everywhere(rows, columns, f) for f in start)
    g = taper(grid.window)
    places = (grid.x + pad).astype(np.intp), (grid.y + pad).astype(np.intp)
    sums, part = np.zeros((ny, nx, FIRST[-1])), np.empty((ny, nx, FIRST[-1]))
    pictures = []
    for a, b in pairs:
        together = half_way(a, b, dx, dy)
        moments(*together, *_gradient(together[0]), *places, g, OF_PICTURES, part)
        sums += part
        if errors:
            pictures.append(together)
    step, quality, state = np.empty((ny * nx, 8)), np.empty(ny * nx), np.empty(ny * nx, np.int64)
    sums = sums.reshape(ny * nx, -1)
    steps(sums, len(pairs) * float(g.sum()) ** 2, texture, step, quality, state)

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
        offset, gain, ex, ey = (everywhere(rows, columns, change[q]) for q in (6, 7, 0, 3))
        zz, ss, ratio, clumping = _scatter(pictures, (offset, gain, ex, ey), places[::-1])
        scatter, noise = np.empty((ny, nx, 18)), np.empty((ny, nx, 18))
        moments_of(zz, *places, g * g, OF_PLANES, scatter)
        moments_of(ss, *places, g, OF_PLANES, noise)
        scatter *= ratio[:, :, None]
        sigma = np.empty((ny * nx, 6))
        # rounding is there where equal frames leave no residual; the frames of an ensemble share all but two of it
        least = (pairs[0][0].rounding + pairs[-1][1].rounding) / len(pairs) * float((g**2).sum() / g.sum()) ** 2
        covariances(sums, noise.reshape(ny * nx, 18), scatter.reshape(ny * nx, 18), least, sigma)
        sigma = sigma[:, ALONG].T.reshape(6, ny, nx)
    state = state.reshape(ny, nx)
    p = np.where(state == STEPPED, p, np.nan)
    return Match(p, sigma, clumping, quality.reshape(ny, nx), state)


def _gradient(f: Float32) -> tuple[Float32, Float32]:
    gx, gy = np.empty_like(f), np.empty_like(f)
    gradient(f, gx, gy)
    return gx, gy


@nb.njit(cache=True, parallel=True, fastmath=True)
def _forces(m, r, keep, change, z, ss, energy):  # type: ignore[no-untyped-def]
    """Adds grad m times what the step (ex, ey), offset and gain of the grey leave of r; |grad m|^2; grad r grad r."""
    rows, cols = m.shape
    offset, gain, ex, ey = change
    for j in nb.prange(2, rows - 2):
        gx, gy, left = np.empty(cols, np.float32), np.empty(cols, np.float32), np.empty(cols, np.float32)
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


@nb.njit(cache=True, fastmath=True)
def _left(keep, r, offset, gain, m, gx, ex, gy, ey, left):  # type: ignore[no-untyped-def]
    for i in range(len(left)):
        left[i] = keep[i] * (r[i] - offset[i] - gain[i] * m[i] - gx[i] * ex[i] - gy[i] * ey[i])


@nb.njit(cache=True, fastmath=True)
def _add(total, a, b):  # type: ignore[no-untyped-def]
    for i in range(len(total)):
        total[i] += a[i] * b[i]


def _scatter(
    pictures: list[tuple[Float32, Float32, Float32]],
    change: tuple[Float32, Float32, Float32, Float32],
    at: tuple[NDArray[np.intp], ...],
) -> tuple[Float32, Float32, Array, float]:
    """Variance that each pixel alone brings to sum w J r (xx, xy, yy: (3, H, W)), and what noise adds to grad m grad m.

    Also the ratio of the variance with a pixel's neighbours to that without, at the rows and columns `at`, and the
    clumping of the texture. z = grad m r of a pixel, summed over the pairs (m, r, keep), as consecutive ones share a
    frame's noise; the ratio is that of sum z (sum of z over the box) to sum z^2 around. change: offset and gain of the
    grey and the step in x and y, everywhere.
    """
    shape = change[0].shape
    z, ss, energy = np.zeros((2, *shape), np.float32), np.zeros((3, *shape), np.float32), np.zeros(shape, np.float32)
    for together in pictures:
        _forces(*together, change, z, ss, energy)
    box = (LAG, LAG)
    around = (AROUND, AROUND)
    together = sum(cv2.multiply(q, cv2.boxFilter(q, -1, box, normalize=False)) for q in z)
    zz = np.empty((3, *shape), np.float32)
    for q, (f, g) in zip(zz, ((z[0], z[0]), (z[0], z[1]), (z[1], z[1]))):
        cv2.multiply(f, g, q)
    around_all, around_alone = (cv2.boxFilter(q, -1, around)[np.ix_(*at)] for q in (together, zz[0] + zz[2]))
    ratio = np.maximum(around_all, LEAST_RATIO * around_alone) / np.maximum(around_alone, 1e-9)
    mean = cv2.mean(energy)[0]
    clumping = cv2.mean(cv2.multiply(energy, cv2.boxFilter(energy, -1, box)))[0] / max(mean**2, 1e-12)
    return zz, ss, ratio, float(clumping)
