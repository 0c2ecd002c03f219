"""The one shape of a fitted number, and the one way a nonlinear fit is solved."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from jumpvision.base.arrays import Array


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

    def entry(self) -> dict[str, float | str | int | None]:
        """The entry of fits.json: value, sigma, sigma_common, unit, n, chi2; a NaN becomes None, as JSON has no NaN."""

        def finite(a: float) -> float | None:
            return float(a) if math.isfinite(a) else None

        return {
            "value": finite(self.value),
            "sigma": finite(self.sigma),
            "sigma_common": finite(self.sigma_common),
            "unit": self.unit,
            "n": int(self.n),
            "chi2": finite(self.chi2),
        }


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
    try:
        fit = least_squares(
            residual,
            start,
            jacobian or "2-point",
            method="lm" if jacobian else "trf",
            x_scale=np.broadcast_to(scale, start.shape),
        )
    except (ValueError, np.linalg.LinAlgError):  # residuals became non-finite
        return None
    half = np.broadcast_to(scale, start.shape)
    jac = fit.jac * half  # scaled, so that the rank below has a meaning
    if not fit.success or not np.isfinite(jac).all():
        return None
    _, size, axes = np.linalg.svd(jac, full_matrices=False)
    if len(jac) < start.size or size[-1] <= DIFFERENCES * size[0]:
        return None
    root = half[:, None] * axes.T / size  # inv(J'J) = V S^-2 V': J'J itself may be singular to rounding
    cov = root @ root.T
    return fit.x, cov, float(2.0 * fit.cost)


def checked(name: str, **arrays: ArrayLike) -> list[Array]:
    """The arrays as 1-D floats of one length; ValueError naming the one that is not. name: the caller."""
    out = [np.asarray(a, dtype=float) for a in arrays.values()]
    for key, a in zip(arrays, out):
        if a.ndim != 1 or a.size != out[0].size:
            shapes = ", ".join(f"{k} {b.shape}" for k, b in zip(arrays, out))
            raise ValueError(f"{name}: {key} has shape {a.shape}; all must be 1-D of one length, got {shapes}")
    return out


def checked_sigma(name: str, sigma: Array) -> None:
    """ValueError when a sigma is zero or negative: a weight 1/sigma^2 would be infinite."""
    bad = np.flatnonzero(sigma <= 0.0)
    if bad.size:
        raise ValueError(
            f"{name}: sigma[{bad[0]}] = {sigma.flat[bad[0]]:g} must be > 0: the standard uncertainty of each sample"
        )
