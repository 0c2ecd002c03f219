"""One record a study, what a study is given, and the way from a call to its data set and table.

A study is one function in a module of this package under `@study`; its figure stands in `report.studies` under
`@figure_of`. The command, `jv.sweep`, lists, errors and the table of the docs read the record.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar, get_type_hints

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError, Toml, closest
from jumpvision.experiment.workflow.stage import import_all
from jumpvision.jumper.physics.batch import resolve
from jumpvision.jumper.physics.hard.jump import HardRobot
from jumpvision.jumper.physics.model import GROUNDS

from .axes import EXAMPLE, Laws, option, read_axes, read_laws
from .setup import Setup, remembering, setup_of

ROBOT_AXES = ("gravity", "rod_mass", "motor_mass", "stiffness", "zeta")  # every study takes single values of these

Say = Callable[[str], None]
Row = dict[str, str | float | None]
Found = tuple[xr.Dataset, list[Row]]  # the data set and the table of numbers
Tables = Mapping[str, Toml]  # --set values: {section: {key: value}}


@dataclass(frozen=True)
class Sweep:
    """What a study of a robot is given: single values stand in place of the robot's own (in setup.values already)."""

    study: Study[Any]
    setup: Setup
    ranges: Mapping[str, Array]  # as asked
    values: Mapping[str, Array]  # single values, as asked
    workers: int
    say: Say
    table: Path | None = None

    def axis(self, name: str) -> Array:
        """The asked range, or single value, of an axis, else the usual one of the study."""
        asked = self.ranges.get(name, self.values.get(name))
        return self.usual(name) if asked is None else np.atleast_1d(np.asarray(asked, float))

    def usual(self, name: str) -> Array:
        """The usual range of one of the study's axes."""
        given = self.study.ranges[name]
        return np.atleast_1d(np.asarray(given(self) if callable(given) else given, float))

    @property
    def robot(self) -> HardRobot:
        """The robot's values, as far as hard ground asks for them."""
        return HardRobot(*(float(self.setup.values[n]) for n in HardRobot._fields))

    def number(self, quantity: str, ours: str, thesis: str = "", rk4: str = "") -> Row:
        """A row of the table; the columns thesis and RK4 (docs/physics.md section 7) are of the thesis' robot."""
        known = self.setup.thesis
        return {"quantity": quantity, "thesis": thesis if known else "", "RK4": rk4 if known else "", "ours": ours}


@dataclass(frozen=True)
class Measured:
    """What a study of measured jumps is given: a campaign, where its results lie, and what stands for its own.

    over: the axis along which they are drawn, "" for what varies most.
    """

    study: Study[Any]
    ground: str
    campaign: Path
    results: Path
    overrides: Tables
    workers: int
    say: Say
    model_file: Path | None = None
    laws: Laws | None = None
    over: str = ""


S = TypeVar("S", Sweep, Measured)
Usual = ArrayLike | Callable[[Sweep], ArrayLike]


@dataclass(frozen=True)
class Study(Generic[S]):
    """An analysis of the thesis or of a campaign.

    ranges: axes that it takes as ranges or single values, with the usual range (or how the robot gives it);
    values: axes that it takes as single values, besides ROBOT_AXES. any_axes: it takes all, and single values are
    points of its grid instead of changes of the robot. needs_laws: only with laws of the bed against its packing.
    model_file: --model may replace the campaign's model. memory: the thesis' robot jumps on a bed that remembers a
    pause of the foot, as far as its laws say how (`setup.remembering`). table: it takes a table of the user's.
    """

    name: str
    grounds: tuple[str, ...]
    source: str  # figure or section of the thesis
    function: Callable[[S], Found]
    of_campaign: bool
    ranges: Mapping[str, Usual]
    values: tuple[str, ...]
    any_axes: bool
    needs_laws: bool
    model_file: bool
    memory: bool
    table: bool

    def __call__(self, given: S) -> Found:
        return self.function(given)

    @property
    def file(self) -> str:
        """Name of the data set's file."""
        return f"{self.name}.nc" if self.of_campaign else "sweep.nc"

    @property
    def shows(self) -> str:
        """What it shows: the first line of the function's docstring."""
        return (self.function.__doc__ or "").partition("\n")[0].rstrip(".")


