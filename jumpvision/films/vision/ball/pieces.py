"""A track in pieces: rows that lead from one to the next. What is no piece of the ball's way is flagged.

Two rows belong together where the motion before, or the motion after, leads from one to the other, and neither ball was
seen beside the other. The piece of most rows that moves is the ball; others are kept where they are within its reach,
look like it and do not merely stand. Only rows near a row decide on it, and which piece is the longest in the film's
head, and what it looks like there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import FROM_MAD, Array
from jumpvision.films.frames.base import Frames

from .identity import only_one, seen_beside
from .moving import BENT, HOLE, STEP, head_rows, led
from .track import BallTrack

Ints = NDArray[np.int64]
LED = 4  # rows that lead on
FEW = 2  # rows that are no way
KNOWN = 60  # rows by which a piece after the first is judged
SHORT, DRIFT = 15, 5.0  # rows, px: a piece that is no longer and drifts less stands
SHARP, MOST = (0.5, 4.0), 20  # diameters and medians off a parabola that are asked about; the first of a film
SAME, RESTS = 0.5, 0.1  # diameters: found again where it was lost; at rest
OTHER_GREY, OTHER_SIZE, SCATTER = 0.05, 0.08, 6.0  # of contrast, of the diameter; standard deviations
SHADED = 4.0  # times these: a hand's shade changes a ball's grey by some tenth of the contrast
STRAY = 0.25  # of what a row is off: so well its neighbours agree
OFF = "doubt: off the way of its neighbours by {:.0f} px"
ALONE = "doubt: no neighbour within reach"
STANDS = "doubt: {} rows that stand still, out of reach of the others"
FAR = "doubt: out of reach of the track before, by {:.0f} px"
BESIDE = "doubt: another ball, seen beside the one before in frame {}"
ALIKE = "doubt: balls alike were seen between"
OTHER = "doubt: another thing ({} {:.4g} instead of {:.4g})"


def in_pieces(track: BallTrack, clicked: bool, frames: Frames | None = None, polarity: str = "bright") -> BallTrack:
    """The track with those rows flagged that are no part of the ball's way. clicked: the first frame's is the ball.
    frames: where given, the balls on both sides of a hole or sharp turn are looked for in them, see `identity`."""
    track = _without_strays(track)
    good = np.flatnonzero(track.flag == "")
    if len(track.flag) < 4 or good.size == 0:
        return track
    way = _Way(track, good, frames, polarity)
    if len(way.pieces) == 1 and (good.size > 1 or clicked):
        return track
    first = clicked and good[0] == 0
    main = way.main(first)
    flag = track.flag.astype(object)
    for order in (range(main + 1, len(way.pieces)), range(main - 1, -1, -1)):
        last, why = way.pieces[main], ""
        for k in order:
            # once another ball was followed, nothing proves which is found next
            why = ALIKE if why.startswith(BESIDE[:20]) or why == ALIKE else way.against(k, last, first and k == 0)
            piece = way.pieces[k]
            if why:
                flag[good[piece]] = why
            else:
                last = np.union1d(last, piece) if piece.size <= FEW else piece
    if way.pieces[main].size == 1 and not first:
        flag[good[way.pieces[main]]] = ALONE
    if (flag == track.flag).all():
        return track
    return without(track, flag)


class _Way:
    """A track's good rows in pieces, and what speaks against each. pieces: indices into the good rows."""

    def __init__(self, track: BallTrack, good: Ints, frames: Frames | None, polarity: str):
        self._track, self._good, self._frames, self._polarity = track, good, frames, polarity
        self._head = head_rows(good).size  # of the good rows
        self._d = float(np.median(track.diameter[good[: self._head]]))
        self._at = np.stack([track.x[good], track.y[good]], axis=1)
        linked = _linked(good, self._at, self._d, track, self._head)
        for k in self._turns(linked):
            begin = max((j + 1 for j in np.flatnonzero(~linked[:k])), default=0)
            end = min((j + 1 for j in np.flatnonzero(~linked[k + 1 :]) + k + 1), default=good.size)
            linked[k] = self._beside(np.arange(begin, k + 1), np.arange(k + 1, end)) is None
        self.pieces = np.split(np.arange(good.size), np.flatnonzero(~linked) + 1)
        self._reach = [float(np.hypot(*np.ptp(self._at[p], axis=0))) for p in self.pieces]

    def main(self, first: bool) -> int:
        """The ball's own piece. first: the first row is of the ball."""
        # a hand that holds the ball changes how it looks
        main = max(
            (k for k, p in enumerate(self.pieces) if p[0] < self._head),
            key=lambda k: (self._reach_in_head(k) > DRIFT, np.count_nonzero(self.pieces[k] < self._head)),
        )
        moves = self.pieces[0].size > 1 and self._reach_in_head(0) > DRIFT
        if first and main:
            apart = any(self._beside(self.pieces[0], self.pieces[k]) is not None for k in {1, main})
            # what stands elsewhere proves nothing against a click
            stands = self._reach_in_head(main) <= DRIFT
            if moves or apart or stands or self._looks(main).other(self.pieces[0], SHADED):
                main = 0
        self._look = self._looks(main)
        return main

    def _looks(self, k: int) -> _Look:
        return _Look(self._track, self._good, self.pieces[k][self.pieces[k] < self._head])

    def _reach_in_head(self, k: int) -> float:
        p = self.pieces[k]
        return float(np.hypot(*np.ptp(self._at[p[p < self._head]], axis=0)))

    def against(self, k: int, last: Ints, clicked: bool) -> str:
        """Why piece k is not of the ball that the piece `last` is of; empty where nothing says so."""
        p = self.pieces[k]
        before, after = (last, p) if p[0] > last[0] else (p, last)
        few = p.size == 1 or (p.size == FEW and self._reach[k] > SAME * self._d)  # no two are a way
        if few and not clicked and not self._only(before, after):
            return ALONE
        if why := self._look.other(p[:KNOWN]):
            return why
        between = self._track.flag[self._good[before[-1]] + 1 : self._good[after[0]]]
        left = any("left the image" in f for f in between)  # what comes back flies
        stands = self._reach[k] < (max(DRIFT, self._d) if left else DRIFT)
        if stands and (left or (p.size <= SHORT and not few)) and not clicked:
            return STANDS.format(p.size)
        if any("alike" in f for f in between):
            return ALIKE
        if (off := _beyond(self._good, self._at, self._d, before, after)) > 0:
            return FAR.format(off)
        if (frame := self._beside(before, after)) is not None:
            return BESIDE.format(frame)
        return ""

    def _turns(self, linked: NDArray[np.bool_]) -> list[int]:
        """The first joints that a hole or a sharp turn is at."""
        if self._frames is None or linked.size < 4:
            return []
        sharp = _off_parabolas(self._good.astype(float), self._at)
        least = max(SHARP[0] * self._d, SHARP[1] * float(np.median(sharp[: self._head])))
        asked = linked & ((sharp > least) | (np.diff(self._good) > 1))
        return [int(k) for k in np.flatnonzero(asked)[:MOST]]

    def _only(self, before: Ints, after: Ints) -> bool:
        """Whether two pieces are a frame or two apart, and no other ball is seen at the joint."""
        one, two = int(self._good[before[-1]]), int(self._good[after[0]])
        if self._frames is None or two - one > FEW:
            return False
        return only_one(self._track, self._frames, self._polarity, one, two)

    def _beside(self, before: Ints, after: Ints) -> int | None:
        if self._frames is None:
            return None
        return seen_beside(self._track, self._frames, self._polarity, self._good[before], self._good[after])


