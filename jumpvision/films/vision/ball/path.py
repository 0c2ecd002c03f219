"""The likeliest path of a ball through the candidates of a film's frames, and the probability of each of its rows.

The logarithm of a path's likelihood over that of chance is a sum over its steps from candidate to candidate,

    sum  log(A / clutter) + log t(second difference) + log t(streak) + log t(size) + log t(contrast) + shape,

t Student's distribution with two degrees of freedom: an impact costs once. Frames without a candidate, beginnings and
ends have their price. Viterbi's recursion over pairs of candidates (a step knows the velocity) gives the best path,
the same from the other end the best that each candidate is on: its max-marginal. Against the best path without it,
that is the row's probability.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from jumpvision.base.arrays import Array

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
NONE = -1e30
BARRED = -1e6  # of a candidate that another path has
OTHERS = 3  # paths of other things that are looked for
OTHER_GAIN = 12.0  # nats that one of these is above chance


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
    calm: float = 0.04  # the same, beyond a constant acceleration, where a whole path is judged
    shake: float = 0.02  # diameters a frame: change of velocity that has no reason
    rest: float = 0.05  # diameters a step: scatter of a thing that stands and is not the ball
    start: float = 1.0  # diameters a frame: speed of a ball whose motion is not known
    streak: float = 0.3  # diameters: scatter of a candidate's length along its motion
    size: float = 0.12  # of the logarithm of the diameter, from candidate to candidate
    contrast: float = 0.25  # of that of the contrast
    shape: float = 0.06  # of the part of an ellipse that a ball's outline fills
    hidden: float = -2.5  # a frame within a step in which the ball is not found
    enter: float = -9.0  # the ball comes in
    leave: float = -6.0  # the ball goes
    impact: float = -5.0  # its velocity is new
    still: float = -20.0  # a spot that the scene shows in frames where the ball is elsewhere


class Nodes(NamedTuple):
    """Candidates (n,) of a film, in the order of frames, see `candidates.Spots`; s: scatter of each place [px]."""

    frame: Ints
    x: Array
    y: Array
    d: Array
    contrast: Array
    wx: Array
    wy: Array
    s: Array


class Path(NamedTuple):
    """The path of one thing.

    node: (frames,) candidate of each frame, -1 where none is. probability: (frames,) of that among all paths of this
    one; other: the candidate that the best path without it takes, -1 none. gain: logarithm of the likelihood of the
    whole; through: (n,) of the best path through each candidate. exchanged: (frames,) likelihood that another thing has
    it from that frame or an earlier one on, over that it has not.
    """

    node: Ints
    probability: Array
    other: Ints
    gain: float
    through: Array
    exchanged: Array


@dataclass(frozen=True)
class Claim:
    """A thing that has a path. own: (n,) logarithm of what speaks for each candidate as this one; at_first: it is there
    in the first frame; known: what the same looks bring over chance, in each row, and over another ball where it comes
    in."""

    own: Array
    score: Score
    at_first: bool = False
    known: float = 0.0


def best_path(nodes: Nodes, frames: int, claim: Claim, taken: Bools | None = None) -> Path:
    """Return the likeliest path of a claim. taken: (n,) candidates that other paths have."""
    own = claim.own + claim.known
    claim = replace(claim, own=own if taken is None else np.where(taken, BARRED, own))
    begin = np.searchsorted(nodes.frame, np.arange(frames + 1))
    node, probability, other, gain, through = _viterbi(_columns(nodes), _values(claim), begin)
    return Path(node, probability, other, gain, through, np.zeros(frames))


def joint_paths(nodes: Nodes, frames: int, claims: Sequence[Claim], free: Claim) -> list[Path]:
    """Return the likeliest path of each claim; no two paths have a candidate in common.

    Each in turn, then the ends of any two exchanged while that makes both together likelier. free: any other.
    """
    everyone, paths = list(claims), [best_path(nodes, frames, claims[0])]
    for claim in claims[1:]:
        paths.append(best_path(nodes, frames, claim, _on_paths(nodes, [p.node for p in paths])))
    for _ in range(OTHERS):
        other = best_path(nodes, frames, free, _on_paths(nodes, [p.node for p in paths]))
        if other.gain < OTHER_GAIN:
            break
        paths.append(other)
        everyone.append(free)
    if len(paths) == 1:
        return paths
    at = [p.node for p in paths]
    pairs = [(i, j) for j in range(len(at)) for i in range(j)]
    while True:
        tried = [
            _best_exchange(_columns(nodes), _values(everyone[i]), _values(everyone[j]), at[i], at[j]) for i, j in pairs
        ]
        (i, j), (gain, t, _) = max(zip(pairs, tried), key=lambda one: one[1][0])
        if gain < 1e-6:
            break
        at[i][t:], at[j][t:] = at[j][t:].copy(), at[i][t:].copy()
    out = []
    for k, claim in enumerate(claims):
        if not claim.at_first:  # the likeliest of those that no other claims
            others = [k, *range(len(claims), len(at))]
            best = max(others, key=lambda m: float(_log_likelihood(_columns(nodes), _values(claim), at[m])))
            at[k], at[best] = at[best], at[k]
        rest = [at[m] for m in range(len(at)) if m != k]
        path = best_path(nodes, frames, claim, _on_paths(nodes, rest))
        lost = np.zeros(frames)  # likelihood of the best exchange over what stands
        for (i, j), (*_, most) in zip(pairs, tried):
            if k in (i, j):
                lost = np.maximum(lost, np.exp(np.minimum(most, 0.0)))
        if not claim.at_first and len(at) > len(claims):  # which of them it is
            gains = [_log_likelihood(_columns(nodes), _values(claim), node) for node in [path.node, *at[len(claims) :]]]
            lost = np.maximum(lost, np.exp(min(0.0, max(gains[1:]) - gains[0])))
        out.append(path._replace(exchanged=lost))
    return out


def _columns(nodes: Nodes) -> tuple[Array | Ints, ...]:
    return (nodes.frame, nodes.x, nodes.y, nodes.d, np.log(nodes.contrast), nodes.wx, nodes.wy, nodes.s)


def _values(claim: Claim) -> tuple[Array, Array, float, float, bool, float]:
    """Return the numbers that the recursions take of a claim."""
    s = claim.score
    scales = (s.fastest, s.bend, s.shake, s.start, s.streak, s.size, s.contrast)
    values = np.array((s.area / s.clutter, *scales, s.hidden, s.ax, s.ay, s.rest, float(s.gap), s.calm, s.impact))
    return claim.own, values, s.enter, s.leave, claim.at_first, claim.known


def _on_paths(nodes: Nodes, paths: Sequence[Ints]) -> Bools:
    """Return (n,) True for candidates on one of the paths, or at the place of one that is."""
    out = np.zeros(nodes.x.size, bool)
    for path in paths:
        k = path[path >= 0]
        at = np.full(int(nodes.frame[-1]) + 1 if nodes.frame.size else 0, -1)
        at[nodes.frame[k]] = k
        mine = at[nodes.frame]
        out |= (mine >= 0) & (np.hypot(nodes.x - nodes.x[mine], nodes.y - nodes.y[mine]) < 0.4 * nodes.d)
    return out


@njit(cache=True)
def _t2(square):  # type: ignore[no-untyped-def]
    """Return the logarithm of Student's t in two dimensions, two degrees of freedom, over its maximum."""
    return -2.0 * np.log1p(0.5 * square)


