"""Round spots of a frame where the ball may be: in the picture, and in what differs from the still scene.

A ball that moves is what differs from the scene; one that rests may be a part of the scene that the film shows. So both
are searched, each by thresholds whose outlines are filled: a highlight inside does not matter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np

from jumpvision.base.arrays import FROM_MAD, Array, Float32, Image
from jumpvision.films.parameters import SMALLEST_BALL

if TYPE_CHECKING:
    from cv2.typing import MatLike

LEVELS = 7  # thresholds from the noise to the brightest, each by the same factor above the one before
LEAST_NOISES = 5.0  # standard deviations of smoothed noise: the lowest threshold
PIXELS = 400_000  # frames with more are searched on a reduced copy
MOST = 12  # candidates of a frame
SAME = 0.4  # diameters between two spots that are one


class Spots(NamedTuple):
    """Candidates (n,) of a frame: centre x, y, diameter d [px], contrast [grey], streak wx, wy [px] of either sign;
    fill: part of the ellipse of the same moments that is covered; still: whether the scene shows it, too."""

    x: Array
    y: Array
    d: Array
    contrast: Array
    wx: Array
    wy: Array
    fill: Array
    still: Array


EMPTY = Spots(*(np.zeros(0) for _ in Spots._fields))


class Scene:
    """What stands still in a film, and its spots. grey: (row, column), None where too few frames tell it."""

    def __init__(
        self, grey: Float32 | None, noise: float, sign: float, diameter: float | None, gone: Float32 | None = None
    ):
        self.grey, self.noise, self.sign, self.diameter, self.gone = grey, noise, sign, diameter, gone

    def find(self, image: Image) -> Spots:
        """Return the candidates of a frame, best first."""
        values = np.asarray(image, dtype=np.float32)
        good = np.isfinite(values)
        if not good.any():
            return EMPTY
        if not good.all():
            values = np.where(good, values, np.median(values[good]))
        rows = self._outlines(values, within=False)
        if self.grey is not None:
            rows += self._outlines(values - self.grey, within=True)
        if not rows:
            return EMPTY
        table = np.array(rows)
        table = table[np.argsort(-table[:, 3] * table[:, 8], kind="stable")]
        kept = Spots(*table[_distinct(table[:, 0], table[:, 1], table[:, 2])][:MOST, :8].T)
        return kept if self.grey is None else kept._replace(still=self._shown(kept, values))

    def _shown(self, s: Spots, values: Float32) -> Array:
        """Return 1 for spots that the scene always shows, else 0."""
        out = np.zeros(s.x.size)
        assert self.grey is not None
        for k, (x, y) in enumerate(zip(s.x, s.y)):
            r = max(1, int(0.3 * s.d[k]))
            at = np.s_[max(0, int(y) - r) : int(y) + r + 1, max(0, int(x) - r) : int(x) + r + 1]
            new = self.sign * float(np.median(values[at] - self.grey[at])) / s.contrast[k]
            gone = 0.0 if self.gone is None else -float(np.median(self.gone[at])) / s.contrast[k]
            out[k] = (new < 0.4) and (gone < 0.5)
        return out

    def _outlines(self, values: Float32, *, within: bool) -> list[tuple[float, ...]]:
        """Return rows of `_measure` of a picture; within: of a difference, whose common level is 0."""
        expected = self.diameter or SMALLEST_BALL
        shrink = max(1.0, min(expected / 8.0, math.sqrt(values.size / PIXELS)))
        if shrink >= 2.0:
            size = (int(values.shape[1] / shrink), int(values.shape[0] / shrink))
            sx, sy = values.shape[1] / size[0], values.shape[0] / size[1]
            values = np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA), np.float32)
        else:
            sx = sy = 1.0
        bright: Float32 = np.asarray(cv2.GaussianBlur(self.sign * values, (0, 0), 0.8), np.float32)
        level = 0.0 if within else float(np.median(bright))
        low = LEAST_NOISES * 0.45 * self.noise / math.sqrt(sx * sy)  # 0.45: what the filter leaves
        top = float(bright.max()) - level
        if not top > low:
            return []
        rows = []
        for threshold in np.geomspace(low, 0.8 * top, LEVELS) if within else level + top * np.array([0.3, 0.5, 0.7]):
            binary = (bright > threshold).astype(np.uint8)
            outlines, _ = cv2.findContours(binary, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
            for outline in outlines:
                row = _measure(outline, bright, level, float(threshold), sx, sy, self.diameter)
                if row is not None:
                    rows.append(row)
        return rows


def _distinct(x: Array, y: Array, d: Array) -> list[int]:
    """Return the indices of the spots, best first, that repeat none before."""
    kept: list[int] = []
    for k in range(x.size):
        if all(math.hypot(x[k] - x[m], y[k] - y[m]) > SAME * max(d[k], d[m]) for m in kept):
            kept.append(k)
    return kept


def _measure(
    outline: MatLike, bright: Float32, level: float, threshold: float, sx: float, sy: float, diameter: float | None
) -> tuple[float, ...] | None:
    """Return the values of Spots and a score of an outline's filled moments; None where it has no ball's size."""
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
    if diameter is not None and not 1 / 1.6 < d / diameter < 1.6:
        return None
    if diameter is None and (d < 0.6 * SMALLEST_BALL or d > 0.5 * max(bright.shape) * scale):
        return None
    fill = min(1.0, area / (4.0 * math.pi * math.sqrt(major * minor)))
    if fill < 0.75 or length > 8.0 * d:
        return None
    cx, cy = m["m10"] / area, m["m01"] / area
    half = max(1, int(0.3 * d / scale))
    inner = bright[max(0, int(cy) - half) : int(cy) + half + 1, max(0, int(cx) - half) : int(cx) + half + 1]
    contrast = float(np.median(inner)) - level  # of most of it: a highlight is small
    if contrast <= 0.0:
        return None
    size = 1.0 if diameter is None else min(d / diameter, diameter / d)
    # at half its height an outline has the ball's own size
    middle = math.exp(-0.5 * (math.log((threshold - level) / (0.5 * contrast)) / 1.0) ** 2)
    score = fill**2 * size * middle / (1.0 + 0.5 * length / d)
    angle = 0.5 * math.atan2(2.0 * cxy, cxx - cyy)
    wx, wy = length * math.cos(angle), length * math.sin(angle)
    return (cx + 0.5) * sx - 0.5, (cy + 0.5) * sy - 0.5, d, contrast, wx, wy, fill, 0.0, score


def noise_of(images: Sequence[Image], scene: Float32 | None) -> float:
    """Return the standard deviation of a pixel's grey from frame to frame, where nothing moves."""
    views = [np.asarray(i, np.float32) for i in images[:: 1 + len(images) // 8]]
    steps = [
        np.abs(v - scene)[::4, ::4] if scene is not None else np.abs(np.diff(v[::4])) / math.sqrt(2.0) for v in views
    ]
    step, grey = (np.concatenate([v[np.isfinite(v)] for v in part]) for part in (steps, [v[::4, ::4] for v in views]))
    if not step.size or not grey.size:
        return 1.0
    span = float(np.ptp(np.percentile(grey, (0.1, 99.9))))
    return max(FROM_MAD * float(np.median(step)), 0.006 * span)  # a codec leaves no noise, but steps
