"""The cone's side in drawn velocity fields, and the front while the cone is broader than the column."""

import math

import numpy as np
import pytest
import xarray as xr
from scipy.ndimage import gaussian_filter

from jumpvision.estimate.mean import near_the_median
from jumpvision.experiment.results.fields import Column, ColumnGeometry
from jumpvision.experiment.stages.grains.cone import cone_fits, sides
from jumpvision.films.grains.grid import Plane
from jumpvision.films.grains.sides import Layer, cone_outline, cone_side
from tests.worlds.vector_fields import window_noise

R, FOOT, STEP, WINDOW = 0.0381, 0.5, 2.4e-3, 7.2e-3
FINE = 3e-4  # m: the fields are drawn and blurred by 1 mm on this grid, and read off every 8th point
X = (np.arange(41) - 20) * STEP
Y = -(np.arange(17) + 0.5) * STEP
NOISE = 0.005 * FOOT
LAYER = Layer(face=0.0, top=0.003, bottom=0.026)
OUTSIDE = {
    "fades evenly": lambda n, d: np.exp(-n / 0.012),
    "fades faster above": lambda n, d: np.exp(-n / (0.008 + 0.5 * d)),
    "falls linearly": lambda n, d: np.clip(1.0 - n / 0.03, 0.0, 1.0),
    "step, then fades": lambda n, d: 0.7 * np.exp(-n / 0.015),
    "step that ends below": lambda n, d: (1.0 - 0.4 * np.clip(1.0 - d / 0.03, 0.0, 1.0)) * np.exp(-n / 0.015),
}


def drawn(theta, outside, offset=0.0):
    """v [m/s] (ny, nx) of grains that move with the foot inside the cone and as `outside` says beside it."""
    x = np.arange(-199, 200) * FINE
    d = (np.arange(17 * 8) + 0.5) * FINE
    n = (np.abs(x - offset)[None] - (R - d[:, None] / math.tan(theta))) * math.sin(theta)
    share = np.where(n > 0.0, outside(np.maximum(n, 0.0), d[:, None]), 1.0)
    blurred = gaussian_filter(share, 0.001 / FINE, mode="nearest")
    return -FOOT * blurred[3::8, 199 - 160 : 199 + 161 : 8]


def plane(v):
    return Plane(v, np.full(v.shape, NOISE), np.isfinite(v), X, Y)


def side(v, start, layer=LAYER, **how):
    where = {"start": start, "speed": FOOT, "edge": R, "window": WINDOW, "blur": 0.001, "correlation_length": 3.0} | how
    return cone_side(plane(v), layer, **where)


def systematic(s):
    return math.degrees(math.hypot(s.theta_sigma, max(abs(s.shift_fitted), abs(s.shift_sharper))))


def test_the_side_is_where_grains_begin_to_lag_whatever_they_do_outside():
    """None of the five ways is the fitted expansion. 30 fields: 0.95 - 3 * 0.04 = 0.83 inside two sigma."""
    rng, inside, found = np.random.default_rng(3), [], {}
    for name, outside in OUTSIDE.items():
        for degrees in (45, 60):
            exact = drawn(math.radians(degrees), outside)
            for _ in range(3):
                v = exact + NOISE * window_noise(rng, Y.size, X.size, 3)
                s = side(v, (math.radians(degrees + 4), R - 0.001))
                if not s.reason:
                    error = math.degrees(s.theta) - degrees
                    inside.append(abs(error) < 2.0 * systematic(s))
                    found.setdefault(name, []).append(error)
    assert len(inside) >= 27  # a bend without a step may be lost in the noise of one frame
    assert np.mean(inside) > 0.83, np.mean(inside)
    for name, errors in found.items():
        # a step stands 0.3 V over 0.005 V of noise; a mere bend of one frame of 16 rows is known to two degrees or so
        bound = 0.6 if "step" in name else 5.0
        assert np.sqrt(np.mean(np.square(errors))) < bound, (name, errors)


def test_the_contour_of_the_speed_is_steeper_than_the_cone_where_grains_fade_faster_above():
    """With n0 = ln(1/0.9) L the contour lies n0/sin(theta) outside: 0.84 mm more for every 16 mm of depth here, with
    L = 8 mm + d/2 and n0 = 0.105 L; cot falls by 0.053/sin(theta): from 45 to 47.2 degrees."""
    theta = math.radians(45)
    v = drawn(theta, OUTSIDE["fades faster above"])
    outline = cone_outline(plane(v), LAYER, speed=0.9 * FOOT, reach=0.05, correlation_length=3.0)
    expected = math.degrees(math.atan2(1.0, 1.0 - 0.5 * math.log(1 / 0.9) / math.sin(theta)))
    assert math.degrees(outline.theta) == pytest.approx(expected, abs=0.5)  # blur, and linear between vectors