@njit(cache=True)
def _t1(square):  # type: ignore[no-untyped-def]
    """Return the logarithm of Student's t in one dimension, two degrees of freedom, over its maximum."""
    return -1.5 * np.log1p(0.5 * square)


@njit(cache=True)
def _step(a, b, frame, x, y, d, c, wx, wy, v):  # type: ignore[no-untyped-def]
    """Return the log-likelihood of a step from candidate a to b, but for its place: looks, streak, hidden frames."""
    gap = frame[b] - frame[a]
    # chance is anywhere, or where it was: what a codec leaves, and what lies about, stands
    chance = 1.0 / v[0]
    if v[11] > 0.0:
        rest, away = v[11] * d[a], (x[b] - x[a]) ** 2 + (y[b] - y[a]) ** 2
        chance += 0.5 * np.exp(-0.5 * away / rest**2) / (2.0 * np.pi * rest**2)
    total = -np.log(chance) + _t1((np.log(d[b] / d[a]) / v[6]) ** 2) + _t1(((c[b] - c[a]) / v[7]) ** 2)
    total += v[8] * (1.0 + 0.2 * (gap - 2)) if gap > 1 else 0.0  # what is hidden stays so
    vx, vy = (x[b] - x[a]) / gap, (y[b] - y[a]) / gap
    speed, length = np.hypot(vx, vy), np.hypot(wx[b], wy[b])
    if speed > 1e-6:
        along, across = abs(wx[b] * vx + wy[b] * vy) / speed, abs(wx[b] * vy - wy[b] * vx) / speed
    else:
        along, across = length, 0.0
    over = max(0.0, along - speed)
    return total + _t1((over**2 + across**2) / (v[5] * d[b]) ** 2)


