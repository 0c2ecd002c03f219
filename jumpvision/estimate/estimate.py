"""The one shape of a fitted number, the one way a nonlinear fit is solved, the straight line that others rest on."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import Array, not_increasing

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Estimate:
    """A fitted value with its standard uncertainty, all of it; sigma_common: the part shared with other experiments.

    unit: "" for a pure number. n: samples used. chi2: sum of squared residuals over sigma (not divided by the
    degrees of freedom). reason: empty when good, else why value and sigma are NaN.
    """

    value: float
    sigma: float
    unit: str
    n: int
    chi2: float
    reason: str = ""
    sigma_common: float = 0.0

    def with_common(self, common: float) -> Estimate:
        """The same with one more standard uncertainty [unit] that other experiments share, independent of the rest."""
        return replace(self, sigma=math.hypot(self.sigma, common), sigma_common=math.hypot(self.sigma_common, common))

    @property
    def known(self) -> bool:
        """Whether there is a value."""
        return math.isfinite(self.value)

    def entry(self) -> dict[str, float | str | int | None]:
        """The entry of fits.json: value, sigma, sigma_common, unit, n, chi2, and the reason where there is one."""
        return {
            "value": finite(self.value),
            "sigma": finite(self.sigma),
            "sigma_common": finite(self.sigma_common),
            "unit": self.unit,
            "n": int(self.n),
            "chi2": finite(self.chi2),
            **({"reason": self.reason} if self.reason else {}),
        }

    @classmethod
    def of_entry(cls, entry: Mapping[str, float | str | int | None]) -> Estimate:
        """What `entry` made, back again."""
        return cls(**{k: math.nan if v is None else v for k, v in entry.items()})  # type: ignore[arg-type]


def table_of(estimates: Mapping[str, Estimate]) -> pd.DataFrame:
    """One row a name: value, sigma, sigma_common, unit, n, chi2."""
    import pandas as pd

    return pd.DataFrame.from_dict({k: e.entry() for k, e in estimates.items()}, orient="index")


def finite(a: float) -> float | None:
    """The number as a file holds it: None for NaN, as JSON has none."""
    return float(a) if math.isfinite(a) else None


APART = 1e-8  # of the common part: a smaller independent one is lost in the sum of their squares


def independent(sigma: ArrayLike, common: ArrayLike) -> Array:
    """The part of sigma that is not common, in its unit and of their shape: sqrt(sigma^2 - common^2).

    sigma itself, to the last bit, where nothing is common; at least APART of common, which is what doubles can tell.
    """
    s, c = np.asarray(sigma, dtype=float), np.asarray(common, dtype=float)
    rest = np.sqrt(np.maximum((s - c) * (s + c), (APART * c) ** 2))
    return np.where(c > 0.0, rest, s)


TWO_SIDED_95 = 1.959964  # standard deviations


def widened(value: float, low: float, high: float, sigma: float) -> tuple[float, float]:
    """The 95 % interval (low, high) of a value with one more normal error of this standard uncertainty."""
    if not sigma:
        return low, high
    wide = TWO_SIDED_95 * sigma
    return value - math.hypot(value - low, wide), value + math.hypot(high - value, wide)


DIFFERENCES = float(np.sqrt(np.finfo(float).eps))  # relative error of derivatives by differences


def scatter_factor(chi2: float, dof: int) -> float:
    """sqrt(max(1, chi2 / dof)): what every sigma of a fit is multiplied with.

    The stated errors of the data are believed until the scatter contradicts them; sigmas are never shrunk. Where the
    stated errors are right the sigmas are on average larger by about 0.2/sqrt(dof) of their value.
    """
    return math.sqrt(max(1.0, chi2 / dof)) if dof > 0 else 1.0


def least_squares_fit(
    residual: Callable[[Array], Array],
    start: ArrayLike,
    *,
    scale: ArrayLike | float = 1.0,
    jacobian: Callable[[Array], Array] | None = None,
) -> tuple[Array, Array, float] | None:
    """(parameters, covariance, chi2) of the least squares of residual(p) = (y - model)/sigma, or None.

    start: first guess, shape (p,). scale: size of a change of each parameter that matters. jacobian(p): d(residual)/dp,
    shape (n, p); default: by differences,
    and a slower solver. The covariance is inv(J'J)
    for unit-variance residuals, without scatter_factor. None when the solver fails or a parameter is undetermined.
    """
    start = np.asarray(start, dtype=float)
    half = np.broadcast_to(scale, start.shape)

    # q: change from the start, in scales. Solvers step by the size of what they vary and report success at a start of
    # 1e-9; from 0 they step by 1
    def residual_of(q: Array) -> Array:
        return residual(start + half * q)

    def jacobian_of(q: Array) -> Array:
        assert jacobian is not None
        return jacobian(start + half * q) * half

    try:
        found = (
            _solved(residual_of, start.size, jacobian_of)
            if jacobian
            else _solved_by_differences(residual_of, start.size)
        )
    except (ValueError, np.linalg.LinAlgError):  # residuals became non-finite
        return None
    if found is None:
        return None
    q, jac, chi2 = found  # scaled, so that the rank below has a meaning
    if not np.isfinite(jac).all():
        return None
    _, size, axes = np.linalg.svd(jac, full_matrices=False)
    if len(jac) < start.size or size[-1] <= DIFFERENCES * size[0]:
        return None
    root = half[:, None] * axes.T / size  # inv(J'J) = V S^-2 V': J'J itself may be singular to rounding
    return start + half * q, root @ root.T, chi2


CLOSE = 1e-8  # relative change of chi2 or of the parameters, or cosine of residual and slopes: what ends a fit


def _solved(
    residual: Callable[[Array], Array], size: int, jacobian: Callable[[Array], Array]
) -> tuple[Array, Array, float] | None:
    """Return (parameters, jacobian, chi2) from 0 by MINPACK's lmder.

    `scipy.optimize.least_squares` takes three times as long around it as the residuals of a short record.
    """
    start = np.zeros(size)
    if not np.isfinite(residual(start)).all():
        return None
    q, _, info, _, how = scipy.optimize.leastsq(
        residual,
        start,
        Dfun=jacobian,
        full_output=True,
        ftol=CLOSE,
        xtol=CLOSE,
        gtol=CLOSE,
        maxfev=100 * size,  # evaluations of the residual for each parameter, at most
        diag=np.ones(size),
    )
    return (q, jacobian(q), float(info["fvec"] @ info["fvec"])) if how in (1, 2, 3, 4) else None


def _solved_by_differences(residual: Callable[[Array], Array], size: int) -> tuple[Array, Array, float] | None:
    fit = scipy.optimize.least_squares(residual, np.zeros(size), method="trf")
    return (fit.x, fit.jac, 2.0 * float(fit.cost)) if fit.success else None


def checked(name: str, **arrays: ArrayLike) -> list[Array]:
    """The arrays as 1-D floats of one length; ValueError naming the one that is not. name: the caller."""
    out = [np.asarray(a, dtype=float) for a in arrays.values()]
    for key, a in zip(arrays, out):
        if a.ndim != 1 or a.size != out[0].size:
            shapes = ", ".join(f"{k} {b.shape}" for k, b in zip(arrays, out))
            raise ValueError(f"{name}: {key} has shape {a.shape}; all must be 1-D of one length, got {shapes}")
    return out


def checked_times(name: str, t: Array) -> None:
    """ValueError where times do not increase from row to row."""
    if back := not_increasing(t):
        raise ValueError(f"{name}: t must increase from sample to sample: {back}; sort the rows, remove duplicates")


def checked_sigma(name: str, sigma: Array) -> None:
    """ValueError when a sigma is zero or negative: a weight 1/sigma^2 would be infinite."""
    bad = np.flatnonzero(sigma <= 0.0)
    if bad.size:
        raise ValueError(
            f"{name}: sigma[{bad[0]}] = {sigma.flat[bad[0]]:g} must be > 0: the standard uncertainty of each sample"
        )


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
    if line.n < 3 or line.chi2 <= scipy.special.chdtri(line.n - 2, 1.0 - LEVEL):
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
