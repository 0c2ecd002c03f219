"""A campaign's jumps along any axis: series that differ in it alone, and each model's curve through them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError, closest
from jumpvision.experiment.inputs.experiment import Experiment
from jumpvision.experiment.inputs.model import ModelSpec
from jumpvision.experiment.inputs.sections import Actuation, Motor, MotorLog, Robot
from jumpvision.experiment.results.values import BedHeight
from jumpvision.jumper.mechanisms.record import Body

from .axes import AXES, option
from .robot import Say, Setup, Tables, setup_of
from .sweep import grid_results

LAW = ("frequency", "phase", "amplitude", "cycles", "delay")
BED = ("phi", "foot_radius")
OVER = (*LAW, "alpha", "gravity", *BED)  # along which a campaign may be drawn, first come first
GIVEN = (*LAW, *BED)  # values of a jump that a curve is given
POINTS = 121  # of a curve
MARGIN = 0.03  # of its range beyond the outer points
ALIKE = 3  # digits in which a number of two conditions is the same
DECLARED = "declared model"


@dataclass(frozen=True)
class Place:
    """Where a condition lies: the numbers of OVER by name (NaN: unknown), its kind of jump, an experiment of it with
    what was seen of its bed, in a folder of recordings."""

    at: Mapping[str, float]
    kind: str
    experiment: Experiment
    bed: BedHeight | None


@dataclass(frozen=True)
class Along:
    """over: the axis. series: (c,) number of each condition's series; names: of the series; x: (s, POINTS) of their
    curves; curves: (s, models, POINTS) heights [m], NaN where a model has none."""

    over: str
    series: NDArray[np.int64]
    names: list[str]
    x: Array
    curves: Array


def drawn_along(
    places: Sequence[Place],
    asked: str,
    files: Sequence[Path | None],
    overrides: Tables,
    *,
    workers: int,
    say: Say,
) -> Along:
    """The series of conditions along `asked`, or along what has most values, and the curve of every model (None: the
    declared one). InputError for what is no axis or does not vary."""
    columns = {n: np.array([p.at[n] for p in places]) for n in OVER}
    over = chosen(columns, asked)
    kinds = [p.kind for p in places]
    rest = [n for n in OVER if n not in (over, "alpha") and not (over in ("alpha", "gravity") and n == "amplitude")]
    rest = [n for n in rest if not (over == "alpha" and n == "gravity")]
    keys = [(kinds[i], *(_rounded(n, columns[n][i]) for n in rest)) for i in range(len(places))]
    known = list(dict.fromkeys(sorted(keys, key=str)))
    series = np.array([known.index(k) for k in keys])
    names = [_called(key, rest, known) for key in known]
    x, curves = np.full((len(known), POINTS), np.nan), np.full((len(known), len(files), POINTS), np.nan)
    for s in range(len(known)):
        mine = [p for p, own in zip(places, series) if own == s]
        low, high = (float(f([p.at[over] for p in mine])) for f in (np.min, np.max))
        if not high > low:
            continue
        room = 0.0 if over == "phi" else MARGIN * (high - low)  # laws of a bed end at what was measured
        x[s] = np.linspace(max(low - room, 0.5 * low), high + room, POINTS)
        for k, file in enumerate(files):
            try:
                curves[s, k] = curve(mine, over, x[s], file, overrides, workers)
            except InputError as e:
                say(f"{names[s]}: no curve of the {file.name if file else DECLARED}: {e}")
    return Along(over, series, names, x, curves)


def chosen(columns: Mapping[str, Array], asked: str) -> str:
    """The axis with most values; InputError where the one that was asked for is none, or has one value."""
    count = {
        n: np.unique(x[np.isfinite(x)].round(ALIKE + 3 if n == "amplitude" else ALIKE)).size for n, x in columns.items()
    }
    if not asked:
        return max(OVER, key=lambda n: count[n])
    name = asked.replace("-", "_")
    if name not in OVER:
        raise InputError(
            [f"--over {asked}: no axis of a campaign{closest(name, OVER)}; one of {' '.join(map(option, OVER))}"]
        )
    if count[name] < 2:
        raise InputError([f"--over {asked}: has one value in this campaign; leave it out, or give another axis"])
    return name


def _rounded(name: str, value: float) -> float:
    """As it counts for a condition: beds to 2 digits, as they are packed alike only to some 0.0005."""
    if math.isnan(value):
        return -1.0
    return round(value, 2 if name == "phi" else ALIKE + 3 if name in ("amplitude", "foot_radius") else ALIKE)


def _called(key: tuple[object, ...], rest: Sequence[str], known: Sequence[tuple[object, ...]]) -> str:
    """The kind of jump, and in what it differs from others of the kind."""
    others = [k for k in known if k[0] == key[0]]
    differ = [n for n in range(1, len(key)) if len({k[n] for k in others}) > 1]
    return ", ".join([str(key[0]).replace("_", " "), *(AXES[rest[n - 1]].text(float(str(key[n])), 3) for n in differ)])


def curve(places: Sequence[Place], over: str, x: Array, file: Path | None, overrides: Tables, workers: int) -> Array:
    """Heights [m] of a model at the values x of an axis, all else as in a series. InputError where it has no curve."""
    first = places[0].experiment
    sections = [(p.experiment.section(Robot), p.experiment.section(ModelSpec)) for p in places]
    if over not in ("gravity", "alpha") and any(s != sections[0] for s in sections) and file is None:
        raise InputError(["[robot] or [model] differ between its jumps"])
    if first.section(MotorLog) is None and (motor := first.section(Motor)) and motor.kp:
        raise InputError(["the [motor] loop drives it"])
    setup = setup_of(first.ground, first.path, overrides, model_file=file, bed_seen=places[0].bed)
    spec = sections[0][1]
    if spec and "camera_scale" in spec.terms:
        raise InputError(["the model's camera_scale makes reported heights of true ones"])
    if drive := setup.model.acting(Body.DRIVE):
        raise InputError([f"'{drive[0].name}' is not swept over"])
    mine = {n: np.asarray(np.mean([p.at[n] for p in places])) for n in GIVEN if n != over}
    given = {n: v for n, v in mine.items() if np.isfinite(v) and not (n == "amplitude" and over == "alpha")}
    if over == "alpha" and len({_rounded("gravity", p.at["gravity"]) for p in places}) > 1:
        given["amplitude"] = mine["amplitude"]
    if setup.model.ground == "hard" or not setup.model.volume_fraction:
        given = {n: v for n, v in given.items() if n not in BED}
    fits = {n: v for n, v in given.items() if not (n == "foot_radius" and v == setup.values.get("foot_radius"))}
    law = first.required(Actuation)
    setup = dataclasses.replace(
        setup, values={**setup.values, "dwell_gain": law.dwell_gain} if "kp" in setup.values else setup.values
    )
    if "phi" in fits and not _sees(setup, "phi"):
        del fits["phi"]
    return np.asarray(grid_results(setup, {**fits, over: x}, workers=workers, say=lambda _: None)["jump_height_m"])


def _sees(setup: Setup, name: str) -> bool:
    """Whether a model's terms or laws ask for a value of the bed."""
    return bool(setup.laws) or any(name in setup.model.mechanism(t).symbols for t in setup.model.terms)
