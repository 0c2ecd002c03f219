"""Validation of a track: it moves as the film moves, it is not at a still object; else the film is searched anew."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array, Float32
from jumpvision.films.frames.base import Frames
from jumpvision.films.parameters import SMALLEST_BALL

from .background import Background, View
from .identity import ball_at, usual_contrast
from .measure import Found, Start
from .moving import (
    HOLE,
    LED,
    AtHand,
    Head,
    Path,
    Spot,
    at,
    behind,
    elsewhere,
    head_rows,
    heads,
    led_to,
    like,
    moving_paths,
    still_scene,
)
from .pieces import in_pieces, without
from .reasons import COVERED, Flag, Reason
from .track import BallSettings, BallTrack, BallTracker, as_track, merged
from .unknowns import A, B

USUAL, ON_PATH = 1.25, 0.4  # largest ratio of contrasts along a path; diameters off it
PLACE, STAYS = 0.2, 3  # diameters; frames there
ASKED = 3  # frames that are asked whether the same stands there without the ball
LOST, MORE = 0.15, 1.1  # share of the frames; times as many in which the ball moves
HIDES = (*COVERED, Reason.POOR_FIT, Reason.NOT_CONVERGED)  # a thing before the ball, or behind its rim
STANDS = "doubt: the same stands here in frame {} while the ball is at ({:.0f}, {:.0f})"
STILL = "doubt: stands still while something moves at ({:.0f}, {:.0f})"
WHICH = "doubt: balls at ({:.0f}, {:.0f}) and ({:.0f}, {:.0f}) in frame {} may both be the one clicked"
REMEDY = "; give track.seed = [column, row]"


def validated(track: BallTrack, frames: Frames, settings: BallSettings) -> BallTrack:
    """The track where nothing speaks against it; the one of what moves through the film where that is the better one;
    with doubtful frames flagged and what a user should know as `notes`. The film's head decides, see `heads`."""
    if len(frames) < STAYS or settings.streak:
        return track
    track = without_still_objects(track, frames, settings)
    good = track.flag == ""
    d = settings.diameter or SMALLEST_BALL
    if good.any():
        d = float(np.median(track.diameter[head_rows(np.flatnonzero(good))]))
    clicked = settings.seed is not None
    # what another ball is taken for is no part of the ball's way
    way = in_pieces(track, True, frames, settings.polarity) if clicked else track
    for head in heads(frames):
        look = slice(0, len(head))
        searched = is_still(track, look) or np.mean(way.flag[look] != "") > LOST
        # nothing proves that what was found later is what was clicked
        searched = searched or (clicked and (bool(track.flag[0]) or _stands(way, look, d)))
        moving = _moving(way, frames, head, settings, d) if searched else None
        if moving or not (head.least or is_still(track, look)):
            return moving or track
    if is_still(track) and good.sum() >= STAYS and len(frames) > STAYS:
        return _doubted(track, frames, head, settings, d)
    return track


def _moving(track: BallTrack, frames: Frames, head: Head, settings: BallSettings, d: float) -> BallTrack | None:
    """What moves through the head of a film as a disc, followed through all of it, where it is better than the track or
    nothing tells which of two it is; else None."""
    good, still = track.flag == "", is_still(track, slice(0, len(head)))
    scene = still_scene(head)
    paths = moving_paths(head, scene, settings.diameter, settings.polarity, SMALLEST_BALL)
    # speeds that a path may have come unseen from the seed; the only one of the film more
    came = 0.5 if len(paths) > 1 else 1.5
    ours = [p for p in paths if settings.seed is None or _begins(p, settings.seed, came)]
    if seed := settings.seed:  # of those about as long as the longest: a shadow flies beside its ball
        # paths below 0.7 of the longest are not preferred for lying nearer to the seed, but for lying on it
        ours = sorted(
            ours, key=lambda p: (not _from_seed(p, seed), len(p) < 0.7 * len(ours[0]), _distance_to_seed(p, seed))
        )
    if seed and ours and (two := _two_from(ours, seed, not track.flag[0])):
        good[[s.i for s in ours[0]]] = True
        return without(track, np.where(good, WHICH.format(*two), track.flag))
    if not ours or len(ours[0]) < head.least:
        return None
    moving = _followed(ours[0], frames, head, settings, scene)
    if seed and len(ours[0]) >= LED and _on_seed(ours[0], seed):
        moving = _to_click(moving, track, ours[0])
    look = slice(0, len(head))
    if seed and _from_seed(ours[0], seed):  # what is seen after it may be another ball
        look = slice(0, ours[0][-1].i + 1)
    # the search must find the ball moving in a tenth more frames
    more = _movers(moving, d, look) > MORE * _movers(track, d, look)
    # what was not seen at the click, and is elsewhere, is another ball than one whose way begins there
    other = seed is not None and bool(track.flag[0]) and _on_seed(ours[0], seed) and _elsewhere(track, ours[0])
    if other or (still and settings.seed is None) or (more and _of_the_clicked(moving, track, settings, ours[0], d)):
        return _with_notes(
            without_still_objects(moving, frames, settings), ours, track, np.flatnonzero(good[: len(head)])
        )
    return None


