"""Who is near whom: discs in square cells, lists of partners by band, and what of them is close."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numba as nb
import numpy as np

FAST: Mapping[str, Any] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"contract", "nsz", "arcp"},
}
X, Y, VX, VY, UX, UY, SPIN, HALF, STATE = range(9)
"""Rows of a state: place [m]; velocity foreseen for now, and half a step before [m/s]; spin likewise [rad/s]."""
RADIUS, LIGHT = 0, 1  # rows of the sizes: m, 1/kg
CLOSE, NEXT = 0.3, 0.1  # close is what is nearer than that share of the skin, soon what is within that of it
OWN, LOWER = 0, 1  # lists: partners of a higher number; those in lower bands


@nb.njit(cache=True, nogil=True)
def cells(x, y, radius, reach, cell, first, inside):  # type: ignore[no-untyped-def]
    """Sorts discs into square cells: cell (n,), and inside[first[c]:first[c + 1]] the discs of cell c, increasing.

    Returns the numbers of columns and rows, which fit `first`.
    """
    n = len(x)
    r_max, left, right, low, high = 0.0, np.inf, -np.inf, np.inf, -np.inf
    for i in range(n):
        r_max = max(r_max, radius[i])
        left, right = min(left, x[i]), max(right, x[i])
        low, high = min(low, y[i]), max(high, y[i])
    size = max(2.0 * r_max + reach, math.sqrt((right - left) * (high - low) / n), 1e-300)  # about n cells at most
    while ((right - left) / size + 1.0) * ((high - low) / size + 1.0) > len(first) - 1:  # far apart on a line
        size *= 1.5
    nx, ny = int((right - left) / size) + 1, int((high - low) / size) + 1
    first[: nx * ny + 1] = 0
    for i in range(n):
        cell[i] = int((y[i] - low) / size) * nx + int((x[i] - left) / size)
        first[cell[i] + 1] += 1
    for c in range(nx * ny):
        first[c + 1] += first[c]
    for i in range(n):  # first[c] runs up to the begin of the next cell
        inside[first[cell[i]]] = i
        first[cell[i]] += 1
    for c in range(nx * ny, 0, -1):
        first[c] = first[c - 1]
    first[0] = 0
    return nx, ny


@nb.njit(cache=True, nogil=True)
def near(x, y, radius, reach, i, low, high, cell, first, inside, nx, ny, out, count):  # type: ignore[no-untyped-def]
    """Appends to out, from count on, the discs from `low` to high - 1 nearer to disc i than r_i + r_j + reach; the
    count, which goes on where out is full."""
    cx, cy = cell[i] % nx, cell[i] // nx
    for row in range(max(cy - 1, 0), min(cy + 2, ny)):
        for q in range(first[row * nx + max(cx - 1, 0)], first[row * nx + min(cx + 1, nx - 1) + 1]):
            j = inside[q]
            if low <= j < high:
                s = radius[i] + radius[j] + reach
                if (x[i] - x[j]) ** 2 + (y[i] - y[j]) ** 2 < s * s:
                    if count < len(out):
                        out[count] = j
                    count += 1
    return count


@nb.njit(cache=True)
def neighbours(p, n_free, reach, start, partner):  # type: ignore[no-untyped-def]
    """List for each free disc i the discs j > i nearer than r_i + r_j + reach in partner[start[i]:start[i + 1]].

    p (n, 6): x, y and in column 4 the radius. Returns the number of pairs; above len(partner) the list did not fit and
    holds nothing of use. start (n_free + 1,).
    """
    x, y, radius, n, count = p[:, 0].copy(), p[:, 1].copy(), p[:, 4].copy(), len(p), 0
    cell, first, inside = np.empty(n, np.int64), np.empty(4 * n + 16, np.int64), np.empty(n, np.int64)
    nx, ny = cells(x, y, radius, reach, cell, first, inside)
    for i in range(n_free):
        start[i] = count
        count = near(x, y, radius, reach, i, i + 1, n, cell, first, inside, nx, ny, partner, count)
    start[n_free] = count
    return count


@nb.njit(**FAST)
def listed(p, size, reach, low, high, cell, first, inside, nx, ny, new, old, clock):  # type: ignore[no-untyped-def]
    """Writes the lists of a band of discs low to high - 1, OWN and LOWER; whether they fit.

    new, old: begin, end (2, n) and partners (2, pairs) of the discs, with stretch [m] and time (2, pairs) of their
    springs: those stretched in the step `clock` live on.
    """
    begin, end, partner, slide, seen = new
    for side in range(2):
        count = 0
        for i in range(low, high):
            begin[side, i] = count
            a, b = (i + 1, p.shape[1]) if side == OWN else (0, low)
            if b > 0:
                out = partner[side]
                count = near(p[X], p[Y], size[RADIUS], reach, i, a, b, cell, first, inside, nx, ny, out, count)
            if count > partner.shape[1]:
                return False
            end[side, i] = count
            for a in range(begin[side, i], count if slide.size > 0 else begin[side, i]):
                slide[side, a], seen[side, a] = 0.0, clock - 1
                for b in range(old[0][side, i], old[1][side, i]):
                    if old[2][side, b] == partner[side, a] and old[4][side, b] == clock:
                        slide[side, a], seen[side, a] = old[3][side, b], clock
                        break
    return True


@nb.njit(**FAST)
def picked(p, size, reach, low, high, begin, end, partner, box, plate, close, found, held):  # type: ignore[no-untyped-def]
    """Writes what of a band is nearer than `reach` besides touching.

    close: first and second disc, place in the list and square of r_i + r_j (plus NEXT of the reach) of pairs (2,
    pairs), discs near walls or plate (high - low,), twice (2, pairs) for `within`. found (5,): how many pairs of OWN
    and LOWER, discs near walls, and pairs of both for `within`.
    held (3, n): springs at walls and plate, or (3, 0); those of the others are slack.
    """
    one, other, where, square, wide, walls, _, _ = close
    for side in range(2):
        count = np.uintp(0)
        for i in range(np.uintp(low), np.uintp(high)):
            for q in range(np.uintp(begin[side, i]), np.uintp(end[side, i])):
                j = np.uintp(partner[side, q])
                s = size[RADIUS, i] + size[RADIUS, j]
                if (p[X, i] - p[X, j]) ** 2 + (p[Y, i] - p[Y, j]) ** 2 < (s + reach) ** 2:
                    one[side, count], other[side, count], where[side, count] = i, j, q
                    square[side, count], wide[side, count] = s * s, (s + NEXT * reach) ** 2
                    count += np.uintp(1)
        found[side] = count
    count = np.uintp(0)
    left, right, bottom, top = box
    half_width, thick, face = plate[0], plate[1], plate[2]
    for i in range(np.uintp(low), np.uintp(high)):
        x, y, r = p[X, i], p[Y, i], size[RADIUS, i] + reach
        beside = x - r < left or x + r > right or y - r < bottom or y + r > top
        if beside or (y + r > face and y - r < face + thick and x + r > -half_width and x - r < half_width):
            walls[count] = i
            count += np.uintp(1)
        elif held.shape[1] > 0:
            held[0, i], held[1, i], held[2, i] = 0.0, 0.0, 0.0
    found[2] = count
