"""Faults: nothing lost, nothing wrong taken for right. (About 10 s.)"""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import tracemalloc
from pathlib import Path

import h5py
import numpy as np
import pytest
import tifffile
from shared import ROOT, later
from test_frames_raw import STAMPS_S, STAMPS_US, write_cine, write_mraw, write_seq

from jumpvision.base.schema import InputError
from jumpvision.cli import main
from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.experiment.inputs.sections import CraterDepth
from jumpvision.experiment.stages.bed.crater import read_map
from jumpvision.experiment.workflow import cache
from jumpvision.films.frames import FrameError, open_frames
from tests.worlds.small import leftovers, results_of, run_here, write_campaign

RUN = [sys.executable, "-c", "import sys; from jumpvision.cli import main; sys.exit(main(sys.argv[1:]))", "run"]


# ---- killed, and together --------------------------------------------------------------------------------------------


TWO_RUNS = """
import os, sys
from pathlib import Path
from tests.worlds.small import run_here

campaign, results = map(Path, sys.argv[1:])
run_here(campaign, results / "alone")  # what it imports is there in both forks
children = []
for _ in range(2):
    children.append(os.fork())
    if children[-1] == 0:
        os._exit(run_here(campaign, results / "together"))
sys.exit(max(os.waitstatus_to_exitcode(os.waitpid(c, 0)[1]) for c in children))
"""


