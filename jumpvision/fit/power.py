"""Motor power and work from force and velocity (thesis 2.4.2; the three powers of PHYSICS section 1)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter

from jumpvision.fit.estimate import Estimate
from jumpvision.fit.mean import difference_noise

Array = NDArray[np.float64]
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
