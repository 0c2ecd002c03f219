"""Two frames read half-way: the spline of each at places moved by half of the displacement, forwards and backwards.

Neighbouring pixels mostly move by the same whole number of knots, so a row is read in runs that share it: their knots
lie side by side in memory and are combined LANES at a time.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from jumpvision.base.arrays import Float32
from jumpvision.base.threads import shared

from .frame import Frame

EDGE = 2  # px at the border of the padded frame that the spline does not reach
LANES = 8  # pixels computed at a time; a run's last ones reach into the next run, which then overwrites them


def half_way(a: Frame, b: Frame, dx: Float32, dy: Float32, top: int) -> tuple[Float32, Float32, Float32]:
    """Mean m and difference r of some rows of two frames brought half-way together, and the weight of their pixels.

    dx, dy: (rows, W) [px] displacement from a to b at every pixel of the padded frame, from its row `top` on; keep is
    0 or 1.
    """
    m, r, keep = (np.empty(dx.shape, np.float32) for _ in range(3))
    frame = (a.pad, a.pad + a.grey.shape[0], a.pad + a.grey.shape[1])
    clear = a.usable.all(), b.usable.all()
    _half_way(len(m), top, a.c, b.c, a.weight, b.weight, *clear, frame, a.fine, dx, dy, m, r, keep)
    return m, r, keep


# "contract" alone, here and wherever threads share a loop: freer rounding differs between a process that compiles
# and one that loads what was compiled
@shared(fastmath={"contract"})
def _half_way(first, last, top, ca, cb, wa, wb, clear_a, clear_b, frame, fine, dx, dy, m, r, keep):  # type: ignore[no-untyped-def]
    cols = m.shape[1]
    half = np.float32(0.5)
    part, grey = np.empty((2, cols + LANES), np.float32), np.empty((2, cols + LANES), np.float32)
    light, knot = np.empty((2, cols), np.float32), np.empty((2, cols), np.int32)
    for j in range(first, last):
        _read(ca, wa, clear_a, frame, fine, dx[j], dy[j], -half, top + j, part, knot, grey[0], light[0])
        _read(cb, wb, clear_b, frame, fine, dx[j], dy[j], half, top + j, part, knot, grey[1], light[1])
        for i in range(cols):
            m[j, i] = half * (grey[0, i] + grey[1, i])
            r[j, i] = grey[0, i] - grey[1, i]
            keep[j, i] = light[0, i] * light[1, i]


@nb.njit(cache=True, fastmath={"contract"})
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


@nb.njit(cache=True, fastmath={"contract"}, inline="always")
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
