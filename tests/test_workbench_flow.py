"""The workbench with a flow: its vectors, maps and profiles are those of the stages, and a person reaches them by hand."""

from __future__ import annotations

import json
import os
import threading
import time
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest
import xarray as xr

from jumpvision.browser.workbench.bench import Benches
from jumpvision.browser.workbench.draft import draft_of
from jumpvision.browser.workbench.flowing import OF_ONE
from jumpvision.browser.workbench.server import Server
from jumpvision.cli import main
from jumpvision.experiment.results.tables import Profiles
from jumpvision.experiment.stages.grains.statistics import along_line
from jumpvision.films.grains.dataset import as_matched

ROWS, COLUMNS = 120, 176  # px; never square
TURN, RADIUS = 0.06, 40.0  # rad a frame and px: of the vortex


def vortex(n: int, seed: int = 3) -> list[np.ndarray]:
    """Frames (ROWS, COLUMNS) of particles in a vortex about the middle, anticlockwise as seen."""
    rng, middle = np.random.default_rng(seed), np.array([COLUMNS / 2, ROWS / 2])
    place = rng.uniform([-20, -20], [COLUMNS + 20, ROWS + 20], (1600, 2))
    y, x = np.mgrid[-4:5, -4:5]
    frames = []
    for _ in range(n):
        image = np.full((ROWS + 60, COLUMNS + 60), 20.0)
        for c, r in place + 30:
            i, j = round(r), round(c)
            image[i - 4 : i + 5, j - 4 : j + 5] += 130 * np.exp(-((y + i - r) ** 2 + (x + j - c) ** 2) / 2.6)
        frames.append(np.clip(image[30:-30, 30:-30] + rng.normal(0, 2, (ROWS, COLUMNS)), 0, 255).astype(np.uint8))
        away = place - middle
        a = -TURN * np.exp(-((np.hypot(*away.T) / RADIUS) ** 2))
        turned = [away[:, 0] * np.cos(a) - away[:, 1] * np.sin(a), away[:, 0] * np.sin(a) + away[:, 1] * np.cos(a)]
        place = np.clip(middle + np.column_stack(turned), -25, [COLUMNS + 25, ROWS + 25])
    return frames


def two_pictures(folder: Path) -> Path:
    folder.mkdir()
    for name, frame in zip("AB", vortex(2)):
        cv2.imwrite(str(folder / f"case{name}.png"), frame)
    return folder


def film(folder: Path, n: int = 13) -> Path:
    folder.mkdir()
    for k, frame in enumerate(vortex(n)):
        cv2.imwrite(str(folder / f"piv_{k:03d}.png"), frame)
    return folder


def stage(name: str, folder: Path) -> Path:
    """Results of a stage by the command line."""
    results = folder.parent / f"{folder.name}-results"
    assert main([name, str(folder), "--results", str(results), "--no-pictures"]) == 0
    return results


def of_file(file: Path, k: int) -> xr.Dataset:
    with xr.open_dataset(file, decode_times=False) as data:
        return data.isel(t=k).load().transpose("y", "x")


def same(shown: list, values: np.ndarray) -> None:
    assert np.array_equal(np.array(shown, float), values.ravel(), equal_nan=True)  # to the last bit


def waited(flowing) -> None:
    while flowing.batch.running:
        time.sleep(0.02)


# --- what is shown is what the stages give ----------------------------------------------------------------------------


SETTINGS = {
    "plain": "",
    "foot, mask, part": "",
    "slow": "[params.piv]\nbaseline = 3\n",
    "steady": "[params.piv]\nensemble = 3\n",
    "light": '[params.piv]\nbackground = "minimum"\nclahe = 24\nwindow = 16\nstep = 12\n',
}


