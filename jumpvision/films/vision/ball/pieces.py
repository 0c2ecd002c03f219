"""A track in pieces: rows that lead from one to the next. What is no piece of the ball's way is flagged.

Two rows belong together where the motion before, or the motion after, leads from one to the other. The piece of most
rows that moves is the ball; others are kept where they are within its reach, look like it and do not merely stand.
Only rows near a row decide on it, and what the longest piece looks like.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import FROM_MAD, Array

from .moving import BENT, HOLE, STEP
from .track import BallTrack

Ints = NDArray[np.int64]
SHORT, DRIFT = 15, 5.0  # rows, px: a piece that is no longer and drifts less stands
SAME = 0.5  # diameters: found again where it was lost
OTHER_GREY, OTHER_SIZE, SCATTER = 0.05, 0.08, 6.0  # of contrast, of the diameter; standard deviations
ALONE = "doubt: no neighbour within reach"
STANDS = "doubt: {} rows that stand still, out of reach of the others"
FAR = "doubt: out of reach of the track before, by {:.0f} px"
ALIKE = "doubt: balls alike were seen between"
OTHER = "doubt: another thing ({} {:.4g} instead of {:.4g})"


def in_pieces(track: BallTrack, clicked: bool) -> BallTrack:
    """The track with those rows flagged that are no part of the ball's way. clicked: the first frame's is the ball."""
    good = np.flatnonzero(track.flag == "")
    if len(track.flag) < 4 or good.size == 0:
        return track
    d = float(np.median(track.diameter[good]))
    at = np.stack([track.x[good], track.y[good]], axis=1)
    pieces = np.split(np.arange(good.size), np.flatnonzero(~_linked(good, at, d, track)) + 1)
    if len(pieces) == 1 and (good.size > 1 or clicked):
        return track
    reach = [float(np.hypot(*np.ptp(at[p], axis=0))) for p in pieces]
    first = clicked and good[0] == 0
    # a hand that holds the ball changes how it looks
    main = max(range(len(pieces)), key=lambda k: (reach[k] > DRIFT, pieces[k].size))
    if first and pieces[0].size > 1 and reach[0] > DRIFT:
        main = 0
    flag = track.flag.astype(object)
    look = _Look(track, good, pieces[main])
    for order in (range(main + 1, len(pieces)), range(main - 1, -1, -1)):
        last = pieces[main]
        for k in order:
            p = pieces[k]
            why = look.other(p)
            if p.size == 1 and not (first and k == 0):
                why = ALONE
            elif not why and p.size <= SHORT and reach[k] < DRIFT and not (first and k == 0):
                why = STANDS.format(p.size)
            elif not why:
                before, after = (last, p) if order.step > 0 else (p, last)
                off = _beyond(good, at, d, before, after)
                why = FAR.format(off) if off > 0 else ""
                if _alike_between(track, good[before[-1]], good[after[0]]):
                    why = ALIKE
            if why:
                flag[good[p]] = why
            else:
                last = p
    if pieces[main].size == 1 and not first:
        flag[good[pieces[main]]] = ALONE
    if (flag == track.flag).all():
        return track
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


def _linked(good: Ints, at: Array, d: float, track: BallTrack) -> NDArray[np.bool_]:
    """(n - 1,): whether each good row and the next belong together."""
    if good.size < 2:
        return np.zeros(0, bool)
    gap = np.diff(good).astype(float)
    step = np.diff(at, axis=0)
    v = step / gap[:, None]
    same = np.hypot(*step.T) < SAME * d
    near = gap <= HOLE
    out = same.copy()
    for turn in (1, -1):  # the motion before leads on, or the motion after back
        v_k, gap_k = v[::turn], gap[::turn]
        off = np.hypot(*(v_k[1:] - v_k[:-1]).T) * gap_k[1:]
        speed = np.hypot(*v_k[:-1].T)
        smooth = (off < gap_k[1:] * (BENT * speed + STEP * d)) & near[::turn][1:] & near[::turn][:-1]
        # three rows in a line are one piece
        three = np.zeros(len(v), bool)
        three[1:] |= smooth
        three[:-1] |= smooth
        out |= three[::turn]
    # from rest, or by a bounce: as far as the motion after or before goes in so many frames
    held = np.zeros(len(v), bool)
    for turn in (1, -1):
        o, v_k, gap_k, near_k = out[::turn], v[::turn], gap[::turn], near[::turn]
        speed = np.hypot(*v_k.T)
        joined = np.zeros(len(v), bool)
        # the next pair is of one piece and this step is no longer than twice its own
        joined[:-1] = o[1:] & near_k[:-1] & (speed[:-1] < 2.0 * speed[1:] + STEP * d)
        held |= joined[::turn]
    both = held & ~out
    # each of the two has a neighbour of its own
    both[1:] &= out[:-1]
    both[:-1] &= out[1:]
    both[[0, -1]] = False
    out |= both
    if track.grey is not None and track.contrast is not None:
        # what changes its grey unseen, or as it jumps, is another thing
        grey, most = track.grey[good], OTHER_GREY * float(np.nanmedian(np.abs(track.contrast[good])))
        for k in np.flatnonzero(out & ((gap > 1) | both)):
            before, after = grey[max(0, k - 4) : k + 1], grey[k + 1 : k + 6]
            off = abs(float(np.median(after) - np.median(before)))
            out[k] = off < max(most, SCATTER * max(_scatter(before), _scatter(after)))
    return out


def _alike_between(track: BallTrack, first: int, last: int) -> bool:
    """Whether in frames between two others several balls were alike."""
    return any("alike" in f for f in track.flag[first + 1 : last])


def _beyond(good: Ints, at: Array, d: float, before: Ints, after: Ints) -> float:
    """By how much two pieces are farther apart than the faster of them goes meanwhile, there and back [px]."""
    gap = float(good[after[0]] - good[before[-1]])
    speed = 0.0
    for p in (before, after):
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

    def other(self, piece: Ints) -> str:
        """Why a piece is of another thing; empty where it is not, or nothing is known."""
        for name, values in self._values.items():
            usual, scatter = self._own[name]
            value = float(np.median(values[piece]))
            if abs(value - usual) > max(self._least[name], SCATTER * scatter):
                return OTHER.format(name, value, usual)
        return ""


def _scatter(values: Array) -> float:
    return FROM_MAD * float(np.median(np.abs(values - np.median(values))))
