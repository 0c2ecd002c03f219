"""Pixels to metres, against positions worked out by hand and an inverse written here."""

from __future__ import annotations

import numpy as np
import pytest

from jumpvision.films.vision.camera import camera

PLAIN = {"scale": 2e-4, "up": "-y", "tilt": 0.0, "marks": (), "k1": 0.0, "k2": 0.0, "centre": (100.0, 50.0)}


@pytest.mark.parametrize(("up", "height"), [("-y", -30.0), ("+y", 30.0), ("+x", 10.0), ("-x", -10.0)])
def test_up_is_the_named_direction_of_the_image(up, height):
    """From (100, 50) to (110, 80): 10 columns right, 30 rows down."""
    c = camera(**{**PLAIN, "up": up})
    h = c.height([100, 110], [50, 80])
    assert h[1] - h[0] == pytest.approx(height * 2e-4, rel=1e-12)


def test_a_tilted_rail_is_followed():
    """A ball moving 50 px along a rail 0.3 rad counter-clockwise of vertical rises by 50 px of rail."""
    c = camera(**{**PLAIN, "tilt": 0.3})
    h = c.height([100, 100 - 50 * np.sin(0.3)], [50, 50 - 50 * np.cos(0.3)])
    assert h[1] - h[0] == pytest.approx(50 * 2e-4, rel=1e-12)


def test_marks_give_scale_and_rotation():
    """Four marks seen by a camera rolled by 0.1 rad with 0.25 mm/px."""
    rng = np.random.default_rng(3)
    world = rng.uniform(-0.05, 0.05, (4, 2))
    z = (world[:, 0] + 1j * world[:, 1] - (0.01 + 0.02j)) * np.exp(-0.1j) / 2.5e-4
    seen = np.column_stack([z.real + 200, 300 - z.imag])
    c = camera(**{**PLAIN, "scale": None, "marks": np.column_stack([seen, world])})
    assert c.scale == pytest.approx(2.5e-4, rel=1e-9)
    assert c.height(seen[:, 0], seen[:, 1]) == pytest.approx(world[:, 1], abs=1e-12)


def test_radial_distortion_is_undone():
    """Points distorted by solving seen (1 + k1 r^2 + k2 r^4) = true for the seen radius."""
    k1, k2 = 2e-6, 1e-12
    c = camera(**{**PLAIN, "k1": k1, "k2": k2})
    true = np.array([5.0, 60.0, 180.0])
    roots = []
    for r in true:
        found = np.roots([k2, 0, k1, 0, 1, -r])
        roots.append(
            float(
                found[np.abs(found.imag) < 1e-9].real.min(
                    initial=np.inf, where=found[np.abs(found.imag) < 1e-9].real > 0
                )
            )
        )
    angle = np.array([0.3, 2.0, -1.0])
    x, y = c.undistorted(100 + roots * np.cos(angle), 50 + roots * np.sin(angle))
    assert x == pytest.approx(100 + true * np.cos(angle), abs=1e-9)
    assert y == pytest.approx(50 + true * np.sin(angle), abs=1e-9)


def test_without_scale_and_marks_it_says_what_to_give():
    with pytest.raises(ValueError, match=r"metres per pixel"):
        camera(**{**PLAIN, "scale": None})
    with pytest.raises(ValueError, match="two different points"):
        camera(**{**PLAIN, "marks": [[1, 1, 0, 0], [1, 1, 0, 0]]})


def oblique(world: np.ndarray) -> np.ndarray:
    """Columns, rows of points (x, y) [m] seen by a pinhole 0.5 m away, turned 0.25 rad to the side and 0.1 rad up."""
    a, b = 0.25, 0.1
    x, y, z = world[:, 0], world[:, 1], np.zeros(len(world))
    x, z = np.cos(a) * x + np.sin(a) * z, -np.sin(a) * x + np.cos(a) * z
    y, z = np.cos(b) * y - np.sin(b) * z, np.sin(b) * y + np.cos(b) * z
    return np.column_stack([320 + 1500 * x / (0.5 + z), 240 - 1500 * y / (0.5 + z)])


GRID = np.array([[x, y] for x in (-0.08, -0.02, 0.07) for y in (-0.06, 0.01, 0.05)])


def test_marks_in_one_line_show_no_perspective():
    """Five marks along a ruler, one clicked 3 px off along it: no homography is determined, the similarity stands."""
    pixel = np.column_stack([[0.0, 100.0, 203.0, 300.0, 400.0], np.full(5, 50.0)])
    metre = np.column_stack([np.arange(5) * 1e-2, np.zeros(5)])
    c = camera(**{**PLAIN, "scale": None, "marks": np.column_stack([pixel, metre])})
    assert c.homography is None and c.scale == pytest.approx(1e-4, rel=1e-3)


def test_marks_seen_at_an_angle_give_the_perspective():
    """Nine marks clicked to 0.1 px; other points must come out within what that leaves (0.1 px of 0.33 mm/px)."""
    rng = np.random.default_rng(5)
    marks = np.column_stack([oblique(GRID) + rng.normal(0, 0.1, GRID.shape), GRID])
    c = camera(**{**PLAIN, "scale": None, "marks": marks})
    assert c.homography is not None and c.residual_px < 0.3
    world = rng.uniform(-0.05, 0.05, (50, 2))
    column, row = oblique(world).T
    assert c.height(column, row) == pytest.approx(world[:, 1], abs=1e-4)
    assert c.across(column, row) == pytest.approx(world[:, 0], abs=1e-4)
    four = camera(**{**PLAIN, "scale": None, "marks": np.column_stack([oblique(GRID), GRID])[[0, 2, 6, 8]]})
    assert four.height(column, row) == pytest.approx(world[:, 1], abs=1e-9)


def test_marks_seen_straight_on_stay_a_similarity():
    """Clicked to 0.3 px: a homography would follow the clicks. It is called in 1 of 100 cases by construction."""
    called = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        seen = np.column_stack([320 + GRID[:, 0] / 3e-4, 240 - GRID[:, 1] / 3e-4]) + rng.normal(0, 0.3, GRID.shape)
        called += camera(**{**PLAIN, "scale": None, "marks": np.column_stack([seen, GRID])}).homography is not None
    assert called <= 5  # 1 expected, 3 sigma of a binomial more


def test_a_crop_is_straight_about_the_sensor_s_middle_and_bent_about_its_own():
    """Points of a straight rail as a lens of k1 = -4e-8 on a sensor of 1280 x 1024 shows them, in a crop of 400 x 600
    at column 700, row 300. The bend about the wrong middle is that of the formula: 3 k1 r (distance of the middles)."""
    corner, sensor = np.array([700.0, 300.0]), np.array([639.5, 511.5])
    seen = np.column_stack([np.full(7, 150.0), np.linspace(20.0, 580.0, 7)])  # px, in the crop
    whole = camera(**{**PLAIN, "k1": -4e-8, "centre": tuple(sensor)})
    crop = camera(**{**PLAIN, "k1": -4e-8, "centre": tuple(sensor - corner)})
    bare = camera(**{**PLAIN, "k1": -4e-8, "centre": (199.5, 299.5)})
    truth = whole.height(*(seen + corner).T)
    assert np.ptp(crop.height(*seen.T) - truth) < 1e-12
    off = bare.height(*seen.T) - truth
    assert np.ptp(off - np.polyval(np.polyfit(seen[:, 1], off, 1), seen[:, 1])) > 1e-4  # m: that was not in any sigma
