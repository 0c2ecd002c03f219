"""One way to run a folder, for command line, notebook and pipeline: its experiments, then what only many show."""

from __future__ import annotations

import csv
import functools
import hashlib
import io
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from jumpvision.base.record import plain
from jumpvision.base.schema import FileSection, InputError, WarningRecord
from jumpvision.base.storage import write_aside
from jumpvision.experiment import files
from jumpvision.experiment.inputs.experiment import Campaign, Experiment
from jumpvision.experiment.inputs.model import ModelSpec
from jumpvision.experiment.inputs.sections import Actuation, MotorLog
from jumpvision.experiment.results.summary import JumpRow
from jumpvision.experiment.results.values import CraterShape, Intrusion
from jumpvision.experiment.workflow.many import draw as draw_experiments
from jumpvision.experiment.workflow.many import run_campaign
from jumpvision.experiment.workflow.provenance import digest_of_results, settle_tables
from jumpvision.experiment.workflow.run import Outcome, Plan, run_single

if TYPE_CHECKING:
    from jumpvision.engine.document.diagnosis import Diagnosis

    from .diagnose import Draw

SAMPLES = "data_samples"  # folder of the samples, into which nothing is written
DIAGNOSED = ("rod", "bed", "flow", "fit", "doubts")  # stages whose results a diagnosis reads, or whose doubts it says


class Watcher(Protocol):
    """Who is told how far a run is."""

    def frames(self, what: str, done: int, total: int | None) -> None:
        """A long film of a single experiment."""

    def experiment(self, outcome: Outcome) -> None:
        """One experiment of a campaign has ended."""

    def pictures(self, outcome: Outcome, names: Sequence[str]) -> None:
        """The pictures of an experiment of a campaign, one of these, are drawn."""

    def found(self, run: Run) -> None:
        """All numbers of a campaign are known; the pictures of its experiments may be left."""


@dataclass
class Run:
    """What became of a folder. files: what was written for the campaign, beside the experiments' results."""

    campaign: Campaign
    single: bool
    plan: Plan
    outcomes: list[Outcome]
    diagnosis: Diagnosis | None = None
    no_diagnosis: str = ""  # why the model could not be tested where that was tried
    files: list[Path] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)  # on what earlier runs left
    shown: bool = False  # the watcher has shown what was found

    @functools.cached_property
    def rows(self) -> list[JumpRow]:
        """The rows of jumps.csv."""
        return jumps_table(self.campaign, self.outcomes, self.warnings)

    @functools.cached_property
    def warnings(self) -> list[dict[str, object]]:
        """What is said of the experiments, each with its name first; recordings that are there twice too."""
        return warnings_of(self.campaign, {o.name: o.warnings for o in self.outcomes})

    @property
    def failed(self) -> bool:
        """Whether something of an experiment failed; its outcome says what."""
        return any(o.errors for o in self.outcomes)


def results_of(path: Path) -> Path:
    """Where results lie by default: results/NAME beside the folder, of samples beside all samples."""
    samples = [p for p in path.absolute().parents if p.name == SAMPLES]
    return (samples[-1].parent if samples else path.absolute().parent) / "results" / path.absolute().name


def as_campaign(opened: Experiment | Campaign) -> Campaign:
    """A single experiment is a campaign of one, or of none where it is excluded."""
    if isinstance(opened, Campaign):
        return opened
    if opened.header.exclude:
        return Campaign(opened.path, (), {opened.name: opened.header.exclude})
    return Campaign(opened.path, (opened,))


def run_folder(
    opened: Experiment | Campaign,
    plan: Plan,
    *,
    workers: int,
    watcher: Watcher | None = None,
    ask: bool | None = None,
    draw: Draw,
    pictured: bool = True,
    say: Callable[[str], None],
    background: Callable[[Campaign, list[Outcome]], AbstractContextManager[None]] | None = None,
) -> Run:
    """Run the plan on every experiment, write what only a campaign shows, question its model; then draw the pictures.

    workers: processes at a time; of a single experiment they share a long film.
    ask: question the model, or raise InputError; None: where everything is run and jumps have a [model], or say why
    not. draw: of the diagnosis' picture; pictured: whether it is put among the results.
    say: is told what the questioning finds on its way.
    background: context entered while the model is questioned, with the outcomes whose pictures are complete.
    """
    campaign = as_campaign(opened)
    _apart(campaign, plan.results, single=isinstance(opened, Experiment))
    single = isinstance(opened, Experiment)
    asked = not single and asks(campaign, plan, ask)
    run = Run(campaign, single, plan, _outcomes(opened, plan, workers, watcher))
    if run.single:
        return run
    written = _tables(run)
    try:
        if asked:
            from .diagnose import question

            by_name = {o.name: o for o in run.outcomes}
            complete = [o for o in run.outcomes if not o.undrawn]
            try:
                with background(campaign, complete) if background else nullcontext():
                    run.diagnosis, run.files = question(
                        campaign,
                        by_name,
                        plan.results,
                        plan.cache,
                        workers=workers,
                        draw=draw,
                        pictured=pictured,
                        say=say,
                        fresh=plan.fresh,
                    )
            except InputError as e:
                if ask:
                    raise
                run.no_diagnosis = f"not diagnosed: {'; '.join(e.problems)}"
                say(run.no_diagnosis)
        run.files += _craters(run)
        if watcher is not None:
            watcher.found(run)
        undrawn = [o.name for o in run.outcomes if o.undrawn]
        report = (lambda outcome: watcher.pictures(outcome, undrawn)) if watcher else None
        run.outcomes = draw_experiments(campaign, plan, run.outcomes, workers=workers, done=report)
    finally:
        made_of = {o.name: _digest(campaign[o.name], o) for o in run.outcomes}
        names = [f.name for f in (*written, *run.files)]
        lasting = () if plan.whole else (files.MODEL, files.PICTURE, files.DIAGNOSIS)
        run.notes = settle_tables(plan.results, made_of, names, plan.command, warnings=run.warnings, lasting=lasting)
    return run


