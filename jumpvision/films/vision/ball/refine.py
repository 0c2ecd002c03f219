"""The last fit of a ball in a film's first frames: what these share is taken from all of them.

A ball's size, blur and lighting are nearly the same in every frame; fitted anew in each they cost the position much
of its certainty, as the scene behind the ball does. Here each frame is fitted without the scene, which frames with the
ball elsewhere show, with the film's own values and their scatter as prior (empirical Bayes, Efron and Morris 1973).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from jumpvision.base.arrays import FROM_MAD, Array
from jumpvision.films.frames.base import Frames

from . import disc
from .background import CLEAR, Background, View
from .disc import LIGHT, RIM_FREEDOM
from .measure import DiscMeasure, Found, Start, at_least, complete, window_half
from .track import BallTrack
from .unknowns import BX, BY, GX, GY, WX, A, B, R, S, X, Y

LEAST_FRAMES = 6  # good frames of which a scatter is taken
OUTLIER = 4.0  # standard deviations from the scene's median, or from the scene outside the ball: something else
SHARED = (R, S, BX, BY, GX, GY)
STEPS = 0.3  # diameters: a fit that goes farther is not of this ball


def refined(track: BallTrack, frames: Frames, polarity: str) -> BallTrack:
    """The track with its good rows in the first frames, those given, fitted once more, where that makes the median
    sigma less."""
    good = np.flatnonzero(track.flag[: len(frames)] == "")
    if good.size < LEAST_FRAMES:
        return track
    d = float(np.median(track.diameter[good]))
    scenes = _Scenes(track, frames, d)
    first = {int(i): f for i in good if (f := _free(frames, track, int(i), polarity)) is not None}
    if len(first) < LEAST_FRAMES:
        return track
    ball = float(np.median([f.fit.p[A] for f in first.values() if f.fit]))
    crops = {i: c for i in first if (c := scenes.without(np.asarray(frames[i]), track, i, ball, d)) is not None}
    if len(crops) < good.size:  # all alike, or none
        return track
    fits: dict[int, disc.DiscFit] = {}
    noise = np.median([f.fit.noise for f in first.values() if f.fit], axis=0)
    contrast = float(np.median([abs(f.fit.p[A] - f.fit.p[B]) for f in first.values() if f.fit]))
    floor = 1.0 / 12.0 if frames[0].dtype.kind in "ui" else (1e-4 * contrast) ** 2  # of digitising
    wide = np.full(12, np.inf)
    wide[LIGHT] = contrast**2
    speed = _speeds(track.x[: len(frames)], track.y[: len(frames)])
    for turn in range(4):
        before, fits = fits, {}
        streaks = _streaks(before, speed) if turn else {}
        starts = {i: before[i].p if i in before else _moved(first[i], crops[i]) for i in crops}
        mean, var = _shared(list(before.values()), wide) if turn else (None, wide)
        for i, p in starts.items():
            at = p.copy() if mean is None else np.where(np.isfinite(var), mean, p)
            own = np.array([noise[0] * (1.0 + crops[i].share), noise[1], noise[2]])
            spread = var
            if i in streaks:
                p, at, spread = p.copy(), at.copy(), var.copy()
                at[WX:], spread[WX:] = streaks[i]
                if turn == 1:
                    p[WX:] = at[WX:]
            fit = disc.fit_disc(crops[i].grey, p, streak=i in streaks, noise=own, mean=at, var=spread)
            if fit.converged and math.hypot(fit.p[X] - p[X], fit.p[Y] - p[Y]) < STEPS * d:
                fits[i] = fit
        if len(fits) < max(LEAST_FRAMES, 0.8 * good.size):
            return track
        noise = at_least(np.median([complete(f.noise, floor) for f in fits.values()], axis=0), floor)
    return _taken(track, fits, crops)


class _Crop:
    """grey: the part of a frame from column x0 and row y0, without the scene; share: variance of the mean scene."""

    def __init__(self, grey: Array, x0: int, y0: int, share: float):
        self.grey, self.x0, self.y0, self.share = grey, x0, y0, share


class _Scenes:
    """What stands behind the ball in each frame, as other frames of the film show it."""

    def __init__(self, track: BallTrack, frames: Frames, d: float):
        # the scene is the mean of 41 frames
        which = np.unique(np.linspace(0, len(frames) - 1, min(41, len(frames))).astype(int))
        self.frames = [np.asarray(frames[int(i)]) for i in which]
        self.x, self.y = track.x[which], track.y[which]
        self.away = 0.5 * d + CLEAR

    def without(self, image: Array, track: BallTrack, i: int, ball: float, d: float) -> _Crop | None:
        """The frame's part around its ball without the scene; None where too few frames show it."""
        x, y, half = float(track.x[i]), float(track.y[i]), window_half(d)
        x0, y0 = max(0, int(x - half)), max(0, int(y - half))
        at = np.s_[y0 : int(y + half) + 2, x0 : int(x + half) + 2]
        apart = np.hypot(self.x - x, self.y - y)
        views = [f[at] for f, r in zip(self.frames, apart) if not r < self.away + half]
        if len(views) < 4:  # too few to tell the scene
            return None
        stack = np.asarray(views, dtype=np.float32)
        middle = np.median(stack, axis=0)
        step = 0.5 if image.dtype.kind in "ui" else 1e-3 * abs(ball)
        spread = FROM_MAD * float(np.median(np.abs(stack - middle))) + step
        kept = np.abs(stack - middle) < OUTLIER * spread
        scene = np.sum(stack * kept, axis=0) / np.maximum(kept.sum(axis=0), 1)
        scene = np.where(kept.any(axis=0), scene, middle).astype(np.float64)
        level = float(np.median(scene))
        if ball == level:
            return None
        crop = np.asarray(image[at], dtype=np.float64)
        other = np.abs(crop - scene) > OUTLIER * spread
        yy, xx = np.indices(crop.shape)
        outside = np.hypot(xx + x0 - x, yy + y0 - y) > 0.5 * d + 3.0
        grey = Background(scene, level, ball).removed(crop)
        grey[outside & other] = np.nan
        return _Crop(grey, x0, y0, 1.0 / len(views))


