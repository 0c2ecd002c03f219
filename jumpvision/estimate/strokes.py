"""A slow intrusion stroke by stroke: overshoots after events, oscillations of the deep regime, noise of the log."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from jumpvision.base.arrays import Array

from .estimate import Estimate, scatter_factor
from .mean import correlation_time

SLOW = 0.25  # share of the typical intrusion speed below which the foot counts as paused


@dataclass(frozen=True)
class Fresh:
    """The samples of a log in which the foot enters grains that it had not reached before.

    index: their positions in the log, shape (n,). event: number of the last event before each, -1 before the first.
    event_depth [m], event_pause [s] (NaN after a withdrawal), event_kind ("reintrusion" | "stop_go"): shape (events,).
    """

    index: NDArray[np.intp]
    event: NDArray[np.intp]
    event_depth: Array
    event_pause: Array
    event_kind: tuple[str, ...]


def directions(t: Array, depth: Array, *, window: float) -> NDArray[np.int8]:
    """+1 intruding, -1 withdrawing, 0 paused, shape (n,); t [s] increasing, depth [m] positive down.

    The speed is a slope over `window` [s]; a rest shorter than that is the turning point of a stroke, not a pause.
    """
    half = max(1, round(0.5 * window / float(np.median(np.diff(t)))))
    lo, hi = np.maximum(np.arange(t.size) - half, 0), np.minimum(np.arange(t.size) + half, t.size - 1)
    speed = (depth[hi] - depth[lo]) / (t[hi] - t[lo])
    down = speed[speed > 0.05 * np.abs(speed).max()]
    state = np.zeros(t.size, dtype=np.int8)
    if down.size:
        state[np.abs(speed) > SLOW * float(np.median(down))] = 1
        state *= np.sign(speed).astype(np.int8)
    cuts = np.flatnonzero(np.diff(state)) + 1
    for i, j in zip([0, *cuts], [*cuts, t.size]):
        if state[i] == 0 and i > 0 and j < t.size and t[j] - t[i] < window:
            middle = (i + j) // 2
            state[i:middle], state[middle:j] = state[i - 1], state[j]
    return state


def fresh_samples(t: Array, depth: Array, *, window: float, rise: float) -> Fresh:
    """The samples that go deeper than all before them, and the events (pauses, withdrawals) between them.

    rise [m]: depth after an event that is left out, while the force builds up again.
    """
    state = directions(t, depth, window=window)
    cuts = np.flatnonzero(np.diff(state)) + 1
    index: list[NDArray[np.intp]] = []
    event: list[NDArray[np.intp]] = []
    depths: list[float] = []
    pauses: list[float] = []
    kinds: list[str] = []
    deepest, pause, withdrawn, begun = -np.inf, 0.0, False, False
    for i, j in zip([0, *cuts], [*cuts, t.size]):
        if state[i] < 0:
            withdrawn = True
        elif state[i] == 0:
            pause += float(t[min(j, t.size - 1)] - t[i]) + (1.0 - 2.0 * SLOW) * window  # lost in the smoothing
        else:
            before = np.maximum.accumulate(np.r_[deepest + (rise if begun else 0.0), depth[i : j - 1]])
            stopping = (t[i:j] > t[j - 1] - window) & (j < t.size)  # the force relaxes as soon as the foot slows
            new = np.arange(i, j)[(depth[i:j] > before) & ~stopping]
            if new.size:
                if begun:
                    depths.append(deepest)
                    pauses.append(np.nan if withdrawn else pause)
                    kinds.append("reintrusion" if withdrawn else "stop_go")
                index.append(new)
                event.append(np.full(new.size, len(depths) - 1))
                pause, withdrawn, begun = 0.0, False, True
        deepest = max(deepest, float(depth[i:j].max()))
    empty = np.zeros(0, dtype=np.intp)
    return Fresh(
        np.concatenate(index) if index else empty,
        np.concatenate(event) if event else empty,
        np.array(depths),
        np.array(pauses),
        tuple(kinds),
    )


REACH = 4.0  # an overshoot farther back than so many lam leaves nothing
SURE = 3.0  # sigmas from which compounding enters the law
VARIED = 2.0  # pauses must differ by this factor to show a dependence


def overshoot_law(
    depth: Array, overshoot: Array, covariance: Array, *, lam: float, pause: Array
) -> dict[str, Estimate]:
    """s, and where the events show them `per_decade` [N/m], `compounding`, `intercept` [N] and `exponent`.

    depth [m] of the events below the surface, overshoot [N] with covariance (m, m), pause [s] (NaN: a withdrawal). lam
    [m]. intercept: of a straight line beside s (0 if proportional); exponent p of O ~ z^p (1 if proportional).
    """
    deep = depth > 0.0
    z, o, t = depth[deep], overshoot[deep], pause[deep]
    cov = covariance[np.ix_(deep, deep)]
    if z.size == 0:
        return {}
    columns = {"s": (z, "N/m")}
    known = np.isfinite(t) & (t > 0)
    if known.all() and t.max() > VARIED * t.min() and z.size >= 3:
        columns["per_decade"] = (z * np.log10(t), "N/m")
    gap = np.diff(z)
    if z.size >= 4 and gap.size and gap.min() < REACH * lam:
        columns["compounding"] = (np.r_[0.0, o[:-1] * np.exp(-gap / lam)], "")
    out = _generalised(columns, o, cov)
    if "compounding" in out and abs(out["compounding"].value) < SURE * out["compounding"].sigma:
        del columns["compounding"]  # nearly proportional to depth itself: it would only widen s
        out = _generalised(columns, o, cov) | {"compounding": out["compounding"]}
    if z.size > len(columns) + 1:
        out["intercept"] = _generalised(columns | {"intercept": (np.ones_like(z), "N")}, o, cov)["intercept"]
        rest = o - columns["compounding"][0] * out["compounding"].value if "compounding" in columns else o
        if np.all(rest > 2.0 * np.sqrt(np.diag(cov))):  # a logarithm of what may be zero has no meaning
            logs = {"exponent": (np.log(z), ""), "level": (np.ones_like(z), "")}
            if "per_decade" in columns:
                logs["pause"] = (np.log10(t), "")
            if z.size > len(logs):
                out["exponent"] = _generalised(logs, np.log(rest), cov / rest[:, None] / rest[None, :])["exponent"]
    return out


def _generalised(columns: dict[str, tuple[Array, str]], y: Array, cov: Array) -> dict[str, Estimate]:
    """Generalised least squares of y (m,) on the columns; sigma with the scatter factor."""
    whiten = np.linalg.inv(np.linalg.cholesky(cov))
    x = whiten @ np.stack([c for c, _ in columns.values()], axis=1)
    inverse = np.linalg.pinv(x.T @ x)
    p = inverse @ (x.T @ (whiten @ y))
    chi2 = float(np.sum((whiten @ y - x @ p) ** 2))
    factor = scatter_factor(chi2, y.size - p.size)
    return {
        k: Estimate(float(p[i]), factor * math.sqrt(float(inverse[i, i])), unit, y.size, chi2)
        for i, (k, (_, unit)) in enumerate(columns.items())
    }


@dataclass(frozen=True)
class Ripple:
    """variance [N^2]: deep minus shallow, negative when there are no oscillations. amplitude [N]: its root times
    sqrt(2), that of a sine; NaN with a reason where the variance is within 3 sigma of 0. spacing [m]: of the peaks."""

    variance: Estimate
    amplitude: Estimate
    spacing: float


def deep_ripple(z: Array, residual: Array, *, surface: float, bend: float) -> Ripple:
    """Ripple of the residual force (n,) [N] at depths z [m]: below `bend` against between `surface` and `bend`."""
    deep, shallow = residual[z > bend], residual[(z > surface) & (z <= bend)]
    (a, sa), (b, sb) = _variance(deep), _variance(shallow)
    variance = Estimate(a - b, math.hypot(sa, sb), "N^2", deep.size, math.nan)
    if not variance.value > 3.0 * variance.sigma:
        none = "no oscillation above the fluctuations near the surface"
        return Ripple(variance, Estimate(math.nan, math.nan, "N", deep.size, math.nan, none), math.nan)
    amplitude = math.sqrt(2.0 * variance.value)
    sigma = variance.sigma / amplitude
    at, step = z[z > bend], float(np.median(np.diff(z[z > bend])))
    even = np.interp(np.arange(at[0], at[-1], step), at, deep)
    power = np.abs(np.fft.rfft((even - even.mean()) * np.hanning(even.size), 8 * even.size)) ** 2
    low = 16  # two periods in the record at least
    spacing = 8 * even.size * step / (low + int(np.argmax(power[low:])))
    return Ripple(variance, Estimate(amplitude, sigma, "N", deep.size, math.nan), spacing)


def _variance(x: Array) -> tuple[float, float]:
    """(variance, sigma) of a correlated Gaussian series: 2 v^2 / n_eff, the squares' correlation time for n_eff."""
    if x.size < 8:
        return math.nan, math.nan
    v = float(np.var(x))
    return v, v * math.sqrt(2.0 * correlation_time((x - x.mean()) ** 2) / x.size)


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
        factor = scipy.linalg.cho_factor(covariance(q), lower=True)
        inner = jacobian.T @ scipy.linalg.cho_solve(factor, jacobian)
        weighted = scipy.linalg.cho_solve(factor, residual)
        best = np.linalg.solve(inner, jacobian.T @ weighted)
        rss = float(residual @ weighted - best @ (jacobian.T @ weighted))
        return float(
            (n - p) * math.log(max(rss, 1e-300)) + 2.0 * np.log(np.diag(factor[0])).sum() + np.linalg.slogdet(inner)[1]
        )

    simplex = np.array([[0.0, math.log(3.0 * step)], [2.0, math.log(3.0 * step)], [0.0, math.log(12.0 * step)]])
    q = scipy.optimize.minimize(
        cost,
        simplex[0],
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxiter": 80, "xatol": 0.05, "fatol": 0.02},
    ).x
    factor = np.linalg.cholesky(covariance(q))
    whiten = scipy.linalg.solve_triangular(factor, np.eye(n), lower=True)
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
