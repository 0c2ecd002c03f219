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

from jumpvision.base.schema import InputError
from jumpvision.campaign.folder import Run, results_of, run_folder
from jumpvision.diagnosis.study.processes import How
from jumpvision.diagnosis.study.study import Channel as Channel
from jumpvision.diagnosis.study.study import Mechanism as Mechanism
from jumpvision.diagnosis.study.study import Parameter as Parameter
from jumpvision.diagnosis.study.study import Recording as Recording
from jumpvision.diagnosis.study.study import Study as Study
from jumpvision.inputs.experiment import Campaign, Experiment, open_folder
from jumpvision.inputs.overrides import overrides_of
from jumpvision.inputs.sections import NotApplicable
from jumpvision.report.figures import PICTURES, drawn_diagnosis
from jumpvision.results import Record
from jumpvision.workflow.provenance import settle
from jumpvision.workflow.run import Plan
from jumpvision.workflow.stage import STAGES
from jumpvision.workflow.workspace import Workspace

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from jumpvision.results.diagnosis import Diagnosis

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
    from jumpvision.workflow.stage import stage_named

    made = stage_named(name)
    of_arrays = without_folder(name)

    def function(experiment: Any, *more: Any, results: PathLike | None = None, **settings: Any) -> Any:
        if of_arrays and not isinstance(experiment, Experiment | Campaign | str | os.PathLike):
            return of_arrays(experiment, *more, **settings)
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


def without_folder(name: str) -> Callable[..., Any] | None:
    """A stage's function of arrays: `of_arrays` of its module; None where it has none."""
    from jumpvision.workflow.stage import stage_named

    module = importlib.import_module(stage_named(name).function.__module__)
    found: Callable[..., Any] | None = getattr(module, "of_arrays", None)
    return found


def ringdown(time_s: Any, x: Any, sigma: Any = None) -> pd.DataFrame:
    """What a free oscillation x (n,), in any unit, at time_s (n,) [s] tells: a row a fit, as in fits.json.

    sigma: standard uncertainty of x, (n,) or one number; default: what a smooth curve leaves of neighbouring samples.
    Rows: zeta, frequency_hz, omega0, ring_amplitude, ring_offset (unit of x), and the share of the energy lost to
    viscous damping, quadratic drag and dry friction, with the chance of each alone. NaN samples are left out; a fit
    that the data do not allow has its `reason`. Raises ValueError for arrays of different lengths.

    Example: jv.ringdown(time_s, height_m).loc["zeta", ["value", "sigma"]]
    """
    from jumpvision.results.values import Fits
    from jumpvision.stages.fit import ringdown_of_arrays

    return Fits(ringdown_of_arrays(time_s, x, sigma)).table


def flights(
    table: Any,
    height_m: Any = None,
    sigma_m: Any = None,
    *,
    gravity: float = 9.81,
    shortest: float = 0.0,
    max_gap: float | None = None,
) -> pd.DataFrame:
    """The free flights of any body, e.g. a ball's bounces, a toss or a drop: a row a flight, in order.

    table: with time_s [s] and height_m (or y_m, z_m) [m], up, as `jv.track` gives with a scale, and sigma_m where it is
    known; or times (n,) [s], then height_m (n,) [m], sigma_m: (n,) or one number, its standard uncertainty. Without it
    the noise is what the record shows, correlated or not. NaN samples are left out; a gap longer than max_gap [s]
    (default 3.5 sample intervals) ends a flight. gravity [m/s^2] along the height. Flights shorter than `shortest` [s]
    are left out.

    Columns: lift_off_s, landing_s with lift_off_sigma_s, landing_sigma_s, NaN outside the record; time_s, time_sigma_s
    (with the correlation of the two); height_m = gravity time_s^2 / 8, height_sigma_m; curvature_m_s2, fitted freely,
    curvature_sigma_m_s2; begins, ends: "rest", "impact" (shorter than a sample, between two flights), "support" (a
    smooth motion met at an angle), "spring", "release", "contact" (none of these: good to a sample), "outside".
    `.attrs` holds restitution, (e, sigma) of successive bounces, NaN below two complete ones, and doubts, which say
    what the record contradicts, e.g. a free flight at 11.8 m/s^2 where the scale is wrong, as a Python warning does.
    Raises ValueError for arrays of different lengths, times that do not increase, a sigma that is not above 0.

    Example: jv.flights(jv.track(frames, frame_rate=500, scale=2e-4, origin=(320, 460)))
    """
    from jumpvision.estimate.flight import restitution
    from jumpvision.estimate.flight.table import as_table, columns_of, found_in

    given = columns_of(table) if height_m is None else (table, height_m, sigma_m)
    found = found_in(*given, gravity=gravity, shortest=shortest, max_gap=max_gap)
    for doubt in found.doubts:
        warnings.warn(doubt.message, stacklevel=2)
    out, e = as_table(found, gravity), restitution(found, after=-float("inf"))
    out.attrs |= {"restitution": (e.value, e.sigma), "doubts": [d.message for d in found.doubts]}
    return out


