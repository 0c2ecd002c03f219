"""The ball of a film by its motion: what is seen along a smooth path, in front of a scene that stands still.

One frame cannot tell a ball from the end of a ruler, nor where a ball is that moves by several diameters from frame to
frame. The whole film can: the scene is the median of its frames, a ball is what differs from it by a round spot, in
one frame after the other where the motion so far leads.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import MAD, Array, Float32, Image
from jumpvision.base.threads import shared
from jumpvision.films.frames.base import Frames

from .background import CLEAR, View, Window
from .measure import DiscMeasure, Found, Start
from .search import find_blobs
from .unknowns import A, B

SAMPLED, FEWEST = 41, 5  # frames of which the scene is the median; of which one is known
HEADS = (60, 100, 200, 400)  # frames from the first that decide how a film is followed, see `heads`
HEAD = HEADS[1]
MOST_FRAMES = HEADS[-1]
ALIKE = 1.3  # largest ratio of diameters along a path, and CONTRASTS of contrasts
CONTRASTS = 1.8
FAR, LEAST = 2.0, 4  # diameters and spots of a path, no less
HOLE = 6  # frames that a path may be hidden for
LED, MOST_LED = 5, 8  # spots whose parabola leads over a hole, at least and at most
MET = 3  # spots at an end of a path that may be another ball's, where two met: they are beside each other no longer
BENT, STEP = 0.35, 0.8  # a third point off the line of two by this part of the speed and diameters
BESIDE, SIZE, TOLD = 1.5, 0.3, 0.1  # diameters, square diameters, share of the frames: motion that is not the ball's


class AtHand:
    """A film of which some frames are kept, and of most the window about the ball: to decode them again takes long.

    whole: kept frames by number. windows: of each frame, None where none is kept. Two threads may ask at once.
    """

    def __init__(self, frames: Frames, whole: Mapping[int, Image], windows: Sequence[Window | None]):
        self._frames, self.whole, self._windows = frames, whole, windows
        self._reading = threading.Lock()

    def __len__(self) -> int:
        return len(self._frames)

    def __getitem__(self, i: int, /) -> Image:
        if i in self.whole:
            return self.whole[i]
        with self._reading:
            return np.asarray(self._frames[i])

    def view(self, i: int) -> View:
        """Frame i; read only where no more than the window is looked at."""
        window = self._windows[i] if i < len(self._windows) and i not in self.whole else None
        if window is None:
            return View.of(self[i])
        return View(self._shape(), whole=lambda: self[i], window=window)

    def _shape(self) -> tuple[int, int]:
        height, width = next(iter(self.whole.values())).shape
        return height, width


class Head:
    """The first n frames of a film. They decide how it is followed: a longer film as a shorter one. least: rows of a
    path by which they do."""

    def __init__(self, frames: Frames, n: int):
        self.film, self._n = frames, min(n, len(frames))
        self.least = self._n // 2 if self._n < min(HEAD, len(frames)) else 0

    def __len__(self) -> int:
        return self._n

    def __getitem__(self, i: int, /) -> Image:
        return np.asarray(self.film[i])


def heads(frames: Frames) -> list[Head]:
    """Of HEADS frames, as far as there are some: the first decide where something moves through most of them, the last
    where the others show nothing."""
    return [Head(frames, n) for k, n in enumerate(HEADS) if k == 0 or len(frames) > HEADS[k - 1]]


def head_end(first: int) -> int:
    """The frame before which a track's rows decide on all, by its first good one: HEAD, whatever the film's length, or
    so many later where the ball is found late."""
    return HEAD if first < HEAD // 2 else first + HEAD


def head_rows(good: NDArray[np.int64]) -> NDArray[np.int64]:
    """Of a track's good rows those that decide on all, see `head_end`."""
    return good[good < head_end(int(good[0]))]


@dataclass(frozen=True)
class Spot:
    """A round spot that was not there before: frame, x, y, diameter d [px], contrast [grey]; found: its measurement."""

    i: int
    x: float
    y: float
    d: float
    contrast: float
    found: Found


Path = tuple[Spot, ...]  # in the order of frames


