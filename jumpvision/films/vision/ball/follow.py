"""Balls of one film: candidates of every frame, the likeliest paths through them, a measurement of each row."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from jumpvision.base.arrays import FROM_MAD, Array, Image
from jumpvision.films.parameters import SMALLEST_BALL

from .background import View
from .candidates import EMPTY, Scene, Spots
from .disc import FRAMES
from .measure import AS_THEY_ARE, Block, DiscMeasure, Found, Start, ThresholdMeasure, span
from .path import BARRED, Claim, Ints, Nodes, Path, Score, joint_paths
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
CENTRE = 0.1  # diameters: scatter of a candidate's centre; of a measurement a fifth
ROUND = 0.3  # diameters: length of a ball's outline that noise makes
LONG = 0.28  # of what is longer than the ball: where one of two in one outline may be, off its centre
FEW = 3  # rows that teach how a ball looks: by fewer none is refused
EXPECTED = 4.0  # nats that a measurement where it was expected is above a candidate


class Ball:
    """A ball as it is followed. found: its measurements in the frames so far."""

    def __init__(self, settings: BallSettings):
        self.settings = settings
        self.sign = 1.0 if settings.polarity == "bright" else -1.0
        self.measurer: DiscMeasure | ThresholdMeasure
        if settings.method == "disc":
            self.measurer = DiscMeasure(settings.diameter, settings.polarity, settings.streak)
        else:
            self.measurer = ThresholdMeasure(settings.diameter, settings.polarity, settings.search)
        self.found: list[Found] = []
        self.score = Score(1.0)
        self.size: tuple[float, float] | None = None  # logarithm of the ball's diameter, and its scatter
        self.light: tuple[float, float] | None = None  # the same of its contrast
        self.centre = CENTRE  # diameters: scatter of the centre of a candidate
        self.pace = 0.0  # px a frame, in the median
        self.share = settings.exposure_fraction if settings.streak else 0.0  # exposure over frame interval
        self.white = True  # neighbouring pixels err independently: what a fit says of its rim holds
        self.forgiven = False  # nothing moves: what stands still is the ball
        self.last: list[tuple[int, float, float]] = []  # frames and places of the last two measurements
        self.own: dict[int, Spots] = {}  # frame: the click, or a measurement
        self.sure: set[int] = set()  # frames of measurements where the ball was expected
        self.at: dict[int, tuple[float, float]] = {}  # frame: candidate that was measured

    # ---- likelihood ----------------------------------------------------------------------------------------------
    def claim(self, s: Spots, frame: Ints, mine: Array, base: Array, at: Mapping[int, tuple[float, float]]) -> Claim:
        """Return the log-likelihood of each candidate as this ball.

        frame: of each; mine: 1 its own, -1 another's own; base: as any ball; at: places in frames that are decided.
        """
        own = np.where((mine > 0.0) & np.isin(frame, list(self.sure)), EXPECTED, base)
        seed = self.settings.seed
        if not self.forgiven:
            still = s.still * self.score.still
            if seed is not None:  # what was clicked may stand
                still = np.where(np.hypot(s.x - seed[0], s.y - seed[1]) < 0.5 * s.d, 0.0, still)
            own = own + still
        over_chance = 0.0
        for known, value, spread in ((self.size, s.d, SIZES), (self.light, s.contrast, CONTRASTS)):
            if known is not None:  # against chance, whose logarithms are spread over `spread`
                off = 0.5 * ((np.log(value) - known[0]) / known[1]) ** 2
                own = own - np.minimum(off, UNLIKE)
                over_chance += math.log(0.4 * spread / known[1])
        if seed is not None:
            off = np.hypot(s.x - seed[0], s.y - seed[1]) / s.d
            near = np.where(off < max(0.6, self.settings.search), -0.5 * (off / CLICK) ** 2, BARRED)
            own = np.where(frame == 0, base + near, own)
        place = np.array([at.get(int(i), (math.nan, math.nan)) for i in frame]).reshape(-1, 2)
        barred = (mine < 0.0) | (~np.isnan(place[:, 0]) & (np.hypot(s.x - place[:, 0], s.y - place[:, 1]) > 1e-6))
        barred |= np.isin(frame, list(self.sure)) & (mine <= 0.0)
        return Claim(np.where(barred, BARRED, own), self.score, seed is not None and 0 in frame[:1], over_chance)

    def learn(self, nodes: Nodes, path: Path) -> None:
        """Learn from a path the ball's size, contrast and acceleration."""
        rows = np.flatnonzero(path.node >= 0)
        if rows.size < 4:
            return
        k = path.node[rows]
        self.size, self.light = (_spread(np.log(v[k]), least) for v, least in ((nodes.d, 0.12), (nodes.contrast, 0.25)))
        if self.settings.seed is not None:  # what was clicked may stand
            self.score = replace(self.score, rest=0.0)
        gap = np.diff(rows)
        speed = np.maximum(np.hypot(np.diff(nodes.x[k]) / gap, np.diff(nodes.y[k]) / gap), 1e-9)
        self.pace = float(np.median(speed))
        moves = (gap == 1) & (speed > 0.1 * math.exp(self.size[0]))
        three = moves[1:] & moves[:-1]
        if np.count_nonzero(three) >= 3:
            change = np.stack([np.diff(v[k], 2)[three] for v in (nodes.x, nodes.y)])
            ax, ay = (float(v) for v in np.median(change, axis=1))
            rest = float(np.median(np.hypot(change[0] - ax, change[1] - ay)))
            calm = 1.5 * rest / max(float(np.median(speed[1:][three])), 1e-9)
            self.score = replace(self.score, ax=ax, ay=ay, bend=0.12, calm=float(np.clip(calm, 0.01, 0.12)))
            self.centre = float(np.clip(rest / (2.9 * math.exp(self.size[0])), 0.2 * CENTRE, CENTRE))
        fast = speed > 0.5 * math.exp(self.size[0])
        if not self.settings.streak and np.count_nonzero(fast) >= 3:
            # of a round outline the length has any direction: what lies along the way less what lies across it
            length2, turn = nodes.wx[k] ** 2 + nodes.wy[k] ** 2, 2.0 * np.arctan2(nodes.wy[k], nodes.wx[k])
            way = 2.0 * np.arctan2(np.diff(nodes.y[k]), np.diff(nodes.x[k]))
            along = (length2[1:] * np.cos(turn[1:] - way) / speed**2)[fast]
            self.share = min(1.0, math.sqrt(max(0.0, float(np.median(along)))))

    # ---- measurement ---------------------------------------------------------------------------------------------
    def measure_expected(self, image: Image, view: View, plain: bool) -> Found | None:
        """Measure the ball where it is expected; None where that is no matter of course."""
        i = len(self.found)
        if len(self.last) < 2 or self.last[-1][0] != i - 1 or not isinstance(self.measurer, DiscMeasure):
            return None
        start, d = self.predict(i), self.measurer.mean_diameter
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

    def predict(self, i: int) -> Start:
        """Return where frame i has the ball at the velocity of the last two measurements."""
        (k, x0, y0), (m, x1, y1) = self.last
        vx, vy = (x1 - x0) / (m - k), (y1 - y0) / (m - k)
        d = self.measurer.mean_diameter
        e = self.share if self.settings.streak else 0.0
        return Start(x1 + (i - m) * vx, y1 + (i - m) * vy, d, vx * e, vy * e, i - m > 1)

    def _inside(self, start: Start, shape: tuple[int, int]) -> bool:
        return -0.5 < start.x < shape[1] - 0.5 and -0.5 < start.y < shape[0] - 0.5

    def accept_expected(self, f: Found) -> None:
        """Take the next frame's measurement where it was expected: the ball's only candidate there."""
        assert f.p is not None
        contrast = max(1e-6, self.sign * float(f.p[A] - f.p[B]))
        row = (f.x, f.y, f.diameter, contrast, float(f.p[WX]), float(f.p[WY]), 1.0, 0.0)
        self.own[len(self.found)] = Spots(*(np.array([v]) for v in row))
        self.sure.add(len(self.found))
        self.append(f)

    def append(self, f: Found) -> None:
        """Take the next frame's measurement."""
        i = len(self.found)
        if not f.flag:
            self.last = [*self.last[-1:], (i, f.x, f.y)]
        self.found.append(f)

    def measure(self, i: int, view: View, nodes: Nodes, path: Path, t: int) -> Found:
        """Measure frame i where row t of a path is, as well as its picture bears; flagged where it bears nothing."""
        k = int(path.node[t])
        if k < 0:
            if len(self.last) == 2 and not self._inside(self.predict(i), view.shape):
                return Found(Flag(Reason.LEFT))
            return Found(Flag(Reason.NO_PIXEL if not np.isfinite(view.everything()).any() else Reason.NO_BALL))
        self.at[i] = (float(nodes.x[k]), float(nodes.y[k]))
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
        known = bool(self.measurer.memory.mean[FRAMES])
        start = Start(x, y, self.measurer.mean_diameter if known else d, wx, wy, True)
        if not self.settings.streak:
            start = start._replace(wx=0.0, wy=0.0)
        found = self.measurer.measure(view, start, fresh=not known)
        near = math.hypot(found.x - x, found.y - y) < ON_SPOT * d + 0.5 * math.hypot(wx, wy)
        if not found.flag and near:
            self.measurer.accept(found)
            return found
        if 0 < self.measurer.memory.mean[FRAMES] < FEW:  # what begins partly hidden does not tell how a rim looks
            anew = DiscMeasure(self.settings.diameter, self.settings.polarity, self.settings.streak)
            again = anew.measure(view, start._replace(d=d), fresh=True)
            if not again.flag and math.hypot(again.x - x, again.y - y) < ON_SPOT * d + 0.5 * math.hypot(wx, wy):
                self.measurer = anew
                anew.accept(again)
                return again
        if known:
            self.measurer.missed()
            blurred = math.hypot(wx, wy) > MOVED * d
            if (self.white and not blurred) or found.flag.reason in (Reason.AT_BORDER, Reason.COVERED_SECTORS):
                return found if found.flag else Found(Flag(Reason.NOT_NEAR, (ON_SPOT,)))
        outline = Outline(x, y, float(nodes.d[k]), float(nodes.wx[k]), float(nodes.wy[k]))
        d = self.settings.diameter or (self.measurer.mean_diameter if known else d)
        return fit_stiff(view, outline, d, (wx, wy), self.sign, self.measurer.memory if known else None)

    def _streak(self, nodes: Nodes, k: int, path: Path) -> tuple[float, float]:
        """Return the way of the ball during the exposure [px], by the steps of the path about it."""
        here = nodes.frame[k]
        rows = [t for t in (here - 1, here, here + 1) if 0 <= t < path.node.size and path.node[t] >= 0]
        if len(rows) < 2 or self.share == 0.0:
            return 0.0, 0.0
        a, b = path.node[rows[0]], path.node[rows[-1]]
        gap = rows[-1] - rows[0]
        return self.share * (nodes.x[b] - nodes.x[a]) / gap, self.share * (nodes.y[b] - nodes.y[a]) / gap