def triangulate(
    first: pd.DataFrame,
    second: pd.DataFrame,
    marks: Any,
    seen_first: Any,
    seen_second: Any,
    *,
    offset: float = 0.0,
    ball_diameter: float = 0.0,
    lens: bool = False,
    window: int = 7,
) -> pd.DataFrame:
    """One body in space from two cameras: a row a frame of the first camera.

    first, second: tables with time_s, x_px, y_px, sigma_px, as `jv.track` gives (x right, y down, no axes needed).
    marks: (n, 3) [m], n >= 6, places that both cameras saw, not in one plane; seen_first, seen_second: (n, 2) column,
    row [px] of them. offset [s]: what is added to the second camera's clock. ball_diameter [m]: of a ball, whose
    outline is not centred on it. lens: fit each camera's radial distortion too. window: as in `jv.track`.

    Columns: frame, time_s; x_m, y_m, z_m in the axes of the marks; sigma_x_m ... independent from frame to frame;
    sigma_common_x_m ... of the calibration, shared by all frames; miss_sigma, by how much the two rays miss each other;
    vx_m_s ... az_m_s2 with v_sigma, a_sigma (of the worst axis); flag: "" or why there is no place (all NaN then).
    Raises InputError for marks or tables that cannot be used.

    Example: jv.triangulate(jv.track(film_a, frame_rate=500), jv.track(film_b, frame_rate=500), marks, seen_a, seen_b)
    """
    from jumpvision.stages.bodies import triangulate as in_space

    seen = (seen_first, seen_second)
    return in_space(first, second, marks, seen, offset=offset, ball_diameter=ball_diameter, lens=lens, window=window)


def run(folder: Folder, *, results: PathLike | None = None, workers: int = 1, pictures: bool = True) -> pd.DataFrame:
    """What `jumpvision run` does, but for the report; one row an experiment, as in jumps.csv, with the `problem`.

    workers: processes for a campaign; with more than one a script needs `if __name__ == "__main__":`.

    Example: jv.run("my_campaign").groupby("kind").jump_height_m.mean()
    """
    import pandas as pd

    done = _run(folder, Plan, results, workers, pictures=pictures)
    for o in done.outcomes:
        for text in o.warnings:
            warnings.warn(f"{o.name}: {text}", stacklevel=2)
    return pd.DataFrame(done.rows)


