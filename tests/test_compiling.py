"""Compiling is told exactly when numba has to: by the first process of a run, never where the cache holds it all."""

from __future__ import annotations

import importlib.util
import json
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
