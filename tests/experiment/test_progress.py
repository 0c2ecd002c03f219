"""Progress that is true: time left from what was measured, one line a phase, nothing silent."""

from __future__ import annotations

from dataclasses import dataclass, field

from jumpvision.cli.progress import Job, Progress, spoken


@dataclass
class Ended:
    """What Progress reads of an outcome."""

    name: str
    seconds: float = 0.0
    computed: int = 1
    errors: list = field(default_factory=list)


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


def test_what_was_kept_from_before_tells_nothing_of_the_others(capsys):
    jobs = {str(k): Job("logs", 1.0) for k in range(10)}
    ended = [*((str(k), 0.1, 0) for k in range(5)), ("5", 30.0, 1), ("6", 30.0, 1)]
    assert told(jobs, ended, capsys)[-1] == "experiments (logs): 7 of 10, about 2 min left"


def test_a_long_film_is_in_proportion_to_its_size_and_one_of_a_kind_is_not_guessed(capsys):
    jobs = {"a": Job("films", 1.0), "b": Job("films", 2.0), "c": Job("films", 10.0), "x": Job("logs", 1.0)}
    lines = told(jobs | {"y": Job("logs", 1.0)}, [("a", 30.0, 1), ("b", 60.0, 1), ("x", 9.0, 1)], capsys)
    assert lines == [
        "experiments (films): 1 of 3",
        "experiments (films): 2 of 3, about 5 min left",
        "experiments (logs): 1 of 2",
    ]


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
