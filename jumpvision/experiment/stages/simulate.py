"""Simulate: the model driven by the measured motor, or by its law where log and law agree."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array
from jumpvision.base.parameters import of_keywords
from jumpvision.base.schema import InputError
from jumpvision.estimate.estimate import checked
from jumpvision.estimate.readings import looked
from jumpvision.experiment.inputs.experiment import Experiment, without_folder
from jumpvision.experiment.inputs.model import ModelSpec
from jumpvision.experiment.inputs.parameters import SimulateParams
from jumpvision.experiment.inputs.sections import Actuation, Bed, Motor, MotorLog, Robot, lacking, need
from jumpvision.experiment.results.tables import RodMotion, Simulation
from jumpvision.experiment.results.values import BedHeight
from jumpvision.experiment.stages.bed.height import packing
from jumpvision.experiment.workflow.stage import StageWarning, stage
from jumpvision.jumper.mechanisms.own import parameters_with
from jumpvision.jumper.physics.batch import OF_MODEL
from jumpvision.jumper.physics.forcing import Forcing, Loop, from_log, from_motion
from jumpvision.jumper.physics.hard.jump import hard_jump
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand.jump import beyond_seen
from jumpvision.jumper.physics.sand.jump import simulate as integrate

from .rod import commanded, last_motion, needs_of_law, read_motor

TICK = 1e-3  # s, spacing of the output where no track gives the times
AROUND = np.linspace(-1.0, 10.0, 12)  # s, of a recording, where a clock's error is looked for


def needs_of_simulate(robot: Robot, law: Actuation | None) -> list[str]:
    """Masses and spring; the law of the motor."""
    return [*lacking(robot, "motor_mass", "rod_mass", "spring_stiffness"), *needs_of_law(law)]


@stage(version=11, any_of=("log", "law"), needs=needs_of_simulate)
def simulate(
    experiment: Experiment,
    robot: Robot,
    spec: ModelSpec,
    log: MotorLog | None,
    law: Actuation | None,
    motor: Motor | None,
    section: Bed | None,
    bed: BedHeight | None,
    rod: RodMotion | None,
    *,
    p: SimulateParams,
) -> Simulation:
    """The model driven by the measured motor or its law: positions [m], x up, and forces [N] against time [s].

    x_r, x_f, x_m absolute, in 1 ms steps over the track; heights as a camera reports them.
    """
    model = build_model(experiment, robot, spec, section, bed)
    forcing, stop = driver(log, law, motor, p, sand=experiment.ground == "granular")
    return moved(model, forcing, stop, rod, p)


def moved(model: Model, forcing: Forcing | Loop, stop: float, rod: RodMotion | None, p: SimulateParams) -> Simulation:
    """A model moved by its motor over the time of a track, where there is one. stop: when the motor rests [s]."""
    columns = courses(model, forcing, stop, None if rod is None else rod.arrays[0], p)
    return Simulation(pd.DataFrame(dict(zip(Simulation.columns, columns, strict=True))))


def courses(model: Model, forcing: Forcing | Loop, stop: float, track: Array | None, p: SimulateParams) -> list[Array]:
    """The same as `Simulation.columns`, (n,) each. track (m,) [s]: its times."""
    shift = float(np.max(np.abs(model.shown(AROUND) - AROUND)))
    times = output_times(forcing, stop, track, lead=0.05 + shift)
    true = model.shown(times)
    if model.exact and not isinstance(forcing, Loop):
        m = hard_jump(
            motor_mass=model.m_m,
            rod_mass=model.rod_mass,
            stiffness=model.k_s,
            damping=model.c_s,
            gravity=model.g,
            landing_loss=model.parameters.e or 0.0 if "landing_loss" in model else 0.0,
            forcing=forcing,
            t=true,
            t_end=max(float(true[-1]), forcing.stop),
        )
        foot = np.maximum(m.rod, 0.0)  # the massless foot stands at 0 or hangs on the relaxed spring
        columns = (m.rod, foot, m.motor, m.ground_force, m.spring_force)
    else:
        n = integrate(model, forcing, t=true, rtol=p.tolerance, atol=1e-9, stop=stop)
        columns = (n.rod, n.foot, n.motor, n.ground_force, n.spring_force)
        for said in beyond_seen(model, n):
            warnings.warn(StageWarning("range", said, "model"), stacklevel=1)
    rest = columns[0][0]
    return [times, rest + model.filmed(columns[0] - rest, times), *columns[1:]]


def build_model(
    experiment: Experiment, robot: Robot, spec: ModelSpec, section: Bed | None, bed: BedHeight | None
) -> Model:
    """The model of [model] over the robot and the bed; a parameter with only a fit range starts at its middle."""
    motor_mass, rod_mass, stiffness = need(robot, "motor_mass", "rod_mass", "spring_stiffness")
    values, own = dict(spec.parameters), spec.mechanisms
    for name, (low, high) in spec.fit.items():
        if name not in values:
            values[name] = 0.5 * (low + high)
            said = f"[model] {name}: no value, only a range; the middle {values[name]:g} is used until it is fitted"
            warnings.warn(StageWarning("missing", said, "model"), stacklevel=2)
    phi, phi_sigma = packing(section, bed)
    if spec.laws:
        if phi is None:
            raise InputError(["[bed] volume_fraction: missing; [model.laws] gives the bed's parameters against it"])
        try:
            at = spec.laws.points(phi, robot.foot_radius or math.nan, phi_sigma or 0.0)
        except ValueError as e:
            raise InputError([f"[model.laws] {e}"]) from None
        if said := spec.laws.continued(phi):
            warnings.warn(StageWarning("range", f"[model.laws] {said}", "model"), stacklevel=2)
        values |= {name.removeprefix(OF_MODEL): float(x) for name, x in at.items()}
    try:
        return Model(
            experiment.ground,
            spec.terms,
            parameters_with(own)(**values),
            motor_mass=motor_mass,
            rod_mass=rod_mass,
            foot_mass=robot.foot_mass,
            spring_stiffness=stiffness,
            spring_damping=robot.spring_damping,
            gravity=robot.gravity,
            foot_radius=robot.foot_radius,
            volume_fraction=phi,
            grain_density=section.grain_density if section else None,
            own=own,
        )
    except InputError as e:
        raise InputError([f"{experiment.path / 'experiment.toml'}: {p}" for p in e.problems]) from None


def driver(
    log: MotorLog | None, law: Actuation | None, motor: Motor | None, p: SimulateParams, *, sand: bool = False
) -> tuple[Forcing | Loop, float]:
    """(forcing, time when the motor stops): the log, or the law where both agree within the encoder's resolution.

    Without a log the law is the command of the [motor] loop where its kp is given, else the motion of the motor. sand:
    a foot rests on it, which a log's ripples before the first motion must not push (`from_motion`).
    """
    known = commanded(law) if law and law.moves else None
    measured = read_motor(log, law) if log and p.driver != "law" else None
    if measured is None:
        if known is None:
            raise InputError(
                ["[actuation] frequency and amplitude, or [motor_log]: missing; the simulation needs a motor"]
            )
        if motor and law and motor.kp is not None:
            return feedback(known, law, motor), known.stop
        return known, known.stop
    time, position = measured
    if known is not None and p.driver == "auto":
        # the encoder rounds, so a log of the law itself differs by less than one step
        off = float(np.max(np.abs(position - known(time)[0])))
        if off <= p.encoder_step:
            return known, known.stop
        said = f"the motor log leaves the commanded law by up to {off * 1e3:.3f} mm: the log drives the model"
        warnings.warn(StageWarning("differs", said, "motor_log", {"apart_m": off}), stacklevel=2)
    spline = (from_motion if sand else from_log)(time, position, p.encoder_step / np.sqrt(12.0))
    return spline, known.stop if known is not None else last_motion(time, position, p.encoder_step)


def feedback(command: Forcing, law: Actuation, motor: Motor) -> Loop:
    """The [motor] loop on the command of [actuation], within its limits where they are given; no kd: none."""
    most = {n: getattr(motor, n) or np.inf for n in ("max_force", "max_speed", "stroke")}
    try:
        return Loop(command, motor.kp or 0.0, motor.kd or 0.0, dwell_gain=law.dwell_gain, **most)
    except ValueError as e:
        raise InputError([f"[motor]: {e}"]) from None


def of_arrays(tables: Any, time_s: ArrayLike | None = None, motor_m: Any = None) -> pd.DataFrame:
    """The motion of a model that tables describe, as experiment.toml would: robot, model, ground, and bed where needed.

    time_s (n,) [s] increasing and motor_m (n,) [m]: where the motor is, along the rod; without them the law of the
    tables' actuation. Example: jv.simulate({"ground": "hard", "robot": {"motor_mass": 1.0, "rod_mass": 0.2,
    "spring_stiffness": 5000}, "model": {"terms": []}, "actuation": {"frequency": 8, "amplitude": 0.005}}).

    Columns: time_s, rod_m, foot_m, motor_m (absolute, up), ground_N, spring_N (forces), in 1 ms steps. Raises
    InputError for tables, ValueError for arrays that are none.
    """
    e = without_folder(tables, "jv.simulate")
    robot, spec = e.section(Robot), e.section(ModelSpec)
    if robot is None or spec is None:
        lacking = [k.name for k in (Robot, ModelSpec) if e.section(k) is None]
        raise InputError([f"jv.simulate: {', '.join(lacking)}: missing"])
    p = of_keywords(SimulateParams, e.params.get("simulate", {}))
    model = build_model(e, robot, spec, e.section(Bed), None)
    if time_s is None:
        return moved(model, *driver(None, e.section(Actuation), e.section(Motor), p), None, p).table
    time, position = checked("simulate", time_s=time_s, motor_m=motor_m)
    usable = np.isfinite(time + position).all() and (np.diff(time) > 0.0).all()
    if usable:
        seen = looked("simulate", motor_m=position)
        time, position = time[seen.kept], seen.columns["motor_m"]
    if time.size < FEWEST or not usable:
        raise ValueError(f"simulate: {time.size} times: give {FEWEST} or more, finite and increasing")
    spline = (from_motion if e.ground == "granular" else from_log)(time, position, p.encoder_step / np.sqrt(12.0))
    return moved(model, spline, float(time[-1]), None, p).table


FEWEST = 8  # samples of a motor's motion


def output_times(forcing: Forcing | Loop, stop: float, track: Array | None, *, lead: float) -> np.ndarray:
    """Equal steps from `lead` seconds before the forcing to the end of the track (or 1 s beyond the motor's stop)."""
    first, last = forcing.start - lead, stop + 1.0
    if track is not None:
        first, last = min(first, float(track[0])), max(float(track[-1]), stop)
    return first + TICK * np.arange(int(np.ceil((last - first) / TICK)) + 1)
