"""Uncertainty of a weighted sum of neighbouring values whose noise is shared with their neighbours."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SETTLED = 1.5  # noise widths of a change of the integral that count as none
GROWTH = 1.15  # the step in which the radius of an integral is enlarged


def sum_sigma(weights: Array, residual: Array) -> float:
    """Standard uncertainty of sum(weights * values) on a regular grid of one or two dimensions.

    weights: shape of the grid. residual: same shape, what is left of the values where their truth is known (undisturbed
    ground less its plane), NaN elsewhere. The covariance is read from the residuals as a function of distance alone, up
    to its first zero, and taken to hold on the whole grid: var = sum_ij w_i w_j C(|i - j|).
    """
    known = np.isfinite(residual)
    shape = [2 * n for n in residual.shape]
    axes = tuple(range(residual.ndim))
    value = np.where(known, residual - np.mean(residual[known]), 0.0)

    def correlate(a: Array) -> Array:
        return np.fft.irfftn(np.abs(np.fft.rfftn(a, shape, axes)) ** 2, shape, axes)

    pairs, product = correlate(known.astype(float)), correlate(value)
    lag = np.sqrt(sum(np.minimum(k, n - k) ** 2.0 for k, n in zip(np.indices(shape), shape)))
    ring = np.rint(lag).astype(int)
    count = np.bincount(ring.ravel(), pairs.ravel())
    covariance = np.bincount(ring.ravel(), product.ravel()) / np.maximum(count, 0.5)
    # far lags have few pairs and hold what the plane took out: they end at the first zero
    far = min(int(np.argmax(np.r_[covariance, -1.0] <= 0.0)), max(residual.shape) // 3)
    covariance[far:] = 0.0
    return math.sqrt(max(float(np.sum(correlate(weights) * covariance[ring])), 0.0))


def settled_radius(
    values: Array, weights: Callable[[float], Array], residual: Callable[[float], Array], radius: float, limit: float
) -> tuple[float, float]:
    """(radius, cut): the smallest from `radius` up beyond which sum(weights(radius) * values) changes within its noise.

    The faint tail of a crater's rim is not seen in single values, but it is in the integral. residual(radius): what is
    left of the values outside, NaN inside. Stops below `limit`. cut: the noise of the next change, which is how much of
    a tail may have been missed.
    """
    while True:
        if not GROWTH * radius < limit:
            return radius, 0.0
        more = weights(GROWTH * radius) - weights(radius)
        cut = sum_sigma(more, residual(GROWTH * radius))
        if abs(float(np.sum(more * values))) < SETTLED * cut:
            return radius, cut
        radius *= GROWTH
