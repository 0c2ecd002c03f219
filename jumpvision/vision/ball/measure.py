"""One ball in one frame, from a start a few pixels off: by the disc fit or by the published threshold-centroid."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import FROM_MAD

from . import disc
from .background import View
from .disc import DRIFT, LIGHT, learn, rim_faults
from .sums import SECTORS

MIN_CONTRAST = 3.0  # ball over background in standard deviations of the noise of one pixel
DIAMETER_GIVEN = 0.25  # allowed relative difference from the diameter that was given
DIAMETER_SEEN = 0.12  # and from the frames before
MOST_SECTORS_OFF = 2  # of 16: a thin rod holding the ball is not an occlusion
MOST_DROPPED = 0.25  # part of the edge pixels
MOST_CHI2 = 4.0
CONTRAST_SEEN = 2.0  # largest factor between the contrast and that of the last good frame
RIM_OFF, RIM_OFF_PX = 0.04, 0.6  # a sector's rim off the fitted circle by this part of the diameter or px is covered
UNCERTAIN, UNCERTAIN_FRESH = 0.05, 0.015  # largest sigma over diameter; a new ball must be clearer: clutter is not
NOISE_FRAMES = 30  # frames the noise is averaged over


class Start(NamedTuple):
    """Where to look: centre x, y, diameter d, streak (wx, wy), px; rough: good to a few pixels only."""

    x: float
    y: float
    d: float
    wx: float
    wy: float
    rough: bool


class Found(NamedTuple):
    """A measurement; flag "" when good. fit: the disc fit, where there is one. rivals: centres (x, y) of other balls
    in the frame that it was first found in [px]."""

    flag: str
    x: float = math.nan
    y: float = math.nan
    sigma: float = math.nan
    diameter: float = math.nan
    chi2: float = math.nan
    fit: disc.DiscFit | None = None
    rivals: tuple[tuple[float, float], ...] = ()


class DiscMeasure:
    """Disc fit whose noise model and lighting gradients are carried from frame to frame.

    The gradients correlate with the position (a ball lit from one side looks shifted), so each frame takes those of
    the frames before as a prior that drifts, by as much as the steps between frames show; noise is averaged over
    NOISE_FRAMES.

    The stated uncertainty is the fit's times the square root of `rim_factor`: how much the rim's sectors move against
    their mean shape from frame to frame, over what the noise of single pixels allows. Background clutter raises it
    above 1. An edge that no model matches but that is the same in every frame lowers it: that offset goes with the
    ball and cancels in every displacement.
    """

    def __init__(self, diameter: float | None, polarity: str, streak: bool):
        self.given = diameter
        self.sign = 1.0 if polarity == "bright" else -1.0
        self.streak = streak
        self.seen = math.nan  # running mean diameter
        self.noise: NDArray[np.float64] | None = None
        self.frames = 0
        self.last = np.zeros(12)
        self.light_var = np.zeros(4)
        self.drift = DRIFT.copy()
        self.rim = np.zeros(SECTORS)  # running mean shape of the rim, px outside the circle
        self.rim_factor = 1.0

    def measure(self, view: View, start: Start, *, fresh: bool) -> Found:
        """fresh: nothing learned before counts (a ball newly found), the noise comes from this frame alone."""
        found = self._measure(view, start, fresh)
        if found.fit is not None and max(abs(found.x - start.x), abs(found.y - start.y)) > 3.0:
            # The ball may have run out of the crop made around the start
            p = found.fit.p
            again = Start(found.x, found.y, start.d, p[disc.WX], p[disc.WY], start.rough)
            if math.hypot(found.x - start.x, found.y - start.y) < 2.0 * start.d:
                found = self._measure(view, again, fresh)
        return found

    def _measure(self, view: View, start: Start, fresh: bool) -> Found:
        fresh = fresh or self.noise is None
        half = window_half(start.d)
        x0 = max(0, int(start.x - 0.5 * abs(start.wx) - half))
        y0 = max(0, int(start.y - 0.5 * abs(start.wy) - half))
        part = view.part(
            y0,
            int(start.y + 0.5 * abs(start.wy) + half) + 2,
            x0,
            int(start.x + 0.5 * abs(start.wx) + half) + 2,
        )
        crop = np.asarray(part, dtype=np.float64)
        if min(crop.shape) < 4:
            return Found("lost: outside the image")
        p = self.last.copy()
        p[disc.X], p[disc.Y], p[disc.WX], p[disc.WY] = start.x - x0, start.y - y0, start.wx, start.wy
        if fresh or start.rough:
            levels = _levels(crop, p[disc.X], p[disc.Y], start)
            if levels is None:
                return Found("lost: pixels not finite")
            p[disc.R], p[disc.S] = 0.5 * start.d, max(0.8, 0.06 * start.d)
            p[disc.B], p[disc.A] = levels
        contrast = abs(float(p[disc.A] - p[disc.B]))
        if not contrast > 0.0:
            return Found("lost: no contrast")
        floor = 1.0 / 12.0 if part.dtype.kind in "ui" else (1e-4 * contrast) ** 2
        mean, var = p.copy(), np.full(12, np.inf)
        var[LIGHT] = contrast**2 if fresh else self.light_var
        if self.streak:
            length = math.hypot(start.wx, start.wy)
            var[disc.WX :] = (2.0 + 0.5 * length) ** 2 if fresh or start.rough else (0.5 + 0.2 * length) ** 2
        if fresh:
            p[LIGHT] = mean[LIGHT] = 0.0
            noise = np.full(3, max(0.01 * contrast**2, floor))
            for _ in range(3):
                fit = disc.fit_disc(crop, p, streak=self.streak, noise=noise, mean=mean, var=var)
                if not fit.converged:
                    break
                p, noise = fit.p, at_least(complete(fit.noise, floor), floor)
        else:
            assert self.noise is not None
            noise = at_least(self.noise, floor)
            fit = disc.fit_disc(crop, p, streak=self.streak, noise=noise, mean=mean, var=var)
        p = fit.p
        p[disc.X] += x0
        p[disc.Y] += y0
        fit = fit._replace(noise=complete(fit.noise, floor))
        n = max(1.0, 4.0 * float(p[disc.R]) * disc.margin(float(p[disc.S])))
        # Only a misfit beyond chance enlarges the stated uncertainty
        excess = fit.chi2 if fit.chi2 > 1.0 + 4.0 * math.sqrt(2.0 / n) else 1.0
        most = float(max(fit.cov[0, 0], fit.cov[1, 1]))
        sigma = math.sqrt(most * excess * self.rim_factor) if fit.converged else math.nan
        flag = self._judge(fit, sigma, view.shape, float(max(noise[0], noise[1])), fresh)
        return Found(flag, float(p[disc.X]), float(p[disc.Y]), sigma, 2.0 * float(p[disc.R]), fit.chi2, fit)

    def _judge(self, fit: disc.DiscFit, sigma: float, shape: tuple[int, ...], noise: float, fresh: bool) -> str:
        """ "" for a good fit, else what is wrong with it."""
        p = fit.p.tolist()
        if not fit.converged or not math.isfinite(sigma):
            return "lost: the fit did not converge"
        d, contrast = 2.0 * p[disc.R], self.sign * (p[disc.A] - p[disc.B])
        if contrast <= MIN_CONTRAST * math.sqrt(noise):
            return "lost: no contrast"
        before = self.sign * float(self.last[disc.A] - self.last[disc.B])
        if before > 0.0 and not 1.0 / CONTRAST_SEEN < contrast / before < CONTRAST_SEEN:
            return f"lost: contrast {contrast:.3g} instead of {before:.3g}"
        if p[disc.S] > 0.35 * p[disc.R]:
            return "lost: no sharp edge"
        wx, wy = (abs(p[disc.WX]), abs(p[disc.WY])) if self.streak else (0.0, 0.0)
        reach = p[disc.R] + 1.5 * p[disc.S]
        if not (
            reach + 0.5 * wx < p[disc.X] < shape[1] - 1 - reach - 0.5 * wx
            and reach + 0.5 * wy < p[disc.Y] < shape[0] - 1 - reach - 0.5 * wy
        ):
            return "at the image edge"
        off, dent = rim_faults(fit.sectors, fit.shifts, fit.shift_sigmas, self.rim, self.rim_factor)
        if off > MOST_SECTORS_OFF:
            return f"occluded: {off} of {SECTORS} sectors"
        if dent > min(RIM_OFF * d, RIM_OFF_PX):
            return f"occluded: the rim is off by {dent:.2g} px"
        if fit.dropped > MOST_DROPPED:
            return f"occluded: {fit.dropped:.0%} of the edge does not fit"
        for expected, most in ((self.given, DIAMETER_GIVEN), (self.seen, DIAMETER_SEEN)):
            if expected is not None and abs(d - expected) > most * expected + 5.0 * math.sqrt(fit.cov[2, 2]):
                return f"diameter off: {d:.4g} px instead of {expected:.4g}"
        if not fresh and fit.chi2 > MOST_CHI2:
            return f"poor fit: chi2 {fit.chi2:.3g} per degree of freedom"
        if sigma > (UNCERTAIN_FRESH if fresh else UNCERTAIN) * d:
            return "lost: position uncertain"
        return ""

    def accept(self, found: Found) -> None:
        fit = found.fit
        assert fit is not None
        self.frames += 1
        n = min(self.frames, NOISE_FRAMES)
        self.noise = fit.noise if self.noise is None else self.noise + (fit.noise - self.noise) / n
        self.seen = found.diameter if self.frames == 1 else self.seen + (found.diameter - self.seen) / n
        self.rim_factor = learn(
            self.frames,
            n,
            fit.p,
            fit.cov,
            fit.shifts,
            fit.shift_sigmas,
            self.rim,
            self.rim_factor,
            self.last,
            self.light_var,
            self.drift,
        )

    def missed(self) -> None:
        """A frame without the ball: the lighting has drifted on."""
        self.light_var = self.light_var + (self.drift * abs(self.last[disc.A] - self.last[disc.B])) ** 2


class ThresholdMeasure:
    """Half-height threshold and centroid; see `half_height_centroid` for its uncertainty. chi2 is NaN."""

    def __init__(self, diameter: float | None, polarity: str, search: float):
        self.given = diameter
        self.polarity = polarity
        self.search = search
        self.seen = math.nan
        self.frames = 0

    def measure(self, view: View, start: Start, *, fresh: bool) -> Found:
        half = max(self.search, 0.75) * start.d + 2.0
        x0, y0 = max(0, int(start.x - half)), max(0, int(start.y - half))
        crop = np.asarray(view.part(y0, int(start.y + half) + 2, x0, int(start.x + half) + 2), dtype=np.float64)
        if min(crop.shape) < 4:
            return Found("lost: outside the image")
        c = half_height_centroid(crop, (start.x - x0, start.y - y0), start.d, self.polarity)
        if c is None:
            return Found("lost: no contrast")
        found = Found("", c.x + x0, c.y + y0, c.sigma, c.diameter)
        if c.cut:
            return found._replace(flag="at the image edge")
        for expected, most in ((self.given, DIAMETER_GIVEN), (self.seen, DIAMETER_SEEN)):
            if expected is not None and abs(c.diameter - expected) > most * expected:
                return found._replace(flag=f"diameter off: {c.diameter:.4g} px instead of {expected:.4g}")
        return found

    def accept(self, found: Found) -> None:
        self.frames += 1
        n = min(self.frames, NOISE_FRAMES)
        self.seen = found.diameter if self.frames == 1 else self.seen + (found.diameter - self.seen) / n

    def missed(self) -> None:
        pass


def window_half(d: float) -> float:
    """Half side of the window around a ball of diameter d [px] that the disc is fitted in, without its streak."""
    return 0.75 * d + 10.0


def _levels(crop: NDArray[np.float64], x: float, y: float, start: Start) -> tuple[float, float] | None:
    """Median grey of the background near the ball and of the rim's inside; None where too few pixels are finite."""
    yy, xx = np.indices(crop.shape)
    dx, dy = xx - x, yy - y
    length2 = start.wx**2 + start.wy**2
    t = np.clip((dx * start.wx + dy * start.wy) / length2, -0.5, 0.5) if length2 > 0 else 0.0
    r = np.hypot(dx - t * start.wx, dy - t * start.wy) / start.d
    good = np.isfinite(crop)
    inside, outside = good & (r > 0.2) & (r < 0.42), good & (r > 0.6)
    if inside.sum() < 4 or outside.sum() < 4:
        return None
    return float(np.median(crop[outside])), float(np.median(crop[inside]))


