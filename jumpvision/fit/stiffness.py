"""Spring stiffness from force against displacement, with hysteresis and errors in both (York et al. 2004)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.fit.estimate import Estimate, checked, scatter_factor

Array = NDArray[np.float64]


def spring_stiffness(x: ArrayLike, force: ArrayLike, *, x_sigma: float, force_sigma: float) -> dict[str, Estimate]:
    """`spring_stiffness` k [N/m] and `spring_hysteresis_N` h of F = F_0 + k x + h sign(dx): h: half the loop.

    x [m], force [N] (n,) in the order measured; x_sigma, force_sigma their white noise. Both errors enter by the
    effective variance force_sigma^2 + (k x_sigma)^2, with the maximum-likelihood correction for noise in x; the turning
    points (where the sign is not known) are left out.
    """
    at, load = checked("spring_stiffness", x=x, force=force)
    if force_sigma <= 0.0 or x_sigma < 0.0:
        raise ValueError(f"spring_stiffness: force_sigma = {force_sigma:g} must be > 0, x_sigma = {x_sigma:g} >= 0")
    slope = np.gradient(at)
    side = np.where(np.abs(slope) > 3.0 * x_sigma, np.sign(slope), 0.0)
    use = side != 0.0
    if use.sum() < 5:
        reason = "fewer than five points where the displacement moves by three of its sigmas"
        return {"spring_stiffness": Estimate(math.nan, math.nan, "N/m", int(use.sum()), math.nan, reason)}
    at, load, side = at[use], load[use], side[use]
    both = np.ptp(side) > 0.0
    rest = np.stack([np.ones_like(at), side] if both else [np.ones_like(at)], axis=1)
    k = float(np.polyfit(at, load, 1)[0])
    for _ in range(50):
        variance = force_sigma**2 + (k * x_sigma) ** 2
        level = np.linalg.lstsq(rest, load - k * at, rcond=None)[0]
        miss = load - k * at - rest @ level
        true = at + miss * k * x_sigma**2 / variance  # most likely displacement
        true_free = true - rest @ np.linalg.lstsq(rest, true, rcond=None)[0]
        new = float(true_free @ load / (true_free @ at))
        if abs(new - k) < 1e-10 * abs(k):
            break
        k = new
    variance = force_sigma**2 + (k * x_sigma) ** 2
    chi2 = float(miss @ miss / variance)
    a = np.column_stack([true, rest])
    cov = np.linalg.inv(a.T @ a) * variance * scatter_factor(chi2, at.size - a.shape[1]) ** 2
    out = {"spring_stiffness": Estimate(k, math.sqrt(cov[0, 0]), "N/m", at.size, chi2)}
    if both:
        out["spring_hysteresis_N"] = Estimate(float(level[1]), math.sqrt(cov[2, 2]), "N", at.size, chi2)
    return out
