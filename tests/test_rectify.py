"""Grain films through a lens and at an angle, straightened before they are matched."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy.ndimage import gaussian_filter, map_coordinates
from test_camera import GRID, PLAIN, oblique

from jumpvision.cli import main
from jumpvision.films.vision.camera import camera, straight_map, straight_points

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
