"""Whether the still scene of a film keeps its place: a camera that was touched moves all heights with it."""

from __future__ import annotations

import math

import cv2
import numpy as np

from jumpvision.base.arrays import Float32, Image
from jumpvision.films.frames.base import Frames

from .piv.predict import correlate, peaks

TILE, FEWEST = 48, 3  # px of the parts that tell a shift, and how many of them must agree
LOOKS = 9  # frames of a film that are compared with its first
ALIKE = 0.4  # correlation of parts that show the same scene
AGREE, MOST = 0.3, 0.5  # px between the shifts of parts that agree, and their share of those that show the scene
MOVED = 0.4  # px, from which it is told


def scene_shift(frames: Frames) -> str:
    """Tell by how much and from which frame on the scene (H, W) stands elsewhere; "" where it keeps its place."""
    n = len(frames)
    if n < 3 or min(np.shape(frames[0])) < TILE:
        return ""
    first = _tiles(frames[0])
    looks = np.unique(np.linspace(0, n - 1, LOOKS).astype(int))[1:]
    moved = [_shift(first, _tiles(frames[int(k)])) for k in looks]
    far = [k for k, d in enumerate(moved) if math.hypot(*d) > MOVED]
    if not far:
        return ""
    high = int(looks[far[0]])
    low, shift = (int(looks[far[0] - 1]) if far[0] else 0), moved[far[0]]
    while high - low > 1:
        middle = (low + high) // 2
        there = math.hypot(*_shift(first, _tiles(frames[middle]))) > 0.5 * math.hypot(*shift)
        low, high = (low, middle) if there else (middle, high)
    right, down = shift
    return (
        f"the still scene stands {right:+.2g} px to the right and {down:+.2g} px down from about frame {high} on: "
        "was the camera touched? Heights before and after are not above one rest; cut the film there"
    )


def _tiles(image: Image) -> Float32:
    """Return parts (n, TILE, TILE) of a picture without its smooth light, and with less noise."""
    grey = cv2.GaussianBlur(np.nan_to_num(np.asarray(image, np.float32)), (0, 0), 1.5)
    high = np.asarray(grey - cv2.blur(grey, (TILE, TILE)), np.float32)
    starts = [np.linspace(0, n - TILE, min(n // TILE, 6)).astype(int) for n in high.shape]
    return np.array([high[j : j + TILE, i : i + TILE] for j in starts[0] for i in starts[1]])


def _shift(a: Float32, b: Float32) -> tuple[float, float]:
    """Return column and row [px] by which most parts moved that show the same scene; 0 where they do not agree."""
    all_of_it = np.ones_like(a)
    found = peaks(correlate(a, all_of_it, b, all_of_it))
    shown = found.height[:, 0] > ALIKE
    if shown.sum() < FEWEST:
        return 0.0, 0.0
    moved = np.stack([found.u[shown, 0], found.v[shown, 0]])
    middle = np.median(moved, axis=1)
    agree = np.hypot(*(moved - middle[:, None])) < AGREE
    if agree.sum() < FEWEST or agree.mean() < MOST:
        return 0.0, 0.0
    return float(middle[0]), float(middle[1])
