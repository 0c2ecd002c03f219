"""Summary: one experiment in a few numbers, null where unknown."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace

from jumpvision.estimate.estimate import finite
from jumpvision.estimate.height import curve_height
from jumpvision.experiment.inputs.experiment import Experiment
from jumpvision.experiment.inputs.sections import Actuation, Bed, MotorLog
from jumpvision.experiment.results.summary import Summary, Uncertain
from jumpvision.experiment.results.tables import Simulation
from jumpvision.experiment.results.values import BedHeight, Fits
from jumpvision.experiment.stages.bed.height import contradicted, packing, packing_common
from jumpvision.experiment.workflow.stage import Said, StageWarning, stage

from .rod import motor_runs

FAR = 5.0  # factor between measured and simulated height that no model's error makes


@stage(version=6, any_of=("fits", "bed"))
def summary(
    experiment: Experiment,
    law: Actuation | None,
    log: MotorLog | None,
    fits: Fits | None,
    simulation: Simulation | None,
    bed: BedHeight | None,
    section: Bed | None,
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
    own = [*packed_otherwise(section, bed), *other_height(found)]
    for doubt in own:
        warnings.warn(doubt, stacklevel=2)
    return replace(found, warnings=(*said, *(d.record for d in own)))


def packed_otherwise(section: Bed | None, bed: BedHeight | None) -> Iterator[StageWarning]:
    """A given volume fraction that is not that of the bed's picture."""
    if text := contradicted(section, bed):
        yield StageWarning("differs", text, "bed")


def other_height(found: Summary) -> Iterator[StageWarning]:
    """A measured height that no error of a model makes of the simulated one."""
    measured = found.jump_height
    height, modelled = measured.value, found.simulated_height
    if height and modelled and not 1.0 / FAR < height / modelled < FAR:
        yield StageWarning(
            "differs",
            f"measured height {height:.3g} m, simulated {modelled:.3g} m ({height / modelled:.3g} times): check units, "
            "scale and masses",
            values={"measured_m": height, "simulated_m": modelled},
        )


def simulated_height(simulation: Simulation, law: Actuation | None, log: MotorLog | None) -> float | None:
    """Greatest simulated rod height from the motor's stop on minus rest [m]; None where the stop is not known."""
    if (runs := motor_runs(law, log)) is None:
        return None
    s = simulation.table
    rod = s.rod_m.to_numpy()
    return finite(curve_height(s.time_s.to_numpy(), rod - rod[0], runs[1]))
