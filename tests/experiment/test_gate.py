"""Nothing false: results are this run's, tables read them alone, a cache cannot be fooled and deletes only its own.

(About 15 s.)
"""

from __future__ import annotations

import json
import shutil
from types import SimpleNamespace

import pytest
from diagnosis_sample import diagnosis

from jumpvision.cli import main
from jumpvision.experiment.workflow import entries, provenance
from jumpvision.experiment.workflow.stage import StageWarning
from jumpvision.experiment.workflow.workspace import Workspace
from tests.worlds.small import results_of, run_here

# ---- the cache deletes its own alone ---------------------------------------------------------------------------------


def test_a_folder_that_only_looks_like_a_cache_is_refused(tmp_path, capsys):
    """`.cache` of a home folder, and folders of folders, hold other programs' files."""
    home = tmp_path / "home"
    for f in (home / ".cache" / "thumbnails" / "large" / "a.png", tmp_path / "data" / "films" / "2024" / "a.avi"):
        f.parent.mkdir(parents=True)
        f.write_text("precious")
    for place in (home, home / ".cache", tmp_path / "data"):
        assert main(["cache", str(place), "--all"]) == 2
        assert "no cache of jumpvision here" in capsys.readouterr().err
    assert (home / ".cache" / "thumbnails" / "large" / "a.png").exists()
    assert (tmp_path / "data" / "films" / "2024" / "a.avi").exists()


def test_in_a_cache_only_sealed_entries_are_deleted(work):
    """--cache may be a folder that holds other things too."""
    store = work / "results" / ".cache"
    whole = next((store / "fit").iterdir())
    beside = shutil.copytree(whole, store / "fit" / "0123456789abcdef01234567")  # the entry of another place
    (noted := next((store / "rod").iterdir())).joinpath("notes.txt").write_text("mine")
    foreign = [store / "films" / "2024" / "a.avi", store / "writing-HOST-old" / "x" / "y", beside / entries.RECEIPT]
    foreign += [noted / "notes.txt", noted / "rod.csv", store / "fit" / "list.json", store / "fit" / "linked"]
    outside = work / "outside"
    shutil.copytree(whole, outside)
    for f in foreign:
        f.parent.mkdir(parents=True, exist_ok=True)
        if f.name == "linked":
            f.symlink_to(outside)
        elif not f.exists():
            f.write_text("{}")
    assert main(["cache", str(work / "results"), "--all"]) == 0
    assert not whole.exists()
    assert all(f.exists() for f in foreign) and (outside / "fits.json").exists()
    assert run_here(work / "campaign", work / "results") == 0  # a folder writing-HOST-old is in nobody's way


# ---- results are exactly this run's ----------------------------------------------------------------------------------


def test_a_section_that_is_removed_takes_its_results_along(work, capsys):
    """A file of the user's stays; a result that was edited is put by, and said."""
    results, toml = work / "results" / "jump-0000", work / "campaign" / "jump-0000" / "experiment.toml"
    (results / "notes.txt").write_text("mine")
    (results / "rod.csv").write_text("edited by hand")
    toml.write_text(toml.read_text().replace("[rod_track]\nfile", "#"))
    run_here(work / "campaign", work / "results")
    left = {f.name: f.read_text() for f in results.iterdir() if f.name in ("notes.txt", "rod.csv.old")}
    assert left == {"notes.txt": "mine", "rod.csv.old": "edited by hand"}
    assert not any((results / n).exists() for n in ("rod.csv", "fits.json", "provenance.json"))
    assert "rod.csv" in capsys.readouterr().err


def test_two_runs_with_different_values_do_not_mix(work):
    """One stage run alone with other values: what no longer fits it goes, what still does stays, and all is told."""
    experiment, results = work / "campaign" / "jump-0000", work / "one"
    assert run_here(experiment, results) == 0
    whole = results_of(results)
    assert main(["rod", str(experiment), "--results", str(results), "--no-pictures"]) == 0
    assert {k: v for k, v in results_of(results).items() if k != "provenance.json"} == {
        k: v for k, v in whole.items() if k != "provenance.json"
    }
    assert (
        main(["fit", str(experiment), "--results", str(results), "--set", "fit.debounce=0.013", "--no-pictures"]) == 0
    )
    assert (results / "fits.json").exists() and (results / "rod.csv").exists()
    assert not (results / "summary.json").exists()  # it was made of other fits
    told = json.loads((results / "provenance.json").read_text())
    assert told["parameters"]["fit"]["debounce"] == 0.013
    there = {f.name for f in results.iterdir() if f.is_file()} - {"provenance.json", "report.html"}
    assert set(told["outputs"]) == there


def test_tables_of_a_campaign_do_not_outlive_its_experiments(work, capsys):
    """jumps.csv of other values is no table of these; a table that still holds stays."""
    table = work / "results" / "jumps.csv"
    assert main(["rod", str(work / "campaign"), "--results", str(work / "results"), "--workers", "1"]) == 0
    assert table.exists()
    call = ["fit", str(work / "campaign"), "--results", str(work / "results"), "--workers", "1"]
    assert main([*call, "--set", "robot.motor_mass=1.1"]) == 0
    assert not table.exists()
    shutil.rmtree(work / "campaign" / "jump-0001")
    capsys.readouterr()
    assert run_here(work / "campaign", work / "results") == 0
    assert "jump-0001: results of an experiment that the campaign no longer has" in capsys.readouterr().err
    assert "jump-0001" not in table.read_text()


@pytest.mark.parametrize("removed", [True, False])
def test_results_overwritten_or_removed_in_mid_run_are_this_runs_at_its_end(calm, tmp_path, monkeypatch, removed):
    true = Workspace.confirm

    def confirm(self):
        for f in self.results.iterdir():
            f.unlink() if removed else f.write_text("of a run with other values")
        true(self)

    monkeypatch.setattr(Workspace, "confirm", confirm)
    assert run_here(calm / "campaign", tmp_path / "results") == 0
    assert results_of(tmp_path / "results") == results_of(calm / "results")


