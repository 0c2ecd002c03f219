"""Parabolas through any stretch of a record, from sums that are added up once: time grows with the record's length.

Sums of a stretch, in a row of 9, about an origin of its own [s]: w tau^p, p < 5; w y tau^p, p < 3; w y^2.
"""

from __future__ import annotations

import math

import numpy as np
import scipy
from numba import njit
from numpy.typing import NDArray

from jumpvision.base.arrays import Array

Index = NDArray[np.int64]
SMALLEST = 8  # samples of the shortest block that is tried before single samples are


@njit(cache=True)
def add(total: Array, row: Array, by: float) -> None:
    """Add a stretch to a total whose origin lies `by` [s] earlier: its tau grows by it."""
    power = np.empty(5)
    power[0] = 1.0
    for p in range(1, 5):
        power[p] = power[p - 1] * by
    for begin, degree in ((0, 4), (5, 2)):
        for p in range(degree + 1):
            choose = 1.0
            for q in range(p, -1, -1):
                total[begin + p] += choose * power[p - q] * row[begin + q]
                choose = choose * q / (p - q + 1)
    total[8] += row[8]


@njit(cache=True, error_model="numpy")
def chi2_of(s: Array) -> tuple[float, float, float, float, float]:
    """(chi^2 of a constant, a straight line, a parabola through a stretch; its bend, half the curvature [m/s^2], and
    the weight of that), by orthogonal polynomials."""
    mean, level = s[1] / s[0], s[5] / s[0]
    m2 = s[2] - mean * s[1]
    m3 = s[3] - 3.0 * mean * s[2] + 2.0 * mean**2 * s[1]
    m4 = s[4] - 4.0 * mean * s[3] + 6.0 * mean**2 * s[2] - 3.0 * mean**3 * s[1]
    c1 = s[6] - mean * s[5]
    c2 = s[7] - 2.0 * mean * s[6] + mean**2 * s[5]
    flat = max(s[8] - s[5] * level, 0.0)
    if not m2 > 0.0:
        return flat, flat, flat, 0.0, 0.0
    skew, width = m3 / m2, m2 / s[0]
    weight = max(m4 - m3 * skew - m2 * width, 0.0)
    straight = max(flat - c1 * c1 / m2, 0.0)
    if not weight > 0.0:
        return flat, straight, straight, 0.0, 0.0
    bend = (c2 - skew * c1 - width * s[5]) / weight
    return flat, straight, max(straight - bend * bend * weight, 0.0), bend, weight


@njit(cache=True)
def _curved(sums: Array) -> Array:
    out = np.empty(len(sums))
    for k in range(len(sums)):
        out[k] = chi2_of(sums[k])[2]
    return out


@njit(cache=True)
def _pairs(sums: Array, origin: Array) -> Array:
    """Of neighbours, about the origin of the first; the last may be alone."""
    out = np.zeros(((len(sums) + 1) // 2, 9))
    for k in range(len(sums)):
        add(out[k // 2], sums[k], origin[k] - origin[k - k % 2])
    return out


@njit(cache=True)
def sums_between(t: Array, y: Array, w: Array, nodes: Index) -> Array:
    """(m, 9) over the stretches from node to node (samples), each about the time of its first sample."""
    out = np.zeros((nodes.size - 1, 9))
    for k in range(nodes.size - 1):
        row, begin = out[k], t[nodes[k]]
        for i in range(nodes[k], nodes[k + 1]):
            tau, term = t[i] - begin, w[i]
            for p in range(5):
                row[p] += term
                if p < 3:
                    row[5 + p] += term * y[i]
                term *= tau
            row[8] += w[i] * y[i] * y[i]
    return out


def change_points(t: Array, y: Array, w: Array, allowed: float) -> Index:
    """Samples at which a segment may begin, 0 and n among them: ends of the largest blocks that are parabolas.

    A block of 2^k SMALLEST samples whose parabola of free curvature has a chi^2 that chance makes with probability
    `allowed` is kept whole, else halved; one of SMALLEST samples that fails is taken sample by sample.
    """
    n = t.size
    starts = np.arange(0, n, SMALLEST)
    sums, origin = sums_between(t, y, w, np.append(starts, n)), t[starts]
    levels = [_curved(sums)]
    for _ in range(math.ceil(math.log2(max(starts.size, 1)))):
        sums, origin = _pairs(sums, origin), origin[::2].copy()
        levels.append(_curved(sums))
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
