"""The saturating cone from drawn added masses, and the sides of a cone in drawn velocity fields."""

import math

import numpy as np
import pytest

from jumpvision.films.grains.cone import fit_mass_curve, mass_curve, solve_cone
from jumpvision.films.grains.gradients import gradients, shear_rate, shear_rate_sigma
from jumpvision.films.grains.grid import Plane
from jumpvision.films.grains.sides import Layer, cone_outline, shear_bands
from jumpvision.jumper.mechanisms.cone import cone_mass
from tests.worlds.vector_fields import window_noise

R, C, MU, THETA, DENSITY = 0.0381, 2.7, 2.0, math.radians(60.0), 285.0
Z = np.linspace(0.004, 0.030, 25)


def masses(z=Z):
    """Equation (33) as the force terms have it (the fit has its own form of it)."""
    return np.array([cone_mass(np, z=a, C=C, mu=MU, theta=THETA, R=R, phi=0.57, rho=DENSITY / 0.57) for a in z])


def test_the_curve_is_equation_33_also_beyond_the_complete_cone():
    z = np.linspace(0.0, 0.06, 200)  # complete at R tan(60 deg)/2 = 33 mm
    slope = C * DENSITY * math.pi * R**2 * MU
    assert mass_curve(z, slope, MU / math.tan(THETA), R) == pytest.approx(masses(z), rel=1e-12)


def test_c_mu_theta_with_their_true_errors():
    rng, z = np.random.default_rng(5), []
    s = 0.01 * masses() + 2e-4
    for _ in range(200):
        curve = fit_mass_curve(Z, masses() + rng.normal(0.0, s), s, R=R)
        mu, theta = (rng.normal(MU, 0.03), 0.03), (rng.normal(THETA, 0.02), 0.02)
        cone = solve_cone(curve, R=R, density=DENSITY, mu=mu, theta=theta)
        assert cone.reason == ""
        e = np.array([cone.C - C, cone.mu - MU, cone.theta - THETA])
        z.append([*(e / np.sqrt(np.diag(cone.covariance))), e @ np.linalg.solve(cone.covariance, e)])
    z = np.array(z)
    inside = np.mean(np.abs(z[:, :3]) < 1.0, axis=0)
    # 200 draws: 0.683 +- 3 * 0.033, and the scatter factor widens by 0.2/sqrt(23) = 4 %
    assert np.all((inside > 0.58) & (inside < 0.81)), inside
    assert np.all(np.abs(z[:, :3].mean(axis=0)) < 0.3)  # 3/sqrt(200) = 0.21, and C = slope/mu is curved
    assert 2.2 < z[:, 3].mean() < 3.5  # of the whole covariance: 3 +- 0.52, 8 % less by the scatter factor
    exact = fit_mass_curve(Z, masses(), s, R=R)
    for known in ({"mu": (MU, 0.03), "theta": None}, {"mu": None, "theta": (THETA, 0.02)}):
        cone = solve_cone(exact, R=R, density=DENSITY, **known)
        assert [cone.C, cone.mu, cone.theta] == pytest.approx([C, MU, THETA], rel=1e-3)


def test_masses_that_scatter_more_than_stated_widen_the_curve_as_much():
    """Of masses k times noisier than stated the covariance is k^2 times what is stated, in the mean (chi2/dof)."""
    rng, s, noisier = np.random.default_rng(6), 0.01 * masses() + 2e-4, 4.0
    stated = fit_mass_curve(Z, masses(), s, R=R).covariance
    found = [fit_mass_curve(Z, masses() + rng.normal(0.0, noisier * s), s, R=R).covariance for _ in range(100)]
    ratio = np.median([np.diag(c) for c in found], axis=0) / np.diag(stated)
    # chi2/dof scatters by sqrt(2/23) = 0.29, its median of 100 by 0.036; the curve's bend by a little
    assert ratio == pytest.approx(noisier**2, rel=0.15)


def test_the_added_mass_alone_does_not_tell_c_from_theta():
    s = np.full(Z.size, 2e-4)
    curve = fit_mass_curve(Z, masses(), s, R=R)
    cone = solve_cone(curve, R=R, density=DENSITY, mu=None, theta=None)
    assert math.isnan(cone.C) and "C tan(theta)" in cone.reason
    # another cone with the same C tan(theta) and mu/tan(theta) has the same masses
    t = math.radians(45.0)
    same = {"C": C * math.tan(THETA), "mu": MU / math.tan(THETA), "theta": t}
    other = [cone_mass(np, z=a, R=R, phi=0.57, rho=DENSITY / 0.57, **same) for a in Z]
    assert np.array(other) == pytest.approx(masses(), rel=1e-12)


