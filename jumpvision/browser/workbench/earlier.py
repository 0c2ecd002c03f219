"""What an earlier run left of an experiment: its report, its warnings, and the track and vectors that still hold."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from jumpvision.base.record import Record, RecordError
from jumpvision.base.schema import InputError, Told
from jumpvision.experiment import files
from jumpvision.experiment.campaign.folder import results_of
from jumpvision.experiment.inputs.experiment import EXPERIMENT, open_experiment
from jumpvision.experiment.results.fields import Piv, Statistics
from jumpvision.experiment.results.tables import Simulation, Track
from jumpvision.experiment.workflow.provenance import read_provenance
from jumpvision.experiment.workflow.stage import STAGES, import_all
from jumpvision.experiment.workflow.workspace import Workspace

from .flowing import Asked, MatchedBefore
from .following import Row

R = TypeVar("R", bound=Record)
HOLDS, CHANGED = "as the last run left it", "what it rests on has changed since the last run"


@dataclass(frozen=True)
class Earlier:
    """results: the folder; report: whether a page lies there; warnings: of its stages; held: which of track, vectors
    and simulation still are what the experiment on the disk gives; changed: which are not."""

    results: str
    report: bool
    warnings: tuple[Told, ...]
    held: tuple[str, ...]
    changed: tuple[str, ...]


@dataclass(frozen=True)
class FoundBefore:
    """A track of an earlier run, as `Following` gives one."""

    final: list[Row]
    notes: tuple[str, ...]
    running: bool = False
    finished: bool = True
    doing: str = ""
    problem: str = ""

    def rows(self, since: int) -> list[Row]:
        """Frames from `since` on."""
        return self.final[since:]


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

    def _warnings(self) -> tuple[Told, ...]:
        """What the stages said of the experiment as it lies on the disk."""
        try:
            return tuple(self._workspace().said()) if self._made else ()
        except (InputError, OSError):
            return ()

    def seen(self) -> Earlier:
        """All of it, for the page."""
        known = {k.file: self.holds(k) for k in (Track, Piv, Simulation)}
        return Earlier(
            results=str(self.results),
            report=(self.results / files.REPORT).exists(),
            warnings=self._warnings(),
            held=tuple(f for f, holds in known.items() if holds),
            changed=tuple(f for f, holds in known.items() if holds is False),
        )

    def track(self) -> FoundBefore | None:
        """The track, as it was found: what a hand has corrected is not in it."""
        try:
            found = self.record(Track)
        except (RecordError, OSError, ValueError):
            return None
        if found is None:
            return None
        t = found.table
        by_hand = t.corrected.to_numpy(bool) if "corrected" in t else np.zeros(len(t), bool)
        x, y = (np.where(by_hand, t.get(f"{c}_found_px", np.nan), t[f"{c}_px"]) for c in "xy")
        flag = np.where(by_hand, t.get("flag_found", ""), t.flag.astype(object).fillna(""))
        rows: list[Row] = [
            (None, None, None, str(f)) if f and f == f else (float(a), float(b), float(s), "")
            for a, b, s, f in zip(x, y, t.sigma_px, flag)
        ]
        return FoundBefore(rows, (f"{self.results / Track.file}, {HOLDS}",))

    def flow(self, asked: Asked) -> MatchedBefore | None:
        """The fields, and their mean where it is there."""
        try:
            piv = self.record(Piv)
            mean = self.record(Statistics) if piv is not None else None
        except (RecordError, OSError, ValueError):
            return None
        return None if piv is None else MatchedBefore(asked, piv, mean, (f"{self.results / Piv.file}, {HOLDS}",))
