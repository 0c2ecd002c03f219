"""What is done to one window of a match (see `refine`): read it, standardise it, sum it up, solve, and its covariance.

Compiled into `refine`; arrays of one window are (m, m) with a rim for the gradient stencil.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

LAG = 3  # px, how far residuals may be correlated in the covariance
RIM = 2  # px around the window for the gradient stencil


@nb.njit(cache=True, fastmath=True)
def sample(c, weight, x, y, p, sign, out, w, first):  # type: ignore[no-untyped-def]
    """Read one window with its rim; multiply the weights `w` (or set them if `first`) by those at the places read."""
    m = out.shape[0]
    h = m // 2
    rows, cols = weight.shape
    for j in range(m):
        eta = j - h
        for i in range(m):
            xi = i - h
            xx, xy, yy = 0.5 * xi * xi, float(xi * eta), 0.5 * eta * eta
            px = x + xi + sign * (p[0] + p[2] * xi + p[3] * eta + p[6] * xx + p[7] * xy + p[8] * yy)
            py = y + eta + sign * (p[1] + p[4] * xi + p[5] * eta + p[9] * xx + p[10] * xy + p[11] * yy)
            nx, ny = math.floor(px + 0.5), math.floor(py + 0.5)
            if nx < 1 or ny < 1 or nx > cols - 2 or ny > rows - 2:
                out[j, i] = 0.0
                w[j, i] = 0.0
                continue
            w[j, i] = weight[ny, nx] if first else w[j, i] * weight[ny, nx]
            px, py = 2.0 * px + 0.5, 2.0 * py + 0.5
            ix, iy = int(px), int(py)
            t, s = np.float32(px - ix), np.float32(py - iy)
            t1, s1 = np.float32(1) - t, np.float32(1) - s
            six, two3, half = np.float32(1 / 6), np.float32(2 / 3), np.float32(0.5)
            x0, x3 = t1 * t1 * t1 * six, t * t * t * six
            x1, x2 = two3 - half * t * t * (t1 + np.float32(1)), two3 - half * t1 * t1 * (t + np.float32(1))
            y0, y3 = s1 * s1 * s1 * six, s * s * s * six
            y1, y2 = two3 - half * s * s * (s1 + np.float32(1)), two3 - half * s1 * s1 * (s + np.float32(1))
            r0 = x0 * c[iy - 1, ix - 1] + x1 * c[iy - 1, ix] + x2 * c[iy - 1, ix + 1] + x3 * c[iy - 1, ix + 2]
            r1 = x0 * c[iy, ix - 1] + x1 * c[iy, ix] + x2 * c[iy, ix + 1] + x3 * c[iy, ix + 2]
            r2 = x0 * c[iy + 1, ix - 1] + x1 * c[iy + 1, ix] + x2 * c[iy + 1, ix + 1] + x3 * c[iy + 1, ix + 2]
            r3 = x0 * c[iy + 2, ix - 1] + x1 * c[iy + 2, ix] + x2 * c[iy + 2, ix + 1] + x3 * c[iy + 2, ix + 2]
            out[j, i] = y0 * r0 + y1 * r1 + y2 * r2 + y3 * r3


@nb.njit(cache=True, fastmath=True)
def standardise(f, w):  # type: ignore[no-untyped-def]
    """Bring f to zero mean and unit variance under the weights w (inside the rim); return its standard deviation."""
    m = f.shape[0]
    total = mean = square = 0.0
    for j in range(RIM, m - RIM):
        for i in range(RIM, m - RIM):
            total += w[j, i]
            mean += w[j, i] * f[j, i]
    mean /= total
    for j in range(RIM, m - RIM):
        for i in range(RIM, m - RIM):
            square += w[j, i] * (f[j, i] - mean) ** 2
    std = math.sqrt(square / total)
    if std > 0.0:
        f -= np.float32(mean)
        f *= np.float32(1.0 / std)
    return std


@nb.njit(cache=True, fastmath=True)
def _gradient(f, j, i):  # type: ignore[no-untyped-def]
    """Fourth-order central differences (d/dx, d/dy)."""
    k8, k12 = np.float32(8), np.float32(1 / 12)
    gx = (k8 * (f[j, i + 1] - f[j, i - 1]) - (f[j, i + 2] - f[j, i - 2])) * k12
    gy = (k8 * (f[j + 1, i] - f[j - 1, i]) - (f[j + 2, i] - f[j - 2, i])) * k12
    return gx, gy


@nb.njit(cache=True, fastmath=True)
def normal_equations(mean, r, w, jac, hess, clean, rhs):  # type: ignore[no-untyped-def]
    """J of every pixel, H = sum w J J^T, the same without noise, and sum w J r, with the mean of J taken out."""
    m = mean.shape[0]
    h = m // 2
    hess[:] = 0.0
    clean[:] = 0.0
    rhs[:] = 0.0
    centre = np.zeros(6)
    q = np.zeros(6)
    # products of the gradient with the coordinates: 1, xi, eta, xi^2, xi eta, eta^2
    s = np.zeros((3, 6))
    e = np.zeros((3, 6))
    total = 0.0
    for j in range(RIM, m - RIM):
        eta = float(j - h)
        for i in range(RIM, m - RIM):
            xi = float(i - h)
            wi = float(w[j, i])
            gx, gy = _gradient(mean, j, i)
            rx, ry = _gradient(r, j, i)
            jac[j, i, 0] = gx
            jac[j, i, 1] = gy
            total += wi
            a, b = wi * gx, wi * gy
            ri = float(r[j, i])
            q[0] += a * ri
            q[1] += b * ri
            q[2] += a * xi * ri
            q[3] += a * eta * ri
            q[4] += b * xi * ri
            q[5] += b * eta * ri
            centre[0] += a
            centre[1] += b
            centre[2] += a * xi
            centre[3] += a * eta
            centre[4] += b * xi
            centre[5] += b * eta
            for k in range(3):
                if k == 0:
                    gg, rr = a * gx, wi * rx * rx
                elif k == 1:
                    gg, rr = a * gy, wi * rx * ry
                else:
                    gg, rr = b * gy, wi * ry * ry
                s[k, 0] += gg
                s[k, 1] += gg * xi
                s[k, 2] += gg * eta
                s[k, 3] += gg * xi * xi
                s[k, 4] += gg * xi * eta
                s[k, 5] += gg * eta * eta
                e[k, 0] += rr
                e[k, 1] += rr * xi
                e[k, 2] += rr * eta
                e[k, 3] += rr * xi * xi
                e[k, 4] += rr * xi * eta
                e[k, 5] += rr * eta * eta
    for k in range(6):
        centre[k] /= total
        rhs[k] = q[k]  # the weighted mean of r is zero already
    for k in range(6):
        ck, pk = (k if k < 2 else (k - 2) // 2), (0 if k < 2 else 1 + (k - 2) % 2)
        for n in range(k, 6):
            cn, pn = (n if n < 2 else (n - 2) // 2), (0 if n < 2 else 1 + (n - 2) % 2)
            if pk == 0 or pn == 0:
                term = pk + pn
            else:
                term = pk + pn + 1
            value = s[ck + cn, term] - total * centre[k] * centre[n]
            hess[k, n] = value
            hess[n, k] = value
            clean[k, n] = value - 0.25 * e[ck + cn, term]
            clean[n, k] = clean[k, n]
    for j in range(RIM, m - RIM):
        eta = float(j - h)
        for i in range(RIM, m - RIM):
            xi = float(i - h)
            gx, gy = jac[j, i, 0], jac[j, i, 1]
            jac[j, i, 0] = gx - centre[0]
            jac[j, i, 1] = gy - centre[1]
            jac[j, i, 2] = gx * xi - centre[2]
            jac[j, i, 3] = gx * eta - centre[3]
            jac[j, i, 4] = gy * xi - centre[4]
            jac[j, i, 5] = gy * eta - centre[5]
    return total


@nb.njit(cache=True, fastmath=True)
def solve(matrix, rhs):  # type: ignore[no-untyped-def]
    """Cholesky solution of matrix x = rhs (6, k) in place; False if the matrix is not positive definite."""
    n = 6
    low = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            s = matrix[i, j]
            for k in range(j):
                s -= low[i, k] * low[j, k]
            if i == j:
                if s <= 1e-9 * matrix[i, i] or s <= 0.0:
                    return False
                low[i, i] = math.sqrt(s)
            else:
                low[i, j] = s / low[j, j]
    for c in range(rhs.shape[1]):
        for i in range(n):
            s = rhs[i, c]
            for k in range(i):
                s -= low[i, k] * rhs[k, c]
            rhs[i, c] = s / low[i, i]
        for i in range(n - 1, -1, -1):
            s = rhs[i, c]
            for k in range(i + 1, n):
                s -= low[k, i] * rhs[k, c]
            rhs[i, c] = s / low[i, i]
    return True


@nb.njit(cache=True, fastmath=True)
def covariance(jac, r, w, inverse, sigma):  # type: ignore[no-untyped-def]
    """Standard uncertainty of each parameter: the variance of sum t r, t = H^-1 J w.

    It is F sum t^2 r^2 / (1 - F leverage)^2. The sum takes noise and mismatch where they are, the leverage is what the
    fit has swallowed of each residual (HC3 of MacKinnon & White 1985), and F is the sum of the autocorrelations of r
    times those of t up to LAG px: neighbouring residuals are not independent, and each swallows F times as much.
    """
    m = r.shape[0]
    n = m - 2 * RIM
    total = 0.0
    for j in range(RIM, m - RIM):
        for i in range(RIM, m - RIM):
            total += w[j, i]
    t = np.empty((6, n, n), np.float32)
    res = np.empty((n, n), np.float32)
    leverage = np.empty((n, n), np.float32)
    square = swallowed = weights = 0.0
    own = np.zeros(2)
    for j in range(n):
        for i in range(n):
            wi = w[j + RIM, i + RIM]
            lever = 2.0 * wi / total  # of the mean and the gain
            for k in range(6):
                z = np.float32(0)
                for q in range(6):
                    z += np.float32(inverse[k, q]) * jac[j + RIM, i + RIM, q]
                t[k, j, i] = z * wi
                lever += t[k, j, i] * jac[j + RIM, i + RIM, k]
            leverage[j, i] = lever
            res[j, i] = r[j + RIM, i + RIM] * wi
            square += res[j, i] ** 2
            swallowed += lever * wi * wi
            weights += wi * wi
            own[0] += t[0, j, i] ** 2
            own[1] += t[1, j, i] ** 2
    swallowed /= weights
    factor = np.ones(2)
    same = np.ones(2)
    for dj in range(LAG + 1):
        for di in range(-LAG if dj else 1, LAG + 1):
            lo, hi = max(0, -di), min(n, n - di)
            rho = r0 = r1 = 0.0
            for j in range(n - dj):
                s, s0, s1 = np.float32(0), np.float32(0), np.float32(0)
                for i in range(lo, hi):
                    s += res[j, i] * res[j + dj, i + di]
                    s0 += t[0, j, i] * t[0, j + dj, i + di]
                    s1 += t[1, j, i] * t[1, j + dj, i + di]
                rho += float(s)
                r0 += float(s0)
                r1 += float(s1)
            rho /= square if square > 0.0 else 1.0
            r0 /= own[0]
            r1 /= own[1]
            factor[0] += 2.0 * rho * r0
            factor[1] += 2.0 * rho * r1
            same[0] += 2.0 * r0 * r0
            same[1] += 2.0 * r1 * r1
    for c in range(2):
        # the fit has also taken its share, shaped like t, out of the autocorrelation of r: put it back
        raw = max(factor[c], 0.2)
        for _ in range(3):
            lost = min(factor[c] * swallowed, 0.5)
            factor[c] = raw * (1.0 - lost) + lost * same[c]
    for k in range(6):
        f = factor[k if k < 2 else (k - 2) // 2]  # gradients share the factor of their component
        var = 0.0
        for j in range(n):
            for i in range(n):
                var += t[k, j, i] ** 2 * r[j + RIM, i + RIM] ** 2 / max(1.0 - f * leverage[j, i], 0.2) ** 2
        sigma[k] = math.sqrt(f * var)