def test_the_axis_may_be_off_and_what_shows_no_side_says_so():
    rng = np.random.default_rng(0)
    v = drawn(math.radians(55), OUTSIDE["step, then fades"], offset=0.002)
    s = side(v + NOISE * window_noise(rng, *v.shape, 3), (math.radians(55), R))
    assert s.offset == pytest.approx(0.002, abs=1e-4)
    assert s.radius == pytest.approx(R, abs=3e-4)
    assert s.blur == pytest.approx(0.001, rel=0.15)
    assert "shorter than" in side(v, (1.0, R), LAYER._replace(bottom=0.01)).reason
    assert "vectors about both sides" in side(np.where(X < 0.0, v, np.nan), (1.0, R)).reason
    assert side(np.full(v.shape, -FOOT), (1.0, R)).reason


def test_mu_counts_only_while_the_cone_is_broader_than_the_column():
    """A cone of 45 degrees and mu 1.8, complete at R = 38.1 mm: later frames would halve mu."""
    z = np.linspace(0.008, 0.03, 20)
    thick = np.minimum(1.8 * z, 0.0345)  # the column of +-5 mm sees no apex
    one = np.ones(z.size)
    names = {
        "foot_depth": z, "jammed_thickness": thick, "jammed_thickness_sigma": 1e-4 * one, "max_speed": 0.5 * one,
        "foot_speed": 0.5 * one, "theta_deg": 45.0 * one, "theta_deg_sigma": one, "theta_shift_fitted_deg": 0.3 * one,
        "jammed_thickness_left": thick + 0.02 * z, "jammed_thickness_right": thick - 0.01 * z,
        "theta_shift_sharper_deg": -0.4 * one, "cone_radius": R * one, "cone_radius_sigma": 1e-3 * one,
        **dict.fromkeys(("beta_deg", "beta_deg_sigma", "log_a", "log_a_sigma", "theta_outline_deg",
                         "theta_outline_deg_sigma", "theta_bands_deg", "theta_bands_deg_sigma"), one),
    }  # fmt: skip
    data = xr.Dataset({k: ("t", v) for k, v in names.items()})
    data = Column.of(data, ColumnGeometry(0.9, 0.008, 0.005, 0.001, 1e-3, R, 0.05)).field
    data["theta_outline_deg"] = data.theta_deg + 4.0
    data["outline_radius"] = data.cone_radius
    fits = cone_fits(Column(data))
    assert fits["mu"].value == pytest.approx(1.8, abs=0.01)
    assert 8 <= fits["mu"].n < 20
    assert fits["mu_per_mm_of_axis"].value == pytest.approx(0.02, abs=1e-3)
    assert fits["theta_deg"].sigma == pytest.approx(math.hypot(1.0 / math.sqrt(20), 0.4))
    lost = data.assign(theta_deg=np.nan * data.theta_deg, theta_outline_deg=np.nan * data.theta_deg)
    without = cone_fits(Column(lost))
    assert without["mu"].n >= 16 and without["theta_deg"].reason

    on = data.assign(jammed_thickness=1.8 * data.foot_depth)  # a plug that runs on: every frame tells its mu
    assert cone_fits(Column(on))["mu"].n == 20


def test_where_the_side_is_chance_the_contour_stands_in_for_it():
    """Sides that contradict the contour in more than half of the frames: theta is the contour's, with what it may be
    off; one contour far from the others does not count."""
    rng = np.random.default_rng(7)
    contour = 44.0 + rng.normal(0.0, 4.0, 20)
    side = np.where(np.arange(20) < 14, contour + 25.0, contour)
    contour[5] = 120.0
    names = {"theta_deg": side, "theta_deg_sigma": np.full(20, 4.0), "theta_outline_deg": contour,
             "theta_shift_fitted_deg": np.zeros(20), "theta_shift_sharper_deg": np.zeros(20)}  # fmt: skip
    c = xr.Dataset({k: ("t", v) for k, v in names.items()})
    found, outline = sides(c, np.ones(20, bool))
    assert "begin to lag" in found.reason
    assert outline.n == 19
    assert abs(outline.value - 44.0) < 2.5 * outline.sigma < 3.0  # 4/sqrt(19) = 0.9
    clear = c.assign(theta_deg=("t", np.where(np.arange(20) < 4, contour + 25.0, 40.0)))
    assert sides(clear, np.ones(20, bool))[0].value == pytest.approx(40.0)
    values, sigma = np.array([60.0, 60.2, 59.7, 60.1, 31.0, np.nan]), np.array([0.3, 0.3, 0.3, 0.3, 0.4, 0.3])
    assert near_the_median(values, sigma, reject=4.0).tolist() == [True, True, True, True, False, False]
