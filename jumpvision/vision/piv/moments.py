"""Weighted sums over every matching window of a picture pair at once, for one Gauss-Newton step in all windows.

All windows read the same deformed pictures, so each product of pictures is summed down the columns once for a whole row
of windows and then across: a window of 25 x 25 px costs about 25 + 25 sums instead of 625.
"""

from __future__ import annotations

import numba as nb
import numpy as np

# products of the pictures m = (a + b) / 2, r = a - b and their gradients g = grad m, s = grad r, and the order to which
# each is multiplied with the coordinates xi, eta from the centre of the window
ORDER = np.array([2, 2, 2, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 2, 2, 2])
GXX, GXY, GYY, GX, GY, GXM, GYM, GXR, GYR, ONE, M, MM, R, MR, RR, SXX, SXY, SYY = range(18)
SIZE = np.array([1, 3, 6])  # sums of an order: 1; xi, eta; xi^2, xi eta, eta^2
FIRST = np.concatenate([[0], np.cumsum(SIZE[ORDER])])


@nb.njit(cache=True, parallel=True, fastmath=True)
def deform(c, fine, weight, dx, dy, sign, out, keep, first):  # type: ignore[no-untyped-def]
    """Read the spline c (knots every pixel, or half pixel if `fine`) at (x, y) + sign (dx, dy); keep *= its weight."""
    rows, cols = out.shape
    scale, shift = (2.0, 0.5) if fine else (1.0, 0.0)
    six, two3, half, one = np.float32(1 / 6), np.float32(2 / 3), np.float32(0.5), np.float32(1)
    top, left = np.float32(rows - 3), np.float32(cols - 3)
    for j in nb.prange(rows):
        for i in range(cols):
            px, py = np.float32(i) + sign * dx[j, i], np.float32(j) + sign * dy[j, i]
            qx, qy = min(max(px, np.float32(2)), left), min(max(py, np.float32(2)), top)
            w = weight[int(qy + half), int(qx + half)]
            if qx != px or qy != py:
                w = np.float32(0)
            keep[j, i] = w if first else keep[j, i] * w
            fx, fy = scale * qx + shift, scale * qy + shift
            ix, iy = int(fx), int(fy)
            t, s = np.float32(fx - ix), np.float32(fy - iy)
            t1, s1 = one - t, one - s
            x0, x3 = t1 * t1 * t1 * six, t * t * t * six
            x1, x2 = two3 - half * t * t * (t1 + one), two3 - half * t1 * t1 * (t + one)
            y0, y3 = s1 * s1 * s1 * six, s * s * s * six
            y1, y2 = two3 - half * s * s * (s1 + one), two3 - half * s1 * s1 * (s + one)
            r0 = x0 * c[iy - 1, ix - 1] + x1 * c[iy - 1, ix] + x2 * c[iy - 1, ix + 1] + x3 * c[iy - 1, ix + 2]
            r1 = x0 * c[iy, ix - 1] + x1 * c[iy, ix] + x2 * c[iy, ix + 1] + x3 * c[iy, ix + 2]
            r2 = x0 * c[iy + 1, ix - 1] + x1 * c[iy + 1, ix] + x2 * c[iy + 1, ix + 1] + x3 * c[iy + 1, ix + 2]
            r3 = x0 * c[iy + 2, ix - 1] + x1 * c[iy + 2, ix] + x2 * c[iy + 2, ix + 1] + x3 * c[iy + 2, ix + 2]
            out[j, i] = y0 * r0 + y1 * r1 + y2 * r2 + y3 * r3


@nb.njit(cache=True, fastmath=True)
def _times(p, a, b):  # type: ignore[no-untyped-def]
    for i in range(len(p)):
        p[i] = a[i] * b[i]


@nb.njit(cache=True, fastmath=True)
def _add(total, factor, p):  # type: ignore[no-untyped-def]
    for i in range(len(p)):
        total[i] += factor * p[i]


@nb.njit(cache=True, fastmath=True)
def _gradient(f, y, gx, gy):  # type: ignore[no-untyped-def]
    """Fourth-order central differences of row y, into gx and gy; zero within 2 px of the picture's edge."""
    n = f.shape[1]
    k8, k12 = np.float32(8), np.float32(1 / 12)
    row, up, up2, down, down2 = f[y], f[y - 1], f[y - 2], f[y + 1], f[y + 2]
    gx[:2] = 0
    gx[n - 2 :] = 0
    for i in range(2, n - 2):
        gx[i] = (k8 * (row[i + 1] - row[i - 1]) - (row[i + 2] - row[i - 2])) * k12
    for i in range(n):
        gy[i] = (k8 * (down[i] - up[i]) - (down2[i] - up2[i])) * k12