def _doubted(track: BallTrack, frames: Frames, head: Head, settings: BallSettings, d: float) -> BallTrack:
    """A track that stands still, flagged where something moves elsewhere; a click is believed, and the doubt said."""
    good = track.flag == ""
    place = float(np.median(track.x[good])), float(np.median(track.y[good]))
    fit = ball_at(View.of(np.asarray(frames[int(np.flatnonzero(good)[0])])), *place, d, settings.polarity)
    contrast = abs(float(fit.fit.p[A] - fit.fit.p[B])) if fit is not None and fit.fit else 50.0
    other = elsewhere(head, still_scene(head), *place, d, contrast)
    if other is None:
        return track
    doubt = STILL.format(*other)
    if settings.seed is not None:
        return replace(track, notes=(*track.notes, doubt))
    return without(replace(track, notes=(*track.notes, doubt + REMEDY)), np.where(good, doubt + REMEDY, track.flag))


def is_still(track: BallTrack, look: slice = slice(None)) -> bool:
    """Whether a track stays within a diameter in the frames looked at, or was never found."""
    good = np.zeros(len(track.flag), bool)
    good[look] = track.flag[look] == ""
    if not good.any():
        return True
    # a track that reaches less far than a diameter stands still
    return math.hypot(np.ptp(track.x[good]), np.ptp(track.y[good])) < 1.0 * float(np.median(track.diameter[good]))


def _followed(path: Path, frames: Frames, head: Head, settings: BallSettings, scene: Float32) -> BallTrack:
    """The ball of a path in all frames, without the scene behind it; once more where it has stood beside the path."""
    if len(frames) < 12:  # of 12 frames the median is a scene to take out
        return follow(path, frames, settings)
    n, d = len(head), float(np.median([s.d for s in path]))
    way = np.array([at(path, min(max(i, path[0].i), path[-1].i)) for i in range(n)])
    moving = follow(path, frames, settings, behind(head, scene, way, d))
    good = np.flatnonzero(moving.flag[:n] == "")
    nearest = good[np.argmin(np.abs(np.arange(n)[:, None] - good), axis=1)]
    now = np.stack([moving.x[nearest], moving.y[nearest]], axis=1)
    stood = (math.dist(now[k], way[k]) > PLACE * d and _stood(now, k, d) for k in (0, -1))
    return follow(path, frames, settings, behind(head, scene, now, d)) if any(stood) else moving


def _stood(way: Array, k: int, d: float) -> bool:
    """Whether a ball is near its place in row k of its way (n, 2) for a quarter of it: a median may show it there."""
    return bool(np.mean(np.hypot(*(way - way[k]).T) < 0.5 * d) > 0.25)


