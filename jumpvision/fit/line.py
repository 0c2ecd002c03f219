"""Weighted straight line: x exact, y with standard uncertainties."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.fit.estimate import Estimate, checked, checked_sigma, scatter_factor

Array = NDArray[np.float64]


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