def still_scene(frames: Frames) -> Float32:
    """Median grey of each pixel over SAMPLED of the first MOST_FRAMES frames, evenly spaced."""
    stack = np.stack([np.asarray(frames[int(i)]) for i in _sampled(frames)])
    if stack.dtype not in (np.uint8, np.uint16):
        return np.median(stack.astype(np.float32), axis=0).astype(np.float32)
    out: Float32 = np.zeros(stack.shape[1:], np.float32)
    _medians(len(out), stack, 8 * stack.dtype.itemsize, out)
    return out


def _sampled(frames: Frames) -> NDArray[np.int64]:
    """SAMPLED of the first MOST_FRAMES frames: what a longer film shows does not change what a shorter one gave."""
    n = min(len(frames), MOST_FRAMES)
    return np.unique(np.linspace(0, n - 1, min(SAMPLED, n)).astype(int))


def behind(frames: Frames, scene: Float32, way: Array, d: float) -> Float32:
    """A still scene as it is behind a ball of diameter d on this way (n, 2) [px]: where it begins and ends it may have
    stood for so long that the median shows it. There, of the frames with the ball elsewhere; NaN where these are few.
    """
    out, half = scene.copy(), d + CLEAR
    for x, y in (way[0], way[-1]):
        x0, y0 = max(0, int(x - half)), max(0, int(y - half))
        part = np.s_[y0 : max(0, int(y + half) + 2), x0 : max(0, int(x + half) + 2)]
        away = [int(i) for i in _sampled(frames) if math.dist(way[i], (x, y)) > half + 0.5 * d]
        few = len(away) < FEWEST
        out[part] = np.nan if few else np.median([np.asarray(frames[i])[part] for i in away], axis=0)
    return out


