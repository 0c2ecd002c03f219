"""Balls in a whole film, read once: followed frame by frame, the still scene behind them learned on the way."""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextvars import copy_context
from dataclasses import replace

import numpy as np

from jumpvision.base.arrays import Image
from jumpvision.base.progress import watch
from jumpvision.films.frames.base import Frames

from .background import Background, Kept, SceneSum, View, Window
from .measure import AS_THEY_ARE, Block, Found, window_half
from .moving import HEAD, AtHand, head_end
from .pieces import SHARP, in_pieces
from .reasons import Flag, Reason
from .refine import refined
from .track import BallSettings, BallTrack, BallTracker, as_track, merged
from .unknowns import WX, WY, A
from .validate import validated, without_still_objects

VIEWS = 100  # frames that all count for the scene; of the next 100 every second does, of the next 200 every fourth ...
LEARNED = 60, 1000  # frames that the scene is learned from: the fewer where it is known by then, at most the more
KEPT = 2**25  # bytes of the first LEARNED frames, kept whole for their last fit; of each kind of samples
SAMPLES = 16  # frames of each kind
MEMORY = 2**28  # bytes of windows kept, in a file; frames beyond are read again
AS_CERTAIN = 1.05  # times the first's median sigma, up to which a second track is taken
WORTHWHILE = 500  # frames from which on a frame's whole measurement is compiled code's: fewer are done sooner without
BLOCK = 16  # windows that are measured together without the scene
TURN, WAY = 12, 8.0  # frames on either side of a sharp turn of which more is kept; by how much, in the ball's steps


def track_film(
    frames: Frames, settings: BallSettings, *, scene: bool, markers: Sequence[tuple[float, float]] = ()
) -> list[BallTrack]:
    """The ball of `settings` and one more for each of `markers`, (x, y) in the first frame [px], in all frames.

    With `scene` each is measured a second time without the still scene behind it. The second result is taken where it
    loses no more frames and is no less certain in the median; a film whose scene moves, or hides behind a ball that
    never moves, keeps the first.
    """
    follower = FilmTracker(settings, scene=scene, markers=markers)
    for i in watch(range(len(frames)), "frames tracked", len(frames)):
        follower.see(frames[i])
    return follower.finish(frames)


