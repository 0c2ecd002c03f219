"""A ball of any face in flight, as a layer before the still scene: found by its motion, then fitted as a picture.

I = S (1 - alpha) + M at every pixel, with S the scene, alpha the ball's share of the pixel and M what it shows there
(Wang and Adelson 1994). All frames of the flight teach alpha and M; each frame is then fitted in position, turn, light
and contrast, on its own pixels.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import FROM_MAD, MAD, Array, Float32

from .measure import Found
from .moving import HOLE, MOST_FRAMES, Frames, Path, Spot, at, extent, paths, still_scene

THINGS = 8  # that are looked at in a frame
FAINT = 0.15  # of what changes most in the usual frame: less is noise
CLEAR = 4.0  # standard deviations of the noise, the least mean change of a thing
WINDOW = 0.8  # diameters: half width of the picture of a ball
ROUNDS = 3  # of learning
TEACHERS = 40  # frames that teach at most
TURNS = np.deg2rad(np.arange(-40.0, 41.0, 20.0))  # from the frame before, that are tried
STEPS, REST, H = 15, 1e-3, 0.3  # of a fit; px: the last; of a difference
UNLIKE = 0.3  # of the change against the scene, which a fit may leave
EDGE = 1.0  # px: half width of a ball's rim before it is learned
RAYS, WEAK = 64, 0.12  # of an outline; least change just inside it, of the strongest
ROUND, SIZE = 0.08, 0.3  # scatter of an outline about its circle, diameters; relative difference from the diameter given
FLIGHT, SURE = 6, 0.7  # frames of a path that nobody clicked, and share of them that must fit
GUESS = 12.0  # px: first diameter where none is known
FREE = 0.1  # of the contrast, by which light and contrast may change from frame to frame
OUTLIER = 3.0  # standard deviations, from which a pixel counts less


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


def in_flight(frames: Frames, diameter: float | None, seed: tuple[float, float] | None) -> list[Found] | None:
    """The ball that flies from the seed, or the farthest where none is given, in every frame; None where nothing flies,
    it is not round, of another diameter [px], or its picture does not hold."""
    if len(frames) < FLIGHT:
        return None
    scene = still_scene(frames)
    path = _path(frames, scene, diameter or GUESS, seed)
    if path is not None and diameter is None:
        size = _size(frames, scene, path)
        path = _path(frames, scene, size, seed)
    if path is None:
        return None
    d = path[0].d
    learned = _learned(frames, scene, path, d)
    if learned is None or (diameter and abs(learned[0].d / diameter - 1.0) > SIZE):
        return None
    layer, known = learned
    places = _everywhere(frames, scene, path, layer, known)
    on_path = [places[s.i].found.flag == "" for s in path]
    if np.mean(on_path) < SURE:
        return None
    return [p.found for p in places]


def _path(frames: Frames, scene: Float32, d: float, seed: tuple[float, float] | None) -> Path | None:
    """The farthest path of those that begin at the seed, of two as far the one of more contrast."""
    n = min(len(frames), MOST_FRAMES)
    things = {i: _things(i, np.asarray(frames[i], np.float32), scene, d) for i in range(n)}
    usual = float(np.median([t[0].contrast if t else 0.0 for t in things.values()]))
    all_paths = paths({i: [s for s in t if s.contrast > FAINT * usual] for i, t in things.items()})
    ours = [p for p in all_paths if (_from(p, seed) if seed is not None else len(p) >= FLIGHT)]
    far = [p for p in ours if extent(p) > 0.7 * max(map(extent, ours))]
    return max(far, key=lambda p: float(np.median([s.contrast for s in p])) * math.sqrt(len(p)), default=None)


def _from(path: Path, seed: tuple[float, float]) -> bool:
    """Whether a path may have begun at the seed in the first frame."""
    first, second = path[0], path[1]
    speed = math.hypot(second.x - first.x, second.y - first.y) / (second.i - first.i)
    x, y = at(path, 0)
    near = math.hypot(first.x - seed[0], first.y - seed[1]), math.hypot(x - seed[0], y - seed[1])
    return min(near) < 1.5 * first.d + speed * max(first.i, 0)


def _things(i: int, image: Float32, scene: Float32, d: float) -> list[Spot]:
    """What has changed against the scene in frame i, as large as the diameter, most changed first."""
    change = np.abs(image - scene)
    noise = max(float(np.median(change)) / MAD, 1e-3)
    k = 2 * int(0.5 * d) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (k, k)).astype(np.float32)
    mean = cv2.filter2D(change, -1, disc / disc.sum())
    out = []
    for _ in range(THINGS):
        row, column = (int(v) for v in np.unravel_index(int(np.argmax(mean)), mean.shape))
        peak = float(mean[row, column])
        if peak < CLEAR * noise:
            break
        half = int(0.75 * d) + 1
        y0, x0 = max(0, row - half), max(0, column - half)
        part = np.clip(change[y0 : row + half + 1, x0 : column + half + 1] - 0.3 * peak, 0.0, None)
        yy, xx = np.indices(part.shape)
        part = part * (np.hypot(xx + x0 - column, yy + y0 - row) < 0.75 * d)
        x, y = (float(np.average(v, weights=part)) for v in (xx + x0, yy + y0))
        out.append(Spot(i, x, y, d, peak, Found("", x, y)))
        mean[max(0, row - k) : row + k + 1, max(0, column - k) : column + k + 1] = 0.0
    return out


def _size(frames: Frames, scene: Float32, path: Path) -> float:
    """Diameter of the area that changes along a path [px]."""
    sizes = []
    for s in path:
        change = np.abs(np.asarray(frames[s.i], np.float32) - scene)
        _, labels, stats, _ = cv2.connectedComponentsWithStats((change > 0.3 * s.contrast).astype(np.uint8))
        row, column = (int(np.clip(v, 0, n - 1)) for v, n in zip((round(s.y), round(s.x)), change.shape))
        if labels[row, column]:
            sizes.append(2.0 * math.sqrt(stats[labels[row, column], cv2.CC_STAT_AREA] / math.pi))
    return max(float(np.median(sizes)) if sizes else GUESS, 6.0)


def _learned(frames: Frames, scene: Float32, path: Path, d: float) -> tuple[Layer, dict[int, Place]] | None:
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
    layer = _taught(frames, scene, list(where.items()), _round(d, 0.0, 0.0, d), None)
    for turn in range(ROUNDS):
        now: dict[int, Place] = {best.i: where[best.i]} if turn == 0 else {}
        for s in order:
            if s.i in now:
                continue
            near = min(now or where, key=lambda i: abs(i - s.i))
            guess = where.get(s.i) or replace((now or where)[near], x=s.x, y=s.y)
            tried = [_fit(np.asarray(frames[s.i], np.float32), scene, layer, guess, d)]
            if turn == 0:
                tried = [
                    _fit(np.asarray(frames[s.i], np.float32), scene, layer, replace(guess, turn=guess.turn + t), d)
                    for t in TURNS
                ]
            place = min(tried, key=lambda p: p.found.chi2 if not p.found.flag else math.inf)
            if not place.found.flag:
                now[s.i] = place
        if len(now) < 3:
            return None
        where = now
        outline = _outline(frames, scene, where, layer)
        if outline is None:
            return None
        x, y, size = outline
        where = {i: _shifted(p, x, y) for i, p in where.items()}
        layer = _taught(frames, scene, list(where.items()), _round(d, 0.0, 0.0, size), layer)
    return layer, where


def _round(d: float, x: float, y: float, size: float) -> Float32:
    """Share of the pixels of a window for diameter d that a disc of a size takes, its centre (x, y) from the middle."""
    k = 2 * math.ceil(WINDOW * d) + 1
    v, u = np.indices((k, k)) - (k - 1) / 2
    return np.clip((0.5 * size - np.hypot(u - x, v - y)) / (2 * EDGE) + 0.5, 0.0, 1.0).astype(np.float32)


def _shifted(place: Place, u: float, v: float) -> Place:
    """The place whose centre is (u, v) of the layer's window away from the middle."""
    c, s = math.cos(place.turn), math.sin(place.turn)
    return replace(place, x=place.x + c * u - s * v, y=place.y + s * u + c * v)


