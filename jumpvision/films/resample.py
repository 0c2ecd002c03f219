"""Pictures read between their pixels by the cubic B-spline through them.

OpenCV's INTER_CUBIC (a = -0.75) moves what it reads, by 0.048 px at a fifth of a pixel, and rounds places to 1/32 px;
the spline moves nothing (Unser 1999).
Neighbouring pixels mostly move by the same whole number of knots, so a row is read in runs that share it: their knots
lie side by side in memory and are combined LANES at a time.
"""

from __future__ import annotations

import cv2
import numba as nb
import numpy as np

from jumpvision.base.arrays import Float32, Image
from jumpvision.base.threads import shared

EDGE = 2  # px at the border of the padded frame that the spline does not reach
WIDE = 1 << 16  # knots that a row or a column may move by at most, twice
LANES = 16  # pixels computed at a time; a run's last ones reach into the next run, which then overwrites them
# weights of the pixels beside a knot in its coefficient; farther ones count for less than 1e-5
COEFFICIENTS = np.sqrt(3) * (np.sqrt(3) - 2) ** np.abs(np.arange(-9, 10))


def resample(image: Image, columns: Float32, rows: Float32) -> Image:
    """Read a picture (h, w) at columns, rows (m, n) [px]: (m, n) of its type; beyond its border the border's value."""
    beyond = EDGE + LANES // 2  # rows at the bottom: a last run of a narrow picture reads on into them
    wide = cv2.copyMakeBorder(np.asarray(image, np.float32), EDGE, beyond, EDGE, EDGE, cv2.BORDER_REFLECT_101)
    knots = cv2.sepFilter2D(wide, -1, COEFFICIENTS, COEFFICIENTS, borderType=cv2.BORDER_REFLECT_101)
    out = np.empty(columns.shape, image.dtype)
    white = np.iinfo(out.dtype).max if out.dtype.kind == "u" else np.inf
    _read(len(out), knots[None, : len(image) + 2 * EDGE + 1], columns, rows, np.float32(white), out)
    return out


@shared(fastmath={"contract"})
def _read(first, last, c, columns, rows, white, out):  # type: ignore[no-untyped-def]
    n = columns.shape[1]
    part, grey, knot = np.empty((2, n + LANES), np.float32), np.empty(n + LANES, np.float32), np.empty(n, np.int32)
    moved, keep, no_weight = np.empty((2, n), np.float32), np.empty(n, np.float32), np.empty((0, 0), np.uint8)
    for j in range(first, last):
        for i in range(n):
            moved[0, i], moved[1, i] = columns[j, i] - np.float32(i - EDGE), rows[j, i] - np.float32(j - EDGE)
        read_row(c, no_weight, True, (0, 0, 0), moved[0], moved[1], np.float32(1), j, part, knot, grey, keep)
        if white < np.inf:
            for i in range(n):
                out[j, i] = np.rint(min(max(grey[i], np.float32(0)), white))
        else:
            out[j] = grey[:n]


@nb.njit(cache=True, fastmath={"contract"})
def read_row(c, weight, clear, frame, dx, dy, sign, j, part, knot, out, keep):  # type: ignore[no-untyped-def]
    """Read row j of the spline c at (x, y) + sign (dx, dy), and its weight.

    c: (1, rows, columns) knots every pixel; (2, 2 rows, columns) every half pixel, those of even columns and of odd.
    clear: the weight is 1 in the whole frame, which ends at pad, bottom and right of the padded one.
    """
    scale, width, cols = len(c), c.shape[2], len(dx)
    flat = c.reshape(scale, -1)
    bottom_knot, right_knot = c.shape[1] // scale - 2 - EDGE, c.shape[2] - 1 - EDGE
    shift, half = np.float32(0.5 * (scale - 1)), np.float32(0.5)
    pad, bottom, right = np.float32(frame[0]), np.float32(frame[1]), np.float32(frame[2])
    # the last row is left out, as the last run reads beyond its end
    low, high = np.float32(EDGE - j), np.float32(bottom_knot - j)
    for i in range(cols):
        x, y = sign * dx[i], sign * dy[i]
        qx = min(max(x, np.float32(EDGE - i)), np.float32(right_knot - i))
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
        even, odd = flat[x % scale], flat[(x + 1) % scale]
        corner = (y - 1) * width
        _run(even, corner + x // scale, odd, corner + (x + 1) // scale, width, 3 - scale, n, first, part, out)
        first = end


@nb.njit(cache=True, fastmath={"contract"})
def _run(even, p, odd, q, width, apart, n, first, part, out):  # type: ignore[no-untyped-def]
    """Sum the cubic B-spline of n pixels from the first on, at the parts of a knot's distance.

    p, q: places of the first's knots in the planes of rows of some width.
    """
    six, two3, half, one = np.float32(1 / 6), np.float32(2 / 3), np.float32(0.5), np.float32(1)
    w, far = np.uintp(width), np.uintp(apart)
    p, q, first = np.uintp(p), np.uintp(q), np.uintp(first)  # signed they would be tested for places before the first
    for i in range(np.uintp(n)):
        a, b = part[0, first + i], part[1, first + i]
        a1, b1 = one - a, one - b
        x0, x3 = a1 * a1 * a1 * six, a * a * a * six
        x1, x2 = two3 - half * a * a * (a1 + one), two3 - half * a1 * a1 * (a + one)
        y0, y3 = b1 * b1 * b1 * six, b * b * b * six
        y1, y2 = two3 - half * b * b * (b1 + one), two3 - half * b1 * b1 * (b + one)
        g, h = p + i, q + i
        r0 = x0 * even[g] + x1 * odd[h] + x2 * even[g + far] + x3 * odd[h + far]
        g, h = g + w, h + w
        r1 = x0 * even[g] + x1 * odd[h] + x2 * even[g + far] + x3 * odd[h + far]
        g, h = g + w, h + w
        r2 = x0 * even[g] + x1 * odd[h] + x2 * even[g + far] + x3 * odd[h + far]
        g, h = g + w, h + w
        r3 = x0 * even[g] + x1 * odd[h] + x2 * even[g + far] + x3 * odd[h + far]
        out[first + i] = y0 * r0 + y1 * r1 + y2 * r2 + y3 * r3