def _without_strays(track: BallTrack) -> BallTrack:
    """With single rows flagged that are off the way that the two before and the two after share."""
    good = np.flatnonzero(track.flag == "")
    if good.size < 5:
        return track
    d, at = float(np.median(track.diameter[head_rows(good)])), np.stack([track.x[good], track.y[good]], axis=1)
    t = np.stack([good[k : good.size - 4 + k] for k in range(5)]).astype(float)
    p = np.stack([at[k : len(at) - 4 + k] for k in range(5)])
    # Newton's divided differences of the four: their parabola, and by how much the fourth is off it
    a, b, c, e = 0, 1, 3, 4
    first = [(p[j] - p[i]) / (t[j] - t[i])[:, None] for i, j in ((a, b), (b, c), (c, e))]
    second = [
        (w - v) / (t[j] - t[i])[:, None] for v, w, i, j in ((first[0], first[1], a, c), (first[1], first[2], b, e))
    ]
    third = np.hypot(*((second[1] - second[0]) / (t[e] - t[a])[:, None]).T)
    mean = 0.5 * (second[0] + second[1])
    there = p[b] + first[1] * (t[2] - t[b])[:, None] + mean * ((t[2] - t[b]) * (t[2] - t[c]))[:, None]
    off = np.hypot(*(p[2] - there).T)
    smooth = third * (t[e] - t[a]) * (t[e] - t[b]) * (t[e] - t[c]) < STRAY * off
    # a ball that rests, and is thrown, is none
    rests = np.any(
        [np.all([np.hypot(*(p[2] - p[k]).T) < RESTS * d for k in two], axis=0) for two in ((a, b), (c, e))], axis=0
    )
    stray = np.flatnonzero(smooth & ~rests & (off > SAME * d) & (t[e] - t[a] <= HOLE))
    if not stray.size:
        return track
    flag = track.flag.astype(object)
    for k in stray:
        flag[good[k + 2]] = OFF.format(off[k])
    return without(track, flag)


