"""A run in which nothing changed computes nothing; whatever did change, of what a result rests on, is seen."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import time
from pathlib import Path

import pandas as pd
import pytest
from fault_lab import results_of, run_here, write_campaign

from jumpvision.base import storage
from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.experiment.results.summary import JumpRow, Summary, Uncertain
from jumpvision.experiment.workflow import cache, stamps
from jumpvision.experiment.workflow.run import Plan, run_experiment
from jumpvision.experiment.workflow.stage import StageWarning

PLAN = {"stages": None, "command": "jumpvision run"}


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """folder/campaign with two experiments, folder/results. Not to be changed."""
    folder = tmp_path_factory.mktemp("made")
    campaign = write_campaign(folder / "campaign", 2)
    time.sleep(storage.FRESH)
    assert run_here(campaign, folder / "results") == 0
    return folder


@pytest.fixture
def place(made, tmp_path) -> Path:
    return Path(shutil.copytree(made / "campaign" / "jump-0000", tmp_path / "jump"))


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
    "a result edited": (lambda at: edit(at / "results" / "fits.json"), False),
    "a result removed": (lambda at: (at / "results" / "rod.csv").unlink(), False),
    "provenance removed": (lambda at: (at / "results" / "provenance.json").unlink(), False),
    "an entry removed": (lambda at: shutil.rmtree(entry(at)), True),
    "an entry edited": (lambda at: edit(entry(at) / "fits.json"), True),
    "a receipt edited": (lambda at: edit(entry(at) / "receipt.json"), True),
}


def edit_toml(at: Path, old: str, new: str) -> None:
    toml = at / "jump" / "experiment.toml"
    text = toml.read_text()
    assert old in text
    toml.write_text(text.replace(old, new))


def entry(at: Path) -> Path:
    return next((at / "results" / ".cache" / "fit").iterdir())


@pytest.mark.parametrize("settled", [False, True])
@pytest.mark.parametrize("what", CHANGES)
@pytest.mark.filterwarnings("ignore::jumpvision.experiment.workflow.stage.StageWarning")
def test_a_change_is_seen(place, monkeypatch, what, settled):
    change, computed = CHANGES[what]
    ran(place)
    if settled:
        monkeypatch.setattr(storage, "FRESH", -1e9)  # as if all had lain there for long
        ran(place)
    change(place.parent)
    outcome = ran(place)
    assert not outcome.errors
    assert (outcome.computed > 0) == computed
    assert ran(place).computed == 0
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


def test_other_questions_have_other_answers(place):
    ran(place)
    assert ran(place, overrides={"params": {"fit": {"debounce": 0.013}}}).computed
    assert not ran(place).computed
    assert [s.stage for s in ran(place, stages=("rod",)).steps] == ["rod"]
    assert not ran(place, verify=True).computed
    assert not ran(place, command="jumpvision report").computed
    told = json.loads((place.parent / "results" / "provenance.json").read_text())
    assert told["command"] == "jumpvision run"  # who made the results, not who found them whole


def test_a_result_of_a_stage_that_has_no_inputs_here_is_removed(place):
    """A killed run of other sections left a file that is no result of this experiment, and never put it down."""
    ran(place)
    results, toml = place.parent / "results", place / "experiment.toml"
    (results / "notes.txt").write_text("mine")
    (results / "provenance.json").unlink()
    toml.write_text(toml.read_text().split("[rod_track]")[0])
    ran(place)
    assert (results / "notes.txt").exists() and not (results / "rod.csv").exists()


def test_what_failed_is_tried_again(place):
    (place / "rod_track.csv").write_text("time_s,height_m\n0,nan\n")
    for _ in range(2):
        assert ran(place).errors


def test_entries_of_a_run_in_which_nothing_changed_count_as_used(place):
    ran(place)
    store = place.parent / "results" / ".cache"
    for f in (*store.glob("*/*/*"), *store.glob("*/*/")):
        os.utime(f, (time.time() - 40 * 86400,) * 2)
    assert len(cache.to_prune(cache.entries_of(store), older_than=30 * 86400.0)) == len(cache.entries_of(store)) > 0
    assert ran(place).computed == 0
    assert cache.to_prune(cache.entries_of(store), older_than=30 * 86400.0) == []


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


def test_the_table_of_jumps_is_that_of_pandas(made):
    """Written without it: its import takes longer than a run in which nothing changed."""
    from jumpvision.experiment.campaign.folder import write_jumps

    jumped = Summary("b", n_jumps=3, jump_height=Uncertain(1e-7, 0.1 + 0.2), mu=Uncertain(2.0))
    rows = [
        JumpRow('a "quoted", name', group="g", kind="single", frequency=7.0, delay=0.1 + 0.2),
        JumpRow("b", summary=jumped, problem="two\nlines"),
        JumpRow("c", problem="excluded: why", excluded=True),
    ]
    folder = made / "table"
    folder.mkdir()
    cells = [r.cells() for r in rows]
    assert write_jumps(rows, folder).read_text() == pd.DataFrame(cells, dtype=object).to_csv(
        index=False, lineterminator="\n"
    )
