"""For notebooks and scripts: every stage as a function on an opened folder, and the commands that give tables.

    import jumpvision as jv

    experiment = jv.open("data_samples/hard_ground")
    jv.track(experiment).table

What is computed is kept where the command line keeps it, so neither computes what the other has; `results` names
another folder. Warnings of a stage are Python warnings here. Bad calls and folders raise `base.schema.InputError`.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import warnings
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from jumpvision.base.schema import InputError
from jumpvision.inputs.experiment import Campaign, Experiment, folder_of, is_campaign, merged, open_campaign
from jumpvision.inputs.experiment import open_experiment as _open_experiment
from jumpvision.inputs.model import model_tables
from jumpvision.inputs.overrides import parse
from jumpvision.report.figures import PICTURES

from .results import Record, fields, tables, values

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from jumpvision.workflow.run import Plan

PathLike = str | os.PathLike[str]
Folder = Experiment | Campaign | str | os.PathLike[str]
R = TypeVar("R", bound=Record)


def open(
    path: PathLike,
    *,
    set: Sequence[str] = (),
    model: PathLike | None = None,
    pipeline: Mapping[str, Mapping[str, Any]] | None = None,
) -> Experiment | Campaign:
    """The experiment folder, or the campaign (a folder of them), at `path`, validated as a whole.

    set: values over the folder's, as --set: ["track.polarity=dark"]. model: a model.toml whose [model] and [robot]
    come over the folder's. pipeline: parameters by stage, under those of the folder.
    """
    overrides = parse(tuple(set))
    if model is not None:
        overrides = merged(model_tables(Path(model)), overrides)
    folder = folder_of(path)
    opened = open_campaign if folder.is_dir() and is_campaign(folder) else _open_experiment
    return opened(folder, overrides=overrides, pipeline=pipeline)


def results_of(path: Path) -> Path:
    """Where results lie by default: results/NAME beside the folder."""
    return path.absolute().parent / "results" / path.absolute().name


def track(experiment: Folder, *, results: PathLike | None = None) -> tables.Track:
    """The ball on the rod in every frame of [rod_video]: position [px], height [m], their sigmas, a flag."""
    return _make(experiment, tables.Track, results)


def rod(experiment: Folder, *, results: PathLike | None = None) -> tables.RodMotion:
    """Height of the rod [m] against time [s], zero at rest, from the track or [rod_track]."""
    return _make(experiment, tables.RodMotion, results)


def bed(experiment: Folder, *, results: PathLike | None = None) -> values.BedHeight:
    """Bed height [m] and volume fraction from [bed_image]."""
    return _make(experiment, values.BedHeight, results)


def geometry(experiment: Folder, *, results: PathLike | None = None) -> values.Geometry:
    """Whether walls, floor and air of the bed disturb the jump."""
    return _make(experiment, values.Geometry, results)


def crater(experiment: Folder, *, results: PathLike | None = None) -> values.CraterShape:
    """Volume change [m^3] of a crater from [crater_image] or [crater_depth]."""
    return _make(experiment, values.CraterShape, results)


def piv(experiment: Folder, *, results: PathLike | None = None) -> fields.Piv:
    """Velocity of the grains in [grain_video]: a data set over (y, x, t) [m/s], x right, y up."""
    return _make(experiment, fields.Piv, results)


def flow(experiment: Folder, *, results: PathLike | None = None) -> fields.Flow:
    """Shear rate, vorticity, divergence [1/s] over (y, x, t); momentum [kg m/s] and added mass [kg] over t."""
    return _make(experiment, fields.Flow, results)


def column(experiment: Folder, *, results: PathLike | None = None) -> fields.Column:
    """Speed under the foot over (y, t), with the jammed front and the decay below it."""
    return _make(experiment, fields.Column, results)


def intrusion(experiment: Folder, *, results: PathLike | None = None) -> values.Intrusion:
    """Two resistances, overshoots and oscillations of [intrusion_log]."""
    return _make(experiment, values.Intrusion, results)


def spring(experiment: Folder, *, results: PathLike | None = None) -> values.SpringTest:
    """Force against displacement of [spring_log]: stiffness and hysteresis."""
    return _make(experiment, values.SpringTest, results)


def fit(experiment: Folder, *, results: PathLike | None = None) -> values.Fits:
    """Every fit: jump height, flights, ring-down, mu, beta, added mass; `.table` has one row a fit."""
    return _make(experiment, values.Fits, results)


def simulate(experiment: Folder, *, results: PathLike | None = None) -> tables.Simulation:
    """The model driven by the motor log or the commanded law: positions [m] (x up), forces [N] against time [s]."""
    return _make(experiment, tables.Simulation, results)


def summary(experiment: Folder, *, results: PathLike | None = None) -> values.Summary:
    """The experiment in a few numbers; None where unknown."""
    return _make(experiment, values.Summary, results)


def run(folder: Folder, *, results: PathLike | None = None, workers: int = 1, pictures: bool = True) -> pd.DataFrame:
    """Every stage that has inputs; one row an experiment, as in jumps.csv, `problem` says what failed or was excluded.

    workers: processes for a campaign; with more than one a script needs `if __name__ == "__main__":`.
    """
    import pandas as pd

    from jumpvision.workflow.run import jumps_table, write_jumps

    campaign, outcomes, plan = _outcomes(folder, None, results, workers, pictures=pictures)
    rows = jumps_table(campaign, outcomes)
    if is_campaign(campaign.path):
        write_jumps(rows, plan.results)
    for o in outcomes:
        for text in o.warnings:
            warnings.warn(f"{o.name}: {text}", stacklevel=2)
    return pd.DataFrame(rows)


def diagnose(campaign: Folder, *, results: PathLike | None = None, workers: int = 1) -> dict[str, Any]:
    """What the campaign's [model] gets wrong, where and why, and what mending it gains: diagnosis.json as a dict."""
    from jumpvision.campaign.diagnose import STAGES, question
    from jumpvision.report.figures.diagnosis import diagnosis_picture

    found, outcomes, plan = _outcomes(campaign, STAGES, results, workers, pictures=False)
    data, _ = question(
        found,
        {o.name: o for o in outcomes},
        plan.results,
        plan.cache,
        workers=workers,
        draw=diagnosis_picture,
        say=_warn,
    )
    return data


