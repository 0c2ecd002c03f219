"""Summary: one experiment in a few numbers, null where unknown."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace

from jumpvision.estimate.estimate import finite
from jumpvision.estimate.height import curve_height
from jumpvision.experiment.inputs.experiment import Experiment
from jumpvision.experiment.inputs.sections import Actuation, Bed, MotorLog, Robot
from jumpvision.experiment.results.summary import Summary, Uncertain
from jumpvision.experiment.results.tables import Simulation
from jumpvision.experiment.results.values import BedHeight, Fits
from jumpvision.experiment.stages.bed.height import packing, packing_common
from jumpvision.experiment.workflow.stage import Said, stage

from .compare import Value, contradictions
from .rod import motor_runs, total_mass

REST_SHARE = 0.01  # of a jump's height, by which it may rest elsewhere afterwards


@stage(version=7, any_of=("fits", "bed"))
def summary(
    experiment: Experiment,
    law: Actuation | None,
    log: MotorLog | None,
    fits: Fits | None,
    simulation: Simulation | None,
    bed: BedHeight | None,
    section: Bed | None,
    robot: Robot | None,
    said: Said,
) -> Summary:
    """The experiment in a few numbers; null where unknown.

    Every value with `<key>_sigma` beside it (`sigma_m` for the jump height), and
    `<key>_sigma_common` (`sigma_common_m`), the part of it that other experiments share. `warnings`:
    [{kind, message, recording, values}] of all stages.
    """
    phi, phi_sigma = packing(section, bed)

    def fitted(name: str) -> Uncertain:
        e = fits.get(name) if fits else None
        return Uncertain(finite(e.value), finite(e.sigma), finite(e.sigma_common)) if e else Uncertain()

    measured, n_jumps = fitted("jump_height_m"), fitted("n_jumps").value
    found = Summary(
        experiment=experiment.name,
        kind=law.kind if law else None,
        jump_height=measured,
        n_jumps=None if n_jumps is None else int(n_jumps),
        volume_fraction=Uncertain(phi, phi_sigma, None if phi is None else phi * packing_common(section, bed)),
        flight_height=fitted("flight_height_m"),
        flight_time=fitted("flight_time_s"),
        lift_off=fitted("lift_off_s"),
        mu=fitted("mu"),
        beta=fitted("beta_deg"),
        added_mass=fitted("added_mass_kg"),
        frequency=fitted("frequency_hz"),
        zeta=fitted("zeta"),
        motor_rise=fitted("motor_rise_m"),
        spring_stiffness=fitted("spring_stiffness"),
        simulated_height=simulated_height(simulation, law, log) if simulation else None,
    )
    own = [*contradictions(values_of(found, fits, robot, section, bed, hard=experiment.ground == "hard"))]
    for doubt in own:
        warnings.warn(doubt, stacklevel=2)
    return replace(found, warnings=(*said, *(d.record for d in own)))


def values_of(
    found: Summary, fits: Fits | None, robot: Robot | None, section: Bed | None, bed: BedHeight | None, *, hard: bool
) -> Iterator[Value]:
    """The values of quantities that an experiment gives more than once."""
    jump, flight, sag = found.jump_height, found.flight_height, 0.0
    offset = fits.get("ring_offset_m") if fits else None
    if robot and robot.spring_stiffness and (mass := total_mass(robot)):
        sag = 2.0 * mass * robot.gravity / robot.spring_stiffness  # the spring lifts the rod from rest, and shakes it
    if hard:
        yield Value("jump height", "the track", jump.value, jump.sigma, sag)
        yield Value("jump height", "the time of flight", flight.value, flight.sigma)
        if offset:
            yield Value("rest", "the track before the jump", 0.0, 0.0, REST_SHARE * (jump.value or 0.0))
            yield Value("rest", "the track after it", offset.value, offset.sigma)
    yield Value("height by the model", "the track", jump.value, jump.sigma)
    yield Value("height by the model", "the simulation", found.simulated_height)
    if section and bed:
        seen = bed.values
        yield Value("volume fraction", "[bed]", section.volume_fraction, recording="bed")
        yield Value("volume fraction", "its picture", seen["volume_fraction"], seen["sigma_volume_fraction"])
    if robot and found.spring_stiffness.value is not None:
        stated, test = robot.spring_stiffness, found.spring_stiffness
        yield Value("spring stiffness", "[robot]", stated, robot.sigma.spring_stiffness, recording="spring_log")
        yield Value("spring stiffness", "its test", test.value, test.sigma)


def simulated_height(simulation: Simulation, law: Actuation | None, log: MotorLog | None) -> float | None:
    """Greatest simulated rod height from the motor's stop on minus rest [m]; None where the stop is not known."""
    if (runs := motor_runs(law, log)) is None:
        return None
    s = simulation.table
    rod = s.rod_m.to_numpy()
    return finite(curve_height(s.time_s.to_numpy(), rod - rod[0], runs[1]))
