"""Both ends of a flight: at a corner, or where a spring begins, whichever the evidence prefers, with covariance."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from jumpvision.base.arrays import Array

from ..estimate import scatter_factor
from .ground import Ground
from .motion import POWER, Motion, Part, curvature, price, pushed, turning
from .piece import Line, Piece, Source, crossing, moves, polynomial, root_of
from .segments import FLIGHT, NUMBERS, REST
from .spring import FREE, SHRUNK, Settings, Sprung, quiet, sprung, swings, well

UNLIKE = 3.0  # sigmas by which a flight's own curvature may differ before it is fitted with it
FEWEST = 6  # samples of a smooth motion that a flight may meet at an angle
SIZES = (6, 8, 11, 15, 20, 28, 40, 56, 80, 112, 160)  # of it, tried in turn
TRIED = ((3, 0), (3, 1), (3, 2), (4, 0))  # numbers of a polynomial, samples about the corner that are left out, in turn
ROUNDS = 5  # of a curve and where it meets the flight
SOON = 0.1  # of a fall's speed that it may have after its release, where it was told from the rest


@dataclass(frozen=True)
class Edge:
    """An end of a flight: when [s], what is beyond it.

    by: {whose: by how much [s] each of its sources of unit variance moves it}.
    """

    time: float
    kind: str
    by: dict[Source, Array]

    @property
    def variance(self) -> float:
        """[s^2]"""
        return self.covariance(self)

    def covariance(self, other: Edge) -> float:
        """With another edge [s^2]."""
        both = [k for k in self.by if k in other.by and self.by[k].size == other.by[k].size]
        return sum(float(self.by[k] @ other.by[k]) for k in both)


@dataclass(frozen=True)
class Flight:
    """Samples i .. j; edges (None: outside the record); curvature [m/s^2] and its sigma."""

    i: int
    j: int
    edges: tuple[Edge | None, Edge | None]
    curvature: tuple[float, float]
    swing: bool  # whether one swing on a spring, or a smooth motion, explains it and what is about it as well

    def covariance(self, a: int, other: Flight, b: int) -> float:
        """Of edge a (0 lift-off, 1 landing) with edge b of another flight [s^2]."""
        first, second = self.edges[a], other.edges[b]
        return 0.0 if first is None or second is None else first.covariance(second)

    def times_together(self, other: Flight) -> float:
        """Covariance of the times of two flights [s^2]."""
        return sum((2 * (i == j) - 1) * self.covariance(i, other, j) for i in (0, 1) for j in (0, 1))


@dataclass(frozen=True)
class Beside:
    """What a flight meets at an angle: the curve, its name, when about [s], and the kind of the edge."""

    name: Source
    line: Line
    near: float
    kind: str


def flight(motion: Motion, k: int, how: Settings, under: Ground) -> Flight:
    """The flight that is part k of a motion. under: the ground of its bounces."""
    part, line, piece = motion.parts[k], under.lines.get(k, motion.lines[k]), motion.piece
    name, span = ("train", under.first[k]) if k in under.first else ("curve", k), under.spans.get(k, (part.i, part.j))
    sides = [side for side in (-1, 1) if 0 <= k + side < len(motion.parts)]
    reach = turning(motion, k, -1), turning(motion, k, 1)
    own = curvature(piece, *span)
    if unlike(own, how):
        line, name = polynomial(piece.part(*span), 3), ("curve", k)
    beside = {}
    for side in sides:
        level = under.levels.get((k, side))
        met = corner(motion, k, side, reach, how) if level is None else None
        if level is not None:
            other = motion.parts[k + side].kind
            kind = "rest" if other == REST else "impact"
            met = Beside(("train", under.first[k]), level, _border(motion, k, side), kind)
        if met is not None:
            beside[side] = met
    gradual = tuple(side for side in sides if side not in beside)
    fit = sprung(piece, (part.i, part.j), reach, gradual, how) if gradual else None
    if fit is not None and not fit.good and len(sides) == 1:  # a contact at the record's end that noise hid
        hidden = sprung(piece, (part.i, part.j), reach, (-1, 1), how)
        if hidden is not None and hidden.good:
            fit, gradual = hidden, (-1, 1)
    swing = False
    if fit is not None:
        own = -fit.own[0], fit.own[1]
        if unlike(own, how):
            freely = replace(how, gravity_sigma=FREE * how.gravity)
            fit = sprung(piece, (part.i, part.j), reach, gradual, freely) or fit
            own = -fit.own[0], fit.own[1]
        line = fit.line
        more = POWER**2 if how.fitted else 0.0
        doubtful = len(gradual) == 2 or (how.fitted and not beside)
        swing = doubtful and _swings(quiet(motion.piece, how), part, reach, fit, more, how)
    if fit is not None:
        line, name = replace(line, root=root_of(fit.cov)), ("curve", k)
    if not beside:
        swing = swing or not all(pushed_up(motion, k, side) for side in gradual if fit is None or not fit.good)
    ends = (*beside, *gradual)
    edges = [_edge(motion, k, s, name, line, beside, fit, gradual) if s in ends else None for s in (-1, 1)]
    return Flight(part.i, part.j, (edges[0], edges[1]), own, swing)


def _swings(piece: Piece, part: Part, reach: tuple[int, int], fit: Sprung, more: float, how: Settings) -> bool:
    """Whether one swing explains all from turn to turn, and a flight between springs is no better by `more` of chi^2:
    six numbers each."""
    lo, hi = min(reach[0], part.i), max(reach[1], part.j)
    swing = swings(piece.part(lo, hi), how)
    if fit.window == (lo, hi):
        return swing <= fit.chi2 + more
    return well(swing, hi - lo - 6) or swings(piece.part(*fit.window), how) <= fit.chi2 + more


def pushed_up(motion: Motion, k: int, side: int) -> bool:
    """Whether the motion beyond a side of flight k leaves its parabola upwards, as a ground makes it do, by POWER
    sigmas in the mean of as many samples as half the flight has."""
    part, line, piece = motion.parts[k], motion.lines[k], motion.piece
    many = max(len(part) // 2, 2)
    lo, hi = (max(part.i - many, 0), part.i) if side < 0 else (part.j, min(part.j + many, piece.t.size))
    tau = piece.t[lo:hi] - line.origin
    rows = tau[:, None] ** np.arange(line.p.size)
    above = float(np.mean(piece.y[lo:hi] - rows @ line.p - line.bend * tau**2))
    row = rows.mean(axis=0)
    white = (1.0 + piece.rho) / (1.0 - piece.rho) / (hi - lo)
    return above > POWER * math.sqrt(float(row @ line.cov @ row) + white * float(np.mean(piece.sigma[lo:hi] ** 2)))


def _border(motion: Motion, k: int, side: int) -> float:
    """Where a part ends [s]."""
    part, t = motion.parts[k], motion.piece.t
    return float(t[part.i] if side < 0 else t[part.j - 1])


def unlike(own: tuple[float, float], how: Settings) -> bool:
    """Whether a curvature is another than gravity's."""
    return abs(own[0] + how.gravity) > UNLIKE * math.hypot(own[1], how.gravity_sigma)


