"""Correlation of the errors of neighbouring PIV vectors, whose interrogation windows overlap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d

Array = NDArray[np.float64]


def overlap(distance: Array | float, correlation_length: float) -> Array:
    """Share of two windows that overlaps, (1 - d/L)+ along one axis: the correlation of their errors.

    distance: in grid steps. correlation_length: L = window width / grid step; 1 or less means independent vectors
    (75 % overlap: 4). In two dimensions the shares of both axes multiply.
    """
    if not correlation_length >= 0.0:
        raise ValueError(f"correlation_length = {correlation_length!r} must be >= 0 (window width / grid step)")
    length = max(1.0, correlation_length)
    return np.asarray(np.maximum(0.0, 1.0 - np.abs(distance) / length))


def correlated_variance(a: Array, correlation_length: float) -> float:
    """sum_kl a_k a_l rho_kl, a of shape (ny, nx): the variance of a sum whose k-th term has the signed sigma a_k."""
    reach = int(np.ceil(max(1.0, correlation_length))) - 1
    kernel = overlap(np.arange(-reach, reach + 1, dtype=float), correlation_length)
    spread = convolve1d(convolve1d(a, kernel, axis=0, mode="constant"), kernel, axis=1, mode="constant")
    return float(np.sum(a * spread))
