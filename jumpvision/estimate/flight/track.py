"""Flights from a track: the record as one motion, its flights' parabolas, and where these end."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array

from ..estimate import checked, checked_sigma
from .corner import crossing, moves
from .flights import NAN, Flights
from .piece import Line, Piece, polynomial
from .segments import CURVED, FLIGHT, REST, STRAIGHT, segmented
from .spring import Ring, Sprung, sprung

POWER = 5.0  # sigmas by which the curvature of a flight must exclude none at all
NEAR = 5.0  # sigmas within which it must be that of gravity
ABRUPT = (REST, STRAIGHT, FLIGHT)
ROUNDS = 12  # of fits and crossings until no sample changes sides
SHORT = 3  # samples of a contact that may be none: an impact between two samples


@dataclass(frozen=True)
class Settings:
    """gravity, its sigma [m/s^2]; shortest flight [s]; ring of a foot; lag = c/k [s] of the damper at the spring."""

    gravity: float
    gravity_sigma: float = 0.0
    shortest: float = 0.0
    ring: Ring | None = None
    lag: float = 0.0


@dataclass
class Part:
    """A segment while its ends are sought: samples i .. j of one kind, and its polynomial."""

    kind: int
    i: int
    j: int
    line: Line | None = None


@dataclass
class Edge:
    """An end of a flight: when [s], its variance, what it is, and how it moves with the numbers of parabolas.

    by: {number of the part: d time / d p}.
    """

    time: float
    variance: float
    kind: str
    by: dict[int, Array] = field(default_factory=dict)


NUMBERS = {REST: 1, STRAIGHT: 2, FLIGHT: 2, CURVED: 3}


def parts_of(piece: Piece, gravity: float) -> list[Part]:
    """The piece's segments: pieces of one flight that a stray sample parted are one again."""
    t, y = piece.seen
    found = segmented(t, y, piece.weights, gravity)
    parts = [Part(int(k), int(i), int(j)) for k, i, j in zip(found.kind, found.first, found.first[1:])]
    parts = _joined(piece, parts, gravity)
    return parts


def fitted(piece: Piece, part: Part, gravity: float) -> Line:
    return polynomial(
        piece.part(part.i, part.j), min(NUMBERS[part.kind], part.j - part.i), -0.5 * gravity if part.kind == FLIGHT else 0.0
    )


def _joined(piece: Piece, parts: list[Part], gravity: float) -> list[Part]:
    """Two segments of one kind and one curve on both sides of at most SHORT stray samples are one."""
    out: list[Part] = []
    price = math.log(max(piece.t.size, 2))
    for part in parts:
        out.append(part)
        while len(out) > 1:
            for back in (2, 3):
                if len(out) < back or out[-back].kind != part.kind or part.kind == CURVED:
                    continue
                between = out[-2].j - out[-2].i if back == 3 else 0
                if between > SHORT:
                    continue
                a, b = out[-back], out[-1]
                whole = Part(part.kind, a.i, b.j)
                chi2 = sum(fitted(piece, p, gravity).chi2 for p in (a, b))
                numbers = NUMBERS[part.kind] + 1 + (min(between, 3) + 1 if between else 0)
                if fitted(piece, whole, gravity).chi2 - chi2 <= price * numbers + 9.0 * between:
                    out[-back:] = [whole]
                    part = whole
                    break
            else:
                break
    return out


