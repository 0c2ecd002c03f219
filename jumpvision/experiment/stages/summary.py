"""Summary: one experiment in a few numbers, null where unknown."""

from __future__ import annotations

import warnings

import numpy as np

from jumpvision.estimate.estimate import finite
from jumpvision.experiment.inputs.experiment import Experiment
from jumpvision.experiment.inputs.sections import Actuation, Bed
from jumpvision.experiment.results.tables import Simulation
from jumpvision.experiment.results.values import BedHeight, Fits, Summary
from jumpvision.experiment.stages.bed.height import contradicted, packing, packing_common
from jumpvision.experiment.workflow.stage import StageWarning, stage

FAR = 5.0  # factor between measured and simulated height that no model's error makes
FROM_FITS = {  # key of summary.json: name in fits.json
    "flight_height_m": "flight_height_m",
    "flight_time_s": "flight_time_s",
    "lift_off_s": "lift_off_s",
    "mu": "mu",
    "beta_deg": "beta_deg",
    "added_mass_kg": "added_mass_kg",
    "frequency_hz": "frequency_hz",
    "zeta": "zeta",
    "motor_rise_m": "motor_rise_m",
    "spring_stiffness_N_m": "spring_stiffness",
}


@stage(version=4, any_of=("fits", "bed"))
def summary(
    experiment: Experiment,
    law: Actuation | None,
    fits: Fits | None,
    simulation: Simulation | None,
    bed: BedHeight | None,
    section: Bed | None,
) -> Summary:
    """The experiment in a few numbers; null where unknown.

    Every value with `<key>_sigma` beside it (`sigma_m` for the jump height), and
    `<key>_sigma_common` (`sigma_common_m`), the part of it that other experiments share.
    """
    phi, phi_sigma = packing(section, bed)
    if said := contradicted(section, bed):
        warnings.warn(said, StageWarning, stacklevel=1)

    def parts(name: str) -> tuple[float | None, float | None, float | None]:
        """value, sigma, sigma_common of a fit."""
        e = fits.get(name) if fits else None
        return (finite(e.value), finite(e.sigma), finite(e.sigma_common)) if e else (None, None, None)

    height, height_sigma, height_common = parts("jump_height_m")
    n_jumps = parts("n_jumps")[0]
    out = {
        "experiment": experiment.name,
        "kind": law.kind if law else None,
        "jump_height_m": height,
        "sigma_m": height_sigma,
        "sigma_common_m": height_common,
        "n_jumps": None if n_jumps is None else int(n_jumps),
        "volume_fraction": phi,
        "sigma_volume_fraction": phi_sigma,
        "sigma_common_volume_fraction": None if phi is None else phi * packing_common(section, bed),
    }
    for key, name in FROM_FITS.items():
        out |= zip((key, f"{key}_sigma", f"{key}_sigma_common"), parts(name))
    out["simulated_height_m"] = modelled = simulated_height(simulation, law) if simulation else None
    if height and modelled and not 1.0 / FAR < height / modelled < FAR:
        warnings.warn(
            f"measured height {height:.3g} m, simulated {modelled:.3g} m ({height / modelled:.3g} times): check units, "
            "scale and masses",
            StageWarning,
            stacklevel=2,
        )
    return Summary(out)


def simulated_height(simulation: Simulation, law: Actuation | None) -> float | None:
    """Greatest simulated rod height after the motor stops minus rest [m]; None where it is not known when it stops."""
    s = simulation.table
    time, rod, relative = s.time_s.to_numpy(), s.rod_m.to_numpy(), (s.motor_m - s.rod_m).to_numpy()
    if law and law.moves:
        stop = law.stop
    else:
        moving = np.flatnonzero(np.abs(relative - relative[-1]) > 1e-4)
        stop = time[moving[-1]] if moving.size else time[0]
    after = time >= stop
    return float(rod[after].max() - rod[0]) if after.any() else None
