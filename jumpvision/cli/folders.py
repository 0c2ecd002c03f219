"""Commands on a folder of recordings: run, one for each stage, check, diagnose, report."""

from __future__ import annotations

from pathlib import Path

from .app import DONE, FAILED, OPTIONS, Options, app
from .work import open_folder, outcomes_of, question_campaign, work


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
    return work(path, None, options, pipeline=pipeline, page=report, profile=profile)


def _stage_command(name: str, text: str) -> None:
    def command(path: Path, /, *, options: Options = OPTIONS) -> int:
        return work(path, (name,), options)

    command.__doc__ = f"{text}\n\nExample: jumpvision {name} data_samples/hard_ground"
    command.__name__ = name
    app.command(command, name=name)


for _name, _text in {
    "track": "Ball on the rod: position, height and uncertainty in every frame (track.csv).",
    "bed": "Height of the bed and its volume fraction (bed.json).",
    "crater": "Volume change of a crater from a laser line or a depth map (crater.json).",
    "piv": "Velocity field of the grains (piv.nc).",
    "flow": "Shear rate, vorticity, divergence, momentum and added mass (flow.nc).",
    "intrusion": "Slow intrusion: two resistances, overshoots after pauses and withdrawals (intrusion.json).",
    "fit": "Ring-down, flights, spring, column profile, jammed front and the other fits (fits.json).",
    "simulate": "The model driven by the measured motor (simulation.csv).",
}.items():
    _stage_command(_name, _text)


@app.command
def check(path: Path, /, *, options: Options = OPTIONS) -> int:
    """Validate a folder: every problem with file, section, key, value and remedy; walls, floor and air of the bed;
    a scale that is taken as exact.

    Example: jumpvision check data_samples/loose_sand
    """
    from . import terminal as show

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
    show.result(data, rows, as_json=options.json)
    if not options.json:
        show.geometry(numbers)
    for text in data["warnings"]:
        show.line(f"warning: {text}")
    for text in data["notes"]:
        show.line(f"note: {text}")
    return DONE


@app.command
def diagnose(path: Path, /, *, options: Options = OPTIONS) -> int:
    """What the simulation gets wrong, why, the extended model and what it gains (diagnosis.json, model.toml).

    Example: jumpvision diagnose data_samples/loose_sand
    """
    from jumpvision.base.schema import InputError
    from jumpvision.campaign.diagnose import STAGES
    from jumpvision.inputs.experiment import folder_of, is_campaign

    from . import terminal as show

    if not is_campaign(folder_of(path)):
        raise InputError([f"{path}: one experiment; give the campaign (the folder of experiments) to be questioned"])
    campaign, outcomes, plan, _ = outcomes_of(path, STAGES, options)
    made: list[Path] = []
    data = question_campaign(campaign, outcomes, plan, options, made)
    show.diagnosis(data, campaign, made, as_json=options.json)
    return FAILED if any(o.errors for o in outcomes) else DONE


@app.command
def report(path: Path, /, *, options: Options = OPTIONS) -> int:
    """One self-contained HTML page with the figures, from the results (computing what is missing); or of a sweep.nc.

    Example: jumpvision report data_samples/hard_ground
    """
    if path.suffix == ".nc":
        from jumpvision.report.pages.sweep import write_sweep

        from . import terminal as show

        page = write_sweep(path)
        show.result({"results": str(path.parent), "files": [str(page)]}, [{"file": str(page)}], as_json=options.json)
        return DONE
    return work(path, None, options, page=True)
