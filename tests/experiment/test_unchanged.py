"""A run in which nothing changed computes nothing; whatever did change, of what a result rests on, is seen."""

from __future__ import annotations

import dataclasses
import os
import shutil
from pathlib import Path

import pytest

from jumpvision.base import storage
from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.experiment.workflow import stamps
from jumpvision.experiment.workflow.run import Plan, run_experiment
from jumpvision.experiment.workflow.stage import StageWarning
from tests.worlds.small import results_of

PLAN = {"stages": None, "command": "jumpvision run"}


@pytest.fixture
def place(calm, tmp_path) -> Path:
    return Path(shutil.copytree(calm / "campaign" / "jump-0000", tmp_path / "jump"))


def ran(place: Path, *, into: str = "results", overrides=None, **options):
    """Outcome of a run of one experiment."""
    results = place.parent / into
    plan = Plan(results, results / ".cache", **{**PLAN, **options})
    return run_experiment(open_experiment(place, overrides=overrides), plan, results)


def told(step):
    return dataclasses.replace(step, seconds=0.0, state="")


def test_a_run_in_which_nothing_changed_reads_no_recording_and_no_result(place, monkeypatch):
    first = ran(place)
    assert first.computed == len(first.steps) > 2
    monkeypatch.setattr(storage, "FRESH", -1e9)  # as if all had lain there for long
    before = results_of(place.parent / "results")
    ran(place)
    read = []
    monkeypatch.setattr(stamps, "sha256", lambda f: read.append(f))
    for _ in range(2):
        again = ran(place)
        assert again.computed == 0 and not read
        assert [*map(told, again.steps)] == [*map(told, first.steps)]
        assert (again.summary, again.not_run, again.warnings) == (first.summary, first.not_run, first.warnings)
        assert results_of(place.parent / "results") == before


def touch(file: Path) -> None:
    os.utime(file)


def edit(file: Path) -> None:
    """One byte other, size and date kept: the time of its last change tells."""
    before, data = file.stat(), bytearray(file.read_bytes())
    data[-3] = ord("1") if data[-3] != ord("1") else ord("2")
    file.write_bytes(data)
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))


CHANGES = {  # what is done in the folder above the experiment, whether something must be computed again
    "log edited": (lambda at: edit(at / "jump" / "rod_track.csv"), True),
    "log touched": (lambda at: touch(at / "jump" / "rod_track.csv"), False),
    "a key": (lambda at: edit_toml(at, "amplitude = 0.004", "amplitude = 0.005"), True),
    "a result removed": (lambda at: (at / "results" / "rod.csv").unlink(), False),
    "an entry edited": (lambda at: edit(entry(at) / "fits.json"), True),
    "a receipt edited": (lambda at: edit(entry(at) / "receipt.json"), True),
}


def edit_toml(at: Path, old: str, new: str) -> None:
    toml = at / "jump" / "experiment.toml"
    text = toml.read_text()
    assert old in text
    toml.write_text(text.replace(old, new))


def entry(at: Path) -> Path:
    """The entry that was made last, which is in use."""
    return max((at / "results" / ".cache" / "fit").iterdir(), key=lambda f: f.stat().st_ctime_ns)


@pytest.mark.parametrize("settled", [False, True])
@pytest.mark.filterwarnings("ignore::jumpvision.experiment.workflow.stage.StageWarning")
def test_a_change_is_seen(place, monkeypatch, settled):
    for what, (change, computed) in CHANGES.items():
        monkeypatch.undo()
        ran(place)
        if settled:
            monkeypatch.setattr(storage, "FRESH", -1e9)  # as if all had lain there for long
            ran(place)
        change(place.parent)
        outcome = ran(place)
        assert not outcome.errors and (outcome.computed > 0) == computed, what
        assert ran(place).computed == 0, what
    shutil.copytree(place, place.parent / "fresh" / "jump")
    ran(place.parent / "fresh" / "jump")
    assert results_of(place.parent / "results") == results_of(place.parent / "fresh" / "results")


def test_an_edit_in_the_moment_of_the_run_is_seen_though_no_date_tells(place, monkeypatch):
    """A file of the same stamp as before, and hashed so shortly after its change that this says nothing."""
    monkeypatch.setattr(storage, "FRESH", 1e9)
    ran(place)
    log = place / "rod_track.csv"
    true, seen = stamps.stamp, storage.stamp(log)
    edit(log)
    monkeypatch.setattr(stamps, "stamp", lambda f: seen if str(f) == str(log) else true(f))
    assert ran(place).computed


def test_what_is_read_is_checked_though_its_stamp_is_known(place, monkeypatch):
    """A byte of an entry that changes without a date, as a disk that fails changes it, enters no other result."""
    ran(place)
    monkeypatch.setattr(storage, "FRESH", -1e9)
    ran(place)
    file = next((place.parent / "results" / ".cache" / "rod").glob("*/rod.csv"))
    true, seen = stamps.stamp, storage.stamp(file)
    before = results_of(place.parent / "results")["fits.json"]
    edit(file)
    monkeypatch.setattr(stamps, "stamp", lambda f: seen if str(f) == str(file) else true(f))
    shutil.rmtree(entry(place.parent))
    with pytest.warns(StageWarning, match="damaged in the cache; computed again"):
        assert {s.stage for s in ran(place).steps if s.state == "computed"} == {"rod", "fit"}
    assert results_of(place.parent / "results")["fits.json"] == before
