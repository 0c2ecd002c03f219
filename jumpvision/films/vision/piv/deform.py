"""Two frames read half-way: the spline of each at places moved by half of the displacement, forwards and backwards."""

from __future__ import annotations

import numpy as np

from jumpvision.base.arrays import Float32
from jumpvision.base.threads import shared
from jumpvision.films.resample import LANES, read_row

from .frame import Frame
from .surface import Drawn, line


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
        read_row(ca, wa, clear_a, frame, dx, dy, -half, top + j, part, knot, grey[0], light[0])
        read_row(cb, wb, clear_b, frame, dx, dy, half, top + j, part, knot, grey[1], light[1])
        for i in range(cols):
            m[j, i] = half * (grey[0, i] + grey[1, i])
            r[j, i] = grey[0, i] - grey[1, i]
            keep[j, i] = light[0, i] * light[1, i] / (one + max(jump[i], zero) * doubt * r[j, i] * r[j, i])
