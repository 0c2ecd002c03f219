"""Commands on a folder of recordings: run, one for each stage, check, diagnose, report."""

from __future__ import annotations

from pathlib import Path

from cyclopts import Group

from jumpvision.workflow.stage import Declared, declared

from .app import DONE, FAILED, OPTIONS, Options, app
from .work import open_folder, show
from .work import run as work


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
    """Every stage that has inputs, for one experiment or a whole campaign, then report.html.

    Example: jumpvision run data_samples/loose_sand

    Parameters
    ----------
    path
        An experiment folder (with experiment.toml) or a folder of them.
    pipeline
        TOML file with the stages to run and their parameters, e.g. pipelines/granular.toml.
    profile
        Hand a campaign to Snakemake: local, slurm, or a folder with config.yaml (docs/scale.md); --workers is then
        the number of jobs at a time.
    report
        Write report.html.
    """
    return show(work(path, options, pipeline=pipeline, profile=profile), options, page=report)


def _add(stage: Declared) -> None:
    def command(path: Path, /, *, options: Options = OPTIONS) -> int:
        return show(work(path, options, stages=(stage.name,)), options)

    command.__doc__ = f"{stage.help}\n\nExample: jumpvision {stage.name} data_samples/hard_ground"
    app.command(command, name=stage.name, group=STAGES)


STAGES = Group("One stage, with what it needs")
for _stage in declared().values():
    _add(_stage)


@app.command
def check(path: Path, /, *, options: Options = OPTIONS) -> int:
    """Validate a folder: every problem with file, section, key, value and remedy; walls, floor and air of the bed;
    a scale that is taken as exact.

    Example: jumpvision check data_samples/loose_sand
    """
    from . import terminal

    campaign = open_folder(path, options)
    rows = [{"experiment": e.name, "ground": e.ground, "sections": ", ".join(e.sections)} for e in campaign.experiments]
    rows += [{"experiment": n, "ground": "", "sections": f"excluded: {why}"} for n, why in campaign.excluded.items()]
    from jumpvision.campaign.checks import check_geometry, exact_scales

    found = {e.name: check_geometry(e) for e in campaign.experiments}
    data = {
        "path": str(path),
        "problems": [],
        "experiments": rows,
        "geometry": (numbers := {n: values for n, (values, _) in found.items() if values is not None}),
        "warnings": [f"{n}: {text}" for n, (_, texts) in found.items() for text in texts],
        "notes": [text for text in (exact_scales(campaign.experiments),) if text],
    }
    terminal.result(data, rows, as_json=options.json)
    if not options.json:
        terminal.geometry(numbers)
    for text in data["warnings"]:
        terminal.line(f"warning: {text}")
    for text in data["notes"]:
        terminal.line(f"note: {text}")
    return DONE


@app.command
def diagnose(path: Path, /, *, options: Options = OPTIONS) -> int:
    """What the simulation gets wrong, why, the extended model and what it gains (diagnosis.json, model.toml).

    Example: jumpvision diagnose data_samples/loose_sand
    """
    from jumpvision.base.schema import InputError
    from jumpvision.campaign.folder import DIAGNOSED
    from jumpvision.inputs.experiment import folder_of, is_campaign

    from . import terminal

    if not is_campaign(folder_of(path)):
        raise InputError([f"{path}: one experiment; give the campaign (the folder of experiments) to be questioned"])
    done = work(path, options, stages=DIAGNOSED, ask=True)
    assert done.diagnosis is not None  # a campaign that cannot be questioned raises
    terminal.diagnosis(done.diagnosis, done.campaign, done.files, as_json=options.json)
    return FAILED if done.failed else DONE


@app.command
def report(path: Path, /, *, options: Options = OPTIONS) -> int:
    """One self-contained HTML page with the figures, from the results (computing what is missing); or of a sweep.nc.

    Example: jumpvision report data_samples/hard_ground
    """
    if path.suffix == ".nc":
        from jumpvision.report.pages.sweep import write_sweep

        from . import terminal

        page = write_sweep(path)
        terminal.result(
            {"results": str(path.parent), "files": [str(page)]}, [{"file": str(page)}], as_json=options.json
        )
        return DONE
    return show(work(path, options), options, page=True)
