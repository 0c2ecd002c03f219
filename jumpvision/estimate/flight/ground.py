"""The ground on which a body bounces: its height, and how long a contact lasts that is too short to be seen.

Two parabolas of a bounce cross below the ground where the contact takes a time T: the one goes on down by v s, the
other comes from u (T - s) below, so that they meet v u T/(u + v) below it, v and u the speeds before and after.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from jumpvision.base.arrays import Array

from .motion import POWER, Motion, price
from .piece import Line, crossing, moves
from .segments import FLIGHT, REST

BRIEF = 0.1  # of the shorter flight beside it: the longest contact that is a bounce
FEW = 2  # samples of one, where flights are short
SCATTER = 4.0  # chi^2 for each degree of freedom above which bounces have no ground in common


@dataclass(frozen=True)
class Ground:
    """line: its height as a curve [m]; bounces: the ends of flights that lie on it, (part, side)."""

    line: Line
    bounces: frozenset[tuple[int, int]]


def ground(motion: Motion) -> Ground | None:
    """The ground of a motion whose contacts last; None where impacts of no length explain it as well."""
    rows, ends = [], set()
    for a, b in _bounces(motion):
        met = _crossing(motion, a, b)
        if met is not None:
            rows.append(met)
            ends |= {(a, 1), (b, -1)}
    rows += [(float(line.p[0]), float(line.cov[0, 0]), 0.0) for line in _rests(motion)]
    y, variance, share = np.array(rows, dtype=float).reshape(-1, 3).T
    if y.size < 2 or not np.any(share > 0.0):
        return None
    level, cov, chi2 = _fit(np.stack([np.ones(y.size), -share], axis=1), y, variance)
    none = _fit(np.ones((y.size, 1)), y, variance)[2] if np.count_nonzero(share == 0.0) < y.size else math.inf
    dof = max(y.size - 2, 0)
    lasts = level[1] > POWER * math.sqrt(cov[1, 1]) and none - chi2 > 2.0 * price(motion.piece)
    if not lasts or chi2 > SCATTER * dof + POWER**2 or level[1] > 4.0 * FEW * motion.piece.step + 0.02:
        return None
    scatter = max(1.0, chi2 / dof) if dof else 1.0
    line = Line(level[:1], scatter * cov[:1, :1], 0.0, 0.0, chi2, y.size)
    return Ground(line, frozenset(ends))


def _fit(a: Array, y: Array, variance: Array) -> tuple[Array, Array, float]:
    """(numbers, covariance, chi^2) of a weighted linear fit."""
    square = (a / variance[:, None]).T @ a
    cov: Array = np.linalg.pinv(square).astype(np.float64)
    p = cov @ ((a / variance[:, None]).T @ y)
    return p, cov, float(np.sum((y - a @ p) ** 2 / variance))


def _bounces(motion: Motion) -> list[tuple[int, int]]:
    """Pairs of flights with nothing, or next to nothing, between them."""
    out = []
    flying = [k for k, p in enumerate(motion.parts) if p.kind == FLIGHT]
    for a, b in pairwise(flying):
        first, second = motion.parts[a], motion.parts[b]
        if second.i - first.j <= max(FEW, BRIEF * min(len(first), len(second))):
            out.append((a, b))
    return out


def _rests(motion: Motion) -> list[Line]:
    """Rests longer than the flight that ended on them."""
    pairs = zip(motion.parts, motion.parts[1:], motion.lines[1:])
    return [line for a, b, line in pairs if a.kind == FLIGHT and b.kind == REST and len(b) > len(a)]


def _crossing(motion: Motion, a: int, b: int) -> tuple[float, float, float] | None:
    """(height [m], its variance, v u/(u + v) [m/s]) at which two flights cross."""
    first, second, t = motion.lines[a], motion.lines[b], motion.piece.t
    at = crossing(first, second, 0.5 * float(t[motion.parts[a].j - 1] + t[motion.parts[b].i]))
    if at is None:
        return None
    down, up = -first.slope(at), second.slope(at)
    if not (down > 0.0 and up > 0.0):
        return None
    by_first, by_second = moves(first, second, at)
    by_first, by_second = first.row(at) - down * by_first, -down * by_second
    variance = float(by_first @ first.cov @ by_first + by_second @ second.cov @ by_second)
    return first.at(at), variance, down * up / (down + up)
