"""The likeliest path of a ball through the candidates of a film's frames, and the probability of each of its rows.

The logarithm of a path's likelihood over that of chance is a sum over its steps from candidate to candidate,

    sum  log(A / clutter) + log t(second difference) + log t(streak) + log t(size) + log t(contrast) + shape,

t Student's distribution with two degrees of freedom: an impact costs once. Frames without a candidate, beginnings and
ends have their price. Viterbi's recursion over pairs of candidates (a step knows the velocity) gives the best path,
the same from the other end the best that each candidate is on: its max-marginal. Against the best path without it,
that is the row's probability.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from jumpvision.base.arrays import Array

Ints = NDArray[np.int64]
NONE = -1e30


@dataclass(frozen=True)
class Score:
    """What the likelihood of a path is made of; logarithms in nats.

    area: of the frame [px^2]. clutter: candidates a frame that move and are not the ball.
    """

    area: float
    clutter: float = 1.0
    gap: int = 6  # frames that a step may lead over: longer, its velocity tells nothing
    fastest: float = 15.0  # diameters a frame: no ball flies farther
    ax: float = 0.0  # px/frame^2: acceleration that the steps have in common, where it is known
    ay: float = 0.0
    bend: float = 0.25  # of the speed, change of velocity in a frame: gravity in films of throws
    jitter: float = 0.10  # diameters: scatter of a candidate's centre and of slow motion
    rest: float = 0.05  # diameters a step: scatter of a thing that stands and is not the ball
    start: float = 1.0  # diameters a frame: speed of a ball whose motion is not known
    streak: float = 0.3  # diameters: scatter of a candidate's length along its motion
    size: float = 0.12  # of the logarithm of the diameter, from candidate to candidate
    contrast: float = 0.25  # of that of the contrast
    shape: float = 0.06  # of the part of an ellipse that a ball's outline fills
    hidden: float = -2.5  # a frame within a step in which the ball is not found
    enter: float = -9.0  # the ball comes in
    leave: float = -3.0  # the ball goes
    still: float = -9.0  # a spot that the scene shows in frames where the ball is elsewhere


class Nodes(NamedTuple):
    """Candidates (n,) of a film, in the order of frames, see `candidates.Spots`; own: logarithm of what speaks for each
    alone."""

    frame: Ints
    x: Array
    y: Array
    d: Array
    contrast: Array
    wx: Array
    wy: Array
    own: Array


class Path(NamedTuple):
    """node: (frames,) candidate of each frame, -1 where none is; probability: (frames,) of that; other: the candidate
    that the best path without it takes, -1 none; gain: logarithm of the likelihood of the whole."""

    node: Ints
    probability: Array
    other: Ints
    gain: float


def best_path(nodes: Nodes, frames: int, s: Score, at_first: bool = False) -> Path:
    """The likeliest path; at_first: one that begins in frame 0."""
    begin = np.searchsorted(nodes.frame, np.arange(frames + 1))
    scales = (s.fastest, s.bend, s.jitter, s.start, s.streak, s.size, s.contrast)
    values = (s.area / s.clutter, *scales, s.hidden, s.ax, s.ay, s.rest)
    node, probability, other, gain = _viterbi(
        nodes.frame, nodes.x, nodes.y, nodes.d, np.log(nodes.contrast), nodes.wx, nodes.wy, nodes.own,
        begin, s.gap, np.array(values), s.enter, s.leave, at_first,
    )  # fmt: skip
    return Path(node, probability, other, gain)


@njit(cache=True)
def _t2(square):  # type: ignore[no-untyped-def]
    """Logarithm of Student's t in two dimensions, two degrees of freedom, over its value in the middle."""
    return -2.0 * np.log1p(0.5 * square)


@njit(cache=True)
def _t1(square):  # type: ignore[no-untyped-def]
    """The same in one dimension."""
    return -1.5 * np.log1p(0.5 * square)


@njit(cache=True)
def _step(a, b, frame, x, y, d, c, wx, wy, v):  # type: ignore[no-untyped-def]
    """What a step from candidate a to b brings without the one before: alike, streak along the way, frames between."""
    gap = frame[b] - frame[a]
    # chance is anywhere, or where it was: what a codec leaves, and what lies about, stands
    chance = 1.0 / v[0]
    if v[11] > 0.0:
        rest, away = v[11] * d[a], (x[b] - x[a]) ** 2 + (y[b] - y[a]) ** 2
        chance += 0.5 * np.exp(-0.5 * away / rest**2) / (2.0 * np.pi * rest**2)
    total = -np.log(chance) + _t1((np.log(d[b] / d[a]) / v[6]) ** 2) + _t1(((c[b] - c[a]) / v[7]) ** 2)
    total += v[8] * (gap - 1)
    vx, vy = (x[b] - x[a]) / gap, (y[b] - y[a]) / gap
    speed, length = np.hypot(vx, vy), np.hypot(wx[b], wy[b])
    if speed > 1e-6:
        along, across = abs(wx[b] * vx + wy[b] * vy) / speed, abs(wx[b] * vy - wy[b] * vx) / speed
    else:
        along, across = length, 0.0
    over = max(0.0, along - speed)
    return total + _t1((over**2 + across**2) / (v[5] * d[b]) ** 2)


