"""One ball in one frame, from a start a few pixels off: by the disc fit or by the published threshold-centroid."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from jumpvision.base.arrays import Array

from . import disc
from .background import Background, View
from .disc import DIAMETER, FRAMES, NOISE_FRAMES, RIM_FACTOR, learn, rim_faults
from .reasons import GOOD, Flag, Reason
from .search import half_height_centroid
from .unknowns import BX, GY, WX, WY, A, B, R, S, X, Y

DIAMETER_GIVEN = 0.25  # allowed relative difference from the diameter that was given
DIAMETER_SEEN = 0.12  # and from the frames before
MOST_CHI2 = 4.0
CONTRAST_SEEN = 2.0  # largest factor between the contrast and that of the last good frame
DIGITS = 1.0 / 12.0  # variance of digitising [grey^2]
FARTHEST = 3.0  # px from the start: a fit that ends beyond it is made again in the crop about its end


class Start(NamedTuple):
    """Where to look: centre x, y, diameter d, streak (wx, wy), px; rough: good to a few pixels only."""

    x: float
    y: float
    d: float
    wx: float
    wy: float
    rough: bool


class Found(NamedTuple):
    """A measurement; flag false when good. fit: the disc fit, where there is one and it was not `follow` that made it;
    p: its parameters."""

    flag: Flag
    x: float = math.nan
    y: float = math.nan
    sigma: float = math.nan
    diameter: float = math.nan
    chi2: float = math.nan
    fit: disc.DiscFit | None = None
    p: Array | None = None


class Wanted(NamedTuple):
    """What counts as the ball. sign: 1 bright, -1 dark; streak: whether it is fitted; given: diameter [px], or NaN."""

    sign: float
    streak: bool
    given: float


# What may be wrong with a fit, as `_judge` numbers it: the first members of Reason, in their order
FITS, NOT_CONVERGED, NO_CONTRAST, OTHER_CONTRAST, NO_EDGE, AT_BORDER = range(6)
COVERED_SECTORS, COVERED_RIM, COVERED_EDGE, OTHER_DIAMETER, POOR_FIT, UNCERTAIN_PLACE = range(6, 12)
VERDICTS = tuple(Reason)


@njit(cache=True, error_model="numpy")
def _judge(fit, sigma, height, width, noise, fresh, wanted, memory):  # type: ignore[no-untyped-def]
    """(number of a VERDICT, its two values); fit: the fields of DiscFit."""
    p, cov, _, chi2, sectors, shifts, sigmas, dropped, good = fit
    if not good or not math.isfinite(sigma):
        return NOT_CONVERGED, 0.0, 0.0
    d, contrast = 2.0 * p[R], wanted.sign * (p[A] - p[B])
    # a ball stands out by more than 3 standard deviations of the noise of one pixel
    if contrast <= 3.0 * math.sqrt(noise):
        return NO_CONTRAST, 0.0, 0.0
    before = wanted.sign * (memory.last[A] - memory.last[B])
    if before > 0.0 and not 1.0 / CONTRAST_SEEN < contrast / before < CONTRAST_SEEN:
        return OTHER_CONTRAST, contrast, before
    if p[S] > 0.35 * p[R]:
        return NO_EDGE, 0.0, 0.0
    wx, wy = (abs(p[WX]), abs(p[WY])) if wanted.streak else (0.0, 0.0)
    reach = p[R] + 1.5 * p[S]
    if not (
        reach + 0.5 * wx < p[X] < width - 1 - reach - 0.5 * wx
        and reach + 0.5 * wy < p[Y] < height - 1 - reach - 0.5 * wy
    ):
        return AT_BORDER, 0.0, 0.0
    off, dent = rim_faults(sectors, shifts, sigmas, memory.rim, memory.mean[RIM_FACTOR])
    if off > 2:  # of 16: a thin rod that holds the ball is no occlusion
        return COVERED_SECTORS, float(off), 0.0
    if dent > min(0.04 * d, 0.6):  # px: a sector's rim so far off the circle is covered
        return COVERED_RIM, dent, 0.0
    if dropped > 0.25:  # of the edge pixels
        return COVERED_EDGE, dropped, 0.0
    for expected, most in ((wanted.given, DIAMETER_GIVEN), (memory.mean[DIAMETER], DIAMETER_SEEN)):  # NaN: not known
        if abs(d - expected) > most * expected + 5.0 * math.sqrt(cov[R, R]):
            return OTHER_DIAMETER, d, expected
    if not fresh and chi2 > MOST_CHI2:
        return POOR_FIT, chi2, 0.0
    # of the diameter; a new ball must be clearer: clutter is not
    if sigma > (0.015 if fresh else 0.05) * d:
        return UNCERTAIN_PLACE, 0.0, 0.0
    return FITS, 0.0, 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _fitted(crop, p, x0, y0, height, width, floor, loose, fresh, wanted, memory):  # type: ignore[no-untyped-def]
    """The fit of a crop whose first pixel is (x0, y0) of a frame, from p in the crop; p in the frame, its noise
    complete; sigma; what `_judge` says. loose: the streak is not known from the frame before."""
    contrast2 = (p[A] - p[B]) ** 2
    mean, var = p.copy(), np.full(12, np.inf)
    for m in range(BX, GY + 1):
        var[m] = contrast2 if fresh else memory.light_var[m - BX]
        if fresh:
            p[m] = mean[m] = 0.0
    if wanted.streak:
        length = math.hypot(p[WX], p[WY])
        var[WX] = var[WY] = (2.0 + 0.5 * length) ** 2 if loose else (0.5 + 0.2 * length) ** 2
    noise = np.full(3, max(0.01 * contrast2, floor)) if fresh else at_least(memory.noise, floor)
    for _ in range(3 if fresh else 1):
        fit = disc.fit_and_judge(crop, p, wanted.streak, noise, mean, var)
        p = fit[0]
        if fresh and not fit[8]:
            break
        if fresh:
            noise = at_least(complete(fit[2], floor), floor)
    q, cov, chi2 = fit[0], fit[1], fit[3]
    q[X] += x0
    q[Y] += y0
    n = max(1.0, 4.0 * q[R] * disc.margin(q[S]))
    # Only a misfit beyond chance enlarges the stated uncertainty
    excess = chi2 if chi2 > 1.0 + 4.0 * math.sqrt(2.0 / n) else 1.0
    sigma = math.sqrt(max(cov[X, X], cov[Y, Y]) * excess * memory.mean[RIM_FACTOR]) if fit[8] else math.nan
    verdict = _judge(fit, sigma, height, width, max(noise[0], noise[1]), fresh, wanted, memory)
    return fit, complete(fit[2], floor), sigma, verdict


@njit(cache=True, nogil=True, error_model="numpy")
def _follow(windows, corners, starts, height, width, gain, offset, first, search, wanted, memory, out):  # type: ignore[no-untyped-def]
    """Measures and learns the frames of a block from `first` on, up to the first that is not a matter of course; how
    many there were. gain, offset: of the whole scene (`Background`), without pixels where it is not taken out; out:
    (n, 17) x, y, sigma, d, chi2, parameters."""
    without = gain.size > 0
    for i in range(first, len(windows)):
        x, y, wx, wy = starts[i, 0], starts[i, 1], starts[i, 2], starts[i, 3]
        d = memory.mean[DIAMETER]
        x0, x1 = span(x, wx, d, width)
        y0, y1 = span(y, wy, d, height)
        left, top = corners[i, 0], corners[i, 1]
        rows, columns = y1 - y0, x1 - x0
        if min(rows, columns) < 4 or y0 < top or x0 < left:
            return i - first
        if y1 > top + windows.shape[1] or x1 > left + windows.shape[2]:
            return i - first
        crop = np.empty((rows, columns))
        for r in range(rows):
            for c in range(columns):
                crop[r, c] = windows[i, y0 - top + r, x0 - left + c]
        if without:
            for r in range(rows):
                for c in range(columns):
                    crop[r, c] = crop[r, c] * gain[y0 + r, x0 + c] + offset[y0 + r, x0 + c]
        p = memory.last.copy()
        p[X], p[Y], p[WX], p[WY] = x - x0, y - y0, wx, wy
        contrast = abs(p[A] - p[B])
        if not contrast > 0.0:
            return i - first
        floor = (1e-4 * contrast) ** 2 if without else DIGITS
        new = d < 0.0  # False; as a literal it would have the fit compiled once more
        fit, noise, sigma, verdict = _fitted(crop, p, x0, y0, height, width, floor, new, new, wanted, memory)
        q = fit[0]
        away = math.hypot(q[X] - x, q[Y] - y)
        if verdict[0] or max(abs(q[X] - x), abs(q[Y] - y)) > FARTHEST or not away < search * d:
            return i - first
        learn(memory, q, fit[1], noise, fit[5], fit[6])
        out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4] = q[X], q[Y], sigma, 2.0 * q[R], fit[3]
        for m in range(12):
            out[i, 5 + m] = q[m]
    return len(windows) - first


@njit(cache=True)
def span(x, wx, d, size):  # type: ignore[no-untyped-def]
    """First and last but one pixel, along one axis, that a ball expected at x with streak wx is fitted in."""
    half = 0.5 * abs(wx) + window_half(d)
    first = max(0, int(x - half))
    return first, max(first, min(size, int(x + half) + 2))


class Block(NamedTuple):
    """Neighbouring frames about the ball: windows (n, rows, columns), corners (n, 2) column and row of their first
    pixels in the frame, starts (n, 4) where the ball is looked for: x, y, wx, wy [px]."""

    windows: NDArray[np.generic]
    corners: NDArray[np.int64]
    starts: Array


NO_PIXELS = np.empty((0, 0))
AS_THEY_ARE = (np.uint8, np.uint16)  # pixels of a block; others are floats there


class DiscMeasure:
    """Disc fit whose noise model and lighting gradients are carried from frame to frame.

    The gradients correlate with the position (a ball lit from one side looks shifted), so each frame takes those of
    the frames before as a prior that drifts, by as much as the steps between frames show; noise is averaged over
    NOISE_FRAMES.

    The stated uncertainty is the fit's times the square root of the rim factor: how much the rim's sectors move against
    their mean shape from frame to frame, over what the noise of single pixels allows. Background clutter raises it
    above 1. An edge that no model matches but that is the same in every frame lowers it: that offset goes with the
    ball and cancels in every displacement.
    """

    def __init__(self, diameter: float | None, polarity: str, streak: bool):
        sign = 1.0 if polarity == "bright" else -1.0
        self.wanted = Wanted(sign, bool(streak), math.nan if diameter is None else float(diameter))
        self.memory = disc.empty_memory()

    @property
    def mean_diameter(self) -> float:
        """Running mean diameter [px]."""
        return float(self.memory.mean[DIAMETER])

    def measure(self, view: View, start: Start, *, fresh: bool) -> Found:
        """fresh: nothing learned before counts (a ball newly found), the noise comes from this frame alone."""
        found = self._measure(view, start, fresh)
        if found.fit is not None and max(abs(found.x - start.x), abs(found.y - start.y)) > FARTHEST:
            # The ball may have run out of the crop made around the start
            p = found.fit.p
            again = Start(found.x, found.y, start.d, p[WX], p[WY], start.rough)
            if math.hypot(found.x - start.x, found.y - start.y) < 2.0 * start.d:
                found = self._measure(view, again, fresh)
        return found

    def _measure(self, view: View, start: Start, fresh: bool) -> Found:
        fresh = fresh or not self.memory.mean[FRAMES]
        height, width = view.shape
        (x0, x1), (y0, y1) = span(start.x, start.wx, start.d, width), span(start.y, start.wy, start.d, height)
        part = view.part(y0, y1, x0, x1)
        crop = np.ascontiguousarray(part, dtype=np.float64)
        if min(crop.shape) < 4:
            return Found(Flag(Reason.OUTSIDE))
        p = self.memory.last.copy()
        p[X], p[Y], p[WX], p[WY] = start.x - x0, start.y - y0, start.wx, start.wy
        if fresh or start.rough:
            levels = _levels(crop, p[X], p[Y], start)
            if levels is None:
                return Found(Flag(Reason.NOT_FINITE))
            p[R], p[S] = 0.5 * start.d, max(0.8, 0.06 * start.d)
            p[B], p[A] = levels
        contrast = abs(float(p[A] - p[B]))
        if not contrast > 0.0:
            return Found(Flag(Reason.NO_CONTRAST))
        floor = DIGITS if part.dtype.kind in "ui" else (1e-4 * contrast) ** 2
        loose = fresh or start.rough
        fit, noise, sigma, (verdict, *values) = _fitted(
            crop, p, x0, y0, height, width, floor, loose, fresh, self.wanted, self.memory
        )
        q, flag = fit[0], Flag(VERDICTS[verdict], tuple(values)) if verdict else GOOD
        found = disc.DiscFit(q, fit[1], noise, *fit[3:])
        return Found(flag, float(q[X]), float(q[Y]), sigma, 2.0 * float(q[R]), found.chi2, found, q)

    def follow(
        self, block: Block, first: int, shape: tuple[int, int], scene: Background | None, search: float
    ) -> list[Found]:
        """The ball in the frames of a block from `first` on, as `measure` and `accept` find it, up to the first that is
        not a matter of course. shape: of whole frames; search: diameters from where it is looked for."""
        out = np.empty((len(block.windows), 17))
        gain, offset = (scene.gain, scene.offset) if scene else (NO_PIXELS, NO_PIXELS)
        n = _follow(*block, *shape, gain, offset, first, float(search), self.wanted, self.memory, out)
        rows = out[first : first + n]
        return [Found(GOOD, x, y, s, d, chi2, p=p) for (x, y, s, d, chi2), p in zip(rows[:, :5].tolist(), rows[:, 5:])]

    def accept(self, found: Found) -> None:
        fit = found.fit
        assert fit is not None
        learn(self.memory, fit.p, fit.cov, fit.noise, fit.shifts, fit.shift_sigmas)

    def missed(self) -> None:
        """A frame without the ball: the lighting has drifted on."""
        m = self.memory
        m.light_var[:] += (m.drift * abs(m.last[A] - m.last[B])) ** 2


class ThresholdMeasure:
    """Half-height threshold and centroid; see `half_height_centroid` for its uncertainty. chi2 is NaN."""

    def __init__(self, diameter: float | None, polarity: str, search: float):
        self.given = diameter
        self.polarity = polarity
        self.search = search
        self.mean_diameter = math.nan
        self.frames = 0

    def measure(self, view: View, start: Start, *, fresh: bool) -> Found:
        half = max(self.search, 0.75) * start.d + 2.0
        x0, y0 = max(0, int(start.x - half)), max(0, int(start.y - half))
        crop = np.asarray(view.part(y0, int(start.y + half) + 2, x0, int(start.x + half) + 2), dtype=np.float64)
        if min(crop.shape) < 4:
            return Found(Flag(Reason.OUTSIDE))
        c = half_height_centroid(crop, (start.x - x0, start.y - y0), start.d, self.polarity)
        if c is None:
            return Found(Flag(Reason.NO_CONTRAST))
        found = Found(GOOD, c.x + x0, c.y + y0, c.sigma, c.diameter)
        if c.cut:
            return found._replace(flag=Flag(Reason.AT_BORDER))
        for expected, most in ((self.given, DIAMETER_GIVEN), (self.mean_diameter, DIAMETER_SEEN)):
            if expected is not None and abs(c.diameter - expected) > most * expected:
                return found._replace(flag=Flag(Reason.OTHER_DIAMETER, (c.diameter, expected)))
        return found

    def accept(self, found: Found) -> None:
        self.frames += 1
        n = min(self.frames, NOISE_FRAMES)
        self.mean_diameter = (
            found.diameter if self.frames == 1 else self.mean_diameter + (found.diameter - self.mean_diameter) / n
        )

    def missed(self) -> None:
        pass


@njit(cache=True)
def window_half(d):  # type: ignore[no-untyped-def]
    """Half side of the window around a ball of diameter d [px] that the disc is fitted in, without its streak."""
    return 0.75 * d + 10.0


def _levels(crop: Array, x: float, y: float, start: Start) -> tuple[float, float] | None:
    """Median grey of the background near the ball and of the rim's inside; None where too few pixels are finite."""
    dx, dy = np.arange(crop.shape[1]) - x, (np.arange(crop.shape[0]) - y)[:, None]
    length2 = start.wx**2 + start.wy**2
    t = np.clip((dx * start.wx + dy * start.wy) / length2, -0.5, 0.5) if length2 > 0 else 0.0
    r = np.hypot(dx - t * start.wx, dy - t * start.wy) / start.d
    good = np.isfinite(crop)
    inside, outside = crop[good & (r > 0.2) & (r < 0.42)], crop[good & (r > 0.6)]
    if min(inside.size, outside.size) < 4:
        return None
    return float(np.median(outside)), float(np.median(inside))


@njit(cache=True)
def at_least(noise, floor):  # type: ignore[no-untyped-def]
    """Variances (3,) no less than what digitising leaves."""
    return np.array([max(noise[0], floor), max(noise[1], floor), max(noise[2], 0.0)])


@njit(cache=True)
def complete(noise, floor):  # type: ignore[no-untyped-def]
    """The variances found, where a class without pixels takes the other's; the edge's excess may be negative."""
    back, ball, edge = noise[0], noise[1], noise[2]
    if not math.isfinite(back):
        back = ball if math.isfinite(ball) else floor
    if not math.isfinite(ball):
        ball = back
    return np.array([back, ball, edge if math.isfinite(edge) else 0.0])
