"""One long film in parts: other processes, the same result to the last bit."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from fault_lab import grain_film
from light_work import doubled
from scipy import ndimage

from jumpvision.base.progress import WORKERS, in_parts
from jumpvision.cli import main
from jumpvision.experiment.stages.grains import piv as piv_module
from jumpvision.experiment.workflow import entries


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


# -- parts that are kept -----------------------------------------------------------------------------------------------


@pytest.fixture
def kept_soon(tmp_path, monkeypatch):
    """A film of 60 pairs, of which parts are kept; the field without; the parts of 16 pairs that are matched."""
    film = grain_film(tmp_path / "film", 61)
    call = ["piv", str(film), "--no-pictures", "--workers", "1", "--results"]
    assert main([*call, str(tmp_path / "whole")]) == 0
    monkeypatch.setattr(piv_module, "KEPT", 32)
    done, part = [], piv_module.Job.part
    monkeypatch.setattr(piv_module.Job, "part", lambda job, f, usable, p: done.append(p) or part(job, f, usable, p))
    return film, call, xr.load_dataset(tmp_path / "whole" / "piv.nc"), done


def test_a_run_that_is_killed_in_a_long_film_goes_on_where_it_was(kept_soon, tmp_path, monkeypatch):
    _, call, whole, done = kept_soon
    put = entries.Parts.put
    monkeypatch.setattr(entries.Parts, "put", lambda self, *x: put(self, *x) if len(done) < 3 else os._exit(9))
    if (child := os.fork()) == 0:
        main([*call, str(tmp_path / "r")])
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9
    monkeypatch.setattr(entries.Parts, "put", put)
    kept = sorted((tmp_path / "r" / ".cache" / "parts").glob("*/frames-*"))
    assert [f.name for f in sorted(kept, key=lambda f: f.name)] == ["frames-0-16.npz", "frames-16-32.npz"]
    kept[0].write_bytes(b"damaged")
    damaged = tuple(int(x) for x in kept[0].stem.split("-")[1:])
    assert main([*call, str(tmp_path / "r")]) == 0
    assert sorted(done) == sorted({damaged, (32, 48), (48, 60)})
    xr.testing.assert_identical(xr.load_dataset(tmp_path / "r" / "piv.nc"), whole)
    assert not list((tmp_path / "r" / ".cache" / "parts").glob("*"))  # the whole is there


def test_shares_of_a_film_are_matched_apart_and_put_together(kept_soon, tmp_path, capsys):
    film, call, whole, done = kept_soon
    share = ["run", str(film), "--workers", "1", "--results", str(tmp_path / "r"), "--share"]
    for k in (3, 1, 2):
        assert main([*share, f"{k}/3"]) == 0
        assert f"share {k}/3: its pairs are kept" in capsys.readouterr().err
    assert sorted(done) == [(0, 16), (16, 32), (32, 48), (48, 60)] and not (tmp_path / "r" / "piv.nc").exists()
    assert main([*call, str(tmp_path / "r")]) == 0
    assert len(done) == 4
    xr.testing.assert_identical(xr.load_dataset(tmp_path / "r" / "piv.nc"), whole)
    assert main([*share, "1/3"]) == 0
    assert "this film is not divided into shares" in capsys.readouterr().err
    for wrong in ("0/3", "4/3", "1", "a/b", "1/99999"):
        assert main([*share, wrong]) == 2
        assert f"--share {wrong}: must be K/N" in capsys.readouterr().err


@pytest.mark.parametrize("share", [[], ["--share", "1/2"]])
def test_parts_of_a_film_that_is_exchanged_meanwhile_are_not_kept(kept_soon, tmp_path, monkeypatch, share, capsys):
    film, _, _, done = kept_soon
    part = piv_module.Job.part

    def exchanged(*x):
        if len(done) == 1:
            np.save(film / "grains.npy", np.load(film / "grains.npy")[::-1])
        return part(*x)

    monkeypatch.setattr(piv_module.Job, "part", exchanged)
    main(["run", str(film), "--workers", "1", "--no-report", "--no-pictures", "--results", str(tmp_path / "r"), *share])
    assert "changed while stage 'piv' read it" in capsys.readouterr().err
    kept = {f.name for f in (tmp_path / "r" / ".cache" / "parts").glob("*/*.npz")}
    assert kept <= {"frames-0-16.npz"}  # of before


@pytest.mark.long
def test_a_long_film_is_shared_among_jobs(tmp_path):
    """600 frames, 200 a job, handed to Snakemake: three jobs for the film, one for the experiment; as by one."""
    if shutil.which("snakemake", path=str(Path(sys.executable).parent)) is None:
        pytest.skip("snakemake is not installed (pip: workflow)")
    film = grain_film(tmp_path / "c" / "film", 600)
    profile = tmp_path / "profile"
    profile.mkdir()
    (profile / "config.yaml").write_text("cores: 2\nconfig:\n  - frames=200\nprintshellcmds: true\n")
    command = [sys.executable, "-c", "import sys; from jumpvision.cli import main; sys.exit(main())"]
    shared = [*command, "run", str(tmp_path / "c"), "--profile", str(profile), "--no-pictures"]
    done = subprocess.run([*shared, "--results", str(tmp_path / "r")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    for k in (1, 2, 3):
        assert f"--share {k}/3" in done.stderr
    alone = [*command, "piv", str(film), "--results", str(tmp_path / "alone"), "--workers", "1", "--no-pictures"]
    subprocess.run(alone, check=True, stdout=subprocess.DEVNULL)
    xr.testing.assert_identical(*(xr.load_dataset(tmp_path / n / "piv.nc") for n in ("alone", "r/film")))
