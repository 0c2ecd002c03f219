"""What the exposure does to a track: each position is the mean over the exposure T, not the one at its middle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FARTHEST = 1.5  # median frame intervals: an acceleration over wider gaps is not taken


def exposure_shift(time: Array, height: Array, exposure: float) -> Array:
    """By how much the mean over the exposure lies above the height at its middle [unit of height], (n,).

    To first order a T^2/24, with the acceleration a from the second difference of neighbours (steps may differ); for
    an oscillation of frequency f it is what the factor sinc(f T) takes from the amplitude. NaN where a neighbour is
    missing. time: (n,) [s], increasing; height: (n,), NaN = no data; exposure: T [s].
    """
    out = np.full(len(height), np.nan)
    if len(height) < 3:
        return out
    step = np.diff(time)
    speed = np.diff(height) / step
    acceleration = 2.0 * np.diff(speed) / (step[:-1] + step[1:])
    far = np.maximum(step[:-1], step[1:]) > FARTHEST * np.median(step)
    out[1:-1] = np.where(far, np.nan, acceleration * exposure**2 / 24.0)
    return out


def shift_sigma(sigma: Array, time: Array, exposure: float) -> Array:
    """Standard uncertainty of height - exposure_shift from that of the heights, (n,), independent between frames."""
    part = (exposure / float(np.median(np.diff(time)))) ** 2 / 24.0  # of the second difference
    return np.asarray(sigma * np.sqrt((1.0 + 2.0 * part) ** 2 + 2.0 * part**2))
