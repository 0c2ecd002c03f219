"""A plan from files to files: an experiment's robot, motor and model in; plan.csv and plan.json out."""

from __future__ import annotations

import dataclasses
import json
import math
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from jumpvision.base.arrays import Array
from jumpvision.base.extras import require_extra
from jumpvision.base.record import plain
from jumpvision.base.schema import InputError, Toml
from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.experiment.inputs.model import ModelSpec, read_model
from jumpvision.experiment.inputs.parameters import SimulateParams
from jumpvision.experiment.inputs.sections import Actuation, Clock, Motor, MotorLog, Robot
from jumpvision.experiment.results.tables import RodMotion
from jumpvision.experiment.stages.fit import height_fits
from jumpvision.experiment.stages.rod import read_motor
from jumpvision.experiment.workflow.workspace import Workspace
from jumpvision.jumper.mechanisms.record import Body
from jumpvision.jumper.mechanisms.registry import acting
from jumpvision.jumper.physics.forcing import RATE, Forcing, as_played, first_motion
from jumpvision.jumper.physics.model import GROUNDS, Model

from .robot import setup_of

if TYPE_CHECKING:
    from jumpvision.jumper.planning.plan import Plan, Planner

DRAWS = 200  # models drawn for the spread of the apex
CORRECTS = {m.names[0]: m.corrects for m in acting(Body.ROBOT)}


@dataclass(frozen=True)
class Robot1D:
    """What is planned for: model, motor (None: it is where its command says) and standard uncertainties by name."""

    name: str
    model: Model
    motor: Motor | None
    sigma: Mapping[str, float]


@dataclass(frozen=True)
class PlanNumbers:
    """What plan.json holds, in its order; None: not known, or not of this status."""

    status: str
    apex_m: float
    resimulated_apex_m: float | None
    apex_spread_m: float | None
    solve_s: float
    active_limits: list[str]
    highest_apex_m: float | None
    planned_apex_m: float
    build_s: float
    total_s: float
    robot: str
    ground: str
    objective: str
    motion: str
    limits: dict[str, float]
    duration_s: float
    phases_s: dict[str, float]
    clear_m: float | None = None  # of an obstacle
    clear_s: float | None = None  # that the foot is to be above it, and is in the re-simulation
    resimulated_clear_s: float | None = None
    recorded_apex_m: float | None = None  # of the jump that played it: jump_height of its track
    recorded_sigma_m: float | None = None
    overshoot_m: float | None = None  # recorded less re-simulated jump height


@dataclass(frozen=True)
class Recorded:
    """A jump that played a plan: its track, its motor (k,) [m] at motor_t [s], robot and clock where they are given.

    late [s]: by how much its clock is behind the plan's; height [m] with sigma, from the plan's stop on.
    """

    name: str
    rod: RodMotion
    motor_t: Array
    motor: Array
    robot: Robot | None
    clock: Clock | None
    late: float = math.nan
    height: float = math.nan
    sigma: float = math.nan

    def beside(self, command: Forcing, played: Callable[[Array], Array]) -> Recorded:
        """Laid on the clock of a plan, whose motor is where `played` says, by least squares; and its height."""
        from scipy.optimize import minimize_scalar

        asked = np.arange(0.0, command.stop, 1.0 / RATE)
        moved, step = played(asked), SimulateParams().encoder_step / math.sqrt(12.0)
        near = float(self.motor_t[first_motion(self.motor, step)]) - asked[first_motion(moved, step)]

        def off(shift: float) -> float:
            return float(np.mean((np.interp(asked + near + shift, self.motor_t, self.motor) - moved) ** 2))

        found = minimize_scalar(off, bounds=(-0.05, 0.05), method="bounded", options={"xatol": 1e-6})
        late = near + float(found.x)
        height = height_fits(self.rod, self.robot, (late, late + command.stop), self.clock)["jump_height_m"]
        if not height.known:
            raise InputError([f"--recorded {self.name}: no jump height: {height.reason}"])
        return dataclasses.replace(self, late=late, height=height.value, sigma=height.sigma)


def recorded_jump(path: Path) -> Recorded:
    """The jump of an experiment's folder. InputError where it has no track or no motor log."""
    folder = path.parent if path.name == "experiment.toml" else path
    e = open_experiment(folder)
    log, at = e.section(MotorLog), f"--recorded {path}"
    if log is None:
        raise InputError([f"{at}: [motor_log]: missing; without it the jump cannot be laid beside the plan"])
    with tempfile.TemporaryDirectory() as place:
        workspace = Workspace(e, Path(place) / "results", Path(place) / "cache")
        if missing := workspace.missing(RodMotion):
            raise InputError([f"{at}: no track: {missing}"])
        rod = workspace.make(RodMotion)
    return Recorded(e.name, rod, *read_motor(log, e.section(Actuation)), e.section(Robot), e.section(Clock))


