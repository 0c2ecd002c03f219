"""Overshoots of the penetration force after pauses and withdrawals: proportional to depth? compounding? pause?

O_i = z_i (s + g log10(t_i / 1 s)) + c O_(i-1) exp(-(z_i - z_(i-1)) / lam)

s [N/m] is the law of PHYSICS section 1 item 3; g its growth a factor ten of pause; c the share of what is left of the
last overshoot that the next one gains: 0 each pause starts anew, 1 they add up.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from jumpvision.fit.estimate import Estimate, scatter_factor

Array = NDArray[np.float64]
REACH = 4.0  # an overshoot farther back than so many lam leaves nothing
SURE = 3.0  # sigmas from which compounding enters the law
VARIED = 2.0  # pauses must differ by this factor to show a dependence


def overshoot_law(
    depth: Array, overshoot: Array, covariance: Array, *, lam: float, pause: Array
) -> dict[str, Estimate]:
    """s, and where the events show them `per_decade` [N/m], `compounding`, `intercept` [N] and `exponent`.

    depth [m] of the events below the surface, overshoot [N] with covariance (m, m), pause [s] (NaN: a withdrawal). lam
    [m]. intercept: of a straight line beside s (0 if proportional); exponent p of O ~ z^p (1 if proportional).
    """
    deep = depth > 0.0
    z, o, t = depth[deep], overshoot[deep], pause[deep]
    cov = covariance[np.ix_(deep, deep)]
    if z.size == 0:
        return {}
    columns = {"s": (z, "N/m")}
    known = np.isfinite(t) & (t > 0)
    if known.all() and t.max() > VARIED * t.min() and z.size >= 3:
        columns["per_decade"] = (z * np.log10(t), "N/m")
    gap = np.diff(z)
    if z.size >= 4 and gap.size and gap.min() < REACH * lam:
        columns["compounding"] = (np.r_[0.0, o[:-1] * np.exp(-gap / lam)], "")
    out = _generalised(columns, o, cov)
    if "compounding" in out and abs(out["compounding"].value) < SURE * out["compounding"].sigma:
        del columns["compounding"]  # nearly proportional to depth itself: it would only widen s
        out = _generalised(columns, o, cov) | {"compounding": out["compounding"]}
    if z.size > len(columns) + 1:
        out["intercept"] = _generalised(columns | {"intercept": (np.ones_like(z), "N")}, o, cov)["intercept"]
        rest = o - columns["compounding"][0] * out["compounding"].value if "compounding" in columns else o
        if np.all(rest > 2.0 * np.sqrt(np.diag(cov))):  # a logarithm of what may be zero has no meaning
            logs = {"exponent": (np.log(z), ""), "level": (np.ones_like(z), "")}
            if "per_decade" in columns:
                logs["pause"] = (np.log10(t), "")
            if z.size > len(logs):
                out["exponent"] = _generalised(logs, np.log(rest), cov / rest[:, None] / rest[None, :])["exponent"]
    return out


def _generalised(columns: dict[str, tuple[Array, str]], y: Array, cov: Array) -> dict[str, Estimate]:
    """Generalised least squares of y (m,) on the columns; sigma with the scatter factor."""
    whiten = np.linalg.inv(np.linalg.cholesky(cov))
    x = whiten @ np.stack([c for c, _ in columns.values()], axis=1)
    inverse = np.linalg.pinv(x.T @ x)
    p = inverse @ (x.T @ (whiten @ y))
    chi2 = float(np.sum((whiten @ y - x @ p) ** 2))
    factor = scatter_factor(chi2, y.size - p.size)
    return {
        k: Estimate(float(p[i]), factor * math.sqrt(float(inverse[i, i])), unit, y.size, chi2)
        for i, (k, (_, unit)) in enumerate(columns.items())
    }