class Samples:
    """Some frames of a film's head: evenly spread ones, and one of each place that the ball comes to."""

    def __init__(self) -> None:
        self._end = math.inf
        self.even: dict[int, Image] = {}
        self.places: dict[int, tuple[Found, Image]] = {}
        self._step = 1

    def see(self, i: int, image: Image, found: Found) -> None:
        """Frame i, where the ball was found."""
        if not found.flag:
            self._end = min(self._end, head_end(i))
        if i >= self._end:
            return
        most = min(SAMPLES, KEPT // max(1, image.nbytes))
        if i % self._step == 0:
            self.even[i] = image
            if len(self.even) > most:
                self._step *= 2
                self.even = {k: a for k, a in self.even.items() if k % self._step == 0}
        if not found.flag and len(self.places) < most:
            far = (math.hypot(f.x - found.x, f.y - found.y) > found.diameter for f, _ in self.places.values())
            if all(far):
                self.places[i] = found, image

    @property
    def all(self) -> dict[int, Image]:
        """The frames by number."""
        return self.even | {i: image for i, (_, image) in self.places.items()}


class FilmTracker:
    """`track_film` for a film that is handed over frame by frame (`see`, in order), while it is decoded."""

    def __init__(self, settings: BallSettings, *, scene: bool, markers: Sequence[tuple[float, float]] = ()):
        self.settings = settings  # of the first ball
        self._settings = [settings] + [replace(settings, seed=m) for m in markers]
        self._trackers = [BallTracker(s) for s in self._settings]
        self._found: list[list[Found]] = []  # by frame, then by ball
        self._enough = False  # nobody waits for the measurements without the scene
        self._windows = [Kept() for _ in self._settings]  # of each ball
        self._scene = SceneSum() if scene and settings.method == "disc" else None
        self._behind: Background | None = None  # the scene, once it is learned
        self._learning = self._scene is not None
        self._room = MEMORY
        self._kept: list[Image] | None = None
        if self._scene is not None and not markers and not settings.streak:
            self._kept = []
        self._samples = Samples()
        self._last: deque[tuple[int, Image, Found]] = deque(maxlen=TURN)  # frames in which the ball was found
        self._turned, self._wide = -TURN - 1, -1  # frame of the last sharp turn; last one of which more is kept
        self.shape = (0, 0)

    def see(self, image: Image) -> None:
        """The next frame (row, column); it is kept for a while and must not change."""
        if self.settings.method == "template":  # has to see the whole film first
            return
        self._follow(image)

    @property
    def found(self) -> list[Found]:
        """The first ball in the frames followed so far."""
        return [f[0] for f in self._found]

    def _follow(self, image: Image) -> None:
        i, self.shape = len(self._found), (image.shape[0], image.shape[1])
        plain = self._trackers[0].next(image) if len(self._trackers) == 1 and i >= WORTHWHILE else None
        found = [plain] if plain else together(self._trackers, [View.of(image) for _ in self._trackers], None)
        self._found.append(found)
        self._samples.see(i, image, found[0])
        if self._kept is not None and i < LEARNED[0]:
            self._kept.append(image)
            if image.nbytes * len(self._kept) > KEPT:
                self._kept = None
        if self._scene is None:
            return
        for kept, f in zip(self._windows, found, strict=True):
            kept.append(self._window(image, f))
        if len(found) == 1 and not found[0].flag:
            self._about_turns(i, image, found[0])
        if not self._learning or i % _stride(i):
            return
        if not any(f.flag for f in found) and found[0].p is not None:
            self._scene.add(image, [(f.x, f.y, f.diameter + _streak(f)) for f in found], float(found[0].p[A]))
        if i + 1 >= LEARNED[1] or (i + 1 >= LEARNED[0] and self._scene.covered):
            self._learning, self._behind = False, self._scene.background()
        elif i + 1 == HEAD:
            self._scene.settle()

    def _about_turns(self, i: int, image: Image, found: Found) -> None:
        """Keeps more of the frames beside a sharp turn: there it is asked later whether two balls met."""
        self._last.append((i, image, found))
        if len(self._last) > 4 and len(self._last) * image.nbytes > KEPT:
            self._last.popleft()
        if len(self._last) < 4:
            return
        a, b, c, d = [f for *_, f in self._last][-4:]
        if math.hypot(d.x - 3 * c.x + 3 * b.x - a.x, d.y - 3 * c.y + 3 * b.y - a.y) > SHARP[0] * d.diameter:
            self._turned = i
        if i <= self._turned + TURN:
            way = [math.hypot(f.x - e.x, f.y - e.y) for (*_, e), (*_, f) in itertools.pairwise(self._last)]
            for j, before, f in self._last:
                if j > self._wide:
                    self._windows[0].put(j, self._window(before, f, WAY * max(way)))
            self._wide = i

    def finish(self, frames: Frames) -> list[BallTrack]:
        """The tracks, the first ball's first. frames: the same film, for what was not kept of it."""
        tracks = zip(self._tracks(frames), self._settings, strict=True)
        kept = AtHand(frames, self._samples.all, self._windows[0])
        return [in_pieces(t, s.seed is not None, kept if s.method == "disc" else None, s.polarity) for t, s in tracks]

    def _tracks(self, frames: Frames) -> list[BallTrack]:
        if self.settings.method == "template":
            from .template import track_template

            return [track_template(frames, s) for s in self._settings]
        kept = AtHand(frames, self._samples.all, self._windows[0])
        with ThreadPoolExecutor(1) as thread:  # each is half of the work that is left
            again = thread.submit(copy_context().run, self._without_scene, kept)
            try:
                return self._decided(kept, again)
            finally:
                self._enough = True

    def _decided(self, frames: AtHand, again: Future[list[list[Found]]]) -> list[BallTrack]:
        """Proves the track while the balls are measured again without the scene, and takes the better one."""
        first = [as_track(list(f)) for f in zip(*self._found, strict=True)]
        if len(first) == 1:
            sure = validated(first[0], frames, self.settings)
            if sure is not first[0]:
                self._enough = True
                return self._refined([sure])
        if not (found := again.result()):
            return self._refined(first) if len(frames) <= LEARNED[0] else first
        second = [as_track(list(f)) for f in zip(*found, strict=True)]
        if len(second) == 1 and not self.settings.streak:  # a sticker's remains, where the ball has left
            second = [without_still_objects(second[0], frames, self.settings)]
        better = [_better(a, b) for a, b in zip(first, second, strict=True)]
        return self._refined(better) if len(frames) <= LEARNED[0] or better[0] is not first[0] else better

    def _refined(self, tracks: list[BallTrack]) -> list[BallTrack]:
        """With what the first LEARNED frames share taken from all of these, where the still scene may be taken out and
        the ball is alone. Later rows know it from the frames before them."""
        if self._kept is None:
            return tracks
        return [refined(tracks[0], self._kept, self.settings.polarity)]

    def _without_scene(self, frames: AtHand) -> list[list[Found]]:
        """The measurements of all frames once more, without the scene; none where too little of it is known."""
        scene = self._scene.background() if self._scene and self._learning else self._behind
        if scene is None:
            return []
        trackers = [BallTracker(s) for s in self._settings]
        out: list[list[Found]] = []
        block, begin, end = None, 0, 0
        for i in watch(range(len(self._found)), "frames tracked without the scene", len(self._found)):
            if self._enough:
                break
            if i < len(out):  # followed with those before
                continue
            if i >= end:
                block, begin = self._block(i) if len(self._found) > WORTHWHILE else None, i
                end = i + (len(block.windows) if block else 1)
            if block:
                out += [[f] for f in trackers[0].follow(block, i - begin, self.shape, scene)]
            if len(out) == i:
                windows = [kept[i] for kept in self._windows]
                views = [View(self.shape, whole=lambda: frames[i], window=w, scene=scene) for w in windows]  # noqa: B023
                out.append(together(trackers, views, self._found[i]))
        return out

    def _block(self, i: int) -> Block | None:
        """The frames from i on in which the one ball was found in windows of one size; None where there is none."""
        windows: list[Window] = []
        starts: list[tuple[float, float, float, float]] = []
        for k, (found, *others) in enumerate(self._found[i : i + BLOCK], i):
            if others or found.p is None or (window := self._windows[0][k]) is None:
                break
            if windows and window.pixels.shape != windows[0].pixels.shape:
                break
            windows.append(window)
            starts.append((found.x, found.y, found.p[WX], found.p[WY]))
        if not windows:
            return None
        corners = np.array([(w.x0, w.y0) for w in windows])
        pixels = np.stack([w.pixels for w in windows])
        if pixels.dtype not in AS_THEY_ARE:
            pixels = pixels.astype(np.float64)
        return Block(pixels, corners, np.array(starts))

    def _window(self, image: Image, found: Found, more: float = 0.0) -> Window | None:
        """The part of a frame that the ball is measured in, and `more` px around it."""
        if found.flag or found.p is None:
            return None
        p = found.p
        half_x, half_y = (math.ceil(window_half(found.diameter) + 0.5 * abs(p[w]) + more) + 2 for w in (WX, WY))
        x0, y0 = max(0, int(found.x) - half_x), max(0, int(found.y) - half_y)
        part = image[y0 : int(found.y) + half_y + 1, x0 : int(found.x) + half_x + 1]
        self._room -= part.nbytes
        return Window(part, x0, y0) if self._room > 0 else None


def together(trackers: Sequence[BallTracker], views: Sequence[View], before: Sequence[Found] | None) -> list[Found]:
    """One frame for all trackers: each knows where the others expect theirs, and no ball is given to two. before: what
    was measured in it earlier."""
    expected = [t.expected for t in trackers]
    found = []
    hints: Sequence[Found | None] = before or [None] * len(trackers)
    for k, (tracker, view, hint) in enumerate(zip(trackers, views, hints, strict=True)):
        others = [e for m, e in enumerate(expected) if m != k and e is not None]
        found.append(tracker.look(view, hint if hint and not hint.flag else None, others))
    for k, f in enumerate(found):
        for m in range(k):
            g = found[m]
            # two balls nearer than half a diameter are one
            if not f.flag and not g.flag and math.hypot(f.x - g.x, f.y - g.y) < 0.5 * f.diameter:
                worse = k if _off(f, expected[k]) > _off(g, expected[m]) else m
                found[worse] = Found(Flag(Reason.OTHER_BALL))
    return [t.keep(f) for t, f in zip(trackers, found, strict=True)]


def _off(found: Found, expected: tuple[float, float] | None) -> float:
    return math.hypot(found.x - expected[0], found.y - expected[1]) if expected else math.inf


def _streak(found: Found) -> float:
    return 0.0 if found.p is None else math.hypot(found.p[WX], found.p[WY])


def _stride(i: int) -> int:
    return 1 << max(0, int(math.log2(max(i, 1) / VIEWS)) + 1 if i >= VIEWS else 0)


def _better(first: BallTrack, again: BallTrack) -> BallTrack:
    """A second track where it is about as certain in the first frames (what the scene pulls stands in no sigma of the
    first), with the first's rows where it loses more of these; else the first."""
    look = slice(0, HEAD)
    if not np.nanmedian(again.sigma[look]) <= AS_CERTAIN * np.nanmedian(first.sigma[look]):
        return first
    if np.count_nonzero(again.flag[look] != "") <= np.count_nonzero(first.flag[look] != ""):
        return again
    return merged(again, first, again.flag != "")
