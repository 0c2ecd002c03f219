"""Before a run: what would stop it, and what can be right only by an odd chance (units, clocks, marks, names).

What is impossible is a problem, worded as the run would word it; what is suspicious is a warning with the number and
the likely remedy. Nothing is computed that takes longer than reading the logs and opening the films.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import TypeVar, cast

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.record import Record
from jumpvision.base.schema import InputError, StageWarning, WarningRecord, read, warnings_in
from jumpvision.estimate.flight import contact_flights
from jumpvision.experiment.inputs.experiment import Experiment
from jumpvision.experiment.inputs.logs import read_log
from jumpvision.experiment.inputs.sections import (
    PHASES,
    Actuation,
    Bed,
    BedImage,
    Calibration,
    ContactLog,
    CraterImage,
    GrainVideo,
    IntrusionLog,
    MotorLog,
    NotApplicable,
    PivField,
    Robot,
    RodVideo,
    SpringLog,
)
from jumpvision.experiment.results.tables import RodMotion, Track
from jumpvision.experiment.results.values import BedHeight, CraterShape
from jumpvision.experiment.workflow.stage import STAGES, results_stages
from jumpvision.experiment.workflow.workspace import Workspace
from jumpvision.films.frames import Film
from jumpvision.films.frames.decoding import open_video, pixel_aspect, square_shape
from jumpvision.films.frames.opening import READERS

from .compare import Value, contradictions, is_prefix
from .crosschecks import cross_checks, motion_of, resting, ringing, softness, stances, swing_of
from .falling import falling, falls_otherwise, flown
from .fit import contact_of
from .grains.vectors import foreign_field
from .modelled import modelled
from .pushes import pushes
from .recordings import in_pixels, open_film, open_pictures
from .rod import motor_in, total_mass
from .spring import read_spring
from .track import in_px_alone

LONGEST = 5.0  # m, of what a film or a log of a jump shows

Read = TypeVar("Read")
R = TypeVar("R", bound=Record)


@dataclass(frozen=True)
class Picture:
    """What the head of a film says. shape: rows, columns; begin, end [s] on the common clock, None where unknown."""

    shape: tuple[int, int]
    begin: float | None
    end: float | None


@dataclass
class Found:
    """What is wrong with an experiment, and what is odd."""

    problems: list[str]
    warned: list[WarningRecord]
    films: dict[str, Picture]
    made: dict[type, Record | None] = field(default_factory=dict)
    motor: tuple[Array, Array] | None = None  # time [s], position [m]
    contact: tuple[Array, Array] | None = None  # time [s], 0 or 1
    deepest: float = 0.0  # m, of an intrusion

    @property
    def rod(self) -> RodMotion | None:
        """How the rod moved."""
        return cast(RodMotion | None, self.made.get(RodMotion))

    @property
    def name(self) -> str:
        """The section that says so."""
        return "rod_video" if "rod_video" in self.films else "rod_track"

    def ask(self, read: Callable[[], Read]) -> Read | None:
        """What `read` gives; None where it finds a problem."""
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                got = read()
        except NotApplicable:
            return None
        except InputError as e:
            self.problems += [p for p in e.problems if p not in self.problems]
        except (ValueError, OSError) as e:
            self.problems.append(str(e))
        else:
            self.warned += warnings_in(caught)
            return got
        return None


def preflight(e: Experiment) -> tuple[list[str], list[WarningRecord]]:
    """(what would stop a run, what is suspicious) of one experiment, before it is run."""
    found = Found([], [], {})
    results_stages()  # all of them are registered
    for output in READ:
        found.made[output] = found.ask(partial(made_now, e, output))
    if (field := e.section(PivField)) is not None:
        found.ask(partial(foreign_field, field, e.section(Robot)))
    warned = suspicious(e, found)
    toml = e.path / "experiment.toml"
    problems = [p if str(e.path) in p else f"{toml}: {p}" for p in found.problems]
    return problems, warned


def suspicious(e: Experiment, found: Found) -> list[WarningRecord]:
    """What is suspicious; in `found` the records that are there, what would stop a run is added to it."""
    _sections(e, found)
    _films(e, found)
    _logs(e, found)
    said = [
        *_sizes(e, found),
        *_depths(e, found),
        *_clocks(e, found),
        *_places(e, found),
        *_names(e),
        *_doubts(e, found),
    ]
    warned = [*found.warned, *(d.record for d in said)]
    return [t for i, t in enumerate(warned) if t not in warned[:i]]


READ = (RodMotion, BedHeight, CraterShape)  # records that doubts are about


def made_now(e: Experiment, output: type[R]) -> R | None:
    """A record, computed and kept nowhere; None where it cannot be made, or takes a film of the rod."""
    made = STAGES[output]
    if output is Track:
        return None
    given: dict[str, object] = {}
    for i in made.inputs:
        given[i.name] = e if i.type is Experiment else made_now(e, i.type) if i.type in STAGES else e.section(i.type)
        if given[i.name] is None and not i.optional:
            return None
    if made.any_of and all(given[name] is None for name in made.any_of):
        return None
    if made.params:
        given["p"] = read(made.params, e.params.get(made.name, {}), "")[0]
    return cast(R, made.called_with(given))


def _sections(e: Experiment, found: Found) -> None:
    """Keys that the stages of a run need, by their own lists, and a film that will give no heights."""
    workspace = Workspace(e, e.path, e.path)
    for made in results_stages():
        if not workspace.missing(made.output):
            given = {i.name: e if i.type is Experiment else e.sections.get(_name_of(i.type)) for i in made.inputs}
            found.problems += [p for p in made.lacks(given) if p not in found.problems]
    calibration, film = e.section(Calibration), e.section(RodVideo)
    if film is not None and in_pixels(film, calibration) and in_px_alone(e.section(Actuation)):
        said = "[rod_video] scale: missing: the track will be in px alone; give scale (metres per pixel) for heights"
        found.warned.append(StageWarning("missing", said, film.name).record)


def _name_of(kind: type) -> str:
    """Of a section; "" for a record."""
    return getattr(kind, "name", "")


OPENED = {RodVideo: open_film, GrainVideo: open_film, BedImage: open_pictures, CraterImage: open_pictures}


def _films(e: Experiment, found: Found) -> None:
    """Films and pictures, opened as a run opens them; of a long film in a container the head alone."""
    for kind, opened in OPENED.items():
        if (section := e.section(kind)) is not None:
            seen = found.ask(partial(_head, section, opened))
            if seen is not None:
                found.films[section.name] = seen


def _head(section: RodVideo | GrainVideo | BedImage | CraterImage, opened: Callable[..., Film]) -> Picture:
    path = section.path
    container = READERS.get(path.suffix.lower(), ("", ""))[0] == "video"
    # a smaller film [bytes] in a container is decoded here, as a run does to count its frames
    if container and path.is_file() and path.stat().st_size > 50e6:
        film, stream = open_video(path, "SLICE")
        with film:
            shape = stream.codec_context.height, stream.codec_context.width
            return Picture(square_shape(shape, pixel_aspect(stream)), None, None)
    with opened(section) as frames:
        return Picture(frames.shape, float(frames.time[0]), float(frames.time[-1]))


def _logs(e: Experiment, found: Found) -> None:
    """Every log, read as its stage reads it."""
    law = e.section(Actuation)
    if (log := e.section(MotorLog)) is not None:
        logged = found.ask(lambda: read_log(log, "time_s", "position_m", optional=("force_N",), at_least=8))
        found.motor = None if logged is None else motor_in(logged, law)
    if (touched := e.section(ContactLog)) is not None:
        found.contact = found.ask(lambda: contact_of(touched))
    if (pushed := e.section(IntrusionLog)) is not None:
        d = found.ask(lambda: read_log(pushed, "time_s", "depth_m", "force_N"))
        found.deepest = 0.0 if d is None else float(np.ptp(d.depth_m))
    if (spring := e.section(SpringLog)) is not None:
        found.ask(lambda: read_spring(spring))


def _doubts(e: Experiment, found: Found) -> Iterator[StageWarning]:
    """Where recordings contradict each other."""
    robot, law, log, rod = e.section(Robot), e.section(Actuation), e.section(MotorLog), found.rod
    motion = None
    if rod is not None and (log is None or found.motor is not None):
        motion = found.ask(lambda: motion_of(*rod.arrays, robot, law, log))
    hard = e.ground == "hard"
    confirmed, doubted = False, list[StageWarning]()
    if rod is not None and motion is not None:
        confirmed, doubted = modelled(found.name, e, rod, cast(BedHeight | None, found.made.get(BedHeight)))
    soft, swing = softness(motion, robot, hard=hard), swing_of(robot, hard=hard) if hard else 0.0  # sand damps it
    yield from cross_checks(found.name, motion, found.contact, law, found.motor, soft, swing, confirmed)
    said = None
    if found.contact is not None:
        said = found.ask(lambda: contact_flights(*found.contact, debounce=0.005) if found.contact else None)
        turned = list(resting(*found.contact, law))
        yield from turned
        if hard and robot is not None and said is not None and not turned:
            yield from stances(said, robot, law)
    if motion is None or rod is None or robot is None or confirmed:
        return
    stop = law.stop if law is not None and law.moves else -math.inf
    falls = False
    if said is not None and not doubted:
        falls, doubted = flown(motion, said, robot, found.name, stop)
    yield from doubted
    if not (falls or doubted):  # a few flights that the track alone shows say less
        doubted = [*falling(motion, robot, found.name, after=stop, hard=hard)]
        yield from doubted or falls_otherwise(motion, found.name, stop)
    if law is not None:
        yield from ringing(found.name, motion, rod.arrays[1], robot, law, hard=hard)
        yield from pushes(found.name, *rod.arrays[:2], robot, law, log if found.motor is not None else None)


def _sizes(e: Experiment, found: Found) -> Iterator[StageWarning]:
    """Units: masses, spring, log, track and ball beside what they can be."""
    robot, law = e.section(Robot), e.section(Actuation)
    if robot is not None:
        yield from _robot(robot)
    moved = [] if found.rod is None else [(found.name, "height_m", found.rod.arrays[1])]
    if found.motor is not None and not (law is not None and law.moves and law.amplitude):
        moved.append(("motor_log", "position_m", found.motor[1]))
    for name, column, x in moved:
        if (rise := float(np.ptp(x))) > LONGEST:
            said = f"[{name}] {column} moves by {rise:.3g} m: in mm? then divide by 1000"
            yield StageWarning("unit", said, name, {"moved_m": rise})
    film, v = found.films.get("rod_video"), e.section(RodVideo)
    if film is not None and v is not None and v.scale and v.ball_diameter:
        across = v.ball_diameter / v.scale
        if not 3.0 <= across <= min(film.shape):
            said = (
                f"[rod_video] ball_diameter = {v.ball_diameter:g} m is {across:.3g} px at scale = {v.scale:g} m/px, in "
                f"a picture of {film.shape[1]} x {film.shape[0]} px: is one of them in mm?"
            )
            yield StageWarning("unit", said, "rod_video", {"diameter_px": across})


def _robot(robot: Robot) -> Iterator[StageWarning]:
    """Robots that jump on a rail weigh less than 100 kg, and no spring gives 0.25 m under a robot's weight."""
    heavy = [n for n in ("motor_mass", "rod_mass", "foot_mass") if (getattr(robot, n) or 0.0) > 100.0]
    for name in heavy:
        value = getattr(robot, name)
        said = f"[robot] {name} = {value:g} kg: more than a jumping robot weighs; in grams? then give {value / 1e3:g}"
        yield StageWarning("unit", said, "robot", {f"{name}_kg": value})
    k, mass = robot.spring_stiffness, total_mass(robot)
    if k and mass and not heavy and (sag := mass * robot.gravity / k) > 0.25:
        said = (
            f"[robot] spring_stiffness = {k:g} N/m: the robot's weight would press it by {sag:.3g} m; in N/mm? then "
            f"give {1e3 * k:g}"
        )
        yield StageWarning("unit", said, "robot", {"sag_m": sag})


