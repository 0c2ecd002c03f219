"""What `check` says beyond the validity of a folder: the geometry of its bed, before anything is measured."""

from __future__ import annotations

import warnings
from typing import Any

from .experiment import Experiment
from .model_spec import ModelSpec
from .params import GeometryParams
from .schema import read
from .sections import Actuation, Bed, Fan, NotApplicable, Robot
from .stage import StageWarning
from .stages.geometry import geometry


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