def settled(piece: Piece, parts: list[Part], gravity: float) -> dict[int, float]:
    """{number of a part: time at which its curve meets the next part's}, of all that are abrupt; parts are moved to it.

    The sample at which a curve ends follows from where it meets the next, and the curve from its samples: by turns
    until neither moves. No corner: curves that do not meet near their samples, or without a push upwards.
    """
    for part in parts:
        part.line = fitted(piece, part, gravity)
    pairs = [k for k in range(len(parts) - 1) if _abrupt(parts[k], parts[k + 1])]
    before = {k: (parts[k].j, _both(parts, k)) for k in pairs}
    corners: dict[int, float] = {}
    for _ in range(ROUNDS):
        touched = set()
        for k in pairs:
            at = _corner(piece, parts[k], parts[k + 1])
            corners.pop(k, None)
            if at is None:
                continue
            corners[k] = at
            lowest, highest = parts[k].i + NUMBERS[parts[k].kind] + 1, parts[k + 1].j - NUMBERS[parts[k + 1].kind] - 1
            new = int(np.clip(np.searchsorted(piece.t, at), lowest, max(lowest, highest)))
            if new != parts[k].j and lowest <= highest:
                parts[k].j = parts[k + 1].i = new
                touched |= {k, k + 1}
        for k in touched:
            parts[k].line = fitted(piece, parts[k], gravity)
        if not touched:
            break
    price = math.log(max(piece.t.size, 2))
    for k in pairs:
        if k in corners and _both(parts, k) - before[k][1] <= 3.0 * price:
            continue
        corners.pop(k, None)
        parts[k].j = parts[k + 1].i = before[k][0]
        for part in parts[k : k + 2]:
            part.line = fitted(piece, part, gravity)
    return corners


def _abrupt(a: Part, b: Part) -> bool:
    return FLIGHT in (a.kind, b.kind) and a.kind in ABRUPT and b.kind in ABRUPT


def _both(parts: list[Part], k: int) -> float:
    return sum(p.line.chi2 for p in parts[k : k + 2] if p.line)


def _corner(piece: Piece, a: Part, b: Part) -> float | None:
    """Where two curves meet with a push upwards, within reach of the samples between them."""
    assert a.line and b.line
    edge = 0.5 * (piece.t[a.j - 1] + piece.t[min(b.i, piece.t.size - 1)])
    at = crossing(a.line, b.line, edge)
    if at is None or not piece.t[a.i] < at < piece.t[b.j - 1]:
        return None
    return at if b.line.slope(at) > a.line.slope(at) else None


def without_touches(piece: Piece, parts: list[Part], gravity: float) -> list[Part]:
    """Contacts between a flight and what is abrupt, taken out where two curves that meet explain the samples as well:
    the impact was between two of them."""
    out, k = list(parts), 1
    price = math.log(max(piece.t.size, 2))
    while k < len(out) - 1:
        a, b, c = out[k - 1 : k + 2]
        if b.kind in (FLIGHT, REST) or not _abrupt(a, c):
            k += 1
            continue
        own = [fitted(piece, p, gravity) for p in (a, b, c)]
        spent = own[0].chi2 + own[2].chi2 + (0.0 if b.j - b.i <= SHORT else own[1].chi2)
        at = crossing(own[0], own[2], float(np.mean(piece.t[b.i : b.j])))
        if at is not None:
            m = int(np.clip(np.searchsorted(piece.t, at), b.i, b.j))
            joined = [Part(a.kind, a.i, m), Part(c.kind, m, c.j)]
            chi2 = sum(fitted(piece, p, gravity).chi2 for p in joined)
            if chi2 - spent <= price * (min(b.j - b.i, 3) + 1) and own[2].slope(at) > own[0].slope(at):
                out[k - 1 : k + 2] = joined
                continue
        k += 1
    return out


@dataclass
class Found:
    """A flight with its edges (None: outside the record), curvature [m/s^2] and its sigma."""

    number: int
    edges: tuple[Edge | None, Edge | None]
    curvature: tuple[float, float]
    covariances: dict[int, Array] = field(default_factory=dict)


def flights_in(piece: Piece, how: Settings) -> list[tuple[list[Part], Found]]:
    """The flights of a piece, each with the parts of the whole motion."""
    if piece.t.size < 6:
        return []
    parts = without_touches(piece, parts_of(piece, how.gravity), how.gravity)
    corners = settled(piece, parts, how.gravity)
    out = []
    for k, part in enumerate(parts):
        if part.kind == FLIGHT and flies(piece, part, how):
            found = ends(piece, parts, k, corners, how)
            if found is not None:
                out.append((parts, found))
    return out


