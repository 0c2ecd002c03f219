"""Damping as published: exponential through the peaks of a ring-down, `~ exp(-zeta omega_0 t)` (PHYSICS section 2)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from jumpvision.fit.estimate import Estimate
from jumpvision.fit.line import fit_line

Array = NDArray[np.float64]
NEAR = 1.0 / 3.0  # of a half period on each side: a cosine is flatter than its parabola by a constant factor
CLEAR = 3.0  # sigmas that a peak must stand above the offset


def peaks_damping(t: Array, x: Array, sigma: Array, *, frequency: float, offset: float) -> Estimate:
    """zeta from the line through log |x - offset| at the peaks, each the top of a parabola over a third of a period.

    t [s] increasing, x, sigma (n,) in one unit; frequency [Hz] and offset as ring_down finds them. NaN with a reason
    below three clear peaks.
    """
    half = 0.5 / frequency
    times: list[float] = []
    logs: list[float] = []
    errors: list[float] = []
    for number in range(int((t[-1] - t[0]) / half)):
        inside = np.flatnonzero((t >= t[0] + number * half) & (t < t[0] + (number + 1) * half))
        if inside.size == 0:
            continue
        top = t[inside[np.argmax(np.abs(x[inside] - offset))]]
        near = np.flatnonzero(np.abs(t - top) <= NEAR * half)
        if near.size < 4 or near[0] == 0 or near[-1] == t.size - 1:
            continue
        d = t[near] - top
        a = np.stack([np.ones_like(d), d, d * d], axis=1) / sigma[near, None]
        cov = np.linalg.inv(a.T @ a)
        p = cov @ (a.T @ ((x[near] - offset) / sigma[near]))
        shift = -0.5 * p[1] / p[2] if p[2] else math.inf
        height = p[0] - 0.25 * p[1] ** 2 / p[2] if p[2] else 0.0
        if abs(shift) > half / 4.0 or height * p[2] > 0.0 or abs(height) < CLEAR * math.sqrt(cov[0, 0]):
            continue
        if not times or top + shift > times[-1] + 0.5 * half:
            times.append(top + shift)
            logs.append(math.log(abs(height)))
            errors.append(math.sqrt(cov[0, 0]) / abs(height))
    if len(times) < 3:
        return Estimate(math.nan, math.nan, "", len(times), math.nan, f"{len(times)} clear peaks, three are needed")
    line = fit_line(times, logs, errors)
    rate = 2.0 * math.pi * frequency
    decay = -line.slope
    omega0 = math.hypot(rate, decay)
    return Estimate(decay / omega0, line.slope_sigma * rate**2 / omega0**3, "", line.n, line.chi2)