def _sampled(image: Float32, place: Place, k: int) -> Float32:
    """An image on the layer's grid (k, k) laid at a place."""
    v, u = np.indices((k, k)) - (k - 1) / 2
    c, s = math.cos(place.turn), math.sin(place.turn)
    at_x, at_y = (place.x + c * u - s * v).astype(np.float32), (place.y + s * u + c * v).astype(np.float32)
    return np.asarray(cv2.remap(image, at_x, at_y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))


def _taught(
    frames: Frames, scene: Float32, where: Sequence[tuple[int, Place]], alpha: Float32, before: Layer | None
) -> Layer:
    """The layer of this share that the frames show at their places; the rim's share from how it hides the scene."""
    k = alpha.shape[0]
    seen = []
    for i, p in where:
        image, behind = (_sampled(a, p, k) for a in (np.asarray(frames[i], np.float32), scene))
        seen.append((image - (1.0 - alpha) * behind - p.light * alpha) / p.contrast)
    stack = np.asarray(seen, np.float32)
    middle = np.median(stack, axis=0)
    spread = FROM_MAD * np.median(np.abs(stack - middle), axis=0) + 1e-3
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
    stack = [_sampled(np.asarray(frames[i], np.float32) - scene, p, k) for i, p in where.items()]
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
        at = np.full(RAYS, np.nan)
        band = 1.5 if turn else max(3.0, 0.4 * rim)
        begin, end = np.searchsorted(r, [rim - band, rim + band])
        for q in range(RAYS):
            below = np.flatnonzero(rays[q, begin:end] / height[q] < 0.5)
            if below.size and below[0] and abs(height[q]) > WEAK * np.percentile(np.abs(height), 90):
                at[q] = r[begin + below[0]]
        ok = np.isfinite(at)
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
    return (u, v, size) if spread < ROUND * size else None


