"""Affine matching of image windows by Gauss-Newton, symmetric in the two frames, with its covariance.

A window centred at X is read from both spline-interpolated frames at half the displacement each,

    a(xi) = A(X + xi - D(xi) / 2),    b(xi) = B(X + xi + D(xi) / 2),    D = d + G xi + xi K xi / 2,

both brought to zero mean and unit variance, and the six numbers d, G minimise the weighted squares of r = a - b. The
curvature K is given: a window cannot measure it well, its neighbours can, and without it d is wrong by about half
the Laplacian times the square of the window's radius.
Reading both frames half-way puts the vector at mid-time and makes the noise of the gradient of (a + b) / 2
independent of r, so that noise does not bias d.

Uncertainty: to first order the error of the parameters is H^-1 sum w J r over the noise part of r. Its variance is
taken from the residuals themselves, with the correlation between neighbouring ones (as the correlation statistics of
Wieneke 2015, doi:10.1088/0957-0233/26/7/074002, do for a pure shift), so it holds the noise of both frames, the
smoothing by the interpolation and any mismatch that changes within LAG pixels. H comes from the products
grad a grad b: the noise of the two frames does not inflate it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba as nb
import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy import ndimage

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]

SMOOTH = 0.8  # px, standard deviation of the Gaussian both frames are smoothed with, against aliasing
LAG = 3  # px, how far residuals may be correlated in the covariance
ITERATIONS = 12
TAPER = 0.45  # Gaussian weight: standard deviation over half the window
RIM = 2  # px around the window for the gradient stencil
GUARD = 2  # px next to a masked pixel that the gradient stencil and the spline reach

CONVERGED, LOST, FLAT, COVERED = range(4)


class Frame(NamedTuple):
    """A frame ready for matching."""

    c: Float32  # cubic B-spline coefficients on a grid of half pixels: pixel q lies at index 2 q + 1 / 2
    weight: Float32  # 0 or 1 for each pixel
    pad: int  # px of border around the image, in both arrays


def prepare(image: Array, usable: NDArray[np.bool_], pad: int) -> Frame:
    """Spline of an image (H, W) [grey], smoothed by SMOOTH, and weights that stay GUARD px away from unusable pixels.

    The image is carried to half pixels by its cosine series: a cubic spline between those follows grains of 3 px to
    0.002 px, on the pixels themselves only to 0.02 px.
    """
    whole = [scipy.fft.next_fast_len(n + 2 * pad, real=True) for n in image.shape]
    border = [(pad, m - n - pad) for n, m in zip(image.shape, whole)]
    series = scipy.fft.dctn(np.pad(image, border, mode="symmetric").astype(np.float32), workers=-1)
    for axis, m in enumerate(whole):
        k = np.pi * np.arange(m) / m  # [rad/px]; the spline on half pixels has the samples (4 + 2 cos(k / 2)) / 6
        gain = 2 * np.exp(-0.5 * (SMOOTH * k) ** 2) * 6 / (4 + 2 * np.cos(k / 2))
        series *= gain.astype(np.float32).reshape((-1, 1) if axis == 0 else (1, -1))
    c = np.ascontiguousarray(scipy.fft.idctn(np.pad(series, [(0, m) for m in whole]), workers=-1))
    keep = usable if usable.all() else ndimage.binary_erosion(usable, iterations=GUARD, border_value=1)
    return Frame(c, np.ascontiguousarray(np.pad(keep, border), np.float32), pad)


def taper(window: int) -> Float32:
    """Weight over the window, shape (2 h + 1, 2 h + 1), h = window // 2."""
    h = window // 2
    g = np.exp(-0.5 * (np.arange(-h, h + 1) / (TAPER * (h + 0.5))) ** 2)
    return np.outer(g, g).astype(np.float32)


