"""How far a command is, on stderr: bars in a terminal, elsewhere a line a phase and one now and then."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, Self

from jumpvision.base.schema import harmless

if TYPE_CHECKING:
    from rich.progress import Task

    from jumpvision.experiment.campaign.folder import Run
    from jumpvision.experiment.inputs.experiment import Campaign, Experiment
    from jumpvision.experiment.workflow.run import Outcome

EXPERIMENTS, DIAGNOSIS, PICTURES = "experiments", "diagnosis", "pictures"  # phases of a run
EVERY = 20.0  # s between two lines of one task where there are no bars
ALL_TIME = 1e9  # s over which rich averages the speed: its 30 s hold no two films


def line(text: str) -> None:
    """One line on stderr."""
    print(harmless(text), file=sys.stderr, flush=True)


def spoken(seconds: float) -> str:
    """A time as a person says it: 8 s, 3 min, 1 h 20 min."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"


class Job(NamedTuple):
    """One of many. kind: jobs of one kind take times in proportion to their size."""

    kind: str
    size: float


def jobs_of(campaign: Campaign) -> dict[str, Job]:
    """The experiments of a campaign as jobs: by the film that takes longest, in proportion to its bytes."""
    return {e.name: _job(e) for e in campaign.experiments}


def _job(e: Experiment) -> Job:
    for name, kind in (("grain_video", "grain films"), ("rod_video", "rod films"), ("bed_image", "bed pictures")):
        if (section := e.sections.get(name)) is not None:
            path = section.path
            return Job(kind, float(path.stat().st_size) if path.is_file() else 1.0)
    return Job("logs alone", 1.0)


class Phase(NamedTuple):
    """One phase of a campaign. tasks: of each kind of its jobs."""

    name: str
    total: int | None
    began: float
    tasks: dict[str, Task]


class Progress:
    """Show one command's progress: films frame by frame for one experiment, phases for a campaign.

    tell: is called with what was found, before the pictures are drawn. clock: s.
    """

    def __init__(
        self,
        campaign: Campaign | None = None,
        *,
        tell: Callable[[Run], None] | None = None,
        phases: Sequence[str] = (),
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as Bars

        self.tell, self.phases, self.clock = tell, tuple(phases), clock
        self.jobs = jobs_of(campaign) if campaign else {}
        self.films: dict[str, Task] = {}
        self.phase: Phase | None = None
        self.bars = Bars(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            get_time=clock,
            speed_estimate_period=ALL_TIME,
            transient=True,
            redirect_stdout=False,  # else rich prints it on stderr
            disable=not sys.stderr.isatty(),
        )

    def __enter__(self) -> Self:
        if self.jobs:
            self._begin(EXPERIMENTS, len(self.jobs), self.jobs)
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        if error is None:  # else interrupted: not to be reported as done
            self._end()
        self.bars.stop()

    # -- one experiment --------------------------------------------------------------------------------------

    def frames(self, what: str, done: int, total: int | None) -> None:
        """Hook of `progress.watch`."""
        if what not in self.films or done == 0:
            self.films[what] = self._add(what, total, total)
        task = self.films[what]
        if task.finished:
            return
        self.bars.update(task.id, completed=done)
        self._show(task, done)
        if done and task.finished:
            self.bars.remove_task(task.id)
            line(f"{what}: {done} done in {spoken(task.elapsed or 0.0)}")

    # -- a campaign ------------------------------------------------------------------------------------------

    def experiment(self, outcome: Outcome) -> None:
        """One experiment has ended."""
        if outcome.errors:
            line(f"{self._numbered(EXPERIMENTS)}: {outcome.name} failed")
        self._job(EXPERIMENTS, outcome, self.jobs)

    def pictures(self, outcome: Outcome, names: Sequence[str]) -> None:
        """The pictures of one experiment, of these, are drawn."""
        self._job(PICTURES, outcome, {n: self.jobs[n] for n in names})

    def question(self, text: str) -> None:
        """A step of the diagnosis begins, or it has something to say."""
        phase = self._begin(DIAGNOSIS, None, {})
        line(f"{self._numbered(DIAGNOSIS)} ({spoken(self.clock() - phase.began)}): {text}")

    def found(self, run: Run) -> None:
        """The verdict and the tables, before the pictures are drawn."""
        self._end()
        self.bars.stop()
        if self.tell is not None and run.plan.whole and any(o.undrawn for o in run.outcomes):
            self.tell(run)
            run.shown = True

    # -- how it is shown -------------------------------------------------------------------------------------

    def _numbered(self, name: str) -> str:
        """[2/3] diagnosis: so that who waits knows what comes after."""
        if name not in self.phases:
            return name
        return f"[{self.phases.index(name) + 1}/{len(self.phases)}] {name}"

    def _job(self, name: str, outcome: Outcome, jobs: Mapping[str, Job]) -> None:
        kind, size = jobs[outcome.name]
        task = self._begin(name, len(jobs), jobs).tasks[kind]
        if outcome.computed or name == PICTURES:
            self.bars.update(task.id, advance=size)
        else:  # what was kept from before takes no time, and tells nothing of the others
            task.completed += size
        self._show(task, task.fields["done"] + 1)

    def _begin(self, name: str, total: int | None, jobs: Mapping[str, Job]) -> Phase:
        """Return the phase of this name: the one under way, else a new one."""
        if self.phase is None or self.phase.name != name:
            self._end()
            sizes: dict[str, list[float]] = {}
            for job in jobs.values():
                sizes.setdefault(job.kind, []).append(job.size)
            tasks = {k: self._add(f"{self._numbered(name)} ({k})", sum(s), len(s)) for k, s in sizes.items()}
            self.phase = Phase(name, total, self.clock(), tasks)
        return self.phase

    def _end(self) -> None:
        """The line of a phase that is over."""
        if (phase := self.phase) is None:
            return
        self.phase = None
        for task in phase.tasks.values():
            self.bars.remove_task(task.id)
        what = f"{phase.total} done" if phase.total is not None else "done"
        line(f"{self._numbered(phase.name)}: {what} in {spoken(self.clock() - phase.began)}")

    def _add(self, what: str, total: float | None, count: int | None) -> Task:
        """A new task. total: frames, or size of all its jobs; count: frames, or jobs."""
        self.bars.start()
        self.bars.add_task(what, total=total, what=what, count=count, done=0, said=self.clock())
        self._show(task := self.bars.tasks[-1], 0)
        return task

    def _show(self, task: Task, done: int) -> None:
        of = f" of {count}" if (count := task.fields["count"]) is not None else ""
        text = f"{task.fields['what']}: {done}{of}"
        self.bars.update(task.id, description=text, done=done)
        if self.bars.disable and self.clock() - task.fields["said"] > EVERY and done != count:
            task.fields["said"] = self.clock()
            left = task.time_remaining
            line(text + (f", about {spoken(left)} left" if left else ""))
