"""Spring stiffness from force against displacement, with hysteresis and errors in both (York et al. 2004)."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array

from .estimate import Estimate, checked, scatter_factor

STROKE = 0.02  # of the range of displacement: smaller reversals are none
FEWEST = 5  # points
BENT = 4.0  # sigmas of the curvature from which it is fitted along
BLOCKS = 40  # of the record, in which the noise is asked for its correlation
RHO = np.linspace(0.05, 0.95, 19)  # correlation of neighbouring blocks


@dataclass(frozen=True)
class Spring:
    """The line through force against displacement.

    fits: `spring_stiffness` k [N/m], `spring_force_at_zero_N` F_0, `spring_hysteresis_N` h (half the loop; only where
    the spring was loaded and unloaded) and `spring_curvature` [N/m^2], by which k grows per displacement: where that is
    beyond BENT sigmas k is the stiffness in the middle of the range. side (n,): 1
    loading, -1 unloading, 0 turning point, left out. fitted (n,) [N]: the line, NaN at turning points. span [m]: range
    of displacement.
    """

    fits: dict[str, Estimate]
    side: Array
    fitted: Array
    span: float


def spring_stiffness(x: ArrayLike, force: ArrayLike, *, x_sigma: float, force_sigma: float | None) -> Spring:
    """F = F_0 + k x + h side through x [m] and force [N], both (n,), in the order measured.

    x_sigma, force_sigma: white noise; force_sigma None takes it from the scatter about the line. Both errors enter by
    the effective variance force_sigma^2 + (k x_sigma)^2, with the maximum-likelihood correction for noise in x. Sigmas
    are widened where the residuals scatter more than stated, and by their correlation along the record.
    """
    at, load = checked("spring_stiffness", x=x, force=force)
    if x_sigma < 0.0 or (force_sigma is not None and force_sigma <= 0.0):
        raise ValueError(f"spring_stiffness: force_sigma = {force_sigma} must be > 0, x_sigma = {x_sigma:g} >= 0")
    span = float(np.ptp(at)) if at.size else 0.0
    side = direction(at, max(6.0 * x_sigma, STROKE * span), 6.0 * x_sigma)
    use = side != 0.0
    fitted = np.full(at.size, math.nan)
    if use.sum() < FEWEST or span <= 6.0 * x_sigma:
        reason = f"fewer than {FEWEST} points where the displacement moves by more than its noise"
        return Spring({"spring_stiffness": _none("N/m", int(use.sum()), reason)}, side, fitted, span)
    middle = 0.5 * float(at.min() + at.max())
    at, load, both = at[use], load[use], np.ptp(side[use]) > 0.0
    rest = np.column_stack([np.ones_like(at), side[use]] if both else [np.ones_like(at)])
    line = _line(at, load, rest, x_sigma, force_sigma)
    bend = _curvature(line.true, rest, line.miss, span)
    if abs(bend.value) > BENT * bend.sigma:  # a bend that is left out would pass for noise
        at_middle = ((at - middle) / span) ** 2
        rest = np.column_stack([rest, at_middle])
        line = _line(at, load, rest, x_sigma, force_sigma)
    cov = _covariance(np.column_stack([line.true, rest]), line.miss, line.variance)
    found = {"spring_stiffness": (line.k, 0, "N/m"), "spring_force_at_zero_N": (float(line.level[0]), 1, "N")}
    if both:
        found["spring_hysteresis_N"] = (float(line.level[1]), 2, "N")
    fits = {n: Estimate(v, math.sqrt(cov[i, i]), unit, at.size, line.chi2) for n, (v, i, unit) in found.items()}
    fits["spring_curvature"] = bend
    fitted[use] = line.k * at + rest[:, : 1 + both] @ line.level[: 1 + both]
    return Spring(fits, side, fitted, span)


@dataclass(frozen=True)
class _Line:
    """F = k x + rest @ level; true (n,): most likely displacements; variance: of a residual, excess included."""

    k: float
    level: Array
    miss: Array
    true: Array
    variance: float
    chi2: float


def _line(at: Array, load: Array, rest: Array, x_sigma: float, force_sigma: float | None) -> _Line:
    free = at.size - rest.shape[1] - 1
    k = float(np.polyfit(at, load, 1)[0])
    for _ in range(50):
        level = np.asarray(np.linalg.lstsq(rest, load - k * at, rcond=None)[0], dtype=np.float64)
        miss = load - k * at - rest @ level
        # the scatter holds the noise of both, so it cannot be less than what the displacement's alone gives
        own = max(float(miss @ miss) / free - (k * x_sigma) ** 2, 0.0) if force_sigma is None else force_sigma**2
        variance = max(own + (k * x_sigma) ** 2, 1e-300)
        true = at + miss * k * x_sigma**2 / variance  # most likely displacement
        true_free = true - rest @ np.linalg.lstsq(rest, true, rcond=None)[0]
        new = float(true_free @ load / (true_free @ at))
        if abs(new - k) < 1e-10 * abs(k):
            break
        k = new
    chi2 = float(miss @ miss / variance)
    return _Line(k, level, miss, true, variance * scatter_factor(chi2, free) ** 2, chi2)


def direction(x: Array, reversal: float, blur: float) -> Array:
    """1 where x (n,) grows, -1 where it falls, 0 within `blur` of an extreme where it turns by `reversal` or more."""
    n = x.size
    turns, low, high, rising = [], 0, 0, 0  # the extremes in turn, from a zigzag
    for i in range(n):
        low, high = (i if x[i] < x[low] else low), (i if x[i] > x[high] else high)
        if rising >= 0 and high < i and x[high] - x[i] >= reversal > 0.0:
            turns += [high] if rising else []
            rising, low, high = -1, i, i
        elif rising <= 0 and low < i and x[i] - x[low] >= reversal > 0.0:
            turns += [low] if rising else []
            rising, low, high = 1, i, i
    side = np.zeros(n)
    ends = [0, *turns, n - 1]
    for a, b in itertools.pairwise(ends):
        side[a : b + 1] = np.sign(x[b] - x[a])
    for t in turns:
        near = np.flatnonzero(np.abs(x - x[t]) > blur)
        before, after = near[near < t], near[near > t]
        side[(before[-1] + 1 if before.size else 0) : (after[0] if after.size else n)] = 0.0
    return side


def _curvature(x: Array, rest: Array, miss: Array, span: float) -> Estimate:
    """d k/d x [N/m^2] from what the line leaves over; its sigma from the scatter that is then left."""
    middle = (x - x.mean()) / span
    a = np.column_stack([middle**2, middle, rest])
    p = np.linalg.lstsq(a, miss, rcond=None)[0]
    left, free = miss - a @ p, x.size - a.shape[1]
    if free < 1:
        return _none("N/m^2", x.size, "too few points")
    sigma = math.sqrt(_covariance(a, left, float(left @ left) / free)[0, 0])
    return Estimate(2.0 * p[0] / span**2, 2.0 * sigma / span**2, "N/m^2", x.size, float(left @ left))


def _covariance(a: Array, miss: Array, variance: float) -> Array:
    """Covariance of the least squares by a (n, p) whose residuals along the record are `miss`.

    Means over BLOCKS of the record are taken as a first-order autoregression. Its correlation is the one that gives the
    means' lag-1 product after the fit has taken its part out, and 0 where chance alone gives as much (2 sigma).
    """
    white = np.linalg.pinv(a.T @ a, hermitian=True) * variance
    if len(a) < 2 * BLOCKS:
        return np.asarray(white)
    parts = np.array_split(np.arange(len(a)), BLOCKS)
    means, left = np.array([a[i].mean(axis=0) for i in parts]), np.array([miss[i].mean() for i in parts])
    solve = np.linalg.pinv(means)
    project = np.eye(BLOCKS) - means @ solve
    lag = np.abs(np.subtract.outer(np.arange(BLOCKS), np.arange(BLOCKS)))

    def seen(rho: float) -> float:
        cov = project @ rho**lag @ project
        return float(cov[lag == 1].sum() / np.trace(cov))

    got = 2.0 * float(left[1:] @ left[:-1]) / float(left @ left)
    if got - seen(0.0) < 4.0 / math.sqrt(BLOCKS):
        return np.asarray(white)
    rho = RHO[np.argmin([abs(seen(r) - got) for r in RHO])]
    of_one = rho**lag
    scale = float(left @ left) / float(np.trace(project @ of_one @ project))
    return np.asarray(scale * solve @ of_one @ solve.T)


def _none(unit: str, n: int, reason: str) -> Estimate:
    return Estimate(math.nan, math.nan, unit, n, math.nan, reason)
