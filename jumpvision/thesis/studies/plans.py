"""Plans over a ladder of heights: how high they jump (thesis Fig 64) and what the motor does (Fig 65)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jumpvision.base.arrays import AnyArray, Array
from jumpvision.base.progress import watch
from jumpvision.base.schema import InputError
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand.jump import Motion

from .compute import Variable, dataset
from .plan import rigid, seeded
from .study import Found, Sweep, study

if TYPE_CHECKING:
    from jumpvision.jumper.planning.plan import Plan, Planner

HEIGHTS = np.linspace(0.02, 0.06, 9)  # m
# relative standard deviation between the model planned with and the robot and bed that jump
UNKNOWN = {"k1": 0.03, "k2": 0.03, "b": 0.05, "C": 0.07, "motor_mass": 0.004, "spring_stiffness": 0.01}
THESIS_ERROR = {  # Fig 64
    "rigid plan, rigid ground": "3.4 ± 1.5 mm",
    "granular plan, sand": "3.9 ± 2.1 mm, 6.6 %",
    "rigid plan, sand": "40.6 %",
}


@dataclass(frozen=True)
class Plans:
    """What the plans make least, and the motor's limits in words."""

    objective: str
    limits: str


def planners(s: Sweep, objective: str) -> dict[str, Planner]:
    """A planner for the robot on hard ground and one on its sand. InputError where no [motor] is known."""
    try:
        from jumpvision.jumper.planning.jumper import Drive
        from jumpvision.jumper.planning.plan import Planner
        from jumpvision.jumper.planning.transcription import Limits
    except ImportError:
        raise InputError(["plans: need CasADi; install it with pip install casadi"]) from None
    m = s.setup.motor
    if m is None or m.kp is None:
        raise InputError(["[motor] kp: missing; a plan is made with the motor's feedback loop"])
    limits = Limits(**{n: getattr(m, n) or math.inf for n in ("max_force", "max_speed", "stroke")})
    sand = s.setup.model
    return {
        ground: Planner(model, Drive(m.kp, m.kd or 0.0), limits, objective)
        for ground, model in (("rigid", rigid(sand)), ("sand", sand))
    }


@dataclass(frozen=True)
class Ladders:
    """By ground: planner, plans for the heights, and their objective over the least known, less 1."""

    planners: dict[str, Planner]
    plans: dict[str, list[Plan]]
    excess: dict[str, Array]


def planned(s: Sweep, objective: str) -> Ladders:
    """Plans for the heights; those that were not found on both grounds are left out and told."""
    made, asked = planners(s, objective), s.axis("apex").tolist()
    from jumpvision.jumper.planning.ladder import ladder

    found = {ground: ladder(p, asked) for ground, p in watch(list(made.items()), "ladders of plans")}
    known = [i for i in range(len(asked)) if all(f.plans[i] for f in found.values())]
    for i in sorted({*range(len(asked))} - {*known}):
        s.say(f"no plan was found on both grounds for {1e3 * asked[i]:.0f} mm")
    if not known:
        raise InputError(["[motor]: no plan was found under its limits; widen them"])
    return Ladders(
        made,
        {ground: [p for i in known if (p := f.plans[i])] for ground, f in found.items()},
        {ground: f.excess[known] for ground, f in found.items()},
    )


def motor_of(m: Motion) -> Array:
    """X_m [m] along a motion."""
    return m.motor - m.rod


def results_of(plan: Plan, m: Motion) -> dict[str, float]:
    """A jump's numbers by the names of `compute.RESULTS`."""
    driven = m.t < plan.command.stop
    rate = np.gradient(motor_of(m), m.t)[driven]
    return {
        "com_height_m": m.com_height,
        "flight_height_m": m.flight_height,
        "jump_height_m": m.jump_height,
        "n_jumps": float(len(m.flights)),
        "lift_off_s": float(m.flights[0, 0]) if len(m.flights) else math.nan,
        "peak_power_W": math.nan,
        "peak_force_N": math.nan,
        "peak_motor_speed": float(np.abs(rate).max()),
    }


def _stacked(rows: list[list[dict[str, float]]]) -> dict[str, AnyArray]:
    return {n: np.array([[r[n] for r in row] for row in rows]) for n in rows[0][0]}


def _unknown(model: Model) -> dict[str, float]:
    """UNKNOWN of the values that the model has, in their units."""
    values: Mapping[str, float] = {**dataclasses.asdict(model.parameters), **vars(model)}
    return {n: share * values[n] for n, share in UNKNOWN.items() if values.get(n) and n in _of(model)}


def _of(model: Model) -> set[str]:
    terms = {n for t in model.terms for n in model.mechanism(t).names}
    return terms | {"motor_mass", "spring_stiffness"}


