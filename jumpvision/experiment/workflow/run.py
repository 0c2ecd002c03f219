"""Run the stages of one experiment or of a whole campaign: parallel over experiments, resumable, nothing lost.

A failed stage is reported with its reason; stages that do not depend on it, and the other experiments, go on.
"""

from __future__ import annotations

import contextlib
import importlib
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import jumpvision
from jumpvision.base.progress import HOOK, WORKERS, Hook, setting
from jumpvision.base.record import Record
from jumpvision.base.schema import InputError, Toml, WarningRecord, closest
from jumpvision.base.storage import sweep_leftovers
from jumpvision.experiment.inputs.experiment import Experiment
from jumpvision.experiment.inputs.model import tables_of
from jumpvision.experiment.inputs.sections import NotApplicable
from jumpvision.experiment.results.summary import UNKNOWN, Summary

from .entries import versions
from .provenance import settle
from .stage import STAGES, Stage, declared, results_stages
from .workspace import NotCached, Step, Workspace


@dataclass(frozen=True)
class Plan:
    """What to do: stages by name (None: all that have inputs), where results and cache lie, how."""

    results: Path
    cache: Path
    stages: tuple[str, ...] | None = None
    whole: bool = True  # also the tables of a campaign; not for a single stage
    pictures: tuple[str, ...] = ()  # modules whose stages draw figures of the results
    drawn: Mapping[str, Sequence[str]] | None = None  # of these only such files, by experiment; None: all
    verify: bool = False
    fresh: bool = False  # compute again what other versions made
    debug: bool = False
    command: str = ""

    def to_draw(self, name: str) -> tuple[str, ...] | None:
        """The files of an experiment's pictures that are drawn; None: of all that its results have."""
        return () if not self.pictures else None if self.drawn is None else tuple(self.drawn.get(name, ()))


@dataclass(frozen=True)
class Pipeline:
    """Stages by name (None: all that have inputs) and parameters by stage."""

    stages: tuple[str, ...] | None = None
    params: Mapping[str, Toml] = field(default_factory=dict)


def pipelines() -> Path:
    """The folder of the pipelines that are shipped: in the installed package, or beside it in a checkout."""
    here = Path(jumpvision.__file__).parent
    inside = here / "pipelines"
    return inside if inside.is_dir() else here.parent / "pipelines"


def read_pipeline(file: Path) -> Pipeline:
    """The definition in a TOML file, or the shipped one of that name. Raises InputError with every problem."""
    shipped = {f.stem: f for f in sorted(pipelines().glob("*.toml"))}
    if not file.exists():
        if str(file) not in shipped:
            raise InputError([f"--pipeline {file}: no such file; give one, or a name: {', '.join(shipped)}"])
        file = shipped[str(file)]
    table = tables_of(file)
    keys = {"description", "stages", "params"}
    problems = [f"{file}: {key}: unknown key{closest(key, keys)}" for key in table if key not in keys]
    stages, known = table.get("stages"), declared()
    if stages is not None:
        problems += [f"{file}: stages: unknown stage '{s}'{closest(str(s), known)}" for s in stages if s not in known]
    if problems:
        raise InputError(problems)
    return Pipeline(tuple(stages) if stages is not None else None, table.get("params", {}))


@dataclass
class Outcome:
    """What became of one experiment."""

    name: str
    results: Path
    steps: list[Step] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    not_run: list[str] = field(default_factory=list)  # stages without inputs, and why
    seconds: float = 0.0
    summary: Summary = UNKNOWN
    notes: list[str] = field(default_factory=list)  # on files of earlier runs that had to stay
    undrawn: bool = False  # its pictures are left for later

    @property
    def computed(self) -> int:
        return sum(s.state == "computed" for s in self.steps)

    @property
    def warnings(self) -> list[WarningRecord]:
        """What its stages had to say, each once, in the order of `warnings_by_stage`."""
        return [warning for _, warning in self.warnings_by_stage]

    @property
    def warnings_by_stage(self) -> list[tuple[str, WarningRecord]]:
        """The same, with the stage that said it first."""
        out: list[tuple[str, WarningRecord]] = []
        for s in self.steps:
            out += [(s.stage, w) for w in s.warnings if all(w != known for _, known in out)]
        return out

    @property
    def said(self) -> list[str]:
        """The same as lines for people, and notes on files of earlier runs."""
        return [*(f"{stage}: {w['message']}" for stage, w in self.warnings_by_stage), *self.notes]

    @property
    def older(self) -> list[str]:
        """Packages of which another version than that of today made a result, as `numpy 2.1.0, now 2.2.3`."""
        now = versions()
        then = {(p, v) for s in self.steps for p, v in s.versions.items() if now.get(p) != v}
        return [f"{p} {v}, now {now.get(p, 'not installed')}" for p, v in sorted(then)]

    def made(self, record: type[Record]) -> bool:
        """Whether this run made the record: what else lies in the folder is no result of it."""
        return any(record.file in s.files for s in self.steps)


