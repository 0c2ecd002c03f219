"""The published centroid at half height."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import FROM_MAD


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
