"""The light of a film before it is matched: its background taken away, its contrast made alike everywhere."""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Image
from jumpvision.base.schema import StageWarning
from jumpvision.films.frames.base import Frames
from jumpvision.films.parameters import PivParams


class Light(NamedTuple):
    """What is done to frame i. common: (H, W) subtracted, of either exposure; tile: of CLAHE [px], 0: none."""

    common: tuple[NDArray[np.float32], ...]
    tile: int

    def __call__(self, image: Image, i: int) -> Image:
        if self.common:
            image = image.astype(np.float32) - self.common[i % len(self.common)]
        return equalised(image, self.tile) if self.tile else image


def light_of(frames: Frames, stride: int, p: PivParams) -> Light:
    """What [params.piv] asks for; a background of double exposures (stride 2) is that of A and of B."""
    wanted = p.background != "none"
    return Light(tuple(common(frames, p.background, k, stride) for k in range(stride)) if wanted else (), p.clahe)


SPARSE = 1.5  # times further from one extreme than from the other the mean lies, where particles leave the ground free
FEW = 32  # frames; of fewer each leaves so much of its particles in the mean that vectors suffer


def common(frames: Frames, how: str, first: int, stride: int) -> NDArray[np.float32]:
    """Minimum or mean (H, W) of 64 frames or fewer, evenly from `first` on, `stride` apart.

    Of sparse particles the mean of FEW frames is their median. Of dark ones on a bright ground the minimum is the
    maximum, which is told.
    """
    every = np.arange(first, len(frames), stride)
    if every.size < 3:
        raise ValueError(f'[params.piv] background = "{how}": needs 3 frames or pairs, found {every.size}; take "none"')
    shown = every[np.unique(np.linspace(0, every.size - 1, min(every.size, 64)).round().astype(int))]
    total = frames[int(shown[0])].astype(np.float32)
    low, high = total.copy(), total.copy()
    for i in shown[1:]:
        frame = frames[int(i)]
        low, high, total = np.minimum(low, frame), np.maximum(high, frame), total + frame
    mean = np.asarray(total / np.float32(shown.size), np.float32)
    below, above = float(np.nanmean(mean - low)), float(np.nanmean(high - mean))
    if how == "mean":
        if shown.size < FEW and max(below, above) > SPARSE * min(below, above):
            return np.asarray(np.median([frames[int(i)] for i in shown], axis=0), np.float32)
        return mean
    if below <= SPARSE * above:
        return np.asarray(low, np.float32)
    said = 'background = "minimum": the particles are darker than the ground, so what is subtracted is the maximum'
    warnings.warn(StageWarning("light", said), stacklevel=2)
    return np.asarray(high, np.float32)


def equalised(image: Image, tile: int) -> NDArray[np.float32]:
    """A frame (H, W) by contrast-limited adaptive histogram equalisation in tiles of that side [px]; 0 to 255."""
    import cv2

    grey = image.astype(np.float32)
    low, high = float(np.nanmin(grey)), float(np.nanmax(grey))
    whole = np.nan_to_num((grey - low) * (65535.0 / max(high - low, 1e-6))).astype(np.uint16)
    rows, columns = (max(1, round(n / tile)) for n in image.shape)
    # cut at three times the mean of a tile's histogram
    even = cv2.createCLAHE(clipLimit=3.0, tileGridSize=(columns, rows)).apply(whole)
    return np.asarray(np.where(np.isfinite(grey), even * np.float32(255.0 / 65535.0), np.nan), np.float32)