def diagnose(
    asked: Folder | Sequence[Recording] | pd.DataFrame,
    study: Study | None = None,
    *,
    results: PathLike | None = None,
    workers: int | None = None,
    limit: float | None = None,
    budget: int | None = None,
    keep: PathLike | None = None,
    avoid: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """What a simulation gets wrong, where and why, and what mending it gains; `.values` is diagnosis.json.

    Without a study, asked is a campaign (folder) of jumps whose [model] is questioned; the rest of the arguments but
    results and workers is not used then. With one, asked is recordings of anything, or a long table with the columns
    recording, time_s and a column a channel, and the study's own simulator is questioned (docs/any_simulator.md):
    workers: other processes that simulate (none: this one). limit: seconds of a run (in another process). budget: most
    runs. keep: file that keeps every run, from which a later call goes on. avoid: go round parameters at which a run
    fails, instead of stopping. progress: told how far it is, e.g. print. Nothing is written unless results names a
    folder: diagnosis.json, samples.csv, diagnosis.png, report.html.

    Example: jv.diagnose("my_campaign").sentence
    """
    if study is not None:
        how = How(workers or 0, limit, budget, _path(keep), avoid, progress)
        return _diagnose_study(asked, study, how, _path(results))
    from jumpvision.campaign.folder import DIAGNOSED

    if not isinstance(asked, Experiment | Campaign | str | os.PathLike):
        raise InputError(["diagnose: recordings need the study that simulates them: jv.diagnose(recordings, study)"])
    diagnosed = partial(Plan, stages=DIAGNOSED, whole=False)
    found = _run(asked, diagnosed, results, workers or 1, pictures=False, ask=True).diagnosis
    assert found is not None  # a campaign that cannot be questioned raises
    return found


def _diagnose_study(asked: Any, study: Study, how: How, results: Path | None) -> Diagnosis:
    from jumpvision.campaign.study import question_study
    from jumpvision.report.figures.diagnosis import study_picture
    from jumpvision.report.pages.study import write_study

    if not isinstance(study, Study):
        raise InputError([f"diagnose: study is a {type(study).__name__}; make it with jv.Study(simulate, ...)"])
    if isinstance(asked, Experiment | Campaign | str | os.PathLike):
        raise InputError(["diagnose: a folder and a study: use `jumpvision diagnose FOLDER --simulator MODULE:NAME`"])
    if hasattr(asked, "columns"):
        asked = Recording.of_table(asked, [c.name for c in study.channels])
    found = question_study(list(asked), study, how)
    if results is not None:
        write_study(found, results, study.name or "a study")
    for text in found.noise.warnings:
        warnings.warn(text, stacklevel=3)
    object.__setattr__(found, "pictures", _Pictures(partial(study_picture, found)))
    return found


class _Pictures:
    """The figures of a record that draws itself, made when they are shown; a pickle of the record leaves them."""

    def __init__(self, draw: Callable[[], bytes] | None) -> None:
        self.draw = draw

    def __call__(self) -> list[bytes]:
        return [self.draw()] if self.draw else []

    def __reduce__(self) -> tuple[Any, ...]:
        return _Pictures, (None,)


def sweep(
    ground: str,
    *,
    analysis: str = "map",
    experiment: PathLike | None = None,
    model: PathLike | None = None,
    laws: PathLike | None = None,
    table: PathLike | None = None,
    set: Sequence[str] = (),
    workers: int = 1,
    **axes: str | float | tuple[float, float, int],
) -> xr.Dataset:
    """Jumps over any axes, e.g. frequency=(4, 18, 200), phase=1.57: heights, lift-off, peaks with the axes as dims.

    axes are those of `jumpvision sweep --help`, analyses of `jumpvision sweep GROUND --analyses`; an axis is
    (low, high, number), one value, or "LO:HI:N".

    Example: jv.sweep("hard", frequency=(5, 15, 41), phase=1.57).jump_height_m
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
        table=_path(table),
        overrides=overrides_of(tuple(set)),
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

    Example: command, numbers = jv.plan("hard", apex=0.02)
    """
    from jumpvision.studies.plan import check_call, make_plan, planned_robot, samples, seeded

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
        for text in step.warnings:
            warnings.warn(f"{step.stage}: {text}", stacklevel=3)
    object.__setattr__(record, "pictures", partial(_pictures, experiment, output, *_places(experiment, results)))
    return record


def _pictures(experiment: Experiment, output: type, results: Path, cache: Path) -> list[bytes]:
    """The PNG figures that show a record, drawn or from the cache."""
    for module in PICTURES:
        importlib.import_module(module)
    workspace, out = Workspace(experiment, results, cache), []
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
    made = plan(*_places(opened, results), pictures=PICTURES if pictures else (), command="jumpvision.run()")
    return run_folder(opened, made, workers=workers, ask=ask, draw=drawn_diagnosis, say=_warn)
