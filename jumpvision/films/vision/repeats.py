"""Frames that are the picture before them again: a film converted to a higher rate, or a camera that skipped."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array, Image
from jumpvision.estimate.readings import held
from jumpvision.films.frames.base import Frames

from .ball.track import BallTrack

NOISY = 0.2  # share of the pixels that differ from frame to frame, from which equal pictures are no still scene
FLAG = "the picture before again"


class Repeats:
    """Watch the frames of a film, handed over in order, and note those equal to the one before."""

    def __init__(self) -> None:
        self._last: Image | None = None
        self._same: list[bool] = []
        self._changed: list[float] = []

    def see(self, image: Image) -> None:
        """Take the next frame (H, W)."""
        last, self._last = self._last, image
        if last is None:
            self._same.append(False)
            return
        changed = float(np.mean(last[::4, ::4] != image[::4, ::4]))
        self._same.append(changed == 0.0 and np.array_equal(last, image, equal_nan=image.dtype.kind == "f"))
        if not self._same[-1]:
            self._changed.append(changed)

    @property
    def nothing_new(self) -> NDArray[np.bool_] | None:
        """Return the pixels (H, W) of the last frame that hold something new: none where it repeats; None where all."""
        if self._last is None or not self._same[-1] or not self.is_noisy:
            return None
        return np.zeros(self._last.shape, bool)

    @property
    def is_noisy(self) -> bool:
        """Return True if the film's noise lets no two pictures be equal."""
        return len(self._changed) > 0 and float(np.median(self._changed)) > NOISY

    @property
    def same(self) -> NDArray[np.bool_]:
        """Return the frames equal to the one before, in a film whose noise lets no two pictures be equal."""
        return np.array(self._same, bool) & self.is_noisy

    def of_moving(self, *places: Array) -> NDArray[np.bool_]:
        """Return frames equal to the one before, else those between which a place (n,) [px] leaps."""
        equal, found = np.array(self._same, bool), self.same
        for place in places if equal.any() and not found.any() else ():
            known = np.flatnonzero(np.isfinite(place))
            first = np.maximum.accumulate(np.where(equal, 0, np.arange(equal.size)))  # of each stretch of one picture
            found[known] |= held(place[first][known], 0.0, None)[0] & equal[known] if known.size else False
        return found

    def watch(self, frames: Iterable[Image]) -> Iterator[Image]:
        """Give the frames on, seen."""
        for image in frames:
            self.see(image)
            yield image


class Seen:
    """Frames whose repeats are noted while they are read for the first time."""

    def __init__(self, frames: Frames, repeats: Repeats) -> None:
        self._frames, self._repeats, self._read = frames, repeats, 0

    def __len__(self) -> int:
        return len(self._frames)

    def __getitem__(self, i: int) -> Image:
        image = self._frames[i]
        if i == self._read:
            self._read += 1
            self._repeats.see(image)
        return image


def without_repeats(tracks: list[BallTrack], repeats: Repeats) -> tuple[list[BallTrack], str]:
    """Return the tracks with the repeated frames flagged, and what to tell of them."""
    good = [np.where(b.flag == "", (b.x, b.y), np.nan) for b in tracks]
    same = repeats.of_moving(*(place for both in good for place in both))
    flagged = [replace(b, flag=np.where(same & (b.flag == ""), FLAG, b.flag).astype(object)) for b in tracks]
    return (flagged if same.any() else tracks), repeats_told(same, "left out; is the frame rate that of the camera?")


def repeats_told(same: NDArray[np.bool_], what: str) -> str:
    """Return a warning for the frames that are `same`, "" for none; what: was done with them."""
    n, first = int(same.sum()), int(np.argmax(same))
    every = f", one in {same.size / n:.3g}" if n > 1 else ""
    return f"{n} of {same.size} frames are the picture before again{every}, first {first}: {what}" if n else ""
