"""Motor trajectories: `jumpvision plan`."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from .app import DONE, FAILED, app


def _limit(text: str) -> Parameter:
    return Parameter(help=text, group="Limits, in place of those of [motor]")


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
    pictures: Annotated[bool, Parameter(help="Draw the figure and the animation.")] = True


@app.command
def plan(
    *,
    ground: str,
    apex: float | None = None,
    experiment: Path | None = None,
    model: Path | None = None,
    objective: str = "effort",
    motion: str = "single",
    limits: PlanLimits = PlanLimits(),
    output: PlanOutput = PlanOutput(),
) -> int:
    """Motor trajectory for a jump to a given apex: plan.csv, plan.json, plan.png and an animation plan.html.

    Example: jumpvision plan --apex 0.04 --ground granular

    Parameters
    ----------
    ground
        hard or granular.
    apex
        Height of the rod over rest to reach [m]; without it the highest jump.
    experiment
        An experiment.toml, or its folder, that gives robot, motor and model; default: the thesis' robot.
    model
        A TOML file whose [model] replaces the model, e.g. model.toml of a diagnosis.
    objective
        What is least: effort (motor force squared over time), power (its peak) or energy.
    motion
        single (one push-off), hop (a preliminary hop), stop-go (a pause in the sand), stick (land and stand still).
    """
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # the solver's small matrices: threads cost three times the time
    from dataclasses import asdict

    from jumpvision.inputs.experiment import overrides_of
    from jumpvision.studies.plan import check_call, make_plan, message, planned_robot, seeded, write

    from . import terminal as show

    given = {name: value for name, value in asdict(limits).items() if value is not None}
    check_call(ground, apex, given)
    robot = planned_robot(ground, experiment, model, {n: t for n, t in overrides_of(output.settings).items() if t})
    show.line(f"planning for {robot.name} ...")
    planned = make_plan(robot, apex, objective=objective, motion=motion, limits=given, say=show.line, rng=seeded())
    results, numbers = output.results, asdict(planned.numbers)
    files = write(planned, results)
    if output.pictures:
        from jumpvision.report.figures.plan import plan_animation, plan_picture

        files += [results / "plan.png", results / "plan.html"]
        files[-2].write_bytes(plan_picture(planned))
        files[-1].write_text(plan_animation(planned), encoding="utf-8")
    rows = [{"what": k, "value": v} for k, v in numbers.items() if not isinstance(v, dict)]
    show.result(numbers | {"files": [str(f) for f in files]}, rows, as_json=output.json)
    if planned.numbers.status != "solved":
        show.line(message(planned.numbers))
        return FAILED
    show.line(f"results in {results}: {', '.join(f.name for f in files)}")
    return DONE
