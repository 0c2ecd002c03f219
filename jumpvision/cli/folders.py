"""Commands on a folder of recordings: run, one for each stage, check, diagnose, report."""

from __future__ import annotations

import contextlib
import io
import json
import shlex
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Group, Parameter

from jumpvision.experiment.workflow.stage import Declared, declared

from .app import DONE, FAILED, OPTIONS, Options, app, cores
from .progress import DIAGNOSIS, EXPERIMENTS, PICTURES

if TYPE_CHECKING:
    from jumpvision.engine.document.diagnosis import Diagnosis
    from jumpvision.experiment.campaign.folder import Run
    from jumpvision.experiment.inputs.experiment import Campaign, Experiment
    from jumpvision.experiment.workflow.run import Outcome, Plan


def open_folder(path: Path, options: Options) -> Campaign:
    """The campaign at `path` with the options' values over it; a single experiment is a campaign of one."""
    from jumpvision.experiment.campaign.folder import as_campaign

    return as_campaign(_opened(path, options))


def _opened(
    path: Path,
    options: Options,
    params: Mapping[str, Mapping[str, object]] | None = None,
    stages: tuple[str, ...] = (),
) -> Experiment | Campaign:
    from jumpvision.experiment.inputs import experiment
    from jumpvision.experiment.inputs.overrides import overrides_of
    from jumpvision.experiment.workflow.stage import recording_of

    if path.is_file() and path.suffix != ".toml" and len(stages) == 1 and (section := recording_of(stages[0])):
        return experiment.of_recording(path, section, pipeline=params, overrides=overrides_of(options.set))
    return experiment.open_folder(path, model=options.model, pipeline=params, overrides=overrides_of(options.set))


def work(
    path: Path,
    options: Options,
    *,
    stages: tuple[str, ...] | None = None,
    pipeline: Path | None = None,
    profile: str | None = None,
    ask: bool | None = None,
    every_page: bool = False,
    report: bool = False,
) -> Run:
    """Run the folder at `path`: `stages`, those of a pipeline file, or all.

    ask: as in run_folder; every_page: draw the pictures of all pages, not only those of the first; report: `show` will
    write the pages, and those of experiments may be written while the model is questioned.
    """
    from jumpvision.base.compiling import noticed
    from jumpvision.experiment.campaign.folder import asks, results_of, run_folder
    from jumpvision.experiment.inputs.experiment import Campaign, folder_of
    from jumpvision.experiment.workflow.many import prepare
    from jumpvision.experiment.workflow.run import Pipeline, Plan, read_pipeline
    from jumpvision.report.figures import PICTURES, diagnosis_png, drawn_by_report, drawn_by_run

    from . import terminal
    from .progress import Progress

    path = folder_of(path)
    if stages:
        _say_left_out(path)
    definition = read_pipeline(pipeline) if pipeline else Pipeline()
    opened = _opened(path, options, definition.params, stages or ())
    results = options.results or results_of(path.with_suffix("") if path.is_file() else path)
    plan = Plan(
        results=results,
        cache=options.cache or results / ".cache",
        stages=stages or definition.stages,
        whole=stages is None,
        pictures=PICTURES if options.pictures else (),
        drawn=drawn_by_report(opened) if every_page else drawn_by_run(opened) if stages is None or ask else None,
        verify=options.verify,
        fresh=options.fresh_if_versions_differ,
        debug=options.debug,
        command="jumpvision " + shlex.join(sys.argv[1:]),
    )
    if isinstance(opened, Campaign) and (options.workers or cores()) > 1 and not profile and not plan.cache.exists():
        prepare(plan)
    if isinstance(opened, Campaign):
        _say_repeated(opened)
    if profile:
        _run_jobs(opened, plan, profile, options, pipeline)
    many = opened if isinstance(opened, Campaign) else None
    number = cores() if profile else options.workers or cores()
    phases = phases_of(plan, asks=bool(many and asks(many, plan, ask)), drawn=bool(many and plan.drawn != {}))

    def tell(run: Run) -> None:
        terminal.tables(run.campaign, run.outcomes, run.diagnosis, whole=options.table)

    shown = Progress(many, tell=None if options.json else tell, phases=phases)
    with shown as progress, noticed(terminal.compiling):
        return run_folder(
            opened,
            plan,
            workers=number,
            watcher=progress,
            ask=ask,
            draw=diagnosis_png,
            pictured=options.pictures,
            say=progress.question,
            background=partial(_write_pages_meanwhile, results) if report and number > 1 else None,
        )


