"""What lies on the bench: one experiment's recordings, and what is going on with them."""

from __future__ import annotations

import contextlib
import json
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from jumpvision.base.record import plain
from jumpvision.base.schema import InputError
from jumpvision.base.storage import write_aside
from jumpvision.engine.study.processes import outside
from jumpvision.experiment import files
from jumpvision.experiment.campaign.folder import results_of
from jumpvision.experiment.init.recognise import ANY_RATE, FILMS, KNOWN, Recording, ball, recognised, recordings
from jumpvision.experiment.init.text import PICKED, RESULTS, Choices, drafted
from jumpvision.experiment.inputs.experiment import CAMPAIGN, EXPERIMENT, folder_of
from jumpvision.experiment.inputs.logs import read_log
from jumpvision.experiment.inputs.model import read_toml
from jumpvision.experiment.inputs.sections import (
    SECTIONS,
    Actuation,
    Bed,
    BedImage,
    Calibration,
    CraterImage,
    Robot,
    RodCorrections,
    RodVideo,
)
from jumpvision.experiment.results.tables import Simulation
from jumpvision.experiment.stages.recordings import SCALE_OF_PIXELS
from jumpvision.films.parameters import BedParams, CraterParams, TrackParams

from .adding import Adding
from .draft import CORRECTIONS, HEAD, Composed, Draft, composed, placed
from .earlier import Before, Earlier, FoundBefore
from .films import Shown
from .flowing import Asked, Flowing
from .flowing import Shown as Flow
from .following import Following, Row, balls_of, section_of
from .glance import Row as Glanced
from .glance import glance, small
from .logs import Trace, traces
from .matching import BedLine, CraterLine, bed_line, crater_line
from .own import height
from .plotting import Fitted, Motion
from .running import Running
from .why import Why, why


@dataclass(frozen=True)
class Seen:
    """A film or picture as the page lists it; time [s]: of each frame; timed: whether the file knows it."""

    section: str
    file: str
    facts: str
    rows: int
    columns: int
    time: list[float]
    timed: bool
    notes: tuple[str, ...]


@dataclass(frozen=True)
class State:
    """All that the page begins with. given: tables of experiment.toml (or of its draft) and campaign.toml.
    kept: what the page was when it was left. beside: folder in which a new one may be made; known: suffixes.
    study: MODULE:NAME of a user's own, "" for none."""

    folder: str
    name: str
    experiments: list[str]
    exists: bool
    films: list[Seen]
    given: Mapping[str, Any]
    corrections: dict[int, tuple[float, float]]
    notes: list[str]
    kept: object = None
    beside: str = ""
    known: tuple[str, ...] = KNOWN
    study: str = ""


KEPT = "workbench.json"
LARGER = 640  # px of a frame beside its residual


