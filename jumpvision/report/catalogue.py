"""Which figures a folder of results gives, each drawn when it is asked for."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from jumpvision.base.schema import InputError, closest
from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.experiment import files
from jumpvision.experiment.campaign.measured.actuator import Driven, actuator_bandwidth
from jumpvision.experiment.campaign.measured.craters import craters_of, zero_crossing
from jumpvision.experiment.campaign.measured.intrusions import SlowIntrusion, intrusion_laws, slow_intrusion, stepped
from jumpvision.experiment.inputs.experiment import Experiment
from jumpvision.experiment.inputs.sections import Actuation, Fan, MotorLog
from jumpvision.experiment.results.fields import Column, Flow, Piv
from jumpvision.experiment.results.summary import Summary
from jumpvision.experiment.results.tables import RodMotion, Simulation
from jumpvision.experiment.results.values import CraterShape, Geometry, Intrusion, SpringTest
from jumpvision.report.figures import grains as films
from jumpvision.report.figures.bed import air, air_of, critical
from jumpvision.report.figures.diagnosis import gains, heights
from jumpvision.report.figures.logs import actuator, moved, resistances, single, steps, stretched
from jumpvision.report.figures.pictures import Tracked, ring_down, tracks
from jumpvision.report.pages.drawings import fits_of
from jumpvision.report.style import FORMATS, NewFigure, lettered, printed, save

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Offered(NamedTuple):
    """A figure: its name, what it shows, and what makes it."""

    name: str
    shows: str
    draw: Callable[[NewFigure], Figure]


@dataclass(frozen=True)
class Results:
    """A results folder: of a campaign or of one experiment."""

    folder: Path

    @cached_property
    def experiments(self) -> dict[str, Path]:
        """Folders of results by experiment; the folder itself where it is one."""
        if (self.folder / Summary.file).exists():
            return {Summary.load(self.folder).experiment or self.folder.name: self.folder}
        return {f.parent.name: f.parent for f in sorted(self.folder.glob(f"*/{Summary.file}"))}

    @cached_property
    def jumps(self) -> list[dict[str, float | str | None]]:
        """Rows of jumps.csv."""
        return table(self.folder / files.JUMPS)

    def having(self, *names: str) -> dict[str, Path]:
        """The experiments whose results hold all these files."""
        return {n: f for n, f in self.experiments.items() if all((f / x).exists() for x in names)}

    def summary(self, name: str) -> Summary:
        """Of an experiment."""
        return Summary.load(self.experiments[name])


def available(folder: Path, recordings: Experiment | None = None) -> dict[str, Offered]:
    """Return the figures of a results folder by name; recordings: the experiment, to draw its motor's log."""
    return {o.name: o for o in _offered(folder, recordings)}


def _offered(folder: Path, recordings: Experiment | None) -> Iterator[Offered]:
    yield from of_results(Results(folder))
    if not (folder / files.JUMPS).exists():  # a campaign's fits.json is another one
        yield from of_apparatus(folder, recordings)


def of_results(r: Results) -> Iterator[Offered]:
    """The figures of experiments and campaigns."""
    if any(j["jump_height_m"] is not None and j["frequency_hz"] is not None for j in r.jumps):
        yield Offered(
            "heights", "jump heights against frequency, measured and simulated", lambda F: heights(r.jumps, F)
        )
    if tracked := r.having(RodMotion.file):
        chosen = of_each_kind(r, tracked)
        yield Offered(
            "tracks",
            "rod height against time beside the simulation, of each kind of jump the highest",
            lambda F: tracks([track(n, r.experiments[n]) for n in chosen], F),
        )
    if (r.folder / Diagnosis.file).exists():
        diagnosis = Diagnosis.load(r.folder)
        yield Offered(
            "diagnosis", "heights, where the model fails, and the gain held out", lambda F: gains(diagnosis, F)
        )
    yield from of_grains(r)
    for name, folder in r.having(Intrusion.file).items():
        yield of_intrusion(name, folder, "" if len(r.experiments) == 1 else f"-{name}")
    if rows := intrusions_of(r):
        yield Offered(
            "resistances",
            "resistances, bend and oscillations against packing; feet beside the cone",
            lambda F: resistances(rows, intrusion_laws(rows), F),
        )
        if in_steps := stepped(rows):
            yield Offered("steps", "force against depth in steps of different lengths", lambda F: steps(in_steps, F))
    craters = [c for c in craters_of(r.having(CraterShape.file)) if c.volume_fraction is not None]
    if len(craters) > 1:
        yield Offered(
            "craters",
            "volume change against packing, and where it is zero",
            lambda F: critical(craters, zero_crossing(craters), F),
        )
    motors = [Driven.of(row) for row in table(r.folder / files.ACTUATOR)]
    if len({m.frequency for m in motors}) > 2:
        what = "amplitude ratio and lag of the actuator"
        yield Offered("actuator", what, lambda F: actuator(motors, actuator_bandwidth(motors), F))


def of_intrusion(name: str, folder: Path, end: str) -> Offered:
    """The figure of one slow intrusion."""
    what = f"force against depth, fit and overshoots: {name}"
    return Offered(f"intrusion{end}", what, lambda F: single(Intrusion.load(folder), F))


