"""Is what is found after a hole, or after a sharp turn, the ball from before? Not, if it was seen beside the ball.

A thing is led back over the hole by its own motion: where a ball like it is seen there, beside the ball that was
followed then, it is another. The ball from before is led on in the same way.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from jumpvision.films.frames.base import Frames
from jumpvision.films.parameters import SMALLEST_BALL

from .background import View
from .measure import DiscMeasure, Found, Start
from .moving import HOLE, AtHand, led
from .search import find_blobs
from .track import BallTrack
from .unknowns import A, B

Ints = NDArray[np.int64]
LED, ASKED = 5, 3  # rows that lead on; frames that are asked
LONGEST = 16  # rows from the hole on that may be
APART, NEAR = 0.9, 0.4  # diameters: two balls; a ball that is where it was led to
STAYS = 0.2  # diameters: what stands
ALIKE = 1.4  # ratio of contrasts


def seen_beside(track: BallTrack, frames: Frames, polarity: str, before: Ints, after: Ints) -> int | None:
    """A frame in which the ball of one group of rows is seen beside the ball of the other; None where in no frame.

    before, after: frames of a track, in order, the last and the first of them on either side of a hole or turn.
    """
    for own, other in ((before[::-1], after[:LED]), (after, before[-LED:])):
        if other.size < 2:
            continue
        far = HOLE + ASKED if other.size > 2 else ASKED  # a line bends
        near = [int(j) for j in own[:LONGEST] if np.min(np.abs(other - j)) <= far]
        asked = [j for j in near if _apart(track, other, j)][:ASKED]  # before they met
        if len(near) > 1 and not asked and other.size == LED:  # it leads onto the other's rows: the same
            return None
        seen = [j for j in asked if _is_there(track, frames, polarity, other, j)]
        if seen and len(seen) >= min(2, own.size):
            return seen[0]
    return None


def only_one(track: BallTrack, frames: Frames, polarity: str, one: int, two: int) -> bool:
    """Whether in two frames near each other the track's rows are the only balls of their like, but for what stands in
    both: one ball then, however it moved."""
    seen = []
    for i in (one, two):
        image, d = np.asarray(frames[i]), float(track.diameter[i])
        blobs = find_blobs(image, diameter=d, polarity=polarity, min_diameter=SMALLEST_BALL, streak=False)
        fits = (ball_at(View.of(image), b.x, b.y, d, polarity) for b in blobs)
        seen.append([(f.x, f.y) for f in fits if f is not None and _is_like(track, np.array([i]), f)])
    for i, here, there in ((one, seen[0], seen[1]), (two, seen[1], seen[0])):
        d = float(track.diameter[i])
        moved = [p for p in here if all(math.dist(p, q) > STAYS * d for q in there)]
        if not moved or any(math.hypot(x - track.x[i], y - track.y[i]) > NEAR * d for x, y in moved):
            return False
    return True


def _apart(track: BallTrack, other: Ints, j: int) -> bool:
    """Whether the thing of the rows `other`, led to frame j, is not at the track's own place."""
    d = float(np.median(track.diameter[other]))
    x, y = (float(led(other, values[other], j)) for values in (track.x, track.y))
    return math.hypot(x - track.x[j], y - track.y[j]) >= APART * d


def _is_there(track: BallTrack, frames: Frames, polarity: str, other: Ints, j: int) -> bool:
    """Whether the thing of the rows `other`, led to frame j, is seen there."""
    d = float(np.median(track.diameter[other]))
    x, y = (float(led(other, values[other], j)) for values in (track.x, track.y))
    view = frames.view(j) if isinstance(frames, AtHand) else View.of(np.asarray(frames[j]))
    if not (0.5 * d < x < view.shape[1] - 0.5 * d and 0.5 * d < y < view.shape[0] - 0.5 * d):
        return False
    found = ball_at(view, x, y, d, polarity)
    return found is not None and _is_like(track, other, found)


def _is_like(track: BallTrack, rows: Ints, found: Found) -> bool:
    """Whether a ball has the contrast of the track's rows, as far as that is known."""
    if found.fit is None or track.contrast is None:
        return found.fit is not None
    usual = abs(float(np.median(track.contrast[rows])))
    return 1 / ALIKE < abs(float(found.fit.p[A] - found.fit.p[B])) / usual < ALIKE


def ball_at(view: View, x: float, y: float, d: float, polarity: str) -> Found | None:
    """What is fitted there as a ball, None where nothing is."""
    found = DiscMeasure(d, polarity, False).measure(view, Start(x, y, d, 0.0, 0.0, True), fresh=True)
    return found if not found.flag and math.hypot(found.x - x, found.y - y) < NEAR * d else None