def test_too_short_a_range_says_so():
    z = np.linspace(0.002, 0.004, 12)
    s = np.full(z.size, 0.02 * masses(z).max())
    rng = np.random.default_rng(1)
    said = set()
    for _ in range(20):
        curve = fit_mass_curve(z, masses(z) + rng.normal(0.0, s), s, R=R)
        said.add(solve_cone(curve, R=R, density=DENSITY, mu=(MU, 0.03), theta=None).reason)
    assert any("does not bend" in text for text in said)
    assert "needs 4" in fit_mass_curve(z[:3], masses(z[:3]), s[:3], R=R).reason
    level = np.full(6, 0.012)
    assert fit_mass_curve(level, masses(level), s[:6], R=R).reason == "all depths are 12 mm; a curve needs others"


X, Y, FOOT = np.arange(-45, 46) * 1e-3, -(np.arange(45) + 0.5) * 1e-3, 0.5


LAYER = Layer(face=0.0, top=0.003, bottom=0.018)


def banded(theta, thickness=0.004, height=0.022, offset=0.0):
    """v [m/s]: the foot's inside a cone of half width R at the face, falling like tanh across bands at theta."""
    d = -Y[:, None]
    across = (np.abs(X - offset)[None] - (R - d / math.tan(theta))) / thickness
    return -FOOT * 0.5 * (1.0 - np.tanh(across)) * np.exp(-np.maximum(d - height, 0.0) / 0.02)


@pytest.mark.parametrize(("degrees", "length"), [(50, 3), (70, 1)])
def test_angle_of_the_bands_within_two_degrees_and_inside_sigma(degrees, length):
    rng, errors = np.random.default_rng(degrees + length), {"bands": [], "outline": []}
    noise, ok = 0.01 * FOOT, np.ones((Y.size, X.size), bool)
    s = np.full(ok.shape, noise)
    for _ in range(25):
        u, v = (noise * window_noise(rng, *ok.shape, length) for _ in range(2))
        v = v + banded(math.radians(degrees))
        g = gradients(u, v, X, Y, s, s, ok, half_width=1, correlation_length=length)
        rate, sigma = shear_rate(g.u_x, g.u_y, g.v_x, g.v_y), shear_rate_sigma(g)
        where = {"reach": 1.3 * R, "correlation_length": length}
        found = {"bands": shear_bands(rate, sigma, X, Y, LAYER, **where),
                 "outline": cone_outline(Plane(v, s, ok, X, Y), LAYER, speed=0.9 * FOOT, **where)}  # fmt: skip
        for name, side in found.items():
            assert side.reason == ""
            e = math.degrees(side.theta) - degrees
            errors[name].append((e, e / math.degrees(side.theta_sigma)))
    for name, pairs in errors.items():
        e, z = np.array(pairs).T
        assert np.abs(e).max() < (2.5 if name == "bands" else 2.0), (name, e)  # largest of 25; one sigma 0.3 to 0.9
        assert abs(e.mean()) < 0.6 and math.sqrt(np.mean(e**2)) < 1.0, name
        # 25 draws: 0.683 +- 3 * 0.093
        assert 0.4 < np.mean(np.abs(z) < 1.0) < 0.965, (name, np.mean(np.abs(z) < 1.0))


def test_the_axis_may_be_off_and_no_band_is_said():
    ok = np.ones((Y.size, X.size), bool)
    v = banded(math.radians(60), offset=0.003)
    plane, where = Plane(v, 0.0 * v, ok, X, Y), {"reach": 0.045, "correlation_length": 1.0}
    side = cone_outline(plane, LAYER, speed=0.9 * FOOT, **where)
    # |x - 3 mm| at 0.9 is inside R by 4 mm atanh(0.8) = 4.4 mm; linear between vectors of 1 mm: 0.05 mm
    assert side.offset == pytest.approx(0.003, abs=5e-5)
    assert side.radius == pytest.approx(R - 0.004 * math.atanh(0.8), abs=1e-4)
    assert math.degrees(side.theta) == pytest.approx(60.0, abs=0.2)
    still = shear_bands(np.zeros(ok.shape), np.ones(ok.shape), X, Y, LAYER, **where)
    assert math.isnan(still.theta) and "found in 0 rows" in still.reason


def test_a_mass_that_rises_and_falls_and_one_that_falls_are_no_cones():
    """Of a film of discs: the foot slows down, the grains run on. Slope and narrowing only show together."""
    z = np.array([5.54, 11.31, 12.83, 13.6, 14.36, 15.1, 15.81, 16.49, 17.12, 17.69]) * 1e-3
    mass = np.array([19.35, 38.64, 24.0, 17.27, 11.7, 8.76, 9.07, 10.66, 14.06, 19.13]) * 1e-3
    falling = 0.05 - 3.0 * (z - 0.015) + 1e-3 * np.random.default_rng(3).standard_normal(z.size)
    for m in (mass, falling):
        curve = fit_mass_curve(z, m, np.full(z.size, 3e-4), R=R)
        cone = solve_cone(curve, R=R, density=DENSITY, mu=(2.0, 0.1), theta=None)
        assert cone.reason and math.isnan(cone.C)