def follow(path: Path, frames: Frames, settings: BallSettings, scene: Float32 | None = None) -> BallTrack:
    """The ball in all frames, from a path of it: from its clearest spot on to both ends of the film.

    Where the tracker, which knows the ball by then, refuses what is on the path but the frame's own fit does not, and
    its contrast is the path's, that fit counts.
    """
    usual = float(np.median([s.contrast for s in path]))
    known = {s.i: s for s in path if 1 / USUAL < s.contrast / usual < USUAL}
    middle = min(known.values(), key=lambda s: s.found.sigma * s.found.chi2).i
    size = float(np.median([s.d for s in path]))
    scenes: list[Background | None] = [None]
    if scene is not None:
        ball = float(np.median([s.found.fit.p[A] for s in known.values() if s.found.fit is not None]))
        greys = scene.astype(np.float64), float(np.nanmedian(scene)), ball
        # what has the ball's own grey covers its rim; of a ball that rests the scene itself shows it
        scenes = [Background(*greys), Background(*greys, blind=True)]
    found: dict[int, Found] = {}
    for order in (range(middle, -1, -1), range(middle, len(frames))):
        tracker = BallTracker(replace(settings, seed=None, diameter=settings.diameter or size))
        tracker.trust = True
        for i in order:
            image = np.asarray(frames[i])
            views = [
                View((image.shape[0], image.shape[1]), whole=partial(frames.__getitem__, i), scene=b) for b in scenes
            ]
            found[i] = _next(tracker, views, path, i, known.get(i))
    return as_track([found[i] for i in range(len(frames))])


def _next(tracker: BallTracker, views: Sequence[View], path: Path, i: int, spot: Spot | None) -> Found:
    """The ball in frame i, which the tracker takes note of. views: of the frame; the next where one has it covered."""
    view = views[0]
    if spot is not None:
        found = tracker.look(view, spot.found)
        near = not found.flag and math.hypot(found.x - spot.x, found.y - spot.y) < ON_PATH * spot.d
        return tracker.keep(found) if near or tracker.last is None else tracker.keep(spot.found)
    if not path[0].i < i < path[-1].i:
        found = tracker.look(view)
        if found.flag.reason in HIDES and tracker.last is not None and len(views) > 1:
            again = tracker.look(views[1])
            found = found if again.flag else again
        return tracker.keep(found)
    (x, y), d = at(path, i), path[0].d
    for view in views:
        found = tracker.measurer.measure(view, Start(x, y, d, 0.0, 0.0, True), fresh=False)
        if found.flag.reason not in HIDES:
            break
    near = not found.flag and math.hypot(found.x - x, found.y - y) < ON_PATH * d
    return tracker.keep(found if near else Found(found.flag or Flag(Reason.HIDDEN)))


def without_still_objects(track: BallTrack, frames: Frames, settings: BallSettings) -> BallTrack:
    """The track with those rows flagged in which it is at what stands there without the ball, too, as rows of the
    film's head show."""
    good = np.flatnonzero(track.flag == "")
    if good.size < 2 * STAYS:
        return track
    kept = frames if isinstance(frames, AtHand) else AtHand(frames, {}, ())
    first = head_rows(good)
    d = float(np.median(track.diameter[first]))
    flag = track.flag.astype(object)
    early, late = [], []
    for rows in _places(track, good, PLACE * d):
        judged = rows[rows <= first[-1]]
        if judged.size >= STAYS:
            early.append((rows, judged))
        elif rows.size >= STAYS:  # what the head does not tell changes nothing in it
            late.append((rows[rows > first[-1]], rows[:STAYS]))
    for rows, judged in [*sorted(early, key=lambda g: -g[1].size)[:5], *late]:
        frame = _without_ball(track, kept, settings.polarity, first, judged, d)
        if frame is not None:
            flag[rows] = STANDS.format(frame, track.x[frame], track.y[frame])
    return without(track, flag) if (flag != track.flag).any() else track


def _places(track: BallTrack, good: NDArray[np.int64], reach: float) -> list[NDArray[np.int64]]:
    """The good rows in groups of one place: those about the first row that is in none yet."""
    left, groups = good, []
    while left.size:
        near = np.hypot(track.x[left] - track.x[left[0]], track.y[left] - track.y[left[0]]) < reach
        groups.append(left[near])
        left = left[~near]
    return groups


