"""Sums over the pixels of one frame that the disc fit is made of: normal equations, noise by class, rim by sector.

The model and its parameters are in `disc`. Compiled; the pixels go through in blocks that stay in the fastest cache,
every loop over a block free of branches, so that the processor takes several pixels at a time. (One flat working array
of rows at constant distances: only so does the compiler know that the rows do not overlap.) No `fastmath`, for the
reason in `base.compiling`; the sums of products stand as four side by side instead.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit, uint64

from .unknowns import BX, BY, GX, GY, WX, WY, A, B, R, S, X, Y

SECTORS = 16
# Sums over a class of pixels, and along the rim of a sector
SQUARES, OF_BACK, OF_BALL, OF_EDGE, PIXELS, DROPPED = range(6)
RESIDUAL_STEP, STEP_SQUARED, RESIDUAL_SLOPE, SLOPE_SQUARED = range(4)
KEEP, DROP = 3.5, 7.0  # residual in standard deviations: full weight up to KEEP, none from DROP on
EDGE = 0.02  # pixels with E in (EDGE, 1 - EDGE) are the edge
REACH = 4.5  # blurs from the edge: beyond it a pixel is all ball or all background (3e-6 of the contrast)
BLOCK = 128  # pixels
# Rows of the working space, BLOCK pixels each: dI/dp in the order of the parameters, residual, the ball's part of I,
# weight, its root over the deviation, variance, column, row, grey value
JX, JY, JR, JS, JB, E, JBX, JBY, JGX, JGY, JWX, JWY, RES, BALL, W, ROOT, VAR, PX, PY, VALUE = (
    BLOCK * i for i in range(20)
)
ROOM = 20 * BLOCK
SQRT2 = math.sqrt(2.0)
ROOT_2PI = math.sqrt(2.0 * math.pi)
TAN_22 = math.tan(math.pi / 8.0)
ONE, TWO, THREE = np.uint64(1), np.uint64(2), np.uint64(3)


class Zone(NamedTuple):
    """Pixels that are fitted: about a disc of that centre, radius and streak (wx, wy), from so far inside its rim to so
    far outside [px]."""

    x: float
    y: float
    radius: float
    wx: float
    wy: float
    inside: float
    outside: float


@njit(cache=True)
def pixels_in_use(img, zone, every):  # type: ignore[no-untyped-def]
    """Column, row and value (3, n) of the pixels in the zone that hold data; of each `every`-th row only."""
    hx, hy = 0.5 * zone.wx, 0.5 * zone.wy
    zl2 = 4.0 * (hx * hx + hy * hy)
    r_out, r_in = zone.radius + zone.outside, max(zone.radius - zone.inside, 0.0)
    r_out2, r_in2 = r_out * r_out, r_in * r_in
    y_lo = max(0, math.floor(zone.y - abs(hy) - r_out))
    y_hi = min(img.shape[0] - 1, math.ceil(zone.y + abs(hy) + r_out))
    x_lo = max(0, math.floor(zone.x - abs(hx) - r_out))
    x_hi = min(img.shape[1] - 1, math.ceil(zone.x + abs(hx) + r_out))
    # No more than the unit squares about pixels within have room for
    most = math.pi * (r_out + 1.0) ** 2 + 2.0 * (r_out + 1.0) * math.sqrt(zl2)
    if zl2 == 0.0:
        most -= math.pi * max(r_in - 1.0, 0.0) ** 2
    pixels = np.empty((3, int(min(most, img.size)) + 1))
    count = 0
    for iy in range(y_lo, y_hi + 1, every):
        for ix in range(x_lo, x_hi + 1):
            zx, zy = ix - zone.x, iy - zone.y
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
            if math.isfinite(value):
                pixels[0, count], pixels[1, count], pixels[2, count] = ix, iy, value
                count += 1
    return pixels[:, :count]


@njit(cache=True)
def accumulate(pixels, p, n_par, noise, soft, last, work, h, g, classes, sectors):  # type: ignore[no-untyped-def]
    """Normal equations h, g of the weighted residuals of `pixels`; returns the sum of capped u^2.

    soft: factor on the variance in the robust weight. last: fill classes (3, 6) for background, ball, edge: sums of
    w r^2, w (1 - E), w E, 4 w E (1 - E), pixels, dropped pixels; and sectors (4, 16): residual and model along
    E - 1/2, then along dI/dR. work: (ROOM,).
    """
    s = p[S]
    wx, wy = (p[WX], p[WY]) if n_par == 12 else (0.0, 0.0)
    n_t = max(3, math.ceil(math.sqrt(wx * wx + wy * wy) / (0.7 * s))) if n_par == 12 else 1
    h[:] = 0.0
    g[:] = 0.0
    total, count = 0.0, pixels.shape[1]
    for first in range(0, count, BLOCK):
        n = min(BLOCK, count - first)
        for k in range(n):
            work[PX + k], work[PY + k] = pixels[0, first + k], pixels[1, first + k]
            work[VALUE + k] = pixels[2, first + k]
        work[:W] = 0.0
        for i in range(n_t):
            t = (i + 0.5) / n_t - 0.5
            _instant(work, n, p, t, t * wx, t * wy, 1.0 / n_t)
        total += _weigh(work, n, p, noise, soft)
        if last:
            _inspect(work, n, p, classes, sectors)
        _products(work, n, n_par, h, g)
    for m in range(n_par):
        for k in range(m):
            h[m, k] = h[k, m]
    return total


@njit(cache=True, error_model="numpy")
def _instant(work, n, p, t, tx, ty, share):  # type: ignore[no-untyped-def]
    """Adds what the disc contributes at one instant of the exposure, (tx, ty) beside its middle."""
    x, y, rad, s, b, a, bx, by, gx, gy = p[X], p[Y], p[R], p[S], p[B], p[A], p[BX], p[BY], p[GX], p[GY]
    per_rad, per_s = 1.0 / rad, 1.0 / s
    kurt = 1.0 / (2880.0 * s**4)
    far_out, far_in = rad + REACH * s, rad - REACH * s
    for k in range(n):
        ox, oy = work[PX + k] - x, work[PY + k] - y
        dx, dy = ox - tx, oy - ty
        out = b + (bx * ox + by * oy) * per_rad
        inside = a + (gx * dx + gy * dy) * per_rad
        r = max(math.sqrt(dx * dx + dy * dy), 0.5)
        per_r = 1.0 / r
        bend = s * per_r
        z = (rad - r) * per_s - 0.5 * bend
        bell = _bell(z)
        phi = bell / ROOT_2PI
        square = dx * dy * per_r * per_r
        e = _normal(z, bell) + kurt * (1.0 - 2.0 * square * square) * (z * z - 3.0) * z * phi
        step = share * (inside - out) * phi * per_s
        e = 1.0 if r < far_in else (0.0 if r > far_out else e)
        step = 0.0 if r < far_in or r > far_out else step
        radial = step * (1.0 - 0.5 * bend * bend) * per_r
        e *= share
        work[JX + k] += radial * dx
        work[JY + k] += radial * dy
        work[JR + k] += step
        work[JS + k] -= step * (z + bend)
        work[E + k] += e
        work[BALL + k] += inside * e
        work[JGX + k] += e * dx * per_rad
        work[JGY + k] += e * dy * per_rad
        work[JWX + k] += t * radial * dx
        work[JWY + k] += t * radial * dy


@njit(cache=True, error_model="numpy")
def _weigh(work, n, p, noise, soft):  # type: ignore[no-untyped-def]
    """Residual, variance and robust weight of each pixel, and the slopes along the background; sum of capped u^2."""
    x, y, per_rad = p[X], p[Y], 1.0 / p[R]
    b, bx, by = p[B], p[BX], p[BY]
    n0, n1, n2, per_soft = noise[0], noise[1], noise[2], 1.0 / soft
    total = 0.0
    for k in range(n):
        ux, uy = (work[PX + k] - x) * per_rad, (work[PY + k] - y) * per_rad
        e = work[E + k]
        back = 1.0 - e
        work[JB + k], work[JBX + k], work[JBY + k] = back, back * ux, back * uy
        res = work[VALUE + k] - (b + bx * ux + by * uy) * back - work[BALL + k]
        e_in = min(1.0, max(0.0, e))
        var = n0 * (1.0 - e_in) + n1 * e_in + 4.0 * n2 * e_in * (1.0 - e_in)
        u2 = res * res / var
        total += min(u2, DROP * DROP)
        w = min(1.0, max(0.0, (DROP - math.sqrt(u2 * per_soft)) / (DROP - KEEP)))
        work[RES + k], work[W + k], work[ROOT + k], work[VAR + k] = res, w, math.sqrt(w / var), var
    return total


@njit(cache=True)
def _products(work, n, n_par, h, g):  # type: ignore[no-untyped-def]
    """Adds the weighted products of the slopes (upper half of h) and with the residuals."""
    for m in range(0, BALL, BLOCK):
        for k in range(n):
            work[m + k] *= work[ROOT + k]
    for m in range(n_par):
        row = work[m * BLOCK : m * BLOCK + n]
        g[m] += _dot(row, work[RES:], n)
        for c in range(m, n_par, 3):  # three at a time; the products with rows past the last are not used
            p0, p1, p2 = _dots(row, work[c * BLOCK :], n)
            h[m, c] += p0
            h[m, c + 1] += p1
            h[m, c + 2] += p2


@njit(cache=True)
def _dot(a, b, n):  # type: ignore[no-untyped-def]
    """Four sums side by side, as the processor takes them; an unsigned index is not looked at for being negative."""
    s0 = s1 = s2 = s3 = 0.0
    for j in range(n // 4):
        k = uint64(4 * j)
        s0 += a[k] * b[k]
        s1 += a[k + ONE] * b[k + ONE]
        s2 += a[k + TWO] * b[k + TWO]
        s3 += a[k + THREE] * b[k + THREE]
    for i in range(n - n % 4, n):
        s0 += a[i] * b[i]
    return (s0 + s1) + (s2 + s3)


@njit(cache=True)
def _dots(a, rows, n):  # type: ignore[no-untyped-def]
    """`_dot` of a with three rows, in one pass."""
    p, q, r = rows, rows[BLOCK:], rows[2 * BLOCK :]
    p0 = p1 = p2 = p3 = q0 = q1 = q2 = q3 = r0 = r1 = r2 = r3 = 0.0
    for j in range(n // 4):
        k = uint64(4 * j)
        a0, a1, a2, a3 = a[k], a[k + ONE], a[k + TWO], a[k + THREE]
        p0, p1, p2, p3 = p0 + a0 * p[k], p1 + a1 * p[k + ONE], p2 + a2 * p[k + TWO], p3 + a3 * p[k + THREE]
        q0, q1, q2, q3 = q0 + a0 * q[k], q1 + a1 * q[k + ONE], q2 + a2 * q[k + TWO], q3 + a3 * q[k + THREE]
        r0, r1, r2, r3 = r0 + a0 * r[k], r1 + a1 * r[k + ONE], r2 + a2 * r[k + TWO], r3 + a3 * r[k + THREE]
    for i in range(n - n % 4, n):
        p0, q0, r0 = p0 + a[i] * p[i], q0 + a[i] * q[i], r0 + a[i] * r[i]
    return (p0 + p1) + (p2 + p3), (q0 + q1) + (q2 + q3), (r0 + r1) + (r2 + r3)


@njit(cache=True, inline="always")
def _bell(z):  # type: ignore[no-untyped-def]
    """exp(-z^2/2), to 4e-6 of itself for |z| < 4.6, by products alone: exp(-q) = (exp(-q/32))^32."""
    q = -min(z * z, 40.0) / 64.0
    f = 1.0 + q * (1.0 + q / 2 * (1.0 + q / 3 * (1.0 + q / 4 * (1.0 + q / 5 * (1.0 + q / 6)))))
    f *= f
    f *= f
    f *= f
    f *= f
    return f * f


@njit(cache=True, inline="always")
def _normal(z, bell):  # type: ignore[no-untyped-def]
    """Normal distribution function from bell = exp(-z^2/2); Abramowitz and Stegun 7.1.26, error < 1e-7."""
    t = 1.0 / (1.0 + 0.3275911 * abs(z) / SQRT2)
    tail = t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))))
    tail *= 0.5 * bell
    return tail if z < 0.0 else 1.0 - tail


@njit(cache=True, error_model="numpy")
def _inspect(work, n, p, classes, sectors):  # type: ignore[no-untyped-def]
    """Adds a block of pixels to the sums that the fit is judged by."""
    for k in range(n):
        res, w, var = work[RES + k], work[W + k], work[VAR + k]
        e_in = min(1.0, max(0.0, work[E + k]))
        c = 0 if e_in < EDGE else (1 if e_in > 1.0 - EDGE else 2)
        classes[c, SQUARES] += w * res * res
        classes[c, OF_BACK] += w * (1.0 - e_in)
        classes[c, OF_BALL] += w * e_in
        classes[c, OF_EDGE] += w * 4.0 * e_in * (1.0 - e_in)
        classes[c, PIXELS] += 1.0
        if w == 0.0:
            classes[c, DROPPED] += 1.0
        dx, dy = work[PX + k] - p[X], work[PY + k] - p[Y]
        u, v = abs(dx), abs(dy)
        q = int(v > TAN_22 * u) + int(v > u) + int(TAN_22 * v > u)  # within the quadrant; counted on from the -x axis
        if dx >= 0.0:
            q = 8 + q if dy >= 0.0 else 7 - q
        elif dy >= 0.0:
            q = 15 - q
        template, slope = e_in - 0.5, work[JR + k]
        sectors[RESIDUAL_STEP, q] += res * template
        sectors[STEP_SQUARED, q] += template * template
        sectors[RESIDUAL_SLOPE, q] += slope * res / var
        sectors[SLOPE_SQUARED, q] += slope * slope / var
