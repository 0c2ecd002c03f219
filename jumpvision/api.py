"""For notebooks and scripts: every stage as a function on an opened folder, and the commands that give tables.

    import jumpvision as jv

    experiment = jv.open("data_samples/hard_ground")
    jv.track(experiment).table

What is computed is kept where the command line keeps it, so neither computes what the other has; `results` names
another folder. `jv.piv`, `jv.track`, `jv.bed`, `jv.crater` and `jv.intrusion` take arrays too, as `jv.ringdown` and
`jv.flights` do: they need no folder then and write nothing.
Warnings are Python warnings here. Bad calls and folders raise jumpvision.base.schema.InputError.
"""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import inspect
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import jumpvision
from jumpvision.base.record import Record
from jumpvision.base.schema import InputError, StageWarning
from jumpvision.experiment.campaign.folder import Run, results_of, run_folder
from jumpvision.experiment.inputs.experiment import Campaign, Experiment, open_folder
from jumpvision.experiment.inputs.overrides import overrides_of
from jumpvision.experiment.inputs.sections import NotApplicable
from jumpvision.experiment.workflow.provenance import settle
from jumpvision.experiment.workflow.run import Plan
from jumpvision.experiment.workflow.stage import STAGES
from jumpvision.experiment.workflow.workspace import Workspace
from jumpvision.report.figures import PICTURES, diagnosis_png, drawn_by_run

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from numpy.typing import ArrayLike

    from jumpvision.engine.document.diagnosis import Diagnosis
    from jumpvision.experiment.inputs.sections import Robot

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

    Example: jv.open("data_samples/hard_ground", set=["robot.gravity=9.81"])
    """
    return open_folder(path, model=_path(model), pipeline=pipeline, overrides=overrides_of(tuple(set)))


def stage_function(name: str) -> Callable[..., Record]:
    """The stage of this name as a function of an opened folder, or of its path: `jv.track(experiment)`."""
    from jumpvision.base.schema import table_of
    from jumpvision.experiment.workflow.stage import stage_named

    made = stage_named(name)
    of_arrays = jumpvision.of_arrays(name) if name in jumpvision.OF_ARRAYS else None

    def function(experiment: Any, *more: Any, results: PathLike | None = None, **settings: Any) -> Any:
        if more or settings:
            given = ", ".join([*map(repr, more), *settings])
            raise InputError([f"{name}: {given}: a folder's settings stand in its TOML, or in open(..., set=[...])"])
        return _make(experiment, made.output, results)

    function.__name__ = function.__qualname__ = name
    function.__module__ = "jumpvision"
    function.__annotations__["return"] = made.output
    about = [made.help, *inspect.cleandoc(made.function.__doc__ or "").split("\n\n")[1:]]
    about.append("experiment: what `open` gave, or a folder's path. results: another folder than the command line's.")
    about.append(f'Example: jv.{name}(jv.open("my_experiment"))')
    if of_arrays:
        about.append(f"Of arrays, without a folder:\n\n{inspect.cleandoc(of_arrays.__doc__ or '')}")
    if made.params:
        about.append(f"Parameters, in [params.{name}] of the folder or open(..., set=['{name}.NAME=value']):")
        about.append("\n".join(f"    {_parameter(row)}" for row in table_of(made.params)))
    function.__doc__ = "\n\n".join(about)
    return function


def run(folder: Folder, *, results: PathLike | None = None, workers: int = 1, pictures: bool = True) -> pd.DataFrame:
    """What `jumpvision run` does, but for the report; one row an experiment, as in jumps.csv, with the `problem`.

    workers: processes for a campaign; with more than one a script needs `if __name__ == "__main__":`.

    Example: jv.run("my_campaign").groupby("kind").jump_height_m.mean()
    """
    import pandas as pd

    done = _run(folder, Plan, results, workers, pictures=pictures)
    for o in done.outcomes:
        for text in o.said:
            warnings.warn(f"{o.name}: {text}", stacklevel=2)
    return pd.DataFrame([r.cells() for r in done.rows])


def questioned(folder: Folder, results: PathLike | None, workers: int | None) -> Diagnosis:
    """The diagnosis of a campaign, for `jv.diagnose`. Raises InputError where it cannot be tested."""
    from jumpvision.experiment.campaign.folder import DIAGNOSED

    plan = partial(Plan, stages=DIAGNOSED, whole=False)
    done = _run(folder, plan, results, workers or 1, pictures=False, ask=True)
    for o in done.outcomes:
        for text in o.said:
            warnings.warn(f"{o.name}: {text}", stacklevel=3)
    found = done.diagnosis
    assert found is not None  # a campaign that cannot be questioned raises
    return found


def sweep(
    ground: str,
    *,
    robot: Robot | Mapping[str, Any] | None = None,
    experiment: PathLike | None = None,
    model: PathLike | Mapping[str, Any] | None = None,
    laws: PathLike | None = None,
    set: Sequence[str] = (),
    workers: int = 1,
    **axes: str | float | tuple[float, float, int] | ArrayLike,
) -> xr.Dataset:
    """Jumps over any axes: heights [m], number of jumps, lift-off [s], peak power [W] and force [N], dims as the axes.

    axes: frequency, phase, amplitude, delay, alpha, gravity, zeta, phi, ... [SI], as in `jumpvision sweep --help`. An
    axis is an array of values, a tuple (low, high, number) of equal steps, "LOW:HIGH:NUMBER", or one value; a tuple is
    never three values. robot: values of [robot] [SI] that replace those of the experiment, or of the thesis' robot.
    model: a file with [model], or values of [model] that replace others (terms=(...), k1=...). laws: a file of the
    bed's parameters against volume fraction. workers: cores.

    Example: jv.sweep("hard", frequency=(5, 15, 41), phase=1.57).jump_height_m
    """
    from jumpvision.sweeps.axes import read_laws
    from jumpvision.sweeps.sweep import sweep as sweep_axes

    overrides = overrides_of(tuple(set))
    if robot is not None:
        values = robot if isinstance(robot, Mapping) else vars(robot)
        known = {n: v for n, v in values.items() if v is not None and n != "sigma"}
        overrides["robot"] = {**overrides.get("robot", {}), **known}
    if isinstance(model, Mapping):
        overrides["model"] = {**overrides.get("model", {}), **model}
    return sweep_axes(
        ground,
        axes,
        experiment=_path(experiment),
        model=None if isinstance(model, Mapping) else _path(model),
        laws=read_laws(Path(laws)) if laws is not None else None,
        overrides=overrides,
        workers=workers,
        say=_warn,
    )


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

    Example: command, numbers = jv.plan("hard", apex=0.02)
    """
    from jumpvision.sweeps.plan import check_call, make_plan, planned_robot, samples, seeded

    check_call(ground, apex, limits)
    tables = {n: t for n, t in overrides_of(tuple(set)).items() if t}
    robot = planned_robot(ground, _path(experiment), _path(model), tables)
    planned = make_plan(robot, apex, objective=objective, motion=motion, limits=limits, rng=seeded(), say=_warn)
    numbers = dataclasses.asdict(planned.numbers)
    return (samples(planned.plan.command) if planned.numbers.status == "solved" else None), numbers


