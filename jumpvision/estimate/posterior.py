"""Posterior of a curve that is linear in most of its parameters, in white noise and fluctuations along its path.

y = X(q) b + noise, noise = white + loud(x) times an Ornstein-Uhlenbeck process of correlation length l. The linear
parameters b and the size of the noise are summed out exactly; what is left, q and the noise's own shape, is drawn by
adaptive importance sampling (Cappe et al., J. Comput. Graph. Stat. 13, 907, 2004), all in the units of the caller.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numba as nb
import numpy as np
import scipy

from jumpvision.base.arrays import Array

ROUNDS, DRAWS, TAIL = 6, 400, 4.0  # of the sampling; degrees of freedom of the t that proposes


@nb.njit(cache=True)
def whitened(A, cells, loud, share, length):  # type: ignore[no-untyped-def]
    """(W, log|V|): the columns of A (n, p) with independent rows of unit variance, where those of A have V.

    Rows are means over cells (n, 3): where each begins, increasing, how long it is, and its white variance over the
    usual one. V: (1 - share) of that and share loud_i loud_j of the means of an Ornstein-Uhlenbeck process o of unit
    variance, by a Kalman filter with o at a cell's end and its integral over the cell.
    """
    n, p = A.shape
    W, state, P, log_det, end = np.empty((n, p)), np.zeros(p), 1.0, 0.0, -np.inf
    for i in range(n):
        w = max(cells[i, 1], 1e-3 * length)
        gap, e = math.exp(-max(cells[i, 0] - end, 0.0) / length), math.exp(-w / length)
        state *= gap
        P = gap * gap * P + 1.0 - gap * gap
        h, mean = math.sqrt(share) * loud[i], length * (1.0 - e) / w
        within = 2.0 * length * (w - 2.0 * length * (1.0 - e) + 0.5 * length * (1.0 - e * e)) / (w * w)
        S = h * h * (mean * mean * P + within) + (1.0 - share) * cells[i, 2]
        gain = h * (e * P * mean + length * (1.0 - e) ** 2 / w) / S
        root = math.sqrt(S)
        for j in range(p):
            left = A[i, j] - h * mean * state[j]
            W[i, j] = left / root
            state[j] = e * state[j] + gain * left
        P = e * e * P + 1.0 - e * e - gain * gain * S
        log_det += math.log(S)
        end = cells[i, 0] + cells[i, 1]
    return W, log_det


@nb.njit(cache=True)
def evidence(y, X, cells, loud, share, length):  # type: ignore[no-untyped-def]
    """(log density, rss, b, root): b (p,) the best linear parameters, their covariance root root' times rss / dof.

    y (n,), X (n, p); cells, loud, share, length: V of `whitened`. Summed out: b under the flat prior of X's own scale,
    the variance under 1/variance:
    -1/2 log|V| - 1/2 log|X' V^-1 X| + 1/2 log|X' X| - (n - p)/2 log rss. -inf where a column is undetermined.
    """
    n, p = X.shape
    A = np.empty((n, p + 1))
    for i in range(n):  # not as whole arrays: numba compiles its words for shapes that differ with them
        for j in range(p):
            A[i, j] = X[i, j]
        A[i, p] = y[i]
    W, log_det = whitened(A, cells, loud, share, length)
    R, plain = orthogonal(W), orthogonal(A)
    b, inverse = np.zeros(p), np.zeros((p, p))
    log = -0.5 * log_det
    for j in range(p):
        if R[j, j] == 0.0 or plain[j, j] == 0.0:
            return -np.inf, np.inf, b, inverse
        log += math.log(plain[j, j] / R[j, j])
    rss = R[p, p] ** 2
    if rss == 0.0:
        return -np.inf, np.inf, b, inverse
    for j in range(p - 1, -1, -1):
        b[j] = R[j, p] / R[j, j]
        for i in range(j + 1, p):
            b[j] -= R[j, i] * b[i] / R[j, j]
        inverse[j, j] = 1.0 / R[j, j]
        for k in range(j + 1, p):
            for i in range(j + 1, k + 1):
                inverse[j, k] -= R[j, i] * inverse[i, k] / R[j, j]
    return log - 0.5 * (n - p) * math.log(rss), rss, b, inverse


@nb.njit(cache=True)
def orthogonal(A):  # type: ignore[no-untyped-def]
    """R (p, p) of A = Q R by Gram and Schmidt, A (n, p) overwritten; a diagonal of 0 where a column is undetermined."""
    n, p = A.shape
    R = np.zeros((p, p))
    for j in range(p):
        whole = math.sqrt(_product(A, j, j))
        for k in range(j):
            R[k, j] = _product(A, k, j)
            for i in range(n):
                A[i, j] -= R[k, j] * A[i, k]
        size = math.sqrt(_product(A, j, j))
        # a column that the others leave so little of is undetermined
        if size > 1e-9 * whole and size > 0.0:
            R[j, j] = size
            for i in range(n):
                A[i, j] /= size
    return R


@nb.njit(cache=True)
def _product(A, k, j):  # type: ignore[no-untyped-def]
    """Of two columns."""
    total = 0.0
    for i in range(A.shape[0]):
        total += A[i, k] * A[i, j]
    return total


@dataclass(frozen=True)
class Drawn:
    """Draws of the posterior: q (m, k) with weight (m,), sum 1; their linear parameters b (m, p), covariance (m, p, p).

    best: the q of the greatest density (k,), log: that density; effective: number of independent draws that the
    weighted ones are worth.
    """

    q: Array
    weight: Array
    b: Array
    covariance: Array
    best: Array
    log: float
    effective: float

    def moments(self, values: Array, gradient: Array) -> tuple[float, float]:
        """(mean, standard deviation) of a number; values (m,) at each draw's b, gradient (m, p) of it by b."""
        mean = float(self.weight @ values)
        inside = np.einsum("mi,mij,mj->m", gradient, self.covariance, gradient)
        return mean, math.sqrt(max(0.0, float(self.weight @ (inside + (values - mean) ** 2))))

    def linear(self, weights: Array) -> tuple[float, float]:
        """The same of the sum of weights (p,) times b."""
        return self.moments(self.b @ weights, np.broadcast_to(weights, self.b.shape))

    def quantiles(self, values: Array, at: tuple[float, ...]) -> list[float]:
        """Quantiles of a number that is a function of q alone, values (m,)."""
        order = np.argsort(values)
        share = np.cumsum(self.weight[order]) - 0.5 * self.weight[order]
        return [float(x) for x in np.interp(at, share, values[order])]


