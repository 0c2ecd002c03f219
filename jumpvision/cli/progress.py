"""How far a command is, on stderr: one line a phase, and time left from what was measured here and now."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from jumpvision.base.schema import harmless

if TYPE_CHECKING:
    from jumpvision.experiment.campaign.folder import Run
    from jumpvision.experiment.inputs.experiment import Campaign, Experiment
    from jumpvision.experiment.workflow.run import Outcome

EXPERIMENTS, DIAGNOSIS, PICTURES = "experiments", "diagnosis", "pictures"  # phases of a run
EVERY = 20.0  # s between two lines of one phase where no line can be written over


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


class TimeLeft:
    """Of jobs, several at a time, from the seconds of those that have ended.

    A job's time is its size times the lower median of its kind: of two the shorter, so that what was compiled in the
    first is not expected of all. One alone, of several, tells nothing yet.
    """

    def __init__(self, jobs: Mapping[str, Job], workers: int) -> None:
        self.waiting, self.workers = dict(jobs), workers
        self.rates: dict[str, list[float]] = {}

    def ended(self, name: str, seconds: float) -> None:
        """A job has ended and took so long."""
        job = self.waiting.pop(name)
        self.rates.setdefault(job.kind, []).append(seconds / job.size)

    @property
    def words(self) -> str:
        """The time left, and of which kinds it is not known; "" where nothing is left or nothing is known."""
        known = {k: sorted(r)[(len(r) - 1) // 2] for k, r in self.rates.items() if len(r) > 1}
        each = [known[j.kind] * j.size for j in self.waiting.values() if j.kind in known]
        open_ = [j.kind for j in self.waiting.values() if j.kind not in known]
        if not each:
            return ""
        left = max(sum(each) / min(self.workers, len(each)), *each)
        text = f"about {spoken(left)} left"
        unknown = ", ".join(f"{open_.count(k)} with {k}" for k in dict.fromkeys(open_))
        return text + (f", not counting {unknown}" if unknown else "")


def jobs_of(campaign: Campaign) -> dict[str, Job]:
    """The experiments of a campaign as jobs: by the film that takes longest, in proportion to its bytes."""
    return {e.name: _job(e) for e in campaign.experiments}


def _job(e: Experiment) -> Job:
    for name, kind in (("grain_video", "a grain film"), ("rod_video", "a rod film"), ("bed_image", "a bed picture")):
        if (section := e.sections.get(name)) is not None:
            path = section.path
            return Job(kind, float(path.stat().st_size) if path.is_file() else 1.0)
    return Job("logs alone", 1.0)


class Phase:
    """Work in steps, as one line: written over in a terminal, every EVERY seconds elsewhere, and at its end."""

    def __init__(self, name: str, total: int | None, *, clock: Callable[[], float] = time.perf_counter) -> None:
        self.name, self.total, self.clock = name, total, clock
        self.began = self.said = clock()
        self.task: Any = None
        self.over = False

    @property
    def seconds(self) -> float:
        """Since it began."""
        return self.clock() - self.began


class Progress:
    """Of one command: films frame by frame for one experiment, phases for a campaign. It hears what a run tells.

    tell: is called with what was found, before the pictures are drawn. workers: jobs at a time.
    """

    def __init__(
        self,
        campaign: Campaign | None = None,
        *,
        workers: int = 1,
        tell: Callable[[Run], None] | None = None,
        phases: Sequence[str] = (),
    ) -> None:
        self.tell, self.workers, self.phases = tell, workers, tuple(phases)
        self.jobs, self.bar = jobs_of(campaign) if campaign else {}, None
        self.films: dict[str, Phase] = {}
        self.phase: Phase | None = None
        self.left = TimeLeft({}, workers)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        if error is None:
            self._end()
        elif self.phase is not None:  # interrupted: not to be reported as done
            self._wipe(self.phase)
        if self.bar is not None:
            self.bar.stop()

    # -- one experiment --------------------------------------------------------------------------------------

    def frames(self, what: str, done: int, total: int | None) -> None:
        """Hook of `progress.watch`."""
        if what not in self.films or done == 0:
            self.films[what] = Phase(what, total)
        phase = self.films[what]
        if phase.over:
            return
        left = f"about {spoken(phase.seconds / done * (total - done))} left" if total and 0 < done < total else ""
        self._show(phase, done, left)
        if total and done >= total:
            phase.over = True
            self._wipe(phase)
            line(f"{what}: {done} done in {spoken(phase.seconds)}")

    # -- a campaign ------------------------------------------------------------------------------------------

    def experiment(self, outcome: Outcome) -> None:
        """One experiment has ended."""
        self._job(EXPERIMENTS, outcome, self.jobs)

    def pictures(self, outcome: Outcome, names: Sequence[str]) -> None:
        """The pictures of one experiment, of these, are drawn."""
        self._job(PICTURES, outcome, {n: self.jobs[n] for n in names})

    def question(self, text: str) -> None:
        """A step of the diagnosis begins, or it has something to say."""
        if self.phase is None or self.phase.name != DIAGNOSIS:
            self._begin(DIAGNOSIS, None)
        assert self.phase is not None
        line(f"{self._numbered(DIAGNOSIS)} ({spoken(self.phase.seconds)}): {text}")

    def found(self, run: Run) -> None:
        """The verdict and the tables, before the pictures are drawn."""
        self._end()
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
        if self.phase is None or self.phase.name != name:
            self._begin(name, len(jobs))
            self.left = TimeLeft(jobs, self.workers)
        assert self.phase is not None
        if outcome.name in self.left.waiting:
            # what was kept from before takes no time, and tells nothing of the others
            if outcome.computed or name == PICTURES:
                self.left.ended(outcome.name, outcome.seconds)
            else:
                self.left.waiting.pop(outcome.name)
        if outcome.errors and name == EXPERIMENTS:
            line(f"{self._numbered(name)}: {outcome.name} failed")
        self._show(self.phase, len(jobs) - len(self.left.waiting), self.left.words)

    def _begin(self, name: str, total: int | None) -> None:
        self._end()
        self.phase = Phase(name, total)

    def _end(self) -> None:
        """The line of a phase that is over."""
        if (phase := self.phase) is None:
            return
        self.phase = None
        self._wipe(phase)
        what = f"{phase.total} done" if phase.total is not None else "done"
        line(f"{self._numbered(phase.name)}: {what} in {spoken(phase.seconds)}")

    def _wipe(self, phase: Phase) -> None:
        """Its bar, where there is one: a line tells what became of it."""
        if self.bar is not None and phase.task is not None:
            self.bar.remove_task(phase.task)

    def _show(self, phase: Phase, done: int, left: str) -> None:
        text = f"{self._numbered(phase.name)}: {done} of {phase.total}" + (f", {left}" if left else "")
        if sys.stderr.isatty():
            self._bar(phase, text, done)
        elif phase.clock() - phase.said > EVERY and done != phase.total:
            phase.said = phase.clock()
            line(text)

    def _bar(self, phase: Phase, text: str, done: int) -> None:
        if self.bar is None:
            from rich.console import Console
            from rich.progress import BarColumn, TextColumn
            from rich.progress import Progress as Bar

            shown = TextColumn("{task.description}"), BarColumn()
            self.bar = Bar(*shown, console=Console(stderr=True), transient=True)  # type: ignore[assignment]
            self.bar.start()  # type: ignore[attr-defined]
        if phase.task is None:
            phase.task = self.bar.add_task(text, total=phase.total)  # type: ignore[attr-defined]
        self.bar.update(phase.task, description=text, completed=done)  # type: ignore[attr-defined]
