"""The noise of readings from stretches whose course is known but for a few coefficients, whoever says which they are.

A system brings the stretches (rest, flight, repeats; windows over which a motion is smooth) and what it was told of the
level besides; size, correlation, tails and wander are learned here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from jumpvision.base.arrays import Array

from . import readings
from .noise import Noise, Stretch, estimate


def learn_level(used: Sequence[Stretch], frame: float, least: float) -> Noise:
    """Size, correlation and tails of the noise of these stretches, each sample of which counts once.

    frame [s]: between two samples. least: what rounding makes [unit of y]. Raises ValueError where they are too few.
    """
    noise = estimate(used, frame, floor=max(least, np.finfo(float).tiny))
    return replace(noise, kurtosis=readings.kurtosis(used, noise))


def with_wander(
    noise: Noise, drifting: Sequence[Stretch], reach: float, *, doubt: float = 0.0, unseen: float = 0.0
) -> Noise:
    """The noise with the slow wander that the stretches show of which only the level is unknown.

    reach [s]: how long a wander remembers. doubt: standard uncertainty of the mean power for tracks that differ.
    unseen: rms of the wander where nothing shows it [unit of y].
    """
    power = math.sqrt((noise.kurtosis - 1.0) / max(noise.n, 1))
    drift = readings.learn(drifting, noise, reach) if drifting else unseen
    return replace(noise, log_power=math.hypot(power, doubt), drift=drift, reach=reach)


def differences(trials: Sequence[tuple[Array, Array]]) -> Iterator[tuple[Array, Array]]:
    """The k - 1 independent differences of k trials of one motion, each with the noise of one trial: (y, spread) (n,).

    trials: of each the readings (n,), NaN where it has none, and the factor (n,) on the noise of each.
    """
    for k in range(1, len(trials)):
        typical = math.sqrt(1.0 + 1.0 / k)
        before, noisy = [np.stack(x) for x in zip(*trials[:k])]
        spread = np.sqrt(trials[k][1] ** 2 + np.sum(np.square(noisy), axis=0) / k**2)
        yield (trials[k][0] - np.mean(before, axis=0)) / typical, spread / typical
