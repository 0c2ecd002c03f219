"""What the residuals of a match tell of its errors: what variance a pixel brings, what a finer window changes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array, Float32
from jumpvision.base.threads import shared
from jumpvision.films.calibration import LEAST_CORRELATION

from .frame import taper
from .moments import slopes
from .surface import Drawn, line
from .validate import LAG, PART

AROUND = 33  # px, side of the region over which the correlation of neighbouring residuals is averaged


class Scatter(NamedTuple):
    """Of the pixels of some rows; planes are (n, H / 2, W / 2): sums about every second pixel, weights 1/2, 1, 1/2 both
    ways.

    z = grad m r of a pixel, r what the step leaves, summed over the pairs, as consecutive ones share a frame's noise.
    """

    zz: Float32  # (3, ...) variance that each pixel alone brings to sum w J r: xx, xy, yy
    ss: Float32  # (3, ...) what noise adds to grad m grad m
    force: Float32  # (2, ...) z
    texture: Float32  # (3, ...) grad a grad b, which noise does not inflate
    ratio: Array  # (ny, nx) sum z (sum of z over the box) to sum z^2 around each window
    energy: Array  # (2, rows) of every other row: sums of (grad m)^2, and of it times the mean of its neighbours'


def scatter(
    pictures: Iterable[tuple[Float32, Float32, Float32]],
    change: Drawn,
    at: tuple[NDArray[np.intp], ...],
    own: slice,
) -> Scatter:
    """Of pairs (m, r, keep); change: offset and gain of the grey and the step in x and y, everywhere; at: rows and
    columns of the windows; own: the planes' rows whose energy is asked for."""
    shape = len(change.knot), change.lines.shape[2]
    half = tuple(-(-n // 2) for n in shape)
    z, energy = np.zeros((2, *shape), np.float32), np.zeros(shape, np.float32)
    ss, texture = np.zeros((2, 3, *half), np.float32)
    for together in pictures:
        _forces(half[0], *together, change, z, ss, texture, energy)
    planes, of_rows = np.zeros((7, *half), np.float32), np.zeros((2, half[0]))
    _products(half[0], z, energy, planes, of_rows)
    rows, columns = (q // 2 for q in at)
    sums = np.empty((2, len(rows), len(columns)))
    _around(len(rows), planes[3:5], rows, columns, sums)
    around_alone, around_all = sums
    ratio = np.maximum(around_all, LEAST_CORRELATION.value * around_alone) / np.maximum(around_alone, 1e-9)
    return Scatter(planes[:3], ss, planes[5:], texture, ratio, of_rows[:, own])


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
def _forces(first, last, m, r, keep, change, z, ss, texture, energy):  # type: ignore[no-untyped-def]
    """Adds grad m times what the step (ex, ey), offset and gain of the grey leave of r; |grad m|^2; grad r grad r and
    grad a grad b.

    Two rows at a time, whose first is the middle one of a sum over three.
    """
    rows, cols = m.shape
    gx, gy, sums = np.empty(cols, np.float32), np.empty(cols, np.float32), np.zeros(cols + 3, np.float32)
    of = np.empty((4, cols), np.float32)
    three = np.zeros((3, 6, cols), np.float32)  # rows; grad r grad r, then grad a grad b
    for pair in range(first, last):
        if pair > first:
            _copy(three[2], three[0])
        for k in range(-1 if pair == first else 0, 2):
            j = 2 * pair + k
            if j < 2 or j >= rows - 2:
                three[1 + k] = 0
                continue
            slopes(r, j, gx, gy)
            of_noise = three[1 + k, :3]
            _squares(gx, gy, keep[j], of_noise[0], of_noise[1], of_noise[2])
            slopes(m, j, gx, gy)
            of_both = three[1 + k, 3:]
            _squares(gx, gy, keep[j], of_both[0], of_both[1], of_both[2])
            for c in range(3):
                _less_quarter(of_both[c], of_noise[c])
            if k >= 0:
                for q in range(4):
                    line(change, q, j, of[q])
                _add_forces((m[j], r[j], keep[j]), (of[0], of[1], of[2], of[3]), gx, gy, z[0, j], z[1, j], energy[j])
        for c in range(3):
            _halved(three[0, c], three[1, c], three[2, c], sums, ss[c, pair])
            _halved(three[0, 3 + c], three[1, 3 + c], three[2, 3 + c], sums, texture[c, pair])


@nb.njit(cache=True, fastmath={"contract"})
def _less_quarter(f, of):  # type: ignore[no-untyped-def]
    for i in range(len(f)):
        f[i] -= np.float32(0.25) * of[i]


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
    """z_x z_x, z_x z_y, z_y z_y, and from the sixth on z_x, z_y, summed as `_halved` does. Of every other row alone, as
    means over regions are all that is asked of them: |z|^2, z times its sum over the box, and (texture: (2, H / 2)) the
    row's sums of the energy and of it times its mean over the box."""
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
        above, below = max(2 * pair - 1, 0), min(2 * pair + 1, rows - 1)  # z is zero at the edges
        for c in range(2):
            _halved(z[c, above], z[c, 2 * pair], z[c, below], sums, out[5 + c, pair])
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


def within(of: Scatter, window: int, at: tuple[NDArray[np.intp], NDArray[np.intp]], rounding: float) -> Array:
    """(4, ny, nx): what a window of PART of the side about the planes' columns and rows `at`, without a gradient of its
    own, would add to the displacement, d_x, d_y [px], and the variance of it, as if the residuals were noise.

    It sees what the whole window has averaged: the displacement less that of the surface through the vectors. NaN where
    the noise hides the texture.
    """
    x, y = at
    fine = taper(round(PART * window))
    g = np.ascontiguousarray(fine[len(fine) // 2 % 2 :: 2])
    least = rounding * float((fine**2).sum() / fine.sum()) ** 2
    force, spread = np.empty((len(y), len(x), 5)), np.empty((len(y), len(x), 3))
    sums_of(len(y), np.concatenate([of.force, of.texture]), x, y, g, force)
    sums_of(len(y), of.zz, x, y, g * g, spread)
    bx, by, xx, xy, yy = np.moveaxis(force, 2, 0)
    zxx, zxy, zyy = np.moveaxis(spread, 2, 0) * of.ratio
    det = xx * yy - xy * xy
    good = (det > 0.01 * xx * yy) & (xx > 0)  # else the noise hides the texture
    det = np.where(good, det, np.nan)
    ix, iy, ixy = yy / det, xx / det, -xy / det
    vx = ix * ix * zxx + 2 * ix * ixy * zxy + ixy * ixy * zyy
    vy = ixy * ixy * zxx + 2 * iy * ixy * zxy + iy * iy * zyy
    return np.stack([ix * bx + ixy * by, ixy * bx + iy * by, np.maximum(vx, least * ix), np.maximum(vy, least * iy)])


@shared(fastmath={"contract"})
def sums_of(first, last, planes, x, y, g, out):  # type: ignore[no-untyped-def]
    """Weighted sums of planes (n, H, W) over the windows centred at columns x and rows y: out (ny, nx, n)."""
    h = len(g) // 2
    down = np.empty(planes.shape[2], np.float32)
    for j in range(first, last):
        for c in range(len(planes)):
            down[:] = 0
            for q in range(-h, h + 1):
                row, f = planes[c, y[j] + q], g[h + q]
                for i in range(len(down)):
                    down[i] += f * row[i]
            for k in range(len(x)):
                total = np.float32(0)
                for q in range(-h, h + 1):
                    total += g[h + q] * down[x[k] + q]
                out[j, k, c] = total
