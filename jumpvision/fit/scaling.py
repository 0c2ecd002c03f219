"""Power law over feet: value ~ radius^n, the level free in every bed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jumpvision.fit.estimate import Estimate, scatter_factor

Array = NDArray[np.float64]


def radius_exponent(radius: Array, value: Array, sigma: Array, bed: Array) -> Estimate:
    """n of value = c(bed) radius^n; radius [m], value and its sigma > 0 in one unit, bed (its packing), shape (n,).

    Force proportional to the foot's area is n = 2. sigma holds the scatter factor: trials differ by more than each
    log's own noise. NaN with a reason where no bed was met by two radii.
    """
    beds, which = np.unique(np.round(bed, 4), return_inverse=True)
    weight = (value / sigma) ** 2
    x, y = np.log(radius), np.log(value)
    total = np.bincount(which, weights=weight)
    x, y = (a - (np.bincount(which, weights=weight * a) / total)[which] for a in (x, y))
    spread = float(np.sum(weight * x * x))
    dof = value.size - beds.size - 1
    if dof < 1 or spread <= 0.0 or np.abs(x).max() < 1e-6:
        return Estimate(np.nan, np.nan, "", value.size, np.nan, "needs feet of different radii, three logs in one bed")
    n = float(np.sum(weight * x * y)) / spread
    chi2 = float(np.sum(weight * (y - n * x) ** 2))
    return Estimate(n, scatter_factor(chi2, dof) / spread**0.5, "", value.size, chi2)
