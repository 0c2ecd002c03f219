"""A record as one motion: rest, straight motion, free flight and the rest of it, segment after segment, by evidence."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from jumpvision.base.arrays import Array

from .moments import Index, add, change_points, chi2_of, sums_between

REST, STRAIGHT, FLIGHT, CURVED = range(4)
NUMBERS = (1, 2, 2, 3)  # that each kind is fitted with
FEWEST = (1, 2, 4, 1)  # samples of each kind
LOOK_BACK = 96  # nodes that a segment may reach back
ABOUT = 12  # samples on either side of a change, which it may move to
LIKE = 0.003  # of gravity: by how much lens, air and tilt may change the curvature of what is a flight all the same
RARE = 50.0  # a motion of constant curvature is one of gravity's, this many to one, before it is looked at
LOST = 1e-11  # of the sum of squares: what rounding may take from a chi^2, a difference of up to 96 nodes' sums
ALLOWED = 1e-3  # chance that a stretch of one parabola is looked into further


def segmented(t: Array, y: Array, w: Array, gravity: float) -> tuple[Index, Index]:
    """(first sample of every segment and n, kind of each) of least cost: chi^2, and log n for every number that they
    are fitted with and for every change.

    t (n,) [s] increasing, y (n,) [m], w (n,) [1/m^2]: weights of white noise. Costs of n samples: BIC (Schwarz 1978),
    a change point counted as a number; its place is one of n. Exact over the change points up to LOOK_BACK of them back
    (optimal partitioning): first the ends of blocks, then those that were chosen and every sample about them.
    """
    coarse = change_points(t, y, w, ALLOWED)
    first, _, _ = _partition(t, y, w, coarse, gravity)
    about = (first[1:-1, None] + np.arange(-ABOUT, ABOUT + 1)).ravel()
    fine = np.unique(np.concatenate([first, about[(about > 0) & (about < t.size)]]))
    return _partition(t, y, w, fine, gravity)[:2]


def evidence(t: Array, y: Array, w: Array, gravity: float) -> float:
    """The least cost that segments may have, from block to block."""
    return _partition(t, y, w, change_points(t, y, w, ALLOWED), gravity)[2]


def _partition(t: Array, y: Array, w: Array, nodes: Index, gravity: float) -> tuple[Index, Index, float]:
    """(first sample of every segment and n, kind of each, cost) of least cost, segments from node to node."""
    price = math.log(max(t.size, 2))
    best, back, kinds = _least(t, sums_between(t, y, w, nodes), nodes, gravity, price)
    ends, named = [nodes.size - 1], []
    while ends[-1] > 0:
        named.append(kinds[ends[-1] - 1])
        ends.append(int(back[ends[-1] - 1]))
    return nodes[np.array(ends[::-1])], np.array(named[::-1], np.int64), float(best[-1])


@njit(cache=True)
def _least(t: Array, blocks: Array, nodes: Index, gravity: float, price: float) -> tuple[Array, Index, Index]:
    """(least cost up to every node (m + 1,); node at which the last segment begins and its kind (m,))."""
    m = nodes.size - 1
    best, least = np.zeros(m + 1), np.zeros(m + 1)  # least: of best up to there
    back, kinds = np.zeros(m, np.int64), np.zeros(m, np.int64)
    for j in range(m):
        best[j + 1] = np.inf
        end, sums = t[nodes[j]], np.zeros(9)
        for k in range(j, max(j - LOOK_BACK, -1), -1):
            add(sums, blocks[k], t[nodes[k]] - end)
            cost, kind, curved = _cheapest(sums, nodes[j + 1] - nodes[k], gravity, price)
            if best[k] + cost < best[j + 1]:
                best[j + 1], back[j], kinds[j] = best[k] + cost, k, kind
            # a segment from further back has at least this chi^2, whatever its kind
            if least[k] + curved - LOST * sums[8] > best[j + 1]:
                break
        least[j + 1] = min(least[j], best[j + 1])
    return best, back, kinds


@njit(cache=True)
def _cheapest(sums: Array, length: int, gravity: float, price: float) -> tuple[float, int, float]:
    """(cost, kind, chi^2 of a parabola) of a segment of so many samples."""
    flat, straight, curved, bend, weight = chi2_of(sums)
    least, kind = np.inf, REST
    for k in (REST, STRAIGHT, FLIGHT, CURVED):
        if length < FEWEST[k]:
            continue
        cost = price * min(NUMBERS[k] + 1, length + 1)
        if k == REST:
            cost += flat if length > 1 else 0.0
        elif k == STRAIGHT:
            cost += straight if length > 2 else 0.0
        elif k == FLIGHT:
            off = weight * (bend + 0.5 * gravity) ** 2
            cost += curved + off / (1.0 + 0.25 * weight * (LIKE * gravity) ** 2)
        elif length > 3:  # what a free curvature might have been, beside gravity's
            sigma = max(2.0 / math.sqrt(weight) if weight > 0.0 else np.inf, LIKE * gravity)
            cost += curved + max(2.0 * math.log(RARE * gravity / sigma) - price if sigma < np.inf else 0.0, 0.0)
        if cost < least:
            least, kind = cost, k
    return least, kind, curved
