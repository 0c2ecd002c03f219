"""What an earlier run left of an experiment: its report, its warnings, and the track and vectors that still hold."""

from __future__ import annotations

import warnings
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jumpvision.base.record import Record, RecordError
from jumpvision.base.schema import InputError, WarningRecord
from jumpvision.experiment import files
from jumpvision.experiment.campaign.folder import results_of
from jumpvision.experiment.inputs.experiment import EXPERIMENT, open_experiment
from jumpvision.experiment.inputs.sections import Calibration, RodVideo
from jumpvision.experiment.results.fields import Piv, Statistics
from jumpvision.experiment.results.tables import Simulation, Track
from jumpvision.experiment.stages.recordings import open_film
from jumpvision.experiment.stages.track import BallFilm, Followed
from jumpvision.experiment.workflow.provenance import read_provenance
from jumpvision.experiment.workflow.stage import STAGES, import_all
from jumpvision.experiment.workflow.workspace import Workspace
from jumpvision.films.parameters import TrackParams
from jumpvision.films.vision.ball.track import BallTrack

from .flowing import Asked, MatchedBefore
from .following import Row, balls_of, refuse_other, rows_of, section_of

R = TypeVar("R", bound=Record)
HOLDS, CHANGED = "as the last run left it", "what it rests on has changed since the last run"


@dataclass(frozen=True)
class Earlier:
    """results: the folder; report: whether a page lies there; warnings: of its stages; held: which of track, vectors
    and simulation still are what the experiment on the disk gives; changed: which are not."""

    results: str
    report: bool
    warnings: tuple[WarningRecord, ...]
    held: tuple[str, ...]
    changed: tuple[str, ...]


@dataclass(frozen=True)
class FoundBefore:
    """A track of an earlier run, as `Following` gives one. made: its tracker; by_hand: frames whose
    sigma is that of a hand."""

    tracks: tuple[BallTrack, ...]
    made: BallFilm
    by_hand: frozenset[int]
    notes: tuple[str, ...]
    running: bool = False
    finished: bool = True
    doing: str = ""
    problem: str = ""

    def rows(self, since: int) -> list[Row]:
        """Frames from `since` on."""
        return rows_of(self.tracks[0])[since:]

    def found(self, film: RodVideo, calibration: Calibration | None, p: TrackParams, rate: float) -> Followed:
        """What was followed, on the clock of `film`; see `Following.found`."""
        section = section_of(film, calibration, rate)
        with warnings.catch_warnings(action="ignore"), open_film(section) as frames:
            exposure, (rows, columns) = self.made.exposure(frames), frames.shape
            done = Followed(list(self.tracks), frames.time + exposure / 2, exposure, (rows, columns))
        refuse_other(balls_of(section, calibration, p), self.made, done)
        if section.excluded(len(done.time)) != self.made.film.excluded(len(done.time)):
            raise InputError(["track: the frames that are left out have changed since the run; track the film again"])
        return done

    def refuse_without(self, corrections: Collection[int]) -> None:
        """InputError where a frame that was corrected is so no more: what was found there is not all in the file."""
        if gone := sorted(self.by_hand - set(corrections)):
            said = f"the correction of frame {gone[0]} was removed since the run"
            raise InputError([f"track: {said}; track the film again"])


def places_of(folder: Path, whole: Path) -> tuple[Path, Path]:
    """(results, cache) of the last run of an experiment: with its campaign `whole`, or alone; by the newer one."""
    alone, base = results_of(folder), results_of(whole)
    found = [(alone, alone / ".cache")]
    if whole != folder:
        found.insert(0, (base / folder.resolve().name, base / ".cache"))
    times = [f.stat().st_mtime if (f := r / files.PROVENANCE).exists() else -1.0 for r, _ in found]
    return found[times.index(max(times))]


class Before:
    """The results of an experiment that lie on the disk."""

    def __init__(self, folder: Path, whole: Path):
        self.folder = folder
        self.results, self._cache = places_of(folder, whole)
        self._made = read_provenance(self.results)
        import_all("jumpvision.experiment.stages")

    def record(self, kind: type[R]) -> R | None:
        """The record, where it is there and is what the experiment gives as it lies on the disk."""
        return kind.load(self.results) if self.holds(kind) else None

    def holds(self, kind: type[Record]) -> bool | None:
        """Whether a record of the run still is what the experiment gives; None where there is none."""
        name = STAGES[kind].name
        if name not in self._made.get("made", {}) or not (self.results / kind.file).exists():
            return None
        if not (self.folder / EXPERIMENT).exists():
            return False
        try:
            now = self._workspace().key(kind)
        except (InputError, OSError):
            return False
        return bool(now == self._made["made"][name]["key"])

    def _workspace(self) -> Workspace:
        return Workspace(open_experiment(self.folder), self.results, self._cache)

    def _warnings(self) -> tuple[WarningRecord, ...]:
        """What the stages said of the experiment as it lies on the disk."""
        try:
            return tuple(self._workspace().said()) if self._made else ()
        except (InputError, OSError):
            return ()

    def overview(self) -> Earlier:
        """All of it, for the page."""
        known = {k.file: self.holds(k) for k in (Track, Piv, Simulation)}
        return Earlier(
            results=str(self.results),
            report=(self.results / files.REPORT).exists(),
            warnings=self._warnings(),
            held=tuple(f for f, holds in known.items() if holds),
            changed=tuple(f for f, holds in known.items() if holds is False),
        )

    def track(self, made: BallFilm) -> FoundBefore | None:
        """The track, as it was found: what a hand has corrected is not in it. made: the tracker of the experiment."""
        try:
            found = self.record(Track)
        except (RecordError, OSError, ValueError):
            return None
        if found is None:
            return None
        by_hand = found.table.get("corrected", pd.Series(0, found.table.index)).to_numpy(bool)
        tracks = tuple(ball_of(t) for t in (found.table, *found.others))
        return FoundBefore(
            tracks, made, frozenset(np.flatnonzero(by_hand).tolist()), (f"{self.results / Track.file}, {HOLDS}",)
        )

    def flow(self, asked: Asked) -> MatchedBefore | None:
        """The fields, and their mean where it is there."""
        try:
            piv = self.record(Piv)
            mean = self.record(Statistics) if piv is not None else None
        except (RecordError, OSError, ValueError):
            return None
        return None if piv is None else MatchedBefore(asked, piv, mean, (f"{self.results / Piv.file}, {HOLDS}",))


def ball_of(t: pd.DataFrame) -> BallTrack:
    """A ball as it was found, from the columns of its table."""
    by_hand = t.corrected.to_numpy(bool) if "corrected" in t else np.zeros(len(t), bool)
    x, y = (np.where(by_hand, t.get(f"{c}_found_px", np.nan), t[f"{c}_px"]).astype(float) for c in "xy")
    flag = np.where(by_hand, _words(t, "flag_found"), _words(t, "flag"))
    unknown = np.full(len(t), np.nan)
    return BallTrack(x, y, t.sigma_px.to_numpy(float), unknown, unknown, flag)


def _words(t: pd.DataFrame, name: str) -> NDArray[np.str_]:
    """A column of words, in which a file has nothing for none."""
    column = t[name] if name in t else [""] * len(t)
    return np.array([f if isinstance(f, str) else "" for f in column], dtype=np.str_)
