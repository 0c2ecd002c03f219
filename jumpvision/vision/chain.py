"""The strongest chain through the columns of a map: surfaces and lines are found with it before they are fitted."""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@nb.njit(cache=True)
def strongest_chain(strength: Array, largest: int, cost: float) -> NDArray[np.int64]:
    """Row index of each column of the chain with the greatest sum of strength - cost |step|; strength (nx, rows).

    largest: rows by which the chain may step from one column to the next. Dynamic programming. Compiles in about 1 s,
    once.
    """
    nx, rows = strength.shape
    best = strength[0].copy()
    came = np.zeros((nx, rows), dtype=np.int64)
    for j in range(1, nx):
        new = np.empty(rows)
        for r in range(rows):
            top, where = -1e300, r
            for q in range(max(0, r - largest), min(rows, r + largest + 1)):
                score = best[q] - cost * abs(q - r)
                if score > top:
                    top, where = score, q
            new[r], came[j, r] = top + strength[j, r], where
        best = new
    path = np.empty(nx, dtype=np.int64)
    path[nx - 1] = np.argmax(best)
    for j in range(nx - 1, 0, -1):
        path[j - 1] = came[j, path[j]]
    return path
