"""Real recordings that nobody here made, through the command line as a user would."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import xarray as xr

from jumpvision.cli import main

PIV = '[grain_video]\nfile = "{}"\nframe_rate = 1.0\n'


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


def test_the_image_pair_that_openpiv_ships(tmp_path):
    openpiv = pytest.importorskip("openpiv", reason="openpiv is not installed")
    folder = Path(openpiv.__file__).parent / "data" / "test1"
    compare_with_openpiv(tmp_path, sorted(folder.glob("exp1_001_*.bmp")), "exp1_001_*.bmp")
