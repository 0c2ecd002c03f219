"""Critical packing phi_c: where the volume change of a crater crosses zero over a set of beds (thesis Fig 46)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq, minimize_scalar

from jumpvision.fit.estimate import TWO_SIDED_95, checked, checked_sigma, scatter_factor, widened


@dataclass(frozen=True)
class ZeroCrossing:
    """phi_c with its standard uncertainty (half the 68.3 % interval) and 95 % interval; slope dV/dphi [m^3].

    An end of an interval is infinite where the data do not bound phi_c on that side. reason: why value is NaN.
    """

    value: float
    sigma: float
    low95: float
    high95: float
    slope: float
    n: int
    chi2: float
    reason: str = ""
    sigma_common: float = 0.0  # the part of sigma that all points share

    def with_common(self, common: float) -> ZeroCrossing:
        """The same with one more standard uncertainty, which all points share; the interval widened on both sides."""
        if not common:
            return self
        low, high = widened(self.value, self.low95, self.high95, common)
        return replace(
            self, sigma=math.hypot(self.sigma, common), sigma_common=math.hypot(self.sigma_common, common),
            low95=low, high95=high,
        )  # fmt: skip


def critical_fraction(phi: ArrayLike, phi_sigma: ArrayLike, volume: ArrayLike, volume_sigma: ArrayLike) -> ZeroCrossing:
    """Zero of the line V = b (phi - phi_c) with errors in both phi and V [m^3]; shape (n,), NaN points left out.

    phi_c minimises chi2 = sum (V - b (phi - phi_c))^2 / (sigma_V^2 + b^2 sigma_phi^2), least over b for each phi_c; the
    interval is where chi2 stays within 1 (1.96^2 for 95 %) of its least value (likelihood profile, after Fieller), so
    it is not symmetric where the slope is uncertain. Where the points scatter more than stated, the stated errors are
    multiplied by the scatter factor. The slope b by York et al. 2004, Am. J. Phys. 72, 367.
    """
    phi, dphi, v, dv = checked(
        "critical_fraction", phi=phi, phi_sigma=phi_sigma, volume=volume, volume_sigma=volume_sigma
    )
    use = np.isfinite(phi) & np.isfinite(dphi) & np.isfinite(v) & np.isfinite(dv)
    phi, dphi, v, dv = phi[use], dphi[use], v[use], dv[use]
    checked_sigma("critical_fraction", dv)
    n = phi.size
    nan = math.nan
    if n < 3 or np.ptp(phi) == 0.0:
        return ZeroCrossing(nan, nan, nan, nan, nan, n, nan, "fewer than three craters at different volume fractions")
    if not (v.min() < 0.0 < v.max()):
        side = "compacted" if v.max() <= 0.0 else "dilated"
        return ZeroCrossing(nan, nan, nan, nan, nan, n, nan, f"every bed {side}: the volume change crosses no zero")
    span = float(np.ptp(phi))

    def profile(zero: float) -> tuple[float, float]:
        """(least chi2, b) of the line through (zero, 0): York's iteration for errors in both."""
        d = phi - zero
        b = float(np.sum(v * d / dv**2) / np.sum(d * d / dv**2))
        for _ in range(50):
            w = 1.0 / (dv**2 + (b * dphi) ** 2)
            lever = w * w * (d * dv**2 + b * v * dphi**2)
            b, before = float(np.sum(lever * v) / np.sum(lever * d)), b
            if abs(b - before) <= 1e-10 * abs(b):
                break
        return float(np.sum((v - b * d) ** 2 / (dv**2 + (b * dphi) ** 2))), b

    tries = np.linspace(phi.min() - 0.5 * span, phi.max() + 0.5 * span, 61)
    k = int(np.argmin([profile(z)[0] for z in tries]))
    found = minimize_scalar(
        lambda z: profile(z)[0], bounds=(tries[max(k - 1, 0)], tries[min(k + 1, 60)]), method="bounded",
        options={"xatol": 1e-7 * span},
    )  # fmt: skip
    value, least = float(found.x), float(found.fun)
    scatter = scatter_factor(least, n - 2) ** 2

    def end(widths: float, way: int) -> float:
        def over(step: float) -> float:
            return profile(value + way * step)[0] - least - scatter * widths**2

        inner, outer = 0.0, 0.02 * span
        while over(outer) < 0.0:
            inner, outer = outer, 1.7 * outer
            if outer > 20.0 * span:
                return way * math.inf
        return value + way * float(brentq(over, inner, outer, xtol=1e-5 * span))

    sigma = 0.5 * (end(1.0, 1) - end(1.0, -1))
    return ZeroCrossing(value, sigma, end(TWO_SIDED_95, -1), end(TWO_SIDED_95, 1), profile(value)[1], n, least)
