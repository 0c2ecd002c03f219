"""Geometry: walls, floor and air of an experiment's bed, as numbers and, where a rule is broken, as warnings."""

from __future__ import annotations

import dataclasses
import math
import warnings
from typing import Any, cast

import numpy as np
import scipy

from jumpvision.base.schema import WarningRecord, read, warnings_in
from jumpvision.experiment.inputs.experiment import Experiment
from jumpvision.experiment.inputs.model import ModelSpec
from jumpvision.experiment.inputs.parameters import GeometryParams
from jumpvision.experiment.inputs.sections import Actuation, Bed, Fan, NotApplicable, Preparation, Robot
from jumpvision.experiment.results.values import BedHeight, Checked, Fluidisation, Geometry, GeometryValues
from jumpvision.experiment.workflow.stage import StageWarning, stage
from jumpvision.jumper.mechanisms.ground import LINEAR_PENETRATION, TWO_RESISTANCE
from jumpvision.jumper.physics import air
from jumpvision.jumper.physics.air import Finding, floor, side_walls

from .height import packing

DEEPEST = 10.0  # m, up to which the depth that carries the load is looked for


@stage(version=2)
def geometry(
    section: Bed,
    robot: Robot | None,
    fan: Fan | None,
    prepared: Preparation | None,
    law: Actuation | None,
    model: ModelSpec | None,
    bed: BedHeight | None,
    *,
    p: GeometryParams,
) -> Geometry:
    """Whether walls, floor and air of the bed disturb the jump.

    Checks with value, limit and meaning; onset of fluidisation; the fan's operating point. SI units.
    """
    phi = packing(section, bed)[0]
    height = bed_depth(section, bed, phi)
    findings = walls(section, robot, law, model, height, p)
    flow, more = fluidised(section, robot, fan, phi, height, p)
    findings += more
    if flow and prepared and prepared.pulses and prepared.air_speed is not None:
        findings.append(air.pulse(prepared.air_speed, flow["onset_wu_m_s"]))
    if not findings and flow is None:
        raise NotApplicable(["geometry needs [bed] length and width with [robot] foot_radius, or [bed] grain_diameter"])
    for f in findings:
        if not f.ok:
            warnings.warn(StageWarning("walls", f"{f.check}: {f.text}", "bed"), stacklevel=2)
    return Geometry(
        {
            "findings": [cast(Checked, dataclasses.asdict(f)) for f in findings],
            "bed_height_m": height,
            "volume_fraction": phi,
            "fluidisation": flow,
        }
    )


def bed_depth(section: Bed, bed: BedHeight | None, phi: float | None) -> float | None:
    """Height of the bed [m]: measured, or from the grains' volume."""
    if bed is not None:
        return float(bed.values["height_m"])
    if section.solid_volume and section.length and section.width and phi:
        return section.solid_volume / (phi * section.length * section.width)
    return None


def walls(
    section: Bed,
    robot: Robot | None,
    law: Actuation | None,
    model: ModelSpec | None,
    height: float | None,
    p: GeometryParams,
) -> list[Finding]:
    """Side walls and floor, where what they need is known."""
    radius = robot.foot_radius if robot else None
    if robot is None or radius is None:
        return []
    out = []
    if section.length and section.width:
        out += side_walls(section.length, section.width, radius, ratio=p.wall_ratio)
    if height is not None:
        resistance = static_resistance(model, radius, p)
        depth = reach(robot, law, resistance)
        if depth is not None:
            near = (p.bottom_stress, p.bottom_rate) if p.bottom_stress and p.bottom_rate else None
            out.append(floor(height, resistance(height), radius, depth, constant=p.bottom_constant, law=near))
    return out


def static_resistance(model: ModelSpec | None, radius: float, p: GeometryParams) -> Any:
    """F_p(z) [N] of the model, or of the usual poppy-seed bed where it gives none."""
    m = model.parameters if model else {}
    if {"k1", "k2", "delta"} <= set(m):
        law, given = TWO_RESISTANCE.expression, dict(m)
    else:
        law, given = LINEAR_PENETRATION.expression, {"k": m.get("k", p.stiffness * math.pi * radius**2)}
    assert law is not None
    return lambda z: float(law(np, z=z, **given))


def reach(robot: Robot, law: Actuation | None, resistance: Any) -> float | None:
    """Depth [m] at which the ground carries weight and the motor's greatest inertial force; None where not known."""
    if robot.motor_mass is None or robot.rod_mass is None:
        return None
    load = (robot.motor_mass + robot.rod_mass + robot.foot_mass) * robot.gravity
    if law and law.moves and law.frequency and law.amplitude:
        load += robot.motor_mass * law.amplitude * (2.0 * math.pi * law.frequency) ** 2
    if resistance(DEEPEST) <= load:
        return None
    return float(scipy.optimize.brentq(lambda z: resistance(z) - load, 0.0, DEEPEST))


def fluidised(
    section: Bed, robot: Robot | None, fan: Fan | None, phi: float | None, height: float | None, p: GeometryParams
) -> tuple[Fluidisation | None, list[Finding]]:
    """Onset speeds after Ergun and after Wu, and the fan's operating point; None without grain diameter and phi."""
    if section.grain_diameter is None or phi is None:
        return None, []
    gravity = robot.gravity if robot else Robot().gravity
    weight = air.bed_weight(phi, section.grain_density, gravity)
    laws = {
        name: law(phi, section.grain_diameter, viscosity=p.air_viscosity, density=p.air_density)
        for name, law in (("ergun", air.ergun), ("wu", air.wu))
    }
    out: Fluidisation = {
        "onset_ergun_m_s": laws["ergun"].speed(weight),
        "onset_wu_m_s": laws["wu"].speed(weight),
        "bed_weight_Pa_m": weight,
        "bed_weight_Pa": None if height is None else weight * height,
        "tortuosity": air.tortuosity(1.0 - phi),
        "laws": {k: {"viscous": d.viscous, "inertial": d.inertial} for k, d in laws.items()},
    }
    if fan is None or not fan.speed or height is None:
        return out, []
    speed, pressure, lifted = air.operating_point(laws["wu"], height, weight, fan.speed, fan.pressure, loss=fan.loss)
    out["fan_speed_m_s"], out["fan_pressure_Pa"], out["fluidised"] = speed, pressure, lifted
    onset = out["onset_wu_m_s"]
    where = f"{speed:.3f} m/s at {pressure:.0f} Pa" if math.isfinite(speed) else "beyond the end of its curve"
    finding = Finding(
        "fan's air speed",
        speed,
        onset,
        "m/s",
        lifted,
        f"the fan works at {where}; the bed fluidises from {onset:.3f} m/s on",
    )
    return out, [finding]


def check_geometry(experiment: Experiment) -> tuple[GeometryValues | None, list[WarningRecord]]:
    """(what geometry.json would hold, warnings) from the folder's numbers alone; None where they do not suffice."""
    if experiment.section(Bed) is None:
        return None, []
    given = (experiment.section(s) for s in (Bed, Robot, Fan, Preparation, Actuation, ModelSpec))
    parameters, _ = read(GeometryParams, experiment.params.get("geometry", {}), "[params.geometry]")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", StageWarning)
        try:
            found = geometry(*given, None, p=parameters)
        except NotApplicable:
            return None, []
    return found.values, warnings_in(caught)
