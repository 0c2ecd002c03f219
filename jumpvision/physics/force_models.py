"""The force models of the ground that the thesis tried in turn, and its fit of a constant drag to single jumps."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator
from scipy.optimize import minimize_scalar

from jumpvision.physics.model import Model

Array = NDArray[np.float64]

DYNAMIC = ("inertial_drag", "depth_drag", "added_mass", "reintrusion_overshoot", "stop_go_overshoot")
FORCE_MODELS: dict[str, tuple[str, ...]] = {  # over the static force F_p (PHYSICS.md section 1, baselines 2 to 4)
    "static": (),
    "constant drag": ("inertial_drag",),
    "drag and overshoot": ("inertial_drag", "reintrusion_overshoot"),
    "depth drag": ("depth_drag",),
    "drag and added mass": ("inertial_drag", "added_mass"),
    "cone": ("depth_drag", "added_mass"),
}


def force_model(model: Model, name: str, **parameters: float) -> Model:
    """The model with the forces of FORCE_MODELS[name] in place of its own dynamic ones, and these parameters."""
    terms = (*(t for t in model.terms if t not in DYNAMIC), *FORCE_MODELS[name])
    return dataclasses.replace(model, terms=terms, parameters=dataclasses.replace(model.parameters, **parameters))


def fitted_drag(alpha: ArrayLike, heights: ArrayLike, measured: ArrayLike) -> tuple[float, float]:
    """alpha [kg/m] with the least sum of squares between simulated and measured heights, and their rms [m] (Fig 49).

    alpha: (na,) increasing. heights: (na, n) [m] of n jumps simulated with each; monotone interpolation in between.
    measured: (n,) [m]; jumps with a NaN are left out. An end of alpha as answer: look further.
    """
    a, h, m = (np.asarray(v, float) for v in (alpha, heights, measured))
    use = np.isfinite(m) & np.isfinite(h).all(axis=0)
    if not use.any():
        raise ValueError("fitted_drag heights, measured: no jump is finite in both; give others")
    at = PchipInterpolator(a, h[:, use], axis=0)

    def rms(x: float) -> float:
        return float(np.sqrt(np.mean((at(x) - m[use]) ** 2)))

    i = int(np.argmin([rms(x) for x in a]))
    ends = (a[max(i - 1, 0)], a[min(i + 1, a.size - 1)])
    best = minimize_scalar(rms, bounds=ends, method="bounded", options={"xatol": 1e-4})
    return (float(best.x), float(best.fun)) if best.fun < rms(a[i]) else (float(a[i]), rms(a[i]))


def fitted_parameter(
    tried: ArrayLike, heights: ArrayLike, measured: ArrayLike, sigma: ArrayLike
) -> tuple[float, float, float]:
    """(value, its standard uncertainty, chi2) of the parameter with the least chi2 of measured jump heights.

    tried: (nt,) increasing. heights: (nt, n) [m] of n jumps simulated with each; monotone interpolation in between.
    measured, sigma: (n,) [m]. The uncertainty is of the curvature, widened by sqrt(chi2/(n - 1)) above 1. NaN where the
    least is at an end of `tried`, or without a jump that is finite in both.
    """
    x, h, m, s = (np.asarray(v, float) for v in (tried, heights, measured, sigma))
    use = np.isfinite(m) & np.isfinite(h).all(axis=0)
    at = PchipInterpolator(x, (h[:, use] - m[use]) / s[use], axis=0)
    i = int(np.argmin(np.sum(at(x) ** 2, axis=1)))
    if not use.any() or i in (0, x.size - 1):
        return np.nan, np.nan, np.nan
    best = minimize_scalar(lambda v: float(np.sum(at(v) ** 2)), bounds=(x[i - 1], x[i + 1]), method="bounded")
    wide = max(1.0, best.fun / max(int(use.sum()) - 1, 1))
    return float(best.x), float(np.sqrt(wide / np.sum(at(best.x, 1) ** 2))), float(best.fun)
