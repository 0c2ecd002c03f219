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
from conftest import later
from fault_lab import leftovers, results_of, run_here, write_campaign
from test_frames_raw import STAMPS_S, STAMPS_US, write_cine, write_mraw, write_seq

from jumpvision.base import storage
from jumpvision.base.schema import InputError
from jumpvision.cli import main
from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.experiment.workflow import cache
from jumpvision.films.frames import FrameError, open_frames

posix = pytest.mark.skipif(os.name == "nt", reason="needs fork and SIGKILL")
LAB = Path(__file__).with_name("fault_lab.py")


def lab(*arguments: object) -> dict:
    done = subprocess.run([sys.executable, LAB, *map(str, arguments)], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def calm(tmp_path_factory) -> Path:
    """A campaign of two experiments and its results: folder/campaign, folder/results. Not to be changed."""
    folder = tmp_path_factory.mktemp("calm")
    campaign = write_campaign(folder / "campaign", 2)
    time.sleep(storage.FRESH)  # what was hashed just after it was written is hashed again
    assert run_here(campaign, folder / "results") == 0
    return folder


@pytest.fixture
def work(calm, tmp_path) -> Path:
    """A copy of it."""
    return Path(shutil.copytree(calm, tmp_path / "work"))


# ---- killed, and together --------------------------------------------------------------------------------------------


@pytest.mark.long
@posix
def test_killed_at_random_moments_it_resumes_to_the_same_numbers(tmp_path):
    found = lab("kill", tmp_path, 5)
    assert found["killed"] >= 1
    assert (found["torn"], found["different"], found["left"]) == ([], [], [])


@posix
def test_two_runs_of_one_campaign_at_once(tmp_path):
    assert lab("together", tmp_path, 2) == {"codes": [0, 0], "same": True, "left": []}


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
    call = [sys.executable, "-c", "import sys; from jumpvision.cli import main; sys.exit(main())", "run"]
    call += [str(campaign), "--results", str(results), "--workers", "2", "--no-pictures"]
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


@pytest.mark.parametrize("error", [errno.ENOSPC, errno.EROFS])
def test_the_disk_fails_in_mid_run(calm, tmp_path, monkeypatch, capsys, error):
    """From the k-th writing on nothing can be written, for k over the whole run: said in words, and made good later."""

    def run(fails_at: int, results: Path) -> tuple[int, int]:
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
    for k in np.linspace(0, total - 1, 4).astype(int):
        results = tmp_path / f"fails-{k}"
        capsys.readouterr()
        code, _ = run(int(k), results)
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


def empty(file: Path) -> None:
    file.write_bytes(b"")


@pytest.mark.parametrize("damage", [flip, cut, empty, Path.unlink])
@pytest.mark.parametrize("where", [".cache/*/*/*", ".cache/stamps.sqlite", ".cache/*/*/receipt.json", "jump*/[!p]*"])
@pytest.mark.filterwarnings("ignore::jumpvision.experiment.workflow.stage.StageWarning")
def test_damaged_cache_and_result_files_are_made_again(work, calm, damage, where):
    files = [f for f in (work / "results").glob(where) if f.is_file()]
    assert files
    for f in files:
        damage(f)
    assert run_here(work / "campaign", work / "results") == 0
    assert results_of(work / "results") == results_of(calm / "results")


def test_a_changed_bit_of_a_receipt_is_no_warning_and_no_excuse(tmp_path):
    text = storage.sealed({"warnings": [], "not_applicable": [], "outputs": {"a.csv": "00"}})
    assert storage.unsealed(text)["outputs"] == {"a.csv": "00"}
    for i in range(len(text)):
        try:
            found = storage.unsealed(text[:i] + chr(ord(text[i]) ^ 1) + text[i + 1 :])
        except ValueError:
            continue
        assert found == storage.unsealed(text)  # white space


def test_a_clock_set_back_hides_no_change(work, calm):
    """A log is exchanged for one of the same size while its date runs back, or stays; entries used 'tomorrow' count."""
    log = work / "campaign" / "jump-0000" / "rod_track.csv"
    before, text = log.stat(), log.read_text()
    for stamp in (before.st_mtime_ns - 86_400 * 10**9, before.st_mtime_ns):
        text = text.replace("0.2", "0.3", 1) if "0.2" in text else text
        log.write_text(text[:-3] + ("7" if text[-3] != "7" else "1") + text[-2:])
        text = log.read_text()
        os.utime(log, ns=(stamp, stamp))
        code = run_here(work / "campaign", work / "results")
        found = results_of(work / "results").get("jump-0000/rod.csv")
        assert code == 1 or found != results_of(calm / "results")["jump-0000/rod.csv"]
        shutil.copy(calm / "results" / "jump-0000" / "rod.csv", work / "results" / "jump-0000" / "rod.csv")
    entries = cache.entries_of(work / "results" / ".cache")
    for e in entries:
        os.utime(e.folder, (time.time() + 10**6,) * 2)
    assert cache.to_prune(cache.entries_of(work / "results" / ".cache"), older_than=0.0) == []


def test_a_moved_campaign_recomputes_nothing(work, capsys):
    (work / "campaign").rename(work / "moved")
    capsys.readouterr()
    assert run_here(work / "moved", work / "results") == 0
    assert "nothing recomputed" in capsys.readouterr().err


def test_blanks_and_letters_beyond_ascii_in_paths(calm, tmp_path):
    folder = shutil.copytree(calm / "campaign", tmp_path / "Größe µ 粒 %20 'x'" / "cämpaign β")
    log = folder / "jump-0000" / "rod_track.csv"
    log.rename(log.with_name("spur é 1.csv"))
    toml = folder / "jump-0000" / "experiment.toml"
    toml.write_text(toml.read_text().replace("rod_track.csv", "spur é 1.csv"), encoding="utf-8")
    assert run_here(folder, tmp_path / "Ergebnisse ü") == 0
    for name in ("summary.json", "fits.json", "rod.csv"):
        theirs = (calm / "results" / "jump-0000" / name).read_bytes()
        assert (tmp_path / "Ergebnisse ü" / "jump-0000" / name).read_bytes() == theirs


def test_an_archive_is_read_and_left_alone(work):
    """Folders and files without the right to write; nothing of them changes."""
    paths = [work / "campaign", *(work / "campaign").rglob("*")]
    for p in paths:
        p.chmod(0o555 if p.is_dir() else 0o444)
    before = {p: (p.stat().st_mtime_ns, p.stat().st_mode) for p in paths}
    try:
        assert run_here(work / "campaign", work / "elsewhere") == 0
        assert {p: (p.stat().st_mtime_ns, p.stat().st_mode) for p in [work / "campaign", *before]} == before
        assert {work / "campaign", *(work / "campaign").rglob("*")} == set(before)
    finally:
        for p in paths:
            p.chmod(0o755 if p.is_dir() else 0o644)


# ---- what is in the files --------------------------------------------------------------------------------------------

ROWS = {  # what is done to the lines of a log: what the message says
    "NaN": (lambda r: [*r[:9], "0.08,nan", *r[10:]], "finite number"),
    "duplicated": (lambda r: [*r[:9], r[8], *r[9:]], "repeats"),
    "goes back": (lambda r: [*r[:9], r[3], *r[9:]], "goes back"),
    "negative sigma": (lambda r: [r[0] + ",sigma_m", *(f"{t},-1e-5" for t in r[1:])], "above 0 m"),
}


@pytest.mark.parametrize("what", ROWS)
def test_a_bad_log_stops_one_experiment_and_its_reason_is_in_the_table(work, what):
    change, says = ROWS[what]
    log = work / "campaign" / "jump-0001" / "rod_track.csv"
    log.write_text("\n".join(change(log.read_text().split())) + "\n")
    assert run_here(work / "campaign", work / "results") == 1
    assert (work / "results" / "jump-0000" / "summary.json").exists()
    assert not (work / "results" / "jump-0001" / "summary.json").exists()
    table = (work / "results" / "jumps.csv").read_text()
    assert says in table and "rod_track.csv" in table


def test_an_excluded_experiment_keeps_its_reason_in_the_table(work):
    toml = work / "campaign" / "jump-0001" / "experiment.toml"
    toml.write_text('exclude = "lamp failed"\n' + toml.read_text())
    assert run_here(work / "campaign", work / "results") == 0
    assert "jump-0001" in (table := (work / "results" / "jumps.csv").read_text())
    assert "excluded: lamp failed" in table


@pytest.mark.parametrize("number", [0, 2])
def test_other_schema_numbers_are_refused_with_the_way_out(work, number, capsys):
    toml = work / "campaign" / "jump-0001" / "experiment.toml"
    toml.write_text(f"schema = {number}\n" + toml.read_text())
    assert main(["check", str(work / "campaign")]) == 2
    assert f"schema = {number}" in (err := capsys.readouterr().err)
    assert ("newer" if number else "older") in err


@pytest.mark.parametrize(
    "file", ["/etc/passwd", "../../../x.csv", "a/../../../x.csv", "../../../*.csv", "../campaignx"]
)
def test_no_recording_from_outside_the_campaign(work, file):
    (work / "campaignx").write_text("x")
    toml = work / "campaign" / "jump-0001" / "experiment.toml"
    toml.write_text(toml.read_text().replace("rod_track.csv", file.replace("../campaignx", "../../campaignx")))
    with pytest.raises(InputError, match="outside"):
        open_experiment(toml.parent)


class Bomb:
    def __reduce__(self):
        return os.mkdir, ("pickle-was-run",)


@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_no_code_from_data_files(tmp_path, monkeypatch, suffix):
    from jumpvision.experiment.inputs.sections import CraterDepth
    from jumpvision.experiment.stages.bed.crater import read_map

    monkeypatch.chdir(tmp_path)
    path = tmp_path / f"a{suffix}"
    bomb = np.array([[Bomb(), Bomb()]] * 2, dtype=object)
    np.savez(path, a=bomb) if suffix == ".npz" else np.save(path, bomb, allow_pickle=True)
    with pytest.raises(ValueError, match=r"a\.np"):
        read_map(CraterDepth(file=path.name, path=path))
    if suffix == ".npy":
        with pytest.raises(FrameError):
            open_frames(path)
    assert not (tmp_path / "pickle-was-run").exists()


def test_no_objects_from_hdf5(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as f:
        f.create_dataset("film", (3, 4, 5), dtype=h5py.special_dtype(vlen=str))
    with pytest.raises(FrameError):
        open_frames(tmp_path / "a.h5")


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


@pytest.mark.parametrize("kind", ["cine", "mraw", "seq", "tiff"])
def test_absurd_headers_take_no_memory(tmp_path, kind):
    path = absurd(tmp_path)[kind]
    with open_frames(path, frame_rate=100.0) as film:  # the imports
        film[0]
    tracemalloc.start()
    try:
        with open_frames(path, frame_rate=100.0) as film:
            assert 1 <= len(film) <= 3
            assert film.truncated
            film[0]
        assert tracemalloc.get_traced_memory()[1] < 20e6  # the file has some 10 kB; 10^9 frames would be terabytes
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
    assert main(["cache", str(results), "--all"]) == 0
    assert cache.entries_of(results / ".cache") == []
    before = results_of(results)
    assert run_here(work / "campaign", results) == 0
    assert results_of(results) == before


@pytest.mark.parametrize("call", [["--older-than", "3 fortnights"], ["--keep", "much"], ["--keep=-5GB"]])
def test_a_wrong_cache_call_is_refused(work, call, capsys):
    assert main(["cache", str(work / "results"), *call]) == 2
    assert "must be a number with a unit" in capsys.readouterr().err


def test_an_entry_pruned_while_it_is_used_is_computed_again(work, calm, monkeypatch):
    """Each entry vanishes once between reading it and copying its files."""
    from jumpvision.experiment.workflow.workspace import Workspace

    true, gone = Workspace._publish, set()

    def publish(self, entry, receipt):
        if entry not in gone:
            gone.add(entry)
            storage.remove_aside(entry, self.cache)
        return true(self, entry, receipt)

    monkeypatch.setattr(Workspace, "_publish", publish)
    shutil.rmtree(work / "results" / "jump-0000")
    shutil.rmtree(work / "results" / "jump-0001")
    assert run_here(work / "campaign", work / "results") == 0
    assert gone
    assert results_of(work / "results") == results_of(calm / "results")