class Bench:
    """One experiment: a folder, or `only` one film in it. roles: section -> file, over what is guessed. `close` gives
    its films back."""

    def __init__(self, folder: Path, only: str = "", roles: Mapping[str, str] = MappingProxyType({})):
        self.folder, self.only = folder, only
        if only:
            found, self.notes = [recognised(folder, only, next(iter(roles), "rod_video"))], list[str]()
        else:
            found, self.notes = recordings(folder, roles)
        file = folder / EXPERIMENT
        inherited, problems = read_toml(folder.parent / CAMPAIGN) if (folder.parent / CAMPAIGN).exists() else ({}, [])
        own, more = read_toml(file) if file.exists() else ({}, [])
        if problems or more:
            raise InputError(problems + more)
        if not found and not own:
            raise InputError(
                [f"{folder}: no recording that is known: {'; '.join(self.notes) or 'the folder is empty'}"]
            )
        self.inherited = inherited
        shared = bool(inherited)
        self._drafted = "" if file.exists() else drafted(folder, found, self.notes, Choices(), shared=shared)
        by_file = {r.file: r for r in found}
        named = {s: t["file"] for s, t in own.items() if s in SECTIONS and isinstance(t, dict) and "file" in t}
        self.recordings = {r.section: r for r in found} | {
            s: replace(by_file.get(f, Recording(s, f, "")), section=s) for s, f in named.items()
        }
        self.films = {s: Shown(folder / self.recordings[s].file) for s in PICKED if s in self.recordings}
        self.following: Following | None = None
        self.flowing = Flowing()
        self.before: FoundBefore | None = None
        self._motion: tuple[object, Motion] | None = None
        self._kept: object = None
        self._lock = threading.Lock()

    @property
    def base(self) -> str:
        """The experiment.toml as it lies on the disk, else as init would write it."""
        file = self.folder / EXPERIMENT
        return file.read_text(encoding="utf-8-sig") if file.exists() else self._drafted

    def close(self) -> None:
        if self.following:
            self.following.stop()
        self.flowing.stop()
        for film in self.films.values():
            film.close()

    def state(self) -> State:
        """What the page begins with."""
        films = [
            Seen(
                section=s,
                file=self.recordings[s].file,
                facts=self.recordings[s].facts,
                rows=f.film.shape[0],
                columns=f.film.shape[1],
                time=np.round(f.film.time, 7).tolist(),
                timed=f.timed,
                notes=tuple(w.removeprefix(f"{f.path}: ") for w in f.film.warnings),
            )
            for s, f in self.films.items()
        ]
        exists, name = (self.folder / EXPERIMENT).exists(), self.folder.resolve().name
        given = self.composed(Draft()).table
        return State(str(self.folder), name, [], exists, films, given, self.corrections(), self.notes, self.kept())

    def corrections(self) -> dict[int, tuple[float, float]]:
        """Those on the disk. InputError where the file is none of ours: it would be written over."""
        file = self.folder / CORRECTIONS
        if not file.exists():
            return {}
        table = read_log(file, *HEAD.split(","), at_least=0)
        return {int(i): (float(x), float(y)) for i, x, y in zip(table.frame, table.x_px, table.y_px)}

    @property
    def _notes_file(self) -> Path:
        """Where the page is kept: with jumpvision's own results, never beside the recordings."""
        of = (self.folder / self.only).with_suffix("") if self.only else self.folder
        return (results_of(of.parent) / of.name if self.inherited else results_of(of)) / KEPT

    def kept(self) -> object:
        """What the page was when it was left; None where it was nothing."""
        if self._kept is None and self._notes_file.exists():
            try:
                self._kept = json.loads(self._notes_file.read_text(encoding="utf-8"))
            except (ValueError, OSError):  # a power cut: begin anew
                self._kept = None
        return self._kept

    def keep(self, page: object) -> None:
        """Keep the page, in memory and, where something was done on it, on the disk. page: JSON, its own."""
        if not isinstance(page, dict) or not isinstance(page.get("draft"), dict):
            raise InputError(["page: must be an object with a draft"])
        self._kept, draft = page, page["draft"]
        picks, values = ([v for t in draft.get(k, {}).values() for v in t.values()] for k in ("picks", "values"))
        done = any(v is not None for v in (*picks, *values)) or bool(draft.get("corrections"))
        with contextlib.suppress(OSError):  # a folder of others: the memory keeps it until the server ends
            if done:
                self._notes_file.parent.mkdir(parents=True, exist_ok=True)
                write_aside(self._notes_file, json.dumps(page))
            else:
                self._notes_file.unlink(missing_ok=True)

    def composed(self, draft: Draft) -> Composed:
        """The experiment.toml that the draft makes."""
        return composed(self.folder, self.base, self.inherited, self.recordings, draft)

    def write(self, draft: Draft, seen: str) -> list[str]:
        """Write what the draft makes; the files' names."""
        return self.composed(draft).write(seen)

    def as_role(self, section: str, role: str) -> Bench:
        """The bench on which the film of a section is another: a ball on the rod, grains. InputError where a file
        says what it is already."""
        self.film(section)
        if (self.folder / EXPERIMENT).exists():
            raise InputError([f"{self.folder / EXPERIMENT}: says [{section}]; write another section's name there"])
        if role not in FILMS:
            raise InputError([f"role = '{role}': must be {' or '.join(FILMS)}"])
        return Bench(self.folder, self.only, {role: self.recordings[section].file})

    def film(self, section: str) -> Shown:
        """InputError where there is none."""
        if section not in self.films:
            raise InputError([f"[{section}]: no such film here; there are {', '.join(self.films) or 'none'}"])
        return self.films[section]

    def find(self, section: str, frame: int, seed: tuple[float, float] | None) -> dict[str, float | str] | None:
        """The ball in one frame: polarity, x, y, diameter [px]; None where there is none, or several without a seed."""
        found = ball(self.film(section).grey(frame), seed)
        return dict(zip(("polarity", "x", "y", "diameter"), found, strict=True)) if found else None

    def follow(self, draft: Draft) -> None:
        """Begin the track of the draft; one that runs is stopped."""
        made = self.composed(draft)
        film = made.section(RodVideo)
        if film is None:
            raise InputError([f"{self.folder}: no [rod_video] here: nothing to track"])
        calibration, p = made.section(Calibration), made.params(TrackParams)
        with self._lock:
            if self.following:
                self.following.stop()
            self.following = Following(film, calibration, p, self._rate("rod_video"))

    def _rate(self, section: str) -> float:
        time = self.film(section).film.time
        return 1.0 / float(np.median(np.diff(time))) if len(time) > 1 else ANY_RATE

    def followed(self, since: int) -> tuple[list[Row], Following | FoundBefore | None]:
        """Rows from frame `since` on, and the run that they are of."""
        run = self.following or self.before
        return (run.rows(since), run) if run else ([], None)

    def candidates(self, frame: int) -> list[tuple[float, float, float, float]]:
        """What may be the ball in a frame of the film that was followed on this bench."""
        return self.following.candidates(frame) if self.following else []

    def motion(self, draft: Draft, body: int = 1) -> Motion:
        """A body that was followed, measured with the values of the draft."""
        made, run = self.composed(draft), self.following or self.before
        film = made.section(RodVideo)
        if film is None or run is None:
            raise InputError(["track: none yet; track the film first"])
        calibration, p, rate = made.section(Calibration), made.params(TrackParams), self._rate("rod_video")
        key = (
            json.dumps(plain(made.table), sort_keys=True, default=str),
            made.corrections,
            id(run),
            len(run.rows(0)),
            body,
        )
        if self._motion is None or self._motion[0] != key:
            if isinstance(run, FoundBefore):
                run.refuse_without(draft.corrections)
            found = run.found(film, calibration, p, rate)
            read = section_of(film, calibration, rate)
            if read.scale == SCALE_OF_PIXELS:
                p = replace(p, exposure_correction="none")
            by_hand = {i: c for i, c in draft.corrections.items() if i < len(found.time)}
            given = placed(by_hand) if RodCorrections.name in made.table else None
            robot, actuation = made.section(Robot), made.section(Actuation)
            self._motion = key, Motion(found, read, calibration, actuation, given, robot, p, body)
        return self._motion[1]

    def flow(self, draft: Draft, frame: int, name: str, mean: bool) -> Flow:
        """The flow of the pair that holds a frame of the grain film, or of all pairs."""
        return self.flowing.shown(self.composed(draft), self._own_rate("grain_video"), frame, name, mean)

    def all_pairs(self, draft: Draft) -> None:
        """Begin to match all pairs of the grain film."""
        self.flowing.all_pairs(self.composed(draft), self._own_rate("grain_video"))

    def earlier(self, whole: Path) -> Before:
        """What a run of it, alone or with its campaign, left; the track and vectors that still hold are taken."""
        found = Before(self.folder, whole)
        if not self.following and "rod_video" in self.films:
            made = self.composed(Draft())
            film, calibration = made.section(RodVideo), made.section(Calibration)
            section = section_of(film, calibration, self._rate("rod_video"))
            self.before = found.track(balls_of(section, calibration, made.params(TrackParams)))
        if "grain_video" in self.films and not (self.flowing.batch and self.flowing.batch.running):
            asked = Asked.of(self.composed(Draft()), self._own_rate("grain_video"))
            self.flowing.batch = found.flow(asked) or self.flowing.batch
        return found

    def lit(self, draft: Draft, frame: int, width: int) -> dict[str, Any]:
        """A frame of the grain film as it is matched."""
        return self.flowing.lit(self.composed(draft), self._own_rate("grain_video"), frame, width)

    def _own_rate(self, section: str) -> float | None:
        return self._rate(section) if self.film(section).timed else None

    def bed(self, draft: Draft, frame: int) -> BedLine:
        """The bed's surface in one picture."""
        made = self.composed(draft)
        image = made.section(BedImage)
        if image is None:
            raise InputError([f"{self.folder}: no [bed_image] here: no surface to find"])
        sections = made.section(Bed), made.section(Calibration)
        return bed_line(image, *sections, made.params(BedParams), self.film("bed_image").grey(frame))

    def crater(self, draft: Draft, frame: int) -> CraterLine:
        """The laser line over a crater in one picture."""
        made = self.composed(draft)
        image = made.section(CraterImage)
        if image is None:
            raise InputError([f"{self.folder}: no [crater_image] here: no line to find"])
        return crater_line(
            image, made.section(Calibration), made.params(CraterParams), self.film("crater_image").grey(frame)
        )

    def logs(self, draft: Draft) -> Sequence[Trace]:
        """The logs under the film."""
        return traces(self.composed(draft))


