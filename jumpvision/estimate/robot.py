"""The robot's parts by their own tests: the stiffness of its spring, how its motor follows, its power and work.

The spring: force against displacement, with hysteresis and errors in both (York et al. 2004). The motor: its
response to the command over frequency (thesis 2.4.2).
"""

from __future__ import annotations

import cmath
import itertools
import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import Array

from .estimate import Estimate, checked, least_squares_fit, scatter_factor
from .local import local_polynomial
from .mean import difference_noise

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
    # reversals of less than a fiftieth of the range of displacement are none
    side = direction(at, max(6.0 * x_sigma, 0.02 * span), 6.0 * x_sigma)
    use = side != 0.0
    fitted = np.full(at.size, math.nan)
    if use.sum() < 5 or span <= 6.0 * x_sigma:
        reason = "fewer than 5 points where the displacement moves by more than its noise"
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


NAN = math.nan
DRAWS = 400


def follow(t: Array, command: Array, encoder: Array, *, frequency: float, noise: float) -> dict[str, Estimate]:
    """`actuator_ratio`, `actuator_lag_s` and the first-order `actuator_tau_s` at `frequency` [Hz].

    H = sum(dy e^(-i w t)) / sum(dx e^(-i w t)) over the whole record, from rest to rest: exact for any linear actuator
    whatever the command, one cycle or many, transients included. t (n,) [s] evenly spaced, command, encoder (n,) [m],
    noise [m] white, of the encoder. lag = -arg(H)/w; tau = tan(w lag)/w, that of a first-order lag.
    """
    w = 2.0 * math.pi * frequency
    turn = np.exp(-1j * w * 0.5 * (t[1:] + t[:-1]))
    x, y = complex(np.sum(np.diff(command) * turn)), complex(np.sum(np.diff(encoder) * turn))
    h = y / x
    weight = np.r_[-turn[0], turn[:-1] - turn[1:], turn[-1]] / x * h.conjugate() / abs(h)  # dH/dy along and across H
    along, across = noise * np.linalg.norm(weight.real), noise * np.linalg.norm(weight.imag)
    lag, lag_sigma = -cmath.phase(h) / w, float(across) / abs(h) / w
    out = {
        "actuator_ratio": Estimate(abs(h), float(along), "", t.size, 0.0),
        "actuator_lag_s": Estimate(lag, lag_sigma, "s", t.size, 0.0),
    }
    if abs(w * lag) < 0.45 * math.pi:
        tau, slope = math.tan(w * lag) / w, 1.0 / math.cos(w * lag) ** 2
        out["actuator_tau_s"] = Estimate(tau, slope * lag_sigma, "s", t.size, 0.0)
    return out


@dataclass(frozen=True)
class Bandwidth:
    """cutoff [Hz], where the amplitude has fallen by 3 dB from its low-frequency value `gain`, with a 95 % interval;
    tau [s] of the first-order fit; order 1 or 2 of the model that the data need."""

    cutoff: Estimate
    low: float
    high: float
    gain: Estimate
    tau: Estimate
    order: int


def response(f: Array, q: Array) -> NDArray[np.complex128]:
    """g / (1 + i w tau - (w s)^2): first order for s = 0; q = (g, tau[, s])."""
    w = 2.0 * math.pi * f
    bend = (w * q[2]) ** 2 if q.size > 2 else 0.0
    return np.asarray(q[0] / (1.0 + 1j * w * q[1] - bend))


