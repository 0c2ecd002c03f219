"""A record as one motion: rest, straight motion, free flight and the rest of it, segment after segment, by evidence."""

from __future__ import annotations

import math

import numpy as np

from jumpvision.base.arrays import Array

from .moments import CHUNK, LOOK_BACK, Fit, Index, change_points, segments_back, sums_between

REST, STRAIGHT, FLIGHT, CURVED = range(4)
NUMBERS = (1, 2, 2, 3)  # that each kind is fitted with
FEWEST = (1, 2, 4, 1)  # samples of each kind
ABOUT = 12  # samples on either side of a change, which it may move to
LIKE = 0.003  # of gravity: by how much lens, air and tilt may change the curvature of what is a flight all the same
RARE = 50.0  # a motion of constant curvature is one of gravity's, this many to one, before it is looked at
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
    blocks = sums_between(t, y, w, nodes)
    m = nodes.size - 1
    price = math.log(max(t.size, 2))
    best = np.zeros(m + 1)
    back, kinds = np.zeros(m, np.int64), np.zeros(m, np.int64)
    for low in range(0, m, CHUNK):
        reach = max(0, low - LOOK_BACK)
        part = nodes[reach : min(low + CHUNK, m) + 1]
        start, sums = segments_back(t, blocks[reach : reach + part.size - 1], part)
        cost, kind = _costs(sums.fit, part, start, gravity, price)
        for j in range(low - reach, part.size - 1):
            use = min(j + 1, cost.shape[1])
            total = cost[j, :use] + best[reach + j - np.arange(use)]
            k = int(np.argmin(total))
            best[reach + j + 1], back[reach + j], kinds[reach + j] = total[k], reach + j - k, kind[j, k]
    ends, named = [m], []
    while ends[-1] > 0:
        named.append(kinds[ends[-1] - 1])
        ends.append(int(back[ends[-1] - 1]))
    return nodes[np.array(ends[::-1])], np.array(named[::-1], np.int64), float(best[-1])


def _costs(fit: Fit, nodes: Index, start: Index, gravity: float, price: float) -> tuple[Array, Index]:
    """(cost, kind) (m, l) of the best kind of every segment."""
    length = nodes[1:][:, None] - nodes[np.maximum(start, 0)]
    falling = fit.falling(gravity, LIKE * gravity)
    chi2 = np.stack([fit.flat, fit.straight, falling, np.where(length <= 3, 0.0, fit.curved)])
    chi2[0] = np.where(length <= 1, 0.0, chi2[0])
    chi2[1] = np.where(length <= 2, 0.0, chi2[1])
    numbers = np.array(NUMBERS)[:, None, None] + 1
    cost = chi2 + price * np.minimum(numbers, length + 1)
    with np.errstate(divide="ignore", invalid="ignore"):  # what a free curvature might have been, beside gravity's
        other = 2.0 * np.log(RARE * gravity / np.maximum(fit.curvature_sigma, LIKE * gravity))
        cost[CURVED] += np.where(length > 3, np.maximum(other - price, 0.0), 0.0)
    cost[length < np.array(FEWEST)[:, None, None]] = np.inf
    cost = np.where((start >= 0) & np.isfinite(cost), cost, np.inf)
    kind = np.argmin(cost, axis=0)
    return np.take_along_axis(cost, kind[None], axis=0)[0], kind
