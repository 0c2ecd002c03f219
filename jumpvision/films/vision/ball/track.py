"""The ball on the rod: its centre in every frame of a film, in pixels, with the uncertainty of each position."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Image
from jumpvision.films.parameters import SMALLEST_BALL

from .background import Background, View
from .measure import AS_THEY_ARE, Block, DiscMeasure, Found, Start, ThresholdMeasure, span
from .reasons import COVERED, GOOD, Flag, Reason
from .search import Blob, find_blobs
from .unknowns import WX, WY, A, B

POLARITIES = ("bright", "dark")
LEAVES = 2.0  # steps before the border from which a ball that is lost has left the image
# of the contrast, where the ball was expected and elsewhere; mean distances: a thing found again is another
OTHER_GREY, SCATTER = (0.08, 0.04), 6.0
STEADY, KNOWN = 10, 4  # rows that the ball's grey is the mean of; from which on it is known
MOVES, PLACE = 0.1, 0.2  # diameters from frame to frame: a ball that moves; a thing that stands
LONG = 6  # frames lost, after whose reach a ball is no longer known by its way
UNKNOWN = 4.0  # diameters a frame: half of what a ball, seen once, may fly
METHODS = ("disc", "threshold", "template")


@dataclass(frozen=True)
class BallTrack:
    """Ball centre at mid-exposure in each of n frames; column x right, row y down, pixel centres at integers.

    x, y, sigma, diameter, chi2: (n,) [px; chi2 per degree of freedom, NaN for the threshold method].
    sigma: standard uncertainty of each coordinate, the larger of the two where they differ (along a streak).
    flag: (n,) of str, "" when good, else the reason; the numbers are NaN then. notes: what a user should know of it.
    grey, contrast: (n,) of the ball, and against what is behind it [grey]; None where no disc was fitted.
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    sigma: NDArray[np.float64]
    diameter: NDArray[np.float64]
    chi2: NDArray[np.float64]
    flag: NDArray[np.str_]
    notes: tuple[str, ...] = ()
    grey: NDArray[np.float64] | None = None
    contrast: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class BallSettings:
    """How to follow one ball. Raises ValueError for a value out of range, by name.

    diameter: of the ball [px], None: learned from the first frame. polarity: "bright" or "dark" against the background.
    method: "disc" (least squares, see `disc`), "threshold" (half height and centroid, the published way) or "template"
    (what is at the seed in the first frame, see `template`).
    search: half width of the window around the predicted position [ball diameters]; it grows with every lost frame.
    seed: position (x, y) in the first frame [px], None: the frame must show one ball only. streak: fit the motion blur,
    starting from the velocity times exposure_fraction (exposure over frame interval, 0..1).
    """

    diameter: float | None
    polarity: str
    method: str
    search: float
    seed: tuple[float, float] | None
    streak: bool
    exposure_fraction: float

    def __post_init__(self) -> None:
        _check(self.diameter, self.polarity, self.method, self.search, self.seed, self.exposure_fraction)


def track_ball(images: Iterable[NDArray[np.generic]], **settings: Any) -> BallTrack:
    """Follow one ball through `images`, each (row, column) of grey levels (integer or float; NaN = no data).

    settings: those of BallSettings, all of them. A frame without a sound ball is flagged, never an exception.
    Raises ValueError for an argument out of range or an image that is not two-dimensional.
    """
    tracker = BallTracker(BallSettings(**settings))
    found = []
    for i, image in enumerate(images):
        if np.ndim(image) != 2:
            raise ValueError(f"images[{i}] has shape {np.shape(image)}: must be (row, column); convert colour to grey")
        found.append(tracker.step(View.of(np.asarray(image))))
    return as_track(found)


def merged(track: BallTrack, other: BallTrack, rows: NDArray[np.bool_]) -> BallTrack:
    """A track with these rows (n,) of another in the place of its own; its notes."""
    both = {f.name: (getattr(track, f.name), getattr(other, f.name)) for f in fields(track) if f.name != "notes"}
    values = {k: np.where(rows, b, a) for k, (a, b) in both.items() if a is not None and b is not None}
    return replace(track, **values)