_STUDIES: dict[str, Study[Any]] = {}


def study(
    name: str,
    *grounds: str,
    source: str = "",
    ranges: Mapping[str, Usual] | None = None,
    values: tuple[str, ...] = (),
    any_axes: bool = False,
    needs_laws: bool = False,
    model_file: bool = True,
    memory: bool = False,
    table: bool = False,
) -> Callable[[Callable[[S], Found]], Study[S]]:
    """Register a function of a Sweep, or of Measured jumps, as a study; the arguments are those of Study."""

    def register(function: Callable[[S], Found]) -> Study[S]:
        of_campaign = Measured in get_type_hints(function).values()
        _STUDIES[name] = made = Study(
            name,
            grounds,
            source,
            function,
            of_campaign,
            ranges or {},
            values,
            any_axes,
            needs_laws,
            model_file,
            memory,
            table,
        )
        return made

    return register


def studies(ground: str | None = None) -> dict[str, Study[Any]]:
    """The studies by name, all or those of a ground."""
    import_all("jumpvision.thesis.studies")
    return {n: s for n, s in sorted(_STUDIES.items()) if ground is None or ground in s.grounds}


def listed(ground: str) -> list[Row]:
    """The studies of a ground as a table. InputError for an unknown ground."""
    if ground not in GROUNDS:
        raise InputError([_no_ground(ground)])
    return [
        {
            "analysis": s.name,
            "thesis": s.source,
            "shows": s.shows,
            "ranges of": "any axes" if s.any_axes else " ".join(map(option, s.ranges)),
            "needs": "--campaign" if s.of_campaign else "--table, if you like" if s.table else "",
        }
        for s in studies(ground).values()
    ]


@dataclass(frozen=True)
class Call:
    """A sweep as it is asked for; axes as typed.

    model: a file with [model]. table: of a study that takes one. laws: a file of the bed's parameters against its
    volume fraction. over: the axis of a comparison. campaign, results: of a study of measured jumps, the folder of
    experiments and that of results.
    """

    ground: str
    axes: Mapping[str, str] = dataclasses.field(default_factory=dict)
    analysis: str = "map"
    experiment: Path | None = None
    campaign: Path | None = None
    model: Path | None = None
    laws: Path | None = None
    table: Path | None = None
    over: str = ""
    results: Path = Path("results/sweep")
    overrides: Tables = dataclasses.field(default_factory=dict)
    workers: int = 1
    say: Say = print


def run(call: Call) -> Found:
    """The data set of a sweep and its table of numbers. InputError names every problem."""
    asked = _asked(call)
    if call.campaign is not None:
        laws, rest = _laws(call, example=False), (call.overrides, call.workers, call.say)
        return asked(Measured(asked, call.ground, call.campaign, call.results, *rest, call.model, laws, call.over))
    sweep = _sweep(asked, call)
    try:
        return asked(sweep)
    except InputError:
        raise
    except ValueError as e:
        raise InputError([f"sweep {call.ground} --analysis {call.analysis}: {e}"]) from None


def _no_ground(ground: str) -> str:
    return f"sweep {ground}: unknown ground{closest(ground, GROUNDS)}"


