"""A target that is no plain disc (a ball of two tones, a marker, a corner): what was clicked, followed as a picture.

The picture of the first frame around the click, round and as wide as the diameter, is sought in each frame by
normalised correlation and fitted by least squares in position, turn, light and contrast; then once more with the mean
of what was found in its place. Bilinear in the picture, as Lucas and Kanade (1981) do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array, Float32, Image
from jumpvision.films.frames.base import Frames
from jumpvision.films.resample import resample

from .background import still_scene
from .measure import Found
from .reasons import GOOD, Flag, Reason
from .track import BallSettings, BallTrack, as_track

DIAMETER = 21.0  # px, of a target whose size is not given
LIKE, SURE = 0.7, 0.85  # least correlation with the target: where it is expected, and anywhere in the picture
TURNS = np.deg2rad([0.0, -20.0, 20.0])  # from the last turn, that are tried
ALL_TURNS = np.deg2rad(np.arange(0.0, 360.0, 20.0))
CHANGED = 0.25  # of the target's contrast: a place that differs less from the still scene is the scene
LINEAR = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
HEAD = 100  # frames from the first that may
FOLDED = 20  # frames of which the mean target is made


@dataclass(frozen=True)
class Target:
    """grey (k, k), centre at (k - 1) / 2; weight (k, k): 1 inside the diameter, 0 outside."""

    grey: Float32
    weight: Array

    @property
    def contrast(self) -> float:
        """Standard deviation of its grey."""
        return float(np.std(self.grey[self.weight > 0.5]))


def track_template(frames: Frames, settings: BallSettings) -> BallTrack:
    """Follow what is at the seed in the first frame: the place that was clicked, in all frames. sigma: by gradients and
    what the fit leaves."""
    assert settings.seed is not None
    scene = still_scene(frames)
    target = _cut(np.asarray(frames[0], np.float32), *settings.seed, settings.diameter or DIAMETER)
    if not target.contrast > 0:
        return as_track([Found(Flag(Reason.ONE_GREY))] * len(frames))
    found, turns = _through(frames, settings, target, scene)
    good = [i for i, f in enumerate(found[:HEAD]) if not f.flag]
    some = good[:: max(1, len(good) // FOLDED)][:FOLDED]
    if len(some) >= 4:
        k = target.grey.shape[0]
        grids = [sampled(np.asarray(frames[i], np.float32), found[i].x, found[i].y, turns[i], k) for i in some]
        target = Target(np.mean(grids, axis=0).astype(np.float32), target.weight)
        found, _ = _through(frames, settings, target, scene)
    return as_track(found)


def sampled(image: Image, x: float, y: float, turn: float, k: int) -> Float32:
    """An image on a grid (k, k) laid with its middle at (x, y), turned."""
    v, u = np.indices((k, k)) - (k - 1) / 2
    c, s, reach = math.cos(turn), math.sin(turn), 0.75 * k + 3.0
    x0, y0 = (int(np.clip(a - reach, 0, n - 1)) for a, n in ((x, image.shape[1]), (y, image.shape[0])))
    part = np.asarray(image[y0 : max(y0, int(y + reach)) + 2, x0 : max(x0, int(x + reach)) + 2], np.float32)
    at_x, at_y = (x - x0 + c * u - s * v).astype(np.float32), (y - y0 + s * u + c * v).astype(np.float32)
    return resample(part, at_x, at_y)


def left(image: Float32, x: float, y: float, margin: float) -> bool:
    """Return True if (x, y) is beyond a picture's edge by the margin [px], but not the upper one: a ball falls back."""
    h, w = image.shape
    return not (-margin < x < w + margin) or y > h + margin


def _cut(image: Float32, x: float, y: float, d: float) -> Target:
    """The round part of an image about (x, y)."""
    k = 2 * math.ceil(0.5 * d) + 1
    yy, xx = np.indices((k, k)) - (k - 1) / 2
    weight = np.clip(0.5 * d - np.hypot(xx, yy) + 0.5, 0.0, 1.0)
    grey = cv2.getRectSubPix(image, (k, k), (float(x), float(y)))
    return Target(np.asarray(grey, np.float32), weight)