class Balls:
    """Balls of one film and the candidates that they share."""

    def __init__(self, balls: Sequence[Ball]):
        self.balls = balls
        self.spots: list[Spots | None] = []  # None: every ball was where it was expected
        self.noise = 0.0  # of a pixel [grey]
        self._recent: deque[Image] = deque(maxlen=TAIL)

    # ---- candidates ----------------------------------------------------------------------------------------------
    def add(self, image: Image, scene: Scene) -> None:
        """Take the candidates of the next frame."""
        self.noise = scene.noise
        spots = scene.find(image)
        if not self.spots:
            for ball in self.balls:
                if ball.settings.seed is not None:
                    ball.own[0] = _candidate_at_click(ball, spots, image)
        self.spots.append(spots)

    def _look_back(self, scene: Scene) -> None:
        """Take the candidates of the frames before that were passed over."""
        for i, image in enumerate(self._recent, len(self.spots) - 1 - len(self._recent)):
            if self.spots[i] is None:
                self.spots[i] = scene.find(image)

    # ---- paths ---------------------------------------------------------------------------------------------------
    def paths(
        self, first: int = 0, last: int | None = None, at: Sequence[Mapping[int, tuple[float, float]]] = ()
    ) -> tuple[Nodes, list[Path]]:
        """Return the candidates of frames first to last - 1 and each ball's likeliest path through them.

        at: places of each in frames that are decided.
        """
        last = len(self.spots) if last is None else last
        parts, frames, owners = [EMPTY], [], []
        for i in range(first, last):
            for owner, spots in [(-1, self.spots[i]), *((k, b.own.get(i)) for k, b in enumerate(self.balls))]:
                if spots is not None:
                    parts.append(spots)
                    frames += [i] * spots.x.size
                    owners += [owner] * spots.x.size
        s = Spots(*(np.concatenate(v) for v in zip(*parts)))
        frame, whose = np.array(frames, np.int64), np.array(owners, np.int64)
        base = self._base(s)
        claims = [
            ball.claim(s, frame, np.where(whose < 0, 0.0, np.where(whose == k, 1.0, -1.0)), base, at[k] if at else {})
            for k, ball in enumerate(self.balls)
        ]
        score = Score(claims[0].score.area)  # of any other motion
        free = Claim(np.where(whose < 0, base + s.still * score.still, BARRED), score)
        ball = self.balls[0]
        scatter = np.where((whose >= 0) & (frame > 0), 0.2 * CENTRE, ball.centre) * s.d
        longer = np.maximum(0.0, np.hypot(s.wx, s.wy) - ball.share * ball.pace - ROUND * s.d)
        scatter = np.hypot(scatter, LONG * longer)
        nodes = Nodes(frame - first, s.x, s.y, s.d, s.contrast, s.wx, s.wy, scatter)
        return nodes, joint_paths(nodes, last - first, claims, free)

    def _base(self, s: Spots) -> Array:
        """Return the log-likelihood of each candidate as any ball: round, of the size given, clearer and larger
        than what noise and a codec leave."""
        faint, score, given = 2.0 * self.noise, self.balls[0].score, self.balls[0].settings.diameter
        own: Array = -0.5 * ((1.0 - s.fill) / score.shape) ** 2
        clear = np.clip(s.contrast / max(faint, 1e-9), 1.0, 1e9)
        own += np.clip(clear - np.log(5.5 * clear), -4.0, 4.0)
        own += np.clip(2.0 * np.log(s.d / 8.0), -1.0, 2.0)
        if given:
            own -= 1.5 * np.log1p(0.5 * (np.log(s.d / given) / score.size) ** 2)
        return np.maximum(own, -2e3)

    def candidates(
        self, i: int, first: int, last: int, at: Mapping[int, tuple[float, float]]
    ) -> list[tuple[float, float, float, float]]:
        """Return x, y, diameter [px] and probability of each candidate of frame i as the first ball, by paths through
        frames first to last - 1. at: where the ball is in frames that are decided."""
        nodes, paths = self.paths(first, last, [at, *({} for _ in self.balls[1:])])
        path, k = paths[0], np.flatnonzero(nodes.frame == i - first)
        weight = np.exp(np.clip(path.through[k] - path.gain, -50.0, 0.0))
        here = 1.0 if path.node[i - first] < 0 else 0.0  # the best path is elsewhere
        share = weight / max(1e-9, float(weight.sum()) + here)
        return [(float(nodes.x[m]), float(nodes.y[m]), float(nodes.d[m]), float(p)) for m, p in zip(k, share)]

    def places(self) -> list[tuple[Array, float]]:
        """Return of each ball the places of its path, (n, 2), NaN where it is not, and its diameter [px]."""
        nodes, paths = self.paths()
        out = []
        for path in paths:
            place, on = np.full((path.node.size, 2), np.nan), path.node >= 0
            k = path.node[on]
            place[on] = np.stack([nodes.x[k], nodes.y[k]], axis=1)
            out.append((place, float(np.median(nodes.d[k])) if k.size else 0.0))
        return out

    def learn(self, shape: tuple[int, int]) -> None:
        """Learn the balls from the frames so far, and whether they only stand."""
        for ball in self.balls:
            ball.score = Score(float(shape[0] * shape[1]))
        nodes, paths = self.paths()
        ball, path = self.balls[0], paths[0]
        if ball.settings.seed is None and (path.gain < 5.0 or np.count_nonzero(path.node >= 0) < 4):
            ball.forgiven, ball.score = True, replace(ball.score, enter=0.0, rest=0.0)
            nodes, paths = self.paths()
        for ball, path in zip(self.balls, paths):
            ball.learn(nodes, path)

    # ---- measurement ---------------------------------------------------------------------------------------------
    def follow_all(self, images: Sequence[Image]) -> None:
        """Measure the paths through the frames so far, in order."""
        nodes, paths = self.paths()
        for i, image in enumerate(images):
            for ball, path in zip(self.balls, paths):
                ball.append(ball.measure(i, View.of(image), nodes, path, i))

    def next(self, image: Image, scene: Scene, plain: bool) -> None:
        """Take and measure the next frame. plain: by compiled code alone where it is a matter of course."""
        i, view = len(self.spots), View.of(image)
        where = [ball.measure_expected(image, view, plain) for ball in self.balls]
        if None in where:
            self.add(image, scene)
            spots = self.spots[i]
            if spots is not None and np.count_nonzero((spots.still == 0.0) & (self._base(spots) > 0.0)) > 1:
                self._look_back(scene)
        else:
            self.spots.append(None)
        self._recent.append(image)
        for ball, f in zip(self.balls, where):
            if f is not None:
                ball.accept_expected(f)
        if None not in where:
            return
        first = max(0, i + 1 - TAIL)
        at = [{t: place for t, place in ball.at.items() if t < i - TAIL // 2} for ball in self.balls]
        nodes, paths = self.paths(first, i + 1, at)
        for ball, path, f in zip(self.balls, paths, where):
            if f is None:
                ball.append(ball.measure(i, view, nodes, path, i - first))


def _candidate_at_click(ball: Ball, spots: Spots, image: Image) -> Spots:
    """Return the click as a candidate of the first frame: it is one, whatever is there."""
    assert ball.settings.seed is not None
    x, y = ball.settings.seed
    near = int(np.argmin(np.hypot(spots.x - x, spots.y - y))) if spots.x.size else -1
    d = ball.settings.diameter or (float(spots.d[near]) if near >= 0 else 2.0 * SMALLEST_BALL)
    row, column = (int(np.clip(round(v), 0, n - 1)) for v, n in ((y, image.shape[0]), (x, image.shape[1])))
    contrast = max(1e-6, ball.sign * (float(image[row, column]) - float(np.nanmedian(image))))
    return Spots(*(np.array([v]) for v in (x, y, d, contrast, 0.0, 0.0, 0.9, 0.0)))


def _spread(values: Array, least: float) -> tuple[float, float]:
    middle = float(np.median(values))
    return middle, max(least, 1.5 * FROM_MAD * float(np.median(np.abs(values - middle))))
