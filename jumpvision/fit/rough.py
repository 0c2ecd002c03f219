"""Noise of a force log: white noise of the load cell and fluctuations of the grains that are correlated in depth."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import minimize

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Roughness:
    """whiten (n, n): turns residuals into independent ones of unit variance. white, correlated [unit of the residual]:
    standard deviations of the two parts; length [unit of z] over which the second is correlated."""

    whiten: Array
    white: float
    correlated: float
    length: float


def roughness(residual: Array, jacobian: Array, z: Array, inside: Array, *, width: float) -> Roughness:
    """Variances and correlation length by restricted maximum likelihood (REML), from the residuals (n,) of a fit.

    Covariance white^2 I + correlated^2 loud_i loud_j c(|z_i - z_j|), with c the mean of exp(-|dz|/length) over two bins
    of `width`. jacobian (n, p) of the fit: REML allows for what the p parameters have absorbed, which the residuals'
    own autocorrelation does not. inside (n,): depth in the grains, 0 in the air; fluctuations
    build up from nothing at the surface, loud = sqrt(1 - exp(-2 inside/length)).
    """
    basis, size_of, _ = np.linalg.svd(jacobian / np.linalg.norm(jacobian, axis=0).clip(1e-300), full_matrices=False)
    jacobian = basis[:, size_of > 1e-7 * size_of[0]]  # REML knows only the space; a break without a bend adds none
    n, p = jacobian.shape
    distance = np.abs(z[:, None] - z[None, :])
    step = width

    def covariance(q: Array) -> Array:
        share = 1.0 / (1.0 + math.exp(-q[0]))
        length = math.exp(q[1])
        loud = np.sqrt(-np.expm1(-2.0 * inside / length))
        both = share * loud[:, None] * loud[None, :] * _binned(distance, length, width)
        return np.asarray((1.0 - share) * np.eye(n) + both)

    def cost(q: Array) -> float:
        if not (-7.0 < q[0] < 7.0 and math.log(0.2 * step) < q[1] < math.log(0.3 * n * step)):
            return 1e12
        factor = cho_factor(covariance(q), lower=True)
        inner = jacobian.T @ cho_solve(factor, jacobian)
        weighted = cho_solve(factor, residual)
        best = np.linalg.solve(inner, jacobian.T @ weighted)
        rss = float(residual @ weighted - best @ (jacobian.T @ weighted))
        return float(
            (n - p) * math.log(max(rss, 1e-300)) + 2.0 * np.log(np.diag(factor[0])).sum() + np.linalg.slogdet(inner)[1]
        )

    simplex = np.array([[0.0, math.log(3.0 * step)], [2.0, math.log(3.0 * step)], [0.0, math.log(12.0 * step)]])
    q = minimize(cost, simplex[0], method="Nelder-Mead",
                 options={"initial_simplex": simplex, "maxiter": 80, "xatol": 0.05, "fatol": 0.02}).x  # fmt: skip
    factor = np.linalg.cholesky(covariance(q))
    whiten = solve_triangular(factor, np.eye(n), lower=True)
    j, r = whiten @ jacobian, whiten @ residual
    left = r - j @ np.linalg.lstsq(j, r, rcond=None)[0]
    scale = math.sqrt(float(left @ left) / (n - p))
    share = 1.0 / (1.0 + math.exp(-q[0]))
    return Roughness(whiten / scale, scale * math.sqrt(1.0 - share), scale * math.sqrt(share), math.exp(q[1]))


def _binned(distance: Array, length: float, width: float) -> Array:
    """Covariance of means over bins of `width` of a process with covariance exp(-distance/length)."""
    x = width / length
    apart = np.exp(-np.maximum(distance, width) / length) * (math.sinh(0.5 * x) / (0.5 * x)) ** 2
    np.fill_diagonal(apart, 2.0 / x * (1.0 - (1.0 - math.exp(-x)) / x))
    return apart
