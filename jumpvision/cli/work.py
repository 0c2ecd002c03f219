"""What a command does with a folder: open it, run stages, draw, question and report."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Any

from jumpvision import api
from jumpvision.report.figures import PICTURES

from .app import DONE, FAILED, Options, cores


def open_folder(path: Path, options: Options, pipeline: dict[str, Any] | None = None) -> Any:
    """The campaign at `path`; a single experiment is a campaign of one."""
    from jumpvision.inputs.experiment import Campaign

    experiment = api.open(path, set=options.set, model=options.model, pipeline=pipeline)
    if isinstance(experiment, Campaign):
        return experiment
    if experiment.header.exclude:
        return Campaign(experiment.path, (), {experiment.name: experiment.header.exclude})
    return Campaign(experiment.path, (experiment,))


def work(
    path: Path,
    stages: tuple[str, ...] | None,
    options: Options,
    *,
    pipeline: Path | None = None,
    page: bool = False,
    profile: str | None = None,
) -> int:
    from jumpvision.base.schema import InputError
    from jumpvision.workflow.run import jumps_table, write_jumps

    from . import terminal as show

    campaign, outcomes, plan, single = outcomes_of(path, stages, options, pipeline, profile)
    if stages and not any(o.steps or o.errors for o in outcomes):  # nothing there for the one stage asked for
        raise InputError(list(dict.fromkeys(f"{path}: {why}" for o in outcomes for why in o.not_run)))
    rows = jumps_table(campaign, outcomes)
    made: list[Path] = []
    diagnosis = None
    if not single and stages is None:
        write_jumps(rows, plan.results)
        from jumpvision.campaign.jumps import worth_asking

        if plan.stages is None and worth_asking(campaign):
            diagnosis = question_campaign(campaign, outcomes, plan, options, made)
    if not single:
        from jumpvision.campaign.across import write_actuator, write_intrusions

        write_intrusions(campaign, outcomes, plan.results)
        write_actuator(campaign, outcomes, plan.results)
    if not single and (stages is None or "crater" in stages):
        from jumpvision.campaign.craters import craters_table, write_craters, zero_crossing

        craters = craters_table({o.name: o.results for o in outcomes})
        made += write_craters(craters, zero_crossing(craters), plan.results)
    if page and any(o.steps for o in outcomes):
        from jumpvision.report.pages.page import write_report

        made.append(write_report(campaign, outcomes, rows, plan.results, single=single, diagnosis=diagnosis))
    show.outcome(campaign, outcomes, rows, plan.results, made, as_json=options.json, single=single, diagnosis=diagnosis)
    return FAILED if any(o.errors for o in outcomes) else DONE


def outcomes_of(
    path: Path,
    stages: tuple[str, ...] | None,
    options: Options,
    pipeline: Path | None = None,
    profile: str | None = None,
) -> Any:
    """Run the stages; (campaign, outcomes, plan, whether it is a single experiment)."""
    from jumpvision.inputs.experiment import folder_of, is_campaign
    from jumpvision.inputs.overrides import read_pipeline
    from jumpvision.workflow.run import Plan, run_campaign, run_single

    from . import terminal as show

    path = folder_of(path)
    definition = read_pipeline(pipeline) if pipeline else {}
    campaign = open_folder(path, options, definition.get("params"))
    results = options.results or api.results_of(path)
    plan = Plan(
        results=results,
        cache=options.cache or results / ".cache",
        stages=stages or definition.get("stages"),
        modules=("jumpvision.stages", *(PICTURES if options.pictures else ())),
        verify=options.verify,
        debug=options.debug,
        command="jumpvision " + shlex.join(sys.argv[1:]),
    )
    single = not is_campaign(path)
    elsewhere = _hand_over(campaign, plan, profile, options, pipeline, single=single) if profile else None
    with show.Progress(len(campaign.experiments)) as progress:
        if single and campaign.experiments:
            workers = options.workers or cores()
            outcomes = [run_single(campaign.experiments[0], plan, workers=workers, hook=progress.frames)]
        else:
            outcomes = run_campaign(
                campaign, plan, workers=options.workers or cores(), done=progress.experiment, elsewhere=elsewhere
            )
    return campaign, outcomes, plan, single


def _hand_over(
    campaign: Any, plan: Any, profile: str, options: Options, pipeline: Path | None, *, single: bool
) -> dict[str, list[str]]:
    """Let Snakemake compute the experiments; the reasons of those that failed, by name."""
    from jumpvision.base.schema import InputError
    from jumpvision.workflow.cluster import hand_over

    if single:
        raise InputError([f"--profile {profile}: {campaign.path} is one experiment; give a campaign, or leave it out"])
    passed = [x for text in options.set for x in ("--set", text)]
    passed += ["--pipeline", str(pipeline.absolute())] if pipeline else []
    passed += ([] if options.pictures else ["--no-pictures"]) + (["--verify"] if options.verify else [])
    return hand_over(campaign, plan, profile, options=passed, jobs=options.workers)


def question_campaign(campaign: Any, outcomes: Any, plan: Any, options: Options, made: list[Path]) -> dict[str, Any]:
    """Diagnose a campaign whose tracks are there; adds the files written to `made`."""
    from jumpvision.campaign.diagnose import question
    from jumpvision.report.figures.diagnosis import diagnosis_picture

    from . import terminal as show

    data, files = question(
        campaign,
        {o.name: o for o in outcomes},
        plan.results,
        plan.cache,
        workers=options.workers or cores(),
        draw=diagnosis_picture if options.pictures else None,
        say=lambda text: show.line(f"diagnose: {text}"),
    )
    made += files
    return data