def run_experiment(
    experiment: Experiment, plan: Plan, results: Path, *, only_cached: bool = False, before: Outcome | None = None
) -> Outcome:
    """Every stage of the plan that has inputs, then the pictures; errors are kept in the outcome, not raised.

    only_cached: raises NotCached when something would have to be computed. before: what became of its stages; only the
    pictures are then computed, and what failed is not tried again.
    """
    began = time.perf_counter()
    for module in plan.pictures:
        importlib.import_module(module)
    computes = "nothing" if only_cached else "pictures" if before else "all"
    workspace = Workspace(experiment, results, plan.cache, verify=plan.verify, computes=computes, fresh=plan.fresh)
    outcome = Outcome(experiment.name, results, errors=list(before.errors) if before else [])
    blamed: set[int] = set()
    stages = list(wanted(plan, experiment.name))
    pictures = [output for output, made in stages if made.picture]
    for output, made in stages:
        if (hook := HOOK.get()) is not None and made.picture:
            hook("pictures drawn", pictures.index(output), len(pictures))
        why = workspace.missing(output)
        if why:
            if not made.picture:
                outcome.not_run.append(why)
            continue
        try:
            if output is Summary:
                outcome.summary = workspace.make(Summary)
            else:
                workspace.complete(output)
        except NotCached:
            if before is None:
                raise
        except NotApplicable as e:
            if not made.picture:
                outcome.not_run += [p for p in e.problems if p not in outcome.not_run]
        except Exception as e:
            if plan.debug and not isinstance(e, InputError):
                raise
            if id(e) not in blamed:  # a stage below failed already: said once
                blamed.add(id(e))
                said = explain(e, made.name, experiment.path)  # two stages that read one bad log say the same
                outcome.errors += [text for text in said if text not in outcome.errors]
    if (hook := HOOK.get()) is not None and pictures:
        hook("pictures drawn", len(pictures), len(pictures))
    already = {s.stage: s for s in before.steps} if before else {}
    outcome.steps = [already.get(s.stage, s) for s in workspace.steps]
    try:
        outcome.notes = settle(workspace, plan.command)
    except (OSError, InputError) as e:
        said = explain(e, "provenance", experiment.path)
        outcome.errors += [text for text in said if text not in outcome.errors]
    outcome.seconds = time.perf_counter() - began + (before.seconds if before else 0.0)
    return outcome


def wanted(plan: Plan, name: str) -> Iterator[tuple[type, Stage]]:
    """The stages of a plan, then the pictures of what those stages make that are drawn of the experiment."""
    chosen = {s.output: s for s in results_stages() if plan.stages is None or s.name in plan.stages}
    yield from chosen.items()
    files = plan.to_draw(name)
    for made in list(STAGES.values()):
        drawn = made.picture and made.function.__module__ in plan.pictures and made.inputs[0].type in chosen
        if drawn and (files is None or made.output.file in files):
            yield made.output, made


def explain(error: Exception, stage: str, path: Path) -> list[str]:
    """An error in words a user can act on: the experiment, the stage and what is wrong."""
    if isinstance(error, InputError):
        return list(error.problems)
    where = f"{path}: {stage}: "
    if isinstance(error, OSError) and error.strerror:
        return [f"{where}{error.strerror}" + (f": {error.filename}" if error.filename else "")]
    if isinstance(error, ValueError):
        return [where + str(error)]
    return [f"{where}unexpected {type(error).__name__}: {error} (run again with --debug to see where)"]


@contextlib.contextmanager
def no_leftovers(plan: Plan) -> Iterator[None]:
    """Before and after: a worker of a killed run can still be dying, in the middle of a write, as the next begins."""
    sweep_leftovers(plan.results, plan.cache)
    try:
        yield
    finally:
        sweep_leftovers(plan.results, plan.cache)


def run_single(experiment: Experiment, plan: Plan, *, workers: int, hook: Hook | None) -> Outcome:
    """One experiment, its files in the results folder itself, with progress; `workers` share a long film."""
    with setting(HOOK, hook), setting(WORKERS, workers), no_leftovers(plan):
        return run_experiment(experiment, plan, plan.results)
