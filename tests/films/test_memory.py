"""Bounded memory: every stage on the largest recordings, under a limit of the address space."""

from __future__ import annotations

import subprocess
import sys
import tracemalloc
from pathlib import Path

import cv2
import numpy as np
import pytest
import xarray as xr

from jumpvision.experiment.results.fields import Flow
from jumpvision.films.vision.piv import engine, refine

LIMIT = 4 * 1000**3  # bytes of address space, the interpreter, its libraries and threads included
WIDE, HIGH = 7680, 4320  # px
SAMPLES = Path(__file__).parents[2] / "data_samples"
SETTINGS = {"window": 25, "step": 6, "passes": (64, 32), "min_correlation": 0.3, "min_texture": 1.0, "outlier": 2.0}

UNDER_LIMIT = f"""
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, ({LIMIT}, {LIMIT}))
from jumpvision.cli import main
sys.exit(main(sys.argv[1:]))
"""


def grains(rows: int, columns: int, seed: int = 0) -> np.ndarray:
    """Grains of about 7 px, 8 bit."""
    f = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=(rows, columns)).astype(np.float32), (0, 0), 2.0)
    return cv2.normalize(f, None, 0, 255, cv2.NORM_MINMAX, cv2.CV_8U)


@pytest.mark.parametrize(("preset", "masked"), [("default", True), ("fast", False)])
def test_a_frame_in_bands_gives_the_vectors_of_the_whole(monkeypatch, preset, masked):
    """All but the mean over the frame that sigma takes is of a pixel's neighbours: the same bits; sigma to rounding."""
    wide = grains(300, 420)
    a, b = wide[4:, :-6], wide[:-4, 6:]
    mask = np.ones(a.shape, bool)
    mask[100:140, 150:190] = not masked
    whole = engine.piv_pair(a, b, mask=mask, preset=preset, **SETTINGS)
    monkeypatch.setattr(refine, "BAND", 20_000)
    bands = engine.piv_pair(a, b, mask=mask, preset=preset, **SETTINGS)
    for name in ("u", "v", "correlation", "reason", "u_raw", "v_raw", "gradient"):
        assert np.array_equal(getattr(bands, name), getattr(whole, name), equal_nan=True), name
    for name in ("u_sigma", "v_sigma", "gradient_sigma"):
        assert np.allclose(getattr(bands, name), getattr(whole, name), rtol=1e-12, atol=0, equal_nan=True), name


def write_8k(folder: Path) -> None:
    """A grain film of three frames, a ball film of six, a crater and a bed: each 7680 x 4320 px."""
    wide = grains(HIGH, WIDE + 8)
    (folder / "grains").mkdir(parents=True)
    (folder / "ball").mkdir()
    for k in range(3):
        cv2.imwrite(str(folder / "grains" / f"{k:03d}.png"), wide[:, 2 * k : 2 * k + WIDE])
    for k in range(6):
        ball = np.full((HIGH, WIDE), 30, np.uint8)
        cv2.circle(ball, (3000, 2000 + 40 * k * k), 90, 230, -1, cv2.LINE_AA)
        cv2.imwrite(str(folder / "ball" / f"{k:03d}.png"), cv2.GaussianBlur(ball, (0, 0), 1.0))
    text = """
[rod_video]
file = "ball"
frame_rate = 500.0
scale = 1e-4
[grain_video]
file = "grains"
frame_rate = 500.0
scale = 1e-5
"""
    (folder / "experiment.toml").write_text(text, encoding="utf-8")


@pytest.mark.long
def test_every_stage_of_the_samples_and_films_of_8k_within_4_GB(tmp_path):
    """The grain film took 5.4 GB before frames were matched in bands."""
    write_8k(tmp_path / "c" / "large")
    for what in (tmp_path / "c" / "large", SAMPLES / "hard_ground", SAMPLES / "loose_sand" / "stutter-7.0Hz-film"):
        call = [sys.executable, "-c", UNDER_LIMIT, "run", str(what), "--results", str(tmp_path / "r" / what.name)]
        done = subprocess.run(call, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr[-2000:]
    assert (tmp_path / "r" / "large" / "piv.nc").exists() and (tmp_path / "r" / "large" / "track.csv").exists()


def test_a_flow_is_written_and_read_without_ever_lying_in_memory(tmp_path):
    """400 times of 8 maps of 40 x 40: 41 MB; of them 16 at once, twice."""
    n, size = 400, (40, 40)
    head = xr.Dataset(
        {"momentum": ("t", np.arange(n) * 1.0)},
        coords={"x": np.arange(40) * 1e-3, "y": np.arange(40) * 1e-3, "t": np.arange(n) * 2e-3},
    )
    planes = (xr.Dataset({f"map{k}": (("y", "x"), np.full(size, i + k / 8.0)) for k in range(8)}) for i in range(n))
    tracemalloc.start()
    try:
        made = Flow.write(head, planes)
        made.save(tmp_path)
        read = Flow.load(tmp_path)
        last = float(read.field.map7.isel(t=-1)[3, 5])
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert last == 399 + 7 / 8 and np.array_equal(Flow.over_time(tmp_path).field.momentum, np.arange(n))
    assert "map0" not in Flow.over_time(tmp_path).field
    assert peak < 8e6
