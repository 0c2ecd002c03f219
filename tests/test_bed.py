"""The bed stage: light and threshold, series and pairs, marks and lens, packing relative to a reference."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from jumpvision.cli import main
from jumpvision.films.vision.surface import bed_height, bed_surface
from jumpvision.laboratory import write
from jumpvision.laboratory.films.bed import bed_picture
from jumpvision.laboratory.films.optics import record

SCALE, FLOOR = 5e-4, 420.0


def side_view(height: float, seed: int, *, lamp: float = 1.0, uneven: float = 0.0, noise: int = 0, gamma: float = 1.0):
    """(8-bit picture, true surface (column,) [m]) of a bed; the same seed gives the same grains."""
    rng = np.random.default_rng(seed)
    mean, surface = bed_picture(height, scale=SCALE, floor_row=FLOOR, shape=(450, 420), grain_diameter=1e-3, rng=rng)
    mean = mean * lamp * (1.0 - uneven * np.linspace(0, 1, mean.shape[1]))
    mean = 255.0 * (mean / 255.0) ** (1.0 / gamma)  # camera's response
    return record(mean, electrons_per_grey=40.0, read_noise=1.5, rng=np.random.default_rng(1000 + noise)), surface


def run_bed(folder, toml, *options) -> dict:
    (folder / "experiment.toml").write_text(toml)
    assert main(["bed", str(folder), "--results", str(folder / "r"), "--no-pictures", *options]) == 0
    return json.loads((folder / "r" / "bed.json").read_text())


IMAGE = f'[bed_image]\nfile = "bed.png"\nscale = {SCALE}\nfloor_row = {FLOOR}\n'


@pytest.mark.parametrize("light", [{}, {"lamp": 0.45}, {"uneven": 0.5}], ids=str)
def test_the_height_does_not_depend_on_the_light(light, tmp_path):
    """Dimmer lamp, light from one side: within a twentieth of a pixel of the picture's true mean surface."""
    for seed in range(2):
        picture, true = side_view(0.15 + 0.0004 * seed, seed, **light)
        write.picture(tmp_path / "bed.png", picture)
        assert run_bed(tmp_path, IMAGE)["height_m"] == pytest.approx(true.mean(), abs=0.05 * SCALE)


@pytest.mark.parametrize("gamma", [0.7, 1.6, 2.2])
def test_a_response_curve_that_is_given_is_undone(gamma, tmp_path):
    """Not given, gamma 1.6 puts the bed 0.25 px low."""
    for seed in range(2):
        picture, true = side_view(0.15 + 0.0004 * seed, seed, gamma=gamma)
        write.picture(tmp_path / "bed.png", picture)
        found = run_bed(tmp_path, IMAGE + f"gamma = {gamma}\n")
        assert found["height_m"] == pytest.approx(true.mean(), abs=0.05 * SCALE)


def test_saturated_light_is_said(tmp_path, capsys):
    write.picture(tmp_path / "bed.png", side_view(0.15, 0, lamp=1.3)[0])
    plain = run_bed(tmp_path, IMAGE)
    assert "light is saturated in 97 %" in capsys.readouterr().err
    assert plain["sigma_m"] > 0.05 * SCALE
    write.picture(tmp_path / "bed.png", side_view(0.15, 0)[0])
    run_bed(tmp_path, IMAGE)
    assert "light is saturated" not in capsys.readouterr().err


def write_series(folder, heights, *, seed=3):
    for i, h in enumerate(heights):
        write.picture(folder / f"bed{i}.png", side_view(h, seed, noise=i)[0])


SERIES = IMAGE.replace("bed.png", "bed*.png") + "frame_rate = 2.0\n"


def test_a_series_shows_the_settling_and_the_packing_of_its_last_picture(tmp_path):
    heights = np.array([0.1510, 0.1503, 0.1499, 0.1497])
    write_series(tmp_path, heights)
    d = run_bed(tmp_path, SERIES + "[params.bed]\nreference_fraction = 0.57\n")
    s = d["series"]
    assert s["time_s"] == [0.0, 0.5, 1.0, 1.5]
    change, sigma = np.array(s["change_m"]), np.array(s["sigma_change_m"])
    # the same grains in all pictures: the change is known far better than the height
    assert (sigma[1:] < 0.3 * d["sigma_m"]).all()
    assert np.abs(change - (heights - heights[0]))[1:] == pytest.approx(0.0, abs=3 * sigma[1:].max())
    assert d["volume_fraction"] == pytest.approx(0.57 * heights[0] / heights[-1], abs=3 * d["sigma_volume_fraction"])
    assert d["sigma_volume_fraction"] < 3e-4
    first = run_bed(tmp_path, SERIES + "[params.bed]\nreference_fraction = 0.57\n", "--set", "bed_image.use=first")
    assert (first["volume_fraction"], first["picture"]) == (0.57, 0)