def at_least(noise: NDArray[np.float64], floor: float) -> NDArray[np.float64]:
    """No less than what digitising leaves."""
    back, ball, edge = noise.tolist()
    return np.array([max(back, floor), max(ball, floor), max(edge, 0.0)])


def complete(noise: NDArray[np.float64], floor: float) -> NDArray[np.float64]:
    """The variances found, where a class without pixels takes the other's; the edge's excess may be negative."""
    back, ball, edge = noise.tolist()
    if not math.isfinite(back):
        back = ball if math.isfinite(ball) else floor
    if not math.isfinite(ball):
        ball = back
    return np.array([back, ball, edge if math.isfinite(edge) else 0.0])


@dataclass(frozen=True)
class Centroid:
    """Binary centroid x, y [px of the crop], its standard uncertainty, the diameter of the same area; cut: the blob
    touches the crop's border."""

    x: float
    y: float
    sigma: float
    diameter: float
    cut: bool


def half_height_centroid(
    crop: NDArray[np.float64], near: tuple[float, float], d: float, polarity: str
) -> Centroid | None:
    """Centroid of the filled blob nearest to `near` (x, y) in the crop; None when there is no contrast or no blob.

    Levels: medians of the background (beyond 0.7 d from `near`) and of the rim inside (0.25-0.4 d). Uncertainty, for a
    rim of steepness q = height / (edge width): each crossed row or column rounds the outline to a pixel (variance 1/12)
    and noise shifts it by noise/q; a circle of radius R averages pi R of those, sigma^2 = (1/12 + (noise/q)^2)/(pi R).
    The rounding part repeats with the sub-pixel position: it is an estimate over positions, not noise between repeats.
    """
    good = np.isfinite(crop)
    yy, xx = np.indices(crop.shape)
    r = np.hypot(xx - near[0], yy - near[1])
    rim, back = good & (r < 0.4 * d) & (r >= 0.25 * d), good & (r > 0.7 * d)
    if rim.sum() < 4 or back.sum() < 8:
        return None
    ball, ground = float(np.median(crop[rim])), float(np.median(crop[back]))
    height = ball - ground if polarity == "bright" else ground - ball
    noise = FROM_MAD * float(np.median(np.abs(crop[back] - ground)))
    if not height > 4.0 * max(noise, 0.29):
        return None
    half = 0.5 * (ball + ground)
    binary = (good & ((crop > half) if polarity == "bright" else (crop < half))).astype(np.uint8)
    outlines, _ = cv2.findContours(binary, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    best, best_score = None, math.inf
    for outline in outlines:
        x0, y0, w, h = cv2.boundingRect(outline)
        size = math.sqrt(w * h)
        if size < 0.4 * d or size > 3.0 * d:
            continue
        away = math.hypot(x0 + 0.5 * (w - 1) - near[0], y0 + 0.5 * (h - 1) - near[1])
        if away < best_score:
            best, best_score = outline, away
    if best is None:
        return None
    x0, y0, w, h = cv2.boundingRect(best)
    mask = np.zeros((h, w), dtype=np.uint8)
    cv2.drawContours(mask, [best], 0, 1, thickness=cv2.FILLED, offset=(-x0, -y0))
    rows, columns = np.nonzero(mask)
    area = len(rows)
    radius = math.sqrt(area / math.pi)
    # Edge width from the largest gradient along the rows and columns through the centre
    steep = float(np.nanmax(np.abs(np.diff(crop[y0 + h // 2, :])))) if w > 1 else height
    sigma = math.sqrt((1.0 / 12.0 + (noise / max(steep, noise)) ** 2) / (math.pi * radius))
    cut = x0 == 0 or y0 == 0 or x0 + w == crop.shape[1] or y0 + h == crop.shape[0]
    return Centroid(float(columns.mean() + x0), float(rows.mean() + y0), sigma, 2.0 * radius, cut)
