"""Image of a disc, and its fit to a crop of one frame: centre, radius, edge blur, levels, shading and motion streak.

Brightness at pixel (X, Y), with E the disc blurred by a Gaussian of width s (optics and pixel) and
u = (X - x, Y - y)/R:

    I = (b + bx ux + by uy) (1 - E) + (a + gx ux + gy uy) E,      E averaged along the streak (wx, wy) of the exposure

so that a and b are the levels of ball and background and the gradients belong to lighting. The blurred edge uses
E = Phi((R - r - s^2/(2 r)) / s): s^2/(2 r) is the first-order effect of the edge's curvature (mean of the transverse
part of |r + n|), and the fourth cumulant of the square pixel enters as an Edgeworth term. Weighted least squares,
with the weights rebuilt from the model at each step: noise variance `out (1 - E) + ball E + 4 edge E (1 - E)`, where
`edge` takes up what the edge model leaves, and a redescending weight that drops highlights, dust and neighbours.
Only pixels from R - min(0.4 R, 12 px) to the margin outside are used: the middle of the ball carries no position.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

NAMES = ("x", "y", "R", "s", "b", "a", "bx", "by", "gx", "gy", "wx", "wy")
X, Y, R, S, B, A, BX, BY, GX, GY, WX, WY = range(12)
SECTORS = 16
KEEP, DROP = 3.5, 7.0  # residual in standard deviations: full weight up to KEEP, none from DROP on
EDGE = 0.02  # pixels with E in (EDGE, 1 - EDGE) are the edge
MIN_S = 0.29  # px, the blur of a square pixel alone
ROUGH_END = 0.05  # of sigma: last step of a fit that need not come to rest
MAX_STEPS = 40
SQRT2 = math.sqrt(2.0)
ROOT_2PI = math.sqrt(2.0 * math.pi)


def margin(s: float) -> float:
    """Width of background used outside the disc [px]."""
    return max(4.0, 5.0 * s)


@dataclass(frozen=True)
class DiscFit:
    """Fit to one frame. p: parameters in the order of NAMES, px and grey levels; cov: their covariance for `noise`."""

    p: Array  # (12,)
    cov: Array  # (12, 12)
    noise: Array  # (3,) variance found in this frame: background, ball, excess at the edge [grey^2]
    chi2: float  # of this frame per degree of freedom, against the noise that was given; capped residuals
    sectors: Array  # (16,) contrast of each sector of the rim over the model's; 1 when all is well, NaN where no pixels
    shifts: Array  # (16,) by how much the rim of each sector lies outside the fitted circle [px], to first order
    shift_sigmas: Array  # (16,) their standard uncertainty [px]
    dropped: float  # part of the edge pixels that the robust weight drops
    converged: bool


@njit(cache=True)
def _accumulate(img, p, n_par, zone, noise, soft, last, h, g, classes, sectors):  # type: ignore[no-untyped-def]
    """Normal equations h, g of the weighted residuals; returns (sum of capped u^2, pixels).

    zone: x, y, R, wx, wy, inner depth, outer margin of the pixels in use. soft: factor on the variance in the robust
    weight. last: fill classes (3, 6) for background, ball, edge: sums of w r^2, w (1 - E),
    w E, 4 w E (1 - E), pixels, dropped pixels; and sectors (4, 16): residual and model along E - 1/2, then along dI/dR.
    """
    h[:] = 0.0
    g[:] = 0.0
    classes[:] = 0.0
    sectors[:] = 0.0
    x, y, rad, s = p[0], p[1], p[2], p[3]
    wx, wy = (p[10], p[11]) if n_par == 12 else (0.0, 0.0)
    length = math.sqrt(wx * wx + wy * wy)
    n_t = max(3, math.ceil(length / (0.7 * s))) if n_par == 12 else 1
    hx, hy = 0.5 * zone[3], 0.5 * zone[4]
    zl2 = 4.0 * (hx * hx + hy * hy)
    r_out = zone[2] + zone[6]
    r_in = max(zone[2] - zone[5], 0.0)
    kurt = 1.0 / (2880.0 * s**4)
    reach = 5.5 * s
    y_lo = max(0, math.floor(zone[1] - abs(hy) - r_out))
    y_hi = min(img.shape[0] - 1, math.ceil(zone[1] + abs(hy) + r_out))
    x_lo = max(0, math.floor(zone[0] - abs(hx) - r_out))
    x_hi = min(img.shape[1] - 1, math.ceil(zone[0] + abs(hx) + r_out))
    j = np.zeros(12)
    total = 0.0
    count = 0
    for iy in range(y_lo, y_hi + 1):
        for ix in range(x_lo, x_hi + 1):
            zx, zy = ix - zone[0], iy - zone[1]
            if zl2 > 0.0:  # distance to the nearest and to the farthest point of the streak
                t = max(-0.5, min(0.5, 2.0 * (zx * hx + zy * hy) / zl2))
                near2 = (zx - 2.0 * t * hx) ** 2 + (zy - 2.0 * t * hy) ** 2
                far2 = max((zx - hx) ** 2 + (zy - hy) ** 2, (zx + hx) ** 2 + (zy + hy) ** 2)
            else:
                near2 = zx * zx + zy * zy
                far2 = near2
            if near2 > r_out * r_out or far2 < r_in * r_in:
                continue
            value = img[iy, ix]
            if not math.isfinite(value):
                continue
            out = p[4] + (p[6] * (ix - x) + p[7] * (iy - y)) / rad
            j[:] = 0.0
            e_mean = 0.0
            ball = 0.0
            for k in range(n_t):
                t = (k + 0.5) / n_t - 0.5
                dx, dy = ix - x - t * wx, iy - y - t * wy
                r = math.sqrt(dx * dx + dy * dy)
                if r > rad + reach:
                    continue
                inside = p[5] + (p[8] * dx + p[9] * dy) / rad
                if r < rad - reach:
                    e = 1.0
                else:
                    r = max(r, 0.5)
                    z = (rad - r) / s - 0.5 * s / r
                    phi = math.exp(-0.5 * z * z) / ROOT_2PI
                    square = dx * dy / (r * r)
                    e = 0.5 * math.erfc(-z / SQRT2) + kurt * (1.0 - 2.0 * square * square) * (z * z - 3.0) * z * phi
                    step = (inside - out) * phi / s
                    radial = step * (1.0 - 0.5 * s * s / (r * r)) / r
                    j[0] += radial * dx
                    j[1] += radial * dy
                    j[2] += step
                    j[3] -= step * (z + s / r)
                    j[10] += t * radial * dx
                    j[11] += t * radial * dy
                e_mean += e
                ball += inside * e
                j[8] += e * dx / rad
                j[9] += e * dy / rad
            for m in range(12):
                j[m] /= n_t
            e_mean /= n_t
            j[4] = 1.0 - e_mean
            j[5] = e_mean
            j[6] = (1.0 - e_mean) * (ix - x) / rad
            j[7] = (1.0 - e_mean) * (iy - y) / rad
            res = value - (out * (1.0 - e_mean) + ball / n_t)
            e_in = min(1.0, max(0.0, e_mean))
            var = noise[0] * (1.0 - e_in) + noise[1] * e_in + 4.0 * noise[2] * e_in * (1.0 - e_in)
            u2 = res * res / var
            total += min(u2, DROP * DROP)
            count += 1
            u = math.sqrt(u2 / soft)
            w = 1.0 if u < KEEP else max(0.0, (DROP - u) / (DROP - KEEP))
            if last:
                c = 0 if e_in < EDGE else (1 if e_in > 1.0 - EDGE else 2)
                classes[c, 0] += w * res * res
                classes[c, 1] += w * (1.0 - e_in)
                classes[c, 2] += w * e_in
                classes[c, 3] += w * 4.0 * e_in * (1.0 - e_in)
                classes[c, 4] += 1.0
                if w == 0.0:
                    classes[c, 5] += 1.0
                angle = (math.atan2(iy - y, ix - x) + math.pi) / (2.0 * math.pi)
                q = min(SECTORS - 1, int(angle * SECTORS))
                template = e_in - 0.5
                sectors[0, q] += res * template
                sectors[1, q] += template * template
                sectors[2, q] += j[2] * res / var
                sectors[3, q] += j[2] * j[2] / var
            if w == 0.0:
                continue
            w /= var
            for m in range(n_par):
                wj = w * j[m]
                g[m] += wj * res
                for n in range(m + 1):
                    h[m, n] += wj * j[n]
    for m in range(n_par):
        for n in range(m):
            h[n, m] = h[m, n]
    return total, count


@njit(cache=True)
def _invert(h, n, inverse):  # type: ignore[no-untyped-def]
    """Inverse of the leading n x n block of a positive definite matrix by Cholesky; False if it is not one."""
    low = np.zeros((n, n))
    for i in range(n):
        for k in range(i + 1):
            total = h[i, k]
            for m in range(k):
                total -= low[i, m] * low[k, m]
            if i == k:
                if not total > 1e-12 * h[i, i]:
                    return False
                low[i, i] = math.sqrt(total)
            else:
                low[i, k] = total / low[k, k]
    inv_low = np.zeros((n, n))
    for i in range(n):
        inv_low[i, i] = 1.0 / low[i, i]
        for k in range(i):
            total = 0.0
            for m in range(k, i):
                total -= low[i, m] * inv_low[m, k]
            inv_low[i, k] = total / low[i, i]
    inverse[:] = 0.0
    for i in range(n):
        for k in range(n):
            total = 0.0
            for m in range(max(i, k), n):
                total += inv_low[m, i] * inv_low[m, k]
            inverse[i, k] = total
    return True


@njit(cache=True)
def _fit(img, p, n_par, noise, mean, weight):  # type: ignore[no-untyped-def]
    """Gauss-Newton from p (changed in place) with a prior `mean`, `weight` = 1/variance (0: flat) on each parameter."""
    h, g = np.zeros((12, 12)), np.zeros(12)
    cov = np.zeros((12, 12))
    classes, sectors = np.zeros((3, 6)), np.zeros((4, SECTORS))
    step = np.zeros(12)
    zone = np.zeros(7)
    soft = 1e30
    settled = False
    good = False
    size = np.inf
    for _ in range(MAX_STEPS):
        if not settled:
            zone[0], zone[1], zone[2] = p[0], p[1], p[2]
            if n_par == 12:
                zone[3], zone[4] = p[10], p[11]
            zone[5] = min(0.4 * p[2], 12.0)
            zone[6] = max(4.0, 5.0 * p[3])
        total, count = _accumulate(img, p, n_par, zone, noise, soft, False, h, g, classes, sectors)
        if count <= n_par:
            break
        for m in range(n_par):
            h[m, m] += weight[m]
            g[m] += weight[m] * (mean[m] - p[m])
        if not _invert(h, n_par, cov):
            break
        scale = 1.0
        for m in range(n_par):
            step[m] = 0.0
            for n in range(n_par):
                step[m] += cov[m, n] * g[n]
        # A step within the edge's width keeps the linear model valid
        limit = max(1.5 * p[3], 0.1 * p[2])
        for m in (0, 1, 2):
            scale = min(scale, limit / max(abs(step[m]), 1e-9))
        scale = min(scale, 0.5 * p[3] / max(abs(step[3]), 1e-9))
        for m in range(n_par):
            p[m] += scale * step[m]
        p[3] = max(p[3], MIN_S)
        if not (abs(p[0]) < 1e6 and abs(p[1]) < 1e6 and 1.5 < p[2] < 1e5 and p[3] < 2.0 * p[2]):
            break
        size = max(abs(step[0]), abs(step[1]), abs(step[2]))
        if size < 0.1 and not settled:
            settled = True
            soft = 1.0
        elif settled and size < 3e-5:
            good = True
            break
        elif not settled:  # far from the answer the misfit, not the noise, sets what is an outlier
            soft = max(1.0, total / count)
            if soft < 1.5:
                soft = 1.0
    soft = 1.0
    total, count = _accumulate(img, p, n_par, zone, noise, soft, True, h, g, classes, sectors)
    for m in range(n_par):
        h[m, m] += weight[m]
    if not _invert(h, n_par, cov):
        good = False
    elif settled and not good:  # a pixel that goes in and out of the fit: the rest of the walk is a part of sigma
        good = size < ROUGH_END * np.sqrt(max(cov[0, 0], cov[1, 1]))
    return cov, classes, sectors, total / max(1.0, count - n_par), good


def fit_disc(
    image: Array, start: Array, *, streak: bool, noise: Array, mean: Array | None = None, var: Array | None = None
) -> DiscFit:
    """Fit the disc to `image` (row, column) [grey levels, NaN = no data]; row down, pixel centres at integers.

    start: (12,) in the order of NAMES. noise: (3,) variances of background, ball and edge excess, all used as given.
    mean, var: prior on each parameter (var = inf: none). The streak (wx, wy) is held at 0 unless `streak`.
    """
    p = np.array(start, dtype=np.float64)
    n = 12 if streak else 10
    weight = np.zeros(12) if var is None else 1.0 / np.asarray(var, dtype=np.float64)
    centre = np.zeros(12) if mean is None else np.where(weight > 0, mean, 0.0)
    if not streak:
        p[WX] = p[WY] = 0.0
    cov, classes, sectors, chi2, good = _fit(image, p, n, np.asarray(noise, dtype=np.float64), centre, weight)
    found = np.zeros(3)
    # Degrees of freedom each class spends: level and gradient; centre, radius and blur (and streak)
    spent = (3.0, 3.0, 6.0 if streak else 4.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        square = classes[:, 0] * classes[:, 4] / np.maximum(classes[:, 4] - spent, 1.0)
        found[0], found[1] = square[0] / classes[0, 1], square[1] / classes[1, 2]
        found[2] = (square[2] - found[0] * classes[2, 1] - found[1] * classes[2, 2]) / classes[2, 3]
        contrast = 1.0 + sectors[0] / sectors[1] / (p[A] - p[B])
    with np.errstate(divide="ignore", invalid="ignore"):
        shifts, shift_sigmas = sectors[2] / sectors[3], 1.0 / np.sqrt(sectors[3])
    few = sectors[1] < 0.3 * np.median(sectors[1])  # outside the image, or no data
    contrast[few] = shifts[few] = shift_sigmas[few] = np.nan
    return DiscFit(
        p,
        cov,
        found,
        float(chi2),
        contrast,
        shifts,
        shift_sigmas,
        float(classes[2, 5] / max(classes[2, 4], 1.0)),
        bool(good),
    )
