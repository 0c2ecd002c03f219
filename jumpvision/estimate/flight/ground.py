"""Bounces one after the other have a ground in common, and a contact whose time is too short to be seen.

Two parabolas of a bounce cross below the ground where the contact takes a time T: the one goes on down for s, the
other came up for T - s, so that V s - g s^2/2 = U (T - s) - g (T - s)^2/2, V and U their speeds where they cross.
Parabolas, level and T are one least squares: each fit of a flight, and a crossing for each contact.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from .motion import POWER, Motion, Part
from .piece import Line, Piece, crossing, moves, polynomial
from .segments import FLIGHT, NUMBERS, REST
from .spring import well

BRIEF = 0.1  # of the shorter flight beside it: the longest contact that is a bounce
FEW = 2  # samples of one, where flights are short
LONGEST = 0.02  # s, of a contact
MOST = 50  # bounces that are fitted at once
SCATTER = 4.0  # chi^2 for each degree of freedom above which bounces have no ground in common
SURE = 0.01  # of what is known of a crossing: by how much it may miss the ground
TOLD = 0.5  # of what a contact may last unseen: the sigma of its time above which bounces do not tell it
LIVELY = 0.95  # the greatest restitution after which a ball still comes to rest
ROUNDS = 5  # of parabolas and edges until no sample changes sides
FEWEST = 6  # samples of a rest that tells the ground


@dataclass(frozen=True)
class Ground:
    """Of flights that bounce, by part: their parabolas, samples and the first of their train; levels: of their ends
    (part, side) that lie on it. The lines of a train have their sources in common."""

    lines: dict[int, Line] = field(default_factory=dict)
    spans: dict[int, tuple[int, int]] = field(default_factory=dict)
    first: dict[int, int] = field(default_factory=dict)
    levels: dict[tuple[int, int], Line] = field(default_factory=dict)


def ground(motion: Motion, gravity: float) -> Ground:
    """The grounds of a motion's bounces."""
    out = Ground()
    for train in trains(motion):
        settled = rest_behind(motion, train)
        for rest in [settled, None] if settled else [None]:
            if bounced(motion, train, rest, gravity, out):
                break
    return out


def trains(motion: Motion) -> Iterator[list[int]]:
    """Flights that bounce one into the next with nothing, or next to nothing, between them."""
    flying = [k for k, p in enumerate(motion.parts) if p.kind == FLIGHT]
    gaps = [motion.parts[b].i - motion.parts[a].j for a, b in pairwise(flying)]
    least = [min(len(motion.parts[a]), len(motion.parts[b])) for a, b in pairwise(flying)]
    brief = [gap for gap, n in zip(gaps, least) if gap <= max(FEW, BRIEF * n)]
    limit = max(brief, default=0) + FEW
    train = flying[:1]
    for k, gap, n in zip(flying[1:], gaps, least):
        if gap > min(limit, n) or len(train) > MOST or not _bounce(motion, train[-1], k):
            yield train
            train = []
        train.append(k)
    yield train


def _bounce(motion: Motion, a: int, b: int) -> bool:
    """Whether two flights cross, the one on its way down, the other up."""
    first, second = motion.lines[a], motion.lines[b]
    at = crossing(first, second, float(motion.piece.t[motion.parts[b].i]))
    return at is not None and first.slope(at) < 0.0 < second.slope(at)


def rest_behind(motion: Motion, train: list[int]) -> Line | None:
    """The level of the rest on which bounces end, from when on those that drown in noise are over: together they take
    e/(1 - e) times as long as the last that is seen."""
    if len(train) < 2 or train[-1] + 1 >= len(motion.parts):
        return None
    part = motion.parts[train[-1] + 1]
    before, last = (len(motion.parts[k]) for k in train[-2:])
    e = min(last / before, LIVELY)
    begin = part.i + round(last * e / (1.0 - e))
    if part.kind != REST or part.j - begin < FEWEST:
        return None
    return polynomial(motion.piece.part(begin, part.j), 1)


def bounced(motion: Motion, train: list[int], rest: Line | None, gravity: float, out: Ground) -> bool:
    """Whether the bounces of a train have one ground, which is then added to `out`."""
    piece = motion.piece
    parts = [motion.parts[k] for k in train]
    if len(train) - 1 + (rest is not None) < 2:
        return False
    unseen = piece.step * (FEW + max(b.i - a.j for a, b in pairwise(parts)))
    spans, lasts = [(p.i, p.j) for p in parts], 0.0
    for _ in range(ROUNDS):
        free = [polynomial(piece.part(i, j), NUMBERS[FLIGHT], -0.5 * gravity) for i, j in spans]
        found = together(free, [float(piece.t[p.j - 1]) for p in parts], rest, unseen, lasts, gravity)
        if found is None:
            return False
        lines, level, lasts = found
        ends = [
            (n, side) for n in range(len(train)) for side in (-1, 1) if _lands(piece, parts, n, side, lines[n], level)
        ]
        new = [_between(piece, parts[n], n, ends, lines[n], level) for n in range(len(train))]
        if new == spans:
            break
        spans = new
    for k, line, span in zip(train, lines, spans):
        out.lines[k], out.spans[k], out.first[k] = line, span, train[0]
    out.levels.update({(train[n], side): level for n, side in ends})
    return True