def _through(frames: Frames, s: BallSettings, target: Target, scene: Float32) -> tuple[list[Found], list[float]]:
    """One pass over the film: measurements and turns [rad]."""
    assert s.seed is not None
    found, turns = list[Found](), list[float]()
    last, turn, velocity, lost, d = s.seed, 0.0, (0.0, 0.0), 0, s.diameter or DIAMETER
    known = False  # whether the velocity is
    for i in range(len(frames)):
        image = np.asarray(frames[i], np.float32)
        x, y = last[0] + velocity[0] * (lost + 1), last[1] + velocity[1] * (lost + 1)
        speed = math.hypot(*velocity)
        # the motion may differ from the last one by a half
        reach = (s.search * d + 0.5 * speed) * (lost + 1)
        best = Found(Flag(Reason.NO_TARGET))
        gone = known and left(image, x, y, 0.5 * d)
        if i == 0:
            best, turn = _fitted(image, target, *s.seed, 0.0)
        elif known and not gone and reach < max(image.shape):
            # a target that moves so fast is not where the scene shows something
            best, turn = _best(
                image, target, (x, y, reach), turn + TURNS, turn, LIKE, scene if speed > 0.3 * d else None
            )
        if best.flag and known and left(image, x, y, 0.0):  # not anywhere else then
            best = Found(Flag(Reason.FLOWN_OUT))
        elif best.flag and i > 0:
            best, turn = _best(image, target, None, turn + (TURNS if lost < 3 else ALL_TURNS), turn, SURE, scene)
        if best.flag:
            lost += 1
        else:
            if i > 0:
                velocity = ((best.x - last[0]) / (lost + 1), (best.y - last[1]) / (lost + 1))
                known = True
            last, lost = (best.x, best.y), 0
        found.append(best)
        turns.append(turn)
    return found, turns


def _best(
    image: Float32,
    target: Target,
    within: tuple[float, float, float] | None,
    turns: Sequence[float] | NDArray[np.float64],
    turn: float,
    least: float,
    scene: Float32 | None,
) -> tuple[Found, float]:
    """The likeliest place of the target at one of the turns, (x, y, reach) around or anywhere that is not the scene."""
    k = target.grey.shape[0]
    places = [within] if within is not None else _changed(image, scene, target)
    top: tuple[float, float, float, float] = (-1.0, 0.0, 0.0, turn)
    mask = (target.weight > 0.5).astype(np.float32)
    pictures = [(float(t), _turned(target.grey, t)) for t in turns]
    for x, y, reach in places:
        half = int(reach + k)
        x0, y0 = max(0, int(x) - half), max(0, int(y) - half)
        part = image[y0 : max(0, int(y) + half + 1), x0 : max(0, int(x) + half + 1)]
        if min(part.shape) <= k:
            continue
        for t, picture in pictures:
            like = cv2.matchTemplate(part, picture, cv2.TM_CCOEFF_NORMED, mask=mask)
            like = np.where(np.isfinite(like), like, -1.0)
            row, column = np.unravel_index(int(np.argmax(like)), like.shape)
            if like[row, column] > top[0]:
                top = (float(like[row, column]), x0 + column + (k - 1) / 2, y0 + row + (k - 1) / 2, t)
    if top[0] < least:
        return Found(Flag(Reason.UNLIKELY, (max(top[0], 0.0),))), turn
    found, turn = _fitted(image, target, *top[1:])
    if not found.flag and scene is not None:
        at = (found.x, found.y)
        there = np.abs(cv2.getRectSubPix(image, (k, k), at) - cv2.getRectSubPix(scene, (k, k), at))
        if float(np.average(there, weights=target.weight)) < CHANGED * target.contrast:
            return Found(Flag(Reason.STANDS_STILL)), turn
    return found, turn


