"""Loops shared between threads: every row once, whatever their number; errors arrive; a forked process has its own."""

from __future__ import annotations

import multiprocessing
import subprocess
import sys
import threading
from pathlib import Path

import numba as nb
import numpy as np
import pytest

from jumpvision.base import threads
from jumpvision.base.progress import WORKERS, in_parts


@threads.shared()
def squares(first, last, x, out, count):
    for i in range(first, last):
        out[i] = x[i] * x[i]
        count[i] += 1


@threads.shared()
def refuses(first, last, bad):
    for i in range(first, last):
        if i == bad:
            raise ValueError("a bad row")


@pytest.fixture(autouse=True)
def sharing(monkeypatch):
    """These loops end before another thread has woken: they are shared all the same."""
    monkeypatch.setattr(threads, "BRIEF", 0.0)


def check(n: int) -> None:
    x, out, count = np.arange(float(n)), np.zeros(n), np.zeros(n, np.int64)
    squares(n, x, out, count)
    assert (count == 1).all() and np.array_equal(out, x * x)


@pytest.mark.parametrize("number", [1, 3])
def test_every_row_is_worked_on_once(number, monkeypatch):
    check(2)  # numba reads its environment anew as it compiles
    monkeypatch.setattr(nb.config, "NUMBA_NUM_THREADS", number)
    monkeypatch.setattr(threads, "_pool", None)
    for n in (0, 1, 2, 5, 63, 64, 1000):
        check(n)
    with threads.at_most(2):
        assert threads.threads() == min(number, 2)
        check(101)
    assert threads.threads() == number


def test_an_error_of_any_row_arrives(monkeypatch):
    monkeypatch.setattr(nb.config, "NUMBA_NUM_THREADS", 3)
    monkeypatch.setattr(threads, "_pool", None)
    for bad in (0, 50, 99):
        with pytest.raises(ValueError, match="a bad row"):
            refuses(100, bad)
    refuses(100, -1)


def test_several_threads_may_call_at_once():
    """numba's own workqueue ends the process then."""
    callers = [threading.Thread(target=lambda: [check(500) for _ in range(20)]) for _ in range(4)]
    for c in callers:
        c.start()
    for c in callers:
        c.join()
    check(500)


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork here")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_forked_process_does_not_wait_for_threads_that_it_has_not(monkeypatch):
    monkeypatch.setattr(nb.config, "NUMBA_NUM_THREADS", 2)
    monkeypatch.setattr(threads, "_pool", None)
    check(500)
    child = multiprocessing.get_context("fork").Process(target=check, args=(500,))
    child.start()
    child.join(60)
    assert child.exitcode == 0


def test_a_call_within_a_call_stays_in_its_thread(monkeypatch):
    """Else all threads could wait for one another."""
    monkeypatch.setattr(nb.config, "NUMBA_NUM_THREADS", 3)
    monkeypatch.setattr(threads, "_pool", None)

    def outer(k):
        here = threading.get_ident()
        inner = threads.at_once([threading.get_ident] * 5)
        assert set(inner) == {here}
        return k

    assert threads.at_once([lambda k=k: outer(k) for k in range(40)]) == list(range(40))
    assert set(threads.at_once([threading.get_ident] * 9, most=1)) == {threading.get_ident()}
    with pytest.raises(ZeroDivisionError):
        threads.at_once([int, lambda: 1 // 0, int])
    assert threads.at_once([int] * 3) == [0, 0, 0]


def alone(part):
    return threads.threads(), multiprocessing.current_process().name


def test_workers_import_what_their_parent_imports(tmp_path):
    """Not the package that lies in the folder they are called from, as a clone beside an installed one."""
    other = tmp_path / "jumpvision" / "base"
    other.mkdir(parents=True)
    for folder in (other.parent, other):
        (folder / "__init__.py").write_text("")
    (other / "progress.py").write_text("raise SystemExit('the wrong one')\n")
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); from jumpvision.base import progress; import os\n"
        "if __name__ == '__main__':\n"
        "    progress.ready(['jumpvision.base.progress']); progress.WORKERS.set(2)\n"
        "    print(list(progress.in_parts(os.path.abspath, ['a', 'b'])))\n"
    )
    (tmp_path / "main.py").write_text(code)
    root = str(Path(threads.__file__).parents[2])
    done = subprocess.run([sys.executable, "-P", "main.py", root], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.startswith("["), done.stderr


def test_a_worker_works_with_one_thread():
    token = WORKERS.set(2)
    try:
        found = list(in_parts(alone, range(4)))
    finally:
        WORKERS.reset(token)
    assert {n for n, _ in found} == {1} and all(name != "MainProcess" for _, name in found)
