"""Sums over the pixels of one frame that the disc fit is made of: normal equations, noise by class, rim by sector.

The model and its parameters are in `disc`. Compiled; every pixel in use is visited once for each step of the fit.
"""

from __future__ import annotations

import math

from numba import njit

SECTORS = 16
KEEP, DROP = 3.5, 7.0  # residual in standard deviations: full weight up to KEEP, none from DROP on
EDGE = 0.02  # pixels with E in (EDGE, 1 - EDGE) are the edge
REACH = 4.5  # blurs from the edge: beyond it a pixel is all ball or all background (3e-6 of the contrast)
SQRT2 = math.sqrt(2.0)
ROOT_2PI = math.sqrt(2.0 * math.pi)
TAN_22 = math.tan(math.pi / 8.0)
FAST = {"contract", "reassoc", "arcp", "nsz"}  # not "nnan": a pixel without data is NaN


@njit(cache=True, fastmath=FAST, error_model="numpy")
def accumulate(img, p, n_par, zone, noise, soft, last, slopes, h, g, classes, sectors):  # type: ignore[no-untyped-def]
    """Normal equations h, g of the weighted residuals; returns (sum of capped u^2, pixels).

    zone: x, y, R, wx, wy, inner depth, outer margin of the pixels in use. soft: factor on the variance in the robust
    weight. last: fill classes (3, 6) for background, ball, edge: sums of w r^2, w (1 - E),
    w E, 4 w E (1 - E), pixels, dropped pixels; and sectors (4, 16): residual and model along E - 1/2, then along dI/dR.
    slopes: (14, pixels at least) working space: dI/dp of the pixels in use, root weight, residual.
    """
    x, y, rad, s = p[0], p[1], p[2], p[3]
    wx, wy = (p[10], p[11]) if n_par == 12 else (0.0, 0.0)
    length = math.sqrt(wx * wx + wy * wy)
    n_t = max(3, math.ceil(length / (0.7 * s))) if n_par == 12 else 1
    mean, per_rad, per_s = 1.0 / n_t, 1.0 / rad, 1.0 / s
    hx, hy = 0.5 * zone[3], 0.5 * zone[4]
    zl2 = 4.0 * (hx * hx + hy * hy)
    r_out2 = (zone[2] + zone[6]) ** 2
    r_in2 = max(zone[2] - zone[5], 0.0) ** 2
    kurt = 1.0 / (2880.0 * s**4)
    far_out = rad + REACH * s
    far_in = max(0.0, rad - REACH * s)
    y_lo = max(0, math.floor(zone[1] - abs(hy) - zone[2] - zone[6]))
    y_hi = min(img.shape[0] - 1, math.ceil(zone[1] + abs(hy) + zone[2] + zone[6]))
    x_lo = max(0, math.floor(zone[0] - abs(hx) - zone[2] - zone[6]))
    x_hi = min(img.shape[1] - 1, math.ceil(zone[0] + abs(hx) + zone[2] + zone[6]))
    total = 0.0
    count = 0
    kept = 0
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
            if near2 > r_out2 or far2 < r_in2:
                continue
            value = img[iy, ix]
            if not math.isfinite(value):
                continue
            ux, uy = (ix - x) * per_rad, (iy - y) * per_rad
            out = p[4] + p[6] * ux + p[7] * uy
            e_mean = ball = 0.0
            jx = jy = jr = js = jgx = jgy = jwx = jwy = 0.0
            for k in range(n_t):
                t = (k + 0.5) * mean - 0.5
                dx, dy = ix - x - t * wx, iy - y - t * wy
                r = math.sqrt(dx * dx + dy * dy)
                if r > far_out:
                    continue
                inside = p[5] + (p[8] * dx + p[9] * dy) * per_rad
                if r < far_in:
                    e = 1.0
                else:
                    r = max(r, 0.5)
                    per_r = 1.0 / r
                    bend = s * per_r
                    z = (rad - r) * per_s - 0.5 * bend
                    bell = math.exp(-0.5 * z * z)
                    phi = bell / ROOT_2PI
                    square = dx * dy * per_r * per_r
                    e = _normal(z, bell) + kurt * (1.0 - 2.0 * square * square) * (z * z - 3.0) * z * phi
                    step = (inside - out) * phi * per_s
                    radial = step * (1.0 - 0.5 * bend * bend) * per_r
                    jx += radial * dx
                    jy += radial * dy
                    jr += step
                    js -= step * (z + bend)
                    jwx += t * radial * dx
                    jwy += t * radial * dy
                e_mean += e
                ball += inside * e
                jgx += e * dx
                jgy += e * dy
            e_mean *= mean
            res = value - (out * (1.0 - e_mean) + ball * mean)
            e_in = min(1.0, max(0.0, e_mean))
            var = noise[0] * (1.0 - e_in) + noise[1] * e_in + 4.0 * noise[2] * e_in * (1.0 - e_in)
            u2 = res * res / var
            total += min(u2, DROP * DROP)
            count += 1
            w = 1.0
            if u2 > KEEP * KEEP * soft:
                w = max(0.0, (DROP - math.sqrt(u2 / soft)) / (DROP - KEEP))
            if last:
                _inspect(ix - x, iy - y, res, w, var, e_in, jr * mean, classes, sectors)
            if w == 0.0:
                continue
            slopes[0, kept], slopes[1, kept], slopes[2, kept] = jx * mean, jy * mean, jr * mean
            slopes[3, kept] = js * mean
            slopes[4, kept], slopes[5, kept] = 1.0 - e_mean, e_mean
            slopes[6, kept], slopes[7, kept] = (1.0 - e_mean) * ux, (1.0 - e_mean) * uy
            slopes[8, kept], slopes[9, kept] = jgx * mean * per_rad, jgy * mean * per_rad
            slopes[10, kept], slopes[11, kept] = jwx * mean, jwy * mean
            slopes[12, kept], slopes[13, kept] = math.sqrt(w / var), res
            kept += 1
    for m in range(n_par):
        for k in range(kept):
            slopes[m, k] *= slopes[12, k]
    for k in range(kept):
        slopes[13, k] *= slopes[12, k]
    for m in range(n_par):
        g[m] = _dot(slopes[m], slopes[13], kept)
        for n in range(m + 1):
            h[m, n] = h[n, m] = _dot(slopes[m], slopes[n], kept)
    return total, count


