"""Speed of the grains in the column under the foot: profile, exponential decay, and the foot seen in it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from jumpvision.base.arrays import MAD, Array
from jumpvision.estimate.estimate import checked, checked_sigma, least_squares_fit, scatter_factor

from .front import LARGEST
from .gradients import overlap


def central_column(
    v: ArrayLike, v_sigma: ArrayLike, valid: ArrayLike, x: ArrayLike, *, half_width: float, correlation_length: float
) -> tuple[Array, Array]:
    """(speed, sigma) [m/s], positive DOWN, shape (ny,): the weighted mean over |x| <= half_width in each row.

    v, v_sigma [m/s], v positive up, valid [bool]: (ny, nx); x (nx,) [m] from the axis. correlation_length: window
    width / grid step (`grains.gradients`): errors of neighbours in a row are alike, and sigma holds it exactly. NaN
    in rows without a valid vector. Raises ValueError where no vector lies in the column.
    """
    x = np.asarray(x, float)
    near = np.flatnonzero(np.abs(x) <= half_width)
    if near.size == 0:
        raise ValueError(f"half_width = {half_width:g} m: no vector so close to the foot's axis; give a larger one")
    ok = np.asarray(valid, bool)[:, near]
    s = np.where(ok, np.asarray(v_sigma, float)[:, near], 1.0)
    weight = np.where(ok, s**-2.0, 0.0)
    total = weight.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        speed = -(weight * np.where(ok, np.asarray(v, float)[:, near], 0.0)).sum(axis=1) / total
        part = weight * s / total[:, None]
    rho = overlap(
        np.abs(np.subtract.outer(np.arange(near.size), np.arange(near.size))).astype(float), correlation_length
    )
    return speed, np.sqrt(np.einsum("yi,ij,yj->y", part, rho, part))


NAN = float("nan")


@dataclass(frozen=True)
class Column:
    """speed / maximum = a^(z + b), z [m] below the foot's face, for the depths z_from..z_to [m].

    a per metre (a < 1), ln_a [1/m], b [m]: -b is where the exponential reaches the maximum. Sigmas hold the scatter
    factor; chi2 over n - 2 degrees of freedom. reason: why the values are NaN.
    """

    a: float
    a_sigma: float
    b: float
    b_sigma: float
    ln_a: float
    ln_a_sigma: float
    z_from: float
    z_to: float
    n: int
    chi2: float
    reason: str = ""


def fit_column(
    z: ArrayLike,
    speed: ArrayLike,
    sigma: ArrayLike,
    *,
    maximum: float,
    maximum_sigma: float,
    front: float,
    top: float,
    floor: float,
) -> Column:
    """Weighted least squares of the exponential itself (not of its logarithm) below the jammed front.

    z [m] depth below the foot's face, increasing, shape (n,); speed, sigma [m/s] downward, NaN = no vector. maximum,
    maximum_sigma [m/s]: the frame's largest speed, and front [m]: the depth of the jammed front (`jammed_thickness`).
    top, floor: shares of the maximum between which the exponential is fitted (0.9 in the thesis; noise).

    Which depths count is decided by the fitted curve and the front, not by the noisy speed of each vector: leaving out
    the vectors that happen to be small would flatten the decay. Started from the fit of the logarithms.
    """
    z, speed, sigma = checked("fit_column", z=z, speed=speed, sigma=sigma)
    checked_sigma("fit_column", sigma)
    if not 0.0 < floor < top <= 1.0:
        raise ValueError(f"fit_column: floor = {floor!r}, top = {top!r}: 0 < floor < top <= 1 is needed")
    good = np.isfinite(z) & np.isfinite(speed) & np.isfinite(sigma)
    z, y, e = z[good], speed[good], sigma[good]
    if not (math.isfinite(front) and maximum > 0.0):
        return _none(0, "no jammed front in this frame")
    y, e = y / maximum, e / maximum
    start = z >= front
    small = np.flatnonzero(start & (y < max(floor, 0.1)))
    chosen = start & (np.arange(z.size) < (small[0] if small.size else z.size)) & (y > 0.0)
    if chosen.sum() < 3:
        return _none(int(chosen.sum()), "fewer than three vectors between the jammed front and the floor")
    slope, at0 = np.polyfit(z[chosen], np.log(y[chosen]), 1, w=y[chosen] / e[chosen])
    p, seen = np.array([min(slope, -1e-3 / np.ptp(z)), at0]), []
    fit = None
    # the depths are chosen from the fit: two or three rounds suffice, more means it hops between two sets
    for _ in range(10):
        log_model = p[0] * z + p[1]
        chosen = start & (log_model < math.log(top)) & (log_model > math.log(floor))
        if chosen.sum() < 3:
            return _none(int(chosen.sum()), "fewer than three vectors between the jammed front and the floor")
        key = (int(np.flatnonzero(chosen)[0]), int(np.flatnonzero(chosen)[-1]))
        if key in seen:
            break
        seen.append(key)
        zc, yc, ec = z[chosen], y[chosen], e[chosen]
        fit = _exponential(zc, yc, ec, p)
        if fit is None or not fit[0][0] < 0.0:
            return _none(int(chosen.sum()), "the speed does not decay with depth")
        p = fit[0]
    assert fit is not None
    p, cov, chi2 = fit
    n = int(zc.size)
    factor = scatter_factor(chi2, n - 2)
    k, b = float(p[0]), float(p[1] / p[0])
    k_sigma = factor * math.sqrt(float(cov[0, 0]))
    row = np.array([-b, 1.0]) / k  # b = p1/k
    b_sigma = math.hypot(factor * math.sqrt(float(row @ cov @ row)), maximum_sigma / maximum / k)
    a = math.exp(k)
    return Column(a, a * k_sigma, b, b_sigma, k, k_sigma, float(zc[0]), float(zc[-1]), n, chi2)


def _exponential(z: Array, y: Array, e: Array, start: Array) -> tuple[Array, Array, float] | None:
    """Weighted fit of y = exp(p0 z + p1)."""

    def share(q: Array) -> Array:
        return np.asarray(np.exp(np.minimum(q[0] * z + q[1], LARGEST)) / e)

    def jacobian(q: Array) -> Array:
        return np.stack([-share(q) * z, -share(q)], axis=1)

    return least_squares_fit(lambda q: y / e - share(q), start, scale=[1.0 / np.ptp(z), 1.0], jacobian=jacobian)


def beta(ln_a: float, ln_a_sigma: float, layer: float) -> tuple[float, float]:
    """(beta, sigma) [rad] = asin(a^Dz), the mean contact angle against the horizontal; layer = Dz [m].

    NaN where a >= 1 (speed not decaying). The angle rests on the chosen layer, 8 mm in the thesis (`beta_sensitivity`).
    """
    if not layer > 0.0:
        raise ValueError(f"beta: layer = {layer!r} m must be > 0 (0.008 in the thesis)")
    q = math.exp(ln_a * layer) if math.isfinite(ln_a) else NAN
    if not q < 1.0:
        return NAN, NAN
    return math.asin(q), q / math.sqrt(1.0 - q * q) * layer * ln_a_sigma


def beta_sensitivity(ln_a: float, layer: float) -> float:
    """d beta / d Dz [rad/m] = ln a tan beta: how far the chosen layer thickness alone moves beta."""
    return ln_a * math.tan(beta(ln_a, 0.0, layer)[0])


def _none(n: int, reason: str) -> Column:
    return Column(NAN, NAN, NAN, NAN, NAN, NAN, NAN, NAN, n, NAN, reason)


BELOW = (0.5, 1.5)  # windows below the face between which the grains are taken to move with the foot


class Plug(NamedTuple):
    """foot_y [m] (up, from the first place), foot_v [m/s] (up) and their standard uncertainties, shape (nt,)."""

    foot_y: Array
    foot_y_sigma: Array
    foot_v: Array
    foot_v_sigma: Array


def follow_plug(
    v: ArrayLike,
    v_sigma: ArrayLike,
    valid: ArrayLike,
    x: ArrayLike,
    y: ArrayLike,
    t: ArrayLike,
    *,
    half_width: float,
    window: float,
    correlation_length: float,
) -> Plug:
    """Mean velocity of the vectors just below the face on the axis, and its integral from the face at (0, 0), t[0].

    v, v_sigma [m/s], v up, valid [bool]: (ny, nx, nt); y (ny,) up and x (nx,) [m] from the face and axis at t[0];
    t (nt,) [s]. half_width [m] of the column; window [m]: side of the matched windows. NaN from the first time on that
    has no vector there. It is the foot only while the foot pushes grains: grains do not follow a foot that rises.
    """
    v, s, y, t = (np.asarray(a, dtype=float) for a in (v, v_sigma, y, t))
    ok = np.asarray(valid, dtype=bool)
    out = Plug(*(np.full(t.size, np.nan) for _ in Plug._fields))
    face = variance = 0.0
    for k in range(t.size):
        near = (y < face - BELOW[0] * window) & (y > face - BELOW[1] * window)
        down, sigma = central_column(
            v[near, :, k],
            s[near, :, k],
            ok[near, :, k],
            x,
            half_width=half_width,
            correlation_length=correlation_length,
        )
        rows = np.isfinite(down)
        if not rows.any():
            break
        speed = -float(np.mean(down[rows]))
        spread = float(np.max(sigma[rows]))  # the rows lie within one window: their errors are alike
        if k:
            half = 0.5 * (t[k] - t[k - 1])
            face += half * (speed + out.foot_v[k - 1])
            variance += half**2 * (spread**2 + out.foot_v_sigma[k - 1] ** 2)
        for a, value in zip(out, (face, np.sqrt(variance), speed, spread)):
            a[k] = value
    return out


def scatter_sigma(f: ArrayLike, valid: ArrayLike, correlation_length: float) -> float:
    """Standard uncertainty of one vector component from the second differences of neighbours along a row.

    f, valid: (ny, nx), any unit. Errors of neighbours are alike as far as their windows overlap (`grains.gradients`).
    The median of the differences keeps bands of shear out; what the flow itself curves over three vectors adds to it.
    NaN where fewer than 10 triples are valid.
    """
    f, ok = np.asarray(f, dtype=float), np.asarray(valid, dtype=bool)
    whole = ok[:, :-2] & ok[:, 1:-1] & ok[:, 2:]
    second = (f[:, :-2] - 2.0 * f[:, 1:-1] + f[:, 2:])[whole]
    if second.size < 10:
        return float("nan")
    rho = np.maximum(0.0, 1.0 - np.arange(1, 3) / max(1.0, correlation_length))
    return float(np.median(np.abs(second)) / MAD / np.sqrt(6.0 - 8.0 * rho[0] + 2.0 * rho[1]))
