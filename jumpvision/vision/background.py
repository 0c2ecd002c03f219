"""The scene behind the ball, seen while the ball is elsewhere, and films in which it no longer shows.

At the ball's edge a pixel is I = B (1 - share) + A share, with B the scene behind and A the ball's grey. A textured B
pulls every position towards its own pattern, the same in all frames, which no frame-to-frame scatter can tell. With B
known, the share itself is (I - B)/(A - B).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CLEAR = 4.0  # px between the ball's edge and a pixel that counts as scene
LEAST = 20  # views of a pixel before its mean is used: its noise is then below 5 % of a single frame's, in variance
FAINT = 0.3  # of the typical contrast: where the scene is as bright as the ball, the share cannot be had


@dataclass(frozen=True)
class Background:
    """scene: (row, column) [grey], NaN where never seen; level: its median; ball: grey of the ball inside its edge."""

    scene: Array
    level: float
    ball: float

    def removed(self, image: NDArray[Any]) -> Array:
        """The image with the even scene `level` behind the ball; unchanged where the scene is not known."""
        contrast = self.ball - self.scene
        usable = np.isfinite(contrast) & (contrast / (self.ball - self.level) > FAINT)
        with np.errstate(invalid="ignore", divide="ignore"):
            share = (image - self.scene) / contrast
        return np.where(usable, self.level + share * (self.ball - self.level), image)


def static_background(views: Iterable[tuple[NDArray[Any], float, float, float]]) -> Background | None:
    """The scene from views (image (row, column), x, y, diameter [px]) of a film whose camera and light stand still.

    None where too little of it is ever seen to be of use.
    """
    total = count = None
    greys = []
    for image, x, y, diameter in views:
        rows, columns = np.ogrid[: image.shape[0], : image.shape[1]]
        r = np.hypot(columns - x, rows - y)
        if total is None or count is None:
            total, count = np.zeros(image.shape), np.zeros(image.shape, dtype=np.int64)
        free = r > 0.5 * diameter + CLEAR
        total[free] += image[free]
        count[free] += 1
        inside = image[(r < 0.42 * diameter) & (r > 0.3 * diameter)]
        if inside.size:
            greys.append(float(np.median(inside)))
    if total is None or count is None or not greys or not (count >= LEAST).any():
        return None
    with np.errstate(invalid="ignore"):
        scene = np.where(count >= LEAST, total / np.maximum(count, 1), np.nan)
    level, ball = float(np.nanmedian(scene)), float(np.median(greys))
    return Background(scene, level, ball) if ball != level else None
