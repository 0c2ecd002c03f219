"""Commands on a model alone: maps of jumps, publication figures of results, motor trajectories."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from .app import DONE, FAILED, app, cores, option

AXES, LIMITS = "Axes: LO:HI:N, or one value; SI units", "Limits, in place of those of [motor]"
_axis, _limit = partial(option, group=AXES), partial(option, group=LIMITS)


@Parameter(name="*", show_default=False)
@dataclass(frozen=True)
class SweepAxes:
    """Declare the axes of a sweep, in the order of its dimensions; sweeps.axes checks their values."""

    frequency: Annotated[str | None, _axis("Forcing frequency [Hz].")] = None
    phase: Annotated[str | None, _axis("Start phase [rad]; pi/2 is a stutter jump, 3 pi/2 a single jump.")] = None
    amplitude: Annotated[str | None, _axis("Forcing amplitude A [m].")] = None
    delay: Annotated[str | None, _axis("Pause between the two half cycles [s].")] = None
    dwell_gain: Annotated[
        str | None, _axis("Position gain in the pause / normal gain; below 1 the [motor] loop drives (granular).")
    ] = None
    frequency2: Annotated[str | None, _axis("Frequency of the second half cycle [Hz].")] = None
    cycles: Annotated[str | None, _axis("Number of forcing cycles.")] = None
    alpha: Annotated[str | None, _axis("M g/(k A): sets the amplitude, or gravity with --amplitude.")] = None
    gravity: Annotated[str | None, _axis("Gravity along the rail [m/s^2].")] = None
    rod_mass: Annotated[str | None, _axis("Mass of the rod [kg]; the total mass is kept.")] = None
    motor_mass: Annotated[str | None, _axis("Mass of the motor [kg].")] = None
    stiffness: Annotated[str | None, _axis("Stiffness of the spring [N/m].")] = None
    zeta: Annotated[str | None, _axis("Damping ratio c / (2 sqrt(k M)).")] = None
    phi: Annotated[str | None, _axis("Volume fraction of the bed (granular).")] = None
    foot_radius: Annotated[str | None, _axis("Radius of the foot [m] (granular).")] = None


@Parameter(name="*")
@dataclass(frozen=True)
class SweepOptions:
    """What is swept besides the axes, and where it goes."""

    analysis: Annotated[
        Literal["map", "comparison"],
        option("map, or comparison: the measured heights of CAMPAIGN beside simulated ones."),
    ] = "map"
    experiment: Annotated[
        Path | None,
        option("An experiment.toml, or its folder, that gives robot, law and model; default: the thesis' robot."),
    ] = None
    model: Annotated[Path | None, option("A TOML file whose [model] replaces the model, e.g. model.toml.")] = None
    laws: Annotated[
        Path | None,
        option("A TOML file of the bed's parameters against volume fraction (docs/granular.md)."),
    ] = None
    results: Annotated[
        Path | None, option("Folder for the files; default: results/sweep, or results/NAME beside the campaign.")
    ] = None
    settings: Annotated[
        tuple[str, ...],
        Parameter(name="--set", negative="", help="Override a value: section.key=value, e.g. robot.gravity=9.81."),
    ] = ()
    json: Annotated[bool, option("Machine-readable result on stdout.")] = False
    workers: Annotated[int | None, option("Cores to use; default: all.")] = None
    pictures: Annotated[bool, option("Draw the figure.")] = True


@app.command
def sweep(
    ground: str,
    campaign: Path | None = None,
    *,
    axes: SweepAxes = SweepAxes(),
    options: SweepOptions = SweepOptions(),
) -> int:
    """Jumps over any axes: sweep.nc and sweep.png; or a campaign's measured heights beside simulated: comparison.*.

    Example: jumpvision sweep hard --frequency 4:18:200 --phase 0:6.283:200

    Parameters
    ----------
    ground
        hard or granular.
    campaign
        Folder of experiments, for --analysis comparison.
    """
    from dataclasses import asdict

    from jumpvision.base.schema import InputError
    from jumpvision.experiment.campaign.folder import results_of
    from jumpvision.experiment.inputs.experiment import folder_of
    from jumpvision.experiment.inputs.overrides import overrides_of
    from jumpvision.sweeps.axes import option as typed
    from jumpvision.sweeps.axes import read_laws
    from jumpvision.sweeps.sweep import highest, keep_other, write
    from jumpvision.sweeps.sweep import sweep as sweep_axes

    from . import terminal as show

    o, given = options, {name: text for name, text in asdict(axes).items() if text is not None}
    results = o.results or (results_of(folder_of(campaign)) if campaign else Path("results/sweep"))
    workers, overrides = o.workers or cores(), overrides_of(o.settings)
    if (campaign is not None) != (o.analysis == "comparison"):
        raise InputError(["sweep: CAMPAIGN and --analysis comparison go together; give both or neither"])
    if campaign is not None:
        from jumpvision.sweeps.comparison import FILE, compare, rows

        alone = [f"{typed(n)} {v}: the jumps are the campaign's own" for n, v in given.items()]
        alone += [f"--{n} {v}: every experiment gives its own" for n in ("experiment", "laws") if (v := getattr(o, n))]
        if alone:
            raise InputError([f"{p}; leave it out" for p in alone])
        with show.progress():
            data = compare(
                ground,
                campaign,
                results,
                model=o.model,
                overrides=overrides,
                workers=workers,
                say=show.line,
            )
        table, name = rows(data), FILE
    else:
        from jumpvision.sweeps.sweep import FILE as name

        with show.progress():
            data = sweep_axes(
                ground,
                given,
                experiment=o.experiment,
                model=o.model,
                laws=read_laws(o.laws) if o.laws else None,
                overrides=overrides,
                workers=workers,
                say=show.line,
            )
        table = [{"quantity": "highest centre of mass", "value": highest(data)}]
    if kept := keep_other(results / name, data):
        show.line(f"{name} held another sweep; that one is kept as {kept}")
    files = [write(data, results, name)]
    if o.pictures:
        from jumpvision.sweeps.figures import picture

        files.append(files[0].with_suffix(".png"))
        files[1].write_bytes(picture(data))
    show.written({"results": str(results), "numbers": table}, table, files, as_json=o.json)
    return DONE


@app.command
def figures(
    path: Path,
    /,
    *,
    list_: Annotated[bool, Parameter(name="--list", negative="")] = False,
    only: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    format: Annotated[tuple[str, ...], Parameter(negative="")] = ("pdf",),
    results: Path | None = None,
    out: Path | None = None,
    json: bool = False,
) -> int:
    """The figures of a campaign, an experiment or a sweep for print: PDF, SVG or PNG in one style.

    Example: jumpvision figures results/loose_sand --format pdf,png

    Parameters
    ----------
    path
        A folder of results, a sweep.nc, or the experiment or campaign folder that the results were made from.
    list_
        Say which figures there are, and draw none.
    only
        Names of the figures to draw, e.g. heights,tracks; default: all.
    format
        pdf, svg, png; several as pdf,png.
    results
        Where the results lie if PATH is the folder of recordings; default: results/NAME beside it.
    out
        Folder for the figures; default: figures in the folder of results.
    json
        Machine-readable result on stdout.
    """
    from jumpvision.base.schema import InputError
    from jumpvision.experiment.campaign.folder import results_of
    from jumpvision.experiment.inputs.experiment import is_campaign, open_experiment
    from jumpvision.report.catalogue import Offered, available, draw
    from jumpvision.sweeps.figures import of_folder

    from . import terminal as show

    recordings = path.is_dir() and ((path / "experiment.toml").exists() or is_campaign(path))
    source = (results or results_of(path)) if recordings else path
    if not source.exists():
        raise InputError([f"{source}: no results there; run `jumpvision run {path}` first, or give --results"])
    recorded = open_experiment(path) if recordings and not is_campaign(path) else None
    found = available(source, recorded) if source.is_dir() else {}
    found |= {n: Offered(n, "a map of jumps, or a comparison", f) for n, f in of_folder(source).items()}
    if not found:
        raise InputError([f"{source}: holds no results to draw; run `jumpvision run` or `jumpvision sweep` first"])
    if list_:
        rows = [{"figure": o.name, "shows": o.shows} for o in found.values()]
        show.result(rows, rows, as_json=json)
        return DONE
    folder = out or (source if source.is_dir() else source.parent) / "figures"
    files = draw(found, folder, _split(only), _split(format))
    rows = [{"file": str(f)} for f in files]
    show.result({"figures": [str(f) for f in files]}, rows, as_json=json)
    return DONE


def _split(texts: tuple[str, ...]) -> tuple[str, ...]:
    """Names given one by one or with commas between them."""
    return tuple(part for text in texts for part in text.split(",") if part)


@Parameter(name="*", show_default=False)
@dataclass(frozen=True)
class PlanLimits:
    """Limits of a plan; what is not given is the motor's."""

    max_force: Annotated[float | None, _limit("Greatest motor force [N].")] = None
    max_speed: Annotated[float | None, _limit("Greatest speed of the motor on the rod [m/s].")] = None
    stroke: Annotated[float | None, _limit("Travel of the motor on the rod [m].")] = None
    max_power: Annotated[float | None, _limit("Greatest motor power [W].")] = None
    by: Annotated[float | None, _limit("Latest time of the apex after the start [s].")] = None