def together(
    free: list[Line], borders: list[float], rest: Line | None, unseen: float, lasts: float, gravity: float
) -> tuple[list[Line], Line, float] | None:
    """(parabolas, level, contact time [s]) of parabolas fitted by themselves; None where they have no ground in common.

    unseen [s]: the contact is about as long as this at most, lasts: its last estimate.
    """
    m = len(free)
    rows, right = np.zeros((3 * m + 1, 2 * m + 2)), np.zeros(3 * m + 1)
    for n, line in enumerate(free):
        sure = np.linalg.inv(np.linalg.cholesky(line.cov))
        rows[2 * n : 2 * n + 2, 2 * n : 2 * n + 2] = sure
        right[2 * n : 2 * n + 2] = sure @ line.p
    for n, (a, b) in enumerate(pairwise(free)):
        at = crossing(a, b, borders[n])
        if at is None or not (a.slope(at) < 0.0 < b.slope(at)):
            return None
        by_a, by_b = moves(a, b, at)
        by = np.concatenate([a.row(at) + a.slope(at) * by_a, a.slope(at) * by_b])
        scale = 1.0 / (SURE * math.sqrt(by[:2] @ a.cov @ by[:2] + by[2:] @ b.cov @ by[2:]))
        rows[2 * m + n, 2 * n : 2 * n + 4] = scale * by
        rows[2 * m + n, 2 * m :] = -scale, scale * _depth(-a.slope(at), b.slope(at), lasts, gravity)
        right[2 * m + n] = scale * (by[:2] @ a.p + by[2:] @ b.p - a.at(at))
    rows[3 * m - 1, 2 * m + 1] = 1.0 / unseen
    if rest is not None:
        rows[3 * m, 2 * m] = rest.cov[0, 0] ** -0.5
        right[3 * m] = rows[3 * m, 2 * m] * rest.p[0]
    q, r = np.linalg.qr(rows)
    root = np.linalg.inv(r)
    x = root @ (q.T @ right)
    chi2, dof = float(np.sum((right - rows @ x) ** 2)), m - 2 + (rest is not None)
    sigma = float(np.linalg.norm(root[-1]))
    if sigma > TOLD * unseen or not -POWER * sigma < x[-1] < LONGEST or chi2 > SCATTER * dof + POWER**2:
        return None
    root = root if well(chi2, dof) or not dof else math.sqrt(max(chi2 / dof, 1.0)) * root
    lines = [replace(a, p=x[2 * n : 2 * n + 2], root=root[2 * n : 2 * n + 2], drift=None) for n, a in enumerate(free)]
    return lines, Line(x[-2:-1], 0.0, 0.0, chi2, m, root[-2:-1]), float(x[-1])


def _depth(v: float, u: float, lasts: float, gravity: float) -> float:
    """Of a crossing below the ground for each second of a contact of `lasts` seconds [m/s]: speeds v down, u up."""
    down = (u - 0.5 * gravity * lasts) / (v + u - gravity * lasts)
    return v * down - 0.5 * gravity * lasts * down * down


def _lands(piece: Piece, parts: list[Part], n: int, side: int, line: Line, level: Line) -> bool:
    """Whether an end of a flight is on the ground: between two bounces, or where its parabola goes on to the ground."""
    if 0 <= n + side < len(parts):
        return True
    border = parts[n].i if side < 0 else parts[n].j
    at = crossing(line, level, float(piece.t[min(border, piece.t.size - 1)]))
    if at is None or not piece.t[0] < at < piece.t[-1]:
        return False
    there = int(np.searchsorted(piece.t, at))
    if side * (border - there) > FEW or abs(border - there) > len(parts[n]):
        return False
    lo, hi = min(border, there), max(border, there)
    t = piece.t[lo:hi]
    off = piece.part(lo, hi).white(piece.y[lo:hi] - line.values(t))
    return hi == lo or well(float(off @ off), hi - lo)


def _between(piece: Piece, part: Part, n: int, ends: list[tuple[int, int]], line: Line, level: Line) -> tuple[int, int]:
    """The samples of a flight between those of its edges that lie on the ground."""
    span = [part.i, part.j]
    for k, side in enumerate((-1, 1)):
        if (n, side) in ends:
            at = crossing(line, level, float(piece.t[span[k] - k]))
            span[k] = span[k] if at is None else int(np.searchsorted(piece.t, at))
    return (span[0], span[1]) if span[1] - span[0] >= 2 * NUMBERS[FLIGHT] else (part.i, part.j)