def _without_ball(
    track: BallTrack, kept: AtHand, polarity: str, first: NDArray[np.int64], judged: NDArray[np.int64], d: float
) -> int | None:
    """A frame of the head in which the same as in the rows `judged` is seen at their place, the ball elsewhere; None
    where another frame shows something else there."""
    x, y = float(np.median(track.x[judged])), float(np.median(track.y[judged]))
    away = first[np.hypot(track.x[first] - x, track.y[first] - y) > 1.2 * d]
    at_hand = away[np.isin(away, list(kept.whole))]
    away = at_hand if at_hand.size >= ASKED else away
    if not away.size:
        return None
    usual = usual_contrast(track, judged)
    here: Found | None = None
    for g in away[np.unique(np.linspace(0, away.size - 1, min(ASKED, away.size)).astype(int))]:
        there = ball_at(View.of(kept[int(g)]), x, y, d, polarity, usual)
        if there is None:
            return None
        if here is None:
            nearest = int(judged[np.argmin(np.hypot(track.x[judged] - x, track.y[judged] - y))])
            here = ball_at(kept.view(nearest), x, y, d, polarity)
        if here is None or not _same_object(here, there):
            return None
    return int(away[0])


def _of_the_clicked(moving: BallTrack, track: BallTrack, settings: BallSettings, path: Path, d: float) -> bool:
    """Whether what moves is not beside what was clicked: in the first frame, or where its path begins soon after what
    was followed from the click."""
    if settings.seed is None or track.flag[0]:
        return True
    if len(path) >= LED and _on_seed(path, settings.seed):
        return True
    if not moving.flag[0]:
        return math.hypot(moving.x[0] - track.x[0], moving.y[0] - track.y[0]) < d
    good, first = np.flatnonzero(track.flag == ""), path[0]
    followed = np.split(good, np.flatnonzero(np.diff(good) > HOLE) + 1)[0]
    last = int(followed[max(int(np.searchsorted(followed, first.i)) - 1, 0)])
    gap, speed = first.i - last, math.dist((first.x, first.y), (path[1].x, path[1].y)) / (path[1].i - first.i)
    away = math.hypot(first.x - track.x[last], first.y - track.y[last])
    return gap <= HOLE and away < 1.5 * d + gap * speed


def _stands(track: BallTrack, look: slice, d: float) -> bool:
    """Whether a track stands in most of the frames looked at, be it at several places."""
    return bool(2 * _movers(track, d, look) < np.count_nonzero(track.flag[look] == ""))


def _to_click(moving: BallTrack, track: BallTrack, path: Path) -> BallTrack:
    """With the rows before a path that leads back to the click where it leads: by what follows the path, else by the
    track from the click; no others."""
    n, d = path[0].i, path[0].d
    way = np.array([led_to(path, i) for i in range(n)]).reshape(n, 2)
    ours, theirs = (np.hypot(t.x[:n] - way[:, 0], t.y[:n] - way[:, 1]) < 0.5 * d for t in (moving, track))  # NaN: not
    taken, gone = np.zeros((2, len(moving.flag)), bool)
    taken[:n], gone[:n] = theirs & ~ours, ~theirs & ~ours & (moving.flag[:n] == "")
    both = merged(moving, track, taken)
    return without(both, np.where(gone, str(Flag(Reason.OTHER_BALL)), both.flag).astype(object))


def _elsewhere(track: BallTrack, path: Path) -> bool:
    """Whether the track is beside a path in most of the frames that both have."""
    both = [s for s in path if not track.flag[s.i]]
    away = [s for s in both if math.hypot(track.x[s.i] - s.x, track.y[s.i] - s.y) > s.d]
    return 2 * len(away) > len(both)


def _movers(track: BallTrack, d: float, look: slice) -> int:
    """Of the frames looked at, those in which the ball is where it is in few others."""
    good = track.flag[look] == ""
    x, y = track.x[look][good], track.y[look][good]
    near = np.hypot(x[:, None] - x, y[:, None] - y) < PLACE * d
    return int(np.count_nonzero(near.sum(axis=1) < STAYS + 1))


def _from_seed(path: Path, seed: tuple[float, float]) -> bool:
    """Whether a path of six frames or more begins in the first, at the seed."""
    first = path[0]
    return len(path) >= 6 and first.i == 0 and math.dist((first.x, first.y), seed) < 0.5 * first.d


