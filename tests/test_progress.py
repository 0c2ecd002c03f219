"""Progress that is true: time left from what was measured, one line a phase, nothing silent."""

from __future__ import annotations

import contextlib
import os
import re
import sys
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from jumpvision.cli.progress import Job, Progress, spoken
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


def told(jobs: dict[str, Job], ended: list[tuple[str, float, int]], capsys) -> list[str]:
    """The lines of a campaign of these jobs. ended: (name, seconds after the last, stages computed)."""
    now = [0.0]
    shown = Progress(clock=lambda: now[0])
    shown.jobs = jobs
    with shown:
        for name, seconds, computed in ended:
            now[0] += seconds
            shown.experiment(Ended(name, computed=computed))
    *lines, last = capsys.readouterr().err.splitlines()
    assert last == f"experiments: {len(jobs)} done in {spoken(now[0])}"
    return lines


def test_what_was_compiled_in_the_first_is_not_expected_of_all(capsys):
    """25 jobs of 22 s, the first with 200 s of compiling: after the second 23 x 22 s are left."""
    jobs = {str(k): Job("logs", 1.0) for k in range(25)}
    lines = told(jobs, [("0", 222.0, 1), *((str(k), 22.0, 1) for k in range(1, 25))], capsys)
    assert lines[0] == "experiments (logs): 1 of 25"  # one of its kind tells nothing yet
    assert lines[1] == "experiments (logs): 2 of 25, about 8 min left"
    assert lines[-1] == "experiments (logs): 24 of 25, about 22 s left"  # and none says that nothing is left


def test_a_long_film_is_in_proportion_to_its_size_and_one_of_a_kind_is_not_guessed(capsys):
    jobs = {"a": Job("films", 1.0), "b": Job("films", 2.0), "c": Job("films", 10.0), "x": Job("logs", 1.0)}
    lines = told(jobs | {"y": Job("logs", 1.0)}, [("a", 30.0, 1), ("b", 60.0, 1), ("x", 9.0, 1)], capsys)
    assert lines == [
        "experiments (films): 1 of 3",
        "experiments (films): 2 of 3, about 5 min left",
        "experiments (logs): 1 of 2",
    ]


def test_what_was_kept_from_before_tells_nothing_of_the_others(capsys):
    jobs = {str(k): Job("logs", 1.0) for k in range(10)}
    ended = [*((str(k), 0.1, 0) for k in range(5)), ("5", 30.0, 1), ("6", 30.0, 1)]
    assert told(jobs, ended, capsys)[-1] == "experiments (logs): 7 of 10, about 2 min left"


def test_one_line_a_phase_and_none_says_that_nothing_is_left(capsys):
    """A campaign of 25 whose experiments take no time, then its diagnosis, then 3 pictures."""
    campaign = open_campaign(SAMPLES / "loose_sand")
    names = [e.name for e in campaign.experiments]
    with Progress(campaign, phases=("experiments", "diagnosis", "pictures")) as shown:
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


def test_long_work_is_not_silent_where_no_line_is_written_over(capsys):
    """A film of 100 pairs at 3 s each: a line every 20 s and more, with what is left by the pairs so far."""
    now = [0.0]
    shown = Progress(clock=lambda: now[0])
    for k in range(101):
        shown.frames("pairs matched", k, 100)
        now[0] += 3.0
    told = capsys.readouterr().err.splitlines()
    assert told[0] == "pairs matched: 7 of 100, about 5 min left" and told[-1] == "pairs matched: 100 done in 5 min"
    assert 12 <= len(told) <= 16


@pytest.mark.skipif(sys.platform == "win32", reason="has no pseudo-terminals")
def test_a_bar_in_a_terminal_leaves_stdout_and_the_cursor_as_they_were(capsys, monkeypatch):
    """Frames done, all frames and time left are shown; then a line in its place, and an interruption shows none."""
    ours, its = os.openpty()
    monkeypatch.setattr(sys, "stderr", os.fdopen(its, "w", buffering=1))
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("NO_COLOR", "1")
    now = [0.0]
    with pytest.raises(KeyboardInterrupt), Progress(clock=lambda: now[0]) as shown:
        for what, last in (("films", 100), ("pairs", 51)):
            for k in range(last + 1):
                shown.frames(what, k, 100)
                now[0] += 1.0
            print("a result")
        shown.bars.refresh()
        raise KeyboardInterrupt
    sys.stderr.close()
    screen = ""
    with contextlib.suppress(OSError):  # at its end
        while part := os.read(ours, 4096):
            screen += part.decode(errors="replace")
    os.close(ours)
    assert re.search(r"pairs: 51 of 100 .*0:00:49", screen)
    assert "films: 100 done in 2 min" in screen and "pairs: 51 done" not in screen
    assert screen.index("\x1b[?25l") < screen.index("pairs") < screen.rindex("\x1b[?25h") and "result" not in screen
    assert "\x1b[?25l" not in screen[screen.rindex("\x1b[?25h") :] and not re.search(r"\x1b\[3\dm", screen)
    assert capsys.readouterr().out == "a result\n" * 2
