"""The noise of a record, from the record: how it scatters about its own motion, and its correlation."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from jumpvision.base.arrays import Array

from .piece import Piece

STRONGEST = 0.8  # correlation from sample to sample that is looked for
RHOS = np.linspace(0.0, STRONGEST, 17)
LONG, MOST = 12, 40_000  # samples of a stretch that tells noise; of all of them, at most
QUARTILE = 0.31864  # lower quartile of the absolute value of a normal deviate
SURE = 3.0  # standard deviations by which the scatter must exceed what is stated


@dataclass(frozen=True)
class Noise:
    """factor: of the stated sigma; rho: correlation from sample to sample; n: samples that tell it."""

    factor: float
    rho: float
    n: int = 0

    def of_stated(self) -> Noise:
        """For a sigma that is stated: believed until the scatter contradicts it, never shrunk."""
        spread = (1.0 + self.rho**2) / (1.0 - self.rho**2) / (2.0 * max(self.n, 1))
        sure = self.n and self.factor > 1.0 + SURE * math.sqrt(spread)
        return Noise(self.factor if sure else 1.0, self.rho, self.n)


def _bends(rho: Array | float, k: int) -> Array | float:
    """Variance of third differences over k samples of noise of variance 1."""
    r = rho**k
    return 20.0 - 30.0 * r + 12.0 * r**2 - 2.0 * r**3


def guessed(scaled: Array) -> list[Noise]:
    """White noise and, where it may be, correlated noise: from third differences of neighbours and of every second
    sample of y/sigma (n,), medians: most of a motion has none of its own. The ratio of the two tells the correlation,
    which a quick motion imitates: guesses."""
    if scaled.size < 16:
        return [Noise(1.0, 0.0)]
    one, two = ((float(np.quantile(np.abs(_third(scaled, k)), 0.25)) / QUARTILE) ** 2 for k in (1, 2))
    if one <= 0.0:
        return [Noise(1.0, 0.0)]
    ratio = np.asarray(_bends(RHOS, 2)) / np.asarray(_bends(RHOS, 1))
    rho = float(np.interp(two / one, ratio, RHOS))
    both = [0.0, rho] if rho > 3.0 / math.sqrt(scaled.size) else [0.0]
    return [Noise(math.sqrt(one / float(_bends(r, 1))), r) for r in both]


def _third(y: Array, k: int) -> Array:
    return np.asarray(y[3 * k :] - 3.0 * y[2 * k : -k] + 3.0 * y[k : -2 * k] - y[: -3 * k])


def learned(stretches: Iterable[tuple[Piece, Array]], price: float) -> Noise | None:
    """Restricted maximum likelihood of factor and correlation over stretches whose course columns (n, p) span.

    Correlation is taken for one where the evidence pays `price` for it. None without stretches.
    """
    chi2, logs, free = np.zeros(RHOS.size), np.zeros(RHOS.size), 0
    n = 0
    for piece, columns in stretches:
        free += piece.t.size - columns.shape[1]
        n += piece.t.size
        gaps = np.maximum(np.round(np.diff(piece.t) / piece.step), 1.0)
        y, a = piece.y / piece.sigma, columns / piece.sigma[:, None]
        for k, rho in enumerate(RHOS):
            kept = rho**gaps if rho else np.zeros(gaps.size)
            root = np.sqrt(1.0 - kept**2)
            b, c = y.copy(), a.copy()
            b[1:] = (y[1:] - kept * y[:-1]) / root
            c[1:] = (a[1:] - kept[:, None] * a[:-1]) / root[:, None]
            q, r = np.linalg.qr(c)
            chi2[k] += max(float(b @ b - np.sum((q.T @ b) ** 2)), 0.0)
            logs[k] += 2.0 * float(np.sum(np.log(root))) + 2.0 * float(np.sum(np.log(np.abs(np.diag(r)))))
        if n > MOST:
            break
    if free < LONG or not np.all(chi2 > 0.0):
        return None
    cost = free * np.log(chi2 / free) + logs
    k = int(np.argmin(cost))
    rho, factor2 = _between(RHOS, cost, k), chi2[k] / free
    if cost[0] - cost[k] < price:
        rho, factor2 = 0.0, chi2[0] / free
    else:
        factor2 = float(np.interp(rho, RHOS, chi2 / free))
    return Noise(math.sqrt(factor2), rho, free)


def _between(x: Array, cost: Array, k: int) -> float:
    """Where a parabola through three neighbours is least."""
    if not 0 < k < x.size - 1:
        return float(x[k])
    a, b, c = cost[k - 1 : k + 2]
    return float(x[k] + 0.5 * (x[1] - x[0]) * (a - c) / max(a - 2.0 * b + c, 1e-300))