def _on_seed(path: Path, seed: tuple[float, float]) -> bool:
    """Whether a path leads back to the seed in the first frame, over no more frames than it tells."""
    far = 2 * min(HOLE, len(path))
    return path[0].i <= far and math.dist(led_to(path, 0), seed) < 0.5 * path[0].d


def _begins(path: Path, seed: tuple[float, float], came: float) -> bool:
    """Whether a path may have begun at the seed in the first frame: so many times its speed away by then, in no more
    frames than a path may be hidden for."""
    first, second = path[0], path[1]
    speed = math.hypot(second.x - first.x, second.y - first.y) / (second.i - first.i)
    if _on_seed(path, seed):
        return True
    return _distance_to_seed(path, seed) < 1.5 * first.d + came * speed * min(first.i, HOLE)


def _two_from(ours: list[Path], seed: tuple[float, float], seen: bool) -> tuple[float, ...] | None:
    """Of paths that may have begun at a seed: where two that are alike are at once, and when. None where they are not,
    or where one of them alone began on the seed itself: that one is put first. seen: a ball is, at the seed; then both
    must have begun on it."""
    for other in ours[1:]:
        one = {s.i: s for s in ours[0]}
        both = [(one[s.i], s) for s in other if s.i in one and like(one[s.i], s)]
        if len(both) < 2:
            continue
        on = [_on_seed(p, seed) for p in (ours[0], other)]
        if on[0] == on[1] and (on[0] or not seen):
            a, b = both[0]
            return a.x, a.y, b.x, b.y, a.i
        if on[1] and not on[0]:
            ours[:] = [other, *(p for p in ours if p is not other)]
    return None


def _distance_to_seed(path: Path, seed: tuple[float, float]) -> float:
    """From the seed to where a path begins, or would have in the first frame, whichever is nearer [px]."""
    first = path[0]
    x, y = led_to(path, 0) if first.i <= 2 * HOLE else (first.x, first.y)
    return min(math.hypot(first.x - seed[0], first.y - seed[1]), math.hypot(x - seed[0], y - seed[1]))


def _same_object(one: Found, two: Found) -> bool:
    assert one.fit is not None and two.fit is not None
    a, b = (abs(float(f.fit.p[A] - f.fit.p[B])) for f in (one, two) if f.fit is not None)
    return math.hypot(one.x - two.x, one.y - two.y) < 0.2 * one.diameter and 0.67 < a / b < 1.5


def _with_notes(track: BallTrack, paths: Sequence[Path], before: BallTrack, rows: NDArray[np.int64]) -> BallTrack:
    """With notes of what was not taken: only of what was seen beside the ball. before, rows: the track that another
    has been preferred to, and its good rows in the head."""
    notes = list(track.notes)
    if rows.size >= 2 and is_still(before, slice(0, int(rows[-1]) + 1)):
        x, y = np.median(before.x[rows]), np.median(before.y[rows])
        if _beside(track, rows, before.x[rows], before.y[rows]):
            notes.append(f"a ball-like thing at ({x:.0f}, {y:.0f}) stands still and was not taken: another moves")
    for p in paths[1:3]:
        rows = np.array([s.i for s in p])
        if _beside(track, rows, np.array([s.x for s in p]), np.array([s.y for s in p])):
            notes.append(
                f"alternative: another ball moves from ({p[0].x:.0f}, {p[0].y:.0f}) in frame {p[0].i} through {len(p)} "
                "frames; track.seed = [column, row] chooses"
            )
    return replace(track, notes=tuple(notes))


def _beside(track: BallTrack, rows: NDArray[np.int64], x: Array, y: Array) -> bool:
    """Whether in half of the rows or more the track is known, and a diameter or more away from (x, y)."""
    known = track.flag[rows] == ""
    if not known.any():
        return False
    d = float(np.nanmedian(track.diameter[rows]))
    away = np.hypot(track.x[rows][known] - x[known], track.y[rows][known] - y[known]) > d
    return bool(2 * np.count_nonzero(away) >= rows.size)
