"""Straight lines, once bent or not, through points with known uncertainties: the fit that most other fits rest on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtri

from jumpvision.base.arrays import Array

from .estimate import Estimate, checked, checked_sigma, scatter_factor


@dataclass(frozen=True)
class Line:
    """y = intercept + slope x, with standard uncertainties and their covariance; NaN with a reason when undetermined.

    Sigmas and covariance are multiplied by the scatter factor sqrt(max(1, chi2/(n - 2))) (squared for the covariance).
    used: which input points entered, shape of the input.
    """

    slope: float
    slope_sigma: float
    intercept: float
    intercept_sigma: float
    covariance: float
    chi2: float
    n: int
    used: NDArray[np.bool_]
    reason: str = ""

    def at(self, x: ArrayLike) -> tuple[Array, Array]:
        """(y, sigma) of the line at x."""
        x = np.asarray(x, dtype=float)
        var = self.intercept_sigma**2 + 2.0 * x * self.covariance + (x * self.slope_sigma) ** 2
        return self.intercept + self.slope * x, np.sqrt(var)

    def slope_estimate(self, unit: str) -> Estimate:
        return Estimate(self.slope, self.slope_sigma, unit, self.n, self.chi2, self.reason)


def fit_line(x: ArrayLike, y: ArrayLike, sigma: ArrayLike) -> Line:
    """The straight line with the least sum ((y - line)/sigma)^2 ; x exact, points with a NaN left out.

    x, y, sigma: shape (n,); sigma > 0 [unit of y], independent from point to point.
    ValueError when shapes differ or a sigma is not positive.
    """
    x, y, sigma = checked("fit_line", x=x, y=y, sigma=sigma)
    checked_sigma("fit_line", sigma)
    used = np.isfinite(x) & np.isfinite(y) & np.isfinite(sigma)
    n = int(used.sum())
    if n < 2 or np.ptp(x[used]) == 0.0:
        nan = float("nan")
        return Line(nan, nan, nan, nan, nan, nan, n, used, "fewer than two points with different x")
    w = sigma[used] ** -2
    mean = float(np.average(x[used], weights=w))
    d = x[used] - mean
    sxx = float(np.sum(w * d * d))
    slope = float(np.sum(w * d * y[used])) / sxx
    middle = float(np.average(y[used], weights=w))
    chi2 = float(np.sum(w * (y[used] - middle - slope * d) ** 2))
    f2 = scatter_factor(chi2, n - 2) ** 2
    var_slope, var_middle = f2 / sxx, f2 / float(w.sum())
    return Line(
        slope,
        var_slope**0.5,
        middle - slope * mean,
        (var_middle + mean**2 * var_slope) ** 0.5,
        -mean * var_slope,
        chi2,
        n,
        used,
    )


LEVEL = 0.999  # of chi2's distribution: beyond it the stated sigmas do not describe the scatter


def line_or_alike(x: Array, y: Array, sigma: Array) -> Line:
    """`fit_line`; (n,) each. Where chi2 is beyond LEVEL, all points have one sigma, their scatter about it."""
    line = fit_line(x, y, sigma)
    if line.n < 3 or line.chi2 <= chdtri(line.n - 2, 1.0 - LEVEL):
        return line
    equal = fit_line(x, np.where(line.used, y, math.nan), np.ones(x.size))
    return fit_line(x, np.where(line.used, y, math.nan), np.full(x.size, math.sqrt(equal.chi2 / (line.n - 2))))


def radius_exponent(radius: Array, value: Array, sigma: Array, bed: Array) -> Estimate:
    """n of value = c(bed) radius^n; radius [m], value and its sigma > 0 in one unit, bed (its packing), shape (n,).

    Force proportional to the foot's area is n = 2. sigma holds the scatter factor: trials differ by more than each
    log's own noise. NaN with a reason where no bed was met by two radii.
    """
    beds, which = np.unique(np.round(bed, 4), return_inverse=True)
    weight = (value / sigma) ** 2
    x, y = np.log(radius), np.log(value)
    total = np.bincount(which, weights=weight)
    x, y = (a - (np.bincount(which, weights=weight * a) / total)[which] for a in (x, y))
    spread = float(np.sum(weight * x * x))
    dof = value.size - beds.size - 1
    if dof < 1 or spread <= 0.0 or np.abs(x).max() < 1e-6:
        return Estimate(np.nan, np.nan, "", value.size, np.nan, "needs feet of different radii, three logs in one bed")
    n = float(np.sum(weight * x * y)) / spread
    chi2 = float(np.sum(weight * (y - n * x) ** 2))
    return Estimate(n, scatter_factor(chi2, dof) / spread**0.5, "", value.size, chi2)


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