@pytest.mark.skipif(os.name == "nt", reason="needs fork")
def test_two_runs_of_one_campaign_at_once(calm, tmp_path):
    call = [sys.executable, "-c", TWO_RUNS, str(calm / "campaign"), str(tmp_path)]
    assert subprocess.run(call, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode == 0
    assert results_of(tmp_path / "together") == results_of(calm / "results")
    assert leftovers(tmp_path / "together") == []


def children(pid: int) -> list[int]:
    """Worker processes of a run, forked from its server; not those that watch shared resources."""
    parents = {}
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1])
            if b"forkserver import main" in (entry / "cmdline").read_bytes():
                parents[int(entry.name)] = parent
        except OSError:
            continue
    servers = {p for p, parent in parents.items() if parent == pid}
    return [p for p, parent in parents.items() if parent in servers]


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def until(what, seconds: float):
    """The first true value of what() within some seconds, else its last."""
    end = time.monotonic() + seconds
    while not (value := what()) and time.monotonic() < end:
        time.sleep(0.02)
    return value


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="finds processes in /proc")
@pytest.mark.parametrize("victim", ["the run", *later("a worker")])
def test_a_killed_process_costs_nothing_but_time(tmp_path, victim):
    """Of two workers one is killed: all experiments are done all the same. The run is killed: no worker stays."""
    campaign, results = write_campaign(tmp_path / "campaign", 4, rate=200.0), tmp_path / "results"
    call = [*RUN, str(campaign), "--results", str(results), "--workers", "2", "--no-pictures"]
    run = subprocess.Popen(call, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        workers = until(lambda: len(c := children(run.pid)) == 2 and c, 60)
        assert workers
        until(lambda: list(results.glob("*/rod.csv")), 60)  # at work
        os.kill(workers[0] if victim == "a worker" else run.pid, signal.SIGKILL)
        err = run.communicate(timeout=120)[1]
        if victim == "a worker":
            assert run.returncode == 0, err
            assert len(list(results.glob("*/summary.json"))) == 4
            assert leftovers(results) == []
        else:
            assert until(lambda: not any(map(alive, workers)), 30), "workers without a run stay"
    finally:
        run.kill()


# ---- the disk --------------------------------------------------------------------------------------------------------


WRITES = [(os, "replace"), (os, "rename"), (os, "fsync"), (shutil, "copyfile"), (Path, "write_text"), (Path, "mkdir")]


def test_the_disk_fails_in_mid_run(calm, tmp_path, monkeypatch, capsys):
    """From the k-th writing on nothing can be written, for k over the whole run: said in words, and made good later."""

    def run(fails_at: int, results: Path, error: int = 0) -> tuple[int, int]:
        """(exit code, number of writings)."""
        count = 0
        with monkeypatch.context() as patch:
            for where, name in WRITES:
                true = getattr(where, name)

                def call(*args, _true=true, **kwargs):
                    nonlocal count
                    count += 1
                    if count > fails_at:
                        raise OSError(error, os.strerror(error), str(args[0]))
                    return _true(*args, **kwargs)

                patch.setattr(where, name, call)
            return run_here(calm / "campaign", results), count

    _, total = run(10**9, tmp_path / "all")
    assert total > 20
    for k, error in zip(np.linspace(0, total - 1, 3).astype(int), (errno.ENOSPC, errno.EROFS, errno.ENOSPC)):
        results = tmp_path / f"fails-{k}"
        capsys.readouterr()
        code, _ = run(int(k), results, error)
        err = capsys.readouterr().err
        assert code == 1, err
        assert os.strerror(error) in err
        assert "Traceback" not in err and "unexpected" not in err
        assert run_here(calm / "campaign", results) == 0
        assert results_of(results) == results_of(calm / "results")


def flip(file: Path) -> None:
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 4
    file.write_bytes(data)


def cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


@pytest.mark.parametrize("damage", [flip, cut, Path.unlink])
@pytest.mark.filterwarnings("ignore::jumpvision.experiment.workflow.stage.StageWarning")
def test_damaged_cache_and_result_files_are_made_again(work, calm, damage):
    for where in (".cache/*/*/*", ".cache/stamps.sqlite", ".cache/*/*/receipt.json", "jump*/[!p]*"):
        files = [f for f in (work / "results").glob(where) if f.is_file()]
        assert files
        for f in files:
            damage(f)
        assert run_here(work / "campaign", work / "results") == 0
        assert results_of(work / "results") == results_of(calm / "results"), where


def test_a_moved_archive_with_blanks_and_letters_beyond_ascii_is_read_and_left_alone(work, calm):
    """Folders and files without the right to write; nothing of them changes."""
    folder = work / "Größe µ 粒 %20 'x'" / "cämpaign β"
    folder.parent.mkdir()
    (work / "campaign").rename(folder)
    (folder / "jump-0000" / "rod_track.csv").rename(folder / "jump-0000" / "spur é 1.csv")
    toml = folder / "jump-0000" / "experiment.toml"
    toml.write_text(toml.read_text().replace("rod_track.csv", "spur é 1.csv"), encoding="utf-8")
    paths = [folder, *folder.rglob("*")]
    for p in paths:
        p.chmod(0o555 if p.is_dir() else 0o444)
    before = {p: (p.stat().st_mtime_ns, p.stat().st_mode) for p in paths}
    try:
        assert run_here(folder, work / "results") == 0
        assert {p: (p.stat().st_mtime_ns, p.stat().st_mode) for p in [folder, *folder.rglob("*")]} == before
    finally:
        for p in paths:
            p.chmod(0o755 if p.is_dir() else 0o644)
    for name in ("summary.json", "fits.json", "rod.csv"):
        theirs = (calm / "results" / "jump-0000" / name).read_bytes()
        assert (work / "results" / "jump-0000" / name).read_bytes() == theirs


# ---- what is in the files --------------------------------------------------------------------------------------------


def test_no_recording_from_outside_the_campaign(work):
    (work / "campaignx").write_text("x")
    toml = work / "campaign" / "jump-0001" / "experiment.toml"
    text = toml.read_text()
    for file in ("/etc/passwd", "../../../x.csv", "a/../../../x.csv", "../../../*.csv", "../../campaignx"):
        toml.write_text(text.replace("rod_track.csv", file))
        with pytest.raises(InputError, match="outside"):
            open_experiment(toml.parent)


class Bomb:
    def __reduce__(self):
        return os.mkdir, ("pickle-was-run",)


def test_no_code_from_data_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bomb = np.array([[Bomb(), Bomb()]] * 2, dtype=object)
    np.savez("a.npz", a=bomb)
    np.save("a.npy", bomb, allow_pickle=True)
    with h5py.File("a.h5", "w") as f:
        f.create_dataset("film", (3, 4, 5), dtype=h5py.special_dtype(vlen=str))
    for name in ("a.npy", "a.npz"):
        with pytest.raises(ValueError, match=r"a\.np"):
            read_map(CraterDepth(file=name, path=tmp_path / name))
    for name in ("a.npy", "a.h5"):
        with pytest.raises(FrameError):
            open_frames(tmp_path / name)
    assert not (tmp_path / "pickle-was-run").exists()


def absurd(folder: Path) -> dict[str, Path]:
    """Small files whose headers claim a thousand million frames."""
    film, many = np.zeros((3, 24, 40), np.uint16), 10**9
    cine = write_cine(folder / "a.cine", film, bits=16, stamps=STAMPS_S[:3])
    data = bytearray(cine.read_bytes())
    data[20:24] = many.to_bytes(4, "little")
    cine.write_bytes(data)
    mraw = write_mraw(folder, film, 12, frames=many)
    seq = write_seq(folder / "a.seq", film, STAMPS_US[:3].tolist(), allocated=many)
    tifffile.imwrite(folder / "a.tif", film[0], description=f"ImageJ=1.53t\nimages={many - 1}\n", metadata=None)
    return {"cine": cine, "mraw": mraw, "seq": seq, "tiff": folder / "a.tif"}


def test_absurd_headers_take_no_memory(tmp_path):
    for path in absurd(tmp_path).values():
        with open_frames(path, frame_rate=100.0) as film:  # the imports
            film[0]
        tracemalloc.start()
        try:
            with open_frames(path, frame_rate=100.0) as film:
                assert 1 <= len(film) <= 3 and film.truncated
                film[0]
            assert tracemalloc.get_traced_memory()[1] < 20e6, path  # bytes; the file has some 10 kB
        finally:
            tracemalloc.stop()


# ---- the cache command -----------------------------------------------------------------------------------------------


def test_the_cache_shows_its_size_and_is_pruned(work, capsys):
    results = work / "results"
    sizes = [f.stat().st_size for f in (results / ".cache").glob("*/*/*")]
    assert main(["cache", str(results), "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["stages"][-1]["bytes"] == sum(sizes)
    assert shown["freed_bytes"] == 0
    old = next((results / ".cache" / "fit").iterdir())
    for f in (*old.iterdir(), old):
        os.utime(f, (time.time() - 40 * 86400,) * 2)
    assert main(["cache", str(results), "--older-than", "30d"]) == 0
    assert not old.exists()
    assert len(cache.entries_of(results / ".cache")) == shown["stages"][-1]["entries"] - 1
    assert main(["cache", str(results), "--keep", "5kB"]) == 0
    assert sum(e.nbytes for e in cache.entries_of(results / ".cache")) <= 5000
    assert main(["cache", str(results), "--keep", "much"]) == 2
    assert main(["cache", str(results), "--all"]) == 0
    assert cache.entries_of(results / ".cache") == []
    before = results_of(results)
    assert run_here(work / "campaign", results) == 0
    assert results_of(results) == before