@dataclass(frozen=True)
class Planned:
    """A plan with its planner and numbers. beside: of a landing that sticks, the single jump to the same apex;
    recorded: the jump that played it."""

    plan: Plan
    planner: Planner
    numbers: PlanNumbers
    beside: Plan | None = None
    recorded: Recorded | None = None


Obstacle = tuple[float, float]  # height [m], time that the foot is to be above it [s]


def obstacle_of(text: str) -> Obstacle | None:
    """HEIGHT:SECONDS; None for "". Raises InputError for anything else."""
    try:
        height, seconds = (float(x) for x in text.split(":")) if text else (1.0, 1.0)
    except ValueError:
        height = seconds = math.nan
    if not (0 < height < math.inf and 0 < seconds < math.inf):
        raise InputError([f"--clear {text}: must be HEIGHT:SECONDS, both > 0 (metres and seconds, e.g. 0.02:0.1)"])
    return (height, seconds) if text else None


def check_call(ground: str, apex: float | None, limits: Mapping[str, float], over: Obstacle | None = None) -> None:
    """InputError for a ground, an apex or a limit that cannot be."""
    problems = []
    if apex is not None and over is not None:
        problems.append("--apex and --clear: give one of them")
    if ground not in GROUNDS:
        problems.append(f"--ground {ground}: must be one of {', '.join(GROUNDS)}")
    if apex is not None and not 0 < apex < math.inf:
        problems.append(f"--apex {apex:g}: must be > 0 (metres, e.g. 0.04)")
    problems += [f"--{n.replace('_', '-')} {v:g}: must be > 0" for n, v in limits.items() if not v > 0]
    if problems:
        raise InputError(problems)


def seeded() -> np.random.Generator:
    """The same draws in every call."""
    return np.random.default_rng(0)


def planned_robot(
    ground: str, experiment: Path | None, model_file: Path | None, overrides: Mapping[str, Toml]
) -> Robot1D:
    """The robot of an experiment.toml (or its folder), or the thesis' one. InputError names what is missing."""
    given = dict(overrides)
    sigma: dict[str, float] = {}
    spec: ModelSpec | None = None
    if experiment is not None:
        folder = experiment.parent if experiment.name == "experiment.toml" else experiment
        e = open_experiment(folder, overrides=given)
        if e.ground != ground:
            raise InputError([f"--ground {ground}: {folder / 'experiment.toml'} has ground = '{e.ground}'; give that"])
        robot, spec = e.section(Robot), e.section(ModelSpec)
        if robot is not None:
            sigma |= asdict(robot.sigma)
    found = setup_of(ground, experiment, given, model_file=model_file)
    if model_file is not None:
        spec = read_model(model_file)
    sigma["volume_fraction"] = found.phi_sigma
    for name, value in (spec.sigma if spec else {}).items():
        name = CORRECTS.get(name, name)
        sigma[name] = math.hypot(sigma.get(name, 0.0), value)
    known = {
        n
        for n in sigma
        if n in Robot.__dataclass_fields__
        or n == "volume_fraction"
        or getattr(found.model.parameters, n, None) is not None
    }
    return Robot1D(found.name, found.model, found.motor, {n: s for n, s in sigma.items() if s > 0 and n in known})


