"""Velocity gradients through the valid neighbours of each vector, and strain rates, with uncertainties."""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import Array


def overlap(distance: Array | float, correlation_length: float) -> Array:
    """Share of two windows that overlaps, (1 - d/L)+ along one axis: the correlation of their errors.

    distance: in grid steps. correlation_length: L = window width / grid step; 1 or less means independent vectors
    (75 % overlap: 4). In two dimensions the shares of both axes multiply.
    """
    if not correlation_length >= 0.0:
        raise ValueError(f"correlation_length = {correlation_length!r} must be >= 0 (window width / grid step)")
    length = max(1.0, correlation_length)
    return np.asarray(np.maximum(0.0, 1.0 - np.abs(distance) / length))


def correlated_variance(a: Array, correlation_length: float) -> float:
    """sum_kl a_k a_l rho_kl, a of shape (ny, nx): the variance of a sum whose k-th term has the signed sigma a_k."""
    reach = int(np.ceil(max(1.0, correlation_length))) - 1
    kernel = overlap(np.arange(-reach, reach + 1, dtype=float), correlation_length)
    spread = scipy.ndimage.convolve1d(
        scipy.ndimage.convolve1d(a, kernel, axis=0, mode="constant"), kernel, axis=1, mode="constant"
    )
    return float(np.sum(a * spread))


@dataclass(frozen=True)
class Gradients:
    """du/dx, du/dy, dv/dx, dv/dy [1/s], shape (ny, nx), x right and y up, with standard uncertainties.

    u_cov, v_cov [1/s^2]: covariance of the x and y derivative of one component (zero for a full, evenly weighted
    neighbourhood). NaN where the neighbourhood does not determine a plane.
    """

    u_x: Array
    u_y: Array
    v_x: Array
    v_y: Array
    u_x_sigma: Array
    u_y_sigma: Array
    v_x_sigma: Array
    v_y_sigma: Array
    u_cov: Array
    v_cov: Array


def gradients(
    u: ArrayLike,
    v: ArrayLike,
    x: ArrayLike,
    y: ArrayLike,
    u_sigma: ArrayLike,
    v_sigma: ArrayLike,
    valid: ArrayLike,
    *,
    half_width: int,
    correlation_length: float,
) -> Gradients:
    """Weighted least squares plane over the (2 half_width + 1)^2 neighbourhood of each valid vector.

    u, v, u_sigma, v_sigma [m/s] (sigma > 0 where valid), valid [bool]: shape (ny, nx). x (nx,), y (ny,) [m]: strictly
    monotonic either way; y is up, so it decreases along axis 0 of an image grid. Non-finite vectors count as invalid.
    correlation_length: window width / grid step (`grains.gradients`); it enters the sigmas, not the weights 1/sigma^2.

    A neighbour counts only where the chain of vectors that steps from it straight to the centre is valid, so no
    difference is taken across a hole. NaN at invalid vectors, and where the rest lie on one line.
    """
    # copies, contiguous and writable: each other layout would be compiled once more
    u, v, x, y, su, sv = (np.array(a, dtype=float, order="C") for a in (u, v, x, y, u_sigma, v_sigma))
    ok = np.asarray(valid, dtype=bool)
    for name, a in (("v", v), ("u_sigma", su), ("v_sigma", sv), ("valid", ok)):
        if u.ndim != 2 or a.shape != u.shape:
            raise ValueError(f"gradients: {name} has shape {a.shape}, u has {u.shape}; both must be (ny, nx)")
    for name, a, size in (("y", y, u.shape[0]), ("x", x, u.shape[1])):
        step = np.diff(a)
        if a.shape != (size,) or not (np.all(step > 0.0) or np.all(step < 0.0)):
            raise ValueError(f"gradients: {name} must be strictly monotonic with shape ({size},), got shape {a.shape}")
    if half_width < 1:
        raise ValueError(f"gradients: half_width = {half_width!r} must be a whole number >= 1")
    ok = ok & np.isfinite(u) & np.isfinite(v) & np.isfinite(su) & np.isfinite(sv)
    for name, s in (("u_sigma", su), ("v_sigma", sv)):
        if np.any(s[ok] <= 0.0):
            raise ValueError(
                f"gradients: {name} has a value <= 0 at a valid vector; standard uncertainties must be > 0"
            )
    rho = overlap(np.arange(2 * half_width + 1, dtype=float), correlation_length)
    gu = _planes(u, su, ok, x, y, half_width, rho)
    gv = _planes(v, sv, ok, x, y, half_width, rho)
    return Gradients(gu[0], gu[1], gv[0], gv[1], gu[2], gu[3], gv[2], gv[3], gu[4], gv[4])