@study("plan-heights", "granular", source="Fig 64", ranges={"apex": HEIGHTS}, values=("phi",))
def plan_heights(s: Sweep) -> Found:
    """Heights jumped against heights planned: rigid and granular plans on hard ground and sand, robots a little off.

    Each plan of least effort is played on 8 robots and beds drawn within UNKNOWN.
    """
    from jumpvision.jumper.planning.plan import perturbed

    found = planned(s, "effort")
    made, plans = found.planners, found.plans
    rng, groups = seeded(), {}
    for name, of, on in (
        ("rigid plan, rigid ground", "rigid", "rigid"),
        ("granular plan, sand", "sand", "sand"),
        ("rigid plan, sand", "rigid", "sand"),
    ):
        model = made[on].model
        played = [perturbed(model, _unknown(model), rng) for _ in range(8)]
        groups[name] = [[made[of].resimulate(p.command, m)[0] for m in played] for p in plans[of]]
    apex = np.array([p.apex for p in plans["sand"]])
    high = np.array([[[m.jump_height for m in row] for row in rows] for rows in groups.values()])
    results = _stacked([[results_of(p, row[0]) for p, row in zip(plans["sand"], rows)] for rows in groups.values()])
    error = np.abs(high - apex[:, None])
    extra: dict[str, Variable] = {
        "jumped_m": (("group", "apex", "robot"), high, "m", "height over rest that the command reaches"),
        "resimulated_m": (
            ("ground", "apex"),
            np.array([[p.resimulated_apex for p in plans[g]] for g in plans]),
            "m",
            "height of the plan, simulated with its events by its own model",
        ),
    }
    data = dataset(
        s,
        {"group": list(groups), "apex": apex, "ground": list(plans)},
        ("group", "apex"),
        results,
        extra,
        facts=Plans("effort", str(made["sand"].limits)),
    )
    rows = [
        s.number(
            f"{name}: error of the height",
            f"{1e3 * e.mean():.1f} ± {1e3 * e.std():.1f} mm, {100 * (e / apex[:, None]).mean():.1f} %",
            THESIS_ERROR[name],
        )
        for name, e in zip(groups, error)
    ]
    worst = max(abs(p.resimulated_apex - p.apex) for f in plans.values() for p in f)
    rows.append(s.number("greatest miss of a plan by its own model", f"{1e6 * worst:.0f} um"))
    return data, rows


@study("plan-strategies", "granular", source="Fig 65", ranges={"apex": HEIGHTS}, values=("phi",))
def plan_strategies(s: Sweep) -> Found:
    """Motor trajectories of plans of least peak power for a ladder of heights, on hard ground and on sand."""
    found = planned(s, "power")
    plans = found.plans
    apex = np.array([p.apex for p in plans["sand"]])
    off = np.array([[take_off(p) for p in f] for f in plans.values()])
    length = np.array([[p.command.stop for p in f] for f in plans.values()])
    time = np.linspace(-off.max(), (length - off).max(), 401)  # about the take-off, that trajectories are shown at
    motor = np.array(
        [
            [np.interp(t + time, p.motion.t, motor_of(p.motion)) for p, t in zip(f, row)]
            for f, row in zip(plans.values(), off)
        ]
    )
    amplitude, pull = np.ptp(motor, axis=-1), -motor.min(axis=-1)
    ratio = amplitude[1] / amplitude[0]
    results = _stacked([[results_of(p, p.motion) for p in f] for f in plans.values()])
    over = ("ground", "apex")
    excess = np.array(list(found.excess.values()))
    extra: dict[str, Variable] = {
        "motor_m": ((*over, "time_from_take_off"), motor, "m", "motor on the rod, X_m"),
        "duration_s": (over, length, "s", "of the command"),
        "take_off_s": (over, off, "s", "from the command's start to the lift-off"),
        "amplitude_m": (over, amplitude, "m", "travel of the motor on the rod"),
        "pull_m": (over, pull, "m", "how far the motor first goes down, which pulls the rod up"),
        "excess": (over, excess, "1", "peak power over that of the best plan found of any shape, less 1"),
    }
    data = dataset(
        s,
        {"ground": list(plans), "apex": apex, "time_from_take_off": time},
        over,
        results,
        extra,
        facts=Plans("power", str(found.planners["sand"].limits)),
    )
    before = motor[..., time <= 0.0]
    step = np.abs(np.diff(before, axis=1)).max(axis=-1) / np.maximum(amplitude[:, 1:], amplitude[:, :-1])
    rows = [
        s.number(
            "travel of the motor, sand over rigid ground, at the least and the greatest height; mean",
            f"{ratio[0]:.2f}, {ratio[-1]:.2f}; {ratio.mean():.2f}",
            "nearly twice",
        ),
        *(
            s.number(
                f"{ground}: share of the travel that is a pull, mean",
                f"{(pull[i] / amplitude[i]).mean():.0%}",
                {"rigid": "pull, then push", "sand": "a single quick thrust"}[ground],
            )
            for i, ground in enumerate(plans)
        ),
        *(
            s.number(
                f"{ground}: change of the trajectory to take-off from one height to the next: median, greatest",
                f"{np.median(step[i]):.0%}, {step[i].max():.0%} of the travel" if step.size else "one height",
                "a smooth shift",
            )
            for i, ground in enumerate(plans)
        ),
        *(
            s.number(
                f"{ground}: peak power above the least of any shape: mean, greatest",
                f"{excess[i].mean():.0%}, {excess[i].max():.0%}",
            )
            for i, ground in enumerate(plans)
        ),
    ]
    return data, rows


def take_off(plan: Plan) -> float:
    """Time [s] of the lift-off in a command's clock."""
    return float(plan.durations[:-1].sum())
