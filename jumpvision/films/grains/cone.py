"""The jammed cone from its added mass against depth (thesis eq. 33), and from the packing alone (eqs. 29, 30)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array
from jumpvision.estimate.estimate import checked, checked_sigma, least_squares_fit, scatter_factor

NAN = math.nan


@dataclass(frozen=True)
class MassCurve:
    """slope dm_a/dz at the surface [kg/m] and narrowing = mu / tan theta, with their covariance (2, 2).

    The covariance holds the scatter factor; chi2 over n - 2 degrees of freedom. reason: why the values are NaN.
    """

    slope: float
    narrowing: float
    covariance: Array
    n: int
    chi2: float
    reason: str = ""


@dataclass(frozen=True)
class Cone:
    """C, mu, theta [rad] and their covariance (3, 3); chi2 over one degree of freedom where mu and theta were both
    given, else 0. reason: why the values are NaN."""

    C: float
    mu: float
    theta: float
    covariance: Array
    chi2: float
    reason: str = ""


def mass_curve(z: ArrayLike, slope: float, narrowing: float, R: float) -> Array:
    """m_a [kg] at the depths z [m] (33): slope z (1 - q + q^2/3), q = narrowing z / R, constant from q = 1 on."""
    d: Array = np.asarray(z, dtype=float)
    if narrowing > 0.0:
        d = np.minimum(d, R / narrowing)
    q = narrowing * d / R
    return np.asarray(slope * d * (1.0 - q + q * q / 3.0))


def fit_mass_curve(z: ArrayLike, mass: ArrayLike, sigma: ArrayLike, *, R: float) -> MassCurve:
    """Least squares of `mass_curve`; z > 0 [m], mass and its sigma [kg], shape (n,), NaN left out; R [m]: foot."""
    z, mass, sigma = checked("fit_mass_curve", z=z, mass=mass, sigma=sigma)
    checked_sigma("fit_mass_curve", sigma)
    use = np.isfinite(z) & np.isfinite(mass) & np.isfinite(sigma) & (z > 0.0)
    z, mass, sigma = z[use], mass[use], sigma[use]
    none = np.full((2, 2), NAN)
    if z.size < 4:
        return MassCurve(NAN, NAN, none, z.size, NAN, f"{z.size} depths with an added mass, the cone needs 4")
    steep = float(np.sum(mass * z / sigma**2) / np.sum(z * z / sigma**2))
    best = None
    for q in (0.1, 0.5, 0.9, 1.5):  # at the greatest depth: the corner where the cone is complete makes chi2 multimodal
        fit = least_squares_fit(
            lambda p: (mass - mass_curve(z, p[0], p[1], R)) / sigma,
            [steep * (1.0 + q), q * R / float(z.max())],
            scale=[abs(steep) or 1.0, R / float(z.max())],
        )
        if fit is not None and (best is None or fit[2] < best[2]):
            best = fit
    if best is None:
        equal = np.ptp(z) <= 1e-9 * float(z.max())
        why = f"all depths are {1e3 * z[0]:.3g} mm; a curve needs others" if equal else "no cone fits the added masses"
        return MassCurve(NAN, NAN, none, z.size, NAN, why)
    (slope, narrowing), cov, chi2 = best
    return MassCurve(float(slope), float(narrowing), cov * scatter_factor(chi2, z.size - 2) ** 2, z.size, chi2)


def solve_cone(
    curve: MassCurve, *, R: float, density: float, mu: tuple[float, float] | None, theta: tuple[float, float] | None
) -> Cone:
    """C, mu, theta from the mass curve and (value, sigma) of mu and theta [rad], at least one of them.

    density [kg/m^3]: phi rho of the bed, times the share of the foot that pushes grains (1/2 at the wall). C goes with
    1/density; mu and theta do not depend on it.
    """
    none = np.full((3, 3), NAN)

    def no(reason: str) -> Cone:
        return Cone(NAN, NAN, NAN, none, NAN, reason)

    if curve.reason:
        return no(curve.reason)
    if mu is None and theta is None:
        return no("m_a fixes only C tan(theta) and mu/tan(theta): mu of the front or theta of the bands is needed")
    s, s_sigma = curve.narrowing, math.sqrt(curve.covariance[1, 1])
    # a curve shows no bend where mu / tan theta is not 2 sigma above zero
    if not s > 0.0 or ((theta is None or mu is None) and s < 2.0 * s_sigma):
        return no("m_a does not bend over these depths: mu/tan(theta) is not determined")
    try:
        root = np.linalg.inv(np.linalg.cholesky(curve.covariance))  # whitens (slope, narrowing)
    except np.linalg.LinAlgError:  # one of them is known to nothing beside the other
        return no("m_a does not bend over these depths: mu/tan(theta) is not determined")
    area = density * math.pi * R * R

    def residual(p: Array) -> Array:
        seen = np.array([p[0] * area * p[1], p[1] / math.tan(p[2])])
        rows = [*(root @ (seen - [curve.slope, s]))]
        rows += [(p[1] - mu[0]) / mu[1]] if mu else []
        rows += [(p[2] - theta[0]) / theta[1]] if theta else []
        return np.array(rows)

    m0 = mu[0] if mu else s * math.tan(theta[0])  # type: ignore[index]
    t0 = theta[0] if theta else math.atan(mu[0] / s)  # type: ignore[index]
    if not (m0 > 0.0 and 0.0 < t0 < 0.5 * math.pi):
        return no(f"mu = {m0:.3g}, theta = {math.degrees(t0):.3g} deg: no cone")
    start = [curve.slope / (area * m0), m0, t0]
    fit = least_squares_fit(residual, start, scale=[abs(start[0]), m0, 0.1])
    if fit is None:
        return no("the cone could not be solved for")
    (c, m, t), cov, chi2 = fit
    return Cone(float(c), float(m), float(t), cov, chi2)


BETA_JAMMED = math.asin(math.sqrt(2.0 / 3.0))  # rad: regular tetrahedra of frictionless spheres, 54.74 deg


@dataclass(frozen=True)
class Packing:
    """Contact angles [rad] against the horizontal and growth rate mu = d z_jammed / d z of the jammed front."""

    beta_jammed: float
    beta_unjammed: float
    beta: float
    mu: float


def cone_growth(volume_fraction: float, critical: float) -> Packing:
    """mu = (1 - sin beta)/(phi_c/phi - 1), beta the mean of the jammed and the unjammed contact angle (eq. 30).

    volume_fraction: phi of the bed, below critical = phi_c (0.605 for poppy seeds): a bed at or above phi_c does not
    consolidate and eq. (30) has no value. ValueError then, and below phi_c sqrt(2/3), without unjammed angle.
    """
    low = critical * math.sin(BETA_JAMMED)
    if not (0.0 < critical < 1.0 and low <= volume_fraction < critical):
        raise ValueError(
            f"cone_growth: volume_fraction = {volume_fraction:g} must be in [{low:.3f}, {critical:g}) "
            f"for critical = {critical:g}: eq. (30) describes a bed looser than its critical packing"
        )
    ratio = critical / volume_fraction
    unjammed = math.asin(min(1.0, ratio * math.sin(BETA_JAMMED)))
    beta = 0.5 * (BETA_JAMMED + unjammed)
    return Packing(BETA_JAMMED, unjammed, beta, (1.0 - math.sin(beta)) / (ratio - 1.0))
