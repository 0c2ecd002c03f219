"""Weighted sums over every matching window of a picture pair at once, for one Gauss-Newton step in all windows.

All windows read the same deformed pictures, so each product of pictures is summed down the columns once for a whole row
of windows and then across: a window of 25 x 25 px costs about 25 + 25 sums instead of 625.
"""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

from jumpvision.base.threads import shared

# products of the pictures m = (a + b) / 2, r = a - b and the gradient g = grad m, and the order to which each is
# multiplied with the coordinates xi, eta from the centre of the window
ORDER = np.array([2, 2, 2, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0])
GXX, GXY, GYY, GX, GY, GXM, GYM, GXR, GYR, ONE, M, MM, R, MR, RR = range(15)
SIZE = np.array([1, 3, 6])  # sums of an order: 1; xi, eta; xi^2, xi eta, eta^2
POWERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))  # of xi and eta, in this order
FIRST = np.concatenate([[0], np.cumsum(SIZE[ORDER])])
TILE = 128  # columns whose sums stay in the CPU's first cache
PRODUCTS, SQUARES = 27, 9  # sums down a column, of `moments` and of `moments_of`
WIDTH = 32  # at least as many, a whole number of the CPU's vectors


def _sources(order: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where `_across` has each of the sums over a window; a plane has a column sum for each power of eta."""
    column = np.concatenate([[0], np.cumsum(order + 1)])
    return np.array([i * WIDTH + column[q] + j for q, o in enumerate(order) for i, j in POWERS[: SIZE[o]]])


OF_PICTURES, OF_PLANES = _sources(ORDER), _sources(np.array([2, 2, 2]))


@nb.njit(cache=True, fastmath={"contract"})
def slopes(f, y, gx, gy):  # type: ignore[no-untyped-def]
    """Fourth-order central differences of row y of a picture, 2 px from its edge at least, into gx and gy."""
    n = f.shape[1]
    k8, k12 = np.float32(8), np.float32(1 / 12)
    row, up, up2, down, down2 = f[y], f[y - 1], f[y - 2], f[y + 1], f[y + 2]
    gx[:2] = 0
    gx[n - 2 :] = 0
    inside = gx[2:]
    for i in range(n - 4):  # forwards only: a place i - 1 would be tested for being negative, one by one
        inside[i] = (k8 * (row[i + 3] - row[i + 1]) - (row[i + 4] - row[i])) * k12
    for i in range(n):
        gy[i] = (k8 * (down[i] - up[i]) - (down2[i] - up2[i])) * k12


@shared(fastmath={"contract"})
def gradient(first, last, f, gx, gy):  # type: ignore[no-untyped-def]
    """The slopes of a row; zero within 2 px of the edge."""
    for j in range(first, last):
        if j < 2 or j >= len(f) - 2:
            gx[j] = 0
            gy[j] = 0
        else:
            slopes(f, j, gx[j], gy[j])


@nb.njit(cache=True, fastmath={"contract"})
def _add_products(below, above, count, total, f, j):  # type: ignore[no-untyped-def]
    """Add the rows at eta = j and -j to the column sums: what is even in eta from their sum, what is odd from the rest.

    below, above: weight, m, r, grad m of either row. One loop for all, so that nothing is read twice.
    """
    f1 = f * j
    f2 = f1 * j
    w_, m_, r_, gx_, gy_ = below
    v_, n_, s_, hx_, hy_ = above
    for i in range(count):
        w, m, r, gx, gy = w_[i], m_[i], r_[i], gx_[i], gy_[i]
        v, n, s, hx, hy = v_[i], n_[i], s_[i], hx_[i], hy_[i]
        wx, wy, wm, wr = w * gx, w * gy, w * m, w * r
        vx, vy, vn, vs = v * hx, v * hy, v * n, v * s
        a, b = wx * gx, vx * hx
        total[i] += f * (a + b)
        total[TILE + i] += f1 * (a - b)
        total[2 * TILE + i] += f2 * (a + b)
        a, b = wx * gy, vx * hy
        total[3 * TILE + i] += f * (a + b)
        total[4 * TILE + i] += f1 * (a - b)
        total[5 * TILE + i] += f2 * (a + b)
        a, b = wy * gy, vy * hy
        total[6 * TILE + i] += f * (a + b)
        total[7 * TILE + i] += f1 * (a - b)
        total[8 * TILE + i] += f2 * (a + b)
        a, b = wx, vx
        total[9 * TILE + i] += f * (a + b)
        total[10 * TILE + i] += f1 * (a - b)
        a, b = wy, vy
        total[11 * TILE + i] += f * (a + b)
        total[12 * TILE + i] += f1 * (a - b)
        a, b = wx * m, vx * n
        total[13 * TILE + i] += f * (a + b)
        total[14 * TILE + i] += f1 * (a - b)
        a, b = wy * m, vy * n
        total[15 * TILE + i] += f * (a + b)
        total[16 * TILE + i] += f1 * (a - b)
        a, b = wx * r, vx * s
        total[17 * TILE + i] += f * (a + b)
        total[18 * TILE + i] += f1 * (a - b)
        a, b = wy * r, vy * s
        total[19 * TILE + i] += f * (a + b)
        total[20 * TILE + i] += f1 * (a - b)
        total[21 * TILE + i] += f * (w + v)
        total[22 * TILE + i] += f * (wm + vn)
        total[23 * TILE + i] += f * (wm * m + vn * n)
        total[24 * TILE + i] += f * (wr + vs)
        total[25 * TILE + i] += f * (wr * m + vs * n)
        total[26 * TILE + i] += f * (wr * r + vs * s)


@nb.njit(cache=True, fastmath={"contract"})
def _add_planes(below, above, count, total, f, j):  # type: ignore[no-untyped-def]
    """As `_add_products`, of three planes up to second order."""
    f1 = f * j
    f2 = f1 * j
    p0, p1, p2 = below
    q0, q1, q2 = above
    for i in range(count):
        a, b = p0[i], q0[i]
        total[i] += f * (a + b)
        total[TILE + i] += f1 * (a - b)
        total[2 * TILE + i] += f2 * (a + b)
        a, b = p1[i], q1[i]
        total[3 * TILE + i] += f * (a + b)
        total[4 * TILE + i] += f1 * (a - b)
        total[5 * TILE + i] += f2 * (a + b)
        a, b = p2[i], q2[i]
        total[6 * TILE + i] += f * (a + b)
        total[7 * TILE + i] += f1 * (a - b)
        total[8 * TILE + i] += f2 * (a + b)


@nb.njit(cache=True, fastmath={"contract"})
def _across(columns, x, g, source, out):  # type: ignore[no-untyped-def]
    """Sums across one row of windows of what was summed down the columns (cols, WIDTH), again in pairs."""
    h = len(g) // 2
    total = np.empty(3 * WIDTH, np.float32)
    for k in range(len(x)):
        total[:] = 0
        for i in range(h + 1):
            f = g[h + i] if i > 0 else g[h] * np.float32(0.5)
            f1 = f * np.float32(i)
            f2 = f1 * np.float32(i)
            right, left = columns[x[k] + i], columns[x[k] - i]
            for c in range(WIDTH):
                a, b = right[c], left[c]
                total[c] += f * (a + b)
                total[WIDTH + c] += f1 * (a - b)
                total[2 * WIDTH + c] += f2 * (a + b)
        for s in range(len(source)):
            out[k, s] = total[source[s]]


@shared(fastmath={"contract"})
def moments(first, last, m, r, keep, gx, gy, x, y, g, source, out):  # type: ignore[no-untyped-def]
    """Sums of every product over the windows centred at columns x and rows y: out (ny, nx, FIRST[-1]).

    m, r, keep, gx, gy: (H, W), mean, difference, weight, gradient of the mean. g: weight along one side of the window;
    source: OF_PICTURES.
    """
    cols = m.shape[1]
    h = len(g) // 2
    columns = np.zeros((cols, WIDTH), np.float32)
    total = np.empty(PRODUCTS * TILE, np.float32)
    for k in range(first, last):
        for start in range(0, cols, TILE):
            n = min(TILE, cols - start)
            total[:] = 0
            for j in range(h + 1):
                d, u, end = y[k] + j, y[k] - j, start + n
                f = g[h + j] if j > 0 else g[h] * np.float32(0.5)  # the middle row is its own pair
                _add_products(
                    (keep[d, start:end], m[d, start:end], r[d, start:end], gx[d, start:end], gy[d, start:end]),
                    (keep[u, start:end], m[u, start:end], r[u, start:end], gx[u, start:end], gy[u, start:end]),
                    n,
                    total,
                    f,
                    np.float32(j),
                )
            for i in range(n):
                for c in range(PRODUCTS):
                    columns[start + i, c] = total[c * TILE + i]
        _across(columns, x, g, source, out[k])


@shared(fastmath={"contract"})
def moments_of(first, last, planes, x, y, g, source, out):  # type: ignore[no-untyped-def]
    """As `moments`, of three given planes (3, H, W) up to second order: out (ny, nx, 18); source: OF_PLANES."""
    cols = planes.shape[2]
    h = len(g) // 2
    columns = np.zeros((cols, WIDTH), np.float32)
    total = np.empty(SQUARES * TILE, np.float32)
    for k in range(first, last):
        for start in range(0, cols, TILE):
            n = min(TILE, cols - start)
            total[:] = 0
            for j in range(h + 1):
                d, u, end = y[k] + j, y[k] - j, start + n
                f = g[h + j] if j > 0 else g[h] * np.float32(0.5)
                _add_planes(
                    (planes[0, d, start:end], planes[1, d, start:end], planes[2, d, start:end]),
                    (planes[0, u, start:end], planes[1, u, start:end], planes[2, u, start:end]),
                    n,
                    total,
                    f,
                    np.float32(j),
                )
            for i in range(n):
                for c in range(SQUARES):
                    columns[start + i, c] = total[c * TILE + i]
        _across(columns, x, g, source, out[k])
