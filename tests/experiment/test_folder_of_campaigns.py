"""`run` on a folder of campaigns runs them all, or says what it leaves out."""

import json
import shutil

from shared import SAMPLES

from jumpvision.cli import main

TRACK = SAMPLES / "loose_sand" / "single-6.5Hz-1" / "rod_track.csv"
QUICK = ["--no-pictures", "--no-report", "--workers", "1"]


def made_of(folder, *names):
    for name in names:
        (folder / name).mkdir(parents=True)
        shutil.copy(TRACK, folder / name)
        (folder / name / "experiment.toml").write_text('[rod_track]\nfile = "rod_track.csv"\n')


def test_every_campaign_below_is_run_and_a_lost_experiment_named(tmp_path, capsys):
    top = tmp_path / "season"
    made_of(top, "loose")
    made_of(top / "march", "a", "b")
    made_of(top / "deep" / "april", "c")
    made_of(top / "loose", "forgotten")
    made_of(top / ".old", "hidden")
    assert main(["run", str(top), *QUICK, "--json"]) == 0
    said = capsys.readouterr()
    told = json.loads(said.out)["campaigns"]
    assert {k: [e["name"] for e in v["experiments"]] for k, v in told.items()} == {
        str(top): ["loose"],
        str(top / "deep" / "april"): ["c"],
        str(top / "march"): ["a", "b"],
    }
    results = tmp_path / "results" / "season"
    for place in ("loose", "march/a", "march/b", "deep/april/c"):
        assert (results / place / "provenance.json").exists()
    assert "left out" in said.err and str(top / "loose" / "forgotten") in said.err


def test_a_campaign_that_cannot_be_opened_does_not_stop_the_others(tmp_path, capsys):
    made_of(tmp_path / "top" / "good", "a")
    made_of(tmp_path / "top" / "bad", "b")
    (tmp_path / "top" / "bad" / "b" / "experiment.toml").write_text("ground = 'soft'\n")
    assert main(["run", str(tmp_path / "top"), *QUICK]) == 1
    assert "soft" in capsys.readouterr().err
    assert (tmp_path / "results" / "top" / "good" / "a" / "provenance.json").exists()
