"""What a campaign's run prints: the verdict first, then what stands out, then where to look."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from diagnosis_sample import diagnosis

from jumpvision.cli import terminal
from jumpvision.engine.document.values import Gain, Height
from jumpvision.experiment.campaign.odd import FAR, far_off, odd
from jumpvision.experiment.inputs.experiment import open_campaign
from jumpvision.experiment.results.summary import Summary, Uncertain
from jumpvision.experiment.workflow.run import Outcome

SAMPLES = Path(__file__).parents[1] / "data_samples"


def height(name: str, miss: float) -> Height:
    return Height(name, "single", 7.0, None, None, 0.02, 1e-4, 0.03, 0.02 + miss)


@pytest.fixture
def campaign():
    """The campaign of loose sand, with a height for each of its 25 jumps: the true one."""
    opened = open_campaign(SAMPLES / "loose_sand")
    from jumpvision.experiment.campaign.truth import truth_of

    outcomes = []
    for e in opened.experiments:
        true = truth_of(e.path)["summary"]["jump_height_m"]
        outcomes.append(Outcome(e.name, e.path, summary=Summary(e.name, jump_height=Uncertain(true, 1e-4, 0.0))))
    return opened, outcomes


def test_only_a_jump_that_the_model_misses_as_no_other_stands_out():
    """100 Gaussian misses and one of 10 sigma; one of FAR - 1 robust sigmas does not."""
    rng = np.random.default_rng(1)
    misses = rng.normal(0.0, 1e-4, 100)
    heights = [height(f"jump-{k}", m) for k, m in enumerate(misses)]
    assert far_off(heights) == []
    assert [h.experiment for h, _ in far_off([*heights, height("far", 1e-3)])] == ["far"]
    usual = 1.4826 * float(np.median(np.abs(misses - np.median(misses))))
    near = float(np.median(misses)) + (FAR - 1.0) * usual
    assert far_off([*heights, height("near", near)]) == []
    assert far_off([height("a", 0.0), height("b", 0.0), height("c", 1.0)]) == []  # of three none is usual


def test_why_an_experiment_stands_out(campaign):
    opened, outcomes = campaign
    assert odd(opened, outcomes, None) == {}
    outcomes[1].errors.append("x")
    outcomes[2] = Outcome(outcomes[2].name, opened.path)
    first = outcomes[3].summary
    off = Uncertain(first.values["jump_height_m"] + 3e-4, 1e-4, 0.0)
    outcomes[3] = dataclasses.replace(outcomes[3], summary=dataclasses.replace(first, jump_height=off))
    found = odd(opened, outcomes, None)
    assert found == {
        outcomes[1].name: "failed",
        outcomes[2].name: "no height",
        outcomes[3].name: "truth of height 3.0 sigma off",
    }


def test_the_verdict_comes_first_and_the_table_is_cut(campaign, capsys):
    opened, outcomes = campaign
    outcomes[1].errors.append("x")
    gain = Gain(("a", "b"), 9.9e-3, 0.3e-3, 8e-3, 0.2e-3, 40.0, (30.0, 50.0), True)
    found = diagnosis(sentence="The sentence.", gain=gain)
    terminal.tables(opened, outcomes, found)
    out = capsys.readouterr().out
    assert out.startswith("The sentence.\n")
    assert out.index("how sure:") < out.index("held-out error: track 8.000 -> 0.200 mm") < out.index("height [mm]")
    rows = [x for x in out.splitlines() if x.split("  ")[0] in {o.name for o in outcomes}]
    assert len(rows) == 1 and rows[0].rstrip().endswith("failed")
    assert "(and 24 experiments that do not stand out; --table shows all)" in out
    terminal.tables(opened, outcomes, found, whole=True)
    assert sum(x.split("  ")[0] in {o.name for o in outcomes} for x in capsys.readouterr().out.splitlines()) == 25
    terminal.tables(opened, outcomes, None)  # without a verdict the table is what was found
    assert sum(x.split("  ")[0] in {o.name for o in outcomes} for x in capsys.readouterr().out.splitlines()) == 25


def test_where_to_look_the_page_first(capsys):
    terminal.look_at([Path("a/diagnosis.json"), Path("a/diagnosis.png"), Path("a/report.html")])
    told = capsys.readouterr().err.splitlines()
    assert [x.split()[2] for x in told] == ["a/report.html", "a/diagnosis.png", "a/diagnosis.json"]