def as_track(found: Sequence[Found]) -> BallTrack:
    """The track that the measurements of all frames make; numbers of flagged ones are dropped."""
    good = [f if not f.flag else Found(f.flag) for f in found]
    numbers = np.array([(f.x, f.y, f.sigma, f.diameter, f.chi2) for f in good], dtype=np.float64).reshape(-1, 5)
    x, y, sigma, size, chi2 = numbers.T.copy()
    flag = np.array([str(f.flag) for f in good], dtype=np.str_)
    if not any(f.p is not None for f in good):
        return BallTrack(x, y, sigma, size, chi2, flag)
    levels = np.array([(f.p[A], f.p[A] - f.p[B]) if f.p is not None else (np.nan, np.nan) for f in good])
    return BallTrack(x, y, sigma, size, chi2, flag, grey=levels[:, 0], contrast=levels[:, 1])


class BallTracker:
    """One ball from frame to frame: last position, velocity, how long it is lost, and other balls seen meanwhile."""

    def __init__(self, settings: BallSettings):
        s = settings
        self.measurer: DiscMeasure | ThresholdMeasure
        if s.method == "disc":
            self.measurer = DiscMeasure(s.diameter, s.polarity, s.streak)
        else:
            self.measurer = ThresholdMeasure(s.diameter, s.polarity, s.search)
        self.polarity, self.search, self.seed = s.polarity, s.search, s.seed
        self.d = s.diameter
        self.streak, self.exposure_fraction = s.streak, s.exposure_fraction
        self.last: tuple[float, float] | None = None
        self.velocity: tuple[float, float] | None = None  # px a frame
        self.lost = 0  # frames since the last good one
        self.grey = (0.0, 0.0, 0)  # running mean of the ball's grey, and of its distance from that; rows of it
        self.fastest = 0.0  # px a frame, so far
        self.view: View | None = None  # the frame that is looked at
        self.before: View | None = None  # the one that the ball was last seen in
        self.others: list[tuple[float, float]] | None = None  # balls beside it there, once asked for
        self.rivals: list[tuple[float, float]] = []
        self.trust = False  # hints are right also after frames without the ball

    def step(self, view: View, hint: Found | None = None) -> Found:
        """The ball in the next frame. hint: an earlier measurement of it in this frame, to start from."""
        return self.keep(self.look(view, hint))

    def follow(self, block: Block, first: int, shape: tuple[int, int], scene: Background | None) -> list[Found]:
        """As `step` in the frames of a block from `first` on, up to the first that is not a matter of course."""
        if self.last is None or self.lost or not isinstance(self.measurer, DiscMeasure):
            return []
        found = self.measurer.follow(block, first, shape, scene, self.search)
        for f in found:
            self._at(f)
        if found:
            self.before = None
        return found

    def next(self, image: Image) -> Found | None:
        """As `step` in a frame that is a matter of course; else None, and nothing is taken note of."""
        if self.last is None or self.lost or image.dtype not in AS_THEY_ARE:
            return None
        start, (height, width) = self._predicted(), image.shape
        (x0, x1), (y0, y1) = span(start.x, start.wx, start.d, width), span(start.y, start.wy, start.d, height)
        window = image[y0:y1, x0:x1].copy()[None]
        block = Block(window, np.array([(x0, y0)]), np.array([(start.x, start.y, start.wx, start.wy)]))
        found = self.follow(block, 0, (height, width), None)
        if not found:
            return None
        self.before, self.others = View.of(image), None
        return found[0]

    def look(self, view: View, hint: Found | None = None, others: Sequence[tuple[float, float]] = ()) -> Found:
        """The same without taking note; `keep` must follow. others: where other balls are expected."""
        self.view = view
        if self.last is None:
            return self._at_hint(view, hint) or self._first(view, others)
        start = self._predicted()
        flag = Flag(Reason.NOT_NEAR, (self.search,))
        if self.lost == 0 or (self.trust and hint is not None):
            near = start
            if hint is not None and hint.p is not None:
                near = start._replace(x=hint.x, y=hint.y, wx=float(hint.p[WX]), wy=float(hint.p[WY]))
            found = self.measurer.measure(view, near, fresh=False)
            if not found.flag and math.hypot(found.x - near.x, found.y - near.y) < self.search * start.d:
                return found
            flag = found.flag or flag
        return self._again(view, start, flag, others)

    def keep(self, found: Found) -> Found:
        """Takes note of a measurement: the next frame is predicted from it."""
        if not found.flag:
            self.before, self.others = self.view, None
        return self._miss(found) if found.flag else self._take(found)

    @property
    def expected(self) -> tuple[float, float] | None:
        """Where the ball should be in the next frame (x, y) [px]; None before it was found."""
        if self.last is None:
            return self.seed
        start = self._predicted()
        return start.x, start.y

    def _predicted(self) -> Start:
        """Constant velocity since the last good frame."""
        assert self.last is not None and self.d is not None
        vx, vy = self.velocity or (0.0, 0.0)
        n, exposed = self.lost + 1, self.exposure_fraction if self.streak else 0.0
        return Start(self.last[0] + n * vx, self.last[1] + n * vy, self.d, vx * exposed, vy * exposed, self.lost > 0)

    def _at_hint(self, view: View, hint: Found | None) -> Found | None:
        """The first ball where an earlier measurement of this frame has it; None if it is not there."""
        if hint is None or hint.p is None:
            return None
        start = Start(hint.x, hint.y, hint.diameter, float(hint.p[WX]), float(hint.p[WY]), rough=True)
        found = self.measurer.measure(view, start, fresh=True)
        near = not found.flag and math.hypot(found.x - hint.x, found.y - hint.y) < self.search * hint.diameter
        return found._replace(rivals=hint.rivals) if near else None

    def _first(self, view: View, others: Sequence[tuple[float, float]]) -> Found:
        """The ball in a frame where nothing is known but perhaps the seed."""
        if not np.isfinite(image := view.everything()).any():
            return Found(Flag(Reason.NO_PIXEL))
        blobs = self._blobs(image)
        found: list[Found] = []
        flags: list[Found] = []
        for blob in blobs:
            f = self.measurer.measure(view, _start(blob, self.streak), fresh=True)
            (flags if f.flag else found).append(f)
        if self.seed is not None:
            sx, sy = self.seed
            found.sort(key=lambda f: math.hypot(f.x - sx, f.y - sy))
            away = [math.hypot(f.x - sx, f.y - sy) / f.diameter for f in found]
            near = [f for f, a in zip(found, away) if a < max(0.6, self.search)]
            if len(near) > 1 and away[0] > 0.5:  # the click is on none of them
                return Found(Flag(Reason.ALIKE, (len(near),)))
            if near:
                return near[0]._replace(rivals=tuple((f.x, f.y) for f in found[1:]))
            return Found(flags[0].flag if flags else Flag(Reason.NOT_AT_SEED))
        found = [f for f in _distinct(found) if not _nearer(f, others, None)]
        if len(found) == 1:
            return found[0]
        if found:
            places = ", ".join(f"({f.x:.0f}, {f.y:.0f})" for f in found[:3])
            return Found(Flag(Reason.WHICH, (len(found), places)))
        return Found(flags[0].flag if flags else Flag(Reason.NO_BALL))

    def _again(self, view: View, predicted: Start, flag: Flag, others: Sequence[tuple[float, float]]) -> Found:
        """Search around the prediction in a window that grows with every lost frame, to the whole image in the end."""
        x, y, d = predicted.x, predicted.y, predicted.d
        n = self.lost + 1
        reach = self.search * d * n
        # a ball that bounces goes anywhere within its way; of one seen once, nobody knows how fast it is
        far = reach + 2.0 * n * (self.fastest if self.velocity else UNKNOWN * d)
        outside = not (0 <= x < view.shape[1] and 0 <= y < view.shape[0])
        # the first miss of a slow ball looks in the window only: most end there
        whole = self.lost > 0 or outside or far > 2.0 * reach
        x0 = y0 = 0
        if whole:
            part = view.everything()
            if not np.isfinite(part).any():
                return Found(Flag(Reason.NO_PIXEL))
        else:
            half = reach + 1.5 * d
            x0, y0 = max(0, int(x - half)), max(0, int(y - half))
            part = view.part(y0, int(y + half) + 2, x0, int(x + half) + 2)
        blobs = self._blobs(part) if min(part.shape) > 4 else []
        starts = [predicted._replace(rough=True)]
        starts += [_start(replace(blob, x=blob.x + x0, y=blob.y + y0), self.streak) for blob in blobs]
        found, covered = [], []
        for start in starts:
            f = self.measurer.measure(view, start, fresh=False)
            if f.flag.reason is Reason.POOR_FIT:  # the scene's noise may have changed: judge it by this frame alone
                f = self.measurer.measure(view, start, fresh=True)
            if not f.flag:
                found.append(f)
            elif f.flag.reason in COVERED:
                covered.append((math.hypot(f.x - x, f.y - y), f.flag))
        free, apart = self._not_rivals(_distinct(found), predicted, reach, far)
        free = [f for f in free if not _nearer(f, others, (x, y))]
        ours = [f for f in free if self._like(f)]
        if strange := [f for f in free if not self._like(f)]:
            grey = self.grey[0]
            flag = Flag(Reason.OTHER_GREY, (float(strange[0].p[A]) if strange[0].p is not None else grey, grey))
        near = [f for f in ours if math.hypot(f.x - x, f.y - y) <= reach]
        if near and math.hypot(near[0].x - x, near[0].y - y) > LONG * self.search * d and self._another(found):
            near = ours = []
        elif not near:  # somewhere else: it must be the ball for sure
            ours = [] if self._another(found) else [f for f in ours if self._like(f, sure=True)]
            alike = len(ours) + sum(self._like(f) for f in apart)
            if ours and alike > 1:
                return Found(Flag(Reason.ALIKE, (alike,)))
        ours = near or ours
        if not ours:
            return Found(Flag(Reason.LEFT) if not strange and self._left(view.shape, x, y) else flag)
        away = [math.hypot(f.x - x, f.y - y) for f in ours]
        nearest = min(covered, key=lambda c: c[0], default=(math.inf, GOOD))
        if nearest[0] < min(away[0] - 0.25 * d, 0.75 * d):
            return Found(nearest[1])  # ours is the covered one where it should be, not the one beside
        # Two balls within what the ball may have moved while lost: no picture tells which is ours
        if len(ours) > 1 and away[1] < away[0] + 0.5 * d * self.lost:
            return Found(Flag(Reason.ALIKE, (len(ours),)))
        return ours[0]

    def _another(self, found: Sequence[Found]) -> bool:
        """Whether beside the ball, when it was last seen, there was another that does not stand where it stood: found
        now, it is not the ball."""
        if self.others is None:
            view, last = self.before, self.last
            if view is None or last is None:
                return False
            starts = (_start(b, self.streak) for b in self._blobs(view.everything()))
            fits = (self.measurer.measure(view, start, fresh=True) for start in starts)
            self.others = [
                (f.x, f.y)
                for f in fits
                if not f.flag and self._like(f) and math.hypot(f.x - last[0], f.y - last[1]) > 0.5 * f.diameter
            ]
        return any(all(math.hypot(f.x - x, f.y - y) > PLACE * f.diameter for f in found) for x, y in self.others)

    def _like(self, found: Found, sure: bool = False) -> bool:
        """Whether what was found again has the ball's grey, as far as that was steady."""
        if found.p is None or self.grey[2] < KNOWN:
            return True
        most = max(OTHER_GREY[sure] * abs(float(found.p[A] - found.p[B])), SCATTER * self.grey[1])
        return abs(float(found.p[A]) - self.grey[0]) < most * (1.0 + self.lost / 5.0)  # light changes on the way

    def _left(self, shape: tuple[int, int], x: float, y: float) -> bool:
        """Whether the ball, expected at (x, y), is beyond the border, and was LEAVES steps from it or less."""
        assert self.last is not None and self.d is not None
        if 0 <= x < shape[1] and 0 <= y < shape[0]:
            return False
        speed = self.velocity or (0.0, 0.0)
        next_x, next_y = self.last[0] + LEAVES * speed[0], self.last[1] + LEAVES * speed[1]
        return not (self.d < next_x < shape[1] - 1 - self.d and self.d < next_y < shape[0] - 1 - self.d)

    def _not_rivals(
        self, found: list[Found], predicted: Start, reach: float, far: float
    ) -> tuple[list[Found], list[Found]]:
        """Balls within reach of the prediction or not too far from the last place, nearest to the prediction first, and
        the others; less those that a rival of the frame before explains."""
        assert self.last is not None
        (x, y), (last_x, last_y) = predicted[:2], self.last
        free = sorted(found, key=lambda f: math.hypot(f.x - x, f.y - y))
        rivals: list[tuple[float, float]] = []
        for rx, ry in self.rivals:
            near = min(free, key=lambda f: math.hypot(f.x - rx, f.y - ry), default=None)
            if near is not None and math.hypot(near.x - rx, near.y - ry) < min(self.search, 1.0) * predicted.d:
                free.remove(near)
                rivals.append((near.x, near.y))
        away = [min(math.hypot(f.x - x, f.y - y) / reach, math.hypot(f.x - last_x, f.y - last_y) / far) for f in free]
        within, apart = ([f for f, a in zip(free, away, strict=True) if (a <= 1) == inside] for inside in (True, False))
        self.rivals = rivals + [(f.x, f.y) for f in apart]
        return within, apart

    def _blobs(self, image: NDArray[np.generic]) -> list[Blob]:
        return find_blobs(
            image, diameter=self.d, polarity=self.polarity, min_diameter=SMALLEST_BALL, streak=self.streak
        )

    def _take(self, found: Found) -> Found:
        if self.last is None:
            self.rivals = list(found.rivals)
        self.measurer.accept(found)
        self._at(found)
        return found

    def _at(self, found: Found) -> None:
        x, y = found.x, found.y
        moves = self.grey[2] == 0
        if self.last is not None:
            n = self.lost + 1
            vx, vy = (x - self.last[0]) / n, (y - self.last[1]) / n
            speed = math.hypot(vx, vy)
            moves = moves or n * speed > MOVES * found.diameter
            if speed > self.fastest and (self.velocity is None or n == 1):
                self.fastest = speed
            self.velocity = vx, vy
        if moves and found.p is not None:  # a hand that holds it changes it
            grey, (mean, off, rows) = float(found.p[A]), self.grey
            share = 1.0 / (1 + min(rows, STEADY))
            mean += share * (grey - mean)
            self.grey = mean, off + share * (abs(grey - mean) - off), rows + 1
        self.last, self.lost, self.d = (x, y), 0, self.measurer.mean_diameter

    def _miss(self, found: Found) -> Found:
        if self.last is not None:
            self.lost += 1
            self.measurer.missed()
        return found


