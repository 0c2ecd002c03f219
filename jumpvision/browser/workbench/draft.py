"""What was clicked and typed on the page, as the experiment.toml and the corrections.csv that it makes.

What is tracked, matched and shown is read back from that text: what is seen is what `jumpvision run` will do.
"""

from __future__ import annotations

import hashlib
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import pandas as pd

from jumpvision.base.parameters import Params
from jumpvision.base.schema import InputError, Section, read
from jumpvision.base.storage import write_aside
from jumpvision.experiment.init.edit import Edits, difference, edited
from jumpvision.experiment.init.measure import Picks, Values, picks_of, tilt_of, with_picks
from jumpvision.experiment.init.recognise import Recording
from jumpvision.experiment.inputs.experiment import EXPERIMENT, merged
from jumpvision.experiment.inputs.parameters import PARAMS
from jumpvision.experiment.inputs.sections import SECTIONS
from jumpvision.films.calibration import CLICKED_MARK

CORRECTIONS = "corrections.csv"
HEAD = "frame,x_px,y_px,sigma_px"
BY_HAND = "set in the workbench"
MOST = 100_000  # corrections


@dataclass(frozen=True)
class Draft:
    """picks: by section; values: keys by section, "params.track" among them; corrections: (x, y) [px] by frame."""

    picks: Mapping[str, Picks] = field(default_factory=dict)
    values: Mapping[str, Mapping[str, object]] = field(default_factory=dict)
    corrections: Mapping[int, tuple[float, float]] = field(default_factory=dict)


def draft_of(table: object) -> Draft:
    """A draft from the page's JSON. InputError with what is wrong."""
    parts = ("picks", "values", "corrections")
    if not isinstance(table, dict) or not all(isinstance(table.get(k, {}), dict) for k in parts):
        raise InputError([f"draft: must be an object with {', '.join(parts)}, each an object"])
    picks, values, given = (table.get(k, {}) for k in parts)
    for what, by_section in (("picks", picks), ("values", values)):
        if bad := [s for s, v in by_section.items() if not isinstance(v, dict)]:
            raise InputError([f"draft: {what} of '{bad[0]}': must be an object"])
    known = {*SECTIONS, *(f"params.{p}" for p in PARAMS)}
    if unknown := [s for s in (*picks, *values) if s not in known]:
        raise InputError([f"draft: '{unknown[0]}': no section of experiment.toml"])
    places = {_frame(k): _place(k, v) for k, v in given.items()}
    if len(places) > MOST:
        raise InputError([f"draft: {len(places)} corrections: at most {MOST}"])
    return Draft({s: whole(picks_of(v)) for s, v in picks.items()}, values, dict(sorted(places.items())))


def whole(picks: Picks) -> Picks:
    """Without what is half set: one end of a ruler, or a ruler whose length is not typed yet, blocks nothing else."""
    sizes = {"ball": 2, "marks": 4, "foot": 2, "roi": 4, "rail": 4}
    half = {k: None for k, n in sizes.items() if (v := getattr(picks, k)) is not None and len(v) < n}
    for k in ("marks", "rail"):
        v = getattr(picks, k)
        if v is not None and len(v) == 4 and v[:2] == v[2:]:
            half[k] = None
    picks = replace(picks, **half)
    return picks if picks.marks and picks.distance else replace(picks, marks=None, distance=None)


def _frame(text: str) -> int:
    if not text.isdecimal() or len(text) > 9:
        raise InputError([f"corrections: frame = '{text}': must be a frame's number"])
    return int(text)


def _place(frame: str, value: object) -> tuple[float, float]:
    numbers = value if isinstance(value, list) and len(value) == 2 else []
    if not numbers or not all(isinstance(v, int | float) and math.isfinite(v) for v in numbers):
        raise InputError([f"corrections: frame {frame} = {value!r}: must be [column, row] in px"])
    return round(float(numbers[0]), 2), round(float(numbers[1]), 2)