def sweep(
    ground: str,
    *,
    analysis: str = "map",
    experiment: PathLike | None = None,
    model: PathLike | None = None,
    laws: PathLike | None = None,
    set: Sequence[str] = (),
    workers: int = 1,
    **axes: str | float | tuple[float, float, int],
) -> xr.Dataset:
    """Jumps over any axes, e.g. frequency=(4, 18, 200), phase=1.57: heights, lift-off, peaks with the axes as dims.

    axes are those of `jumpvision sweep --help`, analyses of `jumpvision sweep GROUND --analyses`; an axis is
    (low, high, number), one value, or "LO:HI:N".
    """
    from jumpvision.studies.study import Call
    from jumpvision.studies.study import run as run_sweep

    given = {k: ":".join(map(str, v)) if isinstance(v, tuple | list) else str(v) for k, v in axes.items()}
    call = Call(
        ground,
        given,
        analysis,
        experiment=_path(experiment),
        model=_path(model),
        laws=_path(laws),
        overrides=parse(tuple(set)),
        workers=workers,
        say=_warn,
    )
    return run_sweep(call)[0]


def plan(
    ground: str,
    apex: float | None = None,
    *,
    experiment: PathLike | None = None,
    model: PathLike | None = None,
    objective: str = "effort",
    motion: str = "single",
    set: Sequence[str] = (),
    **limits: float,
) -> tuple[pd.DataFrame | None, dict[str, Any]]:
    """(motor trajectory time_s, command_m, or None where none is found; plan.json's numbers) for an apex [m], or the
    highest jump. limits: max_force, max_speed, stroke, max_power, by, in place of the motor's.
    """
    from jumpvision.studies.plan import check_call, make_plan, planned_robot, samples, seeded

    check_call(ground, apex, limits)
    tables = {n: t for n, t in parse(tuple(set)).items() if t}
    robot = planned_robot(ground, _path(experiment), _path(model), tables)
    found, _, numbers = make_plan(
        robot, apex, objective=objective, motion=motion, limits=limits, rng=seeded(), say=_warn
    )
    return (samples(found.command, found.command.stop) if numbers["status"] == "solved" else None), numbers


