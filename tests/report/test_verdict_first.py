"""What was found is told before the pictures are drawn; what failed is not tried twice."""

from __future__ import annotations

from jumpvision.cli import main
from jumpvision.experiment.campaign.folder import run_folder
from jumpvision.experiment.inputs.experiment import open_folder
from jumpvision.experiment.workflow.run import Plan
from jumpvision.report.figures import ON_PAGES, PICTURES, pictures
from jumpvision.report.pages.page import FILMS
from jumpvision.report.pages.page import PICTURES as PAGE_PICTURES
from tests.worlds.small import grain_film, results_of, write_campaign


class Watching:
    """What was there when all was found."""

    def __init__(self, results):
        self.results, self.told, self.ended, self.drew = results, [], [], []

    def frames(self, what, done, total):
        pass

    def experiment(self, outcome):
        self.ended.append(outcome.name)

    def pictures(self, outcome, names):
        self.drew.append(outcome.name)

    def found(self, run):
        made = {f.suffix for f in self.results.rglob("*") if ".cache" not in f.parts and f.parent != self.results}
        self.told.append((made, sum(o.undrawn for o in run.outcomes), (self.results / "jumps.csv").exists()))


def ran(campaign, results):
    watcher = Watching(results)
    plan = Plan(results, results / ".cache", pictures=PICTURES)
    run = run_folder(open_folder(campaign), plan, workers=1, watcher=watcher, draw=lambda *_: b"", say=lambda _: None)
    return run, watcher


def test_all_numbers_are_told_before_a_picture_is_drawn(tmp_path):
    campaign, results = write_campaign(tmp_path / "campaign", 2), tmp_path / "results"
    run, watcher = ran(campaign, results)
    [(made, undrawn, table)] = watcher.told
    assert ".csv" in made and ".png" not in made and undrawn == 2 and table
    assert len(watcher.ended) == 2  # each told once, not with its pictures again
    assert sorted(watcher.drew) == sorted(watcher.ended)
    for o in run.outcomes:
        assert (o.results / "jump.png").exists() and not o.errors and not o.undrawn
        assert {s.stage: s.state for s in o.steps}["rod"] == "computed"
    before = results_of(results)
    again, watcher = ran(campaign, results)
    assert watcher.told[0][1] == 0 and not any(o.computed for o in again.outcomes)
    assert results_of(results) == before


def test_a_picture_that_fails_is_told_beside_what_was_found(tmp_path, monkeypatch):
    def broken(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(pictures, "png", broken)
    campaign, results = write_campaign(tmp_path / "campaign", 2), tmp_path / "results"
    (campaign / "jump-0001" / "rod_track.csv").write_text("time_s,height_m\n0,0\n1,nonsense\n")
    run, watcher = ran(campaign, results)
    assert watcher.told[0][2] and "No space left" in run.outcomes[0].errors[0]
    assert (results / "jump-0000" / "rod.csv").exists()
    assert len(run.outcomes[1].errors) == 1 and "rod_track.csv" in run.outcomes[1].errors[0]  # tried once, not drawn


def page_of(results) -> str:
    return (results / "report.html").read_text(encoding="utf-8")


def test_a_campaigns_run_draws_what_is_seen_first_and_report_the_rest_which_stays(tmp_path):
    campaign, results = write_campaign(tmp_path / "campaign", 2), tmp_path / "results"
    grain_film(campaign / "film", 6)
    asked = [str(campaign), "--results", str(results), "--workers", "1"]
    assert main(["run", *asked]) == 0
    assert not [f for f in results.rglob("*") if f.suffix in (".png", ".webm")]
    command = f"jumpvision report {campaign} --results {results}"
    for page in (page_of(results), page_of(results / "film")):  # how to have them
        assert "data:image" not in page and command in page
    assert "data:image" not in page_of(results / "jump-0000") and command not in page_of(results / "jump-0000")

    assert main(["report", *asked]) == 0 and {*PAGE_PICTURES, *FILMS} == set(ON_PAGES)
    made = {f: f.stat().st_mtime_ns for f in results.glob("*/*") if f.suffix in (".png", ".webm")}
    assert {"piv.png", "flow.png", "validation.png", "piv.webm"} <= {f.name for f in made}
    assert not [f for f in made if f.parent.name != "film"]  # pages draw all of a jump by themselves
    for page in (page_of(results), page_of(results / "film")):
        assert "data:image" in page and command not in page
    assert page_of(results / "film").count("<video") == 1
    assert main(["run", *asked]) == 0
    assert {f: f.stat().st_mtime_ns for f in results.glob("*/*") if f.suffix in (".png", ".webm")} == made
    assert page_of(results / "film").count("<video") == 1
