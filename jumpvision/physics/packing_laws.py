"""Parameters of the bed as functions of its volume fraction phi: continuous, piecewise linear, with a kink at phi_c.

Below the critical packing phi_c a bed consolidates under shear, above it dilates: k_1, alpha and the heights of jumps
rise faster above it (thesis sections 3.2.2 and 3.2.3, Figs 45, 48, 49).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar

Array = NDArray[np.float64]

GRID = 301  # trial places of the kink
DRAWS = 2000  # of noise, for the distribution of the test without a kink
CHI2_95 = 3.841  # 95 % point of chi2 with one degree of freedom


@dataclass(frozen=True)
class PackingLaw:
    """A parameter given at increasing volume fractions, linear between them and unknown outside."""

    phi: tuple[float, ...]
    value: tuple[float, ...]

    def __call__(self, phi: ArrayLike) -> Array:
        """The parameter at phi (...). ValueError outside the range of the law."""
        x = np.asarray(phi, float)
        outside = ~((x >= self.phi[0]) & (x <= self.phi[-1]))
        if outside.any():
            raise ValueError(
                f"phi = {x[outside].flat[0]:g} is outside {self.phi[0]:g} to {self.phi[-1]:g}, where the law is known"
            )
        return np.interp(x, self.phi, self.value)


@dataclass(frozen=True)
class PackingFit:
    """value = value_c + slope (phi - phi_c), with one slope below phi_c and one above.

    covariance: (4, 4) of phi_c, value_c, slope_below, slope_above, multiplied by max(1, chi2/(n - 4)) as is the
    interval. interval: 95 % confidence of phi_c, the profile of chi2; an end of the searched range means: not bounded
    there. p_straight: probability of so much better a fit than a straight line where there is no kink.
    """

    phi_c: float
    value_c: float
    slope_below: float
    slope_above: float
    covariance: Array
    interval: tuple[float, float]
    p_straight: float
    chi2: float
    n: int
    range: tuple[float, float]  # of the volume fractions fitted
    line: PackingLaw  # the straight line through the same data

    @property
    def law(self) -> PackingLaw:
        """The fit as a law over the range of its data."""
        x = (self.range[0], self.phi_c, self.range[1])
        return PackingLaw(x, tuple(float(v) for v in self.at(x)[0]))

    def at(self, phi: ArrayLike) -> tuple[Array, Array]:
        """(value, standard uncertainty) at phi (...)."""
        d = np.asarray(phi, float) - self.phi_c
        value = self.value_c + self.slope_below * np.minimum(d, 0.0) + self.slope_above * np.maximum(d, 0.0)
        j = _jacobian(d, self.slope_below, self.slope_above)
        return value, np.sqrt(np.einsum("...i,ij,...j->...", j, self.covariance, j))


def fit_packing_law(
    phi: ArrayLike, value: ArrayLike, sigma: ArrayLike, *, rng: np.random.Generator | None = None
) -> PackingFit:
    """The kinked line with the least sum ((value - law)/sigma)^2, over every place of the kink.

    phi, value, sigma: (n,), sigma > 0 the standard uncertainty of value; points with a NaN are left out. The kink is
    looked for between the second and the last but one volume fraction. p_straight is of the ratio of the drop in chi2
    to chi2/(n - 4), whose distribution without a kink is drawn (`rng`; the place of the kink has no meaning then, so no
    table holds: Davies, Biometrika 74, 1987); it does not depend on the scale of sigma.
    ValueError for shapes that differ, a sigma that is not positive or fewer than five different phi.
    """
    x, y, s = (np.asarray(v, float) for v in (phi, value, sigma))
    if not (x.shape == y.shape == s.shape and x.ndim == 1):
        raise ValueError(f"fit_packing_law phi, value, sigma: shapes {x.shape}, {y.shape}, {s.shape} must be one (n,)")
    if (s <= 0.0).any():
        raise ValueError("fit_packing_law sigma: must be > 0; give the standard uncertainty of each value")
    use = np.isfinite(x) & np.isfinite(y) & np.isfinite(s)
    x, y, w = x[use], y[use], 1.0 / s[use]
    different = np.unique(x)
    if different.size < 5:
        raise ValueError(f"fit_packing_law phi: {different.size} different volume fractions; a kink needs five or more")
    trial = np.linspace(different[1], different[-2], GRID)
    noise = (np.random.default_rng(0) if rng is None else rng).standard_normal((x.size, DRAWS))
    straight, drop = _kinks(trial, x, w, np.column_stack([y * w, noise]))
    profile = straight[0] - drop[:, 0]
    ratio = drop.max(axis=0) / np.maximum(straight - drop.max(axis=0), 1e-12 * straight)
    i = int(np.argmin(profile))
    lo, hi = trial[max(i - 1, 0)], trial[min(i + 1, GRID - 1)]
    fine = minimize_scalar(lambda c: _linear(c, x, y, w)[1], bounds=(lo, hi), method="bounded", options={"xatol": 1e-9})
    at = float(fine.x) if fine.fun < profile[i] else float(trial[i])
    (value_c, below, above), chi2 = _linear(at, x, y, w)
    scatter = max(1.0, chi2 / max(x.size - 4, 1))
    j = _jacobian(x - at, below, above) * w[:, None]
    inside = trial[profile <= chi2 + CHI2_95 * scatter]
    return PackingFit(
        phi_c=at, value_c=value_c, slope_below=below, slope_above=above, covariance=scatter * _inverse(j.T @ j),
        interval=(min(float(inside.min()), at), max(float(inside.max()), at)) if inside.size else (at, at),
        p_straight=float((1 + np.sum(ratio[1:] >= ratio[0])) / (1 + DRAWS)),
        chi2=chi2, n=x.size, range=(float(x.min()), float(x.max())), line=_straight(x, y, w),
    )  # fmt: skip


def _linear(c: float, x: Array, y: Array, w: Array) -> tuple[tuple[float, float, float], float]:
    """Value and slopes at a kink at c, and chi2."""
    design = np.column_stack([np.ones_like(x), np.minimum(x - c, 0.0), np.maximum(x - c, 0.0)]) * w[:, None]
    p = np.linalg.lstsq(design, y * w, rcond=None)[0]
    return (float(p[0]), float(p[1]), float(p[2])), float(np.sum((y * w - design @ p) ** 2))


def _straight(x: Array, y: Array, w: Array) -> PackingLaw:
    slope, level = np.polyfit(x - x.mean(), y, 1, w=w)
    ends = np.array([x.min(), x.max()])
    return PackingLaw(tuple(ends.tolist()), tuple((level + slope * (ends - x.mean())).tolist()))


def _jacobian(d: Array, below: float, above: float) -> Array:
    """Derivatives (..., 4) of the value by phi_c, value_c and the slopes at the distances d (...) from the kink."""
    slope = np.where(d < 0.0, below, np.where(d > 0.0, above, 0.5 * (below + above)))
    return np.stack([-slope, np.ones_like(d), np.minimum(d, 0.0), np.maximum(d, 0.0)], axis=-1)


def _inverse(normal: Array) -> Array:
    """The inverse of a normal matrix, NaN where it has none: two equal slopes leave the kink no place."""
    scale = np.sqrt(np.diag(normal))
    if not (scale > 0.0).all() or np.linalg.cond(normal / np.outer(scale, scale)) > 1e12:
        return np.full(normal.shape, np.nan)
    return np.linalg.inv(normal / np.outer(scale, scale)) / np.outer(scale, scale)


def _kinks(trial: Array, x: Array, w: Array, data: Array) -> tuple[Array, Array]:
    """chi2 (k,) of straight lines through weighted data (n, k), and by how much a kink at each trial (m,) lowers it."""
    line, _ = np.linalg.qr(np.column_stack([w, x * w]))
    bends = np.maximum(x[:, None] - trial, 0.0) * w[:, None]
    bends -= line @ (line.T @ bends)  # what a kink adds to a line
    bends /= np.linalg.norm(bends, axis=0)
    rest = data - line @ (line.T @ data)
    return np.sum(rest**2, axis=0), (bends.T @ rest) ** 2
