"""One long film in parts: other processes, the same result to the last bit."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
import xarray as xr
from scipy import ndimage

from jumpvision.base.progress import WORKERS, in_parts
from tests.worlds.light_work import doubled


@pytest.fixture
def two_workers():
    token = WORKERS.set(2)
    yield
    WORKERS.reset(token)


def test_parts_come_in_order_from_several_processes(two_workers):
    results = list(in_parts(doubled, range(6), 0.2))
    assert [r for r, _ in results] == [0, 2, 4, 6, 8, 10]
    assert os.getpid() not in {p for _, p in results}
    with pytest.raises(ValueError, match="part -1"):
        list(in_parts(doubled, [1, -1, 2], 0.0))


def test_alone_no_process_is_started():
    assert list(in_parts(doubled, [1, 2], 0.0)) == [(2, os.getpid()), (4, os.getpid())]


@pytest.mark.long
def test_a_long_film_matched_by_two_processes_is_as_by_one(tmp_path):
    """70 frames of moving grains, more pairs than a part and a rest; every number of piv.nc is the same.

    As commands: this process may have more threads of BLAS, which rounds by their number.
    """
    rng = np.random.default_rng(3)
    wide = ndimage.gaussian_filter(rng.standard_normal((96, 200)), 1.5)
    wide = 120 + 60 * wide / wide.std()
    film = np.stack([ndimage.shift(wide, (0.0, -0.7 * i), order=3)[:, 20:116] for i in range(70)])
    np.save(tmp_path / "grains.npy", np.clip(film + rng.normal(0, 2, film.shape), 0, 255).astype(np.uint8))
    (tmp_path / "experiment.toml").write_text('[grain_video]\nfile = "grains.npy"\nframe_rate = 500.0\nscale = 1e-4\n')
    fields = []
    for workers in (1, 2):
        out = tmp_path / f"by-{workers}"
        options = ["--results", str(out), "--workers", str(workers), "--no-pictures"]
        command = [sys.executable, "-c", "import sys; from jumpvision.cli import main; sys.exit(main())", "piv"]
        subprocess.run([*command, str(tmp_path), *options], check=True, stdout=subprocess.DEVNULL)
        fields.append(xr.load_dataset(out / "piv.nc"))
    assert fields[0].sizes["t"] == 69
    xr.testing.assert_identical(*fields)
    # 0.7 px in 2 ms at 0.1 mm a pixel: 35 mm/s
    assert float(fields[0].u.median()) == pytest.approx(-0.035, rel=0.01)
