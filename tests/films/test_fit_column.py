"""Central column and jammed front: drawn plateau + exponential profiles, depths as in the thesis."""

import math

import numpy as np
import pytest
from scipy.special import ndtr

from jumpvision.estimate.estimate import fit_line
from jumpvision.films.grains.column import beta, beta_sensitivity, fit_column
from jumpvision.films.grains.front import fit_mu, jammed_thickness

Z = np.arange(0.5, 80.0) * 1e-3
V, L = 0.5, 0.046  # 46 mm: a^(8 mm) = 0.84, beta 57 deg


def profile(front):
    return V * np.exp(-np.maximum(Z - front, 0.0) / L)


def fits(rng, corner, noise):
    e = np.full(Z.size, noise * V)
    v = profile(corner) + rng.normal(0.0, e)
    f = jammed_thickness(Z, v, e, threshold=0.9)
    c = fit_column(Z, v, e, maximum=f.maximum, maximum_sigma=f.maximum_sigma, front=f.thickness, top=0.9, floor=0.1)
    return f, c


@pytest.mark.parametrize("corner", [0.005, 0.02])
def test_front_and_decay_with_their_true_errors(corner):
    rng, z = np.random.default_rng(3), []
    for _ in range(150):
        f, c = fits(rng, corner, 0.02)
        assert f.reason == "" and c.reason == ""
        true = corner + L * math.log(1.0 / 0.9)
        z.append([(f.thickness - true) / f.sigma, (f.maximum - V) / f.maximum_sigma,
                  (c.ln_a + 1 / L) / c.ln_a_sigma, (c.b + corner) / c.b_sigma])  # fmt: skip
    inside = np.mean(np.abs(z) < 1.0, axis=0)
    # 150 draws: 0.683 +- 3 * 0.038, b and ln a a little wider by the scatter factor
    assert np.all((inside > 0.565) & (inside < 0.81)), inside
    assert np.all(np.abs(np.mean(z, axis=0)) < 0.3)  # no bias: 3/sqrt(150) = 0.245, and curvature


def test_an_uncertain_greatest_speed_moves_the_exponential_by_its_sigma():
    """Speeds good to 0.5 %, their greatest one to 5 %: b, where the exponential reaches it, is off by 5 % of L. 300
    draws: 0.683 +- 3 * 0.027; without that part of sigma it would be covered in a tenth of them."""
    rng, inside = np.random.default_rng(8), []
    e = np.full(Z.size, 0.005 * V)
    for _ in range(300):
        seen, top = profile(0.01) + rng.normal(0.0, e), V * (1.0 + 0.05 * rng.standard_normal())
        c = fit_column(Z, seen, e, maximum=top, maximum_sigma=0.05 * V, front=0.02, top=0.9, floor=0.1)
        inside.append(abs(c.b + 0.01) < c.b_sigma)
    assert np.mean(inside) == pytest.approx(0.683, abs=0.081)


def test_the_largest_speed_is_the_plateau_not_the_noisiest_vector():
    rng = np.random.default_rng(5)
    e = np.full(Z.size, 0.05 * V)
    got = [jammed_thickness(Z, profile(0.02) + rng.normal(0.0, e), e, threshold=0.9).maximum for _ in range(60)]
    assert abs(np.mean(got) - V) < 0.01 * V  # the largest of 20 vectors would be 9 % too high


def test_beta_its_sigma_and_what_the_layer_does():
    k = math.log(math.sin(math.radians(57.4))) / 0.008
    value, sigma = beta(k, 0.02 * abs(k), 0.008)
    assert math.degrees(value) == pytest.approx(57.4)
    step = (beta(k * 1.001, 0.0, 0.008)[0] - beta(k * 0.999, 0.0, 0.008)[0]) / (0.002 * k)
    assert sigma == pytest.approx(abs(step) * 0.02 * abs(k), rel=1e-4)
    slope = (beta(k, 0.0, 0.0081)[0] - beta(k, 0.0, 0.0079)[0]) / 0.0002
    assert beta_sensitivity(k, 0.008) == pytest.approx(slope, rel=1e-3)
    assert math.isnan(beta(0.1, 0.1, 0.008)[0])