@pytest.mark.long
def test_the_sigma_of_a_change_is_its_error(tmp_path):
    """24 changes of one bed by parts of a pixel; 0.683 +- 3 * 0.095, and the rms of z about one."""
    rng = np.random.default_rng(0)
    heights = 0.15 + np.r_[0.0, rng.uniform(-1e-3, 1e-3, 24)]
    z = []
    for k, seed in enumerate((1, 2, 3)):
        part = heights[[0, *range(1 + 8 * k, 9 + 8 * k)]]
        (tmp_path / str(k)).mkdir()
        write_series(tmp_path / str(k), part, seed=seed)
        s = run_bed(tmp_path / str(k), SERIES)["series"]
        z += list(
            ((np.array(s["change_m"]) - (part - part[0])) / np.where(part == part[0], 1, s["sigma_change_m"]))[1:]
        )
    assert abs(np.mean(np.abs(z) < 1.0) - 0.683) < 0.285
    assert 0.4 < np.sqrt(np.mean(np.square(z))) < 1.6


def test_a_tilted_view_and_a_lens_are_undone_by_calibration(tmp_path):
    """The picture warped by a known homography, then by a barrel lens; marks are where its corners went."""
    picture, true = side_view(0.15, 5)
    ny, nx = picture.shape
    corner = np.float32([[30, 60], [390, 60], [390, 430], [30, 430], [210, 200], [100, 330]])
    quad = np.float32([[52, 75], [372, 50], [380, 437], [44, 425]])
    h = cv2.getPerspectiveTransform(corner[:4], quad)
    warped = cv2.warpPerspective(picture, h, (nx, ny), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    seen = cv2.perspectiveTransform(corner[None], h)[0]
    k1 = 4e-7
    centre = np.array([(nx - 1) / 2, (ny - 1) / 2])
    # what the lens shows at (column, row) is what was at the undistorted place: offset x (1 + k1 r^2)
    column, row = np.meshgrid(np.arange(nx), np.arange(ny))
    factor = 1 + k1 * ((column - centre[0]) ** 2 + (row - centre[1]) ** 2)
    source = [(c0 + (c - c0) * factor).astype(np.float32) for c, c0 in zip((column, row), centre)]
    bent = cv2.remap(warped, *source, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    marks_px = seen.astype(float)
    for _ in range(20):  # where the lens shows the marks
        off = marks_px - centre
        marks_px = centre + (seen - centre) / (1 + k1 * np.sum(off**2, axis=1))[:, None]
    metres = np.column_stack([corner[:, 0] * SCALE, (FLOOR - corner[:, 1]) * SCALE])
    marks = np.column_stack([marks_px, metres]).round(6).tolist()
    write.picture(tmp_path / "bed.png", bent)
    text = f'[bed_image]\nfile = "bed.png"\n[calibration]\nk1 = {k1}\nmarks = {marks}\n'
    found = run_bed(tmp_path, text)
    x, height = (np.array(found["profile"][k], float) / SCALE for k in ("x_m", "height_m"))
    inside = (x > 5) & (x < nx - 6) & np.isfinite(height)
    off = height[inside] - np.interp(x[inside], np.arange(nx), true / SCALE)
    # the floor is y = 0 of the marks; the two resamplings blur the glow of the grains: worst of twelve pictures 0.15
    assert abs(off.mean()) < 0.1
    assert abs(np.polyfit(x[inside], off, 1)[0]) * nx < 0.3  # no tilt is left over
    plain = run_bed(tmp_path, IMAGE)["height_m"]
    assert abs(plain - true.mean()) > SCALE  # without calibration it is off


def test_a_floor_is_needed_without_marks(tmp_path, capsys):
    write.picture(tmp_path / "bed.png", side_view(0.15, 0)[0])
    (tmp_path / "experiment.toml").write_text(IMAGE.replace(f"floor_row = {FLOOR}", ""))
    assert main(["bed", str(tmp_path), "--results", str(tmp_path / "r")]) == 1
    assert "[bed_image] floor_row: missing" in capsys.readouterr().err
    assert not (tmp_path / "r" / "bed.json").exists()


def test_a_picture_that_is_upside_down_is_refused():
    """Its floor is then light, its top grains: 0.29 was measured of it for 0.25."""
    y, x = np.mgrid[:200, :160]
    rng = np.random.default_rng(7)
    light = 30.0 + 170.0 / (1.0 + np.exp((y - 80.0 - 0.05 * x) / 1.2)) + rng.normal(0.0, 2.0, y.shape)
    assert bed_height(bed_surface(light, floor_row=180.0, method="edge"), 180.0).n > 100
    for method in ("edge", "threshold"):
        with pytest.raises(ValueError, match="upside down"):
            bed_surface(light[::-1], floor_row=180.0, method=method)