def bandwidth(f: Array, ratio: Array, ratio_sigma: Array, lag: Array, *, rng: np.random.Generator) -> Bandwidth:
    """First- or second-order response through amplitude ratios and lags [s] at the frequencies f (n,) [Hz].

    ratio_sigma (n,): of the complex response, the same along and across it. Second order where it fits significantly
    better (F-test at 1 %). The interval is drawn with rng; cutoff NaN with a reason where the response never falls so
    far within three times the highest frequency: beyond that nothing was measured.
    """
    h = ratio * np.exp(-2j * math.pi * f * lag)

    def fit(start: list[float]) -> tuple[Array, Array, float] | None:
        def residual(q: Array) -> Array:
            off = (h - response(f, q)) / ratio_sigma
            return np.r_[off.real, off.imag]

        return least_squares_fit(residual, start, scale=[1.0, *([0.1 / f.max()] * (len(start) - 1))])

    first = fit([float(ratio[np.argmin(f)]), max(float(np.median(lag)), 1e-5)]) if f.size >= 2 else None
    if first is None or np.unique(f).size < 2:
        none = {u: Estimate(NAN, NAN, u, f.size, NAN, "needs two frequencies or more") for u in ("Hz", "", "s")}
        return Bandwidth(none["Hz"], NAN, NAN, none[""], none["s"], 1)
    tau_dof = 2 * f.size - 2
    widen = scatter_factor(first[2], tau_dof)
    tau = Estimate(float(first[0][1]), widen * math.sqrt(first[1][1, 1]), "s", f.size, first[2])
    second = fit([*first[0], 0.5 * abs(float(first[0][1])) + 1e-5]) if np.unique(f).size >= 4 else None
    better = (
        second is not None
        and scipy.special.fdtrc(1, 2 * f.size - 3, (first[2] - second[2]) / (second[2] / (2 * f.size - 3))) < 0.01
    )
    q, cov, chi2 = second if second is not None and better else first
    cov = cov * scatter_factor(chi2, 2 * f.size - q.size) ** 2
    gain = Estimate(float(q[0]), math.sqrt(cov[0, 0]), "", f.size, chi2)
    top = 3.0 * float(f.max())
    cuts = np.array([_cutoff(p, top) for p in rng.multivariate_normal(q, cov, DRAWS)])
    best = _cutoff(q, top)
    if not math.isfinite(best):
        reason = f"the response does not fall by 3 dB below {top:.3g} Hz"
        return Bandwidth(Estimate(NAN, NAN, "Hz", f.size, chi2, reason), NAN, NAN, gain, tau, q.size - 1)
    cuts = np.where(np.isfinite(cuts), cuts, np.inf)
    low, high = np.quantile(cuts, [0.025, 0.975], method="nearest")
    half = 0.5 * float(np.diff(np.quantile(cuts, [0.1587, 0.8413], method="nearest"))[0])
    return Bandwidth(Estimate(best, half, "Hz", f.size, chi2), float(low), float(high), gain, tau, q.size - 1)


def _cutoff(q: Array, top: float) -> float:
    """First frequency up to `top` [Hz] where |H| = g / sqrt(2); NaN where there is none."""

    grid = np.linspace(0.0, top, 400)
    over = np.abs(response(grid, q)) / abs(q[0]) - math.sqrt(0.5)
    crossed = np.flatnonzero(over < 0.0)
    if not crossed.size or crossed[0] == 0:
        return NAN
    i = int(crossed[0])
    return float(grid[i - 1] + (grid[i] - grid[i - 1]) * over[i - 1] / (over[i - 1] - over[i]))


ORDER = 3  # of the local polynomials


def motor_power(
    t: Array, position: Array, force: Array, *, position_noise: float, period: float, begin: float, end: float
) -> dict[str, Estimate]:
    """`peak_power_W`, `motor_work_J`, `peak_speed_m_s`, `peak_force_N` of a motor between `begin` and `end` [s].

    position [m] (X_m for the internal power F X', x_m for the absolute one), force [N] on the motor, (n,) at evenly
    spaced t [s]. Velocity and force are local cubics over a tenth of the `period` [s]; that much is left out at both
    ends, where the command starts with an impulse. Work is the sum of F dX without smoothing. position_noise [m] is
    white; the force's is taken from its third differences.
    """
    step = float(np.median(np.diff(t)))
    width = max(ORDER + 2, int(0.1 * period / step)) | 1
    inside = (t >= begin) & (t <= end)
    central = (t >= begin + 0.1 * period) & (t <= end - 0.1 * period)
    if width > t.size or central.sum() < 2:
        reason = "the log is too coarse or too short for this period"
        return {"peak_power_W": Estimate(math.nan, math.nan, "W", int(inside.sum()), math.nan, reason)}
    v, rough = local_polynomial(position, width, ORDER, deriv=1, delta=step)
    smooth, rougher = local_polynomial(force, width, ORDER)
    f_noise = difference_noise(force[inside])
    v_sigma, f_sigma = position_noise * rough, f_noise * rougher
    at = np.flatnonzero(central)

    def peak(values: Array, sigma: Array, unit: str) -> Estimate:
        k = at[int(np.argmax(np.abs(values[at])))]
        return Estimate(float(values[k]), float(sigma[k]), unit, at.size, 0.0)

    rows = np.flatnonzero(inside)
    x, f = position[rows], force[rows]
    work = float(np.sum(0.5 * (f[1:] + f[:-1]) * np.diff(x)))
    weight = 0.5 * (np.r_[np.diff(x), 0.0] + np.r_[0.0, np.diff(x)])
    lever = 0.5 * (np.r_[0.0, f[1:] + f[:-1]] - np.r_[f[1:] + f[:-1], 0.0])
    work_sigma = math.hypot(f_noise * float(np.linalg.norm(weight)), position_noise * float(np.linalg.norm(lever)))
    flat = np.ones_like(v)
    return {
        "peak_power_W": peak(smooth * v, np.hypot(smooth * v_sigma, v * f_sigma), "W"),
        "motor_work_J": Estimate(work, work_sigma, "J", rows.size, 0.0),
        "peak_speed_m_s": peak(v, v_sigma * flat, "m/s"),
        "peak_force_N": peak(smooth, f_sigma * flat, "N"),
    }
