"""Spring: its stiffness from a test of force against displacement."""

from __future__ import annotations

import warnings

import pandas as pd

from jumpvision.base.units import factor
from jumpvision.estimate.estimate import Estimate
from jumpvision.estimate.robot import BENT, Spring, spring_stiffness
from jumpvision.experiment.inputs.logs import columns_in, read_log
from jumpvision.experiment.inputs.sections import SpringLog
from jumpvision.experiment.results.values import SpringTest
from jumpvision.experiment.workflow.stage import StageWarning, stage

LENGTH = {f"displacement_{unit}": factor(unit, "m") for unit in ("m", "mm", "um")}
FORCE = {f"force_{unit}": factor(unit, "N") for unit in ("N", "kN", "mN")}


@stage(version=2)
def spring(log: SpringLog) -> SpringTest:
    """Force against displacement of [spring_log]: stiffness and hysteresis.

    `fits` {name: {value, sigma, ...}} and the `profile`: displacement, force, direction and the line.
    """
    d = read_spring(log)
    length, load = d.columns
    x, raw = d[length].to_numpy() * LENGTH[length], d[load].to_numpy()
    force = raw * (FORCE[load] if log.force == "along" else -FORCE[load])
    found = spring_stiffness(x, force, x_sigma=log.displacement_sigma, force_sigma=log.force_sigma)
    k = found.fits["spring_stiffness"]
    if k.reason:
        raise ValueError(f"{log.path}: {length}: {k.reason}; was the spring moved?")
    if not k.value > 3.0 * k.sigma:
        other = "against" if log.force == "along" else "along"
        raise ValueError(
            f"{log.path}: {load} does not grow with {length}: {k.value:.4g} ± {k.sigma:.2g} N/m; where the log counts "
            f'the force the other way give [spring_log] force = "{other}"'
        )
    warn_of(found)
    return SpringTest(
        {
            "fits": {n: e.entry() for n, e in found.fits.items()},
            "profile": {"displacement_m": x, "force_N": force, "direction": found.side, "fitted_N": found.fitted},
        }
    )


def read_spring(log: SpringLog) -> pd.DataFrame:
    """Displacement and force in the units that the file has; the SI ones where it has none, which reading refuses."""
    held = columns_in(log)
    length, load = (next((c for c in held if c in units), next(iter(units))) for units in (LENGTH, FORCE))
    return read_log(log, length, load, at_least=5, ordered=False)


def warn_of(found: Spring) -> None:
    """Warnings: a loop, a curve instead of a line."""
    k, h, bend = (found.fits.get(n) for n in ("spring_stiffness", "spring_hysteresis_N", "spring_curvature"))
    assert k is not None and bend is not None
    said: list[str] = []
    if h is not None and clear(h):
        said.append(f"loading and unloading differ by {2 * h.value:.3g} ± {2 * h.sigma:.2g} N (hysteresis)")
    if clear(bend):
        ends = [k.value + s * 0.5 * found.span * bend.value for s in (-1, 1)]
        text = (
            f"its force is no straight line: {ends[0]:.5g} to {ends[1]:.5g} N/m over the {1e3 * found.span:.3g} mm "
            "measured; spring_stiffness is that in the middle"
        )
        said.append(text)
    for text in said:
        warnings.warn(StageWarning("law", text, "spring_log"), stacklevel=3)


def clear(e: Estimate) -> bool:
    """Whether a value is beyond what its noise explains."""
    return abs(e.value) > BENT * e.sigma
