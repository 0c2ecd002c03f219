"""Parabolas through any stretch of a record, from sums that are added up once: time grows with the record's length."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from jumpvision.base.arrays import Array

Index = NDArray[np.int64]
SMALLEST = 8  # samples of the shortest block that is tried before single samples are
LOOK_BACK = 96  # nodes that a segment may reach back
CHUNK = 4096  # nodes whose segments are held at once


@dataclass(frozen=True)
class Sums:
    """Weighted sums over stretches (...,) about an origin of each [s]: w tau^p, p < 5; w y tau^p, p < 3; w y^2."""

    time: Array  # (5, ...)
    height: Array  # (3, ...)
    square: Array  # (...)

    def moved(self, by: Array) -> Sums:
        """About origins that lie `by` [s] earlier: tau grows by it."""
        powers = [np.ones_like(by), by, by**2, by**3, by**4]

        def shifted(sums: Array) -> Array:
            return np.stack(
                [sum(math.comb(p, q) * powers[p - q] * sums[q] for q in range(p + 1)) for p in range(len(sums))]
            )

        return Sums(shifted(self.time), shifted(self.height), self.square)

    def __getitem__(self, key: object) -> Sums:
        return Sums(self.time[:, key], self.height[:, key], self.square[key])  # type: ignore[index, call-overload]

    def plus(self, other: Sums) -> Sums:
        return Sums(self.time + other.time, self.height + other.height, self.square + other.square)

    def then(self, other: Sums) -> Sums:
        """These stretches and, behind them, others."""
        both = zip((self.time, self.height, self.square), (other.time, other.height, other.square))
        return Sums(*(np.concatenate(pair, axis=-1) for pair in both))

    def running(self) -> Sums:
        """Running sums along the last axis of the stretches."""
        return Sums(*(np.cumsum(a, axis=-1) for a in (self.time, self.height, self.square)))

    @cached_property
    def fit(self) -> Fit:
        """Polynomials of degree 0, 1, 2 through every stretch, by orthogonal ones."""
        s, a1, a2, a3, a4 = self.time
        y0, y1, y2 = self.height
        with np.errstate(all="ignore"):
            mean = a1 / s
            m2 = a2 - mean * a1
            m3 = a3 - 3 * mean * a2 + 2 * mean**2 * a1
            m4 = a4 - 4 * mean * a3 + 6 * mean**2 * a2 - 3 * mean**3 * a1
            level = y0 / s
            c1 = y1 - mean * y0
            c2 = y2 - 2 * mean * y1 + mean**2 * y0
            skew, width = m3 / m2, m2 / s
            weight = np.maximum(m4 - m3 * skew - m2 * width, 0.0)
            bend = (c2 - skew * c1 - width * y0) / weight
            slope = c1 / m2
            flat = np.maximum(self.square - y0 * level, 0.0)
            straight = np.maximum(flat - c1 * slope, 0.0)
            curved = np.maximum(straight - bend**2 * weight, 0.0)
        return Fit(mean, level, slope, bend, weight, flat, straight, curved, skew, width)


@dataclass(frozen=True)
class Fit:
    """Fits of stretches (...,): level [m], slope [m/s], bend [m/s^2] (half the curvature) and its weight, chi^2.

    flat, straight, curved: chi^2 of a constant, a straight line, a parabola of free curvature. mean [s]: of tau.
    """

    mean: Array
    level: Array
    slope: Array
    bend: Array
    weight: Array
    flat: Array
    straight: Array
    curved: Array
    skew: Array
    width: Array

    def falling(self, gravity: float, sigma: float) -> Array:
        """chi^2 of a parabola of curvature -gravity, known to sigma [m/s^2]."""
        with np.errstate(invalid="ignore"):
            off = self.weight * (self.bend + 0.5 * gravity) ** 2
            return self.curved + off / (1.0 + 0.25 * self.weight * sigma**2)

    @property
    def curvature(self) -> Array:
        return 2.0 * self.bend

    @property
    def curvature_sigma(self) -> Array:
        with np.errstate(divide="ignore"):
            return np.asarray(2.0 / np.sqrt(self.weight))


def sums_between(t: Array, y: Array, w: Array, nodes: Index) -> Sums:
    """Sums over the stretches from node to node (samples), each about the time of its first sample."""
    first = nodes[:-1]
    tau = t - np.repeat(t[first], np.diff(nodes))
    powers, out = w.copy(), []
    for _ in range(5):
        out.append(powers)
        powers = powers * tau
    add = np.add.reduceat
    return Sums(
        np.stack([add(p, first) for p in out]),
        np.stack([add(p * y, first) for p in out[:3]]),
        add(w * y * y, first),
    )


def change_points(t: Array, y: Array, w: Array, allowed: float) -> Index:
    """Samples at which a segment may begin, 0 and n among them: ends of the largest blocks that are parabolas.

    A block of 2^k SMALLEST samples whose parabola of free curvature has a chi^2 that chance makes with probability
    `allowed` is kept whole, else halved; one of SMALLEST samples that fails is taken sample by sample.
    """
    n = t.size
    starts = np.arange(0, n, SMALLEST)
    sums = sums_between(t, y, w, np.append(starts, n))
    origin = t[starts]
    levels = []
    while True:
        size = sums.time[0].shape[0]
        levels.append(sums.fit.curved)
        if size == 1:
            break
        left, right, at = sums[: size - size % 2 : 2], sums[1::2], origin[: size - size % 2 : 2]
        pairs = left.plus(right.moved(origin[1::2] - at))
        if size % 2:
            pairs = pairs.then(sums[size - 1 :])
            at = np.append(at, origin[-1])
        sums, origin = pairs, at
    nodes = [np.array([0, n])]
    ask = np.array([0])
    for k in range(len(levels) - 1, -1, -1):
        length = SMALLEST << k
        count = np.minimum(length, n - ask * length)
        good = levels[k][ask] <= scipy.special.chdtri(np.maximum(count - 3, 1), allowed)
        nodes.append(ask * length)
        bad = ask[~good]
        if k == 0:
            nodes.append((bad[:, None] * length + np.arange(SMALLEST)).ravel())
            break
        ask = np.concatenate([2 * bad, 2 * bad + 1])
        ask = ask[ask < len(levels[k - 1])]
    found = np.unique(np.concatenate(nodes))
    return found[found <= n].astype(np.int64)


def segments_back(t: Array, blocks: Sums, nodes: Index) -> tuple[Index, Sums]:
    """For every node but the first, the segments that end there: (first nodes (m, LOOK_BACK), sums about its own time).

    Column l holds the segment that reaches l + 1 blocks back; where there is none the weight is that of fewer.
    """
    m = nodes.size - 1
    start = np.arange(m)[:, None] - np.arange(min(LOOK_BACK, m))[None, :]
    inside = start >= 0
    block = np.maximum(start, 0)
    end = t[np.minimum(nodes[1:], t.size - 1)][:, None]
    about = blocks[block].moved(t[nodes[:-1]][block] - end)
    gone = Sums(about.time * inside, about.height * inside, about.square * inside)
    return start, gone.running()