@njit(cache=True)
def _density_after_step(o, a, b, frame, x, y, d, s, v):  # type: ignore[no-untyped-def]
    """Return the logarithm of the density of b [1/px^2] where the step from o to a leads."""
    before, gap = frame[a] - frame[o], frame[b] - frame[a]
    vx, vy, ratio = (x[a] - x[o]) / before, (y[a] - y[o]) / before, gap / before
    lift = 0.5 * gap * (gap + before)
    square = s[b] ** 2 + (1.0 + ratio) ** 2 * s[a] ** 2 + ratio**2 * s[o] ** 2
    square += ((v[3] * d[a] + v[2] * np.hypot(vx, vy)) * lift) ** 2
    off = (x[b] - x[a] - gap * vx - lift * v[9]) ** 2 + (y[b] - y[a] - gap * vy - lift * v[10]) ** 2
    return _t2(off / square) - np.log(2.0 * np.pi * square)


@njit(cache=True)
def _density_at_start(a, b, frame, x, y, d, s, v):  # type: ignore[no-untyped-def]
    """Return the logarithm of the density of b [1/px^2] after a, where the velocity is not known."""
    square = (v[4] * d[a] * (frame[b] - frame[a])) ** 2 + s[a] ** 2 + s[b] ** 2
    return _t2(((x[b] - x[a]) ** 2 + (y[b] - y[a]) ** 2) / square) - np.log(2.0 * np.pi * square)


@njit(cache=True)
def _predict_and_update(state, cov, gap, b, x, y, d, s, v, pace):  # type: ignore[no-untyped-def]
    """Lead a motion on to candidate b, in place; return the logarithm of the density of b there [1/px^2].

    state: (3, 2) place, velocity, acceleration of both axes; cov: (3, 3) their covariances, of either. pace: px a frame
    of the whole path. A Kalman filter whose candidates are as far off as Student's t allows: one beside the way moves
    it little.
    """
    lift = 0.5 * gap * (gap + 1.0)
    for k in range(2):
        state[0, k] += gap * state[1, k] + lift * state[2, k]
        state[1, k] += gap * state[2, k]
    way = np.array([[1.0, gap, lift], [0.0, 1.0, gap], [0.0, 0.0, 1.0]])
    cov[:] = way @ cov @ way.T
    change = (v[3] * d[b] + v[13] * max(pace, np.hypot(state[1, 0], state[1, 1]))) ** 2
    cov[0, 0] += change * gap**3 / 3.0
    cov[0, 1] += 0.5 * change * gap * gap
    cov[1, 0] = cov[0, 1]
    cov[1, 1] += change * gap
    square, ex, ey = cov[0, 0] + s[b] ** 2, x[b] - state[0, 0], y[b] - state[0, 1]
    off = ex * ex + ey * ey
    gain = cov[:, 0] / (square + 0.5 * off)
    for m in range(3):
        state[m, 0] += gain[m] * ex
        state[m, 1] += gain[m] * ey
    cov[:] = cov - np.outer(gain, cov[0])
    for m in range(3):  # as rounding leaves it
        for n in range(m):
            cov[m, n] = cov[n, m]
    return _t2(off / square) - np.log(2.0 * np.pi * square)