@nb.njit(cache=True, fastmath=True)
def _across(columns, order, first, x, g, out):  # type: ignore[no-untyped-def]
    """Sums across one row of windows of what was summed down the columns (planes of up to three orders of eta)."""
    h = len(g) // 2
    for k in range(len(x)):
        c = 0
        left = x[k] - h
        for q in range(len(order)):
            f = first[q]
            for b in range(order[q] + 1):
                s0, s1, s2 = np.float32(0), np.float32(0), np.float32(0)
                for i in range(len(g)):
                    v = g[i] * columns[c, left + i]
                    xi = np.float32(i - h)
                    s0 += v
                    s1 += v * xi
                    s2 += v * xi * xi
                if b == 0:
                    out[k, f] = s0
                    if order[q] > 0:
                        out[k, f + 1] = s1
                    if order[q] > 1:
                        out[k, f + 3] = s2
                elif b == 1:
                    out[k, f + 2] = s0
                    if order[q] > 1:
                        out[k, f + 4] = s1
                else:
                    out[k, f + 5] = s0
                c += 1


@nb.njit(cache=True, parallel=True, fastmath=True)
def moments(m, r, keep, x, y, g, order, first, out):  # type: ignore[no-untyped-def]
    """Sums of every product over the windows centred at columns x and rows y: out (ny, nx, first[-1]).

    g: weight along one side of the window; the planes are those of ORDER, or its first few.
    """
    cols = m.shape[1]
    h = len(g) // 2
    planes = len(order)
    for k in nb.prange(len(y)):
        columns = np.zeros((order.sum() + planes, cols), np.float32)
        buffer = np.empty((10, cols), np.float32)
        p = np.empty(cols, np.float32)
        gx, gy, sx, sy, wx, wy, wm, ux, uy = (buffer[0], buffer[1], buffer[2], buffer[3], buffer[4], buffer[5],
                                              buffer[6], buffer[7], buffer[8])  # fmt: skip
        for j in range(-h, h + 1):
            row = y[k] + j
            w, mj, rj = keep[row], m[row], r[row]
            _gradient(m, row, gx, gy)
            _times(wx, w, gx)
            _times(wy, w, gy)
            _times(wm, w, mj)
            if planes > SXX:
                _gradient(r, row, sx, sy)
                _times(ux, w, sx)
                _times(uy, w, sy)
            c = 0
            for q in range(planes):
                if q == GXX:
                    _times(p, wx, gx)
                elif q == GXY:
                    _times(p, wx, gy)
                elif q == GYY:
                    _times(p, wy, gy)
                elif q == GX:
                    p[:] = wx
                elif q == GY:
                    p[:] = wy
                elif q == GXM:
                    _times(p, wx, mj)
                elif q == GYM:
                    _times(p, wy, mj)
                elif q == GXR:
                    _times(p, wx, rj)
                elif q == GYR:
                    _times(p, wy, rj)
                elif q == ONE:
                    p[:] = w
                elif q == M:
                    p[:] = wm
                elif q == MM:
                    _times(p, wm, mj)
                elif q == R:
                    _times(p, w, rj)
                elif q == MR:
                    _times(p, wm, rj)
                elif q == RR:
                    _times(p, w, rj)
                    _times(p, p, rj)
                elif q == SXX:
                    _times(p, ux, sx)
                elif q == SXY:
                    _times(p, ux, sy)
                else:
                    _times(p, uy, sy)
                factor = g[j + h]
                for _ in range(order[q] + 1):
                    _add(columns[c], factor, p)
                    factor *= np.float32(j)
                    c += 1
        _across(columns, order, first, x, g, out[k])


@nb.njit(cache=True, parallel=True, fastmath=True)
def moments_of(planes, x, y, g, order, first, out):  # type: ignore[no-untyped-def]
    """As `moments`, of given planes (n, H, W), all of the same `order` (an array of n)."""
    cols = planes.shape[2]
    h = len(g) // 2
    for k in nb.prange(len(y)):
        columns = np.zeros((order.sum() + len(order), cols), np.float32)
        for j in range(-h, h + 1):
            c = 0
            for q in range(len(order)):
                factor = g[j + h]
                for _ in range(order[q] + 1):
                    _add(columns[c], factor, planes[q, y[k] + j])
                    factor *= np.float32(j)
                    c += 1
        _across(columns, order, first, x, g, out[k])
