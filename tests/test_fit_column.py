"""Central column and jammed front: drawn plateau + exponential profiles, depths as in the thesis. About 7 s."""

import math

import numpy as np
import pytest

from jumpvision.fit.column import beta, beta_sensitivity, fit_column
from jumpvision.fit.front import fit_mu, jammed_thickness

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


@pytest.mark.parametrize("corner, noise", [(0.005, 0.02), (0.02, 0.02), (0.02, 0.01)])
def test_front_and_decay_with_their_true_errors(corner, noise):
    rng, z = np.random.default_rng(3), []
    for _ in range(150):
        f, c = fits(rng, corner, noise)
        assert f.reason == "" and c.reason == ""
        true = corner + L * math.log(1.0 / 0.9)
        z.append(
            [(f.thickness - true) / f.sigma, (f.maximum - V) / f.maximum_sigma, (c.ln_a + 1 / L) / c.ln_a_sigma,
             (c.b + corner) / c.b_sigma]
        )  # fmt: skip
    inside = np.mean(np.abs(z) < 1.0, axis=0)
    # 150 draws: 0.683 +- 3 * 0.038, b and ln a a little wider by the scatter factor
    assert np.all((inside > 0.565) & (inside < 0.81)), inside
    assert np.all(np.abs(np.mean(z, axis=0)) < 0.3)  # no bias: 3/sqrt(150) = 0.245, and curvature


def test_the_fit_of_logarithms_would_be_biased():
    """Speeds near the noise: a plain fit of the positive ones' logarithms flattens, ours does not."""
    rng, ours, logs = np.random.default_rng(4), [], []
    z, length = Z, 0.015
    e = np.full(z.size, 0.03 * V)
    for _ in range(60):
        v = V * np.exp(-z / length) + rng.normal(0.0, e)
        c = fit_column(z, v, e, maximum=V, maximum_sigma=0.0, front=0.0015, top=0.9, floor=0.1)
        ours.append((c.ln_a + 1.0 / length) / c.ln_a_sigma)
        logs.append(np.polyfit(z[v > 0], np.log(v[v > 0]), 1)[0])
    assert np.mean(logs) > -0.9 / length
    assert abs(np.mean(ours)) < 3.5 / math.sqrt(60)


def test_the_largest_speed_is_the_plateau_not_the_noisiest_vector():
    rng = np.random.default_rng(5)
    e = np.full(Z.size, 0.05 * V)
    got = [jammed_thickness(Z, profile(0.02) + rng.normal(0.0, e), e, threshold=0.9).maximum for _ in range(60)]
    assert abs(np.mean(got) - V) < 0.01 * V  # the largest of 20 vectors would be 9 % too high


def test_mu_from_noisy_fronts_with_outliers():
    rng, z = np.random.default_rng(6), []
    for _ in range(200):
        depth = np.linspace(0.002, 0.012, 25)
        s = rng.uniform(3e-4, 9e-4, 25)
        thick = 0.001 + 2.2 * depth + rng.normal(0.0, s)
        thick[7], thick[11] = thick[7] + 0.03, np.nan
        line = fit_mu(depth, thick, s)
        z.append((line.slope - 2.2) / line.slope_sigma)
    assert abs(np.mean(np.abs(z) < 1.0) - 0.69) < 0.1  # 3 * 0.033


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


def test_no_plateau_takes_the_speed_at_the_face():
    rng = np.random.default_rng(8)
    e = np.full(Z.size, 0.01 * V)
    got = [jammed_thickness(Z, V * np.exp(-Z / L) + rng.normal(0.0, e), e, threshold=0.9) for _ in range(40)]
    there = np.array([f.thickness for f in got if f.reason == ""])
    assert there.size >= 36
    assert np.median(there) == pytest.approx(L * math.log(1 / 0.9), abs=0.0006)  # half a grid step