@nb.njit(cache=True)
def _planes(f: Array, sigma: Array, ok: NDArray[np.bool_], x: Array, y: Array, h: int, rho: Array) -> Array:
    """(5, ny, nx): x slope, y slope, their sigmas and covariance. Compiles in about 2 s, once."""
    ny, nx = f.shape
    out = np.full((5, ny, nx), np.nan)
    side = 2 * h + 1
    used = np.zeros((side, side), dtype=np.bool_)
    pi, pj = np.empty(side * side, dtype=np.int64), np.empty(side * side, dtype=np.int64)
    wx, wy = np.empty(side * side), np.empty(side * side)
    for i in range(ny):
        for j in range(nx):
            if not ok[i, j]:
                continue
            used[:, :] = False
            used[h, h] = True
            n = 0
            for ring in range(h + 1):  # inside out: a cell is used when it and its step towards the centre are
                for di in range(-ring, ring + 1):
                    for dj in range(-ring, ring + 1):
                        if max(abs(di), abs(dj)) != ring:
                            continue
                        ii, jj = i + di, j + dj
                        if ii < 0 or jj < 0 or ii >= ny or jj >= nx or not ok[ii, jj]:
                            continue
                        ci = di - (1 if di > 0 else -1) if abs(di) == ring and di != 0 else di
                        cj = dj - (1 if dj > 0 else -1) if abs(dj) == ring and dj != 0 else dj
                        if not used[h + ci, h + cj]:
                            continue
                        used[h + di, h + dj] = True
                        pi[n], pj[n] = ii, jj
                        n += 1
            if n < 3:
                continue
            s = mx = my = mf = 0.0
            for k in range(n):
                w = sigma[pi[k], pj[k]] ** -2
                s += w
                mx += w * x[pj[k]]
                my += w * y[pi[k]]
                mf += w * f[pi[k], pj[k]]
            mx, my, mf = mx / s, my / s, mf / s
            sxx = sxy = syy = sxf = syf = 0.0
            for k in range(n):
                w = sigma[pi[k], pj[k]] ** -2
                dx, dy, df = x[pj[k]] - mx, y[pi[k]] - my, f[pi[k], pj[k]] - mf
                sxx += w * dx * dx
                sxy += w * dx * dy
                syy += w * dy * dy
                sxf += w * dx * df
                syf += w * dy * df
            det = sxx * syy - sxy * sxy
            if not det > 1e-9 * (sxx + syy) ** 2:  # all on one line
                continue
            for k in range(n):  # slope = sum of (wx, wy) f; the weight is kept times the point's own sigma
                e = sigma[pi[k], pj[k]]
                dx, dy = x[pj[k]] - mx, y[pi[k]] - my
                wx[k] = (syy * dx - sxy * dy) / (det * e)
                wy[k] = (sxx * dy - sxy * dx) / (det * e)
            vx = vy = vxy = 0.0
            for k in range(n):
                for m in range(n):
                    r = rho[abs(pi[k] - pi[m])] * rho[abs(pj[k] - pj[m])]
                    if r > 0.0:
                        vx += r * wx[k] * wx[m]
                        vy += r * wy[k] * wy[m]
                        vxy += r * wx[k] * wy[m]
            out[0, i, j] = (syy * sxf - sxy * syf) / det
            out[1, i, j] = (sxx * syf - sxy * sxf) / det
            out[2, i, j] = np.sqrt(vx)
            out[3, i, j] = np.sqrt(vy)
            out[4, i, j] = vxy
    return out


def shear_rate(u_x: Array, u_y: Array, v_x: Array, v_y: Array) -> Array:
    """sqrt((u_x - v_y)^2/2 + (u_y + v_x)^2/2), thesis eq. (22).

    It is gamma/sqrt(2) in simple shear u = gamma y, not gamma. It is never negative, so noise lifts its mean: where the
    true rate is below about two sigmas the value is mostly noise.
    """
    return np.sqrt(0.5 * (u_x - v_y) ** 2 + 0.5 * (u_y + v_x) ** 2)


def shear_rate_sigma(g: Gradients) -> Array:
    """Linear propagation; where the rate is exactly zero it has no direction, and the mean over directions is given."""
    a, b = g.u_x - g.v_y, g.u_y + g.v_x
    var_a = g.u_x_sigma**2 + g.v_y_sigma**2
    var_b = g.u_y_sigma**2 + g.v_x_sigma**2
    s2 = a * a + b * b
    with np.errstate(invalid="ignore", divide="ignore"):
        var = 0.5 * (a * a * var_a + b * b * var_b + 2.0 * a * b * (g.u_cov - g.v_cov)) / s2
    return np.sqrt(np.where(s2 == 0.0, 0.25 * (var_a + var_b), var))


def vorticity(u_y: Array, v_x: Array) -> Array:
    """v_x - u_y, twice the rotation rate, positive counter-clockwise."""
    return v_x - u_y


def vorticity_sigma(g: Gradients) -> Array:
    return np.hypot(g.v_x_sigma, g.u_y_sigma)


def divergence(u_x: Array, v_y: Array) -> Array:
    """u_x + v_y, the dilation rate of a plane flow, positive where grains move apart."""
    return u_x + v_y


def divergence_sigma(g: Gradients) -> Array:
    return np.hypot(g.u_x_sigma, g.v_y_sigma)


def swirl(u_x: Array, u_y: Array, v_x: Array, v_y: Array) -> Array:
    """Swirling strength [1/s], the imaginary part of the eigenvalues of the velocity gradient (Zhou et al. 1999,
    J. Fluid Mech. 387, 353); in a solid rotation half the vorticity, 0 in shear and strain."""
    return np.sqrt(np.maximum(-(0.25 * (u_x - v_y) ** 2 + u_y * v_x), 0.0))


def swirl_sigma(g: Gradients) -> Array:
    """Linear propagation; NaN where nothing swirls."""
    half = 0.5 * (g.u_x - g.v_y)
    of_u = (half * g.u_x_sigma) ** 2 + (g.v_x * g.u_y_sigma) ** 2 + 2.0 * half * g.v_x * g.u_cov
    of_v = (half * g.v_y_sigma) ** 2 + (g.u_y * g.v_x_sigma) ** 2 - 2.0 * half * g.u_y * g.v_cov
    strength = swirl(g.u_x, g.u_y, g.v_x, g.v_y)
    return 0.5 * np.sqrt(of_u + of_v) / np.where(strength > 0.0, strength, np.nan)
