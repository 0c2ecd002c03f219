"""Speed and acceleration of a body, as columns beside its places."""

from __future__ import annotations

import pandas as pd

from jumpvision.base.arrays import Array
from jumpvision.estimate.height import parabolas


def with_derivatives(out: pd.DataFrame, place: Array, sigma: Array, axes: str, unit: str, window: int) -> pd.DataFrame:
    """The table with speed and acceleration of place (k, n), their sigma from sigma (n,) of every coordinate."""
    *each, (dv, da) = parabolas(out.time_s.to_numpy(float), place, sigma, window)
    names = [f"v{a}_{unit}_s" for a in axes] + [f"v_sigma_{unit}_s"]
    names += [f"a{a}_{unit}_s2" for a in axes] + [f"a_sigma_{unit}_s2"]
    return out.assign(**dict(zip(names, (*(v for v, _ in each), dv, *(a for _, a in each), da))))
