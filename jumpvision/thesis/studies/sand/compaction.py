"""Packing of a fluidised bed against the air pulses since: the law fitted, and turned round (thesis section 3.2.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import Array

NAMES = {"logarithmic": ("loose", "dense", "B", "tau"), "stretched": ("loose", "dense", "beta", "tau")}
SHAPES = {"logarithmic": np.geomspace(0.05, 20.0, 9), "stretched": np.linspace(0.2, 1.6, 8)}
DENSEST = 0.8  # volume fraction, beyond which a fit's dense state is no packing of grains
LEAST = 5  # different numbers of pulses for four parameters
REPEATS = 6  # beds beyond the first of their pulses, from which scatter is told from a law that does not fit


def share(law: str, pulses: ArrayLike, shape: float, tau: float) -> Array:
    """Of the way from the loose state to the dense one, after pulses (...) >= 0.

    logarithmic: 1 - 1/(1 + B ln(1 + n/tau)) (Knight et al., Phys. Rev. E 51, 3957, 1995), shape = B; stretched:
    1 - exp(-(n/tau)^beta) (Philippe and Bideau, Europhys. Lett. 60, 677, 2002), shape = beta.
    """
    n = np.asarray(pulses, float)
    if law == "logarithmic":
        return 1.0 - 1.0 / (1.0 + shape * np.log1p(n / tau))
    return -np.expm1(-((n / tau) ** shape))


@dataclass(frozen=True)
class Compaction:
    """A law of packing: values by NAMES[law], their covariance (4, 4), both with chi2 of n preparations.

    scatter: standard deviation of a preparation's volume fraction beside what its measurement is uncertain by; it is
    in the weights. lack: by how much (standard deviation) the means of repeated beds are off the law beyond their own
    errors; 0 without repeats. range: of the pulses fitted. other: values of the other law with its chi2; `decided`:
    whether the data tell them apart. What they differ by goes into the uncertainties, by the other's probability.
    """

    law: str
    values: Array
    covariance: Array
    scatter: float
    lack: float
    chi2: float
    n: int
    range: tuple[float, float]
    other: tuple[Array, float]

    @property
    def decided(self) -> bool:
        return self.other[1] - self.chi2 > 2.0  # of chi2: else the laws cannot be told apart

    @property
    def doubt(self) -> float:
        """Probability of the other law, both held for as likely before."""
        worse = self.other[1] - self.chi2
        return 0.0 if np.isnan(worse) else float(scipy.special.expit(-0.5 * worse))

    def at(self, pulses: ArrayLike) -> tuple[Array, Array]:
        """(volume fraction, standard uncertainty of its mean) after pulses (...)."""
        n = np.asarray(pulses, float)
        j = _jacobian(self.law, n.ravel(), self.values)
        variance = np.maximum(np.einsum("ni,ij,nj->n", j, self.covariance, j), 0.0).reshape(n.shape)
        phi, other = _phi(self.law, n, self.values), _phi(_other(self.law), n, self.other[0])
        return phi, np.sqrt(variance + self.doubt * (other - phi) ** 2 + self.lack**2)

    def pulses(self, phi: float) -> tuple[float, float]:
        """(pulses after which the mean packing is phi, standard uncertainty); NaN where phi is not within reach."""
        loose, dense, shape, tau = self.values
        if not loose <= phi < dense:
            return math.nan, math.nan
        left = (dense - phi) / (dense - loose)
        if self.law == "logarithmic":
            n = float(tau * np.expm1((1.0 / left - 1.0) / shape))
        else:
            n = float(tau * (-math.log(left)) ** (1.0 / shape))
        if not math.isfinite(n):
            return math.nan, math.nan
        step = max(1e-4 * n, 1e-6)
        slope = float(_phi(self.law, n + step, self.values) - _phi(self.law, n, self.values)) / step
        return n, float(self.at(n)[1]) / slope


def fit_compaction(pulses: ArrayLike, phi: ArrayLike, sigma: ArrayLike, common: float = 0.0) -> Compaction:
    """The law with the least chi2 through the packings phi (n,) of beds that had `pulses` (n,) since fluidisation.

    sigma (n,): standard uncertainties of phi by themselves (0: known exactly); common: what all share, which moves the
    loose and the dense state. The scatter of preparations is learned: of repeats about their means where there are
    REPEATS or more beyond the first, else of all beds about the law.
    ValueError for shapes that differ, a negative number of pulses or fewer than LEAST different ones.
    """
    n, y, s = (np.asarray(v, float) for v in (pulses, phi, sigma))
    if not (n.shape == y.shape == s.shape and n.ndim == 1):
        raise ValueError(f"fit_compaction pulses, phi, sigma: shapes {n.shape}, {y.shape}, {s.shape} must be one (n,)")
    if (n < 0).any() or np.unique(n).size < LEAST:
        raise ValueError(
            f"fit_compaction pulses: {np.unique(n).size} different numbers of pulses, least {n.min():g}; the law has "
            f"four parameters: give {LEAST} or more, all >= 0"
        )
    different, group = np.unique(n, return_inverse=True)
    repeats = n.size - different.size
    free, scatter = (repeats if repeats >= REPEATS else n.size - 4), 0.0
    floor = max(1e-12, 1e-6 * float(np.ptp(y)))
    for _ in range(30):  # the scatter with which chi2 is its degrees of freedom
        weight = 1.0 / np.sqrt(s**2 + scatter**2 + floor**2)
        fits = {law: _fitted(law, n, y, weight) for law in NAMES}
        law = min(fits, key=lambda k: fits[k][1])
        values, chi2 = fits[law]
        about = _means(y, group)[group] if repeats >= REPEATS else _phi(law, n, values)
        more = _excess((y - about) ** 2, s, free)
        if abs(more - scatter) <= 1e-3 * max(more, floor):
            break
        scatter = more
    j = _jacobian(law, n, values) * weight[:, None]
    size = np.maximum(np.abs(values), 1e-9)
    covariance = np.linalg.pinv((j * size).T @ (j * size), hermitian=True) * np.outer(size, size)
    shared = np.array([common, common, 0.0, 0.0])
    lack = 0.0
    if repeats >= REPEATS and different.size > 4:
        own = np.sqrt(_means(s**2 + scatter**2, group) / np.bincount(group))
        lack = _excess((_means(y, group) - _phi(law, different, values)) ** 2, own, different.size - 4)
    reach = (float(n.min()), float(n.max()))
    return Compaction(
        law, values, covariance + np.outer(shared, shared), scatter, lack, chi2, n.size, reach, fits[_other(law)]
    )


def _means(x: Array, group: NDArray[np.intp]) -> Array:
    """Of the values (n,) of each group."""
    return np.asarray(np.bincount(group, x) / np.bincount(group))


def _other(law: str) -> str:
    return next(k for k in NAMES if k != law)


def _phi(law: str, n: ArrayLike, values: Array) -> Array:
    loose, dense, shape, tau = values
    return np.asarray(loose + (dense - loose) * share(law, n, shape, tau))


def _fitted(law: str, n: Array, y: Array, weight: Array) -> tuple[Array, float]:
    """Values and chi2: loose and dense state by least squares for every shape and tau of a grid, the best polished."""
    positive = n[n > 0]
    taus = np.geomspace(0.1 * positive.min(), 10.0 * positive.max(), 13)
    starts = []
    for shape, tau in product(SHAPES[law], taus):
        g = share(law, n, shape, tau)
        a = np.column_stack([1.0 - g, g]) * weight[:, None]
        (loose, dense), *_ = np.linalg.lstsq(a, y * weight, rcond=None)
        if 0.0 < loose < dense < DENSEST:
            starts.append((float(np.sum((a @ [loose, dense] - y * weight) ** 2)), loose, dense, shape, tau))
    if not starts:  # flat or falling: the mean, and no way to go
        return np.array([np.average(y, weights=weight**2)] * 2 + [1.0, float(positive.mean())]), math.inf
    best: tuple[Array, float] | None = None
    for _, loose, dense, shape, tau in sorted(starts)[:3]:
        r = scipy.optimize.least_squares(
            lambda p: (_phi(law, n, np.array([p[0], p[1], *np.exp(p[2:])])) - y) * weight,
            [loose, dense, math.log(shape), math.log(tau)],
            bounds=([0.0, 0.0, -8.0, -20.0], [DENSEST, DENSEST, 8.0, 20.0]),
            x_scale=[1e-3, 1e-3, 0.1, 0.1],
        )
        if best is None or 2.0 * r.cost < best[1]:
            best = np.array([r.x[0], r.x[1], *np.exp(r.x[2:])]), float(2.0 * r.cost)
    assert best is not None
    return best


def _excess(rest: Array, s: Array, free: int) -> float:
    """The scatter beside s at which sum rest/(s^2 + scatter^2) is `free`; 0 where s alone is enough."""
    if free <= 0 or np.sum(rest / np.maximum(s, 1e-12) ** 2) <= free:
        return 0.0
    top = math.sqrt(rest.sum() / free)
    return float(scipy.optimize.brentq(lambda q: np.sum(rest / (s**2 + q**2 + 1e-300)) - free, 1e-9 * top, 2.0 * top))


def _jacobian(law: str, n: Array, values: Array) -> Array:
    """Derivatives (n, 4) of phi by the values, by central differences."""
    steps = 1e-5 * np.maximum(np.abs(values), 1e-6)
    return np.column_stack(
        [(_phi(law, n, values + d) - _phi(law, n, values - d)) / (2.0 * d.sum()) for d in np.diag(steps)]
    )