def flies(piece: Piece, part: Part, how: Settings) -> bool:
    """Whether a part's own curvature excludes none at all and agrees with gravity's."""
    if part.j - part.i < 4:
        return False
    bend, sigma = curvature(piece, part.i, part.j)
    near = NEAR * math.hypot(sigma, how.gravity_sigma)
    return -bend > POWER * sigma and abs(bend + how.gravity) < near


def curvature(piece: Piece, i: int, j: int) -> tuple[float, float]:
    line = polynomial(piece.part(i, j), 3)
    return 2.0 * float(line.p[2]), 2.0 * math.sqrt(float(line.cov[2, 2]))


def ends(piece: Piece, parts: list[Part], k: int, corners: dict[int, float], how: Settings) -> Found | None:
    """Both edges of the flight parts[k]."""
    part = parts[k]
    assert part.line is not None
    gradual = tuple(
        side for side, other in ((-1, k - 1), (1, k)) if 0 <= other < len(parts) - 1 and other not in corners
    )
    line, cov, times = part.line, part.line.cov, {}
    fit: Sprung | None = None
    if gradual:
        reach = turning(piece, parts, k, -1), turning(piece, parts, k, 1)
        fit = sprung(piece, (part.i, part.j), reach, gradual, how.gravity, how.gravity_sigma, how.lag, how.ring)
        if fit is not None:
            line = Line(fit.p[:2], fit.cov[:2, :2], fit.origin, -0.5 * fit.curvature[0], fit.chi2, fit.n)
            cov = fit.cov
            times = {side: (fit.times[n], fit.p.size + n) for n, side in enumerate(gradual)}
    edges = []
    for side, other, neighbour in ((-1, k - 1, k - 1), (1, k, k + 1)):
        if side in gradual:
            edges.append(_gradual(piece, part, side, times, cov, fit, k))
        elif other in corners:
            edges.append(_abrupt_edge(parts, line, k, neighbour, corners[other], cov))
        else:
            edges.append(None)
    found = Found(k, (edges[0], edges[1]), curvature(piece, part.i, part.j), {k: cov})
    for e in edges:
        for n in e.by if e else ():
            if n != k:
                found.covariances[n] = parts[n].line.cov  # type: ignore[union-attr]
    return found


def _gradual(
    piece: Piece, part: Part, side: int, times: dict[int, tuple[float, int]], cov: Array, fit: Sprung | None, k: int
) -> Edge:
    if side not in times:
        n = part.i if side < 0 else part.j
        return Edge(0.5 * float(piece.t[n - 1] + piece.t[n]), piece.step**2, "contact")
    time, n = times[side]
    assert fit is not None
    by = np.zeros(len(cov))
    by[n] = 1.0
    edge = Edge(float(time), float(cov[n, n]), "spring" if fit.good else "contact", {k: by})
    if not fit.good and edge.variance < piece.step**2:  # no spring-like landing: good to a frame at best
        return Edge(edge.time, piece.step**2, "contact")
    return edge


def _abrupt_edge(parts: list[Part], line: Line, k: int, neighbour: int, near: float, cov: Array) -> Edge:
    other = parts[neighbour].line
    assert other is not None
    at = crossing(line, other, near)
    at = near if at is None else at
    mine, theirs = moves(line, other, at)
    by = np.zeros(len(cov))
    by[: mine.size] = mine
    variance = float(by @ cov @ by + theirs @ other.cov @ theirs)
    kind = "impact" if parts[neighbour].kind == FLIGHT else "rest" if parts[neighbour].kind == REST else "support"
    return Edge(at, variance, kind, {k: by, neighbour: theirs})


def turning(piece: Piece, parts: list[Part], k: int, side: int) -> int:
    """The sample at which the contact beside a flight has turned: where the smooth path comes back, or the next flight."""
    m = k
    while True:
        m += side
        if not 0 <= m < len(parts):
            return 0 if side < 0 else piece.t.size
        part = parts[m]
        if part.kind == FLIGHT:
            return part.j if side < 0 else part.i
        line = part.line
        assert line is not None
        for n in range(part.i, part.j) if side > 0 else range(part.j - 1, part.i - 1, -1):
            if side * line.slope(float(piece.t[n])) >= 0.0:
                return n + (side < 0)


