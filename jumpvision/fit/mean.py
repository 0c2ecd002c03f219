"""Means with their uncertainty, and the noise of a smooth series."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.fit.estimate import Estimate, checked, scatter_factor


def weighted_mean(values: ArrayLike, sigma: ArrayLike, unit: str) -> Estimate:
    """Inverse-variance mean of values (n,) with standard uncertainties sigma (n,), both in `unit`; NaN is left out.

    Sigma holds the scatter factor: it is widened where the values scatter more than stated. NaN with a reason without
    a single value.
    """
    values, sigma = checked("weighted_mean", values=values, sigma=sigma)
    use = np.isfinite(values) & (sigma > 0.0)
    n = int(use.sum())
    if n == 0:
        return Estimate(math.nan, math.nan, unit, 0, math.nan, "no value")
    w = sigma[use] ** -2.0
    mean = float(np.average(values[use], weights=w))
    chi2 = float(np.sum(w * (values[use] - mean) ** 2))
    return Estimate(mean, scatter_factor(chi2, n - 1) * float(w.sum()) ** -0.5, unit, n, chi2)


def plain_mean(values: ArrayLike, unit: str) -> Estimate:
    """Mean of values (n,) in `unit` at equal weights, sigma from their scatter; NaN is left out, below two NaN."""
    (values,) = checked("plain_mean", values=values)
    values = values[np.isfinite(values)]
    n = values.size
    if n < 2:
        return Estimate(math.nan, math.nan, unit, n, math.nan, "fewer than two values")
    return Estimate(float(values.mean()), float(values.std(ddof=1)) / math.sqrt(n), unit, n, n - 1.0)


def near_the_median(values: ArrayLike, sigma: ArrayLike, *, reject: float) -> NDArray[np.bool_]:
    """Values (n,) within `reject` robust sigmas of their median; a value's robust sigma is its own times
    max(1, 1.4826 median |deviation/sigma|), so that understated errors turn no ordinary value into a stray one. NaN is
    not near."""
    values, sigma = checked("near_the_median", values=values, sigma=sigma)
    use = np.isfinite(values) & (sigma > 0.0)
    if not use.any():
        return use
    off = np.abs(values - np.median(values[use])) / np.where(use, sigma, np.nan)
    near: NDArray[np.bool_] = off <= reject * max(1.0, 1.4826 * float(np.median(off[use])))
    return near


def difference_noise(series: NDArray[np.float64]) -> float:
    """White noise (standard deviation) of a smooth, evenly sampled series (n,) by third differences; 0 for n < 8.

    Third differences of white noise have 20 times its variance; their median absolute value is not moved by the few
    samples in which the series itself bends.
    """
    if series.size < 8:
        return 0.0
    return float(np.median(np.abs(np.diff(series, 3)))) / 0.6745 / math.sqrt(20.0)