def test_what_cannot_be_fitted_is_nan_with_a_reason():
    e = np.full(Z.size, 0.01)
    still = jammed_thickness(Z, np.zeros(Z.size), e, threshold=0.9)
    assert math.isnan(still.thickness) and still.reason == "no moving grains: largest speed below 3 sigma"
    solid = jammed_thickness(Z, np.full(Z.size, V) + 1e-4 * np.sin(7e3 * Z), e, threshold=0.9)
    assert math.isnan(solid.thickness) and solid.reason
    none = fit_column(Z, np.zeros(Z.size), e, maximum=math.nan, maximum_sigma=0.0, front=math.nan, top=0.9, floor=0.1)
    assert math.isnan(none.ln_a) and none.reason
    with pytest.raises(ValueError, match="threshold"):
        jammed_thickness(Z, profile(0.01), e, threshold=1.2)


def test_a_sharp_front_is_found_between_its_vectors():
    """A plateau that ends in a step blurred by 0.8 mm, a vector every 2 mm: no point on the flank. The crossing of 0.9
    lies 1.2816 x 0.8 mm above the step; linear between two vectors it is known to 2 mm/sqrt(12)."""
    rng, step, blur = np.random.default_rng(9), 2e-3, 8e-4
    z, off = np.arange(2.0, 60.0, 2.0) * 1e-3, []
    e = np.full(z.size, 0.01 * V)
    for _ in range(100):
        place = rng.uniform(0.010, 0.040)
        f = jammed_thickness(z, V * ndtr((place - z) / blur) + rng.normal(0.0, e), e, threshold=0.9)
        assert f.reason == "" and f.sigma >= step / math.sqrt(12.0)
        off.append([(f.thickness - place + 1.2816 * blur) / f.sigma, (f.maximum - V) / f.maximum_sigma])
    off = np.array(off)
    assert np.sqrt(np.mean(off[:, 0] ** 2)) < 1.2  # the chord of a concave curve lies above it, never below
    assert np.all(np.abs(off[:, 0]) < math.sqrt(12.0))  # the true place is between the two vectors, or just beside
    # the median of the noise's larger values: 0.95 of the greatest is 5 sigma down and cuts nothing off
    assert 0.5 < np.mean(np.abs(off[:, 1]) < 1.0) < 0.85


def test_a_plug_that_yields_before_it_ends_is_no_exponential():
    """Falls by 2 % a vector, then at once: an exponential through its flank lies far from the crossing."""
    z = np.arange(2.0, 60.0, 2.0) * 1e-3
    share = np.interp(z, [0.0, 0.020, 0.030, 0.034, 0.036, 0.1], [1.0, 1.0, 0.94, 0.75, 0.2, 0.0])
    f = jammed_thickness(z, V * share, np.full(z.size, 0.002 * V), threshold=0.9)
    assert f.thickness == pytest.approx(0.030 + 0.004 * 0.04 / 0.19, abs=4e-4)  # 2 mm sampled, linear pieces


def test_mu_where_the_front_scatters_more_than_stated():
    """Stated sigmas of 0.2 to 1.2 mm, true scatter of 1 mm in each frame: few small sigmas must not decide."""
    rng, z, weighted = np.random.default_rng(10), [], []
    for _ in range(300):
        depth = np.linspace(0.005, 0.018, 20)
        s = np.exp(rng.uniform(math.log(2e-4), math.log(1.2e-3), 20))
        thick = 0.002 + 1.6 * depth + rng.normal(0.0, 1e-3, 20)
        line = fit_mu(depth, thick, s)
        z.append([(line.slope - 1.6) / line.slope_sigma, line.slope - 1.6])
        weighted.append(fit_line(depth, thick, s).slope - 1.6)
    z = np.array(z)
    assert abs(np.mean(np.abs(z[:, 0]) < 1.0) - 0.67) < 0.08  # 3 sqrt(0.67 0.33/300); Student's t of 18
    # sqrt(E[w^2])/E[w] = 1.34 for these weights: 0.75, +- 3 x 0.04 of 300 pairs
    assert np.std(z[:, 1]) < 0.87 * np.std(weighted)


def test_a_front_that_runs_on_in_a_jump_is_no_stray():
    depth = np.linspace(0.005, 0.018, 20)
    thick = 1.5 * depth + 2e-4 * np.sin(np.arange(20.0) ** 2)
    thick[-4:] += 0.006
    assert fit_mu(depth, thick, np.full(20, 3e-4)).n == 20
    thick[8] += 0.006
    assert fit_mu(depth, thick, np.full(20, 3e-4)).n == 19