@contextlib.contextmanager
def _write_pages_meanwhile(results: Path, campaign: Campaign, outcomes: list[Outcome]) -> Iterator[None]:
    """Write the experiments' pages in another process; those that it cannot write are left to `show`."""
    from jumpvision.base.progress import worker_pool
    from jumpvision.report.pages.report import write_pages

    with worker_pool(1) as pool:
        pool.submit(write_pages, campaign, outcomes, results)
        yield


def phases_of(plan: Plan, *, asks: bool, drawn: bool) -> list[str]:
    """What a run of a campaign goes through, in order."""
    return [EXPERIMENTS, *[DIAGNOSIS] * asks, *[PICTURES] * (drawn and bool(plan.pictures))]


def _say_left_out(path: Path) -> None:
    """Names the campaigns below a folder that only `run` takes."""
    from jumpvision.experiment.inputs.experiment import folders_below

    from . import terminal

    others = [str(f.relative_to(path)) for f in folders_below(path)[0] if f != path] if path.is_dir() else []
    if others:
        terminal.line(
            f"left out: {', '.join(others)}: folders of experiments below {path}; name them one by one, or run"
        )


def _say_repeated(campaign: Campaign) -> None:
    """Names experiments with one and the same recording."""
    from jumpvision.experiment.campaign.copies import repeated

    from . import terminal

    for name, doubts in repeated(campaign.experiments).items():
        for doubt in doubts:
            terminal.line(f"warning: {name}: {doubt}")


def show(done: Run, options: Options, *, page: bool = False) -> int:
    """The end of `run` and of a stage's command: the report where asked for, the tables; the exit code."""
    from jumpvision.base.schema import InputError

    from . import terminal

    stages = not done.plan.whole and done.plan.stages
    made = {s.stage for o in done.outcomes for s in o.steps}
    if stages and made.isdisjoint(stages) and not any(o.errors for o in done.outcomes):  # nothing of what was asked for
        raise InputError(
            list(dict.fromkeys(f"{done.campaign.path}: {why}" for o in done.outcomes for why in o.not_run))
        )
    if page and any(o.steps for o in done.outcomes):
        from jumpvision.report.pages.report import write_report

        done.files.append(
            write_report(
                done.campaign,
                done.outcomes,
                done.rows,
                done.plan.results,
                single=done.single,
                warned=done.warnings,
                diagnosis=done.diagnosis,
                no_diagnosis=done.no_diagnosis,
            )
        )
    terminal.outcome(done, as_json=options.json, whole=options.table)
    for text in done.notes:
        terminal.line(f"note: {text}")
    return FAILED if done.failed else DONE


def _run_jobs(opened: Experiment | Campaign, plan: Plan, profile: str, options: Options, pipeline: Path | None) -> None:
    """Let Snakemake compute the experiments."""
    from jumpvision.base.schema import InputError
    from jumpvision.experiment.inputs.experiment import Experiment
    from jumpvision.experiment.workflow.cluster import run_jobs

    if isinstance(opened, Experiment):
        raise InputError([f"--profile {profile}: {opened.path} is one experiment; give a campaign, or leave it out"])
    passed = [x for text in options.set for x in ("--set", text)]
    passed += ["--pipeline", str(pipeline.absolute() if pipeline.exists() else pipeline)] if pipeline else []
    passed += ["--model", str(options.model.absolute())] if options.model else []
    passed += ([] if options.pictures else ["--no-pictures"]) + (["--verify"] if options.verify else [])
    passed += ["--fresh-if-versions-differ"] if options.fresh_if_versions_differ else []
    run_jobs(opened.path, plan, profile, options=passed, jobs=options.workers)


@app.command
def run(
    path: Path,
    /,
    *,
    pipeline: Path | None = None,
    profile: str | None = None,
    report: bool = True,
    options: Options = OPTIONS,
) -> int:
    """Every stage that has inputs, for one experiment, a whole campaign or a folder of campaigns, then report.html.

    Example: jumpvision run data_samples/loose_sand --results results/loose_sand

    Parameters
    ----------
    path
        An experiment folder (with experiment.toml), a folder of them, or a folder of such folders.
    pipeline
        The stages to run and their parameters: granular, hard_ground, piv_only, or a TOML file of your own.
    profile
        Run a campaign's experiments by Snakemake: local, slurm, or a folder with config.yaml (docs/scale.md); --workers
        is then the number of jobs at a time.
    report
        Write report.html.
    """
    from jumpvision.experiment.campaign.folder import results_of
    from jumpvision.experiment.inputs.experiment import folder_of, folders_below

    from . import terminal

    def one(path: Path, options: Options) -> int:
        done = work(path, options, pipeline=pipeline, profile=profile, report=report)
        return show(done, options, page=report)

    folder = folder_of(path)
    found, lost = folders_below(folder) if folder.is_dir() else ([], [])
    code = DONE
    if found in ([], [folder]):
        code = one(path, options)
    else:
        base = options.results or results_of(folder)
        places = {f: base if f == folder else base / f.relative_to(folder) for f in found}
        code = _each({f: replace(options, results=place) for f, place in places.items()}, one, as_json=options.json)
    for f in lost:
        terminal.line(f"left out: {f}: lies in the folder of another experiment; move it beside that")
    return code


