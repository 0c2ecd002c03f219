"""By thresholds: where might the ball be (round or streaked blobs, best first, good to a few pixels), and the published
centroid at half height."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import FROM_MAD

if TYPE_CHECKING:
    from cv2.typing import MatLike

LEVELS = (0.3, 0.5, 0.7)  # of the way from the common grey level to the brightest
SIZE_RATIO = 1.5  # largest factor between a blob's and the ball's diameter


@dataclass(frozen=True)
class Blob:
    """Centre x, y, diameter d and streak (wx, wy) in px (sign of the streak arbitrary); score 0..1, 1 = a perfect disc;
    cut: touches the image border."""

    x: float
    y: float
    d: float
    wx: float
    wy: float
    score: float
    cut: bool


def find_blobs(
    image: NDArray[np.generic], *, diameter: float | None, polarity: str, min_diameter: float, streak: bool
) -> list[Blob]:
    """Candidates in `image` (row, column), best first, at most 8; empty when there is none.

    Thresholds at several levels and at Otsu's; each outline is filled, so a highlight inside does not matter.
    diameter: expected, px; without it anything from min_diameter up to half the image counts. NaN pixels are empty.
    """
    values = _to_bytes(image, polarity)
    if values is None:
        return []
    grey: MatLike = values
    expected = diameter if diameter is not None else min_diameter
    # larger frames are searched on a reduced copy
    shrink = min(expected / 8.0, math.sqrt(grey.size / 400_000))
    if shrink >= 2.0:
        shrink = float(int(shrink))
        size = (int(grey.shape[1] / shrink), int(grey.shape[0] / shrink))
        sx, sy = grey.shape[1] / size[0], grey.shape[0] / size[1]
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    else:
        sx = sy = 1.0
    grey = cv2.GaussianBlur(grey, (0, 0), 1.0 if shrink < 2.0 else 0.6)
    low, high = quantile(np.asarray(grey).ravel(), 0.5), float(grey.max())
    otsu, _ = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    blobs: list[Blob] = []
    for level in sorted({int(low + f * (high - low)) for f in LEVELS} | {int(otsu)}):
        binary = (grey > level).astype(np.uint8)
        outlines, _ = cv2.findContours(binary, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        for outline in outlines:
            blob = _measure(outline, grey.shape, sx, sy, diameter, min_diameter, streak)
            if blob is not None:
                blobs.append(blob)
    blobs.sort(key=lambda b: -b.score)
    kept: list[Blob] = []
    for b in blobs:
        if all(math.hypot(b.x - k.x, b.y - k.y) > 0.3 * max(b.d, k.d) for k in kept):
            kept.append(b)
        if len(kept) == 8:
            break
    return kept


def _to_bytes(image: NDArray[np.generic], polarity: str) -> NDArray[np.uint8] | None:
    """Grey 0..255 with the ball bright; None when the image has no contrast."""
    values = image if image.dtype.kind == "u" and image.itemsize < 4 else np.asarray(image, dtype=np.float32)
    good = None if values is image else np.isfinite(values)
    known = values.ravel() if good is None or good.all() else values[good]
    if not known.size:
        return None
    # A few hot or dead pixels must not set the range
    some = known[:: max(1, values.size // 200_000)]
    low, high = (quantile(some, q) for q in (0.0002, 0.9998))
    if not high > low:
        low, high = float(known.min()), float(known.max())
    if not high > low:
        return None
    grey = np.clip((values.astype(np.float32) - np.float32(low)) * np.float32(255.0 / (high - low)), 0.0, 255.0)
    if polarity == "dark":
        grey = 255.0 - grey
    return (grey if good is None else np.where(good, grey, 0.0)).astype(np.uint8)


def quantile(values: NDArray[np.generic], share: float) -> float:
    """That of `numpy.quantile` of values (n,), sooner: of bytes and of 16 bits by how many there are of each."""
    at = share * (values.size - 1)
    ranks = np.array([math.floor(at), math.ceil(at)])
    if values.dtype.kind == "u" and values.itemsize < 4:
        low, high = np.searchsorted(np.cumsum(np.bincount(values)), ranks, side="right")
    else:
        low, high = np.partition(values, ranks)[ranks]
    return float(low) + (float(high) - float(low)) * (at - ranks[0])


def _measure(
    outline: MatLike,
    shape: tuple[int, ...],
    sx: float,
    sy: float,
    diameter: float | None,
    min_diameter: float,
    streak: bool,
) -> Blob | None:
    """A blob from its outline's filled moments, or None when neither its size nor its shape is a ball's."""
    if len(outline) < 6:
        return None
    m = cv2.moments(outline)
    area = m["m00"]
    if area <= 4.0:
        return None
    cxx, cyy, cxy = m["mu20"] / area, m["mu02"] / area, m["mu11"] / area
    root = math.hypot(0.5 * (cxx - cyy), cxy)
    major, minor = 0.5 * (cxx + cyy) + root, 0.5 * (cxx + cyy) - root
    if minor <= 0.0:
        return None
    scale = math.sqrt(sx * sy)
    d = (4.0 * math.sqrt(minor) + 1.0) * scale  # outlines run through pixel centres, half a pixel inside
    length = math.sqrt(12.0 * max(major - minor, 0.0)) * scale
    if diameter is None:
        if d < min_diameter / SIZE_RATIO or d > 0.5 * max(shape[0] * sy, shape[1] * sx):
            return None
        size = 1.0
    else:
        size = min(d / diameter, diameter / d)
        if size < 1.0 / SIZE_RATIO:
            return None
    filled = area / (4.0 * math.pi * math.sqrt(major * minor))  # 1 for an ellipse, 0.97 or so for a streak
    elongated = math.sqrt(major / minor)
    if filled < 0.8 or (not streak and elongated > 1.6):
        return None
    x0, y0, w, h = cv2.boundingRect(outline)
    cut = x0 <= 1 or y0 <= 1 or x0 + w >= shape[1] - 1 or y0 + h >= shape[0] - 1
    score = min(filled, 1.0) ** 2 * size * (1.0 if streak else 1.0 / elongated) * (0.5 if cut else 1.0)
    angle = 0.5 * math.atan2(2.0 * cxy, cxx - cyy)
    return Blob(
        (m["m10"] / area + 0.5) * sx - 0.5,
        (m["m01"] / area + 0.5) * sy - 0.5,
        d,
        length * math.cos(angle),
        length * math.sin(angle),
        score,
        cut,
    )


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
