"""A ball of any face as a layer before the still scene: its picture, learned from a flight, and its fit to a frame.

I = S (1 - alpha) + M at every pixel, with S the scene, alpha the ball's share of the pixel and M what it shows there
(Wang and Adelson 1994). All frames of the flight teach alpha and M; each frame is then fitted in position, turn, light
and contrast, on its own pixels.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from jumpvision.base.arrays import FROM_MAD, Float32

from ..measure import Found
from ..moving import Frames, Path, at
from .rim import BLUR, outline, rim, share

FINE = 2  # points of a layer to a pixel
WINDOW = 0.8  # diameters: half width of the picture of a ball
ROUNDS = 3  # of learning
TEACHERS = 40  # frames that teach at most
TURNS = np.deg2rad(np.arange(-40.0, 41.0, 20.0))  # from the frame before, that are tried
STEPS, REST, H = 15, 1e-3, 0.3  # of a fit; px: the last; of a difference
UNLIKE = 0.3  # of the change against the scene, which a fit may leave
FREE = 0.1  # of the contrast, by which light and contrast may change from frame to frame
LEAST = 0.002  # of the height, that noise is taken for, up to what digitising leaves
LESSONS = 6  # of a layer, from all its frames
FAST, LONGEST = 4.0, 0.5  # px a frame, from which a streak is looked for; diameters
SHARES, CLOSE = (0.0, 0.2, 0.5, 1.0), 0.01  # of the longest, that are tried, and how near it is found
FASTEST = 12  # frames, that tell it
PIECES = 24  # of a streak
OUTLIER = 3.0  # standard deviations, from which a pixel counts less


@dataclass(frozen=True)
class Layer:
    """alpha, shown (FINE side, FINE side): share of a pixel and what is shown in it, FINE to a pixel, the centre in the
    middle; d: diameter [px]; n: frames that taught it."""

    alpha: Float32
    shown: Float32
    d: float
    n: int

    @property
    def side(self) -> int:
        """Of the window [px]."""
        return self.alpha.shape[0] // FINE


def _side(d: float) -> int:
    """Of a window for a diameter [px]."""
    return 2 * math.ceil(WINDOW * d) + 1


@dataclass(frozen=True)
class Place:
    """x, y [px], turn [rad], light [grey] and contrast of a ball in one frame; found: its measurement; streak: its way
    in the exposure [px]."""

    x: float
    y: float
    turn: float
    light: float
    contrast: float
    found: Found
    streak: tuple[float, float] = (0.0, 0.0)


def learned(frames: Frames, scene: Float32, path: Path, d: float) -> tuple[Layer, dict[int, Place]] | None:
    """The layer that a path's frames show, and their fits; None where they show no round thing."""
    h, w = scene.shape
    inside = [s for s in path if 0.6 * d < s.x < w - 0.6 * d and 0.6 * d < s.y < h - 0.6 * d]
    inside = inside[:: max(1, len(inside) // TEACHERS)]
    if len(inside) < 3:
        return None
    usual = float(np.median([s.contrast for s in inside]))
    best = min(inside, key=lambda s: abs(s.contrast - usual))
    order = sorted(inside, key=lambda s: abs(s.i - best.i))
    where = {best.i: Place(best.x, best.y, 0.0, 0.0, 1.0, best.found)}
    layer, _ = _taught(frames, scene, where, _disc(d, d, BLUR[0]))
    for turn in range(ROUNDS):
        now: dict[int, Place] = {best.i: where[best.i]} if turn == 0 else {}
        for s in order:
            if s.i in now:
                continue
            near = min(now or where, key=lambda i: abs(i - s.i))
            guess = where.get(s.i) or replace((now or where)[near], x=s.x, y=s.y)
            image = np.asarray(frames[s.i], np.float32)
            turns = TURNS if turn == 0 else (0.0,)
            tried = [fit(image, scene, layer, replace(guess, turn=guess.turn + t), d) for t in turns]
            place = min(tried, key=lambda p: p.found.chi2 if not p.found.flag else math.inf)
            if not place.found.flag:
                now[s.i] = place
        if len(now) < 3:
            return None
        where = now
        change, behind = _change(frames, scene, where, layer.side, LESSONS if turn else 1)
        round_one = outline(change, layer.d)
        if round_one is None:
            return None
        x, y, size, blur = rim(change, behind, round_one)
        where = {i: _shifted(p, x, y) for i, p in where.items()}
        layer = replace(layer, alpha=_disc(d, size, blur), d=size)
        if turn < ROUNDS - 1:
            where = _streaked(frames, scene, path, where, layer)
        layer, _ = _taught(frames, scene, where, layer.alpha)
    return layer, where


def _streaked(frames: Frames, scene: Float32, path: Path, where: dict[int, Place], layer: Layer) -> dict[int, Place]:
    """The places with their streaks: of the exposure, as a share of the time between frames, that leaves least."""
    speed = {i: math.hypot(*velocity(path, i)) for i in where}
    fastest = max(speed.values())
    if fastest < FAST:
        return where

    def of(exposure: float, which: Iterable[int]) -> dict[int, Place]:
        ways = {i: velocity(path, i) for i in which}
        return {i: replace(where[i], streak=(exposure * u, exposure * v)) for i, (u, v) in ways.items()}

    some = sorted(where, key=lambda i: -speed[i])[:FASTEST]

    def left(exposure: float) -> float:
        return _taught(frames, scene, of(exposure, some), layer.alpha)[1]

    tried = [min(1.0, LONGEST * layer.d / fastest) * f for f in SHARES]
    best = int(np.argmin([left(s) for s in tried]))
    span = tried[max(best - 1, 0)], tried[min(best + 1, len(tried) - 1)]
    found = minimize_scalar(left, bounds=span, method="bounded", options={"xatol": CLOSE * tried[-1]})
    return of(float(found.x), where)


def velocity(path: Path, i: int) -> tuple[float, float]:
    """Of a ball in frame i [px a frame], none where the path does not see it."""
    if all(s.i != i for s in path):
        return 0.0, 0.0
    (x0, y0), (x1, y1) = at(path, i - 1), at(path, i + 1)
    return 0.5 * (x1 - x0), 0.5 * (y1 - y0)


def _disc(d: float, size: float, blur: float) -> Float32:
    """Share of the pixels of a window for diameter d that a disc of a size takes in its middle."""
    k = FINE * _side(d)
    v, u = (np.indices((k, k)) - (k - 1) / 2) / FINE
    return share(0.0, 0.0, 0.5 * size, blur, u, v).astype(np.float32)


def _change(frames: Frames, scene: Float32, where: dict[int, Place], k: int, lessons: int) -> tuple[Float32, Float32]:
    """What changes with the ball, without its streaks, and what is behind it on the median, (k, k) each."""
    change = _taught(frames, scene, where, np.zeros((FINE * k, FINE * k), np.float32), lessons)[0].shown
    middle = (FINE * k - 1) / 2
    behind = [sampled(scene, p.x, p.y, p.turn, k) for p in where.values()]
    return sampled(change, middle, middle, 0.0, k, 1 / FINE), np.median(behind, axis=0).astype(np.float32)


def _shifted(place: Place, u: float, v: float) -> Place:
    """The place whose centre is (u, v) of the layer's window away from the middle."""
    c, s = math.cos(place.turn), math.sin(place.turn)
    return replace(place, x=place.x + c * u - s * v, y=place.y + s * u + c * v)


def sampled(image: Float32, x: float, y: float, turn: float, k: int, fine: float = 1.0) -> Float32:
    """An image on a grid (k, k) laid with its middle at (x, y), turned, as many times as fine."""
    v, u = (np.indices((k, k)) - (k - 1) / 2) / fine
    c, s = math.cos(turn), math.sin(turn)
    at_x, at_y = (x + c * u - s * v).astype(np.float32), (y + s * u + c * v).astype(np.float32)
    return np.asarray(cv2.remap(image, at_x, at_y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))


def _taught(
    frames: Frames, scene: Float32, where: dict[int, Place], alpha: Float32, lessons: int = LESSONS
) -> tuple[Layer, float]:
    """The layer of this share that the frames show at their places, and the squared grey levels that it leaves.

    What a frame shows beyond the layer, laid on the layer again, corrects it (Landweber 1951; Irani and Peleg 1991).
    """
    k = alpha.shape[0] // FINE
    cuts = [(_cut(np.asarray(frames[i], np.float32), scene, p.x, p.y, k), p) for i, p in where.items()]
    layer = Layer(alpha, np.zeros_like(alpha), 2.0 * math.sqrt(float(alpha.sum()) / math.pi) / FINE, len(cuts))
    yy, xx = np.indices((k, k))

    def near(p: Place, cut: _Cut) -> NDArray[np.bool_]:
        return np.hypot(xx + cut.x - p.x, yy + cut.y - p.y) < (0.5 + 0.25 * LONGEST) * layer.d + 2.0

    for lesson in range(lessons):
        rest, power = [], 0.0
        for cut, p in cuts:
            share, shown = _laid(layer, p.x - cut.x, p.y - cut.y, p.turn, p.streak)
            left = (cut.grey - cut.behind * (1.0 - share) - p.light * share) / p.contrast - shown
            power += float(np.sum(left[cut.inside & near(p, cut)] ** 2))
            rest.append(
                sampled(
                    _smeared(left.astype(np.float32), p.streak), p.x - cut.x, p.y - cut.y, p.turn, alpha.shape[0], FINE
                )
            )
        stack = np.stack(rest)
        if lesson == 0:
            more = np.median(stack, axis=0)
            off = np.abs(stack - more)
            kept = off <= OUTLIER * FROM_MAD * np.median(off, axis=0) + 1e-5 * float(np.ptp(stack))
        else:
            more = np.sum(stack * kept, axis=0) / np.maximum(kept.sum(axis=0), 1)
        layer = replace(layer, shown=(layer.shown + more).astype(np.float32))
    if alpha.any():
        layer = replace(layer, shown=np.where(alpha > 1e-3, layer.shown, 0.0).astype(np.float32))
    return layer, power


@dataclass(frozen=True)
class _Cut:
    """grey, behind (k, k): a frame and the scene from row y and column x; inside (k, k): the image's."""

    grey: NDArray[np.float64]
    behind: NDArray[np.float64]
    x: int
    y: int
    inside: NDArray[np.bool_]


def _cut(image: Float32, scene: Float32, x: float, y: float, k: int) -> _Cut:
    """A window (k, k) about (x, y)."""
    h, w = image.shape
    x0, y0 = round(x) - (k - 1) // 2, round(y) - (k - 1) // 2
    cut = [max(0, -y0), max(0, y0 + k - h), max(0, -x0), max(0, x0 + k - w)]
    at = np.s_[max(0, y0) : y0 + k, max(0, x0) : x0 + k]
    room = ((cut[0], cut[1]), (cut[2], cut[3]))
    grey, behind = (np.pad(a[at].astype(np.float64), room, mode="edge") for a in (image, scene))
    return _Cut(grey, behind, x0, y0, np.pad(np.ones(image[at].shape, bool), room))


def fit(image: Float32, scene: Float32, layer: Layer, start: Place, d: float) -> Place:
    """Least squares of the layer before the scene, in x, y, turn, light and contrast; chi2: what is left of the change
    against the scene."""
    k = layer.side
    x, y, turn, light, contrast = start.x, start.y, start.turn, start.light, start.contrast
    h, w = image.shape
    reach = 0.5 * layer.d + 1.0

    def lost(why: str) -> Place:
        return replace(start, found=Found(why))

    if not (reach < x < w - 1 - reach and reach < y < h - 1 - reach):
        return lost("at the image edge")
    cut = _cut(image, scene, x, y, k)
    grey, behind, x0, y0 = cut.grey, cut.behind, cut.x, cut.y
    yy, xx = np.indices((k, k))
    face = layer.shown[layer.alpha > 0.5]
    height = float(np.std(face)) + abs(float(np.median(face) - np.median(behind)))
    for _ in range(STEPS):
        alpha, shown = _laid(layer, x - x0, y - y0, turn, start.streak)
        model = behind * (1.0 - alpha) + light * alpha + contrast * shown
        part = cut.inside & (np.hypot(xx + x0 - x, yy + y0 - y) < 0.5 * layer.d + 3.0 + 0.5 * math.hypot(*start.streak))
        left = grey - model
        columns = []
        for dx, dy, dt in ((H, 0.0, 0.0), (0.0, H, 0.0), (0.0, 0.0, 2 * H / layer.d)):
            (a1, m1), (a0, m0) = (
                _laid(layer, x - x0 + g * dx, y - y0 + g * dy, turn + g * dt, start.streak) for g in (1.0, -1.0)
            )
            columns.append(((light - behind) * (a1 - a0) + contrast * (m1 - m0)) / (2 * (dx + dy + dt)))
        j = np.stack([*columns, alpha, shown], axis=-1)[part]
        r = left[part]
        noise = max(FROM_MAD * float(np.median(np.abs(r))), min(0.3, LEAST * height))
        weight = np.minimum(1.0, OUTLIER * noise / np.maximum(np.abs(r), 1e-9))
        normal = j.T @ (weight[:, None] * j)
        prior = noise**2 / np.array([np.inf, np.inf, np.inf, (FREE * height) ** 2, FREE**2])
        normal[np.diag_indices(5)] += prior + 1e-9
        right = j.T @ (weight * r) - prior * np.array([0.0, 0.0, 0.0, light, contrast - 1.0])
        step = np.linalg.solve(normal, right)
        size = math.hypot(step[0], step[1])
        short = min(1.0, 0.15 * d / max(size, 1e-9), 0.3 / max(abs(step[2]), 1e-9))
        x, y, turn, light, contrast = (v + short * float(s) for v, s in zip((x, y, turn, light, contrast), step))
        if not math.hypot(x - start.x, y - start.y) < 0.5 * d:
            return lost("lost: the fit did not converge")
        if size < REST:
            break
    if not (reach < x < w - 1 - reach and reach < y < h - 1 - reach):
        return lost("at the image edge")
    ball = part & (alpha > 0.5)
    unlike = float(np.sum(left[ball] ** 2) / max(np.sum((grey - behind)[ball] ** 2), 1e-9))
    if unlike > UNLIKE or not 0.5 < contrast < 2.0:
        return lost(f"lost: not like the target (contrast {contrast:.2g} of it, {unlike:.0%} unlike)")
    cov = np.linalg.inv(normal) * float(np.sum(weight * r**2) / max(np.sum(weight) - 5.0, 1.0))
    # The layer's own noise, 1 / n of a frame's, is in both; of a frame that taught it, what is left hides as much
    sigma = math.sqrt(max(cov[0, 0], cov[1, 1]) * (layer.n + 1) / max(layer.n - 1, 1))
    return Place(x, y, turn, light, contrast, Found("", x, y, sigma, layer.d, unlike), start.streak)


def _laid(
    layer: Layer, x: float, y: float, turn: float, streak: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """alpha and what is shown, of the layer laid at (x, y) of its own window, turned and smeared."""
    k = layer.side
    c, s, m = FINE * math.cos(turn), FINE * math.sin(turn), (FINE * k - 1) / 2
    back = np.array([[c, s, m - c * x - s * y], [-s, c, m + s * x - c * y]])
    how = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    a, b = (
        _smeared(np.asarray(cv2.warpAffine(v, back, (k, k), flags=how)), streak).astype(np.float64)
        for v in (layer.alpha, layer.shown)
    )
    return a, b


def _smeared(image: Float32, streak: tuple[float, float]) -> Float32:
    """The mean of an image along a way [px]."""
    if math.hypot(*streak) < 0.2:
        return image
    return np.asarray(cv2.filter2D(image, -1, _line(*streak), borderType=cv2.BORDER_REPLICATE))


@lru_cache(maxsize=256)
def _line(u: float, v: float) -> Float32:
    """Shares of the pixels about the middle in a line from (-u / 2, -v / 2) to (u / 2, v / 2)."""
    f = (np.arange(PIECES) + 0.5) / PIECES - 0.5
    rows, columns = (np.ceil(0.5 * abs(s)) for s in (v, u))
    y, x = np.arange(-rows, rows + 1), np.arange(-columns, columns + 1)
    down, across = (np.maximum(1.0 - np.abs(a[:, None] - s * f), 0.0) for a, s in ((y, v), (x, u)))
    return np.asarray(down @ across.T / PIECES, np.float32)