def refine(
    a: Frame, b: Frame, x: Array, y: Array, seed: Array, weight: Float32, texture: float, tolerance: float, errors: bool
) -> tuple[Array, Array, Array, NDArray[np.int64]]:
    """Match windows at (x, y) (n,) [px], starting from seed (n, 12), until a step changes no place by `tolerance` [px].

    seed: d_x, d_y [px], u_x, u_y, v_x, v_y [1], and the given curvature u_xx, u_xy, u_yy, v_xx, v_xy, v_yy [1/px].
    Returns parameters (n, 12), standard uncertainties of the first six (n, 6; NaN without `errors`), correlation (n,)
    and state (n,): CONVERGED, LOST, FLAT = standard deviation in the window below `texture` [grey], COVERED = less
    than half the weight is usable.
    """
    n = len(x)
    p, sigma, quality = seed.astype(np.float64), np.full((n, 6), np.nan), np.full(n, np.nan)
    state = np.empty(n, np.int64)
    places = x + a.pad, y + a.pad
    _refine(a.c, a.weight, b.c, b.weight, *places, weight, texture, tolerance, errors, p, sigma, quality, state)
    return p, sigma, quality, state


@nb.njit(cache=True, fastmath=True)
def _sample(c, weight, x, y, p, sign, out, w, first):  # type: ignore[no-untyped-def]
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
def _standardise(f, w):  # type: ignore[no-untyped-def]
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
def _normal_equations(mean, r, w, jac, hess, clean, rhs):  # type: ignore[no-untyped-def]
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
def _solve(matrix, rhs):  # type: ignore[no-untyped-def]
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
def _covariance(jac, r, w, inverse, sigma):  # type: ignore[no-untyped-def]
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


@nb.njit(cache=True, parallel=True, fastmath=True)
def _refine(ca, wa, cb, wb, x, y, weight, texture, tolerance, errors, p, sigma, quality, state):  # type: ignore[no-untyped-def]
    n = weight.shape[0]
    m = n + 2 * RIM
    full = weight.sum()
    for k in nb.prange(len(x)):
        a = np.empty((m, m), np.float32)
        b = np.empty((m, m), np.float32)
        w = np.empty((m, m), np.float32)
        jac = np.empty((m, m, 6), np.float32)
        hess, clean = np.empty((6, 6)), np.empty((6, 6))
        rhs = np.empty(6)
        step = np.empty((6, 1))
        seed_x, seed_y = p[k, 0], p[k, 1]
        state[k] = LOST
        for _ in range(ITERATIONS):
            _sample(ca, wa, x[k], y[k], p[k], -0.5, a, w, True)
            _sample(cb, wb, x[k], y[k], p[k], 0.5, b, w, False)
            usable = 0.0
            for j in range(n):
                for i in range(n):
                    w[j + RIM, i + RIM] *= weight[j, i]
                    usable += w[j + RIM, i + RIM]
            if usable < 0.5 * full:
                state[k] = COVERED
                break
            if min(_standardise(a, w), _standardise(b, w)) < texture:
                state[k] = FLAT
                break
            for j in range(m):
                for i in range(m):
                    f, g = a[j, i], b[j, i]
                    a[j, i] = np.float32(0.5) * (f + g)
                    b[j, i] = f - g
            total = _normal_equations(a, b, w, jac, hess, clean, rhs)
            step[:, 0] = rhs
            if not _solve(hess, step):
                state[k] = FLAT
                break
            for q in range(6):
                p[k, q] += step[q, 0]
            if abs(p[k, 0] - seed_x) > 0.25 * n or abs(p[k, 1] - seed_y) > 0.25 * n:
                break
            edge = 0.25 * n
            worst = max(
                abs(step[0, 0]) + edge * (abs(step[2, 0]) + abs(step[3, 0])),
                abs(step[1, 0]) + edge * (abs(step[4, 0]) + abs(step[5, 0])),
            )
            if worst < tolerance:
                square = 0.0
                for j in range(RIM, m - RIM):
                    for i in range(RIM, m - RIM):
                        square += w[j, i] * b[j, i] ** 2
                quality[k] = 1.0 - 0.5 * square / total
                inverse = np.eye(6)
                if not _solve(clean, inverse):  # so noisy that the texture cannot be told from it
                    break
                if errors:
                    _covariance(jac, b, w, inverse, sigma[k])
                state[k] = CONVERGED
                break
