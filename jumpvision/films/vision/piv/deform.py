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
from .surface import Drawn, line

EDGE = 2  # px at the border of the padded frame that the spline does not reach
WIDE = 1 << 16  # knots that a row or a column may move by at most, twice
LANES = 16  # pixels computed at a time; a run's last ones reach into the next run, which then overwrites them


def half_way(a: Frame, b: Frame, moved: Drawn, top: int, foreign: float) -> tuple[Float32, Float32, Float32]:
    """Mean m and difference r of some rows of two frames brought half-way together, and the weight of their pixels.

    moved: displacement [px] from a to b, in x and in y, of the padded frame's pixels from its row `top` on, and where
    it jumps, j. keep is 0 where either is not usable, else 1 / (1 + j (r / foreign)^2) (Lorentz), foreign [grey]:
    beside a jump larger differences are of its other side.
    """
    m, r, keep = (np.empty((len(moved.knot), moved.lines.shape[2]), np.float32) for _ in range(3))
    frame = (a.pad, a.pad + a.grey.shape[0], a.pad + a.grey.shape[1])
    clear = bool(a.usable.all()), bool(b.usable.all())
    _half_way(len(m), top, a.c, b.c, a.weight, b.weight, *clear, frame, moved, np.float32(foreign**-2), m, r, keep)
    return m, r, keep


# "contract" alone, here and wherever threads share a loop: freer rounding differs between a process that compiles
# and one that loads what was compiled
@shared(fastmath={"contract"})
def _half_way(first, last, top, ca, cb, wa, wb, clear_a, clear_b, frame, moved, doubt, m, r, keep):  # type: ignore[no-untyped-def]
    cols = m.shape[1]
    half, zero, one = np.float32(0.5), np.float32(0), np.float32(1)
    part, grey = np.empty((2, cols + LANES), np.float32), np.empty((2, cols + LANES), np.float32)
    light, knot = np.empty((2, cols), np.float32), np.empty(cols, np.int32)
    dx, dy, jump = np.empty(cols, np.float32), np.empty(cols, np.float32), np.zeros(cols, np.float32)
    jumps = len(moved.lines) > 2
    for j in range(first, last):
        line(moved, np.int64(0), j, dx)  # as literals each would have it compiled once more
        line(moved, np.int64(1), j, dy)
        if jumps:
            line(moved, np.int64(2), j, jump)
        _read(ca, wa, clear_a, frame, dx, dy, -half, top + j, part, knot, grey[0], light[0])
        _read(cb, wb, clear_b, frame, dx, dy, half, top + j, part, knot, grey[1], light[1])
        for i in range(cols):
            m[j, i] = half * (grey[0, i] + grey[1, i])
            r[j, i] = grey[0, i] - grey[1, i]
            keep[j, i] = light[0, i] * light[1, i] / (one + max(jump[i], zero) * doubt * r[j, i] * r[j, i])


@nb.njit(cache=True, fastmath={"contract"})
def _read(c, weight, clear, frame, dx, dy, sign, j, part, knot, out, keep):  # type: ignore[no-untyped-def]
    """Row j of the spline c at (x, y) + sign (dx, dy), and its weight.

    c: (1, rows, columns) knots every pixel; (2, 2 rows, columns) every half pixel, those of even columns and of odd.
    clear: the weight is 1 in the whole frame, which ends at pad, bottom and right of the padded one.
    """
    rows, cols = weight.shape
    scale = len(c)
    shift, half = np.float32(0.5 * (scale - 1)), np.float32(0.5)
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
        knot[i] = np.int32(WIDE) * np.int32(ky) + np.int32(kx)
        part[0, i], part[1, i] = ex - kx, ey - ky
    if not clear:
        for i in range(cols):
            if keep[i] > 0:
                keep[i] = weight[j + int(np.floor(sign * dy[i] + half)), i + int(np.floor(sign * dx[i] + half))]
    first = 0
    while first < cols:
        both = knot[first]
        end = first + 1
        while end < cols and knot[end] == both:
            end += 1
        ky = (both + WIDE // 2) // WIDE
        y, x = scale * j + ky, scale * first + both - WIDE * ky - 1
        n = (end - first + LANES - 1) // LANES * LANES
        # of a row's four knots the first and third, and the second and fourth, lie in one plane, so far apart
        even, odd = c[x % scale], c[(x + 1) % scale]
        p, q = x // scale, (x + 1) // scale
        _run(
            (even[y - 1, p:], even[y, p:], even[y + 1, p:], even[y + 2, p:]),
            (odd[y - 1, q:], odd[y, q:], odd[y + 1, q:], odd[y + 2, q:]),
            3 - scale,
            n,
            part[0, first:],
            part[1, first:],
            out[first:],
        )
        first = end


@nb.njit(cache=True, fastmath={"contract"})
def _run(even, odd, apart, n, t, s, out):  # type: ignore[no-untyped-def]
    """Cubic B-spline at the parts t, s of a knot's distance; even, odd: four rows of knots from the first's on."""
    c0, c1, c2, c3 = even
    d0, d1, d2, d3 = odd
    six, two3, half, one = np.float32(1 / 6), np.float32(2 / 3), np.float32(0.5), np.float32(1)
    for i in range(n):
        k = np.uintp(i) + np.uintp(apart)  # signed it would be tested for places before the first, one by one
        a, b = t[i], s[i]
        a1, b1 = one - a, one - b
        x0, x3 = a1 * a1 * a1 * six, a * a * a * six
        x1, x2 = two3 - half * a * a * (a1 + one), two3 - half * a1 * a1 * (a + one)
        y0, y3 = b1 * b1 * b1 * six, b * b * b * six
        y1, y2 = two3 - half * b * b * (b1 + one), two3 - half * b1 * b1 * (b + one)
        r0 = x0 * c0[i] + x1 * d0[i] + x2 * c0[k] + x3 * d0[k]
        r1 = x0 * c1[i] + x1 * d1[i] + x2 * c1[k] + x3 * d1[k]
        r2 = x0 * c2[i] + x1 * d2[i] + x2 * c2[k] + x3 * d2[k]
        r3 = x0 * c3[i] + x1 * d3[i] + x2 * c3[k] + x3 * d3[k]
        out[i] = y0 * r0 + y1 * r1 + y2 * r2 + y3 * r3