@dataclass(frozen=True)
class Composed:
    """An experiment.toml as it would be. base: as it is (or as init drafts it); table: of the new text and of the
    campaign.toml above it; corrections: text of the file, "" for none."""

    folder: Path
    base: str
    text: str
    table: Mapping[str, Any]
    corrections: str

    def section(self, cls: type[Section]) -> Any:
        """The section of this type, or None. InputError for values that are not allowed."""
        table = self.table.get(cls.name)
        if table is None:
            return None
        made, problems = read(cls, table, f"[{cls.name}]")
        if problems:
            raise InputError(problems)
        return replace(made, path=(self.folder / made.file).absolute()) if hasattr(made, "file") else made

    def params(self, cls: type[Params]) -> Any:
        """The parameters of a stage."""
        made, problems = read(cls, self.table.get("params", {}).get(cls.stage, {}), f"[params.{cls.stage}]")
        if problems:
            raise InputError(problems)
        return made

    def check(self) -> None:
        """InputError with all values that are not allowed."""
        problems = []
        for name, cls in SECTIONS.items():
            if name in self.table:
                problems += read(cls, self.table[name], f"[{name}]")[1]
        for name, stage in PARAMS.items():
            problems += read(stage, self.table.get("params", {}).get(name, {}), f"[params.{name}]")[1]
        if problems:
            raise InputError(problems)

    @property
    def difference(self) -> list[str]:
        """Against what is on the disk."""
        old = self.base if (self.folder / EXPERIMENT).exists() else ""
        return difference(old, self.text)

    @property
    def seen(self) -> str:
        """Stands for the files that this was made from; another one means that somebody else wrote them."""
        return fingerprint(self.folder)

    def write(self, seen: str) -> list[str]:
        """Write both files; their names. InputError where one has changed since `seen`."""
        if fingerprint(self.folder) != seen:
            raise InputError(
                [f"{self.folder / EXPERIMENT}: changed on the disk since the difference was shown: look at it again"]
            )
        self.check()
        written = []
        if self.corrections:
            write_aside(self.folder / CORRECTIONS, self.corrections)
            written.append(CORRECTIONS)
        write_aside(self.folder / EXPERIMENT, self.text)
        return [*written, EXPERIMENT]


def composed(
    folder: Path, base: str, inherited: Mapping[str, Any], recordings: Mapping[str, Recording], draft: Draft
) -> Composed:
    """The text that a draft makes of `base`. inherited: tables of campaign.toml."""
    edits, named = dict[str, Values](), tomllib.loads(base)
    for section, picks in draft.picks.items():
        if section not in recordings:
            raise InputError([f"draft: picks in [{section}]: there is no such recording here"])
        _put(edits, _picked(folder, recordings[section], picks))
    for section, values in draft.values.items():
        _put(edits, {section: {k: (v, BY_HAND) for k, v in values.items() if v is not None}})
    if rail := next((p.rail for p in draft.picks.values() if p.rail), None):
        up = draft.values.get("rod_video", {}).get("up") or named.get("rod_video", {}).get("up", "-y")
        if up not in ("-y", "+y", "-x", "+x"):
            raise InputError([f"[rod_video] up = {up!r}: must be -y, +y, -x or +x"])
        _put(edits, {"calibration": {"tilt": (round(tilt_of(rail, str(up)), 5), "two points along the rail")}})
    for section in edits.keys() & recordings.keys() - named.keys():
        edits[section] = {"file": (recordings[section].file, ""), **edits[section]}
    text, file = "", folder / CORRECTIONS
    if draft.corrections or file.exists():
        rows = [f"{i},{x:g},{y:g},{CLICKED_MARK.value:g}" for i, (x, y) in draft.corrections.items()]
        text = "\n".join([HEAD, *rows, ""])
    if draft.corrections:
        _put(edits, {"rod_corrections": {"file": (CORRECTIONS, "frames in which a person said where the ball is")}})
    new = edited(base, {s: v for s, v in edits.items() if v}, str(folder / EXPERIMENT))
    return Composed(folder, base, new, merged(inherited, tomllib.loads(new)), text)


def placed(corrections: Mapping[int, tuple[float, float]]) -> pd.DataFrame:
    """The table of corrections.csv as its text reads back."""
    rows = [(i, float(f"{x:g}"), float(f"{y:g}"), CLICKED_MARK.value) for i, (x, y) in corrections.items()]
    return pd.DataFrame(rows, columns=HEAD.split(",")).astype({"frame": float})


@lru_cache(maxsize=64)  # a click in one field does not search the ball of another again
def _found(folder: Path, section: str, file: str, picks: Picks) -> tuple[Values, Values]:
    recording, track = with_picks(folder, Recording(section, file, ""), picks)
    return dict(recording.values), track


def _picked(folder: Path, recording: Recording, picks: Picks) -> Edits:
    if picks == Picks() or (recording.section == "rod_video" and picks == Picks(rail=picks.rail)):
        return {}
    values, track = _found(folder, recording.section, recording.file, picks)
    if picks.ball is None and picks.ball_diameter is None:
        track = {}  # marks and rail say nothing of the ball
    known = recording.values.get("frame_rate")
    if known and picks.rate and abs(known[0] / picks.rate - 1) > 1e-3:
        values = values | {"clock": ("declared", f"the file's own time stamps say {known[0]:g} Hz")}
    return {recording.section: values, "params.track": track}


def _put(edits: dict[str, Values], more: Edits) -> None:
    for section, values in more.items():
        edits[section] = edits.get(section, {}) | values


def fingerprint(folder: Path) -> str:
    """Of experiment.toml and corrections.csv as they lie on the disk."""
    files = (folder / EXPERIMENT, folder / CORRECTIONS)
    return hashlib.sha256(b"\0".join(f.read_bytes() if f.exists() else b"" for f in files)).hexdigest()
