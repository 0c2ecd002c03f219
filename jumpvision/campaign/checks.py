"""What `check` says beyond the validity of a folder: the geometry of its bed, and what is taken as exact."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from typing import Any

from jumpvision.base.schema import read
from jumpvision.inputs.experiment import Experiment
from jumpvision.inputs.model import ModelSpec
from jumpvision.inputs.parameters import GeometryParams
from jumpvision.inputs.sections import Actuation, Bed, Calibration, Fan, NotApplicable, Robot
from jumpvision.stages.bed.geometry import geometry
from jumpvision.workflow.stage import StageWarning

UNMARKED = "rod_track", "crater_depth", "piv_field"  # of which no picture is read that marks could stand in


def check_geometry(experiment: Experiment) -> tuple[dict[str, Any] | None, list[str]]:
    """(values of geometry.json, warnings) from the folder's numbers alone; None where they do not suffice."""
    if experiment.section(Bed) is None:
        return None, []
    bed, robot, fan, law, model = (experiment.section(s) for s in (Bed, Robot, Fan, Actuation, ModelSpec))
    parameters, _ = read(GeometryParams, experiment.params.get("geometry", {}), "[params.geometry]")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", StageWarning)
        try:
            found = geometry(bed, robot, fan, law, model, None, p=parameters)
        except NotApplicable:
            return None, []
    return found.values, [str(w.message) for w in caught if issubclass(w.category, StageWarning)]


def exact_scales(experiments: Iterable[Experiment]) -> str:
    """One note on all sections whose scale is taken as exact, "" where none is; marks bring their own uncertainty."""
    bare: dict[str, None] = {}
    for e in experiments:
        calibration = e.section(Calibration)
        for name, section in e.sections.items():
            marked = calibration is not None and calibration.marks and name not in UNMARKED
            scaled = name == "rod_track" or getattr(section, "scale", None)
            if scaled and not section.scale_sigma and not marked:
                bare[f"[{name}]"] = None
    if not bare:
        return ""
    return (
        f"the scale of {', '.join(bare)} is taken as exact, so no sigma holds its error, which all experiments share: "
        "give scale_sigma (its standard uncertainty, m/px; of [rod_track] a share), or marks in [calibration]"
    )