def _opened(folder: Folder) -> Experiment | Campaign:
    return folder if isinstance(folder, Experiment | Campaign) else open(folder)


def _path(path: PathLike | None) -> Path | None:
    return None if path is None else Path(path)


def _warn(text: str) -> None:
    warnings.warn(text, stacklevel=4)


def _places(experiment: Experiment, results: PathLike | None) -> tuple[Path, Path]:
    """(results, cache) of an experiment: those of its campaign where it has one."""
    if results is not None:
        return Path(results), Path(results) / ".cache"
    if experiment.campaign is None:
        return (base := results_of(experiment.path)), base / ".cache"
    base = results_of(experiment.campaign)
    return base / experiment.name, base / ".cache"


def _make(folder: Folder, output: type[R], results: PathLike | None) -> R:
    from jumpvision.workflow.run import write_provenance
    from jumpvision.workflow.stage import STAGES
    from jumpvision.workflow.workspace import Workspace

    importlib.import_module("jumpvision.stages")
    experiment = _opened(folder)
    if isinstance(experiment, Campaign):
        names = ", ".join(e.name for e in experiment.experiments[:3])
        raise InputError([f"{experiment.path}: a campaign; give one of its experiments: campaign[name] ({names}, ...)"])
    workspace = Workspace(experiment, *_places(experiment, results))
    record: R = workspace.make(output)
    write_provenance(workspace, f"jumpvision.{STAGES[output].name}()")
    for step in workspace.steps:
        for text in step.warnings:
            warnings.warn(f"{step.stage}: {text}", stacklevel=3)
    object.__setattr__(record, "pictures", partial(_pictures, experiment, output, *_places(experiment, results)))
    return record


def _pictures(experiment: Experiment, output: type, results: Path, cache: Path) -> list[bytes]:
    """The PNG figures that show a record, drawn or from the cache."""
    from jumpvision.inputs.sections import NotApplicable
    from jumpvision.workflow.stage import STAGES
    from jumpvision.workflow.workspace import Workspace

    for module in PICTURES:
        importlib.import_module(module)
    workspace, out = Workspace(experiment, results, cache), []
    for shown, stage in list(STAGES.items()):
        png = stage.picture and shown.file.endswith(".png")  # type: ignore[attr-defined]  # no films: they take long
        if png and stage.inputs[0].type is output and not workspace.missing(shown):
            with contextlib.suppress(NotApplicable):
                out.append(workspace.make(shown).png)
    return out


def _outcomes(
    folder: Folder, stages: tuple[str, ...] | None, results: PathLike | None, workers: int, *, pictures: bool
) -> tuple[Campaign, list[Any], Plan]:
    from jumpvision.workflow.run import Plan, run_campaign, run_single

    found = _opened(folder)
    campaign = found if isinstance(found, Campaign) else Campaign(found.path, (found,))
    modules = ("jumpvision.stages", *(PICTURES if pictures else ()))
    if isinstance(found, Experiment):
        plan = Plan(*_places(found, results), stages, modules, command="jumpvision.run()")
        return campaign, [run_single(found, plan, workers=workers, hook=None)], plan
    base = Path(results) if results is not None else results_of(found.path)
    plan = Plan(base, base / ".cache", stages, modules, command="jumpvision.run()")
    return campaign, run_campaign(found, plan, workers=workers, done=lambda outcome: None), plan
