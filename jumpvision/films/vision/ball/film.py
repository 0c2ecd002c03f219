"""Balls in a whole film, read once: candidates of every frame, one path a ball, the still scene learned on the way."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import MAD, Array, Float32, Image
from jumpvision.base.progress import watch
from jumpvision.films.frames.base import Frames

from .background import Background, Kept, SceneSum, View, Window, still_scene
from .candidates import Scene, noise_of
from .disc import FRAMES
from .follow import SURE, Ball, Balls
from .measure import AS_THEY_ARE, Block, DiscMeasure, Found, Start, window_half
from .path import Nodes, Path
from .reasons import Flag, Reason
from .refine import refined
from .scatter import SHARED, shared_noise, with_scatter
from .track import BallSettings, BallTrack, as_track
from .unknowns import WX, WY, A

HEAD = 60  # frames that tell the scene and the ball; later rows do not change them
KEPT = 2**25  # bytes of these, kept whole; of larger frames fewer
LEAST = 5  # frames of which a scene is known
GONE = 3  # frames of the head in which a spot of the scene is not there: it is none
LAG = 60  # frames: a row does not depend on film that comes more than twice as many later
VIEWS = 100  # frames that all count for the scene; of the next 100 every second does, of the next 200 every fourth ...
LEARNED = 60, 1000  # frames that the scene is learned from: the fewer where it is known by then, at most the more
MEMORY = 2**28  # bytes of windows kept, in a file; frames beyond are read again
AS_CERTAIN = 1.05  # times the first's median sigma, up to which a second track is taken
WORTHWHILE = 500  # frames from which on a frame's whole measurement is compiled code's: fewer are done sooner without
BLOCK = 16  # windows that are measured together without the scene
STILL = "doubt: stands still while something moves at ({:.0f}, {:.0f})"
REMEDY = "; give track.seed = [column, row]"


def track_film(
    frames: Frames, settings: BallSettings, *, scene: bool, markers: Sequence[tuple[float, float]] = ()
) -> list[BallTrack]:
    """Track the ball of `settings` and one more for each of `markers`, (x, y) in the first frame [px], in all frames.

    With `scene` each is measured a second time without the still scene behind it. The second result is taken where it
    is no less certain in the median; a film whose scene moves, or hides behind a ball that rests, keeps the first.
    """
    follower = FilmTracker(settings, scene=scene, markers=markers)
    for i in watch(range(len(frames)), "frames tracked", len(frames)):
        follower.see(frames[i])
    return follower.finish(frames)


def track_ball(images: Iterable[NDArray[np.generic]], **settings: Any) -> BallTrack:
    """Follow one ball through `images`, each (row, column) of grey levels (integer or float; NaN = no data).

    settings: those of BallSettings, all of them. A frame without a sound ball is flagged, never an exception.
    Raises ValueError for an argument out of range or an image that is not two-dimensional.
    """
    how, frames = BallSettings(**settings), list(images)
    for i, image in enumerate(frames):
        if np.ndim(image) != 2:
            raise ValueError(f"images[{i}] has shape {np.shape(image)}: must be (row, column); convert colour to grey")
    return track_film(frames, how, scene=False)[0]


def scene_of(head: Sequence[Image], sign: float, diameter: float | None) -> Scene:
    """Learn what stands still in the first frames of a film. sign: 1 a bright ball, -1 a dark one."""
    if len(head) < LEAST:
        return Scene(None, noise_of(head, None), sign, diameter)
    grey = still_scene(head)
    changes = np.stack([sign * (np.asarray(f, np.float32) - grey) for f in head[:: max(1, len(head) // 30)]])
    k = min(GONE, len(changes) - 1)
    return Scene(grey, noise_of(head, grey), sign, diameter, np.partition(changes, k, axis=0)[k])


def moving_ball(head: Sequence[Image], polarity: str, rows: float) -> tuple[int, float, float, float] | None:
    """Return (frame, x, y, diameter) [px] of the first row of a ball that moves in this share of frames, or None."""
    ball = Ball(BallSettings(None, polarity, "disc", 1.5, None, False, 0.0))
    balls, scene = Balls([ball]), scene_of(head, ball.sign, None)
    for image in head:
        balls.add(image, scene)
    balls.learn((head[0].shape[0], head[0].shape[1]))
    nodes, (path,) = balls.paths()
    found = np.flatnonzero(path.node >= 0)
    if ball.forgiven or found.size < rows * len(head):
        return None
    k = path.node[found[0]]
    return int(found[0]), float(nodes.x[k]), float(nodes.y[k]), float(nodes.d[k])


class FilmTracker:
    """`track_film` for a film that is handed over frame by frame (`see`, in order), while it is decoded."""

    def __init__(self, settings: BallSettings, *, scene: bool, markers: Sequence[tuple[float, float]] = ()):
        self.settings = settings  # of the first ball
        self._settings = [settings] + [replace(settings, seed=m) for m in markers]
        self._balls = [Ball(s) for s in self._settings]
        self._together = Balls(self._balls)
        self._head: list[Image] = []
        self._scene: Scene | None = None  # for the candidates
        self._windows = [Kept() for _ in self._settings]  # of each ball
        self._sum = SceneSum() if scene and settings.method == "disc" else None
        self._behind: Background | None = None  # the scene behind the ball, once it is learned
        self._decided: dict[int, tuple[float, float]] = {}  # where the first ball is
        self._learning = self._sum is not None
        self._shared = 0.0  # of the noise of neighbouring pixels
        self._room, self._n = MEMORY, 0
        self.shape = (0, 0)

    def see(self, image: Image) -> None:
        """Take the next frame (row, column); it is kept for a while and must not change."""
        if self.settings.method == "template":  # has to see the whole film first
            return
        self.shape = (image.shape[0], image.shape[1])
        if self._scene is not None:
            self._together.next(image, self._scene, len(self._balls) == 1 and self._n >= WORTHWHILE)
            self._keep(self._n, image)
            self._n += 1
            return
        self._head.append(image)
        if len(self._head) >= HEAD or len(self._head) * image.nbytes >= KEPT:
            self._look()

    @property
    def found(self) -> list[Found]:
        """Return the measurements of the first ball in the frames followed so far."""
        return self._balls[0].found

    def candidates(self, i: int) -> list[tuple[float, float, float, float]]:
        """Return x, y, diameter [px] and probability of what may be the first ball in frame i."""
        n, before = len(self._together.spots), {k: v for k, v in self._decided.items() if k < i - LAG // 2}
        return self._together.candidates(i, max(0, i - LAG), min(n, i + LAG), before) if i < n else []

    def _look(self) -> None:
        """Learn scene and balls from the head, and measure them there."""
        head, sign = self._head, 1.0 if self.settings.polarity == "bright" else -1.0
        self._scene = scene_of(head, sign, self.settings.diameter)
        for image in head:
            self._together.add(image, self._scene)
        self._together.learn(self.shape)
        self._shared = max(shared_noise(head, places, d) for places, d in self._together.places())
        for ball in self._balls:
            ball.white = self._shared < SHARED
        self._together.follow_all(head)
        for i, image in enumerate(head):
            self._keep(i, image)
        self._n = len(head)

    def _keep(self, i: int, image: Image) -> None:
        """Keep what the second measurement needs of a frame, and add it to the scene."""
        if self._sum is None:
            return
        found = [ball.found[i] for ball in self._balls]
        for kept, f in zip(self._windows, found, strict=True):
            kept.append(self._window(image, f))
        if not self._learning or i % _stride(i):
            return
        if not any(f.flag for f in found) and found[0].p is not None:
            self._sum.add(image, [(f.x, f.y, f.diameter + _streak(f)) for f in found], float(found[0].p[A]))
        if i + 1 >= LEARNED[1] or (i + 1 >= LEARNED[0] and self._sum.covered):
            self._learning, self._behind = False, self._sum.background()

    def settle(self) -> None:
        """Learn scene and balls from the frames so far, if that is not done yet."""
        if self._scene is None and self._head:
            self._look()

    def finish(self, frames: Frames) -> list[BallTrack]:
        """Return the tracks, the first ball's first. frames: the same film, for what was not kept of it."""
        if self.settings.method == "template":
            from .template import track_template

            return [track_template(frames, s) for s in self._settings]
        self.settle()
        tracks = self._decide_rows(frames)
        out = []
        for number, (ball, (found, probability)) in enumerate(zip(self._balls, tracks)):
            track = as_track(found)
            track = self._refit(number, ball, track, frames)
            if self._shared > SHARED:
                track = with_scatter(track)
            out.append(replace(self._flag_if_still(track, ball), probability=probability))
        return out

    def _decide_rows(self, frames: Frames) -> list[tuple[list[Found], Array]]:
        """Return of each ball the measurements along the likeliest path, and the probability of each row."""
        n = len(self._together.spots)
        out = [(list(ball.found), np.ones(n)) for ball in self._balls]
        at: list[dict[int, tuple[float, float]]] = [{} for _ in self._balls]  # places in frames that are decided
        exchanged = [0.0] * len(self._balls)  # likelihood that it is another by then
        for begin in range(0, n, LAG):
            first = max(0, begin - LAG)
            nodes, paths = self._together.paths(first, min(n, begin + 2 * LAG), at)
            for b, (ball, path, (found, probability), known) in enumerate(zip(self._balls, paths, out, at)):
                for i in range(begin, min(n, begin + LAG)):
                    exchanged[b] = max(exchanged[b], path.exchanged[i - first])
                    probability[i] = 1.0 / (1.0 / path.probability[i - first] + exchanged[b])
                    found[i] = self._decide_row(ball, frames, i, nodes, path, i - first, probability[i])
                    k = int(path.node[i - first])
                    known[i] = (float(nodes.x[k]), float(nodes.y[k])) if k >= 0 else (math.inf, math.inf)
        self._decided = at[0]
        return out

    def _decide_row(
        self, ball: Ball, frames: Frames, i: int, nodes: Nodes, path: Path, t: int, probability: float
    ) -> Found:
        """Measure or flag frame i, which is row t of a path."""
        k, found = int(path.node[t]), ball.found[i]
        if k >= 0 and probability < SURE:
            other = int(path.other[t])
            rival = f"at ({nodes.x[other]:.0f}, {nodes.y[other]:.0f})" if other >= 0 else "none"
            if path.probability[t] > SURE:
                rival = "another ball"
            return Found(Flag(Reason.UNSURE, (probability, rival)))
        if k < 0:
            return found if found.flag else Found(Flag(Reason.NO_BALL))
        if i in ball.sure:
            return found
        away = math.hypot(found.x - nodes.x[k], found.y - nodes.y[k]) / nodes.d[k]
        if (not found.flag and away < 0.6) or (found.flag and found.flag.reason is not Reason.NO_BALL):
            return found
        return ball.measure(i, View.of(np.asarray(frames[i])), nodes, path, t)

    def _flag_if_still(self, track: BallTrack, ball: Ball) -> BallTrack:
        """Flag a track that stands still where something moves elsewhere; a click is believed, and the doubt said."""
        good = np.flatnonzero(track.flag[: len(self._head)] == "")
        if len(self._head) < LEAST or not good.size or self._scene is None or self._scene.grey is None:
            return track
        d = float(np.median(track.diameter[good]))
        x, y = track.x[good], track.y[good]
        if math.hypot(np.ptp(x), np.ptp(y)) > d:
            return track
        contrast = math.exp(ball.light[0]) if ball.light else 0.0
        other = _find_motion_elsewhere(
            self._head, self._scene.grey, float(np.median(x)), float(np.median(y)), d, contrast
        )
        if other is None:
            return track
        doubt = STILL.format(*other)
        if ball.settings.seed is not None:
            return replace(track, notes=(*track.notes, doubt))
        flag = np.where(track.flag == "", doubt + REMEDY, track.flag)
        return replace(_flag_rows(track, flag), notes=(*track.notes, doubt + REMEDY))

    def _refit(self, number: int, ball: Ball, track: BallTrack, frames: Frames) -> BallTrack:
        """Measure the track once more without the scene behind it, and take that where it is about as certain."""
        look = slice(0, VIEWS)
        if self._sum is None or not (track.flag[look] == "").any():
            return track
        scene = self._sum.background() if self._learning else self._behind
        again = self._without_scene(number, ball, track, frames, scene) if scene is not None else None
        if again is not None and np.nanmedian(again.sigma[look]) <= AS_CERTAIN * np.nanmedian(track.sigma[look]):
            track = again
        alone = len(self._balls) == 1 and not self.settings.streak and len(self._head) >= LEAST
        if alone and (len(frames) <= HEAD or again is track):
            track = refined(track, self._head, self.settings.polarity)
        return track

    def _without_scene(
        self, number: int, ball: Ball, track: BallTrack, frames: Frames, scene: Background
    ) -> BallTrack | None:
        """Measure the rows that a disc was fitted to once more without the scene."""
        measurer = DiscMeasure(ball.settings.diameter, ball.settings.polarity, ball.settings.streak)
        out = {name: getattr(track, name).copy() for name in ("x", "y", "sigma", "diameter", "chi2")}
        n, i = len(track.flag), 0
        block, begin, end = None, 0, 0
        while i < n:
            p = ball.found[i].p
            if track.flag[i] or p is None or (ball.found[i].fit is None and i not in ball.sure):
                i += 1
                continue
            if i >= end and n > WORTHWHILE:
                block, begin = self._block(number, ball, i), i
                end = i + (len(block.windows) if block else 1)
            done: list[Found] = []
            if block is not None and i < end and measurer.memory.mean[FRAMES]:
                done = measurer.follow(block, i - begin, self.shape, scene, ball.settings.search)
            if not done:
                start = Start(track.x[i], track.y[i], track.diameter[i], float(p[WX]), float(p[WY]), False)
                view = View(
                    self.shape, whole=partial(frames.__getitem__, i), window=self._windows[number][i], scene=scene
                )
                f = measurer.measure(view, start, fresh=not measurer.memory.mean[FRAMES])
                if f.flag or math.hypot(f.x - track.x[i], f.y - track.y[i]) > 0.35 * track.diameter[i]:
                    measurer.missed()
                    i += 1
                    continue
                measurer.accept(f)
                done = [f]
            for f in done:
                for name in out:
                    out[name][i] = getattr(f, name)
                i += 1
        return replace(track, **out)

    def _block(self, number: int, ball: Ball, i: int) -> Block | None:
        """Return the frames from i on in which the ball was found in windows of one size; None where there is none."""
        windows: list[Window] = []
        starts: list[tuple[float, float, float, float]] = []
        for k, found in enumerate(ball.found[i : i + BLOCK], i):
            if k not in ball.sure or found.p is None or (window := self._windows[number][k]) is None:
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

    def _window(self, image: Image, found: Found) -> Window | None:
        """Return the part of a frame that the ball is measured in."""
        if found.flag or found.p is None:
            return None
        p = found.p
        half_x, half_y = (math.ceil(window_half(found.diameter) + 0.5 * abs(p[w])) + 2 for w in (WX, WY))
        x0, y0 = max(0, int(found.x) - half_x), max(0, int(found.y) - half_y)
        part = image[y0 : int(found.y) + half_y + 1, x0 : int(found.x) + half_x + 1]
        self._room -= part.nbytes
        return Window(part, x0, y0) if self._room > 0 else None


