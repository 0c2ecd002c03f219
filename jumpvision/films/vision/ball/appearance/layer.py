"""A ball of any face as a layer before the still scene: its picture, learned from a flight, and its fit to a frame.

I = S (1 - alpha) + M at every pixel, with S the scene, alpha the ball's share of the pixel and M what it shows there
(Wang and Adelson 1994). All frames of the flight teach alpha and M; each frame is then fitted in position, turn, light
and contrast, on its own pixels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from jumpvision.base.arrays import FROM_MAD, Float32, Image
from jumpvision.films.frames.base import Frames
from jumpvision.films.vision.ball.measure import Found
from jumpvision.films.vision.ball.moving import Path
from jumpvision.films.vision.ball.reasons import GOOD, Flag, Reason

from .laying import OUTLIER, fit_layer

TURNS = np.deg2rad(np.arange(-40.0, 41.0, 20.0))  # from the frame before, that are tried
ODD = 2.8  # times what most frames leave of the picture, from which one shows something else
RAYS, WEAK = 64, 0.12  # of an outline; least change just inside it, of the strongest


@dataclass(frozen=True)
class Layer:
    """alpha, shown (k, k): share of a pixel and what is shown in it; d: diameter [px]. Centre at (k - 1) / 2."""

    alpha: Float32
    shown: Float32
    d: float


@dataclass(frozen=True)
class Place:
    """x, y [px], turn [rad], light [grey] and contrast of a ball in one frame; found: its measurement."""

    x: float
    y: float
    turn: float
    light: float
    contrast: float
    found: Found


def learned(frames: Frames, scene: Float32, path: Path, d: float) -> tuple[Layer, dict[int, Place], bool] | None:
    """The layer that a path's frames show, their fits, and whether a round rim is seen; None where nothing holds."""
    h, w = scene.shape
    inside = [s for s in path if 0.6 * d < s.x < w - 0.6 * d and 0.6 * d < s.y < h - 0.6 * d]
    inside = inside[:: max(1, len(inside) // 40)]  # forty frames teach enough
    if len(inside) < 3:
        return None
    usual = float(np.median([s.contrast for s in inside]))
    best = min(inside, key=lambda s: abs(s.contrast - usual))
    order = sorted(inside, key=lambda s: abs(s.i - best.i))
    where = {best.i: Place(best.x, best.y, 0.0, 0.0, 1.0, best.found)}
    layer = _learned_layer(frames, scene, where, _round(d, d))
    for turn in range(3):  # each round learns from better places
        now: dict[int, Place] = {best.i: where[best.i]} if turn == 0 else {}
        for s in order:
            if s.i in now:
                continue
            near = min(now or where, key=lambda i: abs(i - s.i))
            guess = where.get(s.i) or replace((now or where)[near], x=s.x, y=s.y)
            image = np.asarray(frames[s.i])
            turns = TURNS if turn == 0 else (0.0,)
            tried = [fit(image, scene, layer, replace(guess, turn=guess.turn + t), d) for t in turns]
            place = min(tried, key=lambda p: p.found.chi2 if not p.found.flag else math.inf)
            if not place.found.flag:
                now[s.i] = place
        if len(now) < 3:
            return None
        where = now
        outline = _outline(frames, scene, where, layer)
        x, y, size = outline or (0.0, 0.0, d)
        where = {i: shifted(p, x, y) for i, p in where.items()}
        layer = _learned_layer(frames, scene, where, _round(d, size))
    return layer, where, outline is not None


def _round(d: float, size: float) -> Float32:
    """Share of the pixels of a window for diameter d that a disc of a size takes in its middle."""
    k = 2 * math.ceil(0.8 * d) + 1  # half width of the picture: 0.8 diameters
    v, u = np.indices((k, k)) - (k - 1) / 2
    # a ball's rim is blurred over 2 px
    return np.clip((0.5 * size - np.hypot(u, v)) / (2 * 1.0) + 0.5, 0.0, 1.0).astype(np.float32)


def shifted(place: Place, u: float, v: float) -> Place:
    """The place whose centre is (u, v) of the layer's window away from the middle."""
    c, s = math.cos(place.turn), math.sin(place.turn)
    return replace(place, x=place.x + c * u - s * v, y=place.y + s * u + c * v)


def sampled(image: Image, x: float, y: float, turn: float, k: int) -> Float32:
    """An image on a grid (k, k) laid with its middle at (x, y), turned."""
    v, u = np.indices((k, k)) - (k - 1) / 2
    c, s, reach = math.cos(turn), math.sin(turn), 0.75 * k + 3.0
    x0, y0 = (int(np.clip(a - reach, 0, n - 1)) for a, n in ((x, image.shape[1]), (y, image.shape[0])))
    part = np.asarray(image[y0 : max(y0, int(y + reach)) + 2, x0 : max(x0, int(x + reach)) + 2], np.float32)
    at_x, at_y = (x - x0 + c * u - s * v).astype(np.float32), (y - y0 + s * u + c * v).astype(np.float32)
    return np.asarray(cv2.remap(part, at_x, at_y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))


def _learned_layer(frames: Frames, scene: Float32, where: dict[int, Place], alpha: Float32) -> Layer:
    """The layer of this share that the frames show at their places."""
    k = alpha.shape[0]
    seen = []
    for i, p in where.items():
        images = (np.asarray(frames[i]), scene)
        image, behind = (sampled(a, p.x, p.y, p.turn, k) for a in images)
        seen.append((image - (1.0 - alpha) * behind - p.light * alpha) / p.contrast)
    stack = np.asarray(seen, np.float32)
    middle = np.median(stack, axis=0)
    spread = FROM_MAD * np.median(np.abs(stack - middle), axis=0) + 1e-5 * float(np.ptp(stack))
    kept = np.abs(stack - middle) <= OUTLIER * spread
    shown = np.sum(stack * kept, axis=0) / np.maximum(kept.sum(axis=0), 1)
    shown = np.where(alpha > 0.0, shown, 0.0)
    size = 2.0 * math.sqrt(float(alpha.sum()) / math.pi)
    return Layer(alpha, shown.astype(np.float32), size)


def _outline(
    frames: Frames, scene: Float32, where: dict[int, Place], layer: Layer
) -> tuple[float, float, float] | None:
    """Centre (u, v) in the layer's window and diameter of what changes with the ball; None where it is not round.

    Where the change falls to half of what it is just inside, along RAYS from the centre; a circle through these.
    """
    k = layer.alpha.shape[0]
    pairs = (((np.asarray(frames[i]), scene), p) for i, p in where.items())
    stack = [np.subtract(*(sampled(a, p.x, p.y, p.turn, k) for a in pair)) for pair, p in pairs]
    change = np.median(stack, axis=0).astype(np.float32)
    u = v = 0.0
    size = layer.d
    angle = np.arange(RAYS) * 2 * math.pi / RAYS
    for turn in range(5):
        r = np.arange(0.0, 0.5 * k, 0.1)
        x, y = (c + np.outer(f(angle), r) for c, f in ((u, np.cos), (v, np.sin)))
        shift = np.float32((k - 1) / 2)
        rays = cv2.remap(change, x.astype(np.float32) + shift, y.astype(np.float32) + shift, cv2.INTER_CUBIC)
        rim = 0.5 * size
        inner = (r > rim - max(0.35 * rim, 2.8)) & (r < rim - 1.3)
        basis = np.stack([np.ones(inner.sum()), r[inner] - rim], axis=1)
        line = np.linalg.lstsq(basis, rays[:, inner].T, rcond=None)[0]
        height = line[0]  # what the rim would show, were it sharp
        at, strong = np.full(RAYS, np.nan), np.abs(height) > WEAK * np.percentile(np.abs(height), 90)
        band = 1.5 if turn else max(3.0, 0.4 * rim)
        begin, end = np.searchsorted(r, [rim - band, rim + band])
        for q in range(RAYS):
            below = np.flatnonzero(rays[q, begin:end] / height[q] < 0.5)
            if below.size and below[0] and strong[q]:
                at[q] = r[begin + below[0]]
        ok = np.isfinite(at)
        # what is seen must end at the rim on so many of the rays
        if turn and np.mean(ok[strong]) < 0.6:
            return None
        for _ in range(3):
            if ok.sum() < RAYS // 5:
                return None
            weight = np.abs(height[ok])
            ex, ey = u + at[ok] * np.cos(angle[ok]), v + at[ok] * np.sin(angle[ok])
            a = np.stack([ex, ey, np.ones(ok.sum())], axis=1) * weight[:, None]
            cu, cv, c0 = np.linalg.lstsq(a, weight * (ex**2 + ey**2), rcond=None)[0]
            centre, radius = (0.5 * cu, 0.5 * cv), math.sqrt(max(c0 + 0.25 * (cu**2 + cv**2), 1e-6))
            off = np.hypot(u + at * np.cos(angle) - centre[0], v + at * np.sin(angle) - centre[1]) - radius
            spread = FROM_MAD * float(np.nanmedian(np.abs(off[ok])))
            ok = np.isfinite(at) & (np.abs(off) < max(3.0 * spread, 0.1))
        u, v, size = float(centre[0]), float(centre[1]), 2.0 * radius
        if not (math.hypot(u, v) < 0.4 * layer.d and 0.6 < size / layer.d < 1.6):
            return None
    # an outline that scatters more about its circle is not round
    return (u, v, size) if spread < 0.08 * size else None


def fit(image: Image, scene: Float32, layer: Layer, start: Place, d: float) -> Place:
    """Least squares of the layer before the scene, in x, y, turn, light and contrast; chi2: what is left of the change
    against the scene."""
    x, y = start.x, start.y
    h, w = image.shape
    reach = 0.5 * layer.d + 1.0

    def lost(why: Reason, *numbers: float) -> Place:
        return replace(start, found=Found(Flag(why, numbers)))

    if not (reach < x < w - 1 - reach and reach < y < h - 1 - reach):
        return lost(Reason.AT_BORDER)
    half = (layer.alpha.shape[0] - 1) // 2
    x0, y0 = max(0, round(x) - half), max(0, round(y) - half)
    part = np.s_[y0 : round(y) + half + 1, x0 : round(x) + half + 1]
    grey, behind = (np.ascontiguousarray(a[part], np.float32) for a in (image, scene))
    face = layer.shown[layer.alpha > 0.5]
    height = float(np.std(face)) + abs(float(np.median(face) - np.median(behind)))
    begin = np.array([x - x0, y - y0, start.turn, start.light, start.contrast])
    p, normal, square, unlike, near = fit_layer(grey, behind, layer.alpha, layer.shown, begin, d, height)
    if not near:
        return lost(Reason.NOT_CONVERGED)
    x, y, turn, light, contrast = (float(v) for v in p + np.array([x0, y0, 0.0, 0.0, 0.0]))
    if not (reach < x < w - 1 - reach and reach < y < h - 1 - reach):
        return lost(Reason.AT_BORDER)
    if unlike > 0.3 or not 0.5 < contrast < 2.0:
        return lost(Reason.UNLIKE, contrast, unlike)
    cov = np.linalg.inv(normal) * square
    sigma = math.sqrt(max(cov[0, 0], cov[1, 1]))
    return Place(x, y, turn, light, contrast, Found(GOOD, x, y, sigma, layer.d, unlike))


def like_others(found: Found, usual: float) -> Found:
    """A measurement, or the reason why it is of something else; usual: what the ball's leave of its change."""
    times = math.sqrt(found.chi2 / max(usual, 1e-9)) if not found.flag else 0.0
    return Found(Flag(Reason.UNLIKE_OTHERS, (times,))) if times > ODD else found