@njit(cache=True, fastmath=FAST)
def _dot(a, b, n):  # type: ignore[no-untyped-def]
    total = 0.0
    for k in range(n):
        total += a[k] * b[k]
    return total


@njit(cache=True, inline="always")
def _normal(z, bell):  # type: ignore[no-untyped-def]
    """Normal distribution function from bell = exp(-z^2/2); Abramowitz and Stegun 7.1.26, error < 1e-7."""
    t = 1.0 / (1.0 + 0.3275911 * abs(z) / SQRT2)
    tail = t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))))
    tail *= 0.5 * bell
    return tail if z < 0.0 else 1.0 - tail


@njit(cache=True, fastmath=FAST, error_model="numpy")
def _inspect(dx, dy, res, w, var, e_in, slope, classes, sectors):  # type: ignore[no-untyped-def]
    """Adds one pixel to the sums that the fit is judged by."""
    c = 0 if e_in < EDGE else (1 if e_in > 1.0 - EDGE else 2)
    classes[c, 0] += w * res * res
    classes[c, 1] += w * (1.0 - e_in)
    classes[c, 2] += w * e_in
    classes[c, 3] += w * 4.0 * e_in * (1.0 - e_in)
    classes[c, 4] += 1.0
    if w == 0.0:
        classes[c, 5] += 1.0
    u, v = abs(dx), abs(dy)
    q = int(v > TAN_22 * u) + int(v > u) + int(TAN_22 * v > u)  # within the quadrant; counted on from the -x axis
    if dx >= 0.0:
        q = 8 + q if dy >= 0.0 else 7 - q
    elif dy >= 0.0:
        q = 15 - q
    template = e_in - 0.5
    sectors[0, q] += res * template
    sectors[1, q] += template * template
    sectors[2, q] += slope * res / var
    sectors[3, q] += slope * slope / var
