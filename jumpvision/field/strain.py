"""Shear, rotation and dilation rates from velocity gradients [1/s], x right and y up, with standard uncertainties.

The errors of u and v are taken as independent of each other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jumpvision.field.gradients import Gradients

Array = NDArray[np.float64]


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


def axisymmetric_divergence(u_x: Array, v_y: Array, u: Array, x: Array, axis_x: float) -> Array:
    """u_x + v_y + u/(x - axis_x) = d u_r/dr + u_r/r + dv/dy, assuming azimuthal symmetry about the foot's axis.

    u (ny, nx) [m/s], x (nx,) and axis_x [m]. Both signs of r cancel, so it holds on either side. In the column on the
    axis (nearer than half a grid step) u/r is its limit u_x.
    """
    r = _radius(x, axis_x)
    return u_x + v_y + np.where(np.isnan(r), u_x, u / r)


def axisymmetric_divergence_sigma(g: Gradients, u_sigma: Array, x: Array, axis_x: float) -> Array:
    """Linear propagation, u and its derivative taken as independent (exact for a symmetric neighbourhood)."""
    r = _radius(x, axis_x)
    hoop = np.where(np.isnan(r), 0.0, u_sigma / np.abs(r))
    return np.sqrt(np.where(np.isnan(r), 4.0, 1.0) * g.u_x_sigma**2 + g.v_y_sigma**2 + hoop**2)


def _radius(x: Array, axis_x: float) -> Array:
    """Signed distance from the axis [m], shape (1, nx); NaN in the column on the axis."""
    x = np.asarray(x, dtype=float)
    step = np.min(np.abs(np.diff(x)))
    r = x - axis_x
    return np.where(np.abs(r) < 0.5 * step, np.nan, r)[None, :]