@shared()
def _medians(first, last, stack, bits, out):  # type: ignore[no-untyped-def]
    """Of rows first to last - 1 of a stack (n, rows, columns) of whole grey levels, bit by bit from the highest: the
    middle value is the largest that no more than half of the others are below."""
    n, columns = len(stack), out.shape[1]
    value, below = np.zeros(columns, np.int32), np.zeros(columns, np.int32)
    for row in range(first, last):
        for rank in ((n - 1) // 2, n // 2):
            value[:] = 0
            for bit in range(bits - 1, -1, -1):
                below[:] = 0
                for i in range(n):
                    for c in range(columns):
                        below[c] += np.int32(stack[i, row, c]) < value[c] + (1 << bit)
                for c in range(columns):
                    if below[c] <= rank:
                        value[c] += 1 << bit
            for c in range(columns):
                out[row, c] += 0.5 * value[c]


def spots(i: int, image: Image, scene: Float32, diameter: float | None, polarity: str, least: float) -> list[Spot]:
    """What is round and differs from the scene in frame i, each fitted as a disc."""
    sign = 1.0 if polarity == "bright" else -1.0
    change = np.clip(sign * (np.asarray(image, dtype=np.float32) - scene), 0.0, None)
    out: list[Spot] = []
    view = View.of(image)
    for blob in find_blobs(change, diameter=diameter, polarity="bright", min_diameter=least, streak=False):
        start = Start(blob.x, blob.y, blob.d, 0.0, 0.0, rough=True)
        f = DiscMeasure(diameter, polarity, False).measure(view, start, fresh=True)
        if f.flag or f.fit is None or math.hypot(f.x - blob.x, f.y - blob.y) > 0.4 * f.diameter:
            continue
        contrast = sign * float(f.fit.p[A] - f.fit.p[B])
        r = max(1, int(0.3 * f.diameter))
        inner = change[max(0, int(f.y) - r) : int(f.y) + r + 1, max(0, int(f.x) - r) : int(f.x) + r + 1]
        if (
            inner.size
            and float(np.median(inner)) > 0.5 * contrast
            and all(math.hypot(f.x - s.x, f.y - s.y) > 0.5 * f.diameter for s in out)
        ):
            out.append(Spot(i, f.x, f.y, f.diameter, contrast, f))
    return out


def paths(by_frame: Mapping[int, Sequence[Spot]]) -> list[Path]:
    """Smooth paths through the spots, the longest first; a spot belongs to one path only."""
    found: list[Path] = []
    joined: set[tuple[int, int]] = set()  # pairs of spots that a path has joined
    for i in sorted(by_frame):
        for a in by_frame[i]:
            for b in (s for j in (i + 1, i + 2) for s in by_frame.get(j, ())):
                # no ball flies farther than 15 diameters a frame
                if (
                    (id(a), id(b)) in joined
                    or not like(a, b)
                    or math.hypot(b.x - a.x, b.y - a.y) > 15.0 * a.d * (b.i - a.i)
                ):
                    continue
                for c in (s for j in (b.i + 1, b.i + 2) for s in by_frame.get(j, ())):
                    if like(b, c) and _straight(a, b, c):
                        found.append(_longer([a, b, c], by_frame))
                        for m in (1, 2):  # a pair that leaves one out tells nothing more
                            joined |= {(id(s), id(t)) for s, t in zip(found[-1], found[-1][m:])}
    found = [p for p in found if len(p) >= LEAST and extent(p) > FAR]
    found.sort(key=lambda p: (-len(p), -float(np.median([s.contrast for s in p]))))
    kept: list[Path] = []
    taken: set[tuple[int, float, float]] = set()
    for path in found:
        if free := _free(path, taken):
            keys = {(s.i, s.x, s.y) for s in free}
            kept.append(_filled(free, by_frame, taken | keys))
            taken |= {(s.i, s.x, s.y) for s in kept[-1]}
    return _joined([_own(path, kept) for path in kept])


def _joined(kept: list[Path]) -> list[Path]:
    """With those made one that lead to one another over a hole: of one ball, which another passed."""
    out: list[Path] = []
    for path in sorted(kept, key=lambda p: p[0].i):
        for k, before in enumerate(out):
            a, b = before[-1], path[0]
            if 0 < b.i - a.i <= HOLE and like(a, b) and _near(before, b) and _near(path, a):
                out[k] = before + path
                break
        else:
            out.append(path)
    return sorted(out, key=lambda p: -len(p))


def _near(path: Path, s: Spot) -> bool:
    """Whether a path leads to a spot, to half a diameter."""
    return math.dist(led_to(path, s.i), (s.x, s.y)) < 0.5 * s.d


def _own(path: Path, kept: Sequence[Path]) -> Path:
    """Without spots at its ends that are off its own way and on another's: two balls that met."""
    beside = [p for p in kept if p is not path]
    for turn in (1, -1):
        way = path[::turn]
        for cut in range(1, MET + 1):
            s, rest = way[cut - 1], way[cut:]
            if len(rest) >= LED and not _near(rest, s):
                others = (tuple(o for o in p if (o.i - s.i) * turn > 0) for p in beside)
                if any(len(p) >= LED and like(p[0], s) and _near(p, s) for p in others):
                    path = rest[::turn]
    return path


def _free(path: Path, taken: set[tuple[int, float, float]]) -> Path:
    """The longest run of a path's spots that no other has: two balls that meet share some. Empty where none is left."""
    runs: list[list[Spot]] = [[]]
    for s in path:
        if (s.i, s.x, s.y) in taken:
            runs.append([])
        else:
            runs[-1].append(s)
    longest = max(runs, key=len)
    free = tuple(longest)
    return free if len(free) >= LEAST and extent(free) > FAR else ()


def _filled(path: Path, by_frame: Mapping[int, Sequence[Spot]], taken: set[tuple[int, float, float]]) -> Path:
    """With spots in its holes and before its first that are off it by less than a jerk: as a hand lets go."""
    out = {s.i: s for s in path}
    for i in range(path[0].i - 1, path[-1].i + 2):
        if i in out or i not in by_frame:
            continue
        near = min(path, key=lambda s: abs(s.i - i))
        j = path.index(near)
        other = path[j + 1] if j + 1 < len(path) else path[j - 1]
        speed = math.hypot(other.x - near.x, other.y - near.y) / abs(other.i - near.i)
        x, y = at(path, i)
        free = [s for s in by_frame[i] if (s.i, s.x, s.y) not in taken and like(near, s)]
        # a hand lets go, or a ball bounces: off the path by no more than its speed
        free = [s for s in free if math.hypot(s.x - x, s.y - y) < 1.0 * speed + STEP * s.d]
        if len(free) == 1:
            out[i] = free[0]
    return tuple(out[i] for i in sorted(out))


def extent(path: Path) -> float:
    """How far it reaches [diameters]."""
    x, y = (np.array([getattr(s, k) for s in path]) for k in "xy")
    return float(math.hypot(np.ptp(x), np.ptp(y)) / np.median([s.d for s in path]))


def at(path: Sequence[Spot], i: int) -> tuple[float, float]:
    """(x, y) of the parabola through the three spots nearest to frame i (Lagrange)."""
    near = sorted(path, key=lambda s: abs(s.i - i))[:3]
    x = y = 0.0
    for s in near:
        share = math.prod((i - o.i) / (s.i - o.i) for o in near if o is not s)
        x, y = x + share * s.x, y + share * s.y
    return x, y


def led_to(path: Sequence[Spot], i: int) -> tuple[float, float]:
    """(x, y) of the parabola through the MOST_LED spots nearest to frame i, of LED or more; else as `at`."""
    near = sorted(path, key=lambda s: abs(s.i - i))[:MOST_LED]
    if len(near) < LED:
        return at(path, i)
    x, y = led([s.i for s in near], [(s.x, s.y) for s in near], i)
    return float(x), float(y)


def led(rows: ArrayLike, values: ArrayLike, i: ArrayLike) -> Array:
    """The parabola through values (n, ...) in frames `rows` (n,), or the line where there are two, in frame i; in
    several where the values are numbers."""
    t = np.asarray(rows, float)
    middle = t.mean()
    p = np.polyfit(t - middle, np.asarray(values, float), min(2, t.size - 1))
    return np.asarray(np.polyval(p, np.asarray(i, float) - middle))


def like(a: Spot, b: Spot) -> bool:
    """Whether two spots are alike in diameter and contrast."""
    return 1 / ALIKE < a.d / b.d < ALIKE and 1 / CONTRASTS < a.contrast / b.contrast < CONTRASTS


def _straight(a: Spot, b: Spot, c: Spot) -> bool:
    """Whether c is where the motion from a to b leads, bent a little."""
    n, m = b.i - a.i, c.i - b.i
    vx, vy = (b.x - a.x) / n, (b.y - a.y) / n
    return math.hypot(c.x - b.x - m * vx, c.y - b.y - m * vy) < m * (BENT * math.hypot(vx, vy) + STEP * b.d)


def _longer(path: list[Spot], by_frame: Mapping[int, Sequence[Spot]]) -> Path:
    """The path with what lies on its continuation on both ends."""
    for end in (1, -1):
        while True:
            last = path[-1] if end > 0 else path[0]
            tail = tuple(path[-4:] if end > 0 else path[:4])
            speed = math.hypot(tail[-1].x - tail[0].x, tail[-1].y - tail[0].y) / max(tail[-1].i - tail[0].i, 1)
            best = None
            for gap in range(1, HOLE + 1):
                x, y = at(tail, last.i + end * gap)
                # the next lies near the parabola through the last
                reach = (0.7 * last.d + 0.12 * speed) * (0.5 + 0.5 * gap)
                near = [
                    (math.hypot(s.x - x, s.y - y), s) for s in by_frame.get(last.i + end * gap, ()) if like(last, s)
                ]
                off, best = min(near, key=lambda n: n[0], default=(math.inf, None))
                if off < reach:
                    break
                best = None
            if best is None:
                break
            path = [*path, best] if end > 0 else [best, *path]
    return tuple(path)


def moving_paths(frames: Frames, scene: Float32, diameter: float | None, polarity: str, least: float) -> list[Path]:
    """Paths of what moves through the first MOST_FRAMES of a film, the longest first."""
    n = min(len(frames), MOST_FRAMES)
    return paths({i: spots(i, np.asarray(frames[i]), scene, diameter, polarity, least) for i in range(n)})


def elsewhere(
    frames: Frames, scene: Float32, x: float, y: float, d: float, contrast: float
) -> tuple[float, float] | None:
    """Where (x, y) something as large as the ball moves, BESIDE diameters or more away from it, in SAMPLED frames; None
    where nothing does in TOLD of them."""
    places: list[tuple[float, float]] = []
    which = _sampled(frames)
    for i in which:
        off = np.abs(np.asarray(frames[int(i)], dtype=np.float32) - scene)
        noise = float(np.median(off)) / MAD
        changed = (cv2.blur(off, (3, 3)) > max(0.25 * contrast, 5.0 * noise)).astype(np.uint8)
        _, _, stats, centres = cv2.connectedComponentsWithStats(changed)
        for (_, _, _, _, area), (u, v) in zip(stats[1:], centres[1:], strict=True):
            if area > SIZE * d * d and math.hypot(u - x, v - y) > BESIDE * d:
                places.append((float(u), float(v)))
                break
    return places[len(places) // 2] if len(places) >= max(2.0, TOLD * which.size) else None
