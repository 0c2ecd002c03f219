"""A sweep from options to a data set: which analysis, which axes, which robot."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError, closest
from jumpvision.physics.batch import resolve

from . import motions, scaling, thresholds
from . import sand_beds as granular_studies
from . import sand_models as granular_models
from .axes import EXAMPLE, Laws, option, read_axes, read_laws
from .comparison import compare
from .compute import Say
from .drag_fit import drag_fit
from .machine import Machine, machine
from .study import Analysis, Rows, Study

GROUNDS = ("hard", "granular")


ROBOT_AXES = ("gravity", "rod_mass", "motor_mass", "stiffness", "zeta")


# name: function, axes it takes as ranges, axes it takes as single values besides ROBOT_AXES
ANALYSES: dict[str, tuple[Analysis, tuple[str, ...], tuple[str, ...]]] = {
    "minimum-amplitude": (thresholds.least_amplitude, ("frequency", "phase", "cycles"), ()),
    "lift-off-time": (thresholds.lift_off_time, ("frequency", "amplitude", "phase"), ("cycles",)),
    "alpha": (scaling.alpha, ("alpha",), ("amplitude",)),
    "scatter": (motions.scatter, ("frequency", "phase"), ("amplitude", "cycles", "alpha")),
    "bifurcation": (motions.bifurcation, ("frequency", "amplitude"), ()),
    "traces": (motions.traces, ("frequency", "phase"), ("amplitude", "alpha")),
    "estimates": (scaling.estimates, ("alpha",), ()),
    "animals": (scaling.animals, (), ()),
    "two-frequency": (scaling.two_frequency, ("alpha",), ()),
}


COMPARISON = "comparison"  # of a campaign with its simulation


DRAG_FIT = "drag-fit"  # to the jumps of a campaign


# the same on sand, and whether the laws of the bed against phi are needed
GRANULAR: dict[str, tuple[Analysis, tuple[str, ...], tuple[str, ...], bool]] = {
    "height-phi": (granular_studies.height_phi, ("frequency", "phi"), ("amplitude",), True),
    "jump-types": (granular_studies.jump_types, ("phi",), ("amplitude",), True),
    "delay": (granular_studies.delay, ("delay", "frequency"), ("phi", "amplitude"), False),
    "alpha-fit": (granular_models.alpha_fit, ("frequency", "phi"), ("amplitude",), False),
    "force-models": (granular_models.force_models, (), ("frequency", "phi", "amplitude"), False),
    "drag-scale": (granular_models.drag_scale, ("frequency", "phi"), ("amplitude",), False),
    "foot-radius": (granular_studies.foot_radius, ("foot_radius",), ("phi", "amplitude"), False),
}


OF_GROUND = {"hard": ("map", *ANALYSES, COMPARISON), "granular": ("map", *GRANULAR, DRAG_FIT)}


GRID = {"frequency": (0.2, 1.8, 320), "phase": (0.0, 2.0 * np.pi, 241)}  # f_0 and rad: the map where no range is given


SLOW_GRID = {"frequency": (0.35, 1.5, 40), "phase": (0.0, 2.0 * np.pi, 25)}  # where a jump takes half a millisecond


def run(
    ground: str,
    given: Mapping[str, str],
    *,
    analysis: str,
    experiment: Path | None,
    overrides: Mapping[str, Mapping[str, Any]],
    workers: int,
    say: Say,
    model: Path | None = None,
    laws: Path | None = None,
    campaign: Path | None = None,
    results: Path | None = None,
) -> tuple[xr.Dataset, Rows]:
    """The data set of a sweep and its table of numbers. given: axes as typed. InputError names every problem.

    model: a file with [model]. laws: a file of the bed's parameters against phi (sweep.laws). campaign, results: of
    the comparison, the folder of experiments and the one of their results.
    """
    problems = []
    if ground not in GROUNDS:
        problems.append(f"sweep {ground}: unknown ground{closest(ground, GROUNDS)}")
    elif analysis not in OF_GROUND[ground]:
        other = next((g for g in GROUNDS if analysis in OF_GROUND[g]), None)
        problems.append(
            f"--analysis {analysis}: is of {other} ground; sweep {other}, or leave --analysis out"
            if other
            else f"--analysis {analysis}: unknown{closest(analysis, OF_GROUND[ground])}"
        )
    if ground == "hard" and laws is not None:
        problems.append(f"--laws {laws}: has no meaning on hard ground; leave it out")
    if (campaign is not None) != (analysis in (COMPARISON, DRAG_FIT)):
        of_campaign = COMPARISON if ground == "hard" else DRAG_FIT
        problems.append(f"--campaign FOLDER and --analysis {of_campaign}: go together; give both or neither")
    elif campaign is not None:
        problems += [f"{option(n)} {v}: the jumps are the campaign's own; leave it out" for n, v in given.items()]
        for name, file in (("--experiment", experiment), ("--model", model)):
            if file is not None and (analysis, name) != (DRAG_FIT, "--model"):
                problems.append(f"{name} {file}: every experiment of the campaign gives its own; leave it out")
    if problems:
        raise InputError(problems)
    if campaign is not None and results is not None and analysis == DRAG_FIT:
        return drag_fit(
            campaign,
            overrides=overrides,
            results=results,
            workers=workers,
            say=say,
            model_file=model,
            laws=_laws(laws, overrides, example=False),
        )
    if campaign is not None and results is not None:
        return compare(campaign, overrides=overrides, results=results, workers=workers, say=say)
    axes = read_axes(ground, given)
    of_bed = _laws(laws, overrides, example=analysis in GRANULAR and experiment is None and model is None)
    robot = machine(ground, experiment, overrides, model_file=model, laws=of_bed)
    robot = dataclasses.replace(robot, thesis=robot.thesis and laws is None)
    values = {n: a for n, a in axes.items() if a.ndim == 0}
    ranges = {n: a for n, a in axes.items() if a.ndim}
    if analysis == "map":
        study = Study(robot, ranges, values, workers, say)
        if not ranges:
            grid = GRID if robot.exact else SLOW_GRID
            usual = {n: np.linspace(*x) * (study.f0 if n == "frequency" else 1.0) for n, x in grid.items()}
            study = dataclasses.replace(study, ranges={n: x for n, x in usual.items() if n not in values})
        return motions.grid(study)
    if ground == "granular":
        function, takes, singles, wanted = GRANULAR[analysis]
        if wanted and robot.laws is None:
            raise InputError([f"--analysis {analysis}: needs the bed's parameters against phi; give --laws FILE"])
    elif not robot.exact:
        raise InputError(
            [
                f"--analysis {analysis}: needs the exact flow, which holds for a massless foot and the terms "
                f"landing_loss and corrections of the robot; this one is: {robot.model}"
            ]
        )
    else:
        function, takes, singles = ANALYSES[analysis]
    allowed = {*takes, *singles, *ROBOT_AXES}
    for n in axes:
        if n in ranges and n not in takes:
            words = f"takes a range of {' or '.join(map(option, takes))}" if takes else "takes no range"
            problems.append(f"{option(n)} {given[n]}: --analysis {analysis} {words}; leave it out, or give one value")
        elif n not in allowed:
            problems.append(f"{option(n)} {given[n]}: --analysis {analysis} does not use it; leave it out")
    if problems:
        raise InputError(problems)
    try:
        return function(Study(_changed(robot, values), ranges, values, workers, say))
    except InputError:
        raise
    except ValueError as e:
        raise InputError([f"sweep {ground} --analysis {analysis}: {e}"]) from None


def _laws(file: Path | None, overrides: Mapping[str, Mapping[str, Any]], *, example: bool) -> Laws | None:
    """The laws of the file, or the example's, without what --set gives."""
    if file is None and not example:
        return None
    found = read_laws(file or EXAMPLE).without(overrides.get("model", {}))
    return found if found.laws else None


def _changed(robot: Machine, values: Mapping[str, Array]) -> Machine:
    """The robot with single values in place of its constants."""
    if not values:
        return robot
    try:
        found = resolve(robot.values, values)
    except ValueError as e:
        raise InputError([f"sweep {robot.model.ground}: {e}"]) from None
    robot_changed = any(n in ROBOT_AXES or n in ("amplitude", "alpha", "cycles") for n in values)
    return dataclasses.replace(
        robot, values={n: float(v) for n, v in found.items()}, thesis=robot.thesis and not robot_changed
    )