def _edge(
    motion: Motion,
    k: int,
    side: int,
    name: Source,
    line: Line,
    beside: dict[int, Beside],
    fit: Sprung | None,
    gradual: tuple[int, ...],
) -> Edge:
    """line: its root is of all numbers that are fitted, the edges on a spring among them."""
    piece, part = motion.piece, motion.parts[k]
    to_a_sample = {("contact", 2 * k + side): np.array([piece.step])}
    if side in beside:
        met = beside[side]
        if met.kind == "release":
            return _release(line, met, name)
        at = crossing(line, met.line, met.near)
        at = met.near if at is None else at
        mine, theirs = moves(line, met.line, at)
        by = line.moved(mine, name, side > 0)
        for source, moved in met.line.moved(theirs, met.name, side < 0).items():
            by[source] = by.get(source, 0.0) + moved
        return Edge(at, met.kind, by)
    if fit is None:
        n = part.i if side < 0 else part.j
        return Edge(0.5 * float(piece.t[n - 1] + piece.t[n]), "contact", to_a_sample)
    n = gradual.index(side)
    edge = Edge(float(fit.times[n]), "spring", {name: line.root[fit.p.size + n]})
    if not fit.good and edge.variance < piece.step**2:  # no spring-like landing: good to a frame at best
        return Edge(edge.time, "contact", to_a_sample)
    return edge