def _each(asked: Mapping[Path, Options], one: Callable[[Path, Options], int], *, as_json: bool) -> int:
    """`one` of every folder; one that cannot be opened is told, and the others are done. JSON: {folder: its own}."""
    from jumpvision.base.schema import InputError, harmless

    from . import terminal

    codes: list[int] = []
    campaigns = {}
    for folder, options in asked.items():
        terminal.line(f"{folder}: campaign {len(codes) + 1} of {len(asked)}")
        with contextlib.redirect_stdout(io.StringIO()) if as_json else contextlib.nullcontext() as out:
            try:
                codes.append(one(folder, options))
            except InputError as e:
                codes.append(FAILED)
                for problem in e.problems:
                    terminal.line(f"failed: {harmless(problem)}")
        if out is not None:
            campaigns[str(folder)] = json.loads(out.getvalue() or "null")
    if as_json:
        print(json.dumps({"campaigns": campaigns}, indent=1))
    return FAILED if FAILED in codes else DONE


def _add(stage: Declared) -> None:
    def command(path: Path, /, *, options: Options = OPTIONS) -> int:
        return show(work(path, options, stages=(stage.name,)), options)

    command.__doc__ = (
        f"{stage.help}\n\nExample: jumpvision {stage.name} data_samples/hard_ground --results results/hard_ground"
    )
    app.command(command, name=stage.name, group=ONE)


ONE = Group("One stage, with what it needs")
for _stage in declared().values():
    _add(_stage)


def _isolable(path: Path, options: Options) -> int:
    """What `check --isolable` says."""
    from jumpvision.experiment.campaign.offers import TRACK_NOISE_M, weigh_declared

    from . import terminal

    found = weigh_declared(open_folder(path, options), options.workers or cores())
    data = {"path": str(path), "isolable": found.rows, "jumps": found.recordings, "noise_m": TRACK_NOISE_M}
    terminal.result(data, found.rows, as_json=options.json)
    terminal.line(found.sentence)
    for text in found.left_out:
        terminal.line(f"left out: {text}")
    return DONE


@app.command
def check(path: Path, /, *, isolable: bool = False, options: Options = OPTIONS) -> int:
    """Validate a folder: every problem with file, section, key, value and remedy, also those that a run would find in
    the recordings; units, clocks, marks and names that look wrong; walls, floor and air; a scale taken as exact.

    Example: jumpvision check data_samples/loose_sand

    Parameters
    ----------
    isolable:
        Instead, from what is declared alone: which causes these jumps could show and distinguish, before any is made.
    """
    if isolable:
        return _isolable(path, options)
    from . import terminal

    campaign = open_folder(path, options)
    _say_left_out(campaign.path)
    rows = [{"experiment": e.name, "ground": e.ground, "sections": ", ".join(e.sections)} for e in campaign.experiments]
    rows += [{"experiment": n, "ground": "", "sections": f"excluded: {why}"} for n, why in campaign.excluded.items()]
    from jumpvision.base.schema import InputError
    from jumpvision.experiment.campaign.folder import warnings_of
    from jumpvision.experiment.inputs.experiment import exact_scales
    from jumpvision.experiment.stages.bed.geometry import check_geometry
    from jumpvision.experiment.stages.preflight import preflight

    before = {e.name: preflight(e) for e in campaign.experiments}
    if problems := [p for found, _ in before.values() for p in found]:
        for name, (_, warned) in before.items():
            for w in warned:
                terminal.line(f"warning: {name}: {w['message']}")
        raise InputError(problems)
    found = {e.name: check_geometry(e) for e in campaign.experiments}
    notes = warnings_of(campaign, {n: [*before[n][1], *warned] for n, (_, warned) in found.items()})
    numbers = {n: values for n, (values, _) in found.items() if values is not None}
    exact = [text for text in (exact_scales(campaign.experiments),) if text]
    data = {
        "path": str(path),
        "problems": [],
        "experiments": rows,
        "geometry": numbers,
        "warnings": notes,
        "notes": exact,
    }
    terminal.result(data, rows, as_json=options.json)
    if not options.json:
        terminal.geometry(numbers)
    for note in notes:
        terminal.line(f"warning: {note['experiment']}: {note['message']}")
    for text in exact:
        terminal.line(f"note: {text}")
    return DONE


