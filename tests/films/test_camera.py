"""Pixels to metres, against positions worked out by hand and an inverse written here."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy.ndimage import gaussian_filter, map_coordinates

from jumpvision.cli import main
from jumpvision.films.vision.camera import camera, straight_map, straight_points

PLAIN = {"scale": 2e-4, "up": "-y", "tilt": 0.0, "marks": (), "k1": 0.0, "k2": 0.0, "centre": (100.0, 50.0)}


def test_up_is_the_named_direction_of_the_image_and_a_tilted_rail_is_followed():
    """From (100, 50) to (110, 80): 10 columns right, 30 rows down. Moving 50 px along a rail 0.3 rad counter-clockwise
    of vertical a ball rises by 50 px of rail."""
    for up, height in (("-y", -30.0), ("+y", 30.0), ("+x", 10.0), ("-x", -10.0)):
        h = camera(**{**PLAIN, "up": up}).height([100, 110], [50, 80])
        assert h[1] - h[0] == pytest.approx(height * 2e-4, rel=1e-12)
    h = camera(**{**PLAIN, "tilt": 0.3}).height([100, 100 - 50 * np.sin(0.3)], [50, 50 - 50 * np.cos(0.3)])
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
    """Points seen at radius r are shown as at r (1 + k1 r^2 + k2 r^4)."""
    k1, k2 = 2e-6, 1e-12
    c = camera(**{**PLAIN, "k1": k1, "k2": k2})
    seen, angle = np.array([5.0, 58.0, 170.0]), np.array([0.3, 2.0, -1.0])
    true = seen * (1 + k1 * seen**2 + k2 * seen**4)
    x, y = c.undistorted(100 + seen * np.cos(angle), 50 + seen * np.sin(angle))
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


# ---- grain films straightened before they are matched

SHAPE = (160, 200)
CENTRE = np.array([99.5, 79.5])
K1 = 6e-6  # 10 % at the corners


def test_the_map_and_the_points_are_each_others_inverse():
    marks = np.column_stack([oblique(GRID) / 2, GRID])
    view = camera(**{**PLAIN, "scale": None, "marks": marks, "k1": 4e-8, "centre": (160.0, 120.0)})
    x, y = straight_map(view, (240, 320), view.scale)
    column, row = straight_points(view, (240, 320), view.scale, x.astype(float), y.astype(float))
    true_row, true_column = np.mgrid[:240, :320]
    assert column == pytest.approx(true_column, abs=2e-3)  # the maps are float32
    assert row == pytest.approx(true_row, abs=2e-3)
    # the straight picture is metric: equal steps in metres are equal steps in pixels
    world_row = [np.interp(r, np.arange(240), view.height(x[:, 150], y[:, 150])) for r in (50, 100, 150)]
    assert np.diff(world_row) == pytest.approx(-50 * view.scale, rel=1e-3)


def seen_through_the_lens(scene, shift):
    """The scene moved right by `shift` px, as the lens shows it: at (column, row) stands what was farther out."""
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    dx, dy = column - CENTRE[0], row - CENTRE[1]
    factor = 1 + K1 * (dx**2 + dy**2)
    at = [CENTRE[1] + dy * factor + 60, CENTRE[0] + dx * factor + 60 - shift]
    return map_coordinates(scene, at, order=3, mode="nearest")


def test_a_uniform_motion_through_a_lens_is_measured_uniform(tmp_path):
    """3.4 px a frame everywhere; without [calibration] the lens shows it 8 % slower at the sides."""
    rng = np.random.default_rng(2)
    scene = gaussian_filter(rng.normal(size=(SHAPE[0] + 120, SHAPE[1] + 120)), 1.6)
    scene = 120 + 45 * scene / scene.std()
    film = np.stack([seen_through_the_lens(scene, 3.4 * i) + rng.normal(0, 1, SHAPE) for i in range(2)])
    np.save(tmp_path / "g.npy", np.clip(np.rint(film), 0, 255).astype(np.uint8))
    text = '[grain_video]\nfile = "g.npy"\nframe_rate = 100.0\nscale = 1e-4\n'
    speeds = {}
    for name, lens in (("plain", ""), ("lens", f"[calibration]\nk1 = {K1}\n")):
        (tmp_path / "experiment.toml").write_text(text + lens)
        assert main(["piv", str(tmp_path), "--results", str(tmp_path / name), "--no-pictures"]) == 0
        with xr.open_dataset(tmp_path / name / "piv.nc") as d:
            speeds[name] = d.u.where(d.chc > 0).isel(t=0).values / (1e-4 * 100)
    # the matcher's own scatter on this texture is about 0.004 px a vector
    assert np.nanstd(speeds["lens"]) < 0.01
    assert np.nanmedian(speeds["lens"]) == pytest.approx(3.4, abs=0.01)
    assert np.nanstd(speeds["plain"]) > 0.08
