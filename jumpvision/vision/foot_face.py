"""Where a textured body ends: all frames laid over each other along the body."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Array = NDArray[np.float64]

ABOVE, BELOW = 12, 8  # rows about the expected face that are laid over each other
BLOCK = 16  # columns that share a grain
LEAST, LEAST_BLOCKS = 6, 4  # frames, blocks of columns
SHARP = 2.5  # rows
CONTRAST = 3.0  # change of grey from frame to frame below the face over that above it: less is no end of a body


class Stack:
    """Sum and sum of squares over the frames, on rows that move with the body."""

    def __init__(self) -> None:
        self.n = 0
        self.u = np.arange(-ABOVE, BELOW + 1.0)  # rows below the expected face
        self.sum: Array | float = 0.0
        self.squares: Array | float = 0.0

    def add(self, strip: NDArray[np.generic], face: float) -> None:
        """Lay a frame's columns of the body (H, columns) [grey] over the others; left out where the rows do not fit."""
        first = math.floor(face) - ABOVE - 3
        if first < 0 or first + ABOVE + BELOW + 8 > len(strip):
            return
        part = np.asarray(strip[first : first + ABOVE + BELOW + 8], np.float64)
        at = np.asarray(ndimage.shift(part, (first + ABOVE - face, 0.0), order=1, mode="nearest"))[: len(self.u)]
        self.sum, self.squares, self.n = self.sum + at, self.squares + at * at, self.n + 1

    def face(self) -> tuple[float, float]:
        """Rows by which the face lies below the expected one, and its standard uncertainty; infinite where not seen.

        With I = T (1 - Phi) + G Phi and the body T the same in all frames, the standard deviation over the frames is
        Phi times that of the grains: half of it at the face, whatever the blur. Taken over all blocks of columns below
        which grains change: a single block is as uneven as its few grains and, in a noisy film, far too deep. Sigma:
        jackknife over the blocks.
        """
        if self.n < LEAST:
            return 0.0, math.inf
        variance = np.maximum(np.asarray(self.squares) / self.n - (np.asarray(self.sum) / self.n) ** 2, 0.0)
        blocks = variance.shape[1] // BLOCK
        variance = variance[:, : blocks * BLOCK].reshape(len(self.u), blocks, BLOCK).mean(2)
        changing = variance[:, variance[-4:].mean(0) > CONTRAST**2 * variance[:3].mean(0)]
        n = changing.shape[1]
        if n < max(LEAST_BLOCKS, blocks // 4):
            return 0.0, math.inf
        centre = _face(self.u, changing.mean(1))
        others = np.array([_face(self.u, np.delete(changing, k, axis=1).mean(1)) for k in range(n)])
        if not (math.isfinite(centre) and np.isfinite(others).all()):
            return 0.0, math.inf
        return centre, math.sqrt((n - 1) / n * float(np.sum((others - centre) ** 2)))


def _face(u: Array, variance: Array) -> float:
    """Where the standard deviation over the frames is half of the grains', from the variance on the rows u."""
    body, grains = variance[:3].mean(), variance[-4:].mean()
    return _rise(u, np.sqrt(np.maximum(variance - body, 0.0) / (grains - body)))


def _rise(u: Array, spread: Array) -> float:
    """Where `spread` rises through a half on the way down; NaN where it takes more than SHARP rows from 1/4 to 3/4.

    Grains that are jammed below the face go with it and change little by little with depth: they hide the end.
    """
    places = []
    for level in (0.25, 0.5, 0.75):
        below = np.flatnonzero(spread < level)
        if below.size == 0 or below[-1] == len(u) - 1:
            return math.nan
        i = int(below[-1])
        places.append(float(u[i] + (level - spread[i]) / (spread[i + 1] - spread[i])))
    return places[1] if places[2] - places[0] < SHARP else math.nan