def _start(blob: Blob, streak: bool) -> Start:
    wx, wy = (blob.wx, blob.wy) if streak else (0.0, 0.0)
    return Start(blob.x, blob.y, blob.d, wx, wy, rough=True)


def _nearer(f: Found, others: Sequence[tuple[float, float]], ours: tuple[float, float] | None) -> bool:
    """Whether another ball, expected within a diameter, explains a measurement better than ours does."""
    own = math.hypot(f.x - ours[0], f.y - ours[1]) if ours else math.inf
    return any(math.hypot(f.x - x, f.y - y) < min(own, f.diameter) for x, y in others)


def _distinct(found: list[Found]) -> list[Found]:
    """Without repeats: two blobs may lead to one ball."""
    kept: list[Found] = []
    for f in found:
        if all(math.hypot(f.x - k.x, f.y - k.y) > 0.5 * k.diameter for k in kept):
            kept.append(f)
    return kept


def _check(
    diameter: float | None,
    polarity: str,
    method: str,
    search: float,
    seed: tuple[float, float] | None,
    exposure_fraction: float,
) -> None:
    if diameter is not None and not (SMALLEST_BALL <= diameter < math.inf):
        raise ValueError(f"diameter = {diameter!r}: must be at least {SMALLEST_BALL:g} px, or None to learn it")
    if polarity not in POLARITIES:
        raise ValueError(f"polarity = {polarity!r}: must be one of {POLARITIES} (ball against the background)")
    if method not in METHODS:
        raise ValueError(f"method = {method!r}: must be one of {METHODS}")
    if method == "template" and seed is None:
        raise ValueError('method = "template" follows what is at the seed in the first frame: give seed = (x, y) in px')
    if not (0.0 < search < math.inf):
        raise ValueError(f"search = {search!r}: must be above 0 ball diameters (half width of the window)")
    if seed is not None and not (len(seed) == 2 and all(math.isfinite(v) for v in seed)):
        raise ValueError(f"seed = {seed!r}: must be the position (x, y) in px, or None to search")
    if not 0.0 <= exposure_fraction <= 1.0:
        raise ValueError(f"exposure_fraction = {exposure_fraction!r}: must be in [0, 1] (exposure over frame interval)")