def without(track: BallTrack, reason: NDArray[np.object_]) -> BallTrack:
    """The track with these flags, and no numbers where there is one."""
    flag: NDArray[np.str_] = reason.astype(np.str_)

    def kept(values: Array | None) -> Array | None:
        return None if values is None else np.where(flag == "", values, np.nan)

    x, y, sigma, size, chi2 = (
        np.where(flag == "", v, np.nan) for v in (track.x, track.y, track.sigma, track.diameter, track.chi2)
    )
    return BallTrack(x, y, sigma, size, chi2, flag, track.notes, kept(track.grey), kept(track.contrast))


def _linked(good: Ints, at: Array, d: float, track: BallTrack, head: int) -> NDArray[np.bool_]:
    """(n - 1,): whether each good row and the next belong together. head: rows that tell the usual contrast."""
    if good.size < 2:
        return np.zeros(0, bool)
    gap = np.diff(good).astype(float)
    step = np.diff(at, axis=0)
    v = step / gap[:, None]
    same = np.hypot(*step.T) < SAME * d
    near = gap <= HOLE
    # after a hole only what hardly moves is found where it was lost
    beside = np.stack([np.hypot(*v[at].T) for at in (np.r_[0, : len(v) - 1], np.r_[1 : len(v), len(v) - 1])])
    out = same & ((gap == 1) | (gap * beside.max(axis=0) < SAME * d))
    for turn in (1, -1):  # the motion before leads on, or the motion after back
        v_k, gap_k = v[::turn], gap[::turn]
        off = np.hypot(*(v_k[1:] - v_k[:-1]).T) * np.maximum(gap_k[1:], gap_k[:-1])
        speed = np.hypot(*v_k[:-1].T)
        smooth = (
            (off < np.maximum(gap_k[1:], gap_k[:-1]) * BENT * speed + STEP * d) & near[::turn][1:] & near[::turn][:-1]
        )
        # three rows in a line are one piece
        three = np.zeros(len(v), bool)
        three[1:] |= smooth
        three[:-1] |= smooth
        out |= three[::turn]
    out = _led_over(good, at, d, out)
    # from rest, or by a bounce: as far as the motion after or before goes in so many frames
    held = np.zeros(len(v), bool)
    for turn in (1, -1):
        o, v_k, gap_k, near_k = out[::turn], v[::turn], gap[::turn], near[::turn]
        speed = np.hypot(*v_k.T)
        joined = np.zeros(len(v), bool)
        # the next pair is of one piece and this step is no longer than twice its own
        joined[:-1] = o[1:] & near_k[:-1] & (speed[:-1] < 2.0 * speed[1:] + STEP * d)
        held |= joined[::turn]
    both = held & ~out & (gap == 1)  # behind something it may have done anything: its pieces are looked at
    # each of the two has a neighbour of its own
    both[1:] &= out[:-1]
    both[:-1] &= out[1:]
    both[[0, -1]] = False
    out |= both
    if track.grey is not None and track.contrast is not None:
        # what changes its grey unseen, or as it jumps, is another thing
        grey, most = track.grey[good], OTHER_GREY * float(np.nanmedian(np.abs(track.contrast[good[:head]])))
        for k in np.flatnonzero(out & ((gap > 1) | both)):
            before, after = grey[max(0, k - 4) : k + 1], grey[k + 1 : k + 6]
            off = abs(float(np.median(after) - np.median(before)))
            out[k] = off < max(most, SCATTER * max(_scatter(before), _scatter(after)))
    return out


