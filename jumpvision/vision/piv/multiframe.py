"""Slow motion from longer baselines: pairs of frames further apart about one mid-time, combined with the short one.

The error of a match is a few hundredths of a pixel however far the frames are apart, so n times the time between them
gives 1/n of the error of the velocity, as long as the grains keep their faces and their acceleration changes little.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from jumpvision.vision.piv.field import MEASURED, VectorField

Array = NDArray[np.float64]

AGREE = 3.0  # standard uncertainties that two baselines may differ by
FURTHEST = 2.0  # px, a longer displacement gains little and loses grains


def combined(fields: list[tuple[float, VectorField]]) -> VectorField:
    """Displacement per shortest baseline from fields (baseline, field) of one mid-time, the shortest first.

    Every longer one that is measured, moves by no more than FURTHEST and agrees with those before it takes part with
    the weight of its variance (their errors come from different frames). What is left of the disagreement widens sigma
    as in Birge's ratio. Gradients are those of the longest that takes part; all else is that of the shortest.
    """
    (unit, base), *longer = fields
    d, s = np.stack([base.u, base.v]), np.stack([base.u_sigma, base.v_sigma])
    weight = np.where(np.isin(base.reason, MEASURED), 1 / s**2, np.nan)
    total, mean, chi2, count = weight.copy(), d.copy(), np.zeros_like(d), np.ones(d.shape[1:])
    gradient, gradient_sigma = base.gradient.copy(), base.gradient_sigma.copy()
    for baseline, f in longer:
        n = baseline / unit
        u, sigma = np.stack([f.u, f.v]) / n, np.stack([f.u_sigma, f.v_sigma]) / n
        apart = (u - mean) ** 2 / (sigma**2 + 1 / total)
        use = np.isin(f.reason, MEASURED) & (np.hypot(f.u, f.v) <= FURTHEST) & (apart.max(0) <= AGREE**2)
        w = np.where(use, 1 / sigma**2, 0.0)
        mean, chi2 = np.where(use, (total * mean + w * u) / (total + w), mean), chi2 + np.where(use, apart, 0.0)
        total, count = total + w, count + use
        gradient[:, :, use], gradient_sigma[:, :, use] = f.gradient[:, :, use] / n, f.gradient_sigma[:, :, use] / n
    birge = np.sqrt(np.maximum(1.0, chi2.sum(0) / np.maximum(2 * (count - 1), 1)))
    several = count > 1
    d, s = np.where(several, mean, d), np.where(several, birge / np.sqrt(total), s)
    return replace(
        base, u=d[0], v=d[1], u_sigma=s[0], v_sigma=s[1], gradient=gradient, gradient_sigma=gradient_sigma
    )  # fmt: skip
