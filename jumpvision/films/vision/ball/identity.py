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
        near = own[:LONGEST][np.min(np.abs(own[:LONGEST, None] - other), axis=1) <= far]
        d = float(np.median(track.diameter[other]))
        x, y = (led(other, values[other], near) for values in (track.x, track.y))
        apart = np.hypot(x - track.x[near], y - track.y[near]) >= APART * d
        asked = np.flatnonzero(apart)[:ASKED]  # before they met
        if near.size > 1 and not asked.size and other.size == LED:  # it leads onto the other's rows: the same
            return None
        usual = usual_contrast(track, other)
        needed = min(2, own.size)
        seen: list[int] = []
        for k, a in enumerate(asked[np.argsort(near[asked])]):  # a film is read forwards
            if len(seen) + asked.size - k < needed:
                break
            j = int(near[a])
            if _is_there(frames, j, float(x[a]), float(y[a]), d, polarity, usual):
                seen.append(j)
        if seen and len(seen) >= needed:
            return seen[0] if own is after else seen[-1]
    return None


def only_one(track: BallTrack, frames: Frames, polarity: str, one: int, two: int) -> bool:
    """Whether in two frames near each other the track's rows are the only balls of their like, but for what stands in
    both: one ball then, however it moved."""
    seen = []
    for i in (one, two):
        image, d = np.asarray(frames[i]), float(track.diameter[i])
        blobs = find_blobs(image, diameter=d, polarity=polarity, min_diameter=SMALLEST_BALL, streak=False)
        usual = usual_contrast(track, np.array([i]))
        fits = (ball_at(View.of(image), b.x, b.y, d, polarity, usual) for b in blobs)
        seen.append([(f.x, f.y) for f in fits if f is not None and _is_like(f, usual)])
    first, second = seen
    for i, here, there in ((one, first, second), (two, second, first)):
        d = float(track.diameter[i])
        moved = [p for p in here if all(math.dist(p, q) > STAYS * d for q in there)]
        if not moved or any(math.hypot(x - track.x[i], y - track.y[i]) > NEAR * d for x, y in moved):
            return False
    return True


def _is_there(frames: Frames, j: int, x: float, y: float, d: float, polarity: str, usual: float | None) -> bool:
    """Whether a ball of diameter d and about the usual contrast is seen there in frame j."""
    view = frames.view(j) if isinstance(frames, AtHand) else View.of(np.asarray(frames[j]))
    if not (0.5 * d < x < view.shape[1] - 0.5 * d and 0.5 * d < y < view.shape[0] - 0.5 * d):
        return False
    found = ball_at(view, x, y, d, polarity, usual)
    return found is not None and _is_like(found, usual)


def usual_contrast(track: BallTrack, rows: Ints) -> float | None:
    """That of the track's rows, where it is known."""
    return None if track.contrast is None else abs(float(np.median(track.contrast[rows])))


def _is_like(found: Found, usual: float | None) -> bool:
    """Whether a ball has about the usual contrast, as far as that is known."""
    if found.fit is None or usual is None:
        return found.fit is not None
    return 1 / ALIKE < abs(float(found.fit.p[A] - found.fit.p[B])) / usual < ALIKE


def ball_at(view: View, x: float, y: float, d: float, polarity: str, contrast: float | None = None) -> Found | None:
    """What is fitted there as a ball, None where nothing is. contrast: of the ball it may be, where that is known: what
    differs far less from what is around it is not fitted at all, which takes long where there is no ball."""
    if contrast is not None and not _differs(view, x, y, d, polarity, contrast):
        return None
    found = DiscMeasure(d, polarity, False).measure(view, Start(x, y, d, 0.0, 0.0, True), fresh=True)
    return found if not found.flag and math.hypot(found.x - x, found.y - y) < NEAR * d else None


def _differs(view: View, x: float, y: float, d: float, polarity: str, contrast: float) -> bool:
    """Whether a third of the disc is half as bright (or dark) against the darkest (brightest) quarter around it as a
    ball of that contrast. Half of a disc lies on a ball that is NEAR."""
    x0, y0 = max(0, int(x - d)), max(0, int(y - d))
    part = np.asarray(view.part(y0, int(y + d) + 2, x0, int(x + d) + 2), dtype=np.float64)
    part = part if polarity == "bright" else -part
    r = np.hypot(np.arange(part.shape[1]) + x0 - x, (np.arange(part.shape[0]) + y0 - y)[:, None]) / d
    inside, around = part[r < 0.5], part[(r > 0.6) & (r < 1.0)]
    if min(inside.size, around.size) < 4:
        return True
    return bool(np.mean(inside - np.quantile(around, 0.25) > 0.5 * contrast / ALIKE) > 1 / 3)
