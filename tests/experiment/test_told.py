"""What a campaign's run prints: the verdict first, then what stands out, then where to look."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from shared import SAMPLES

from jumpvision.engine.document.values import Height
from jumpvision.experiment.campaign.odd import FAR, far_off, odd
from jumpvision.experiment.campaign.truth import truth_of
from jumpvision.experiment.inputs.experiment import open_campaign
from jumpvision.experiment.results.summary import Summary, Uncertain
from jumpvision.experiment.workflow.run import Outcome


def height(name: str, miss: float) -> Height:
    return Height(name, "single", 7.0, None, None, 0.02, 1e-4, 0.03, 0.02 + miss)


@pytest.fixture
def campaign():
    """The campaign of loose sand, with a height for each of its 25 jumps: the true one."""
    opened = open_campaign(SAMPLES / "loose_sand")
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