def track_flights(
    t: ArrayLike,
    h: ArrayLike,
    sigma: ArrayLike,
    *,
    gravity: float,
    shortest: float,
    max_gap: float,
    ripple: float = 0.0,
    gravity_sigma: float = 0.0,
    lag: float = 0.0,
    ring: Ring | None = None,
) -> Flights:
    """Flights from the track."""
    t, h, sigma = checked("track_flights", t=t, h=h, sigma=sigma)
    checked_sigma("track_flights", sigma)
    if not gravity > 0.0:
        raise ValueError(f"track_flights: gravity = {gravity!r} m/s^2 must be > 0 (along the rail)")
    good = np.isfinite(t) & np.isfinite(h) & np.isfinite(sigma)
    t, h, sigma = t[good], h[good], np.hypot(sigma[good], ripple / math.sqrt(2.0))
    if np.any(np.diff(t) <= 0.0):
        raise ValueError("track_flights: t must increase from sample to sample")
    how = Settings(gravity, gravity_sigma, shortest, ring, lag)
    found = []
    for i, j in pieces(t, max_gap):
        piece = Piece(t[i:j], h[i:j], sigma[i:j])
        found += [(piece, parts, f) for parts, f in flights_in(piece, how) if lasts(piece, parts, f, how)]
    return collected(found)


def lasts(piece: Piece, parts: list[Part], found: Found, how: Settings) -> bool:
    begin, end = (e.time if e else None for e in found.edges)
    part = parts[found.number]
    begin = piece.t[part.i] if begin is None else begin
    end = piece.t[part.j - 1] if end is None else end
    return end - begin >= how.shortest


def pieces(t: Array, max_gap: float) -> Iterator[tuple[int, int]]:
    cuts = [0, *(np.flatnonzero(np.diff(t) > max_gap) + 1).tolist(), t.size]
    return zip(cuts, cuts[1:])


def _dot(a: Edge | None, b: Edge | None, cov: dict[int, Array]) -> float:
    if a is None or b is None:
        return 0.0
    return sum(float(a.by[n] @ cov[n] @ b.by[n]) for n in a.by if n in b.by and a.by[n].size == b.by[n].size)


def collected(found: list[tuple[Piece, list[Part], Found]]) -> Flights:
    rows, covariance, shared = [], [], np.zeros((len(found), 2))
    for a, (_, parts, f) in enumerate(found):
        up, down = f.edges
        rows.append(
            [
                up.time if up else NAN,
                math.sqrt(up.variance) if up else NAN,
                down.time if down else NAN,
                math.sqrt(down.variance) if down else NAN,
            ]
        )
        covariance.append(_dot(up, down, f.covariances))
        for lag in (1, 2):
            if a + lag < len(found) and found[a + lag][1] is parts:
                other = found[a + lag][2]
                cov = f.covariances | other.covariances
                (u, d), (v, e) = f.edges, other.edges
                shared[a, lag - 1] = _dot(d, e, cov) - _dot(d, v, cov) - _dot(u, e, cov) + _dot(u, v, cov)
    table = np.array(rows, dtype=float).reshape(-1, 4)
    bends = np.array([f.curvature for *_, f in found], dtype=float).reshape(-1, 2)
    kinds = tuple(tuple(e.kind if e else "" for e in f.edges) for *_, f in found)
    return Flights(
        *(table[:, c].copy() for c in range(4)),
        covariance=np.array(covariance),
        shared=shared,
        curvature=bends[:, 0].copy(),
        curvature_sigma=bends[:, 1].copy(),
        kinds=kinds,  # type: ignore[arg-type]
    )


def in_flight(t: Array, h: Array, sigma: Array, *, gravity: float) -> list[tuple[int, int]]:
    """(first, one past the last) sample of every stretch in which h is a parabola of curvature -gravity."""
    if t.size < 6:
        return []
    piece, how = Piece(t, h, sigma), Settings(gravity)
    parts = without_touches(piece, parts_of(piece, gravity), gravity)
    return [(p.i, p.j) for p in parts if p.kind == FLIGHT and flies(piece, p, how)]