def make_plan(
    robot: Robot1D,
    apex: float | None,
    *,
    objective: str,
    motion: str,
    limits: Mapping[str, float],
    say: Callable[[str], None],
    rng: np.random.Generator,
    over: Obstacle | None = None,
    recorded: Recorded | None = None,
) -> Planned:
    """The plan of a jump to an apex, or `over` an obstacle; neither: the highest. limits: by name, they replace the
    motor's. recorded: the jump that played the plan."""
    with require_extra("casadi", "plan", "plan"):
        from jumpvision.jumper.planning.jumper import Drive
        from jumpvision.jumper.planning.plan import Planner, above, apexes
        from jumpvision.jumper.planning.transcription import Limits
    m = robot.motor
    own = {n: v for n in ("max_force", "max_speed", "stroke") if m and (v := getattr(m, n)) is not None}
    drive = Drive(m.kp or 0.0, m.kd or 0.0) if m and m.kp else Drive()
    if drive.kp == 0:
        say("no [motor] kp: the motor is taken to be where its command says")
    planner = Planner(robot.model, drive, Limits(**(own | dict(limits))), objective, motion, say)
    if over is not None:
        plan = planner.clear(*over)
    else:
        plan = planner.highest() if apex is None else planner.plan(apex)
    spread = None
    if plan.status == "solved" and robot.sigma:
        say(f"spread of the apex over {DRAWS} models drawn from the uncertainties of {', '.join(robot.sigma)}")
        spread = float(np.std(apexes(planner, plan.command, robot.sigma, draws=DRAWS, rng=rng), ddof=1))
    elif plan.status == "solved":
        say("no uncertainties in [robot.sigma] or [model.sigma]: the spread of the apex stays open")
    reached = plan.status == "solved"
    numbers = PlanNumbers(
        status=plan.status,
        apex_m=plan.apex,
        resimulated_apex_m=plan.resimulated_apex if reached else None,
        apex_spread_m=spread,
        solve_s=plan.solve_s,
        active_limits=list(plan.active),
        highest_apex_m=None if reached else plan.planned_apex,
        planned_apex_m=plan.planned_apex,
        build_s=plan.build_s,
        total_s=plan.total_s,
        robot=robot.name,
        ground=robot.model.ground,
        objective="height" if apex is None and over is None else objective,
        motion=motion,
        limits={n: v for n, v in asdict(planner.limits).items() if v < math.inf},
        duration_s=plan.command.stop,
        phases_s=dict(zip(_phases(planner.sequence), plan.durations.tolist())),
        clear_m=over[0] if over else None,
        clear_s=over[1] if over else None,
        resimulated_clear_s=above(plan.motion, over[0]) if over and reached else None,
    )
    beside = None
    if motion == "stick" and reached and apex is not None:
        single = Planner(robot.model, drive, planner.limits, objective).plan(apex)
        beside = single if single.status == "solved" else None
    if recorded is not None and reached:
        moved = plan.motion
        recorded = recorded.beside(plan.command, lambda t: np.interp(t, moved.t, moved.motor - moved.rod))
        numbers = dataclasses.replace(
            numbers,
            recorded_apex_m=recorded.height,
            recorded_sigma_m=recorded.sigma,
            overshoot_m=recorded.height - moved.jump_height,
        )
    return Planned(plan, planner, numbers, beside, recorded if reached else None)


def _phases(sequence: tuple[str, ...]) -> list[str]:
    return [f"{i + 1} {mode}" for i, mode in enumerate(sequence)]


def message(numbers: PlanNumbers) -> str:
    """One sentence on a plan that was not found."""
    n = numbers
    limits = ", ".join(f"{name} ({_limit(name, n.limits)})" for name in n.active_limits)
    why = f"what holds it back: {limits}" if limits else "no motor limit holds it back: try another --motion"
    if n.status == "infeasible" and n.highest_apex_m is not None:
        wanted, best = 1e3 * n.apex_m, 1e3 * n.highest_apex_m
        return f"an apex of {wanted:.1f} mm is out of reach: the highest jump found reaches {best:.1f} mm; {why}"
    return f"no plan was found for an apex of {1e3 * n.apex_m:.1f} mm; try another --objective or --motion"


def _limit(name: str, limits: Mapping[str, float]) -> str:
    key, unit = {
        "force": ("max_force", "N"),
        "speed": ("max_speed", "m/s"),
        "stroke": ("stroke", "m"),
        "power": ("max_power", "W"),
        "time": ("by", "s"),
    }[name]
    return f"{limits[key]:g} {unit}"


def samples(command: Forcing) -> pd.DataFrame:
    """The command in equal steps for the controller, to its end."""
    t = as_played(command).knots
    return pd.DataFrame({"time_s": t, "command_m": command(t)[0]})


def write(planned: Planned, folder: Path) -> list[Path]:
    """plan.json, and plan.csv where there is a plan; an old plan.csv does not outlive a failure."""
    folder.mkdir(parents=True, exist_ok=True)
    table, text = folder / "plan.csv", folder / "plan.json"
    text.write_text(json.dumps(plain(asdict(planned.numbers)), indent=1) + "\n", encoding="utf-8")
    if planned.numbers.status != "solved":
        table.unlink(missing_ok=True)
        return [text]
    samples(planned.plan.command).to_csv(table, index=False, lineterminator="\n")
    return [table, text]


def rigid(model: Model) -> Model:
    """The same robot on hard ground: what a plan that knows nothing of the sand is made for."""
    keep = model.acting(Body.CARRIAGE, Body.SPRING, Body.MOTOR)
    return dataclasses.replace(model, ground="hard", terms=tuple(m.name for m in keep))
