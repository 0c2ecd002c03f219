"""What a command does with a folder: open it, run it, show what came out, and report."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from .app import DONE, FAILED, Options, cores

if TYPE_CHECKING:
    from jumpvision.campaign.folder import Run
    from jumpvision.inputs.experiment import Campaign, Experiment
    from jumpvision.workflow.run import Plan


def open_folder(path: Path, options: Options) -> Campaign:
    """The campaign at `path` with the options' values over it; a single experiment is a campaign of one."""
    from jumpvision.campaign.folder import as_campaign

    return as_campaign(_opened(path, options))


def _opened(
    path: Path, options: Options, params: Mapping[str, Mapping[str, object]] | None = None
) -> Experiment | Campaign:
    from jumpvision.inputs import experiment
    from jumpvision.inputs.experiment import overrides_of

    return experiment.open_folder(path, model=options.model, pipeline=params, overrides=overrides_of(options.set))


def run(
    path: Path,
    options: Options,
    *,
    stages: tuple[str, ...] | None = None,
    pipeline: Path | None = None,
    profile: str | None = None,
    ask: bool | None = None,
) -> Run:
    """Run the folder at `path`: `stages`, those of a pipeline file, or all; ask: as in run_folder."""
    from jumpvision.campaign.folder import results_of, run_folder
    from jumpvision.inputs.experiment import Experiment, folder_of
    from jumpvision.report.figures import PICTURES, drawn_diagnosis
    from jumpvision.workflow.run import Pipeline, Plan, read_pipeline

    from . import terminal

    path = folder_of(path)
    definition = read_pipeline(pipeline) if pipeline else Pipeline()
    opened = _opened(path, options, definition.params)
    results = options.results or results_of(path)
    plan = Plan(
        results=results,
        cache=options.cache or results / ".cache",
        stages=stages or definition.stages,
        whole=stages is None,
        pictures=PICTURES if options.pictures else (),
        verify=options.verify,
        debug=options.debug,
        command="jumpvision " + shlex.join(sys.argv[1:]),
    )
    elsewhere = _hand_over(opened, plan, profile, options, pipeline) if profile else None
    with terminal.Progress(1 if isinstance(opened, Experiment) else len(opened.experiments)) as progress:
        return run_folder(
            opened,
            plan,
            workers=options.workers or cores(),
            watcher=progress,
            elsewhere=elsewhere,
            ask=ask,
            draw=drawn_diagnosis if options.pictures else None,
            say=lambda text: terminal.line(f"diagnose: {text}"),
        )


def show(done: Run, options: Options, *, page: bool = False) -> int:
    """The end of `run` and of a stage's command: the report where asked for, the tables; the exit code."""
    from jumpvision.base.schema import InputError

    from . import terminal

    stages = not done.plan.whole and done.plan.stages
    if stages and not any(o.steps or o.errors for o in done.outcomes):  # nothing there for the one stage asked for
        raise InputError(
            list(dict.fromkeys(f"{done.campaign.path}: {why}" for o in done.outcomes for why in o.not_run))
        )
    if page and any(o.steps for o in done.outcomes):
        from jumpvision.report.pages.page import write_report

        done.files.append(
            write_report(
                done.campaign,
                done.outcomes,
                done.rows,
                done.plan.results,
                single=done.single,
                diagnosis=done.diagnosis,
            )
        )
    terminal.outcome(
        done.campaign,
        done.outcomes,
        done.rows,
        done.plan.results,
        done.files,
        as_json=options.json,
        single=done.single,
        diagnosis=done.diagnosis,
    )
    return FAILED if done.failed else DONE


def _hand_over(
    opened: Experiment | Campaign, plan: Plan, profile: str, options: Options, pipeline: Path | None
) -> dict[str, list[str]]:
    """Let Snakemake compute the experiments; the reasons of those that failed, by name."""
    from jumpvision.base.schema import InputError
    from jumpvision.inputs.experiment import Experiment
    from jumpvision.workflow.cluster import hand_over

    if isinstance(opened, Experiment):
        raise InputError([f"--profile {profile}: {opened.path} is one experiment; give a campaign, or leave it out"])
    passed = [x for text in options.set for x in ("--set", text)]
    passed += ["--pipeline", str(pipeline.absolute())] if pipeline else []
    passed += ([] if options.pictures else ["--no-pictures"]) + (["--verify"] if options.verify else [])
    return hand_over(opened, plan, profile, options=passed, jobs=options.workers)
