"""Where grains go: paths of material points through the velocity fields of a film."""

from __future__ import annotations

import warnings

from jumpvision.experiment.inputs.sections import Calibration, GrainVideo, NotApplicable, PivField, Robot
from jumpvision.experiment.results.fields import Piv
from jumpvision.experiment.results.tables import Paths
from jumpvision.experiment.stages.recordings import open_grains
from jumpvision.experiment.workflow.stage import StageWarning, stage
from jumpvision.films.arrays.paths import through
from jumpvision.films.parameters import PathsParams

from .masks import half_width


@stage(version=2)
def paths(
    piv: Piv,
    film: GrainVideo | None,
    field: PivField | None,
    robot: Robot | None,
    calibration: Calibration | None,
    *,
    p: PathsParams,
) -> Paths:
    """Paths of grains through the velocity field, from points of a square grid, frame by frame.

    A row a point and frame: id, t, x, y with x_sigma, y_sigma (0 where a path starts; without the scale's), start_x,
    start_y. A path ends with a row without x and y that has the reason.
    """
    if not p.spacing:
        raise NotApplicable(["paths: give [params.paths] spacing = 16 (px between the points they start from)"])
    times = None
    if field is None and film is not None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StageWarning)  # said where the film was opened first
            frames, film = open_grains(film, calibration)
        with frames:
            times = frames.time
    half = half_width(film, robot) if film is not None else None
    return Paths(through(piv.as_matched, piv.geometry, times, half, p))
