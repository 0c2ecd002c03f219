"""A ball of any face in flight: found by its motion before the still scene, then fitted as a layer, see `layer`."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import cv2
import numpy as np
from threadpoolctl import threadpool_limits

from jumpvision.base.arrays import MAD, Float32, Image
from jumpvision.base.threads import at_once
from jumpvision.films.frames.base import Frames
from jumpvision.films.vision.ball.measure import Found
from jumpvision.films.vision.ball.moving import HOLE, Head, Path, Spot, at, extent, paths
from jumpvision.films.vision.ball.reasons import GOOD, Flag, Reason
from jumpvision.films.vision.ball.track import BallTrack, as_track

if TYPE_CHECKING:
    from .layer import Layer, Place

FLIGHT, SURE = 6, 0.7  # frames of a path that nobody clicked, and share of them that must fit
BESIDE, DARKER = (0.6, 2.5), 1.4  # diameters between a ball and its shadow; of a shadow's change, the ball's
AGAIN, CERTAIN = 3, 0.1  # things that may be a ball lost for long; what may be unlike it then
TOGETHER = 8  # frames
GUESS = 12.0  # px: first diameter where none is known
CENTRE = "the target is a ball in flight: positions are of its centre, not of the place that was clicked"
KNOWN = ", known in its picture to {:.2g} px, an offset that turns with the ball"


def in_flight(head: Head, scene: Float32, diameter: float | None, seed: tuple[float, float] | None) -> BallTrack | None:
    """The ball that flies from the seed, or the farthest where none is given, in every frame; None where nothing flies
    in the film's head, it is not round, of another diameter [px], or its picture does not hold. notes: of what its
    positions are."""
    frames, n = head.film, len(head)
    if n < FLIGHT:
        return None
    path = _path(head, scene, diameter or GUESS, seed)
    if path is not None and diameter is None:
        size = _size(frames, scene, path)
        path = _path(head, scene, size, seed)
    if path is None or len(path) < head.least:
        return None
    from .joint import adjusted  # loaded where something flies
    from .layer import learned, like_others

    d = path[0].d
    known_layer = learned(frames, scene, path, d)
    # a ball is not more than a third larger or smaller than the diameter given
    if known_layer is None or (diameter and abs(known_layer[0].d / diameter - 1.0) > 0.3):
        return None
    layer, known, outlined = known_layer
    if not outlined and diameter is None:
        return None
    places = _everywhere(frames, scene, path, layer, known)
    on_path = [not places[s.i].found.flag for s in path]
    if np.mean(on_path) < SURE:
        return None
    with threadpool_limits(1, "blas"):  # the matrices are small: threads of BLAS wait for each other
        better = adjusted(frames, scene, places, layer, outlined, n)
    # a ball whose rim is not seen all round must fit so well, and its centre [px] be known so well
    if not outlined and (better is None or better.misfit > 1.5 or better.centre > 0.1):
        return None
    if better is None:
        usual = float(np.median([places[s.i].found.chi2 for s in path if not places[s.i].found.flag]))
        return replace(as_track([like_others(p.found, usual) for p in places]), notes=(CENTRE,))
    return replace(as_track([p.found for p in better.places]), notes=(CENTRE + KNOWN.format(better.centre),))


def is_shadow(track: BallTrack, frames: Frames, scene: Float32) -> bool:
    """Whether a dark track goes beside something that changes the scene more, as a shadow beside its ball."""
    good = np.flatnonzero(track.flag[: len(frames)] == "")
    if good.size < FLIGHT:
        return False
    d, beside = float(np.median(track.diameter[good])), 0
    look = _Things(scene, d)
    for i in good:
        things = look.of(int(i), np.asarray(frames[int(i)]))
        away = [math.hypot(t.x - track.x[i], t.y - track.y[i]) / d for t in things]
        own = max((t.contrast for t, a in zip(things, away) if a < BESIDE[0]), default=0.0)
        beside += any(t.contrast > DARKER * own for t, a in zip(things, away) if BESIDE[0] < a < BESIDE[1])
    return beside > SURE * good.size


def _path(frames: Frames, scene: Float32, d: float, seed: tuple[float, float] | None) -> Path | None:
    """The farthest path of those that begin at the seed, of two as far the one of more contrast."""
    n = len(frames)
    look, things = _Things(scene, d), dict[int, list[Spot]]()
    for first in range(0, n, TOGETHER):  # read by one thread, looked at by several
        images = {i: np.asarray(frames[i]) for i in range(first, min(n, first + TOGETHER))}
        calls = [partial(look.of, i, image) for i, image in images.items()]
        things |= dict(zip(images, at_once(calls), strict=True))
    # what changes most in nine of ten frames
    usual = float(np.percentile([t[0].contrast if t else 0.0 for t in things.values()], 90))
    # less than 0.15 of it is noise
    all_paths = paths({i: [s for s in t if s.contrast > 0.15 * usual] for i, t in things.items()})
    ours = [p for p in all_paths if (_from(p, seed) if seed is not None else len(p) >= FLIGHT)]
    far = [p for p in ours if extent(p) > 0.7 * max(map(extent, ours))]
    return max(far, key=lambda p: float(np.median([s.contrast for s in p])) * math.sqrt(len(p)), default=None)


def _from(path: Path, seed: tuple[float, float]) -> bool:
    """Whether a path may have begun at the seed in the first frame; its own first may be of the hand beside."""
    for first, second in itertools.pairwise(path[:4]):  # the ball's own first may be one of three
        speed = math.hypot(second.x - first.x, second.y - first.y) / (second.i - first.i)
        x, y = at([s for s in path if s.i >= first.i], 0)
        near = math.hypot(first.x - seed[0], first.y - seed[1]), math.hypot(x - seed[0], y - seed[1])
        if min(near) < 1.5 * first.d + speed * min(first.i, HOLE):
            return True
    return False


class _Things:
    """What has changed against the scene in a frame, as large as the diameter d, looked for on a copy `f` times as
    small."""

    def __init__(self, scene: Float32, d: float):
        self.scene, self.d = scene, d
        self.f = f = max(1, int(d / 5.0))
        self._size = scene.shape[1] // f, scene.shape[0] // f
        self._small = self._reduced(scene)
        k = self._k = 2 * int(0.5 * d / f) + 1
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (k, k)).astype(np.float32)
        self._disc = disc / disc.sum()

    def _reduced(self, image: Image) -> Float32:
        whole = image[: self._size[1] * self.f, : self._size[0] * self.f]
        if whole.dtype not in (np.uint8, np.uint16, np.float32):
            whole = whole.astype(np.float32)
        return np.asarray(cv2.resize(whole, self._size, interpolation=cv2.INTER_AREA), np.float32)

    def of(self, i: int, image: Image) -> list[Spot]:
        """Of frame i, most changed first."""
        d, f, k = self.d, self.f, self._k
        change = cv2.absdiff(self._reduced(image), self._small)
        least = 0.3 if image.dtype.kind == "u" else 1e-3  # of digitising
        noise = max(float(np.median(change[::2, ::2])) / MAD, least)
        mean = cv2.filter2D(change, -1, self._disc)
        out = []
        for _ in range(8):  # so many things of a frame are looked at
            r, c = (int(v) for v in np.unravel_index(int(np.argmax(mean)), mean.shape))
            peak = float(mean[r, c])
            if peak < 4.0 * noise:  # a thing changes the scene by more than 4 standard deviations of the noise
                break
            row, column = int((r + 0.5) * f), int((c + 0.5) * f)
            half = int(0.75 * d) + 1
            y0, x0 = max(0, row - half), max(0, column - half)
            at = np.s_[y0 : row + half + 1, x0 : column + half + 1]
            part = np.abs(image[at].astype(np.float32) - self.scene[at])
            part = np.clip(part - 0.3 * peak, 0.0, None)
            yy, xx = np.indices(part.shape)
            part = part * (np.hypot(xx + x0 - column, yy + y0 - row) < 0.75 * d)
            if not part.any():
                break
            x, y = (float(np.average(v, weights=part)) for v in (xx + x0, yy + y0))
            out.append(Spot(i, x, y, d, peak, Found(GOOD, x, y)))
            mean[max(0, r - k) : r + k + 1, max(0, c - k) : c + k + 1] = 0.0
        return out


def _size(frames: Frames, scene: Float32, path: Path) -> float:
    """Diameter of the area that changes along a path [px]."""
    sizes = []
    for s in path:
        change = np.abs(np.asarray(frames[s.i], np.float32) - scene)
        _, labels, stats, _ = cv2.connectedComponentsWithStats((change > 0.3 * s.contrast).astype(np.uint8))
        row, column = (int(np.clip(v, 0, n - 1)) for v, n in zip((round(s.y), round(s.x)), change.shape))
        if labels[row, column]:
            sizes.append(2.0 * math.sqrt(stats[labels[row, column], cv2.CC_STAT_AREA] / math.pi))
    return max(float(np.median(sizes)) if sizes else GUESS, 6.0)


def _everywhere(frames: Frames, scene: Float32, path: Path, layer: Layer, known: dict[int, Place]) -> list[Place]:
    """Every frame's fit: from those that taught, on along the path and beyond its ends, where the last ones lead."""
    from .layer import fit

    spots, fastest, look = {s.i: s for s in path}, _fastest(path), _Things(scene, layer.d)
    done: dict[int, Place] = {}
    middle = sorted(known)[len(known) // 2]
    for order in (range(middle, len(frames)), range(middle - 1, -1, -1)):
        last, gap, gone = known[middle], 1, False
        recent: list[Spot] = [s for s in path if (s.i - order.start) * order.step < 0][:: order.step][-3:]
        for i in order:
            image = np.asarray(frames[i])
            if i in spots:
                expected = spots[i].x, spots[i].y
            elif path[0].i < i < path[-1].i:
                expected = at(path, i)
            else:
                expected = at(recent, i) if gap <= HOLE else (last.x, last.y)
            start = known.get(i) or replace(last, x=expected[0], y=expected[1])
            place = fit(image, scene, layer, start, layer.d) if not gone or i in spots else last
            if i in spots:
                gone = False
            elif gone or place.found.flag:  # held before, or bounced: where it was, or something moves
                if order.step > 0 and gap <= HOLE and left(scene, *expected, 0.0):
                    gone = True
                reach = layer.d + gap * fastest if gap <= HOLE else math.inf
                things = look.of(i, image)
                near = [(t.x, t.y) for t in things if math.hypot(t.x - last.x, t.y - last.y) < reach]
                starts = [(last.x, last.y), *near] if gap <= HOLE else near[:AGAIN]
                tried = [fit(image, scene, layer, replace(last, x=x, y=y), layer.d) for x, y in starts]
                most = math.inf if gap <= HOLE and not gone else CERTAIN
                held = [p for p in tried if not p.found.flag and p.found.chi2 < most]
                place = min(held, key=lambda p: p.found.chi2, default=tried[0] if tried else place)
                if not held:
                    place = replace(place, found=Found(Flag(Reason.FLOWN_OUT if gone else Reason.HIDDEN)))
            done[i] = place
            if place.found.flag:
                gap += 1
            else:
                last, gap, gone = place, 1, False
                recent = [*recent, Spot(i, place.x, place.y, layer.d, 0.0, place.found)][-3:]
    return [done[i] for i in range(len(frames))]


def left(image: Float32, x: float, y: float, margin: float) -> bool:
    """Whether (x, y) is beyond a picture's edge by the margin [px], but not the upper one: from there it falls back."""
    h, w = image.shape
    return not (-margin < x < w + margin) or y > h + margin


def _fastest(path: Path) -> float:
    """Largest speed along a path [px a frame]."""
    return max(math.hypot(b.x - a.x, b.y - a.y) / (b.i - a.i) for a, b in itertools.pairwise(path))
