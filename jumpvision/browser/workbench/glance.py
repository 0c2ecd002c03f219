"""A campaign at a glance: of each experiment a picture, its height, what the model misses, why it stands out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np

from jumpvision.base.record import Record, RecordError
from jumpvision.base.schema import InputError
from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.experiment.campaign.folder import results_of
from jumpvision.experiment.campaign.odd import by_model
from jumpvision.experiment.init.recognise import opened, recordings
from jumpvision.experiment.init.text import PICKED
from jumpvision.experiment.inputs.experiment import EXPERIMENT
from jumpvision.experiment.inputs.model import read_toml
from jumpvision.experiment.results.summary import UNKNOWN, Summary
from jumpvision.experiment.results.tables import RodMotion
from jumpvision.films.frames import FrameError

from .earlier import places_of
from .films import stretched
from .logs import thinned

R = TypeVar("R", bound=Record)
WIDE = 200  # px of a small picture
POINTS = 160  # of a small line


@dataclass(frozen=True)
class Row:
    """An experiment; lengths in m, None where not known. missed: the extended model, else the model, less measured.
    trace: times [s] and heights [m] of the rod; odd: why it stands out, "" where it does not."""

    experiment: str
    kind: str | None
    height: float | None
    sigma: float | None
    missed: float | None
    warnings: int
    odd: str
    pictured: bool
    trace: tuple[list[float], list[float]]


def glance(folders: dict[str, Path], whole: Path) -> list[Row]:
    """Of every experiment, from the results that lie there; those that stand out come first."""
    base = results_of(whole)
    diagnosis = loaded(Diagnosis, base)
    apart = dict[str, list[str]]()
    for name, text in by_model(diagnosis) if diagnosis else ():
        apart.setdefault(name, []).append(text)
    extended = {h.experiment: h.extended_m - h.measured_m for h in diagnosis.heights} if diagnosis else {}
    places = {n: places_of(f, whole)[0] for n, f in folders.items()}
    summaries = {n: loaded(Summary, r) or UNKNOWN for n, r in places.items()}
    measured = any(s.jump_height.value is not None for s in summaries.values())
    rows = []
    for name, folder in folders.items():
        s = summaries[name]
        height, sigma, _ = s.jump_height
        missed = s.simulated_height - height if s.simulated_height is not None and height is not None else None
        if np.isfinite(extended.get(name, np.nan)):
            missed = float(extended[name])
        why = apart.get(name, [])
        if measured and height is None:
            why = ["no height", *why]
        if n := len(s.warnings):
            why = [*why, f"{n} warning{'s' * (n > 1)}"]
        film = film_of(folder)
        rows.append(Row(name, s.kind, height, sigma, missed, n, "; ".join(why), film is not None, trace(places[name])))
    return sorted(rows, key=lambda r: not r.odd)


def loaded(kind: type[R], folder: Path) -> R | None:
    """The record in a folder, None where it is not there or cannot be read."""
    try:
        return kind.load(folder)
    except (OSError, RecordError, ValueError, KeyError, TypeError):
        return None


def trace(results: Path) -> tuple[list[float], list[float]]:
    """The rod's height over time, as few points as a small picture shows."""
    motion = loaded(RodMotion, results)
    if motion is None:
        return [], []
    t, y = (motion.table[c].to_numpy(float) for c in ("time_s", "height_m"))
    good = np.isfinite(t) & np.isfinite(y)
    t, y = thinned(t[good], y[good], POINTS)
    return t.tolist(), y.tolist()


def film_of(folder: Path) -> Path | None:
    """The first film or picture of an experiment."""
    table = read_toml(folder / EXPERIMENT)[0] if (folder / EXPERIMENT).exists() else {}
    named = [table[s]["file"] for s in PICKED if isinstance(table.get(s), dict) and "file" in table[s]]
    if not named and not table:
        named = [r.file for r in recordings(folder, {})[0] if r.section in PICKED]
    return folder / named[0] if named else None


@lru_cache(maxsize=256)
def small(folder: Path, frame: int | None = None, wide: int = WIDE) -> bytes:
    """A picture of its film, the middle one or a frame, as JPEG no larger than `wide` [px]. InputError where there is
    none."""
    path = film_of(folder)
    try:
        if path is None:
            raise FrameError(f"{folder}: no film or picture")
        film, _ = opened(path)
        with film:
            i = len(film) // 2 if frame is None else frame
            if not 0 <= i < len(film):
                raise InputError([f"{path}: frame = {i}: must be in [0, {len(film) - 1}]"])
            image = np.nan_to_num(film[i].astype(float))
    except FrameError as e:
        raise InputError([str(e)]) from None
    grey = stretched(image).astype(np.uint8)
    rows, columns = grey.shape
    k = min(wide / max(rows, columns), 4.0)  # a pixel no larger than 4
    size = max(1, round(columns * k)), max(1, round(rows * k))
    return cv2.imencode(".jpg", cv2.resize(grey, size, interpolation=cv2.INTER_AREA))[1].tobytes()
