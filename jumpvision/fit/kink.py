"""A line that bends once, through points with known uncertainties: k_1 or ripples against packing."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from jumpvision.fit.estimate import Estimate, scatter_factor

Array = NDArray[np.float64]
PLACES = 201


def bend_of(x: Array, y: Array, sigma: Array, *, unit: str, flat: bool = False) -> tuple[Estimate, float, float]:
    """(x of the bend, low, high): y straight on both sides (flat: zero before it), low and high a 95 % interval.

    x, y, sigma (n,). Posterior mean and quantiles over the bend's position, the slopes integrated out, sigmas widened
    by the scatter factor. NaN with a reason where a straight line does as well (F-test at 1 %).
    """
    nan = math.nan
    need = 4 if flat else 6
    if np.unique(x).size < need:
        return Estimate(nan, nan, unit, x.size, nan, f"fewer than {need} different values"), nan, nan
    places = np.linspace(np.unique(x)[0 if flat else 1], np.unique(x)[-2], PLACES)
    rest = [] if flat else [np.ones_like(x), x]
    fits = [_fit([*rest, np.maximum(x - p, 0.0)], y, sigma) for p in places]
    chi2 = np.array([f[0] for f in fits])
    straight = float(np.sum((y / sigma) ** 2)) if flat else _fit(rest, y, sigma)[0]
    best, dof = float(chi2.min()), x.size - len(rest) - 2
    gain = (straight - best) / scatter_factor(best, dof) ** 2
    if gain < 14.0:  # two parameters searched over some ten independent places, 1 %
        return Estimate(nan, nan, unit, x.size, best, f"no bend: chi2 gains {gain:.1f} only"), nan, nan
    log = -0.5 * (chi2 - best) / scatter_factor(best, dof) ** 2 + np.array([f[1] for f in fits])
    w = np.exp(log - log.max())
    w /= w.sum()
    mean = float(w @ places)
    spread = math.sqrt(float(w @ (places - mean) ** 2))
    low, high = np.interp([0.025, 0.975], np.cumsum(w) - 0.5 * w, places)
    return Estimate(mean, spread, unit, x.size, best), float(low), float(high)


def _fit(columns: list[Array], y: Array, sigma: Array) -> tuple[float, float]:
    """(chi2, log of the volume of the linear parameters) of a weighted linear fit."""
    a = np.stack(columns, axis=1) / sigma[:, None]
    p, *_ = np.linalg.lstsq(a, y / sigma, rcond=None)
    values = np.linalg.svd(a, compute_uv=False)
    return float(np.sum((y / sigma - a @ p) ** 2)), -float(np.log(values).sum())
