"""Both ends of a flight: at a corner, or where a spring begins, whichever the evidence prefers, with covariance."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from jumpvision.base.arrays import Array

from .corner import crossing, moves
from .motion import Motion, curvature, price, pushed, turning
from .piece import Line, polynomial
from .segments import FLIGHT, REST
from .spring import Settings, Sprung, sprung, swings

UNLIKE = 3.0  # sigmas by which a flight's own curvature may differ before it is fitted with it
FEWEST = 6  # samples of a smooth motion that a flight may meet at an angle
FREE = 0.3  # of gravity: what is known of a curvature that is fitted freely


@dataclass(frozen=True)
class Edge:
    """An end of a flight: when [s], its variance [s^2], what is beyond it.

    by: {which curve: d time / d its numbers}; curves of the motion by their place in it, others below 0.
    """

    time: float
    variance: float
    kind: str
    by: dict[int, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class Flight:
    """Samples i .. j; edges (None: outside the record); curvature [m/s^2] and its sigma; covariances: of the curves."""

    i: int
    j: int
    edges: tuple[Edge | None, Edge | None]
    curvature: tuple[float, float]
    covariances: dict[int, Array]
    swing: bool  # whether one swing on a spring explains it and what is about it as well

    def covariance(self, a: int, other: Flight, b: int) -> float:
        """Of edge a (0 lift-off, 1 landing) with edge b of another flight [s^2]."""
        first, second = self.edges[a], other.edges[b]
        if first is None or second is None:
            return 0.0
        cov = self.covariances
        both = [k for k in first.by if k in second.by and (k >= 0 or self is other)]
        return sum(float(first.by[k] @ cov[k] @ second.by[k]) for k in both if first.by[k].size == second.by[k].size)


def flight(motion: Motion, k: int, how: Settings) -> Flight:
    """The flight that is part k of a motion."""
    part, line = motion.parts[k], motion.lines[k]
    sides = {side: k + min(side, 0) for side in (-1, 1) if 0 <= k + side < len(motion.parts)}
    reach = turning(motion, k, -1), turning(motion, k, 1)
    own = curvature(motion.piece, part.i, part.j)
    if abs(own[0] + how.gravity) > UNLIKE * math.hypot(own[1], how.gravity_sigma):
        line = polynomial(motion.piece.part(part.i, part.j), 3)
    beside: dict[int, tuple[int, Line, float, str]] = {}
    gradual: list[int] = []
    for side, corner in sides.items():
        if corner in motion.corners:
            n = k + side
            kind = {FLIGHT: "impact", REST: "rest"}.get(motion.parts[n].kind, "support")
            beside[side] = n, motion.lines[n], motion.corners[corner], kind
        elif (met := bent_corner(motion, k, side, reach, how)) is not None:
            beside[side] = side - 2, *met, "support"
        else:
            gradual.append(side)
    fit = None
    if gradual:
        fit = sprung(motion.piece, (part.i, part.j), reach, tuple(gradual), how)
    swing = False
    if fit is not None:
        own = _own(motion, part.i, part.j, reach, gradual, how, fit)
        if abs(own[0] + how.gravity) > UNLIKE * math.hypot(own[1], how.gravity_sigma):
            freely = replace(how, gravity_sigma=FREE * how.gravity)
            fit = sprung(motion.piece, (part.i, part.j), reach, tuple(gradual), freely) or fit
        line = fit.line
        swing = len(gradual) == 2 and swings(motion.piece.part(*fit.window)) + 5.0 * price(motion.piece) <= (
            fit.chi2 + 6.0 * price(motion.piece)
        )
    cov = line.cov if fit is None else fit.cov
    covariances = {k: cov} | {name: other.cov for name, other, _, _ in beside.values()}
    edges = [_edge(motion, k, side, line, cov, beside, fit, gradual) if side in sides else None for side in (-1, 1)]
    return Flight(part.i, part.j, (edges[0], edges[1]), own, covariances, swing)


def _own(
    motion: Motion, i: int, j: int, reach: tuple[int, int], gradual: list[int], how: Settings, fit: Sprung
) -> tuple[float, float]:
    """The curvature of a flight with springs at its ends, fitted along with them."""
    freely = sprung(motion.piece, (i, j), reach, tuple(gradual), replace(how, gravity_sigma=FREE * how.gravity))
    if freely is not None:
        return -freely.curvature[0], freely.curvature[1]
    inside = np.flatnonzero((motion.piece.t > min(fit.times)) & (motion.piece.t < max(fit.times)))
    lo, hi = (int(inside[0]), int(inside[-1]) + 1) if len(gradual) == 2 and inside.size > 4 else (i, j)
    return curvature(motion.piece, lo, hi)


def _edge(
    motion: Motion,
    k: int,
    side: int,
    line: Line,
    cov: Array,
    beside: dict[int, tuple[int, Line, float, str]],
    fit: Sprung | None,
    gradual: list[int],
) -> Edge:
    piece, part = motion.piece, motion.parts[k]
    if side in beside:
        name, other, near, kind = beside[side]
        at = crossing(line, other, near)
        at = near if at is None else at
        mine, theirs = moves(line, other, at)
        by = np.zeros(len(cov))
        by[: mine.size] = mine
        return Edge(at, float(by @ cov @ by + theirs @ other.cov @ theirs), kind, {k: by, name: theirs})
    if fit is None:
        n = part.i if side < 0 else part.j
        return Edge(0.5 * float(piece.t[n - 1] + piece.t[n]), piece.step**2, "contact")
    n = gradual.index(side)
    by = np.zeros(len(cov))
    by[fit.p.size + n] = 1.0
    time, variance = float(fit.times[n]), float(by @ cov @ by)
    if not fit.good and variance < piece.step**2:  # no spring-like landing: good to a frame at best
        return Edge(time, piece.step**2, "contact")
    return Edge(time, variance, "spring", {k: by})


def bent_corner(
    motion: Motion, k: int, side: int, reach: tuple[int, int], how: Settings
) -> tuple[Line, float] | None:
    """(the curve beside, time) where a flight meets a smooth motion at an angle; None where a spring does as well."""
    piece, part, other = motion.piece, motion.parts[k], motion.parts[k + side]
    lo, hi = (max(other.i, reach[0]), other.j) if side < 0 else (other.i, min(other.j, reach[1]))
    if hi - lo < FEWEST or other.kind == FLIGHT:
        return None
    mine, beside = motion.lines[k], polynomial(piece.part(lo, hi), 3)
    border = part.i if side < 0 else part.j
    at = crossing(mine, beside, 0.5 * float(piece.t[border - 1] + piece.t[border]))
    if at is None or not piece.t[min(part.i, lo)] < at < piece.t[max(part.j, hi) - 1]:
        return None
    if not (pushed(mine, beside, at) if side > 0 else pushed(beside, mine, at)):
        return None
    spring = sprung(piece, (part.i, part.j), (lo, hi), (side,), how)
    if spring is None or spring.n < hi - lo + part.j - part.i:  # no spring that explains all of it
        return beside, at
    return (beside, at) if mine.chi2 + beside.chi2 + price(piece) < spring.chi2 else None
