"""The ball in a whole film: followed once, the scene behind it learned, and followed again without the scene."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from jumpvision.progress import watch
from jumpvision.vision.background import LEAST, static_background
from jumpvision.vision.ball import BallTrack

VIEWS = 300  # frames that the scene behind the ball is taken from


class Frames(Protocol):
    """What is read of a film: its length, and a frame (row, column) of grey levels by its number."""

    def __len__(self) -> int: ...
    def __getitem__(self, i: int, /) -> NDArray[Any]: ...


def track_film(frames: Frames, track: Callable[[Iterable[NDArray[Any]]], BallTrack], *, scene: bool) -> BallTrack:
    """`track` over the frames; with `scene` a second time over frames without the still scene behind the ball.

    The second result is taken where it loses no more frames and is no less certain in the median; a film whose scene
    moves, or hides behind a ball that never moves, keeps the first.
    """
    whole = range(len(frames))
    found = track(watch((frames[i] for i in whole), "frames tracked", len(frames)))
    good = np.flatnonzero(found.flag == "")
    if not scene or good.size < LEAST:
        return found
    sample = good[:: max(1, good.size // VIEWS)]
    behind = static_background((frames[i], found.x[i], found.y[i], found.diameter[i]) for i in sample.tolist())
    if behind is None:
        return found
    clean = (behind.removed(frames[i]) for i in whole)
    again = track(watch(clean, "frames tracked without the scene", len(frames)))
    lost = np.count_nonzero(again.flag != "") > np.count_nonzero(found.flag != "")
    return found if lost or np.nanmedian(again.sigma) > np.nanmedian(found.sigma) else again