def _flag_rows(track: BallTrack, flag: np.ndarray) -> BallTrack:
    """Return the track with these flags, and no numbers where there is one."""
    bad = flag != ""
    x, y, sigma, size, chi2 = (
        np.where(bad, np.nan, v) for v in (track.x, track.y, track.sigma, track.diameter, track.chi2)
    )
    grey, contrast = (None if v is None else np.where(bad, np.nan, v) for v in (track.grey, track.contrast))
    return BallTrack(x, y, sigma, size, chi2, flag.astype(np.str_), track.notes, grey, contrast, track.probability)


def _find_motion_elsewhere(
    frames: Sequence[Image], scene: Float32, x: float, y: float, d: float, contrast: float
) -> tuple[float, float] | None:
    """Find (x, y) where something as large as the ball moves, 1.5 diameters or more away, in a tenth of the frames."""
    places: list[tuple[float, float]] = []
    for image in frames:
        off = np.abs(np.asarray(image, dtype=np.float32) - scene)
        noise = float(np.median(off)) / MAD
        changed = (cv2.blur(off, (3, 3)) > max(0.25 * contrast, 5.0 * noise)).astype(np.uint8)
        _, _, stats, centres = cv2.connectedComponentsWithStats(changed)
        for (_, _, _, _, area), (u, v) in zip(stats[1:], centres[1:], strict=True):
            if area > 0.3 * d * d and math.hypot(u - x, v - y) > 1.5 * d:
                places.append((float(u), float(v)))
                break
    return places[len(places) // 2] if len(places) >= max(2.0, 0.1 * len(frames)) else None


def _streak(found: Found) -> float:
    return 0.0 if found.p is None else math.hypot(found.p[WX], found.p[WY])


def _stride(i: int) -> int:
    return 1 << max(0, int(math.log2(max(i, 1) / VIEWS)) + 1 if i >= VIEWS else 0)
