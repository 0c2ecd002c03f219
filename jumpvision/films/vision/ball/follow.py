"""One ball of a film: candidates of every frame, the likeliest path through them, a measurement of each of its rows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jumpvision.base.arrays import FROM_MAD, Array, Image
from jumpvision.films.parameters import SMALLEST_BALL

from .background import View
from .candidates import Scene, Spots
from .measure import AS_THEY_ARE, Block, DiscMeasure, Found, Start, ThresholdMeasure, span
from .path import Nodes, Path, Score, best_path
from .reasons import Flag, Reason
from .stiff import MOVED, Outline, fit_stiff
from .track import BallSettings
from .unknowns import WX, WY, A, B

SURE = 0.95  # least probability of a row
TAIL = 16  # frames before one that its own path is sought in
ON_SPOT = 0.35  # diameters: a fit that ends farther from its candidate is of something else
SIZES, CONTRASTS = 3.0, 4.0  # spans of the logarithms of what chance leaves: 20 times, 50 times
UNLIKE = 12.0  # nats that another size or contrast costs at most
CLICK = 0.25  # diameters: scatter of a click about the ball's centre


class Ball:
    """A ball as it is followed. spots: candidates of the frames so far; found: their measurements."""

    def __init__(self, settings: BallSettings, others: Sequence[Ball] = ()):
        self.settings, self._others = settings, others  # others: balls that are followed before this one
        self.sign = 1.0 if settings.polarity == "bright" else -1.0
        self.measurer: DiscMeasure | ThresholdMeasure
        if settings.method == "disc":
            self.measurer = DiscMeasure(settings.diameter, settings.polarity, settings.streak)
        else:
            self.measurer = ThresholdMeasure(settings.diameter, settings.polarity, settings.search)
        self.spots: list[Spots] = []
        self.own: list[Array] = []  # of each spot
        self.found: list[Found] = []
        self.score = Score(1.0)
        self.size: tuple[float, float] | None = None  # logarithm of the ball's diameter, and its scatter
        self.light: tuple[float, float] | None = None  # the same of its contrast
        self.share = settings.exposure_fraction if settings.streak else 0.0  # exposure over frame interval
        self.white = True  # neighbouring pixels err independently: what a fit says of its rim holds
        self.forgiven = False  # nothing moves: what stands still is the ball
        self.last: list[tuple[int, float, float]] = []  # frames and places of the last two measurements
        self.sure: set[int] = set()  # frames whose candidate is a measurement where it was expected

    # ---- candidates ----------------------------------------------------------------------------------------------
    def add(self, image: Image, scene: Scene) -> None:
        """Take the candidates of the next frame."""
        spots = scene.find(image)
        if self.settings.seed is not None and not self.spots:
            spots = self._with_click(spots, image)
        self.spots.append(spots)
        self.own.append(self._alone(spots, scene.noise))

    def _with_click(self, spots: Spots, image: Image) -> Spots:
        """The candidates of the first frame, and the click: it is one, whatever is there."""
        assert self.settings.seed is not None
        x, y = self.settings.seed
        near = np.argmin(np.hypot(spots.x - x, spots.y - y)) if spots.x.size else -1
        d = self.settings.diameter or (float(spots.d[near]) if near >= 0 else 2.0 * SMALLEST_BALL)
        row, column = (int(np.clip(round(v), 0, n - 1)) for v, n in ((y, image.shape[0]), (x, image.shape[1])))
        contrast = max(1e-6, self.sign * (float(image[row, column]) - float(np.nanmedian(image))))
        return Spots(*(np.append(v, w) for v, w in zip(spots, (x, y, d, contrast, 0.0, 0.0, 0.9, 0.0))))

    def _alone(self, s: Spots, noise: float) -> Array:
        """What speaks for each candidate by itself: round, of the size that was given, clearer and larger than what
        noise and a codec leave."""
        faint = 2.0 * noise
        own = -0.5 * ((1.0 - s.fill) / self.score.shape) ** 2
        own += np.clip(np.log(faint / (5.5 * s.contrast)) + s.contrast / faint, -4.0, 4.0)
        own += np.clip(2.0 * np.log(s.d / 8.0), -1.0, 2.0)
        if self.settings.diameter:
            own -= 1.5 * np.log1p(0.5 * (np.log(s.d / self.settings.diameter) / self.score.size) ** 2)
        if self.settings.seed is not None and not self.own:
            off = np.hypot(s.x - self.settings.seed[0], s.y - self.settings.seed[1]) / s.d
            own -= np.where(off < max(0.6, self.settings.search), 0.5 * (off / CLICK) ** 2, 1e3)
        return np.maximum(own, -2e3)

    def nodes(self, first: int, last: int) -> Nodes:
        """The candidates of frames first to last - 1."""
        part = self.spots[first:last]
        s = Spots(*(np.concatenate(v) for v in zip(*part)))
        frame = np.concatenate([np.full(p.x.size, i) for i, p in enumerate(part)]).astype(np.int64)
        own = np.concatenate(self.own[first:last])
        if not self.forgiven:
            still = s.still * self.score.still
            if self.settings.seed is not None:  # what was clicked may stand
                at = np.hypot(s.x - self.settings.seed[0], s.y - self.settings.seed[1])
                still = np.where(at < 0.5 * s.d, 0.0, still)
            own = own + still
        for known, value, spread in ((self.size, s.d, SIZES), (self.light, s.contrast, CONTRASTS)):
            if known is not None:  # against chance, whose logarithms are spread over `spread`
                off = 0.5 * ((np.log(value) - known[0]) / known[1]) ** 2
                own = own + math.log(0.4 * spread / known[1]) - np.minimum(off, UNLIKE)
        for ball in self._others:
            there = [(f.x, f.y) if not f.flag else (math.nan, math.nan) for f in ball.found[first:last]]
            there += [(math.nan, math.nan)] * (last - first - len(there))
            at = np.array(there)[frame] if there else np.zeros((0, 2))
            own = own - np.where(np.hypot(s.x - at[:, 0], s.y - at[:, 1]) < 0.4 * s.d, UNLIKE, 0.0)
        return Nodes(frame, s.x, s.y, s.d, s.contrast, s.wx, s.wy, own)

    # ---- path ----------------------------------------------------------------------------------------------------
    def path(self, first: int = 0, last: int | None = None) -> tuple[Nodes, Path]:
        """The likeliest path through frames first to last - 1."""
        last = len(self.spots) if last is None else last
        nodes = self.nodes(first, last)
        return nodes, best_path(nodes, last - first, self.score, self.settings.seed is not None and first == 0)

    def places(self) -> tuple[Array, float]:
        """Where the path is in each frame, (n, 2), NaN where it is not, and the ball's diameter [px]."""
        nodes, path = self.path()
        out, on = np.full((path.node.size, 2), np.nan), path.node >= 0
        k = path.node[on]
        out[on] = np.stack([nodes.x[k], nodes.y[k]], axis=1)
        return out, float(np.median(nodes.d[k])) if k.size else 0.0

    def learn(self, shape: tuple[int, int]) -> None:
        """Learn the ball from the frames so far: its size, contrast, acceleration, and whether it only stands."""
        self.score = Score(float(shape[0] * shape[1]))
        nodes, path = self.path()
        if self.settings.seed is None and (path.gain < 5.0 or np.count_nonzero(path.node >= 0) < 4):
            self.forgiven, self.score = True, replace(self.score, enter=0.0, rest=0.0)
            nodes, path = self.path()
        rows = np.flatnonzero(path.node >= 0)
        if rows.size < 4:
            return
        k = path.node[rows]
        self.size, self.light = (_spread(np.log(v[k]), least) for v, least in ((nodes.d, 0.12), (nodes.contrast, 0.25)))
        if self.settings.seed is not None:  # what was clicked may stand
            self.score = replace(self.score, rest=0.0)
        three = (np.diff(rows)[1:] == 1) & (np.diff(rows)[:-1] == 1)
        if np.count_nonzero(three) >= 3:
            ax, ay = (float(np.median(np.diff(v[k], 2)[three])) for v in (nodes.x, nodes.y))
            self.score = replace(self.score, ax=ax, ay=ay, bend=0.12)
        gap = np.diff(rows)
        speed = np.maximum(np.hypot(np.diff(nodes.x[k]) / gap, np.diff(nodes.y[k]) / gap), 1e-9)
        fast = speed > 0.5 * math.exp(self.size[0])
        if not self.settings.streak and np.count_nonzero(fast) >= 3:
            # of a round outline the length has any direction: what lies along the way less what lies across it
            length2, turn = nodes.wx[k] ** 2 + nodes.wy[k] ** 2, 2.0 * np.arctan2(nodes.wy[k], nodes.wx[k])
            way = 2.0 * np.arctan2(np.diff(nodes.y[k]), np.diff(nodes.x[k]))
            along = (length2[1:] * np.cos(turn[1:] - way) / speed**2)[fast]
            self.share = min(1.0, math.sqrt(max(0.0, float(np.median(along)))))

    # ---- measurement ---------------------------------------------------------------------------------------------
    def follow_all(self, images: Sequence[Image]) -> None:
        """Measure the path through the frames so far, in order."""
        nodes, path = self.path()
        for i, image in enumerate(images):
            self.found.append(self.measured(i, View.of(image), nodes, int(path.node[i]), path))
            self._note(i, self.found[-1])

    def next(self, image: Image, scene: Scene, plain: bool) -> None:
        """Take and measure the next frame. plain: by compiled code alone where it is a matter of course."""
        i, view = len(self.spots), View.of(image)
        found = self._expected(image, view, plain)
        if found is not None:
            self._take(i, found)
            return
        self.add(image, scene)
        self.found.append(Found(Flag(Reason.NO_BALL)))
        first = max(0, i + 1 - TAIL)
        nodes, path = self.path(first)
        self.found[i] = self.measured(i, view, nodes, int(path.node[-1]), path)
        self._note(i, self.found[i])

    def _expected(self, image: Image, view: View, plain: bool) -> Found | None:
        """The ball where it is expected; None where that is no matter of course."""
        if len(self.last) < 2 or self.last[-1][0] != len(self.spots) - 1 or not isinstance(self.measurer, DiscMeasure):
            return None
        start, d = self.predicted(len(self.spots)), self.measurer.mean_diameter
        if plain and image.dtype in AS_THEY_ARE:
            height, width = image.shape
            (x0, x1), (y0, y1) = span(start.x, start.wx, d, width), span(start.y, start.wy, d, height)
            window = image[y0:y1, x0:x1].copy()[None]
            block = Block(window, np.array([(x0, y0)]), np.array([(start.x, start.y, start.wx, start.wy)]))
            found = self.measurer.follow(block, 0, (height, width), None, self.settings.search)
            return found[0] if found else None
        f = self.measurer.measure(view, start, fresh=False)
        if f.flag or math.hypot(f.x - start.x, f.y - start.y) > self.settings.search * d:
            return None
        self.measurer.accept(f)
        return f

    def predicted(self, i: int) -> Start:
        """Constant velocity from the last two measurements."""
        (k, x0, y0), (m, x1, y1) = self.last
        vx, vy = (x1 - x0) / (m - k), (y1 - y0) / (m - k)
        d = self.measurer.mean_diameter
        e = self.share if self.settings.streak else 0.0
        return Start(x1 + (i - m) * vx, y1 + (i - m) * vy, d, vx * e, vy * e, i - m > 1)

    def _take(self, i: int, f: Found) -> None:
        """A measurement is the only candidate of its frame."""
        assert f.p is not None
        contrast = max(1e-6, self.sign * float(f.p[A] - f.p[B]))
        row = (f.x, f.y, f.diameter, contrast, float(f.p[WX]), float(f.p[WY]), 1.0, 0.0)
        self.spots.append(Spots(*(np.array([v]) for v in row)))
        self.own.append(np.array([4.0]))
        self.found.append(f)
        self.sure.add(i)
        self._note(i, f)

    def _note(self, i: int, f: Found) -> None:
        if not f.flag:
            self.last = [*self.last[-1:], (i, f.x, f.y)]

    def measured(self, i: int, view: View, nodes: Nodes, k: int, path: Path) -> Found:
        """The best measurement that a frame bears of the ball at a candidate; flagged where there is none."""
        if k < 0:
            return Found(Flag(Reason.NO_PIXEL if not np.isfinite(view.everything()).any() else Reason.NO_BALL))
        x, y, d = float(nodes.x[k]), float(nodes.y[k]), float(nodes.d[k])
        if self.size is not None:
            d = math.exp(self.size[0])
        if isinstance(self.measurer, ThresholdMeasure):
            d = self.measurer.mean_diameter if self.last else d
            found = self.measurer.measure(view, Start(x, y, d, 0.0, 0.0, True), fresh=not self.last)
            if not found.flag:
                self.measurer.accept(found)
            return found
        wx, wy = self._streak(nodes, k, path)
        known = bool(self.measurer.memory.mean[2])
        start = Start(x, y, self.measurer.mean_diameter if known else d, wx, wy, True)
        if not self.settings.streak:
            start = start._replace(wx=0.0, wy=0.0)
        found = self.measurer.measure(view, start, fresh=not known)
        near = math.hypot(found.x - x, found.y - y) < ON_SPOT * d + 0.5 * math.hypot(wx, wy)
        if not found.flag and near:
            self.measurer.accept(found)
            return found
        if known:
            self.measurer.missed()
            blurred = math.hypot(wx, wy) > MOVED * d
            if (self.white and not blurred) or found.flag.reason in (Reason.AT_BORDER, Reason.COVERED_SECTORS):
                return found if found.flag else Found(Flag(Reason.NOT_NEAR, (ON_SPOT,)))
        outline = Outline(x, y, float(nodes.d[k]), float(nodes.wx[k]), float(nodes.wy[k]))
        d = self.settings.diameter or (self.measurer.mean_diameter if known else d)
        return fit_stiff(view, outline, d, (wx, wy), self.sign, self.measurer.memory if known else None)

    def _streak(self, nodes: Nodes, k: int, path: Path) -> tuple[float, float]:
        """Way of the ball during the exposure [px], from the steps of the path beside it."""
        here = nodes.frame[k]
        rows = [t for t in (here - 1, here, here + 1) if 0 <= t < path.node.size and path.node[t] >= 0]
        if len(rows) < 2 or self.share == 0.0:
            return 0.0, 0.0
        a, b = path.node[rows[0]], path.node[rows[-1]]
        gap = rows[-1] - rows[0]
        return self.share * (nodes.x[b] - nodes.x[a]) / gap, self.share * (nodes.y[b] - nodes.y[a]) / gap


def _spread(values: Array, least: float) -> tuple[float, float]:
    middle = float(np.median(values))
    return middle, max(least, 1.5 * FROM_MAD * float(np.median(np.abs(values - middle))))
