"""Faulty cameras of grain films and bed images: their pictures, and what the analysis makes of a jump."""

from __future__ import annotations

import json

import numpy as np
import pytest
import xarray as xr

from jumpvision.cli import main
from jumpvision.experiment.inputs.experiment import open_campaign
from jumpvision.films.frames.opening import open_frames
from jumpvision.laboratory.campaign import write_campaign
from jumpvision.laboratory.films.optics import (
    BedCamera,
    GrainCamera,
    Lens,
    distorted,
    lens_of,
    margin,
    reflection,
    shade,
)
from jumpvision.laboratory.protocol import BedImage, GrainFilm, Protocol, Records, jumps_of
from jumpvision.laboratory.samples import SAND_ROBOT


def test_a_lens_moves_a_picture_as_its_formula_says():
    """Waves of 12 px, drawn where the formula puts each pixel: a cubic spline is within 1 % of their amplitude."""
    shape, lens = (120, 90), Lens(2e-6, 1e-10, 59.5, 44.5)
    m = margin(shape, lens)
    assert 6 < m < 60

    def waves(row, column):
        return np.sin(2 * np.pi * row / 12.0) + np.cos(2 * np.pi * column / 12.0)

    wide = waves(*(a - m for a in np.mgrid[: shape[0] + 2 * m, : shape[1] + 2 * m].astype(float)))
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    r2 = (y - lens.row) ** 2 + (x - lens.column) ** 2
    more = 1 + lens.k1 * r2 + lens.k2 * r2**2
    seen = waves(lens.row + (y - lens.row) * more, lens.column + (x - lens.column) * more)
    np.testing.assert_allclose(distorted(wide, lens, shape), seen, atol=0.01)
    assert np.abs(seen - waves(y, x)).max() > 0.5
    plain = np.ones(shape)
    assert distorted(plain, lens_of(0.0, 0.0, shape), shape) is plain


def test_corners_and_glare():
    light = shade((30, 50), 0.4)
    assert light[0, 0] == pytest.approx(0.6) and light.max() == pytest.approx(1.0, abs=1e-3)
    spot = reflection((101, 101), 25.0)
    assert 24.9 < spot.max() <= 25.0 and spot[0, 0] < 0.01


FAULTY = Protocol(
    SAND_ROBOT._replace(foot_radius=0.016),
    jumps_of("stutter", [7.0]),
    Records(grain_film=GrainFilm(frames=24, rows=220, columns=264), bed_image=BedImage()),
    terms=("two_resistance", "inertial_drag"),
    parameters={"k1": 2100.0, "k2": 2100.0, "delta": 0.012, "alpha": 73.0},
    duration=0.5,
    grain_camera=GrainCamera(
        bits=12, shading=0.3, glare=30.0, dropped=0.1, clock_offset=0.003, clock_drift=0.001, k1=4e-7, calibrated=True,
        scale_error=0.01,
    ),
    bed_camera=BedCamera(bits=12, shading=0.2, glare=20.0, k1=4e-7, calibrated=True),
)  # fmt: skip


@pytest.mark.long
def test_the_faults_of_grain_film_and_bed_image(tmp_path):
    root, folder = tmp_path, tmp_path / "film" / "stutter-7Hz-1"
    write_campaign(root / "film", FAULTY, seed=7)
    true = json.loads((folder / "truth.json").read_text())
    frames = true["grain_film"]["frames"]
    sections = open_campaign(root / "film").experiments[0].sections
    film = open_frames(folder / "grains.mkv", frame_rate=500.0)
    images = np.stack(list(film))
    assert images.dtype == np.uint16 and 1000 < images.max() < 4096
    assert 0 < 24 - len(images) < 10  # 2.4 +- 4 sqrt(2.2)
    start = sections["grain_video"].start
    np.testing.assert_allclose(film.time + start + 0.00025, frames["time_s"], atol=1e-6)
    t = np.array(frames["time_s"])
    np.testing.assert_allclose(np.array(frames["shown_s"]), t - 0.00025 + 0.003 + 0.001 * (t - 0.00025), atol=1e-9)
    assert sections["grain_video"].scale == pytest.approx(3e-4 * 1.01)
    assert sections["calibration"].k1 == 4e-7
    # the picture of the bed shows its surface where a lens without fault would, once the lens is taken out
    assert main(["bed", str(folder), "--results", str(root / "r")]) == 0
    bed = json.loads((root / "r" / "bed.json").read_text())
    assert bed["height_m"] == pytest.approx(true["bed"]["height_m"], abs=3 * bed["sigma_m"])
    # the foot is where it was at the time that a frame shows, but for a constant: grains hide the edge of its face
    assert main(["flow", str(folder), "--results", str(root / "r")]) == 0
    with xr.open_dataset(root / "r" / "flow.nc", decode_times=False) as flow:
        apart = flow.foot_depth.values / 1.01 - np.array(true["grain_film"]["pairs"]["foot_depth_m"])
        assert np.nanmedian(np.abs(apart - np.nanmedian(apart))) < 0.15 * 3e-4  # 0.15 px