def _fit(image: Float32, scene: Float32, layer: Layer, start: Place, d: float) -> Place:
    """Least squares of the layer before the scene, in x, y, turn, light and contrast; chi2: what is left of the change
    against the scene."""
    k = layer.alpha.shape[0]
    half = (k - 1) // 2
    x, y, turn, light, contrast = start.x, start.y, start.turn, start.light, start.contrast
    h, w = image.shape
    reach = 0.5 * layer.d + 1.0

    def lost(why: str) -> Place:
        return replace(start, found=Found(why))

    if not (reach < x < w - 1 - reach and reach < y < h - 1 - reach):
        return lost("at the image edge")
    x0, y0 = round(x) - half, round(y) - half
    pad = cv2.copyMakeBorder
    cut = [max(0, -y0), max(0, y0 + k - h), max(0, -x0), max(0, x0 + k - w)]
    at = np.s_[max(0, y0) : y0 + k, max(0, x0) : x0 + k]
    grey, behind = (pad(np.ascontiguousarray(a[at]), *cut, cv2.BORDER_REPLICATE).astype(np.float64) for a in (image, scene))
    yy, xx = np.indices((k, k))
    level = float(np.std(layer.shown[layer.alpha > 0.5] - np.median(behind))) + float(
        abs(np.median(layer.shown[layer.alpha > 0.5]) - np.median(behind))
    )
    weight = np.ones((k, k))
    noise = 1.0
    for step_number in range(STEPS):
        alpha, shown = _laid(layer, x - x0, y - y0, turn)
        model = behind * (1.0 - alpha) + light * alpha + contrast * shown
        part = np.hypot(xx + x0 - x, yy + y0 - y) < 0.5 * layer.d + 3.0
        part[: cut[0]] = part[k - cut[1] :] = part[:, : cut[2]] = part[:, k - cut[3] :] = False
        left = grey - model
        columns = []
        for dx, dy, dt in ((H, 0.0, 0.0), (0.0, H, 0.0), (0.0, 0.0, 2 * H / layer.d)):
            (a1, m1), (a0, m0) = (
                _laid(layer, x - x0 + g * dx, y - y0 + g * dy, turn + g * dt) for g in (1.0, -1.0)
            )
            columns.append(((light - behind) * (a1 - a0) + contrast * (m1 - m0)) / (2 * (dx + dy + dt)))
        j = np.stack([*columns, alpha, shown], axis=-1)[part]
        r = left[part]
        noise = max(FROM_MAD * float(np.median(np.abs(r))), 0.3)
        weight = np.minimum(1.0, OUTLIER * noise / np.maximum(np.abs(r), 1e-9))
        normal = j.T @ (weight[:, None] * j)
        prior = noise**2 / np.array([np.inf, np.inf, np.inf, (FREE * level) ** 2, FREE**2])
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
    sigma = math.sqrt(max(cov[0, 0], cov[1, 1]))
    return Place(x, y, turn, light, contrast, Found("", x, y, sigma, layer.d, unlike))


