"""The motor: how it follows its command over frequency, and its power and work (thesis 2.4.2)."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter
from scipy.special import fdtrc

from jumpvision.base.arrays import Array

from .estimate import Estimate, least_squares_fit, scatter_factor
from .mean import difference_noise

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
        second is not None and fdtrc(1, 2 * f.size - 3, (first[2] - second[2]) / (second[2] / (2 * f.size - 3))) < 0.01
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
    v = savgol_filter(position, width, ORDER, deriv=1, delta=step)
    smooth = savgol_filter(force, width, ORDER)
    v_sigma = position_noise * float(np.linalg.norm(savgol_coeffs(width, ORDER, deriv=1, delta=step)))
    f_noise = difference_noise(force[inside])
    f_sigma = f_noise * float(np.linalg.norm(savgol_coeffs(width, ORDER)))
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
