"""`jv.ringdown`: what a free oscillation tells, and which law of its decay the record allows."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array
from jumpvision.base.schema import StageWarning

from .decay import LAWS, MISFIT, decay_law
from .estimate import Estimate, checked, table_of
from .readings import looked
from .ringdown import ring_down

NAN = math.nan
REFUSED = 1e-4  # chance below which a user is told that the decay is not viscous


def ringdown(time_s: ArrayLike, x: ArrayLike, sigma: ArrayLike | None = None) -> pd.DataFrame:
    """What a free oscillation x (n,), in any unit, at time_s (n,) [s] tells: a row a fit, as in fits.json.

    sigma: standard uncertainty of x, (n,) or one number; default: what a smooth curve leaves of neighbouring samples.
    Rows: zeta, frequency_hz, omega0, ring_amplitude, ring_offset (unit of x), and the share of the energy lost to
    viscous damping, quadratic drag and dry friction, with the chance of each alone. NaN samples are left out; a fit
    that the data do not allow has its `reason`. Raises ValueError for arrays of different lengths.

    Example: jv.ringdown(time_s, height_m).loc["zeta", ["value", "sigma"]]
    """
    t, y = checked("ringdown", time_s=time_s, x=x)
    seen = looked("ringdown", x=y)
    if sigma is not None:
        sigma = np.broadcast_to(np.asarray(sigma, float), t.shape)[seen.kept]
    t, y = t[seen.kept], seen.columns["x"]
    if sigma is None:  # third differences of white noise have 20 times its variance
        bends = np.diff(y[np.isfinite(y)], 3)
        sigma = float(np.sqrt(np.mean(bends**2) / 20.0)) if bends.size else NAN
    each = np.broadcast_to(np.asarray(sigma, float), t.shape)
    if not np.all(each > 0.0):
        raise ValueError("ringdown sigma: must be > 0 everywhere; give the noise of x, or more samples")
    ring = ring_down(t, y, each)
    out = ring.estimates()
    if not ring.reason:
        values = {
            "ring_amplitude": (ring.amplitude, ring.amplitude_sigma),
            "ring_offset": (ring.offset, ring.offset_sigma),
        }
        out |= {k: Estimate(float(v), float(s), "unit of x", ring.n, ring.chi2) for k, (v, s) in values.items()}
        own = {"1/m": "1/(unit of x)", "m/s^2": "(unit of x)/s^2"}  # decay_fits is of heights [m]
        out |= {k: replace(e, unit=own.get(e.unit, e.unit)) for k, e in decay_fits(t, y, each).items()}
    return table_of(out)


def decay_fits(t: Array, h: Array, sigma: Array) -> dict[str, Estimate]:
    """Shares of the energy lost, rate and chance of each law, and that of each alone; a warning where viscous damping
    is refused, and first of all where no law follows the record within its noise."""
    decay = decay_law(t, h, sigma, rng=np.random.default_rng(0))
    if decay.excess > MISFIT:
        said = (
            f"ring-down: chi2 is {decay.excess:.3g} per sample: no decay law follows the motion within the stated "
            f"noise (sigma understated, or a motion that is more than one oscillation); all sigmas of the decay are "
            f"{decay.widened:.2g} times wider for it, and its chances hold among these laws alone"
        )
        warnings.warn(StageWarning("law", said, values={"chi2_per_sample": decay.excess}), stacklevel=2)
    if decay.p_alone["viscous"] < REFUSED:
        shares = ", ".join(f"{k} {e.value:.2f} ± {e.sigma:.2f}" for k, e in decay.share.items())
        said = (
            f"ring-down: viscous damping alone is refused (p = {decay.p_alone['viscous']:.1g}), zeta is an effective "
            f"value; decay law: {decay.law}; shares of the energy lost: {shares}"
        )
        warnings.warn(StageWarning("law", said, values={"p_viscous": decay.p_alone["viscous"]}), stacklevel=2)
    out = {f"decay_{k}_share": decay.share[k] for k in LAWS} | {f"decay_{k}_rate": decay.rate[k] for k in LAWS}
    for k, e in decay.share.items():
        out[f"decay_{k}_p_value"] = Estimate(decay.p_alone[k], NAN, "", e.n, e.chi2)
        out[f"decay_{k}_chance"] = Estimate(decay.takes_part(k), NAN, "", e.n, e.chi2)
    return out
