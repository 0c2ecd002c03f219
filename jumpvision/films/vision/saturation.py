"""Where a picture's light is clipped: at the top of its numbers, or where its values pile up below it.

A camera of 12 bits in numbers of 16 clips at 4095, video at 235. Values of light that is not clipped thin out towards
the brightest; clipped ones all stand at the greatest.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

PILED = 10.0  # times as many pixels at the greatest value as at each of the brightest others, in the mean
BRIGHTEST = 0.1  # of the range of values, that the greatest is held against
FEWEST = 32  # pixels at the greatest value
GREYS = 48  # values in all: a drawn picture of fewer has no noise, so its lit ground piles up without being clipped


def saturation_of(picture: NDArray[Any], stated: float | None = None) -> float | None:
    """Grey value at and above which a picture (H, W) is clipped: the stated one, else what it shows; None: it has none.

    Of whole numbers without a pile below their top it is the top, as a picture without a clipped pixel does not matter.
    """
    if stated or picture.dtype.kind != "u":
        return stated
    top = float(np.iinfo(picture.dtype).max)
    values, counts = np.unique(picture, return_counts=True)
    if values[-1] == top or counts[-1] < FEWEST or values.size < GREYS:
        return top
    step = float(np.min(np.diff(values)))  # 12 bits may be kept times 16
    bright = BRIGHTEST * (float(values[-1]) - float(values[0]))
    others = counts[:-1][values[:-1] > values[-1] - bright].sum() / max(bright / step, 1.0)
    return float(values[-1]) if counts[-1] > PILED * others else top