def _release(line: Line, met: Beside, name: Source) -> Edge:
    """Let go without a push: where the parabola is as fast as what held it, and that it is as high there."""
    at, beside = met.near, met.line
    later = -0.5 / (line.curve(at) - beside.curve(at))
    mine, theirs = line.row(at), -beside.row(at)  # how the gap of heights moves
    by, by_theirs = later * line.slope_row(at), -later * beside.slope_row(at)
    cov = line.cov[: line.p.size, : line.p.size]
    gap = float(mine @ cov @ mine + theirs @ beside.cov @ theirs)
    gain = float(by @ cov @ mine + by_theirs @ beside.cov @ theirs) / gap
    moved = line.moved(by - gain * mine, name, False) | beside.moved(by_theirs - gain * theirs, met.name, True)
    return Edge(at - gain * (line.at(at) - beside.at(at)), "release", moved)


def corner(motion: Motion, k: int, side: int, reach: tuple[int, int], how: Settings) -> Beside | None:
    """What the flight k meets at an angle on one side; None where a spring explains the motion beside it as well."""
    piece, other = motion.piece, motion.parts[k + side]
    at = None if how.slow(piece.step) else motion.corners.get(k + min(side, 0))
    if at is not None and other.kind == FLIGHT:
        return Beside(("curve", k + side), motion.lines[k + side], at, "impact")
    lo, hi = (reach[0], motion.parts[k].i) if side < 0 else (motion.parts[k].j, reach[1])
    around = piece.t[max(lo - FEWEST, 0) : hi + FEWEST]
    driven = how.drive is not None and how.drive.near(around, 0.0) is not None
    let = released(motion, k) if side < 0 and not driven else None
    if let is not None and other.kind == REST:
        return let
    if at is not None and not driven and stays(motion, k, side):  # longer than any turn on a spring
        return Beside(("curve", k + side), motion.lines[k + side], at, "rest")
    if how.slow(piece.step):
        return None
    found = let or bent(motion, k, side)
    if found is None and at is not None:
        kind = "rest" if other.kind == REST else "support"
        found = Beside(("curve", k + side), motion.lines[k + side], at, kind)
    if found is None or hi - lo < 2:
        return found
    part = motion.parts[k]
    cut = len(part) // 6  # the other end may hang over into a contact of its own
    inside = (part.i + cut, part.j) if side > 0 else (part.i, part.j - cut)
    spring = sprung(piece, inside, (lo, hi), (side,), how, shares=SHRUNK if driven else (1.0,))
    if driven and spring is not None and spring.good:  # a moving motor makes no corner
        return None
    if spring is None or not well(spring.spent, spring.dof):
        return found
    spent = replace(part, i=inside[0], j=inside[1]).line(piece, how.gravity).chi2
    spent += sum(_cost(motion, p, lo, hi) for p in motion.parts)
    numbers = 4.0 if other.kind == REST else 2.0  # a spring that ends in a rest has that beside it
    return None if spring.spent + numbers * price(piece) <= spent else found


