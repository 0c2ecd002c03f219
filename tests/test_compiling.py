"""Compiling is told exactly when numba has to: by the first process of a run, never where the cache holds it all."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from functools import partial

import pytest
from conftest import SAMPLES

from jumpvision.base import compiling, threads
from jumpvision.base.progress import WORKERS, in_parts, setting
from jumpvision.cli import main

KERNEL = "from numba import njit\n\n@njit(cache={cache})\ndef double(x):\n    return 2 * x\n"


def loaded(file, cache=True):
    """The function of a source, as a new process would see it: not compiled yet, but perhaps kept on the disk."""
    if not file.exists():
        file.write_text(KERNEL.format(cache=cache))
    spec = importlib.util.spec_from_file_location(file.stem, file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.double


def test_it_is_told_once_as_it_begins_and_not_where_the_cache_holds_it(tmp_path):
    assert threads.threads() > 0  # hears of numba
    told, f = [], loaded(tmp_path / "kernel_a.py")
    with compiling.noticed(lambda: told.append(f.stats.cache_misses)):
        f(1)
        f(1.0)
    assert told and len(told) == 1
    with compiling.noticed(lambda: told.append("again")):
        again = loaded(tmp_path / "kernel_a.py")
        assert again(1) == 2 and sum(again.stats.cache_hits.values()) == 1
    assert len(told) == 1
    loaded(tmp_path / "kernel_b.py")(1)  # nobody asked


def test_what_is_compiled_every_time_is_not_this_once(tmp_path):
    told = []
    with compiling.noticed(lambda: told.append(1)):
        loaded(tmp_path / "kernel_c.py", cache=False)(1)
    assert not told


def in_worker(file):
    return threads.threads() and loaded(file)(2)


def write_down(file):
    with file.open("a") as out:
        out.write("compiling\n")


def test_of_many_processes_one_tells(tmp_path):
    told = tmp_path / "told.txt"
    files = [tmp_path / f"kernel_{k}.py" for k in range(4)]
    with setting(WORKERS, 2), compiling.noticed(partial(write_down, told)):
        assert list(in_parts(in_worker, files)) == [4] * 4
        assert loaded(tmp_path / "kernel_here.py")(1) == 2
    assert told.read_text() == "compiling\n"


def test_a_second_run_on_sand_does_not_speak_of_compiling(tmp_path, capsys):
    """`simulate` with nothing kept but what numba has compiled."""
    folder = str(SAMPLES / "loose_sand" / "single-4.5Hz-1")
    for k in range(2):
        capsys.readouterr()
        assert main(["simulate", folder, "--results", str(tmp_path / str(k)), "--no-pictures", "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out) and "compiling" not in err


@pytest.mark.long
def test_a_first_run_on_sand_does(tmp_path, monkeypatch):
    folder = str(SAMPLES / "loose_sand" / "single-4.5Hz-1")
    call = [sys.executable, "-c", "import sys; from jumpvision.cli import main; sys.exit(main())", "simulate", folder]
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "numba"))
    for said in (1, 0):
        results = tmp_path / f"results_{said}"
        done = subprocess.run([*call, "--results", str(results), "--no-pictures"], capture_output=True, text=True)
        assert done.returncode == 0 and done.stderr.count("compiling for this machine") == said


def test_a_version_does_not_meet_what_another_compiled(tmp_path, monkeypatch):
    """numba knows a function by its own file: a record that was renamed elsewhere was an AttributeError on loading."""
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    inner = tmp_path / "films" / "__pycache__"
    inner.mkdir(parents=True)
    one = tmp_path / "__init__.py"
    one.write_text("")
    installed = 1_700_000_000
    for version, later, kept in (
        ("1.0", 0, True),
        ("1.0", 0, True),
        ("1.1", 0, False),
        ("1.1", 0, True),
        ("1.1", 9, False),
    ):
        os.utime(one, (installed + later, installed + later))
        for name in ("kernel.nbi", "kernel.1.nbc", "kernel.pyc"):
            (inner / name).write_bytes(b"")
        compiling.compiled_code_goes(tmp_path, version)
        assert {f.name for f in inner.iterdir()} == {"kernel.pyc"} | ({"kernel.nbi", "kernel.1.nbc"} if kept else set())


def test_where_the_package_cannot_be_written_a_version_has_its_own_folder(tmp_path, monkeypatch):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    compiling.compiled_code_goes(tmp_path / "not there", "1.1")
    assert os.environ["NUMBA_CACHE_DIR"] == str(tmp_path / "jumpvision" / "compiled-1.1")


TWICE = """
import hashlib, warnings
import numpy as np
import jumpvision as jv
from scipy.ndimage import gaussian_filter
warnings.simplefilter("ignore")
rng = np.random.default_rng(1)
y, x = np.mgrid[:80, :100]
ball = [120.0 / (1.0 + np.exp((np.hypot(x - 40 - 1.3 * i, y - 38 + 0.7 * i) - 8.3) / 0.5)) for i in range(12)]
film = np.clip(40 + np.array(ball) + rng.normal(0, 3, (12, *x.shape)), 0, 255).astype(np.uint8)
track = jv.track(film, frame_rate=500, diameter=16)
a = 100 + 50 * gaussian_filter(rng.normal(size=(96, 128)), 1.2)
field = jv.piv(a, np.roll(a, 2, axis=1) + rng.normal(0, 1, a.shape), window=32, step=16)
hard = jv.sweep("hard", frequency=(5, 15, 41), phase=(0.0, 3.0, 9))
sand = jv.sweep("granular", frequency=(5, 9, 3))
for name, arrays in {
    "track": [track[["x_px", "y_px", "sigma_px"]].to_numpy()],
    "piv": [field[k].values for k in ("u", "v", "u_sigma", "v_sigma")],
    "hard": [hard.jump_height_m.values, hard.peak_power_W.values],
    "sand": [sand.jump_height_m.values, sand.peak_power_W.values],
}.items():
    print(name, hashlib.sha256(b"".join(a.tobytes() for a in arrays)).hexdigest())
"""


@pytest.mark.long
def test_the_first_run_gives_the_bits_of_the_next(tmp_path):
    """With nothing compiled, and with all of it loaded: a sweep and sigmas of a track were 1e-14 apart."""
    there = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    said = [subprocess.run([sys.executable, "-c", TWICE], env=there, capture_output=True, text=True) for _ in range(2)]
    assert said[0].returncode == 0, said[0].stderr
    assert said[0].stdout == said[1].stdout and said[0].stdout.count("\n") == 4
