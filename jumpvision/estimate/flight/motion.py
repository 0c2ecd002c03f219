"""A piece of a record as parts of one motion: stray samples out, touching curves joined, each cut where they meet."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .piece import Line, Piece, crossing, polynomial
from .segments import CURVED, FLIGHT, NUMBERS, REST, STRAIGHT, segmented

ABRUPT = (REST, STRAIGHT, FLIGHT)
POWER = 5.0  # sigmas of what is no accident
STRAY = 8  # samples in a row that may be off the curve on both sides of them
AROUND = 64  # samples beside a stray one that tell whether their curve goes on
TOUCH = 3  # samples of a rest that may be none
ROUNDS = 12  # of fits and crossings until no sample changes sides
SLACK = 3.0  # log n that chi^2 may rise where two curves are made to meet


@dataclass(frozen=True)
class Part:
    """Samples i .. j of one kind of motion."""

    kind: int
    i: int
    j: int

    def __len__(self) -> int:
        return self.j - self.i

    def line(self, piece: Piece, gravity: float) -> Line:
        """Its curve."""
        bend = -0.5 * gravity if self.kind == FLIGHT else 0.0
        return polynomial(piece.part(self.i, self.j), min(NUMBERS[self.kind], len(self)), bend)


@dataclass(frozen=True)
class Motion:
    """piece: without stray samples. parts: in order, all of it; lines: their curves; corners: {k: time at which part k
    meets part k + 1}, of the ends that are abrupt."""

    piece: Piece
    parts: list[Part]
    lines: list[Line]
    corners: dict[int, float]


def parts_of(piece: Piece, gravity: float) -> tuple[Piece, list[Part]]:
    """The piece without stray samples, and its segments, those of one curve joined."""
    while True:
        t, y = piece.whitened
        first, kind = segmented(t, y, piece.weights, gravity)
        parts = [Part(int(k), int(i), int(j)) for k, i, j in zip(kind, first, first[1:])]
        stray = strays(piece, parts, gravity)
        if not stray.any():
            return piece, joined(piece, parts, gravity)
        piece = piece.of(np.flatnonzero(~stray))


def motion(piece: Piece, gravity: float) -> Motion:
    """The piece as one motion, cut where its curves meet."""
    piece, parts = parts_of(piece, gravity)
    parts = [p if falls(piece, p, gravity) else replace(p, kind=CURVED) for p in parts]
    return settled(piece, without_touches(piece, parts, gravity), gravity)


def falls(piece: Piece, part: Part, gravity: float) -> bool:
    """Whether a part that is called a flight bends as one by itself: not by few samples that any curve may take."""
    if part.kind != FLIGHT:
        return True
    bend, sigma = curvature(piece, part.i, part.j)
    return -bend > POWER * sigma


def price(piece: Piece) -> float:
    """Of a number that is fitted, in chi^2: log n."""
    return math.log(max(piece.t.size, 2))


def strays(piece: Piece, parts: list[Part], gravity: float) -> NDArray[np.bool_]:
    """(n,): samples beside a curve that goes on behind them as if they were not there: at most STRAY in a row."""
    out = np.zeros(piece.t.size, bool)
    for k, a in enumerate(parts):
        if len(a) <= 2 * NUMBERS[a.kind]:
            continue
        m = k + 1
        while m < len(parts) - 1 and parts[m].j - a.j <= STRAY and parts[m].kind != FLIGHT:
            m += 1
            c = parts[m]
            if c.kind == a.kind and len(c) > 2 * NUMBERS[a.kind] and _goes_on(piece, a, c, gravity):
                out[a.j : c.i] = True
                break
    return out


def _goes_on(piece: Piece, a: Part, c: Part, gravity: float) -> bool:
    near = replace(a, i=max(a.i, a.j - AROUND)), replace(c, j=min(c.j, c.i + AROUND))
    both = np.r_[near[0].i : near[0].j, near[1].i : near[1].j]
    whole = polynomial(piece.of(both), NUMBERS[a.kind], -0.5 * gravity if a.kind == FLIGHT else 0.0)
    apart = sum(p.line(piece, gravity).chi2 for p in near)
    return whole.chi2 - apart <= price(piece) * (NUMBERS[a.kind] + 1)


def joined(piece: Piece, parts: list[Part], gravity: float) -> list[Part]:
    """Neighbours of one kind on one curve are one, and so are two flights without a push upwards between them."""
    out: list[Part] = []
    for part in parts:
        out.append(part)
        while len(out) > 1 and out[-1].kind == out[-2].kind != CURVED and _one(piece, out[-2], out[-1], gravity):
            out[-2:] = [replace(out[-2], j=out[-1].j)]
    return out


def _one(piece: Piece, a: Part, b: Part, gravity: float) -> bool:
    first, second = a.line(piece, gravity), b.line(piece, gravity)
    whole = replace(a, j=b.j).line(piece, gravity)
    if whole.chi2 - first.chi2 - second.chi2 <= price(piece) * (NUMBERS[a.kind] + 1):
        return True
    return a.kind == FLIGHT and not pushed(first, second, float(piece.t[b.i]))


def pushed(first: Line, second: Line, at: float) -> bool:
    """Whether a motion goes on upwards faster than it came, by POWER sigmas."""
    push = second.slope(at) - first.slope(at)
    return push > POWER * math.hypot(first.slope_sigma(at), second.slope_sigma(at))


def abrupt(a: Part, b: Part) -> bool:
    """Whether two parts may meet at an angle: a flight and what is a curve of few numbers."""
    return FLIGHT in (a.kind, b.kind) and a.kind in ABRUPT and b.kind in ABRUPT


def without_touches(piece: Piece, parts: list[Part], gravity: float) -> list[Part]:
    """Contacts between a flight and what is abrupt, taken out where two curves that meet explain the samples as well:
    the impact was between two of them."""
    out, k = list(parts), 1
    while k < len(out) - 1:
        a, b, c = out[k - 1 : k + 2]
        if b.kind != FLIGHT and (b.kind != REST or len(b) <= TOUCH) and abrupt(a, c):
            meeting = _met(piece, a, b, c, gravity)
            if meeting is not None:
                out[k - 1 : k + 2] = meeting
                continue
        k += 1
    return out


def _met(piece: Piece, a: Part, b: Part, c: Part, gravity: float) -> list[Part] | None:
    first, between, last = (p.line(piece, gravity) for p in (a, b, c))
    at = crossing(first, last, float(np.mean(piece.t[b.i : b.j])))
    if at is None or not pushed(first, last, at):
        return None
    m = int(np.clip(np.searchsorted(piece.t, at), b.i, b.j))
    meeting = [replace(a, j=m), replace(c, i=m)]
    more = sum(p.line(piece, gravity).chi2 for p in meeting) - first.chi2 - between.chi2 - last.chi2
    return meeting if more <= price(piece) * (min(len(b), NUMBERS[b.kind]) + 1) else None


def settled(piece: Piece, parts: list[Part], gravity: float) -> Motion:
    """The sample at which a curve ends follows from where it meets the next, and the curve from its samples: by turns
    until neither moves. No corner: curves that do not meet near their samples, or without a push upwards."""
    parts = list(parts)
    lines = [p.line(piece, gravity) for p in parts]
    pairs = [k for k in range(len(parts) - 1) if abrupt(parts[k], parts[k + 1])]
    before = {k: (parts[k].j, lines[k].chi2 + lines[k + 1].chi2) for k in pairs}
    corners: dict[int, float] = {}
    for _ in range(ROUNDS):
        corners = {k: at for k in pairs if (at := _corner(piece, parts, lines, k)) is not None}
        touched = {n for k, at in corners.items() for n in _moved(piece, parts, k, at)}
        for n in touched:
            lines[n] = parts[n].line(piece, gravity)
        if not touched:
            break
    for k in pairs:
        if k in corners and lines[k].chi2 + lines[k + 1].chi2 - before[k][1] <= SLACK * price(piece):
            continue
        corners.pop(k, None)
        border = min(max(before[k][0], parts[k].i + 1), parts[k + 1].j - 1)
        parts[k], parts[k + 1] = replace(parts[k], j=border), replace(parts[k + 1], i=border)
        lines[k : k + 2] = [p.line(piece, gravity) for p in parts[k : k + 2]]
    return Motion(piece, parts, lines, corners)


def _moved(piece: Piece, parts: list[Part], k: int, at: float) -> tuple[int, ...]:
    """The parts whose samples change as their corner lies at this time; parts is changed."""
    a, b = parts[k], parts[k + 1]
    lowest, highest = a.i + NUMBERS[a.kind] + 1, b.j - NUMBERS[b.kind] - 1
    new = int(np.clip(np.searchsorted(piece.t, at), lowest, max(lowest, highest)))
    if new == a.j or lowest > highest:
        return ()
    parts[k], parts[k + 1] = replace(a, j=new), replace(b, i=new)
    return k, k + 1


def _corner(piece: Piece, parts: list[Part], lines: list[Line], k: int) -> float | None:
    """Where two curves meet with a push upwards, within reach of the samples beside their border."""
    a, b = parts[k], parts[k + 1]
    at = crossing(lines[k], lines[k + 1], 0.5 * float(piece.t[b.i - 1] + piece.t[b.i]))
    if at is None or not piece.t[a.i] < at < piece.t[b.j - 1]:
        return None
    return at if lines[k + 1].slope(at) > lines[k].slope(at) else None


def turning(motion: Motion, k: int, side: int) -> int:
    """The sample at which what is beside the flight k has turned: its path comes back, or the next flight begins."""
    piece, m = motion.piece, k
    while True:
        m += side
        if not 0 <= m < len(motion.parts):
            return 0 if side < 0 else piece.t.size
        part, line = motion.parts[m], motion.lines[m]
        if part.kind == FLIGHT:
            return part.j if side < 0 else part.i
        if part.kind == REST and len(part) <= TOUCH:
            continue
        if part.kind == REST:  # of a contact's turn, if it is one
            return part.i + len(part) // 2
        back = np.flatnonzero(side * line.slopes(piece.t[part.i : part.j]) >= 0.0)
        if back.size:
            return part.i + int(back[0] if side > 0 else back[-1] + 1)


def curvature(piece: Piece, i: int, j: int) -> tuple[float, float]:
    """(curvature [m/s^2] of samples i .. j, fitted freely, its standard uncertainty)."""
    line = polynomial(piece.part(i, j), 3)
    return 2.0 * float(line.p[2]), 2.0 * math.sqrt(float(line.cov[2, 2]))


def calm(parts: list[Part], fewest: int) -> list[Part]:
    """Parts that tell noise: long ones, less their ends, which may hang over into what follows."""
    out = []
    for p in parts:
        cut = len(p) // 8 if p.kind != REST else 0
        if len(p) - 2 * cut >= (fewest if p.kind != CURVED else 2 * fewest):
            out.append(replace(p, i=p.i + cut, j=p.j - cut))
    return out