def _laid(layer: Layer, x: float, y: float, turn: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """alpha and what is shown, of the layer laid at (x, y) of its own window, turned."""
    k = layer.alpha.shape[0]
    c, s, m = math.cos(turn), math.sin(turn), (k - 1) / 2
    back = np.array([[c, s, m - c * x - s * y], [-s, c, m + s * x - c * y]])
    how = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    a, b = (
        cv2.warpAffine(v, back, (k, k), flags=how, borderMode=cv2.BORDER_CONSTANT).astype(np.float64)
        for v in (layer.alpha, layer.shown)
    )
    return a, b


def _everywhere(frames: Frames, scene: Float32, path: Path, layer: Layer, known: dict[int, Place]) -> list[Place]:
    """Every frame's fit: from those that taught, on along the path and beyond its ends."""
    spots = {s.i: s for s in path}
    done: dict[int, Place] = {}
    middle = sorted(known)[len(known) // 2]
    for order in (range(middle, len(frames)), range(middle - 1, -1, -1)):
        last, gap = known[middle], 1
        for i in order:
            image = np.asarray(frames[i], np.float32)
            expected = (spots[i].x, spots[i].y) if i in spots else at(path, i)
            starts = [known[i]] if i in known else [replace(last, x=expected[0], y=expected[1])]
            place = _fit(image, scene, layer, starts[0], layer.d)
            if place.found.flag and i not in spots:  # held before, or bounced: where it was, or something moves
                if order.step > 0 and _left(scene, *expected):
                    place = replace(place, found=Found("left the image"))
                elif gap <= HOLE:
                    reach = layer.d + _fastest(path)
                    near = [(t.x, t.y) for t in _things(i, image, scene, layer.d)]
                    near = [p for p in near if math.hypot(p[0] - last.x, p[1] - last.y) < reach]
                    starts = [replace(last, x=x, y=y) for x, y in [(last.x, last.y), *near]]
                    tried = [p for p in (_fit(image, scene, layer, s, layer.d) for s in starts) if not p.found.flag]
                    place = min(tried, key=lambda p: p.found.chi2, default=place)
            done[i] = place
            if place.found.flag == "left the image":
                gap = HOLE + 1
            last, gap = (last, gap + 1) if place.found.flag else (place, 1)
    return [done[i] for i in range(len(frames))]


def _left(scene: Float32, x: float, y: float) -> bool:
    """Whether (x, y) is beyond the picture's edge, but not the upper one: from there it falls back."""
    return not 0.0 <= x < scene.shape[1] or y >= scene.shape[0]


def _fastest(path: Path) -> float:
    """Largest speed along a path [px a frame]."""
    return max(math.hypot(b.x - a.x, b.y - a.y) / (b.i - a.i) for a, b in itertools.pairwise(path))
