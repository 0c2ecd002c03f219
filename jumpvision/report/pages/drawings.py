"""The figures of an experiment's page, each drawn once by `report.figures`, from its result files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from jumpvision.experiment.inputs.experiment import Experiment
from jumpvision.experiment.inputs.sections import Actuation, Fan, MotorLog
from jumpvision.experiment.results.fields import Column, Flow
from jumpvision.experiment.results.tables import RodMotion, Simulation
from jumpvision.experiment.results.values import Fits, Geometry, Intrusion, SpringTest
from jumpvision.report.figures.bed import air, air_of
from jumpvision.report.figures.grains import added_mass, column, momentum
from jumpvision.report.figures.logs import moved, single, stretched
from jumpvision.report.figures.pictures import history, jump, ring_down

from .svg import Drawn, drawing

MAX_FRAMES = 1500  # of a jump that a page draws


def fits_of(results: Path) -> Fits:
    """fits.json; no fits where it is not there."""
    return Fits.load(results) if (results / Fits.file).exists() else Fits({})


def whole_disc(results: Path) -> bool:
    """Return True if the grain film shows a whole foot and not half of one at the wall."""
    import xarray as xr

    if not (results / Flow.file).exists():
        return False
    with xr.open_dataset(results / Flow.file, decode_times=False) as f:
        return f.attrs.get("disc") == "full"


def motion_figures(results: Path, experiment: Experiment | None) -> Iterator[Drawn]:
    """Draw the jump, the grains, the intrusion."""
    fits, law = fits_of(results), experiment.section(Actuation) if experiment else None
    if (results / RodMotion.file).exists():
        rod = RodMotion.load(results).table
        every = -(-len(rod) // MAX_FRAMES)
        model = Simulation.load(results) if (results / Simulation.file).exists() else None
        note = f"One frame in {every} is shown." if every > 1 else ""
        svg = drawing("The jump", jump, RodMotion(rod.iloc[::every]), model, law, fits)
        yield Drawn(svg, "The jump", note)
    if (results / Flow.file).exists():
        yield from _grain_figures(results, fits, law)
    if (results / Intrusion.file).exists():
        yield intrusion_figure(results)


def _grain_figures(results: Path, fits: Fits, law: Actuation | None) -> Iterator[Drawn]:
    flow = Flow.load(results)
    if not np.isfinite(flow.field.momentum).any():
        return
    shown = [(results.name, law.kind if law else "", flow.field)]
    yield Drawn(drawing("Momentum of the grains", momentum, shown), "Momentum of the grains")
    if not (results / Column.file).exists():
        return
    record = Column.load(results)
    if np.isfinite(flow.field.added_mass).any():
        note = "P/v is singular where the foot stops: left out there."
        yield Drawn(drawing("Mass that moves with the foot", added_mass, fits, record, flow), "Added mass", note)
    levels, speeds = history(record)
    if np.isfinite(speeds).any() and levels[-1] > 0.0:
        words = "The central column and the cone"
        yield Drawn(drawing(words, column, fits, record), words)


def intrusion_figure(results: Path) -> Drawn:
    """Force against depth, what the fit leaves, overshoots."""
    return Drawn(drawing("Slow intrusion", single, Intrusion.load(results)), "Slow intrusion")


def apparatus_figures(results: Path, experiment: Experiment | None) -> Iterator[Drawn]:
    """Draw the apparatus: motor, ring-down, spring, air."""
    fits = fits_of(results)
    log, law = (experiment.section(MotorLog), experiment.section(Actuation)) if experiment else (None, None)
    if log and law and fits.determined("actuator_ratio"):
        yield Drawn(drawing("The motor", moved, fits, log, law), "The motor")
    if fits.get("ring_start_s") and (results / RodMotion.file).exists():
        yield Drawn(drawing("Ring-down", ring_down, fits, RodMotion.load(results)), "Ring-down")
    if (results / SpringTest.file).exists():
        yield Drawn(drawing("The spring", stretched, fits, SpringTest.load(results)), "The spring")
    if (results / Geometry.file).exists():
        found = air_of(Geometry.load(results), experiment.section(Fan) if experiment else None)
        if found is not None:
            yield Drawn(drawing("Fluidisation", air, found), "Fluidisation")