def _changed(image: Float32, scene: Float32 | None, target: Target) -> list[tuple[float, float, float]]:
    """(x, y, reach) of six places that differ most from the scene; the whole picture where none does."""
    k = target.grey.shape[0]
    whole = [(0.5 * image.shape[1], 0.5 * image.shape[0], 0.5 * max(image.shape))]
    if scene is None:
        return whole
    moved, out = cv2.blur(np.abs(image - scene), (k, k)), []
    for _ in range(6):
        row, column = np.unravel_index(int(np.argmax(moved)), moved.shape)
        if moved[row, column] < CHANGED * target.contrast:
            break
        out.append((float(column), float(row), 0.5 * k))
        moved[max(0, row - k) : row + k + 1, max(0, column - k) : column + k + 1] = 0.0
    return out or whole


def _turned(grey: Float32, turn: float) -> Float32:
    """The target turned by an angle [rad], as `sampled` turns its grid."""
    k = grey.shape[0]
    c, s, m = math.cos(turn), math.sin(turn), (k - 1) / 2
    back = np.array([[c, s, m - c * m - s * m], [-s, c, m + s * m - c * m]])
    return np.asarray(
        cv2.warpAffine(grey, back, (k, k), flags=LINEAR, borderMode=cv2.BORDER_REPLICATE),
        np.float32,
    )


def _fitted(image: Float32, target: Target, x: float, y: float, turn: float) -> tuple[Found, float]:
    """Least squares of light + contrast times the target, in x, y and turn; the turn beside it."""
    k = target.grey.shape[0]
    begin, half = (x, y), 0.5 * k
    w, t = target.weight.ravel(), target.grey.ravel().astype(np.float64)
    v, u = (a.ravel() - (k - 1) / 2 for a in np.indices((k, k)))
    h, w_img = image.shape
    size = float(np.sqrt(np.sum(target.weight > 0.5) * 4 / math.pi))
    for _ in range(20):  # Gauss-Newton; most come to rest after five
        if not (half < x < w_img - 1 - half and half < y < h - 1 - half):
            return Found(Flag(Reason.AT_BORDER)), turn
        grey = sampled(image, x, y, turn, k).astype(np.float64)
        gv, gu = np.gradient(grey)
        c, s = math.cos(turn), math.sin(turn)
        gx, gy = np.ravel(c * gu - s * gv), np.ravel(s * gu + c * gv)
        by_turn = -v * np.ravel(gu) + u * np.ravel(gv)
        j = np.stack([gx, gy, by_turn, -np.ones(t.size), -t], axis=1)
        normal = j.T @ (w[:, None] * j)
        try:
            step = -np.linalg.solve(normal, j.T @ (w * grey.ravel()))
        except np.linalg.LinAlgError:
            return Found(Flag(Reason.NO_STRUCTURE)), turn
        x, y, turn = x + float(step[0]), y + float(step[1]), turn + float(np.clip(step[2], -0.3, 0.3))
        if math.hypot(x - begin[0], y - begin[1]) > 0.5 * k:
            return Found(Flag(Reason.NOT_CONVERGED)), turn
        if math.hypot(step[0], step[1]) < 1e-3:  # px
            break
    light, contrast = (float(v) for v in step[3:])
    left = grey.ravel() - light - contrast * t
    noise = float(np.sum(w * left**2) / max(np.sum(w) - 5, 1.0))
    spread = float(np.sum(w * (contrast * t - np.average(contrast * t, weights=w)) ** 2) / np.sum(w))
    if not 0.4 < contrast < 2.5 or noise > (1 - LIKE**2) * (spread + noise):
        return Found(Flag(Reason.UNLIKE, (contrast, noise / (spread + noise)))), turn
    cov = np.linalg.inv(normal) * noise
    return Found(GOOD, x, y, math.sqrt(max(cov[0, 0], cov[1, 1])), size, math.nan), turn