def _asked(call: Call) -> Study[Any]:
    """The study of a call. InputError for a ground, an analysis or files that do not go together."""
    known, problems = studies(), []
    here = studies(call.ground)
    asked = known.get(call.analysis)
    if call.ground not in GROUNDS:
        problems.append(_no_ground(call.ground))
    elif asked is None:
        problems.append(f"--analysis {call.analysis}: unknown{closest(call.analysis, here)}")
    elif call.ground not in asked.grounds:
        other = asked.grounds[0]
        problems.append(f"--analysis {call.analysis}: is of {other} ground; sweep {other}, or leave --analysis out")
    if call.ground == "hard" and call.laws is not None:
        problems.append(f"--laws {call.laws}: has no meaning on hard ground; leave it out")
    if call.table is not None and not (asked and asked.table):
        names = " or ".join(s.name for s in (here or known).values() if s.table) or "another ground's analysis"
        problems.append(f"--table {call.table}: is for --analysis {names}; leave it out")
    if call.over and call.campaign is None:
        problems.append(f"--over {call.over}: is of --campaign FOLDER; leave it out")
    if (call.campaign is not None) != (asked is not None and asked.of_campaign):
        names = " or ".join(s.name for s in (here or known).values() if s.of_campaign)
        problems.append(f"--campaign FOLDER and --analysis {names}: go together; give both or neither")
    elif call.campaign is not None and asked is not None:
        problems += [f"{option(n)} {v}: the jumps are the campaign's own; leave it out" for n, v in call.axes.items()]
        for name, file in (("--experiment", call.experiment), ("--model", None if asked.model_file else call.model)):
            if file is not None:
                problems.append(f"{name} {file}: every experiment of the campaign gives its own; leave it out")
    if problems or asked is None:
        raise InputError(problems)
    return asked


def _sweep(asked: Study[Any], call: Call) -> Sweep:
    """The robot of a call with its axes. InputError for what the study does not take."""
    axes = read_axes(call.ground, call.axes)
    own = call.experiment is None and call.model is None
    laws = _laws(call, example=own and call.ground == "granular" and not asked.any_axes)
    robot = setup_of(call.ground, call.experiment, call.overrides, model_file=call.model, laws=laws)
    robot = dataclasses.replace(robot, thesis=robot.thesis and call.laws is None)
    robot = remembering(robot) if asked.memory and own else robot
    values = {n: a for n, a in axes.items() if a.ndim == 0}
    ranges = {n: a for n, a in axes.items() if a.ndim}
    if asked.any_axes:
        return Sweep(asked, robot, ranges, values, call.workers, call.say)
    at = f"--analysis {asked.name}"
    if asked.needs_laws and robot.laws is None:
        raise InputError([f"{at}: needs the bed's parameters against phi; give --laws FILE"])
    if call.ground == "hard" and not robot.exact:
        raise InputError(
            [
                f"{at}: needs the exact flow, which holds for a massless foot and the terms "
                f"landing_loss and corrections of the robot; this one is: {robot.model}"
            ]
        )
    problems = []
    for n in axes:
        if n in ranges and n not in asked.ranges:
            words = f"takes a range of {' or '.join(map(option, asked.ranges))}" if asked.ranges else "takes no range"
            problems.append(f"{option(n)} {call.axes[n]}: {at} {words}; leave it out, or give one value")
        elif n not in {*asked.ranges, *asked.values, *ROBOT_AXES}:
            problems.append(f"{option(n)} {call.axes[n]}: {at} does not use it; leave it out")
    if problems:
        raise InputError(problems)
    return Sweep(asked, _changed(robot, values), ranges, values, call.workers, call.say, call.table)


def _laws(call: Call, *, example: bool) -> Laws | None:
    """The laws of the call's file, or the example's, without what --set gives."""
    if call.laws is None and not example:
        return None
    found = read_laws(call.laws or EXAMPLE).without(call.overrides.get("model", {}))
    return found if found.laws else None


def _changed(robot: Setup, values: Mapping[str, Array]) -> Setup:
    """The robot with single values in place of its constants."""
    if not values:
        return robot
    try:
        found = resolve(robot.values, values)
    except ValueError as e:
        raise InputError([f"sweep {robot.model.ground}: {e}"]) from None
    robot_changed = any(n in ROBOT_AXES or n in ("amplitude", "alpha", "cycles", "dwell_gain") for n in values)
    return dataclasses.replace(
        robot, values={n: float(v) for n, v in found.items()}, thesis=robot.thesis and not robot_changed
    )