def _parameter(row: Mapping[str, str]) -> str:
    value = f" = {row['default']}" if row["default"] else ""
    unit = f" {row['unit']}" if row["unit"] else ""
    return f"{row['name']}{value}{unit}: {row['meaning']}"


def _opened(folder: Folder) -> Experiment | Campaign:
    return folder if isinstance(folder, Experiment | Campaign) else open(folder)


def _path(path: PathLike | None) -> Path | None:
    return None if path is None else Path(path)


def _warn(text: str) -> None:
    warnings.warn(text, stacklevel=4)


def _places(folder: Experiment | Campaign, results: PathLike | None) -> tuple[Path, Path]:
    """(results, cache) of a folder; of an experiment those of its campaign where it has one."""
    if results is not None:
        return Path(results), Path(results) / ".cache"
    if isinstance(folder, Campaign) or folder.campaign is None:
        return (base := results_of(folder.path)), base / ".cache"
    base = results_of(folder.campaign)
    return base / folder.name, base / ".cache"


def _make(folder: Folder, output: type[R], results: PathLike | None) -> R:
    experiment = _opened(folder)
    if isinstance(experiment, Campaign):
        names = ", ".join(e.name for e in experiment.experiments[:3])
        raise InputError([f"{experiment.path}: a campaign; give one of its experiments: campaign[name] ({names}, ...)"])
    workspace = Workspace(experiment, *_places(experiment, results))
    record: R = workspace.make(output)
    for text in settle(workspace, f"jumpvision.{STAGES[output].name}()"):
        warnings.warn(text, stacklevel=3)
    for step in workspace.steps:
        for w in step.warnings:
            said = f"{step.stage}: {w['message']}"
            warnings.warn(StageWarning(w["kind"], said, w["recording"], w["values"]), stacklevel=3)
    object.__setattr__(record, "pictures", partial(_pictures, experiment, output, *_places(experiment, results)))
    return record


def _pictures(experiment: Experiment, output: type, results: Path, cache: Path) -> list[bytes]:
    """The PNG figures that show a record, drawn or from the cache."""
    for module in PICTURES:
        importlib.import_module(module)
    workspace = Workspace(experiment, results, cache)
    out: list[bytes] = []
    for shown, stage in list(STAGES.items()):
        png = stage.picture and shown.file.endswith(".png")  # type: ignore[attr-defined]  # no films: they take long
        if png and stage.inputs[0].type is output and not workspace.missing(shown):
            with contextlib.suppress(NotApplicable):
                out.append(workspace.make(shown).png)
    return out


def _run(
    folder: Folder,
    plan: Callable[..., Plan],
    results: PathLike | None,
    workers: int,
    *,
    pictures: bool,
    ask: bool | None = None,
) -> Run:
    opened = _opened(folder)
    drawn, modules = drawn_by_run(opened), PICTURES if pictures else ()
    made = plan(*_places(opened, results), pictures=modules, drawn=drawn, command="jumpvision.run()")
    return run_folder(opened, made, workers=workers, ask=ask, draw=diagnosis_png, say=_warn)