class Benches:
    """The benches of what `open` was given, one at a time, and the run of all of it. study: MODULE:NAME."""

    def __init__(self, path: Path, study: str = ""):
        path = folder_of(path)
        if study:
            outside(study, path if path.is_dir() else path.parent)
        self.study = study
        self._own: tuple[Motion, Fitted] | None = None
        if not path.exists():
            raise InputError([f"{path}: does not exist; give a film, an experiment's folder or a folder of those"])
        self.only = "" if path.is_dir() else path.name
        folder = path if path.is_dir() else path.parent
        below = [] if self.only else [f for f in sorted(folder.iterdir()) if _holds_recordings(f)]
        own = bool(self.only) or (folder / EXPERIMENT).exists() or bool(recordings(folder, {})[0])
        self._campaign = None if own or not below else folder
        self.folders = {f.resolve().name: f for f in ([folder] if own or not below else below)}
        if own and (folder.parent / CAMPAIGN).exists():
            self._campaign = folder.parent
            self.folders = {f.name: f for f in sorted(folder.parent.iterdir()) if _holds_recordings(f)}
        first = Bench(folder if own or not below else below[0], self.only)
        if not own:  # of a campaign the first with a film, as there is more to do
            first = next((b for b in map(Bench, below) if b.films), first) if not first.films else first
        self.bench, self.running = first, None  # type: Bench, Running | None
        self._given, self.adding = folder, None  # type: Path, Adding | None
        self._tracks = dict[Path, Following]()  # of experiments that lay on the bench
        self._lock = threading.Lock()

    @property
    def whole(self) -> Path:
        """What is run and reported: the campaign, or what lies on the bench."""
        return self._campaign or self.bench.folder

    @property
    def beside(self) -> Path:
        """Where a new folder goes: beside the film, or beside the experiment."""
        return self.bench.folder if self.bench.only else self._campaign or self.bench.folder.resolve().parent

    def state(self) -> State:
        there = replace(self.bench.state(), experiments=list(self.folders), beside=str(self.beside))
        return replace(there, study=self.study)

    def add(self, name: str, files: Mapping[str, int]) -> None:
        """Begin a new folder for files (name -> bytes); one that was left half-way is taken away."""
        with self._lock:
            if self.adding and self.adding.writing:
                raise InputError(["files: others are being copied; wait for their end"])
            self.stop_adding()
            if name in self.folders:
                raise InputError([f"folder = '{name}': an experiment of this name is open; give another name"])
            self.adding = Adding(self.beside, name, files)

    def stop_adding(self) -> str:
        """Take away a folder that is not whole; why it is not."""
        adding, self.adding = self.adding, None
        if adding:
            adding.stop()
        return adding.problem if adding else ""

    def added(self) -> None:
        """Open the folder that is whole now."""
        if self.adding is None:
            raise InputError(["files: none were added"])
        folder, self.adding = self.adding.done(), None
        self._take(Bench(folder))
        self.folders[folder.name] = folder

    def change(self, name: str) -> None:
        """Take another experiment onto the bench."""
        folder = self._folder(name)
        bench = Bench(folder, self.only if folder == self._given else "")
        bench.following = self._tracks.get(folder)
        self._take(bench)

    def as_role(self, section: str, role: str) -> None:
        """Take a film for another kind."""
        self._take(self.bench.as_role(section, role))

    def _take(self, bench: Bench) -> None:
        with self._lock:
            old, self.bench = self.bench, bench
            old.close()
            if old.following:
                self._tracks[old.folder] = old.following

    def run(self) -> None:
        """`jumpvision run` on all of it."""
        with self._lock:
            if self.running and self.running.running:
                raise InputError(["run: already running; stop it first"])
            self.running = Running(self.whole)

    def earlier(self) -> Earlier:
        """What the last run left of what lies on the bench."""
        return self.bench.earlier(self.whole).overview()

    def simulated(self, draft: Draft) -> Fitted:
        """The jump that the last run simulated, beside the one that is followed."""
        there = Before(self.bench.folder, self.whole).record(Simulation)
        if there is None:
            raise InputError(["simulation.csv: none that still holds; write and run the experiment first"])
        t, rod = there.table.time_s.to_numpy(float), there.table.rod_m.to_numpy(float)
        motion = self.bench.motion(draft)
        up = np.interp(motion.time, t, rod - rod[0], left=np.nan, right=np.nan)
        return motion.beside(up, "height of the rod in simulation.csv")

    def studied(self, draft: Draft) -> Fitted:
        """The ball as the user's own study simulates it, beside the one that is followed."""
        if not self.study:
            raise InputError(["study: none; jumpvision open PATH --simulator MODULE:NAME"])
        motion = self.bench.motion(draft)
        if self._own is None or self._own[0] is not motion:  # of this track with these values: made once
            up = height(self.study, self.bench.composed(draft), motion.time, motion.height)
            self._own = motion, motion.beside(up, f"height by {self.study}")
        return self._own[1]

    def glance(self) -> list[Glanced]:
        """All experiments in a row each."""
        return glance(self.folders, self.whole)

    def why(self, name: str) -> Why:
        """What its results say of one of the experiments."""
        return why(name, self._folder(name), self.whole)

    def small(self, name: str, frame: int | None = None) -> bytes:
        """A small picture of an experiment's film; larger of a frame."""
        return small(self._folder(name)) if frame is None else small(self._folder(name), frame, LARGER)

    def _folder(self, name: str) -> Path:
        if name not in self.folders:
            raise InputError([f"experiment = '{name}': must be one of {', '.join(self.folders)}"])
        return self.folders[name]

    def report(self, name: str = "") -> bytes:
        """The page of the last run: of the whole, or of an experiment of it. InputError where there is none."""
        if name:
            self._folder(name)
        if name or self.whole == self.bench.folder:
            file = Before(self.folders.get(name, self.bench.folder), self.whole).results / files.REPORT
        else:
            file = results_of(self.whole) / files.REPORT
        if not file.exists():
            raise InputError([f"{file}: no such page yet; run it first"])
        return file.read_bytes()

    def close(self) -> None:
        self.stop_adding()
        if self.running:
            self.running.stop()
        self.bench.close()


def _holds_recordings(folder: Path) -> bool:
    if not folder.is_dir() or folder.name.startswith(".") or folder.name == RESULTS:
        return False
    return (folder / EXPERIMENT).exists() or bool(recordings(folder, {})[0])
