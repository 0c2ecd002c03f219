"""A run in which nothing changed looks into nothing; whatever did change, of what a result rests on, is seen."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import os
import shutil
import subprocess
import sys
import time
import tracemalloc
from pathlib import Path

import pandas as pd
import pytest
from fault_lab import results_of, run_here, write_campaign

from jumpvision.base import storage
from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.experiment.inputs.sections import NotApplicable
from jumpvision.experiment.results.summary import JumpRow, Summary, Uncertain
from jumpvision.experiment.results.tables import RodMotion
from jumpvision.experiment.workflow import cache, run, unchanged
from jumpvision.experiment.workflow.hashes import Hashed, packed, unpacked
from jumpvision.experiment.workflow.run import Plan, run_experiment
from jumpvision.experiment.workflow.stage import STAGES

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


def asked(place: Path, monkeypatch, *, into: str = "results", overrides=None, **options):
    """(outcome of a run of one experiment, whether it was told from its note)."""
    looked = []
    with monkeypatch.context() as patch:
        true = run.Workspace
        patch.setattr(run, "Workspace", lambda *a, **k: looked.append(1) or true(*a, **k))
        results = place.parent / into
        plan = Plan(results, results / ".cache", **{**PLAN, **options})
        e = open_experiment(place, overrides=overrides)
        return run_experiment(e, plan, results), not looked


def shown(step):
    """What is told of a step by its note: keys and digests stay there."""
    return step.stage, step.warnings, step.versions, list(step.files)


def test_what_is_told_is_what_was_done(place, monkeypatch):
    first, noted = asked(place, monkeypatch)
    assert not noted and first.computed == len(first.steps) > 2
    before = results_of(place.parent / "results")
    for _ in range(3):  # the first time by hashes, as files are new; then by dates
        again, noted = asked(place, monkeypatch)
        assert noted and again.computed == 0
        assert [*map(shown, again.steps)] == [*map(shown, first.steps)]
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
    "the note cut": (lambda at: cut(next((at / "results" / ".cache" / "notes").iterdir())), False),
}


def edit_toml(at: Path, old: str, new: str) -> None:
    toml = at / "jump" / "experiment.toml"
    text = toml.read_text()
    assert old in text
    toml.write_text(text.replace(old, new))


def entry(at: Path) -> Path:
    return next((at / "results" / ".cache" / "fit").iterdir())


def cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-20])


@pytest.mark.parametrize("settled", [False, True])
@pytest.mark.parametrize("what", CHANGES)
@pytest.mark.filterwarnings("ignore::jumpvision.experiment.workflow.stage.StageWarning")
def test_a_change_is_seen(place, monkeypatch, what, settled):
    change, computed = CHANGES[what]
    asked(place, monkeypatch)
    if settled:
        monkeypatch.setattr(storage, "FRESH", -1e9)  # as if all had lain there for long
        assert asked(place, monkeypatch)[1]
        assert asked(place, monkeypatch)[1]
    change(place.parent)
    outcome, noted = asked(place, monkeypatch)
    assert not noted and not outcome.errors
    assert (outcome.computed > 0) == computed
    assert asked(place, monkeypatch)[1]
    shutil.copytree(place, place.parent / "fresh" / "jump")
    asked(place.parent / "fresh" / "jump", monkeypatch)
    assert results_of(place.parent / "results") == results_of(place.parent / "fresh" / "results")


def test_an_edit_in_the_moment_of_the_run_is_seen_though_no_date_tells(place, monkeypatch):
    """A file of the same stamp as noted, and noted so shortly after its change that this says nothing."""
    monkeypatch.setattr(storage, "FRESH", 1e9)
    asked(place, monkeypatch)
    log = place / "rod_track.csv"
    true, noted = unchanged.stamp, storage.stamp(log)
    edit(log)
    monkeypatch.setattr(unchanged, "stamp", lambda f: noted if str(f) == str(log) else true(f))
    outcome, told = asked(place, monkeypatch)
    assert not told and outcome.computed


def test_other_questions_have_other_answers(place, monkeypatch):
    asked(place, monkeypatch)
    assert not asked(place, monkeypatch, overrides={"params": {"fit": {"debounce": 0.013}}})[1]
    assert not asked(place, monkeypatch)[1]
    assert not asked(place, monkeypatch, stages=("rod",))[1]
    assert not asked(place, monkeypatch)[1]
    assert asked(place, monkeypatch)[1]
    assert not asked(place, monkeypatch, verify=True)[1]
    assert asked(place, monkeypatch, command="jumpvision run --json")[1]
    monkeypatch.setattr(unchanged, "_code", lambda: "another version")
    assert not asked(place, monkeypatch, command="jumpvision report")[1]
    told = json.loads((place.parent / "results" / "provenance.json").read_text())
    assert told["command"] == "jumpvision run"  # who made the results, not who found them whole


def test_what_experiments_share_is_looked_at_by_one_and_stays_noted_by_all(tmp_path, monkeypatch):
    """The same drive on the same bed has one geometry: who read it made the note of the one before worthless."""
    campaign = write_campaign(tmp_path / "campaign", 2)
    shutil.copy(campaign / "jump-0000" / "experiment.toml", campaign / "jump-0001")
    toml = campaign / "campaign.toml"
    bed = "[bed]\nvolume_fraction = 0.57\nsolid_volume = 0.045\nlength = 0.56\nwidth = 0.56\n"
    robot = "foot_mass = 0.04\nfoot_radius = 0.0381\n"
    toml.write_text(toml.read_text().replace("hard", "granular") + robot + bed)
    assert run_here(campaign, tmp_path / "results") == 0
    assert len(list((tmp_path / "results" / ".cache" / "geometry").iterdir())) == 1
    looked = []
    true = run.Workspace
    monkeypatch.setattr(run, "Workspace", lambda *a, **k: looked.append(1) or true(*a, **k))
    assert run_here(campaign, tmp_path / "results") == 0
    assert not looked


NOTHING_NEW = """
import sys
from fault_lab import Path, run_here
assert run_here(Path(sys.argv[1]) / "campaign", Path(sys.argv[1]) / "results") == 0
print("loaded:", *sorted({"numba", "scipy", "pandas", "xarray", "cv2", "matplotlib"} & sys.modules.keys()))
"""


def test_where_nothing_changed_nothing_large_is_loaded(made):
    """What only stages and new pages need takes 2 s and 170 MB."""
    here = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, [Path(__file__).parent, *sys.path]))}
    call = [sys.executable, "-c", NOTHING_NEW, str(made)]
    said = [subprocess.run(call, capture_output=True, text=True, env=here, check=True).stdout for _ in range(2)]
    assert said[1].splitlines()[-1].strip() == "loaded:"


def test_memory_of_what_is_told_from_its_note(place, monkeypatch):
    """What all experiments of a campaign have alike is there once: 2 kB an experiment, 5.8 where it is not."""
    for _ in range(2):
        asked(place, monkeypatch)
    results = place.parent / "results"
    e, plan = open_experiment(place), Plan(results, results / ".cache", **PLAN)
    tracemalloc.start()
    try:
        before, told = tracemalloc.get_traced_memory()[0], []
        for _ in range(100):
            told.append(run_experiment(e, plan, results))
        each = (tracemalloc.get_traced_memory()[0] - before) / len(told)
    finally:
        tracemalloc.stop()
    assert all(not o.computed for o in told) and each < 2500, each


def test_a_result_of_a_stage_that_comes_from_elsewhere_is_looked_at(place, monkeypatch):
    """A killed run of other sections left a file that is no result of this experiment."""
    asked(place, monkeypatch)
    (place.parent / "results" / "notes.txt").write_text("mine")
    assert asked(place, monkeypatch)[1]
    (place.parent / "results" / "bed.json").write_text("{}")
    assert not asked(place, monkeypatch)[1]


def test_a_picture_of_what_there_is_not_keeps_nothing_from_being_noted(place, monkeypatch):
    """It has no entry of its own, which the note would look for in vain."""

    @functools.wraps(STAGES[RodMotion].function)
    def nothing(*args, **kwargs):
        raise NotApplicable(["no rod here"])

    monkeypatch.setitem(STAGES, RodMotion, dataclasses.replace(STAGES[RodMotion], function=nothing))
    pictures = ("jumpvision.report.figures.pictures",)
    assert "no rod here" in asked(place, monkeypatch, pictures=pictures)[0].not_run
    assert asked(place, monkeypatch, pictures=pictures)[1]


def test_what_failed_is_tried_again(place, monkeypatch):
    (place / "rod_track.csv").write_text("time_s,height_m\n0,nan\n")
    for _ in range(2):
        outcome, noted = asked(place, monkeypatch)
        assert outcome.errors and not noted


def test_a_new_frame_of_a_folder_is_seen(tmp_path):
    """The files of a recording are listed again, not only looked at."""
    folder = tmp_path / "film"
    folder.mkdir()
    (folder / "a.png").write_text("a")
    files = Hashed(str(folder), ["a.png"], packed("00" * 32, storage.stamp(folder / "a.png")))
    noted = {"foreign": [], "recordings": {str(folder): unchanged._files_noted(files, math.inf)}, "files": {}}
    assert unchanged._same(noted, tmp_path, time.time())
    (folder / "b.png").write_text("b")
    assert not unchanged._same(noted, tmp_path, time.time())


def test_entries_of_a_run_that_looked_into_nothing_count_as_used(place, monkeypatch):
    asked(place, monkeypatch)
    store = place.parent / "results" / ".cache"
    long_ago = time.time() - 40 * 86400
    monkeypatch.setattr(unchanged, "stamp", lambda f: storage.stamp(f)[:1])  # dates are set back here
    monkeypatch.setattr(unchanged, "settled", lambda *_: True)
    note = next((store / "notes").iterdir())
    content = storage.unsealed(note.read_text())
    files = {f: [v[0], v[-1]] for f, v in content["files"].items()}
    note.write_text(storage.sealed({**content, "recordings": {}, "files": files}))
    for f in (*store.glob("*/*/*"), *store.glob("*/*/")):
        os.utime(f, (long_ago,) * 2)
    os.utime(note, (long_ago,) * 2)
    assert len(cache.to_prune(cache.entries_of(store), older_than=30 * 86400.0)) == len(cache.entries_of(store)) > 0
    assert asked(place, monkeypatch)[1]
    assert cache.to_prune(cache.entries_of(store), older_than=30 * 86400.0) == []


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


@pytest.mark.parametrize("number", [0, 17, -1, 2**63, -(2**63), 2**128 - 1])
def test_a_digest_and_a_stamp_come_back_as_they_were_packed(number):
    """Dates before 1970 are negative, numbers of files on Windows have 128 bits."""
    digest, at = storage.sha256(Path(__file__)), (4096, number, 10**18 + 1, number)
    assert unpacked(packed(digest, at)) == (digest, at)
