"""Single readings that stand off their neighbours: found without fitting any model, listed and weighted down.

A reading is held against the cubic through two neighbours on either side, (-1, 4, ., 4, -1)/6 (the first ones, at
rest, against the median of the next), of what is left beside a rough prediction; how far it may stand off is learned
from the same track's bulk. A model that errs errs smoothly, and so takes no part in it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

Array = NDArray[np.float64]

BULK = 2.5  # robust sigmas beyond which a reading's weight falls, as Huber (1964) has it
LISTED = 5.0  # from which it is called an outlier
ROUNDS = 12
NEAR = 7  # readings of a running median, which two that stand off do not move
OWN = math.sqrt(1.0 + 34.0 / 36.0)  # white noise of 1 makes deviations of this


def deviation(r: Array) -> Array:
    """r (n,) less the cubic through its four neighbours; the first two less the median of the next five, the last 0."""
    out = np.zeros_like(r)
    if r.size >= 8:
        out[2:-2] = r[2:-2] - (4.0 * (r[1:-3] + r[3:-1]) - r[:-4] - r[4:]) / 6.0
        for k in (0, 1):
            out[k] = r[k] - np.median(r[k + 1 : k + 6])
    return out


def factors(r: Array, least: float) -> tuple[Array, Array]:
    """(factor on the noise of every reading (n,) >= 1, how far it stands off in robust sigmas (n,)).

    r (n,): measured minus roughly predicted, evenly sampled; least: smallest standard deviation of a reading
    (rounding). The readings that stand off most are moved to the edge of the bulk, again and again, so that they are
    not held against their neighbours.
    """
    calm = r.copy()
    sigma = max(float(np.median(np.abs(deviation(r)[2:-2]))) / 0.6745 if r.size > 8 else 0.0, OWN * least)
    if not sigma > 0.0:
        return np.ones_like(r), np.zeros_like(r)
    bulk = max(float(np.median(np.abs(r - median_filter(r, NEAR)))) / 0.6745, least)
    for _ in range(ROUNDS):
        off = deviation(calm)
        # a reading between two that stand off deviates from the cubic, but not from the median about it
        size = np.where(np.abs(calm - median_filter(calm, NEAR)) > BULK * bulk, np.abs(off), 0.0)
        peak = (size > BULK * sigma) & (size >= np.maximum(np.roll(size, 1), np.roll(size, -1)))
        if not peak.any():
            break
        calm[peak] -= off[peak] - np.sign(off[peak]) * BULK * sigma
    moved = np.abs(r - calm) / sigma
    return 1.0 + moved / BULK, np.where(moved > 0.0, moved + BULK, 0.0)