def _depths(e: Experiment, found: Found) -> Iterator[StageWarning]:
    """Nothing goes deeper into a bed than to its floor."""
    bed, height = e.section(Bed), cast(BedHeight | None, found.made.get(BedHeight))
    crater = cast(CraterShape | None, found.made.get(CraterShape))
    depth = height.values["height_m"] if height is not None else _filled(bed)
    if not depth:
        return
    crater_depth = 0.0 if crater is None else abs(crater.values["depth_m"])
    name = "crater_depth" if "crater_depth" in e.sections else "crater_image"
    for section, deep in ((name, crater_depth), ("intrusion_log", found.deepest)):
        if deep > depth:
            unit = is_prefix(deep / depth) or deep > LONGEST
            said = (
                f"[{section}] goes {deep:.3g} m deep, into a bed of {depth:.3g} m: "
                f"{'in mm?' if unit else 'scale, or [bed] solid_volume, length and width?'}"
            )
            yield StageWarning("unit" if unit else "differs", said, section, {"deep_m": deep, "bed_m": depth})
    seen = height.values["height_m"] if height is not None else None
    yield from contradictions(
        [
            Value("height of the bed", "[bed_image]", seen, recording="bed_image"),
            Value("height of the bed", "[bed]", _filled(bed) or None),
        ]
    )