@pytest.mark.parametrize("name", SETTINGS)
def test_a_pair_on_the_page_is_the_stage_s_to_the_last_bit(name, tmp_path):
    folder = film(tmp_path / "film", 8)
    head = 'schema = 1\n[grain_video]\nfile = "piv_*.png"\nframe_rate = 100.0\nscale = 1e-4\n'
    if name == "foot, mask, part":
        mask = np.full((ROWS, COLUMNS), 255, np.uint8)
        mask[70:, 90:] = 0
        cv2.imwrite(str(folder / "mask.png"), mask)
        head += "roi = [8, 4, 167, 115]\nleave_out = [[20, 20, 60, 20, 40, 50]]\n"
        head += '[grain_mask]\nfile = "mask.png"\n'
    (folder / "experiment.toml").write_text(head + SETTINGS[name])
    results = stage("piv", folder)
    stage("flow", folder)
    b = Benches(folder)
    last = len(xr.open_dataset(results / "piv.nc", decode_times=False).t) - 1
    size = 3 if name == "steady" else 1
    for k in (0, last // 2, last):
        u, flow = of_file(results / "piv.nc", k), of_file(results / "flow.nc", k)
        for what in OF_ONE:
            s = b.bench.flow(draft_of({}), k * size, what, False)
            same(s.values, np.hypot(u.u, u.v).values if what == "speed" else (u if what in u else flow)[what].values)
            assert s.frame == k * size and s.unit == ("m/s" if what in ("speed", "u", "v") else "1/s")
        same(s.u, u.u.values)
        same(s.reason, u.reason.values)
        assert s.measured == int(u.chc.sum())
    b.close()


def test_double_exposures_are_matched_as_the_stage_does(tmp_path):
    folder = tmp_path / "pairs"
    folder.mkdir()
    for k in range(2):
        for name, frame in zip("ab", vortex(2, seed=k)):
            cv2.imwrite(str(folder / f"run_{k:03d}{name}.png"), frame)
    (folder / "experiment.toml").write_text(
        'schema = 1\n[grain_video]\nfile = "run_*.png"\npairs = "names"\nframe_rate = 10.0\npair_time = 1e-3\n'
    )
    results, b = stage("piv", folder), Benches(folder)
    for frame, k in ((0, 0), (1, 0), (2, 1), (3, 1)):  # either picture of a pair
        s = b.bench.flow(draft_of({}), frame, "u", False)
        same(s.values, of_file(results / "piv.nc", k).u.values)
        assert s.frame == 2 * k
    b.close()


def test_a_map_has_the_sign_and_the_place_of_the_truth(tmp_path):
    b = Benches(two_pictures(tmp_path / "pair"))
    s = b.bench.flow(draft_of({}), 0, "vorticity", False)
    field = np.array(s.values, float).reshape(len(s.rows), len(s.columns))
    row, column = (np.argmin(np.abs(np.array(a) - m)) for a, m in ((s.rows, ROWS / 2), (s.columns, COLUMNS / 2)))
    # twice the rate of turning in the middle, anticlockwise positive; planes over 3 vectors, 8 px apart, and windows of
    # 24 px see about a tenth less of a vortex of 40 px
    assert field[row, column] == pytest.approx(2 * TURN, rel=0.15) and s.unit == "1/frame"
    b.close()


def test_the_mean_and_its_profile_are_those_of_the_pipeline(tmp_path):
    folder = film(tmp_path / "film")
    line = [0.002, -0.006, 0.014, -0.005]
    text = 'schema = 1\n[grain_video]\nfile = "piv_*.png"\nframe_rate = 100.0\nscale = 1e-4\n'
    (folder / "experiment.toml").write_text(text + f"[params.profiles]\nlines = [{line}]\n")
    results = stage("profiles", folder)
    b = Benches(folder)
    b.bench.all_pairs(draft_of({}))
    waited(b.bench.flowing)
    s = b.bench.flow(draft_of({}), 0, "vorticity", True)
    with xr.open_dataset(results / "statistics.nc", decode_times=False) as mean:
        same(s.values, mean.vorticity.transpose("y", "x").values)
        same(s.u, mean.u.transpose("y", "x").values)
        assert s.fields == 12
    table = Profiles.load(results).table
    for column in ("s", "along", "along_sigma", "across", "across_sigma", "uv"):
        same(s.profile[column], table[column].to_numpy())
    one = b.bench.flow(draft_of({}), 3, "u", False)  # of the field that lies there already
    stage("piv", folder)
    same(one.values, of_file(results / "piv.nc", 3).u.values)
    b.close()