def test_results_do_not_go_among_the_recordings(work, capsys):
    before = {f: f.read_bytes() for f in (work / "campaign").rglob("*") if f.is_file()}
    assert run_here(work / "campaign", work / "campaign") == 2
    assert "holds recordings" in capsys.readouterr().err
    assert {f: f.read_bytes() for f in (work / "campaign").rglob("*") if f.is_file()} == before


# ---- provenance ------------------------------------------------------------------------------------------------------


def test_versions_are_those_that_made_the_results(work, monkeypatch, capsys):
    """Yesterday's results under today's libraries: the versions stay, are said to differ, and are redone on demand."""
    before = results_of(work / "results")
    then = entries.versions()
    now = {**then, "numpy": "99.0"}
    monkeypatch.setattr(entries, "versions", lambda: now)
    for name in ("jumpvision.experiment.workflow.provenance.versions", "jumpvision.experiment.workflow.run.versions"):
        monkeypatch.setattr(name, lambda: now)
    assert run_here(work / "campaign", work / "results") == 0
    err = capsys.readouterr().err
    assert f"made with other versions (numpy {then['numpy']}, now 99.0)" in err
    told = work / "results" / "jump-0000" / "provenance.json"
    assert json.loads(told.read_text())["versions"]["numpy"] == then["numpy"]
    shutil.rmtree(next((work / "results" / ".cache" / "summary").iterdir()))
    assert run_here(work / "campaign", work / "results") == 0
    mixed = [json.loads(f.read_text()) for f in (work / "results").glob("jump-*/provenance.json")]
    assert {m["versions"]["numpy"] for m in mixed} == {then["numpy"], f"{then['numpy']}, 99.0"}
    one = next(m for m in mixed if "99.0" in m["versions"]["numpy"])
    assert one["made"]["summary"]["versions"]["numpy"] == "99.0"
    assert one["made"]["fit"]["versions"]["numpy"] == then["numpy"]
    capsys.readouterr()
    assert run_here(work / "campaign", work / "results", "--fresh-if-versions-differ") == 0
    assert "other versions" not in (err := capsys.readouterr().err) and "nothing recomputed" not in err
    assert json.loads(told.read_text())["versions"]["numpy"] == "99.0"
    assert results_of(work / "results") == before
    assert run_here(work / "campaign", work / "results", "--fresh-if-versions-differ") == 0
    assert "nothing recomputed" in capsys.readouterr().err


# ---- the diagnosis' cache --------------------------------------------------------------------------------------------


@pytest.fixture
def asking(tmp_path, monkeypatch):
    """(ask, entry): a diagnosis whose answer is given; `ask` says how often it had to be found."""
    from jumpvision.experiment.campaign import diagnose

    found = []

    class Asked:
        def digest(self):
            return "of everything"

    def answer(asked, path, workers, draw, say):
        found.append(draw)
        return diagnose.Answer(diagnosis(), {"model.toml": "[model]\n"}, b"picture")

    monkeypatch.setattr(diagnose, "asked_of", lambda *_: Asked())
    monkeypatch.setattr(diagnose, "_answer", answer)
    campaign = SimpleNamespace(path=tmp_path)

    def ask(**options):
        how = {"workers": 1, "draw": lambda *_: b"", "say": print, **options}
        _, files = diagnose.question(campaign, {}, tmp_path, tmp_path / "cache", **how)
        assert json.loads((tmp_path / "diagnosis.json").read_text())["sentence"] == "Said."
        assert (tmp_path / "model.toml").read_text() == "[model]\n"
        return len(found), {f.name for f in files}

    return ask, lambda: next((tmp_path / "cache" / "diagnose").iterdir())


def test_a_diagnosis_is_asked_again_only_where_it_must_be(asking, monkeypatch):
    """Not for its picture; where its entry was edited or torn, or, on demand, where versions differ."""
    ask, entry = asking
    assert ask(pictured=False) == (1, {"diagnosis.json", "model.toml"})
    assert ask() == (1, {"diagnosis.json", "model.toml", "diagnosis.png"})
    asked = 1
    for name in ("model.toml", "diagnosis.json", "diagnosis.png", "receipt.json"):
        for damage in (lambda b: b + b"#", lambda b: b[: len(b) // 2]):
            file = entry() / name
            file.write_bytes(damage(file.read_bytes()))
            asked += 1
            with pytest.warns(StageWarning, match="asked again"):
                assert ask()[0] == asked, name
            assert ask()[0] == asked
    monkeypatch.setattr(entries, "versions", lambda: {"numpy": "99.0"})
    assert [ask()[0], ask(fresh=True)[0], ask(fresh=True)[0]] == [asked, asked + 1, asked + 1]


def test_the_model_of_a_diagnosis_outlives_a_stage_run_with_it(tmp_path):
    """simulate --model results/model.toml is the way on from a diagnosis: it must not take the file away."""
    for name in ("model.toml", "jumps.csv"):
        (tmp_path / name).write_text(name)
    provenance.settle_tables(tmp_path, {"a": "1"}, ["model.toml", "jumps.csv"], "run")
    (note,) = provenance.settle_tables(tmp_path, {"a": "2"}, [], "simulate", lasting=["model.toml"])
    assert "model.toml in" in note and "of other values" in note
    assert (tmp_path / "model.toml").exists() and not (tmp_path / "jumps.csv").exists()
    assert provenance.settle_tables(tmp_path, {"a": "3"}, [], "run") == []
    assert not (tmp_path / "model.toml").exists()
