"""Means with their uncertainty, how much a correlated series is worth, and whether two sets of values agree."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import FROM_MAD, MAD, Array

from .estimate import Estimate, checked, checked_sigma, scatter_factor


def weighted_mean(values: ArrayLike, sigma: ArrayLike, unit: str) -> Estimate:
    """Inverse-variance mean of values (n,) with standard uncertainties sigma (n,), both in `unit`; NaN is left out.

    Sigma holds the scatter factor: it is widened where the values scatter more than stated. NaN with a reason without
    a single value.
    """
    values, sigma = checked("weighted_mean", values=values, sigma=sigma)
    use = np.isfinite(values) & (sigma > 0.0)
    n = int(use.sum())
    if n == 0:
        return Estimate(math.nan, math.nan, unit, 0, math.nan, "no value")
    w = sigma[use] ** -2.0
    mean = float(np.average(values[use], weights=w))
    chi2 = float(np.sum(w * (values[use] - mean) ** 2))
    return Estimate(mean, scatter_factor(chi2, n - 1) * float(w.sum()) ** -0.5, unit, n, chi2)


def plain_mean(values: ArrayLike, unit: str) -> Estimate:
    """Mean of values (n,) in `unit` at equal weights, sigma from their scatter; NaN is left out, below two NaN."""
    (values,) = checked("plain_mean", values=values)
    values = values[np.isfinite(values)]
    n = values.size
    if n < 2:
        return Estimate(math.nan, math.nan, unit, n, math.nan, "fewer than two values")
    return Estimate(float(values.mean()), float(values.std(ddof=1)) / math.sqrt(n), unit, n, n - 1.0)


def near_the_median(values: ArrayLike, sigma: ArrayLike, *, reject: float) -> NDArray[np.bool_]:
    """Values (n,) within `reject` robust sigmas of their median; a value's robust sigma is its own times
    max(1, 1.4826 median |deviation/sigma|), so that understated errors turn no ordinary value into a stray one. NaN is
    not near."""
    values, sigma = checked("near_the_median", values=values, sigma=sigma)
    use = np.isfinite(values) & (sigma > 0.0)
    if not use.any():
        return use
    off = np.abs(values - np.median(values[use])) / np.where(use, sigma, np.nan)
    near: NDArray[np.bool_] = off <= reject * max(1.0, FROM_MAD * float(np.median(off[use])))
    return near


def difference_noise(series: NDArray[np.float64]) -> float:
    """White noise (standard deviation) of a smooth, evenly sampled series (n,) by third differences; 0 for n < 8.

    Third differences of white noise have 20 times its variance; their median absolute value is not moved by the few
    samples in which the series itself bends.
    """
    if series.size < 8:
        return 0.0
    return float(np.median(np.abs(np.diff(series, 3)))) / MAD / math.sqrt(20.0)


WINDOW = 5.0  # the sum over lags ends where the lag exceeds this many correlation times (Sokal 1997)


def correlation_time(residual: Array) -> float:
    """Integrated autocorrelation time 1 + 2 sum rho_k of an evenly sampled series (n,), in samples, at least 1.

    n / correlation_time is the effective number of samples of a mean or of any fit whose model varies more slowly than
    the noise. The sum ends by Sokal's self-consistent window. Anticorrelated noise counts as white: the safe side.
    """
    n = residual.size
    if n < 8:
        return 1.0
    d = residual - residual.mean()
    spectrum = np.fft.rfft(d, 2 * n)
    acf = np.fft.irfft(spectrum * spectrum.conj())[:n]
    if acf[0] <= 0.0:
        return 1.0
    tau = 2.0 * np.cumsum(acf / acf[0]) - 1.0
    far = np.flatnonzero(np.arange(n) >= WINDOW * tau)
    return max(1.0, float(tau[far[0] if far.size else -1]))


ORDERS = 20  # most lags of an autoregression


def noise_at(residual: Array, frequency: float) -> float:
    """Power density of an evenly sampled series (n,) at a frequency [cycles a sample] over that of white noise of its
    variance: by the autoregression of least BIC (Levinson's recursion), 1 where no order betters white noise."""
    n = residual.size
    if n < 8:
        return 1.0
    d = residual - residual.mean()
    spectrum = np.fft.rfft(d, 2 * n)
    acf = np.fft.irfft(spectrum * spectrum.conj())[: ORDERS + 1]
    if acf[0] <= 0.0:
        return 1.0
    acf = acf / acf[0]
    a, left = np.ones(1), 1.0
    best = (0.0, a, left)
    for k in range(1, min(ORDERS, n // 10) + 1):
        turn = -float(a @ acf[k : k - a.size : -1]) / left
        a = np.r_[a, 0.0] + turn * np.r_[0.0, a[::-1]]
        left *= 1.0 - turn * turn
        if not left > 0.0:
            break
        best = min(best, (n * math.log(left) + k * math.log(n), a, left), key=lambda b: b[0])
    _, a, left = best
    return left / abs(np.exp(-2j * np.pi * frequency * np.arange(a.size)) @ a) ** 2


OWN = 4  # trials from which the scatter of a condition is judged by itself, not pooled with that of the others
DRAWS = 20_000


@dataclass(frozen=True)
class Agreement:
    """Arrays (c,) over the conditions, in the unit of the values.

    trials: how many were combined. measured, model: their means; sigma: of measured, with the scatter of trials beyond
    their stated errors (scatter: its standard deviation; dof: repeats it was learned from, inf without any) and with
    what all trials of one apparatus share (sigma_common).
    model_sigma: of the model, from its uncertain parameters. z: difference measured - model over both, as a normal
    deviate; p its two-sided probability, p_holm that corrected for the number of conditions (Holm).
    chi2: of all differences with their correlations, about c where they agree, and its p_value.
    """

    trials: NDArray[np.int64]
    measured: Array
    sigma: Array
    scatter: Array
    dof: Array
    model: Array
    model_sigma: Array
    z: Array
    p: Array
    p_holm: Array
    chi2: float
    p_value: float
    sigma_common: Array

    @property
    def difference(self) -> Array:
        return self.measured - self.model


def agreement(
    measured: ArrayLike,
    sigma: ArrayLike,
    model: ArrayLike,
    condition: ArrayLike,
    steps: ArrayLike,
    *,
    rng: np.random.Generator,
    shared: ArrayLike = (),
) -> Agreement:
    """Trials (n,) against a model whose parameters are uncertain.

    measured with standard uncertainties sigma > 0, model: (n,), one unit. condition: (n,), 0..c-1, the trials that are
    repeats of one another. steps: (n, p), change of the model by one standard uncertainty of each parameter; an error
    of a parameter is one and the same for all trials, so it correlates the conditions. shared: (n, q), change of
    measured by one standard uncertainty of each error of the apparatus (a scale, a lens), which sigma does not hold:
    neither do these average out over trials.

    Trials of a condition scatter by sigma and by a start-up scatter beside it, estimated by Paule and Mandel (1982):
    in a condition of OWN trials or more from itself, else pooled over those with fewer. Where it was learned from
    repeats, a condition's difference is held against Student's t (with the model's part after Welch and
    Satterthwaite), and chi2 against DRAWS draws of the same: p_value is then at least 1 / (DRAWS + 1).
    """
    h, s, m = checked("agreement", measured=measured, sigma=sigma, model=model)
    checked_sigma("agreement", s)
    at, steps = np.asarray(condition, np.int64), np.asarray(steps, float).reshape(h.size, -1)
    count = np.bincount(at)
    scatter, dof, learned = _scatter(h - m, s, at, count)
    w = 1.0 / (s**2 + scatter[at] ** 2)
    w /= np.bincount(at, w)[at]
    u = np.sqrt(np.bincount(at, w**2 * (s**2 + scatter[at] ** 2)))
    mean, predicted = (np.bincount(at, w * x).astype(np.float64) for x in (h, m))
    off = mean - predicted
    by_step = np.array([np.bincount(at, w * x) for x in steps.T]).reshape(-1, count.size).T
    seen = np.asarray(shared, float).reshape(h.size, -1)
    by_apparatus = np.array([np.bincount(at, w * x) for x in seen.T]).reshape(-1, count.size).T
    all_steps = np.hstack([by_step, by_apparatus])
    cov = np.diag(u**2) + all_steps @ all_steps.T
    total = np.sqrt(np.diag(cov))
    ratio, welch = off / total, dof * (total / u) ** 4
    p = 2.0 * scipy.stats.t.sf(np.abs(ratio), welch)
    # z beyond 37 is told as 37: its p is no floating-point number
    z = np.where(np.isinf(welch), ratio, np.sign(ratio) * scipy.stats.norm.isf(0.5 * np.maximum(p, 1e-300)))
    inverse = np.linalg.inv(cov)
    chi2 = float(off @ inverse @ off)
    if np.isinf(dof).all():
        p_value = float(scipy.stats.chi2.sf(chi2, count.size))
    else:
        known = np.where(np.isinf(dof), 1.0, dof)
        spread = rng.chisquare(known, (DRAWS, count.size)) / known
        spread = np.where(np.isinf(dof), 1.0, np.take_along_axis(spread, np.tile(learned, (DRAWS, 1)), axis=1))
        d = u * rng.standard_normal((DRAWS, count.size)) / np.sqrt(spread)
        d += rng.standard_normal((DRAWS, all_steps.shape[1])) @ all_steps.T
        p_value = (1 + int(np.sum(np.einsum("ij,jk,ik->i", d, inverse, d) >= chi2))) / (DRAWS + 1)
    model_sigma = np.sqrt(np.sum(by_step**2, axis=1))
    common = np.sqrt(np.sum(by_apparatus**2, axis=1))
    sigma_of = np.hypot(u, common)
    return Agreement(count, mean, sigma_of, scatter, dof, predicted, model_sigma, z, p, holm(p), chi2, p_value, common)


def _scatter(
    d: Array, s: Array, at: NDArray[np.int64], count: NDArray[np.int64]
) -> tuple[Array, Array, NDArray[np.int64]]:
    """Start-up scatter (c,), the degrees of freedom it was learned from (c,), and the first condition of its pool."""
    out, dof, learned = np.zeros(count.size), np.full(count.size, math.inf), np.arange(count.size)
    few = (count < OWN) if (count[count < OWN] > 1).any() else np.ones(count.size, bool)
    for pool in (few, *(np.arange(count.size) == c for c in np.flatnonzero(count >= OWN))):
        out[pool], dof[pool] = excess_scatter(d[pool[at]], s[pool[at]], at[pool[at]])
        learned[pool] = np.argmax(pool)
    return out, dof, learned


def excess_scatter(d: Array, s: Array, at: NDArray[np.int64]) -> tuple[float, float]:
    """(t, dof): the least t >= 0 with sum (d - mean)^2/(s^2 + t^2) <= dof over the conditions; (0, inf) of none."""
    dof = d.size - np.unique(at).size

    def missing(t: float) -> float:
        w = 1.0 / (s**2 + t**2)
        mean = np.bincount(at, w * d) / np.maximum(np.bincount(at, w), 1e-300)
        return float(np.sum(w * (d - mean[at]) ** 2)) - dof

    if dof == 0:
        return 0.0, math.inf
    if missing(0.0) <= 0.0:
        return 0.0, float(dof)
    return float(scipy.optimize.brentq(missing, 0.0, 2.0 * float(np.ptp(d)) * math.sqrt(d.size))), float(dof)


def holm(p: ArrayLike) -> Array:
    """p values (n,) corrected for their number, whatever their dependence (Holm 1979): below 0.05 any is an event."""
    p = np.asarray(p, float)
    order = np.argsort(p)
    out = np.empty(p.size)
    out[order] = np.minimum(np.maximum.accumulate(p[order] * np.arange(p.size, 0, -1)), 1.0)
    return out