@njit(cache=True)
def _log_likelihood(columns, values, chosen):  # type: ignore[no-untyped-def]
    """Return the log-likelihood of a whole path. chosen: candidate of each frame, -1 none.

    Four motions are led on: three that began anew at one of the last candidates, and the best of all older ones.
    """
    frame, x, y, d, c, wx, wy, s = columns
    own, v, enter, leave, at_first, known = values
    gain, motion, spread = np.full(4, NONE), np.zeros((4, 3, 2)), np.zeros((4, 3, 3))
    a, way, frames = -1, 0.0, 0
    for b in chosen:
        if a >= 0 and b >= 0:
            way, frames = way + np.hypot(x[b] - x[a], y[b] - y[a]), frames + frame[b] - frame[a]
        a = max(a, b)
    pace = way / max(1, frames)
    a, total = -1, NONE if at_first else 0.0
    for b in chosen:
        if b < 0:
            continue
        total = max(total, gain.max() + leave)
        begins = (0.0 if at_first and frame[b] == 0 else total + enter + known) + own[b]
        goes_on = a >= 0 and frame[b] - frame[a] <= 2.0 * v[12]
        brings = own[b] + _step(a, b, frame, x, y, d, c, wx, wy, v) if goes_on else NONE
        for k in range(4):
            if goes_on and gain[k] > 0.5 * NONE:
                gain[k] += brings + _predict_and_update(
                    motion[k], spread[k], float(frame[b] - frame[a]), b, x, y, d, s, v, pace
                )
            else:
                gain[k] = NONE
        anew = max(begins, gain.max() + v[14])
        oldest = 3 if gain[3] > gain[2] else 2
        gain[3], motion[3], spread[3] = gain[oldest], motion[oldest].copy(), spread[oldest].copy()
        for k in (2, 1):
            gain[k], motion[k], spread[k] = gain[k - 1], motion[k - 1].copy(), spread[k - 1].copy()
        gain[0], a = anew, b
        motion[0, 0, 0], motion[0, 0, 1], motion[0, 2, 0], motion[0, 2, 1] = x[b], y[b], v[9], v[10]
        motion[0, 1, :] = 0.0
        spread[0, :, :] = 0.0
        spread[0, 0, 0], spread[0, 1, 1], spread[0, 2, 2] = s[b] ** 2, max(v[4] * d[b], pace) ** 2, (v[2] * pace) ** 2
    ends = 0.0 if a >= 0 and frame[a] == len(chosen) - 1 else leave
    return max(total, gain.max() + ends)


@njit(cache=True)
def _best_exchange(columns, ours, theirs, mine, other):  # type: ignore[no-untyped-def]
    """Return the gain of the best exchange of two paths' ends, the frame it begins in, and (frames,) the best gain of
    one that begins no later than each frame."""
    now = _log_likelihood(columns, ours, mine) + _log_likelihood(columns, theirs, other)
    a, b, most, best, begin = mine.copy(), other.copy(), np.full(len(mine), NONE), NONE, 0
    for t in range(len(mine) - 1, 0, -1):
        a[t], b[t] = other[t], mine[t]
        if mine[t] < 0 and other[t] < 0:
            continue
        gain = _log_likelihood(columns, ours, a) + _log_likelihood(columns, theirs, b) - now
        if abs(gain) < 1e-9:  # of candidates that neither likelihood takes
            continue
        most[t] = gain
        if gain > best:
            best, begin = gain, t
    for t in range(1, len(mine)):
        most[t] = max(most[t], most[t - 1])
    return best, begin, most


@njit(cache=True)
def _viterbi(columns, values, begin):  # type: ignore[no-untyped-def]
    frame, x, y, d, c, wx, wy, s = columns
    own, v, enter, leave, at_first, _ = values
    frames, n = len(begin) - 1, len(frame)
    # steps, by the candidate that they lead to; the first of each is its beginning
    source, target, at = [0], [0], np.zeros(n + 1, np.int64)
    source.pop()
    target.pop()
    for b in range(n):
        at[b] = len(source)
        source.append(-1)
        target.append(b)
        for a in range(begin[max(0, frame[b] - int(v[12]))], begin[frame[b]]):
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
                    turn = (
                        _density_at_start(a, b, frame, x, y, d, s, v)
                        if o < 0
                        else _density_after_step(o, a, b, frame, x, y, d, s, v)
                    )
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
                    turn = (
                        _density_at_start(a, b, frame, x, y, d, s, v)
                        if o < 0
                        else _density_after_step(o, a, b, frame, x, y, d, s, v)
                    )
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
    return chosen, probability, other, best, most