def of_grains(r: Results) -> Iterator[Offered]:
    """Figures from grain films: of each experiment that has one, and the momentum of all together."""
    filmed = r.having(Piv.file, Flow.file)
    for name, folder in r.having(Piv.file, Flow.file, Column.file).items():  # in metres, and with a foot
        yield from of_film(name, folder, "" if len(filmed) == 1 else f"-{name}")
    if filmed:
        kinds = {n: str(r.summary(n).kind) for n in filmed}
        yield Offered(
            "grain-momentum",
            "momentum of the grains against time, by kind of jump",
            lambda F: films.momentum([(n, kinds[n], Flow.load(filmed[n]).field) for n in filmed], F),
        )


def of_film(name: str, folder: Path, end: str) -> Iterator[Offered]:
    """The figures of one grain film; end: of their names."""
    fits = fits_of(folder)
    yield Offered(
        f"grain-speed{end}",
        f"downwards speed of the grains over the foot's: {name}",
        lambda F: films.grain_speed(Piv.load(folder).field, Flow.load(folder).field, F),
    )
    yield Offered(
        f"shear-rate{end}",
        f"shear rate with the cone: {name}",
        lambda F: films.shear_rate(Flow.load(folder).field, Column.load(folder).field, F),
    )
    yield Offered(
        f"column{end}",
        f"central column: exponential, beta, jammed front, theta: {name}",
        lambda F: films.column(fits, Column.load(folder), F),
    )
    if fits.determined("cone_slope_kg_m"):
        yield Offered(
            f"added-mass{end}",
            f"added mass against depth and the cone: {name}",
            lambda F: films.added_mass(fits, Column.load(folder), Flow.load(folder), F),
        )


def of_apparatus(folder: Path, recordings: Experiment | None) -> Iterator[Offered]:
    """Figures of what one experiment was made with; its page shows the same."""
    fits = fits_of(folder)
    log, law = (recordings.section(MotorLog), recordings.section(Actuation)) if recordings else (None, None)
    if log and law and fits.determined("actuator_ratio"):
        what = "encoder against command, their difference, work of the motor's force"
        yield Offered("motor", what, lambda F: moved(fits, log, law, F))
    if fits.get("ring_start_s") and (folder / RodMotion.file).exists():
        yield Offered("ring-down", "ring-down and its fit", lambda F: ring_down(fits, RodMotion.load(folder), F))
    if (folder / SpringTest.file).exists():
        what = "force against displacement of the spring, and what its line leaves over"
        yield Offered("spring", what, lambda F: stretched(fits, SpringTest.load(folder), F))
    if (folder / Geometry.file).exists():
        fan = recordings.section(Fan) if recordings else None
        if (found := air_of(Geometry.load(folder), fan)) is not None:
            what = "pressure that the bed needs and the fan gives, against air speed"
            yield Offered("air", what, lambda F: air(found, F))


def of_each_kind(r: Results, tracked: dict[str, Path]) -> list[str]:
    """Of each kind of jump the highest."""
    best: dict[str, tuple[float, str]] = {}
    for name in tracked:
        s = r.summary(name)
        height = s.jump_height.value or 0.0
        best[str(s.kind)] = max(best.get(str(s.kind), (-1.0, "")), (height, name))
    return [name for _, name in (best[k] for k in sorted(best))]


def track(name: str, folder: Path) -> Tracked:
    """The measured and the simulated track of an experiment."""
    made = (folder / Simulation.file).exists()
    return Tracked(name, RodMotion.load(folder), Simulation.load(folder) if made else None)


def intrusions_of(r: Results) -> list[SlowIntrusion]:
    """The slow intrusions of a campaign, by its table."""
    out = []
    for row in table(r.folder / files.INTRUSIONS):
        name = str(row["experiment"])
        if (r.folder / name / Intrusion.file).exists():
            known = (row[k] for k in ("foot_radius_m", "volume_fraction", "sigma_common_volume_fraction"))
            out.append(slow_intrusion(name, r.folder / name, *(None if x is None else float(x) for x in known)))
    return out


def table(file: Path) -> list[dict[str, float | str | None]]:
    """Rows of a CSV file, numbers as floats and empty cells as None; [] where it is not there."""
    if not file.exists():
        return []
    with file.open(newline="", encoding="utf-8") as f:
        return [{k: value(v) for k, v in row.items()} for row in csv.DictReader(f)]


def value(text: str) -> float | str | None:
    """A cell of a table."""
    try:
        return float(text) if text else None
    except ValueError:
        return text


def draw(found: Mapping[str, Offered], out: Path, only: tuple[str, ...], formats: tuple[str, ...]) -> list[Path]:
    """Draw those of the figures that are named (all where none is) into `out`; the files. InputError: unknown names."""
    problems = [f"--format {f}: not one of {', '.join(FORMATS)}" for f in formats if f not in FORMATS]
    problems += [f"--only {n}: not among the figures{closest(n, found)}" for n in only if n not in found]
    if problems:
        raise InputError(problems)
    files = []
    for name in only or found:
        with printed() as Figure:
            figure = lettered(found[name].draw(Figure))
            for f in formats:
                files.append(out / f"{name}.{f}")
                save(figure, files[-1])
    return files