def _free(frames: Frames, track: BallTrack, i: int, polarity: str) -> Found | None:
    """The frame's own fit, without prior."""
    start = Start(float(track.x[i]), float(track.y[i]), float(track.diameter[i]), 0.0, 0.0, True)
    found = DiscMeasure(None, polarity, False).measure(View.of(np.asarray(frames[i])), start, fresh=True)
    near = found.fit is not None and math.hypot(found.x - start.x, found.y - start.y) < STEPS * start.d
    return found if near and found.fit is not None and found.fit.converged else None


def _moved(found: Found, crop: _Crop) -> Array:
    assert found.fit is not None
    p = found.fit.p.copy()
    p[X], p[Y] = found.x - crop.x0, found.y - crop.y0
    return p


def _shared(fits: list[disc.DiscFit], wide: Array) -> tuple[Array, Array]:
    """Mean and variance of the prior on each parameter: the film's median, and its scatter beyond the fits' own."""
    p = np.array([f.p for f in fits])
    mean, var = np.median(p, axis=0), wide.copy()
    for m in SHARED:
        own = float(np.median([f.cov[m, m] for f in fits]))
        var[m] = max((FROM_MAD * float(np.median(np.abs(p[:, m] - mean[m])))) ** 2 - own, 0.01 * own, 1e-12)
    return mean, var


def _speeds(x: Array, y: Array) -> Array:
    """(n, 2): by how much the ball moves in a frame [px]; NaN where nothing next to it is known."""
    steps, none = np.stack([np.diff(x), np.diff(y)], axis=1), np.full((1, 2), np.nan)
    before, after = np.vstack([none, steps]), np.vstack([steps, none])
    before, after = np.where(np.isnan(before), after, before), np.where(np.isnan(after), before, after)
    return np.asarray(0.5 * (before + after))


def _streaks(fits: dict[int, disc.DiscFit], speed: Array) -> dict[int, tuple[Array, float]]:
    """Streak of each frame [px] and its variance: the exposure's share of a frame is the film's."""
    # a streak may show from 4 px a frame on
    fast = {i: f for i, f in fits.items() if float(np.hypot(*speed[i])) > 4.0}
    if len(fast) < LEAST_FRAMES:
        return {}
    v = np.array([speed[i] for i in fast])
    w = np.array([f.p[WX:] for f in fast.values()])
    if not w.any():  # none looked for so far
        return {i: (0.02 * speed[i], 1.0 + 0.0025 * float(speed[i] @ speed[i])) for i in fast}
    w *= np.sign(np.sum(w * v, axis=1, keepdims=True))
    share = float(np.median(np.sum(w * v, axis=1) / np.sum(v * v, axis=1)))
    return {i: (share * speed[i], 1e-4) for i in fast}


def _taken(track: BallTrack, fits: dict[int, disc.DiscFit], crops: dict[int, _Crop]) -> BallTrack:
    """The track with the fits' positions; sigma: times what the rim's sectors move from frame to frame beyond noise."""
    usual = np.nanmedian([f.shifts for f in fits.values()], axis=0)
    off = [np.nansum(((f.shifts - usual) / f.shift_sigmas) ** 2) / RIM_FREEDOM for f in fits.values()]
    factor = float(np.median(off)) / (1.0 - 1.0 / len(fits))
    x, y, sigma, size, chi2 = (v.copy() for v in (track.x, track.y, track.sigma, track.diameter, track.chi2))
    for i, f in fits.items():
        x[i], y[i] = f.p[X] + crops[i].x0, f.p[Y] + crops[i].y0
        sigma[i] = math.sqrt(max(f.cov[X, X], f.cov[Y, Y]) * max(factor, 1.0) * max(f.chi2, 1.0))
        size[i], chi2[i] = 2.0 * f.p[R], f.chi2
    again = [*fits]
    if not np.median(sigma[again]) < np.median(track.sigma[again]):
        return track
    return replace(track, x=x, y=y, sigma=sigma, diameter=size, chi2=chi2)
