"""A ball of any face in flight: found by its motion before the still scene, then fitted as a layer, see `layer`."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import cv2
import numpy as np

from jumpvision.base.arrays import MAD, Float32
from jumpvision.films.frames.base import Frames
from jumpvision.films.vision.ball.measure import Found
from jumpvision.films.vision.ball.moving import HOLE, MOST_FRAMES, Path, Spot, at, extent, paths, still_scene
from jumpvision.films.vision.ball.reasons import GOOD, Flag, Reason
from jumpvision.films.vision.ball.track import BallTrack, as_track

from .joint import adjusted
from .layer import Layer, Place, fit, learned

FLIGHT, SURE = 6, 0.7  # frames of a path that nobody clicked, and share of them that must fit
BESIDE, DARKER = (0.6, 2.5), 1.4  # diameters between a ball and its shadow; of a shadow's change, the ball's
GUESS = 12.0  # px: first diameter where none is known
CENTRE = "the target is a ball in flight: positions are of its centre, not of the place that was clicked"
KNOWN = ", known in its picture to {:.2g} px, an offset that turns with the ball"


def in_flight(frames: Frames, diameter: float | None, seed: tuple[float, float] | None) -> BallTrack | None:
    """The ball that flies from the seed, or the farthest where none is given, in every frame; None where nothing flies,
    it is not round, of another diameter [px], or its picture does not hold. notes: of what its positions are."""
    if len(frames) < FLIGHT:
        return None
    scene = still_scene(frames)
    path = _path(frames, scene, diameter or GUESS, seed)
    if path is not None and diameter is None:
        size = _size(frames, scene, path)
        path = _path(frames, scene, size, seed)
    if path is None:
        return None
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
    better = adjusted(frames, scene, places, layer, outlined)
    # a ball whose rim is not seen all round must fit so well, and its centre [px] be known so well
    if not outlined and (better is None or better.misfit > 1.5 or better.centre > 0.1):
        return None
    if better is None:
        return replace(as_track([p.found for p in places]), notes=(CENTRE,))
    return replace(as_track([p.found for p in better.places]), notes=(CENTRE + KNOWN.format(better.centre),))


def is_shadow(track: BallTrack, frames: Frames) -> bool:
    """Whether a dark track goes beside something that changes the scene more, as a shadow beside its ball."""
    good = np.flatnonzero(track.flag == "")
    if good.size < FLIGHT:
        return False
    scene, d, beside = still_scene(frames), float(np.median(track.diameter[good])), 0
    for i in good:
        things = _things(int(i), np.asarray(frames[int(i)], np.float32), scene, d)
        away = [math.hypot(t.x - track.x[i], t.y - track.y[i]) / d for t in things]
        own = max((t.contrast for t, a in zip(things, away) if a < BESIDE[0]), default=0.0)
        beside += any(t.contrast > DARKER * own for t, a in zip(things, away) if BESIDE[0] < a < BESIDE[1])
    return beside > SURE * good.size


def _path(frames: Frames, scene: Float32, d: float, seed: tuple[float, float] | None) -> Path | None:
    """The farthest path of those that begin at the seed, of two as far the one of more contrast."""
    n = min(len(frames), MOST_FRAMES)
    things = {i: _things(i, np.asarray(frames[i], np.float32), scene, d) for i in range(n)}
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


def _things(i: int, image: Float32, scene: Float32, d: float) -> list[Spot]:
    """What has changed against the scene in frame i, as large as the diameter, most changed first."""
    change = np.abs(image - scene)
    noise = max(float(np.median(change)) / MAD, 1e-3)
    k = 2 * int(0.5 * d) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (k, k)).astype(np.float32)
    mean = cv2.filter2D(change, -1, disc / disc.sum())
    out = []
    for _ in range(8):  # so many things of a frame are looked at
        row, column = (int(v) for v in np.unravel_index(int(np.argmax(mean)), mean.shape))
        peak = float(mean[row, column])
        if peak < 4.0 * noise:  # a thing changes the scene by more than 4 standard deviations of the noise
            break
        half = int(0.75 * d) + 1
        y0, x0 = max(0, row - half), max(0, column - half)
        part = np.clip(change[y0 : row + half + 1, x0 : column + half + 1] - 0.3 * peak, 0.0, None)
        yy, xx = np.indices(part.shape)
        part = part * (np.hypot(xx + x0 - column, yy + y0 - row) < 0.75 * d)
        x, y = (float(np.average(v, weights=part)) for v in (xx + x0, yy + y0))
        out.append(Spot(i, x, y, d, peak, Found(GOOD, x, y)))
        mean[max(0, row - k) : row + k + 1, max(0, column - k) : column + k + 1] = 0.0
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
    """Every frame's fit: from those that taught, on along the path and beyond its ends."""
    spots = {s.i: s for s in path}
    done: dict[int, Place] = {}
    middle = sorted(known)[len(known) // 2]
    for order in (range(middle, len(frames)), range(middle - 1, -1, -1)):
        last, gap = known[middle], 1
        for i in order:
            image = np.asarray(frames[i], np.float32)
            expected = (spots[i].x, spots[i].y) if i in spots else at(path, i)
            start = known.get(i) or replace(last, x=expected[0], y=expected[1])
            place = fit(image, scene, layer, start, layer.d)
            if place.found.flag and i not in spots:  # held before, or bounced: where it was, or something moves
                if order.step > 0 and left(scene, *expected, 0.0):
                    place = replace(place, found=Found(Flag(Reason.FLOWN_OUT)))
                elif gap <= HOLE:
                    reach = layer.d + gap * _fastest(path)
                    near = [(t.x, t.y) for t in _things(i, image, scene, layer.d)]
                    near = [p for p in near if math.hypot(p[0] - last.x, p[1] - last.y) < reach]
                    starts = [replace(last, x=x, y=y) for x, y in [(last.x, last.y), *near]]
                    tried = [p for p in (fit(image, scene, layer, s, layer.d) for s in starts) if not p.found.flag]
                    place = min(tried, key=lambda p: p.found.chi2, default=place)
            done[i] = place
            if place.found.flag.reason is Reason.FLOWN_OUT:
                gap = HOLE + 1
            last, gap = (last, gap + 1) if place.found.flag else (place, 1)
    return [done[i] for i in range(len(frames))]


def left(image: Float32, x: float, y: float, margin: float) -> bool:
    """Whether (x, y) is beyond a picture's edge by the margin [px], but not the upper one: from there it falls back."""
    h, w = image.shape
    return not (-margin < x < w + margin) or y > h + margin


def _fastest(path: Path) -> float:
    """Largest speed along a path [px a frame]."""
    return max(math.hypot(b.x - a.x, b.y - a.y) / (b.i - a.i) for a, b in itertools.pairwise(path))