def _filled(bed: Bed | None) -> float:
    """Height [m] of a bed by its grains and area; 0 where that is not known."""
    if bed is None or not (bed.solid_volume and bed.volume_fraction and bed.length and bed.width):
        return 0.0
    return bed.solid_volume / (bed.volume_fraction * bed.length * bed.width)


def _clocks(e: Experiment, found: Found) -> Iterator[StageWarning]:
    """Recordings that do not meet in time."""
    law, spans = e.section(Actuation), {}
    for name in ("rod_video", "grain_video"):
        if (film := found.films.get(name)) is not None and film.begin is not None and film.end is not None:
            spans[name] = film.begin, film.end
    track = None if found.rod is None else found.rod.arrays
    for name, log in (("motor_log", found.motor), ("contact_log", found.contact), (found.name, track)):
        if log is not None and name not in spans:
            spans[name] = float(log[0][0]), float(log[0][-1])
    if law is not None and not (law.moves and law.frequency is not None):
        law = None
    if law is not None:
        spans["actuation"] = law.start, law.stop
    watched = next((n for n in ("rod_video", "rod_track", "grain_video", "motor_log") if n in spans), None)
    for name, (begin, end) in spans.items():
        if watched is None or name == watched:
            continue
        first, last = spans[watched]
        lasts = f"[{name}] lasts from {begin:.4g} to {end:.4g} s, [{watched}] from {first:.4g} to {last:.4g} s"
        if end < first or begin > last:
            said = f"{lasts}: they never meet; give start (s on the common clock), and times in seconds"
            yield StageWarning("clock", said, name, {"begin_s": begin, "end_s": end})
        elif name.endswith("_log") and last > first and is_prefix((end - begin) / (last - first)):
            said = f"{lasts}: {(end - begin) / (last - first):.3g} times as long; are its times in ms?"
            yield StageWarning("unit", said, name, {"lasts_s": end - begin, f"{watched}_s": last - first})
    if law is not None and found.motor is not None:
        yield from _onset(found.motor, law)


