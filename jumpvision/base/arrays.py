"""Array types, constants and chances of a normal distribution, numbers with the digits of their uncertainty."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]
Image = NDArray[Any]  # (rows, columns) grey, or (rows, columns, 3), at the depth it was recorded with
AnyArray = NDArray[Any]  # of any type: integers, floats, marks

MAD = 0.6745  # median absolute deviation of a normal distribution over its standard deviation
FROM_MAD = 1.4826  # the other way round
Z90, Z95 = 1.645, 1.960  # half widths of 90 % and 95 % intervals of a normal error, in sigmas


def measured(value: float | None, sigma: float | None, factor: float = 1.0) -> str:
    """`12.34 ± 0.05`: two significant figures of the uncertainty; "" when unknown."""
    if value is None or not math.isfinite(value):
        return ""
    if not sigma or not math.isfinite(sigma):
        return plain_number(value, factor)
    return f"{with_digits_of(value, sigma, factor)} ± {with_digits_of(sigma, sigma, factor)}"


def plain_number(value: float | None, factor: float = 1.0) -> str:
    """Four significant figures, a whole number as it is; "" when unknown."""
    if value is None or not math.isfinite(value):
        return ""
    scaled = value * factor
    if scaled and not 1e-3 <= abs(scaled) < 1e5:
        return f"{scaled:.3e}"
    return f"{scaled:#.4g}".rstrip(".") if abs(scaled) < 1e4 else f"{scaled:.0f}"


def with_digits_of(value: float, sigma: float | None, factor: float = 1.0) -> str:
    """A value to the second figure of an uncertainty, to stand beside what has it."""
    if not sigma or not math.isfinite(sigma) or not math.isfinite(value):
        return plain_number(value, factor)
    power = int(f"{sigma * factor:.1e}".partition("e")[2])  # of the rounded sigma: 0.0998 is 0.10
    return f"{round(value * factor, 1 - power) + 0.0:.{max(0, 1 - power)}f}"


def not_increasing(t: Array) -> str:
    """The first row of times t (n,) [s] that is not after the row before it, with both values; "" where all are. NaN
    rows are passed over."""
    rows = np.flatnonzero(np.isfinite(t))
    back = np.flatnonzero(np.diff(t[rows]) <= 0.0)
    if not back.size:
        return ""
    before, at = rows[back[0]], rows[back[0] + 1]
    return f"row {at}, t = {t[at]:.10g} after {t[before]:.10g} in row {before} (the first row is 0)"


def log_interval(low: Array, high: Array) -> Array:
    """ln of the probability of a standard normal between low and high, far into its tails too."""
    from scipy.special import log_ndtr

    flip = low + high > 0  # the tail where the logarithm keeps its digits
    a, b = np.where(flip, -high, low), np.where(flip, -low, high)
    below, above = log_ndtr(a), log_ndtr(b)
    with np.errstate(divide="ignore"):
        return np.asarray(above + np.log(-np.expm1(np.minimum(below - above, -1e-300))))


def log_box(mean: Array, covariance: Array, low: Array, high: Array) -> float:
    """ln of the probability of a box (k,) under a normal distribution: one variable after the other, given those before
    it (Geweke, Hajivassiliou and Keane), over points of a Sobol sequence."""
    from scipy.special import log_ndtr, ndtri_exp
    from scipy.stats.qmc import Sobol

    if mean.size == 0:
        return 0.0
    root = np.linalg.cholesky(covariance)
    a, b = (low - mean) / np.diag(root), (high - mean) / np.diag(root)
    # 2^8 points, where more than one end is integrated over
    points = Sobol(mean.size, seed=0).random_base2(8 if mean.size > 1 else 0)
    drawn, log = np.zeros(points.shape), np.zeros(len(points))
    for k in range(mean.size):
        off = drawn[:, :k] @ root[k, :k] / root[k, k]
        lo, hi = a[k] - off, b[k] - off
        inside = log_interval(lo, hi)
        log += inside
        flip = lo + hi > 0
        start = np.where(flip, -hi, lo)
        share = np.logaddexp(log_ndtr(start), np.log(points[:, k]) + inside)
        drawn[:, k] = np.where(flip, -1.0, 1.0) * ndtri_exp(np.minimum(share, -1e-300))
    return float(np.logaddexp.reduce(log) - math.log(len(log)))
