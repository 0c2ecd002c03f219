"""Chances of intervals and boxes under normal distributions, as logarithms that keep their digits far out."""

from __future__ import annotations

import math

import numpy as np
import scipy

from jumpvision.base.arrays import Array

SOBOL = 8  # log2 of the points by which more than one end is integrated over


def log_interval(low: Array, high: Array) -> Array:
    """ln of the probability of a standard normal between low and high, far into its tails too."""
    flip = low + high > 0  # the tail where the logarithm keeps its digits
    a, b = np.where(flip, -high, low), np.where(flip, -low, high)
    below, above = scipy.special.log_ndtr(a), scipy.special.log_ndtr(b)
    with np.errstate(divide="ignore"):
        return np.asarray(above + np.log(-np.expm1(np.minimum(below - above, -1e-300))))


def log_box(mean: Array, covariance: Array, low: Array, high: Array) -> float:
    """ln of the probability of a box (k,) under a normal distribution: one variable after the other, given those before
    it (Geweke, Hajivassiliou and Keane), over points of a Sobol sequence."""
    if mean.size == 0:
        return 0.0
    root = np.linalg.cholesky(covariance)
    a, b = (low - mean) / np.diag(root), (high - mean) / np.diag(root)
    points = scipy.stats.qmc.Sobol(mean.size, seed=0).random_base2(SOBOL if mean.size > 1 else 0)
    drawn, log = np.zeros(points.shape), np.zeros(len(points))
    for k in range(mean.size):
        off = drawn[:, :k] @ root[k, :k] / root[k, k]
        lo, hi = a[k] - off, b[k] - off
        inside = log_interval(lo, hi)
        log += inside
        flip = lo + hi > 0
        start = np.where(flip, -hi, lo)
        share = np.logaddexp(scipy.special.log_ndtr(start), np.log(points[:, k]) + inside)
        drawn[:, k] = np.where(flip, -1.0, 1.0) * scipy.special.ndtri_exp(np.minimum(share, -1e-300))
    return float(np.logaddexp.reduce(log) - math.log(len(log)))