def _onset(motor: tuple[Array, Array], law: Actuation) -> Iterator[StageWarning]:
    """When the log says that the motor starts, beside [actuation]."""
    t, x = motor
    rest = np.median(x[: max(x.size // 50, 3)])
    away = np.abs(x - rest) > 0.2 * np.ptp(x)
    if not away.any() or not t[0] < law.start < t[-1] or not law.frequency:
        return
    begins, allowed = float(t[np.argmax(away)]), 0.5 / law.frequency
    if abs(begins - law.start) > allowed:
        in_ms = law.start > 0.0 and is_prefix(begins / law.start)
        remedy = "are its times in ms?" if in_ms else "is it on the common clock?"
        said = (
            f"[motor_log] moves from about {begins:.4g} s on, [actuation] start = {law.start:g} s: "
            f"{begins - law.start:+.3g} s apart; {remedy}"
        )
        yield StageWarning("clock", said, "motor_log", {"logged_s": begins, "start_s": law.start})


def _places(e: Experiment, found: Found) -> Iterator[StageWarning]:
    """Marks, feet and floors outside the picture that they are given in."""
    calibration = e.section(Calibration) or Calibration()
    for name, film in found.films.items():
        rows, columns = film.shape
        section = e.sections[name]
        places: list[tuple[str, float, float]] = []
        for k, mark in enumerate(calibration.marks, 1):
            places.append((f"[calibration] marks: mark {k}", mark[0], mark[1]))
        if doubt := calibration.centred(name, film.shape):
            yield StageWarning("place", doubt, name)
        if (moved := _by_lens(calibration, film.shape)) > 0.2:  # of a corner's distance: no lens bends so far
            said = (
                f"[calibration] the lens would move a corner of [{name}] by {moved:.0%} of its distance from centre = "
                f"{list(calibration.centre)}: check centre (column, row), k1 and k2"
            )
            yield StageWarning("place", said, name, {"share": moved})
        for key in ("foot_row", "floor_row"):
            if (row := getattr(section, key, None)) is not None:
                places.append((f"[{name}] {key}", 0.0, row))
        if (column := getattr(section, "axis_column", None)) is not None:
            places.append((f"[{name}] axis_column", column, 0.0))
        for what, x, y in places:
            if not (-1.0 <= x <= columns and -1.0 <= y <= rows):
                turned = -1.0 <= x <= rows and -1.0 <= y <= columns and section.path.suffix.lower() in (".h5", ".hdf5")
                if turned and not section.axes:
                    found.problems.append(
                        f"{section.path}: {what} = {x:g}, {y:g} (column, row) lies outside [{name}] of {columns} x "
                        f'{rows} px: give axes = "frame,column,row" (MATLAB\'s h5write), or correct it'
                    )
                    continue
                said = (
                    f"{what} = {x:g}, {y:g} (column, row) lies outside [{name}] of {columns} x {rows} px: "
                    "of another camera, or column and row exchanged?"
                )
                yield StageWarning("place", said, name, {"column_px": x, "row_px": y})


def _by_lens(calibration: Calibration, shape: tuple[int, int]) -> float:
    """Greatest share by which the lens moves a corner of a picture (rows, columns)."""
    column, row = calibration.centre or ((shape[1] - 1) / 2, (shape[0] - 1) / 2)
    x, y = np.array([0, shape[1] - 1]) - column, np.array([[0], [shape[0] - 1]]) - row
    r2 = x**2 + y**2
    return float(np.abs(calibration.k1 * r2 + calibration.k2 * r2**2).max())


def _names(e: Experiment) -> Iterator[StageWarning]:
    """A folder that is named after another jump."""
    law = e.section(Actuation)
    if law is None:
        return
    name = e.name.lower().replace("-", "_").replace(" ", "_")
    doubt = f"but the experiment is called {e.name}: is it the right one?"
    kind = next((k for k in ("delayed_stutter", "stutter", "single") if k in name), None)
    if kind is not None and law.kind in PHASES and law.kind != kind:
        yield StageWarning("name", f'[actuation] kind = "{law.kind}", {doubt}', "actuation")
    found = re.search(r"(?<![0-9.])(\d+(?:\.\d+)?)_?hz", name)
    if found and law.frequency:
        rounding = 0.51 * 10.0 ** -len(found[1].partition(".")[2])
        if abs(float(found[1]) - law.frequency) > rounding:
            said = f"[actuation] frequency = {law.frequency:g} Hz, {doubt}"
            yield StageWarning("name", said, "actuation", {"frequency_hz": law.frequency})
