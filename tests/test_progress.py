"""Progress that is true: time left from what was measured, one line a phase, nothing silent."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import pytest

from jumpvision.cli import progress
from jumpvision.cli.progress import Job, Phase, Progress, TimeLeft, spoken
from jumpvision.experiment.inputs.experiment import open_campaign

SAMPLES = Path(__file__).parents[1] / "data_samples"


@dataclass
class Ended:
    """What Progress reads of an outcome."""

    name: str
    seconds: float = 0.0
    computed: int = 1
    errors: list = field(default_factory=list)


@pytest.mark.parametrize(
    ("seconds", "said"), [(8.4, "8 s"), (89.0, "89 s"), (170.0, "3 min"), (4800.0, "80 min"), (9300.0, "2 h 35 min")]
)
def test_times_as_people_say_them(seconds, said):
    assert spoken(seconds) == said


def test_what_was_compiled_in_the_first_is_not_expected_of_all():
    """25 jobs of 4 s, the first with 200 s of compiling: after the second 23 x 4 s on 2 processors are left."""
    left = TimeLeft({str(k): Job("logs", 1.0) for k in range(25)}, 2)
    assert left.words == ""
    left.ended("0", 204.0)
    assert left.words == ""  # one of its kind tells nothing yet
    left.ended("1", 4.0)
    assert left.words == "about 46 s left"
    for k in range(2, 25):
        left.ended(str(k), 4.0)
    assert left.words == ""


def test_a_long_film_is_in_proportion_to_its_size_and_one_of_a_kind_is_said():
    jobs = {"a": Job("film", 1.0), "b": Job("film", 2.0), "c": Job("film", 10.0), "x": Job("logs", 1.0)}
    left = TimeLeft(jobs, 4)
    left.ended("a", 6.0)
    left.ended("b", 12.0)
    assert left.words == "about 60 s left, not counting 1 with logs"  # c alone, whatever the processors
    left = TimeLeft({**{str(k): Job("logs", 1.0) for k in range(4)}, "film": Job("a grain film", 9.0)}, 1)
    left.ended("0", 5.0)
    left.ended("1", 5.0)
    assert left.words == "about 10 s left, not counting 1 with a grain film"


def test_one_line_a_phase_and_none_says_that_nothing_is_left(capsys):
    """A campaign of 25 whose experiments take no time, then its diagnosis, then 3 pictures."""
    campaign = open_campaign(SAMPLES / "loose_sand")
    names = [e.name for e in campaign.experiments]
    with Progress(campaign, workers=2, phases=("experiments", "diagnosis", "pictures")) as shown:
        for name in names:
            shown.experiment(Ended(name, 4.0, errors=["x"] if name == names[3] else []))
        shown.question("fitting the baseline")
        shown.question("testing it")
        for name in names[:3]:
            shown.pictures(Ended(name, 1.0), names[:3])
    told = capsys.readouterr().err.splitlines()
    assert told == [
        f"[1/3] experiments: {names[3]} failed",
        "[1/3] experiments: 25 done in 0 s",
        "[2/3] diagnosis (0 s): fitting the baseline",
        "[2/3] diagnosis (0 s): testing it",
        "[2/3] diagnosis: done in 0 s",
        "[3/3] pictures: 3 done in 0 s",
    ]


def test_a_phase_that_is_interrupted_is_not_told_as_done(capsys):
    campaign = open_campaign(SAMPLES / "loose_sand")
    with pytest.raises(KeyboardInterrupt), Progress(campaign, phases=("experiments",)) as shown:
        shown.experiment(Ended(campaign.experiments[0].name))
        raise KeyboardInterrupt
    assert "done" not in capsys.readouterr().err


def test_long_work_is_not_silent_where_no_line_is_written_over(capsys, monkeypatch):
    """A film of 100 pairs at 3 s each: a line every 20 s and more, with what is left by the pairs so far."""
    now = [0.0]
    monkeypatch.setattr(progress, "Phase", lambda name, total: Phase(name, total, clock=lambda: now[0]))
    shown = Progress()
    for k in range(101):
        shown.frames("pairs matched", k, 100)
        now[0] += 3.0
    told = capsys.readouterr().err.splitlines()
    assert told[0] == "pairs matched: 7 of 100, about 5 min left" and told[-1] == "pairs matched: 100 done in 5 min"
    assert 12 <= len(told) <= 16