def _led_over(good: Ints, at: Array, d: float, linked: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(n - 1,): linked, and where the parabola through the LED linked rows before leads to the next row, also over a
    hole, or that through as many after it back; through one less, where both do."""
    out = linked.copy()

    def leads(k: int, n: int, after: bool) -> bool:
        rows, to = (np.arange(k + 1, k + 1 + n), k) if after else (np.arange(k + 1 - n, k + 1), k + 1)
        if rows[0] < 0 or rows[-1] >= good.size or not out[rows[0] : rows[-1]].all():
            return False
        return bool(np.hypot(*(led(good[rows], at[rows], good[to]) - at[to])) < SAME * d)

    asked = np.flatnonzero(~linked & (np.diff(good) <= HOLE))
    while True:  # what is joined may lead on
        ways = {int(k): [leads(int(k), n, after) for n in (LED, LED - 1) for after in (False, True)] for k in asked}
        joined = [k for k, (*one, before, after) in ways.items() if any(one) or (before and after)]
        if not joined:
            return out
        out[joined] = True
        asked = np.setdiff1d(asked, joined)


def _off_parabolas(t: Array, at: Array) -> Array:
    """(n - 1,): how far each row is from the parabola through the three before it, or the one before it from that
    through the three after, whichever is more [px]: third divided differences."""
    differences = at
    for order in (1, 2, 3):
        differences = np.diff(differences, axis=0) / (t[order:] - t[:-order])[:, None]
    third, out = np.hypot(*differences.T), np.zeros(t.size - 1)
    out[2:] = third * np.prod([t[3:] - t[k : k - 3] for k in range(3)], axis=0)
    out[:-2] = np.maximum(out[:-2], third * np.prod([t[3 - k : t.size - k] - t[:-3] for k in range(3)], axis=0))
    return out


def _beyond(good: Ints, at: Array, d: float, before: Ints, after: Ints) -> float:
    """By how much two pieces are farther apart than the faster of them goes meanwhile, there and back [px]."""
    gap = float(good[after[0]] - good[before[-1]])
    speed = 0.0
    for p in (before, after):
        p = p[-KNOWN:] if p is before else p[:KNOWN]
        if p.size > 1:
            speed = max(speed, float(np.max(np.hypot(*np.diff(at[p], axis=0).T) / np.diff(good[p]))))
    return float(np.hypot(*(at[after[0]] - at[before[-1]]))) - gap * (2.0 * speed + STEP * d)


class _Look:
    """What the ball's own piece looks like: grey and diameter."""

    def __init__(self, track: BallTrack, good: Ints, own: Ints):
        self._values = {"diameter": track.diameter[good]}
        self._least = {"diameter": OTHER_SIZE * float(np.median(track.diameter[good][own]))}
        if track.grey is not None and track.contrast is not None:
            self._values["grey"] = track.grey[good]
            self._least["grey"] = OTHER_GREY * float(np.median(np.abs(track.contrast[good][own])))
        self._own = {n: (float(np.median(v[own])), _scatter(v[own])) for n, v in self._values.items()}

    def other(self, piece: Ints, times: float = 1.0) -> str:
        """Why a piece is of another thing, by so many times what tells; empty where it is not, or nothing is known."""
        for name, values in self._values.items():
            usual, scatter = self._own[name]
            value = float(np.median(values[piece]))
            if abs(value - usual) > times * max(self._least[name], SCATTER * scatter):
                return OTHER.format(name, value, usual)
        return ""


def _scatter(values: Array) -> float:
    return FROM_MAD * float(np.median(np.abs(values - np.median(values))))