@Parameter(name="*")
@dataclass(frozen=True)
class PlanOutput:
    """Where a plan goes, and values in place of others."""

    results: Annotated[Path, Parameter(help="Folder for the files.")] = Path("results/plan")
    settings: Annotated[
        tuple[str, ...],
        Parameter(name="--set", negative="", help="Override a value: section.key=value, e.g. motor.kp=30000."),
    ] = ()
    json: Annotated[bool, Parameter(help="Machine-readable result on stdout.")] = False
    pictures: Annotated[bool, Parameter(help="Draw the figure.")] = True


@app.command
def plan(
    *,
    ground: str,
    apex: float | None = None,
    clear: str = "",
    experiment: Path | None = None,
    model: Path | None = None,
    recorded: Path | None = None,
    objective: str = "effort",
    motion: str = "single",
    limits: PlanLimits = PlanLimits(),
    output: PlanOutput = PlanOutput(),
) -> int:
    """Motor trajectory for a jump to a given apex: plan.csv, plan.json and plan.png.

    Needs CasADi: pip install casadi.

    Example: jumpvision plan --apex 0.04 --ground granular

    Parameters
    ----------
    ground
        hard or granular.
    apex
        Height of the rod over rest to reach [m]; without it, and without --clear, the highest jump.
    clear
        HEIGHT:SECONDS, e.g. 0.02:0.1: over an obstacle; the foot is above HEIGHT [m] for so long.
    experiment
        An experiment.toml, or its folder, that gives robot, motor and model; default: the thesis' robot.
    model
        A TOML file whose [model] replaces the model, e.g. model.toml of a diagnosis.
    recorded
        Folder of an experiment that played the plan: drawn beside it, with its overshoot.
    objective
        What is least: effort (motor force squared over time), power (its peak) or energy.
    motion
        single (one push-off), hop (a preliminary hop), stop-go (a pause in the sand), stick (land and stand still).
    """
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # the solver's small matrices: threads cost three times the time
    from dataclasses import asdict

    from jumpvision.experiment.inputs.overrides import overrides_of
    from jumpvision.sweeps.plan import (
        check_call,
        make_plan,
        message,
        obstacle_of,
        planned_robot,
        recorded_jump,
        seeded,
        write,
    )

    from . import terminal as show

    given = {name: value for name, value in asdict(limits).items() if value is not None}
    over = obstacle_of(clear)
    check_call(ground, apex, given, over)
    robot = planned_robot(ground, experiment, model, {n: t for n, t in overrides_of(output.settings).items() if t})
    show.line(f"planning for {robot.name} ...")
    planned = make_plan(
        robot,
        apex,
        objective=objective,
        motion=motion,
        limits=given,
        say=show.line,
        rng=seeded(),
        over=over,
        recorded=recorded_jump(recorded) if recorded else None,
    )
    results, numbers = output.results, asdict(planned.numbers)
    files = write(planned, results)
    if output.pictures:
        from jumpvision.sweeps.plan_figure import plan_picture

        files.append(results / "plan.png")
        files[-1].write_bytes(plan_picture(planned))
    rows = [{"what": k, "value": v} for k, v in numbers.items() if not isinstance(v, dict)]
    if planned.numbers.status != "solved":
        show.result(numbers | {"files": [str(f) for f in files]}, rows, as_json=output.json)
        show.line(message(planned.numbers))
        return FAILED
    show.written(numbers, rows, files, as_json=output.json)
    return DONE