@njit(cache=True)
def _turn(o, a, b, frame, x, y, d, v):  # type: ignore[no-untyped-def]
    """Logarithm of the density of b where the step from o to a leads [1/px^2]."""
    before, gap = frame[a] - frame[o], frame[b] - frame[a]
    vx, vy = (x[a] - x[o]) / before, (y[a] - y[o]) / before
    s = (v[3] * d[a] + v[2] * np.hypot(vx, vy)) * 0.5 * gap * (gap + before)
    lift = 0.5 * gap * (gap + before)
    off = (x[b] - x[a] - gap * vx - lift * v[9]) ** 2 + (y[b] - y[a] - gap * vy - lift * v[10]) ** 2
    return _t2(off / s**2) - np.log(2.0 * np.pi * s * s)


@njit(cache=True)
def _first(a, b, frame, x, y, d, v):  # type: ignore[no-untyped-def]
    """The same of the first step."""
    s = v[4] * d[a] * (frame[b] - frame[a])
    return _t2(((x[b] - x[a]) ** 2 + (y[b] - y[a]) ** 2) / s**2) - np.log(2.0 * np.pi * s * s)


@njit(cache=True)
def _viterbi(frame, x, y, d, c, wx, wy, own, begin, gap, v, enter, leave, at_first):  # type: ignore[no-untyped-def]
    frames, n = len(begin) - 1, len(frame)
    # steps, by the candidate that they lead to; the first of each is its beginning
    source, target, at = [0], [0], np.zeros(n + 1, np.int64)
    source.pop()
    target.pop()
    for b in range(n):
        at[b] = len(source)
        source.append(-1)
        target.append(b)
        for a in range(begin[max(0, frame[b] - gap)], begin[frame[b]]):
            far = v[1] * min(d[a], d[b]) * (frame[b] - frame[a])
            if (x[b] - x[a]) ** 2 + (y[b] - y[a]) ** 2 <= far * far and abs(np.log(d[b] / d[a])) < 0.7:
                source.append(a)
                target.append(b)
    at[n] = len(source)
    m = len(source)
    alpha, beta, back = np.full(m, NONE), np.full(m, NONE), np.full(m, -1, np.int64)
    brings = np.zeros(m)
    # gone[t]: best of the frames before t, after which the ball is not there; to[t]: the step that it left by
    gone, to = np.full(frames + 1, NONE), np.full(frames + 1, -1, np.int64)
    gone[0] = NONE if at_first else 0.0
    for t in range(frames):
        for b in range(begin[t], begin[t + 1]):
            first = at[b]
            alpha[first] = gone[t] + enter + own[b]
            if at_first and t == 0:
                alpha[first] = own[b]
            for e in range(first + 1, at[b + 1]):
                a = source[e]
                brings[e] = own[b] + _step(a, b, frame, x, y, d, c, wx, wy, v)
                for f in range(at[a], at[a + 1]):
                    if alpha[f] == NONE:
                        continue
                    o = source[f]
                    turn = _first(a, b, frame, x, y, d, v) if o < 0 else _turn(o, a, b, frame, x, y, d, v)
                    if alpha[f] + turn + brings[e] > alpha[e]:
                        alpha[e], back[e] = alpha[f] + turn + brings[e], f
        gone[t + 1], to[t + 1] = gone[t], to[t]
        for e in range(at[begin[t]], at[begin[t + 1]]):
            if alpha[e] + leave > gone[t + 1]:
                gone[t + 1], to[t + 1] = alpha[e] + leave, e
    come = np.full(frames + 1, NONE)  # best of the frames from t on, the ball not there before
    come[frames] = 0.0
    for t in range(frames - 1, -1, -1):
        for a in range(begin[t], begin[t + 1]):
            for e in range(at[a], at[a + 1]):
                beta[e] = max(beta[e], 0.0 if t == frames - 1 else leave + come[t + 1])
        for b in range(begin[t], begin[t + 1]):
            for e in range(at[b] + 1, at[b + 1]):
                a = source[e]
                for f in range(at[a], at[a + 1]):
                    o = source[f]
                    turn = _first(a, b, frame, x, y, d, v) if o < 0 else _turn(o, a, b, frame, x, y, d, v)
                    beta[f] = max(beta[f], beta[e] + turn + brings[e])
        come[t] = come[t + 1]
        for b in range(begin[t], begin[t + 1]):
            come[t] = max(come[t], enter + own[b] + beta[at[b]])
    best, last = gone[frames], -2
    if best == NONE:
        best = -1e29
    for e in range(at[begin[frames - 1]] if frames else 0, m):
        if alpha[e] > best:
            best, last = alpha[e], e
    chosen = np.full(frames, -1, np.int64)
    if last == -2:
        last = to[frames]
    while last >= 0:
        b = target[last]
        chosen[frame[b]] = b
        last = back[last] if source[last] >= 0 else to[frame[b]]
    most = np.full(n, NONE)
    over = np.full(frames, NONE)
    for e in range(m):
        total, b = alpha[e] + beta[e], target[e]
        most[b] = max(most[b], total)
        if source[e] >= 0:
            for t in range(frame[source[e]] + 1, frame[b]):
                over[t] = max(over[t], total)
    probability, other = np.ones(frames), np.full(frames, -1, np.int64)
    for t in range(frames):
        without = max(over[t], gone[t] + come[t + 1])
        mine = chosen[t]
        for b in range(begin[t], begin[t + 1]):
            if b == mine or most[b] <= without:
                continue
            if mine >= 0 and np.hypot(x[b] - x[mine], y[b] - y[mine]) < 0.3 * d[mine]:
                continue
            without, other[t] = most[b], b
        if mine >= 0:
            probability[t] = 1.0 / (1.0 + np.exp(min(50.0, without - most[mine])))
    return chosen, probability, other, best
