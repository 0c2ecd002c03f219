"""What is known of the parameters before the motions are seen: priors, and measurements by other means."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from jumpvision.base.arrays import Array

from .system import Parameter


@dataclass(frozen=True)
class Measured:
    """Parameters `names` measured as values (k,) with covariance (k, k), in the parameters' units; source: by what.

    Example: jv.Measured.of("W", 58.0, 0.5, "the free swing")
    """

    names: tuple[str, ...]
    values: Array
    covariance: Array
    source: str

    @classmethod
    def of(cls, name: str, value: float, sigma: float, source: str) -> Self:
        """One parameter with its standard uncertainty."""
        return cls((name,), np.array([value]), np.array([[sigma**2]]), source)

    def sigma(self, name: str) -> float:
        k = self.names.index(name)
        return math.sqrt(float(self.covariance[k, k]))

    def among(self, names: Sequence[str]) -> Measured:
        """The part of it that these parameters have, the others left free."""
        keep = [k for k, n in enumerate(self.names) if n in names]
        return Measured(
            tuple(self.names[k] for k in keep), self.values[keep], self.covariance[np.ix_(keep, keep)], self.source
        )


@dataclass(frozen=True)
class Known:
    """What is known of the free parameters x (k,) before the motions are seen: target - rows @ x is of unit variance.

    log_chance: ln of the probability of the measurements before, had each model parameters of its own for them, so that
    a model is not judged by how much is measured of it.
    """

    rows: Array
    target: Array
    log_chance: float = 0.0

    def pull(self, x: Array) -> Array:
        return np.asarray(self.target - self.rows @ x)

    @property
    def precision(self) -> Array:
        return np.asarray(self.rows.T @ self.rows)


def prior_of(free: Sequence[Parameter], measured: Sequence[Measured]) -> Known:
    """Priors and measurements of the parameters `free`, in their order."""
    names = [p.name for p in free]
    rows = [np.eye(len(free))[i] / p.sigma for i, p in enumerate(free) if math.isfinite(p.sigma)]
    target = [p.start / p.sigma for p in free if math.isfinite(p.sigma)]
    centre = np.array([p.start if math.isfinite(p.sigma) else 0.5 * (p.low + p.high) for p in free])
    spread = np.diag([min(p.sigma**2, (p.high - p.low) ** 2 / 12.0) for p in free])
    log_chance = 0.0
    for m in (x.among(names) for x in measured):
        if not m.names:
            continue
        at = [names.index(n) for n in m.names]
        select = np.eye(len(free))[at]
        root = np.linalg.inv(np.linalg.cholesky(m.covariance))  # whitens
        rows += list(root @ select)
        target += list(root @ m.values)
        # predicted before it is seen: N(select centre, covariance + select spread select')
        whole = m.covariance + select @ spread @ select.T
        gain = spread @ select.T @ np.linalg.inv(whole)
        off = m.values - select @ centre
        log_chance -= 0.5 * float(off @ np.linalg.solve(whole, off)) + 0.5 * float(
            np.linalg.slogdet(whole)[1] - np.linalg.slogdet(m.covariance)[1]
        )
        centre, spread = centre + gain @ off, spread - gain @ select @ spread
    return Known(np.array(rows).reshape(len(rows), len(free)), np.array(target), log_chance)