@app.command
def diagnose(
    path: Path,
    /,
    *,
    consider: Annotated[
        tuple[str, ...], Parameter(negative="", help="A [mechanism.NAME] of the folder's, tried as a cause.")
    ] = (),
    simulator: str = "",
    limit: float = 600.0,
    budget: int | None = None,
    accept: Annotated[bool, Parameter(negative="")] = False,
    options: Options = OPTIONS,
) -> int:
    """What the simulation gets wrong, why, the extended model and what it gains (diagnosis.json, model.toml).

    Example: jumpvision diagnose data_samples/loose_sand --results results/loose_sand

    Parameters
    ----------
    path
        A folder of experiments.
    simulator
        MODULE:NAME (or FILE.py:NAME) of your own Study, in place of [model]; imported in a process of its own
        (docs/any_simulator.md). Then diagnosis.json, samples.csv, diagnosis.png and report.html are written.
    limit
        With --simulator: seconds that one run may take.
    budget
        With --simulator: most runs.
    accept
        Write the suggested corrections into the experiments' experiment.toml, and diagnose again.
    """
    from jumpvision.base.schema import InputError
    from jumpvision.experiment.campaign.folder import DIAGNOSED
    from jumpvision.experiment.inputs.experiment import folder_of, is_campaign

    from . import terminal

    if not is_campaign(folder_of(path)):
        raise InputError(
            [f"{path}: one experiment; give the campaign, the folder of experiments whose model is to be tested"]
        )
    if consider:
        options = replace(options, set=(*options.set, f"diagnosis.consider={json.dumps(list(consider))}"))
    if simulator and accept:
        raise InputError(["--accept: corrects what this package's own simulation shows; leave out --simulator, or it"])
    if simulator:
        return _foreign(path, simulator, limit, budget, options)
    done = work(path, options, stages=DIAGNOSED, ask=True)
    if accept and done.diagnosis and _accepted(done.diagnosis, done.campaign):
        done = work(path, options, stages=DIAGNOSED, ask=True)
    assert done.diagnosis is not None  # a campaign that cannot be questioned raises
    terminal.warned(done.outcomes)
    terminal.diagnosis(
        done.diagnosis,
        done.campaign,
        done.files,
        as_json=options.json,
        outcomes=done.outcomes,
        whole=options.table,
    )
    return FAILED if done.failed else DONE


def _accepted(found: Diagnosis, campaign: Campaign) -> bool:
    """Whether lines that would mend the campaign were written; each is told."""
    from jumpvision.experiment.campaign.mend import accept

    from . import terminal

    if not found.suggested:
        terminal.line("--accept: there is nothing to correct")
    accept(found.suggested, campaign.path)
    for x in found.suggested:
        terminal.line(f"written into {campaign.path / x.file}: {x.line}  ({x.why})")
    return bool(found.suggested)


def _foreign(path: Path, simulator: str, limit: float, budget: int | None, options: Options) -> int:
    """A simulator that is not ours, on the tracks of a campaign."""
    from jumpvision.engine.study.processes import How, outside
    from jumpvision.engine.study.question import diagnose as diagnose_study
    from jumpvision.experiment.campaign.recordings import recordings_of
    from jumpvision.report.pages.study import write_study

    from . import terminal
    from .app import cores

    outside(simulator, path)
    done = work(path, options, stages=("rod",))
    recordings = recordings_of(done.campaign, {o.name: o for o in done.outcomes})
    keep = done.plan.cache / "diagnose" / "runs.sqlite"
    say = lambda text: terminal.line(f"diagnose: {text}")  # noqa: E731
    how = How(options.workers or cores(), limit, budget, keep, progress=say, source=simulator)
    found = diagnose_study(recordings, None, how)
    for warning in found.noise.warnings:
        terminal.line(f"warning: {warning}")
    title = f"{path.absolute().name}, {simulator}"
    made = write_study(found, done.plan.results, title, pictures=options.pictures)
    terminal.diagnosis(found, done.campaign, made, as_json=options.json, whole=options.table)
    return FAILED if done.failed else DONE


@app.command
def report(path: Path, /, *, options: Options = OPTIONS) -> int:
    """One self-contained HTML page with the figures, all pictures and films, from the results (computing what is
    missing).

    Example: jumpvision report data_samples/hard_ground --results results/hard_ground
    """
    return show(work(path, options, every_page=True), options, page=True)
