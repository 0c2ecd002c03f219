"""The bed stage: light and threshold, series and pairs, marks and lens, packing relative to a reference."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from jumpvision.cli import main
from jumpvision.films.vision.surface import bed_height, bed_surface
from jumpvision.laboratory import write
from tests.worlds.bed_pictures import FLOOR, SCALE, side_view


def run_bed(folder, toml, *options) -> dict:
    (folder / "experiment.toml").write_text(toml)
    assert main(["bed", str(folder), "--results", str(folder / "r"), "--no-pictures", *options]) == 0
    return json.loads((folder / "r" / "bed.json").read_text())


IMAGE = f'[bed_image]\nfile = "bed.png"\nscale = {SCALE}\nfloor_row = {FLOOR}\n'


@pytest.mark.parametrize("light", [{"lamp": 0.45}, {"uneven": 0.5}, {"gamma": 0.7}, {"gamma": 2.2}], ids=str)
def test_the_height_does_not_depend_on_the_light(light, tmp_path):
    """Dimmer lamp, light from one side, a response curve that is given (not given, gamma 1.6 puts the bed 0.25 px low):
    within a twentieth of a pixel of the picture's true mean surface."""
    picture, true = side_view(0.15, 0, **light)
    write.picture(tmp_path / "bed.png", picture)
    found = run_bed(tmp_path, IMAGE + "".join(f"{k} = {v}\n" for k, v in light.items() if k == "gamma"))
    assert found["height_m"] == pytest.approx(true.mean(), abs=0.05 * SCALE)


def test_saturated_light_is_said_and_a_floor_is_needed_without_marks(tmp_path, capsys):
    write.picture(tmp_path / "bed.png", side_view(0.15, 0, lamp=1.3)[0])
    assert run_bed(tmp_path, IMAGE)["sigma_m"] > 0.05 * SCALE
    assert "light is saturated in 97 %" in capsys.readouterr().err
    (tmp_path / "experiment.toml").write_text(IMAGE.replace(f"floor_row = {FLOOR}", ""))
    assert main(["bed", str(tmp_path), "--results", str(tmp_path / "r2")]) == 1
    assert "[bed_image] floor_row: missing" in capsys.readouterr().err
    assert not (tmp_path / "r2" / "bed.json").exists()


def test_a_series_shows_the_settling_and_the_packing_of_its_last_picture(tmp_path):
    heights = np.array([0.1510, 0.1503, 0.1499, 0.1497])
    for i, h in enumerate(heights):
        write.picture(tmp_path / f"bed{i}.png", side_view(h, 3, noise=i)[0])
    series = IMAGE.replace("bed.png", "bed*.png") + "frame_rate = 2.0\n[params.bed]\nreference_fraction = 0.57\n"
    d = run_bed(tmp_path, series)
    s = d["series"]
    assert s["time_s"] == [0.0, 0.5, 1.0, 1.5]
    change, sigma = np.array(s["change_m"]), np.array(s["sigma_change_m"])
    # the same grains in all pictures: the change is known far better than the height
    assert (sigma[1:] < 0.3 * d["sigma_m"]).all()
    assert np.abs(change - (heights - heights[0]))[1:] == pytest.approx(0.0, abs=3 * sigma[1:].max())
    assert d["volume_fraction"] == pytest.approx(0.57 * heights[0] / heights[-1], abs=3 * d["sigma_volume_fraction"])
    assert d["sigma_volume_fraction"] < 3e-4
    first = run_bed(tmp_path, series, "--set", "bed_image.use=first")
    assert (first["volume_fraction"], first["picture"]) == (0.57, 0)


def test_a_tilted_view_and_a_lens_are_undone_by_calibration(tmp_path):
    """The picture warped by a known homography as a barrel lens shows it; marks are where its corners went: at (column,
    row) of the picture stands what was at the undistorted place, offset x (1 + k1 r^2)."""
    picture, true = side_view(0.15, 5)
    (ny, nx), k1 = picture.shape, 4e-7
    corner = np.float32([[30, 60], [390, 60], [390, 430], [30, 430], [210, 200], [100, 330]])
    h = cv2.getPerspectiveTransform(corner[:4], np.float32([[52, 75], [372, 50], [380, 437], [44, 425]]))
    centre = np.array([(nx - 1) / 2, (ny - 1) / 2])
    place = np.stack(np.meshgrid(np.arange(nx), np.arange(ny)), -1) - centre
    flat = centre + place * (1 + k1 * np.sum(place**2, -1, keepdims=True))
    source = cv2.perspectiveTransform(flat, np.linalg.inv(h)).astype(np.float32)
    bent = cv2.remap(picture, source[..., 0], source[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    seen = cv2.perspectiveTransform(corner[None], h)[0] - centre
    marks_px = seen.astype(float)
    for _ in range(20):  # where the lens shows the marks
        marks_px = seen / (1 + k1 * np.sum(marks_px**2, axis=1))[:, None]
    metres = np.column_stack([corner[:, 0] * SCALE, (FLOOR - corner[:, 1]) * SCALE])
    marks = np.column_stack([marks_px + centre, metres]).round(6).tolist()
    write.picture(tmp_path / "bed.png", bent)
    found = run_bed(tmp_path, f'[bed_image]\nfile = "bed.png"\n[calibration]\nk1 = {k1}\nmarks = {marks}\n')
    x, height = (np.array(found["profile"][k], float) / SCALE for k in ("x_m", "height_m"))
    inside = (x > 5) & (x < nx - 6) & np.isfinite(height)
    off = height[inside] - np.interp(x[inside], np.arange(nx), true / SCALE)
    # the floor is y = 0 of the marks; resampling blurs the glow of the grains: worst of twelve pictures 0.15
    assert abs(off.mean()) < 0.1
    assert abs(np.polyfit(x[inside], off, 1)[0]) * nx < 0.3  # no tilt is left over
    assert abs(run_bed(tmp_path, IMAGE)["height_m"] - true.mean()) > SCALE  # without calibration it is off


def test_a_picture_that_is_upside_down_is_refused():
    """Its floor is then light, its top grains: 0.29 was measured of it for 0.25."""
    y, x = np.mgrid[:200, :160]
    rng = np.random.default_rng(7)
    light = 30.0 + 170.0 / (1.0 + np.exp((y - 80.0 - 0.05 * x) / 1.2)) + rng.normal(0.0, 2.0, y.shape)
    assert bed_height(bed_surface(light, floor_row=180.0, method="edge"), 180.0).n > 100
    for method in ("edge", "threshold"):
        with pytest.raises(ValueError, match="upside down"):
            bed_surface(light[::-1], floor_row=180.0, method=method)
