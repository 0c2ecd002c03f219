"""Compiling is told exactly when numba has to: by the first process of a run, never where the cache holds it all."""

from __future__ import annotations

import importlib.util
import os
from functools import partial

from jumpvision.base import compiling, threads
from jumpvision.base.progress import WORKERS, in_parts, setting

KERNEL = "from numba import njit\n\n@njit(cache=True)\ndef double(x):\n    return 2 * x\n"


def loaded(file):
    """The function of a source, as a new process would see it: not compiled yet, but perhaps kept on the disk."""
    if not file.exists():
        file.write_text(KERNEL)
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