Solved = tuple[float, float, Array, Array]  # what `evidence` returns


def maximum(
    solve: Callable[[Array], Solved], starts: list[Array], low: Array, high: Array, scale: Array
) -> tuple[Array, float]:
    """(q, log density) of the greatest density between low and high (k,), by Nelder and Mead from the best starts."""

    def cost(q: Array) -> float:
        if np.any(q < low) or np.any(q > high):
            return 1e300
        value = solve(q)[0]
        return -value if math.isfinite(value) else 1e300

    ranked = sorted(starts, key=cost)[:2]
    found = []
    for start in ranked:
        simplex = np.vstack([start, *(start + d * np.where(start + d > high, -1.0, 1.0) for d in np.diag(scale))])
        options = {"initial_simplex": simplex, "maxfev": 250 * len(start), "xatol": 1e-3, "fatol": 0.02}
        fit = scipy.optimize.minimize(cost, start, method="Nelder-Mead", options=options)
        found.append((float(fit.fun), fit.x))
    fun, q = min(found, key=lambda f: f[0])
    return np.asarray(q, dtype=float), -fun


def draw(
    solve: Callable[[Array], Solved],
    best: Array,
    low: Array,
    high: Array,
    scale: Array,
    *,
    dof: int,
    rng: np.random.Generator,
) -> Drawn:
    """Draws about the best q (k,), within low and high; scale (k,): first guess of its spread; dof: n - p."""
    k = best.size
    top = solve(best)[0]
    centre, root = best, np.diag([_width(solve, best, i, float(scale[i]), low, high, top) for i in range(k)])
    for _ in range(ROUNDS):
        step = rng.normal(size=(DRAWS, k)) / np.sqrt(rng.chisquare(TAIL, DRAWS) / TAIL)[:, None]
        q = centre + step @ root.T
        inside = np.all((q >= low) & (q <= high), axis=1)
        q, step = q[inside], step[inside]
        solved = [solve(x) for x in q]
        log = np.array([s[0] for s in solved])
        proposal = -0.5 * (TAIL + k) * np.log1p(np.sum(step**2, axis=1) / TAIL)
        weight = np.exp(np.minimum(log - top, 50.0) - proposal)
        weight = np.where(np.isfinite(weight), weight, 0.0) / max(float(np.sum(weight)), 1e-300)
        centre = weight @ q
        soft = weight**0.5 / np.sum(weight**0.5)  # a few heavy draws would shrink the next round
        spread = (q - centre).T @ ((q - centre) * (0.5 * (weight + soft))[:, None])
        root = np.linalg.cholesky(spread + np.diag((1e-3 * scale) ** 2))
    there = np.flatnonzero(weight)
    rss, b, inverse = (np.stack([solved[i][k] for i in there]) for k in (1, 2, 3))
    covariance = (rss / max(dof - 2, 1))[:, None, None] * (inverse @ inverse.transpose(0, 2, 1))
    weight = weight[there]
    return Drawn(q[there], weight, b, covariance, best, top, 1.0 / float(np.sum(weight**2)))


def _width(
    solve: Callable[[Array], Solved], best: Array, i: int, scale: float, low: Array, high: Array, top: float
) -> float:
    """About the distance along axis i at which the log density has fallen by a half."""
    width = scale
    for _ in range(12):
        q = best.copy()
        q[i] = best[i] + width if best[i] + width < high[i] else best[i] - width
        if q[i] <= low[i]:
            width *= 0.5
            continue
        fallen = top - solve(q)[0]
        if fallen < 0.2:
            if width > 0.25 * (high[i] - low[i]):
                break
            width *= 1.8
        elif fallen > 2.0:
            width *= 0.5
        else:
            break
    return width