def asks(campaign: Campaign, plan: Plan, ask: bool | None) -> bool:
    """Whether the model of a campaign is questioned; ask: as in `run_folder`."""
    whole = ask is None and plan.whole and plan.stages is None
    if not whole or not any(e.section(ModelSpec) for e in campaign.experiments):  # the imports would take longer
        return bool(ask)
    from .jumps import questioned

    return any(e.section(ModelSpec) for e in questioned(campaign))


def _apart(campaign: Campaign, results: Path, *, single: bool) -> None:
    """Recordings and results may not lie in one folder: a table of ours would take the place of a recording."""
    there = {results.resolve()} if single else {(results / e.name).resolve() for e in campaign.experiments}
    both = [e.path for e in campaign.experiments if e.path.resolve() in there]
    if both:
        raise InputError([f"--results {results}: {both[0]} holds recordings; name another folder for results"])


def _digest(e: Experiment, o: Outcome) -> str:
    """Of all of an experiment that tables of a campaign may show."""
    sections = {n: replace(s, path=Path()) if isinstance(s, FileSection) else s for n, s in e.sections.items()}
    texts = [repr(sorted(sections.items())), repr(e.params), repr(e.header), *o.errors]
    return hashlib.sha256("\n".join([*texts, digest_of_results(o.results)]).encode()).hexdigest()


def _outcomes(opened: Experiment | Campaign, plan: Plan, workers: int, watcher: Watcher | None) -> list[Outcome]:
    if isinstance(opened, Experiment):
        runs = as_campaign(opened).experiments
        return [run_single(e, plan, workers=workers, hook=watcher.frames if watcher else None) for e in runs]
    done = watcher.experiment if watcher else lambda outcome: None
    return run_campaign(opened, plan, workers=workers, done=done)


def _tables(run: Run) -> list[Path]:
    """What the experiments show together, for programs: jumps, intrusions, the actuator."""
    results = run.plan.results
    written = [write_jumps(run.rows, results)] if run.plan.whole else []
    if any(o.made(Intrusion) for o in run.outcomes):
        from .measured.intrusions import write_intrusions

        written += write_intrusions(run.campaign, run.outcomes, results)
    if any(e.section(MotorLog) for e in run.campaign.experiments):
        from .measured.actuator import write_actuator

        written += write_actuator(run.campaign, run.outcomes, results)
    return written


def _craters(run: Run) -> list[Path]:
    """The critical packing, for people."""
    asked = run.plan.whole or "crater" in (run.plan.stages or ())
    if not asked or not any(o.made(CraterShape) for o in run.outcomes):
        return []
    from .measured.craters import measured_in, write_craters, zero_crossing

    craters = measured_in(run.outcomes)
    return write_craters(craters, zero_crossing(craters), run.plan.results)


def warnings_of(campaign: Campaign, warned: Mapping[str, Sequence[WarningRecord]]) -> list[dict[str, object]]:
    """Of a campaign, from what is told of each experiment: {experiment, kind, message, recording, values}."""
    from .copies import repeated

    twice = repeated(campaign.experiments)
    return [
        {"experiment": e.name, **w}
        for e in campaign.experiments
        for w in [*warned.get(e.name, ()), *(d.record for d in twice.get(e.name, ()))]
    ]


def jumps_table(
    campaign: Campaign, outcomes: list[Outcome], warned: Sequence[Mapping[str, object]] = ()
) -> list[JumpRow]:
    """One row an experiment, failed and excluded ones with their reason. warned: as `warnings_of` gives them."""
    said = Counter(w["experiment"] for w in warned)
    by_name = {o.name: o for o in outcomes}
    rows = []
    for e in campaign.experiments:
        a, o = e.section(Actuation), by_name[e.name]
        rows.append(
            JumpRow(
                e.name,
                e.header.group or None,
                a.kind if a else None,
                a.frequency if a else None,
                a.delay if a else None,
                o.summary,
                said[e.name],
                o.errors[0] if o.errors else None,
            )
        )
    return rows + [JumpRow(n, problem=f"excluded: {why}", excluded=True) for n, why in campaign.excluded.items()]


def write_jumps(rows: list[JumpRow], results: Path) -> Path:
    """jumps.csv; the file."""
    text, cells = io.StringIO(), [r.cells() for r in rows]
    table = csv.DictWriter(text, list(dict.fromkeys(c for row in cells for c in row)), lineterminator="\n")
    table.writeheader()
    table.writerows(plain(cells))
    write_aside(results / files.JUMPS, text.getvalue())
    return results / files.JUMPS