def _cost(motion: Motion, part: Part, lo: int, hi: int) -> float:
    """chi^2 and numbers of the samples of a part that lie in lo .. hi."""
    i, j = max(part.i, lo), min(part.j, hi)
    if j <= i:
        return 0.0
    numbers = min(NUMBERS[part.kind], j - i)
    return polynomial(motion.piece.part(i, j), numbers).chi2 + (numbers + 1) * price(motion.piece)


def stays(motion: Motion, k: int, side: int) -> bool:
    """Return True if rests beside flight k last longer than that, or as long as the record."""
    n, at = 0, k + side
    while 0 <= at < len(motion.parts) and motion.parts[at].kind == REST:
        n, at = n + len(motion.parts[at]), at + side
    return n > len(motion.parts[k]) or (n >= FEWEST and not 0 <= at < len(motion.parts))


def released(motion: Motion, k: int) -> Beside | None:
    """What the flight k is let go from: it begins as high and as fast as that is."""
    line, held, at = motion.lines[k], motion.lines[k - 1], float(motion.piece.t[motion.parts[k].i])
    fallen = abs(line.slope(float(motion.piece.t[motion.parts[k].j - 1])) - line.slope(at))
    slow = 2.0 * POWER * math.hypot(line.slope_sigma(at), held.slope_sigma(at)) + SOON * fallen
    off, bend = line.slope(at) - held.slope(at), line.curve(at) - held.curve(at)
    few = len(motion.parts[k - 1]) < FEWEST and not stays(motion, k, -1)
    if few or abs(off) > slow or not bend < 0.0:
        return None
    apex = at - 0.5 * off / bend
    rows = line.row(apex), held.row(apex)
    sigma = math.sqrt(sum(float(row @ one.cov @ row) for row, one in zip(rows, (line, held))))
    return (
        Beside(("curve", k - 1), held, apex, "release") if abs(line.at(apex) - held.at(apex)) < POWER * sigma else None
    )


def bent(motion: Motion, k: int, side: int) -> Beside | None:
    """Fit the smooth motion that a flight meets at an angle: by one degree more than explains as much of it, so that
    what the polynomial leaves out is less than noise."""
    piece, part, mine = motion.piece, motion.parts[k], motion.lines[k]
    border = part.i if side < 0 else part.j
    first = max((p.j for p in motion.parts[:k] if p.kind == FLIGHT), default=0)
    last = min((p.i for p in motion.parts[k + 1 :] if p.kind == FLIGHT), default=piece.t.size)
    for _ in range(ROUNDS):
        good: list[tuple[int, int]] = []
        for numbers, skip in TRIED:
            begin = border + side * skip
            room = begin - first if side < 0 else last - begin
            if room < FEWEST:
                return None
            sizes = [n for n in SIZES if n < room] + [room]
            spans = [(begin - n, begin) if side < 0 else (begin, begin + n) for n in sizes]
            good = [s for s in spans if well(polynomial(piece.part(*s), numbers).chi2, s[1] - s[0] - numbers)]
            if good:
                break
        lo, hi = good[-1] if good else spans[0]
        beside = polynomial(piece.part(lo, hi), numbers + 1)
        met = crossing(mine, beside, 0.5 * float(piece.t[border - 1] + piece.t[border]))
        if met is None or not piece.t[min(part.i, lo)] < met < piece.t[max(part.j, hi) - 1]:
            return None
        at, before, border = met, border, int(np.searchsorted(piece.t, met))
        if border == before:
            break
    beside = replace(beside, root=scatter_factor(beside.chi2, hi - lo - numbers - 1) * beside.root)
    push = pushed(mine, beside, at) if side > 0 else pushed(beside, mine, at)
    turn = 2.0 * abs(mine.curve(at) - beside.curve(at)) * piece.step  # that it makes without one, in a sample
    sharp = abs(mine.slope(at) - beside.slope(at)) > turn
    return Beside(("support", 2 * k + side), beside, at, "support") if push and sharp else None
