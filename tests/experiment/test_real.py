"""Real recordings that nobody here made, through the command line as a user would."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
import xarray as xr

from jumpvision.cli import main

PIV = '[grain_video]\nfile = "{}"\nframe_rate = 1.0\n'


def test_the_falling_ball_of_a_photron_camera(real_data, tmp_path):
    """15 frames of 12 bit: over 0.5 ms of free fall the path is a parabola.

    An edge-and-circle fit of others leaves 0.0018 px (x) and 0.0024 px (y); ours 0.0016 and 0.0031.
    """
    for name in ("ball_12bit.mraw", "ball_12bit.cihx"):
        shutil.copy(real_data / "photron_ball_12bit" / name, tmp_path)
    (tmp_path / "experiment.toml").write_text(
        '[rod_video]\nfile = "ball_12bit.mraw"\nscale = 2e-5\nball_diameter = 0.002526\n'
        '[params.track]\npolarity = "dark"\n'
    )
    assert main(["track", str(tmp_path), "--results", str(tmp_path / "r"), "--no-pictures"]) == 0
    d = pd.read_csv(tmp_path / "r" / "track.csv")
    assert d.flag.isna().all()
    assert np.diff(d.time_s) == pytest.approx(1 / 30000, rel=1e-6)
    for column, bound in (("x_px", 0.0025), ("y_px", 0.0035)):
        fit = np.polyfit(d.frame, d[column], 2)
        assert (d[column] - np.polyval(fit, d.frame)).std(ddof=3) < bound
    assert np.polyfit(d.frame, d.y_px, 1)[0] == pytest.approx(2.65, abs=0.02)
    # the same recording with the published method: usable, ten times noisier
    assert main(["track", str(tmp_path), "--results", str(tmp_path / "t"), "--set", "track.method=threshold",
                 "--no-pictures"]) == 0  # fmt: skip
    t = pd.read_csv(tmp_path / "t" / "track.csv")
    assert np.abs(t.y_px - d.y_px - (t.y_px - d.y_px).mean()).max() < 0.1


def compare_with_openpiv(folder: Path, files: list[Path], pattern: str) -> None:
    """Our field against a single pass of OpenPIV (window 32) on the same pair.

    Two sound measurements of real particles differ by their noise, some tenths of a pixel a vector here (one pass, no
    deformation), and agree in the mean: median difference of some 500 vectors below 0.05 px.
    """
    process = pytest.importorskip("openpiv.pyprocess", reason="openpiv is not installed")
    for f in files:
        shutil.copy(f, folder)
    (folder / "experiment.toml").write_text(PIV.format(pattern))
    assert main(["piv", str(folder), "--results", str(folder / "r"), "--no-pictures"]) == 0
    a, b = (cv2.imread(str(f), cv2.IMREAD_GRAYSCALE).astype(np.int32) for f in files[:2])
    u, v, _ = process.extended_search_area_piv(a, b, window_size=32, overlap=8, search_area_size=32)
    x, y = process.get_coordinates(a.shape, 32, overlap=8)
    with xr.open_dataset(folder / "r" / "piv.nc") as p:
        assert float((p.chc > 0).mean()) > 0.9
        assert p.u.attrs["units"] == "px/s"
        first = p.isel(t=0).where(p.chc.isel(t=0) > 0)
        at = {"x": ("n", x.ravel()), "y": ("n", -y.ravel())}
        # before its transform_coordinates OpenPIV's v points down the rows; ours points up
        off = np.array([first.u.interp(at) - u.ravel(), first.v.interp(at) + v.ravel()])
    assert np.isfinite(off).mean() > 0.7
    assert np.abs(np.nanmedian(off, axis=1)).max() < 0.05
    assert np.nanmedian(np.abs(off)) < 0.25


def test_the_karman_street_of_pivlab(real_data, tmp_path):
    files = sorted((real_data / "pivlab_karman").glob("PIVlab_Karman_*.bmp"))
    compare_with_openpiv(tmp_path, files, "PIVlab_Karman_*.bmp")


def test_the_image_pair_that_openpiv_ships(tmp_path):
    openpiv = pytest.importorskip("openpiv", reason="openpiv is not installed")
    folder = Path(openpiv.__file__).parent / "data" / "test1"
    compare_with_openpiv(tmp_path, sorted(folder.glob("exp1_001_*.bmp")), "exp1_001_*.bmp")
