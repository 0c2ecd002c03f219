"""Opening a film for a stage: its warnings are kept with the result, a cut film is refused unless it is accepted."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..frames import Film, FrameError, open_frames
from ..pipeline import StageWarning
from ..sections import Calibration, GrainVideo, RodVideo, need


def open_film(section: RodVideo | GrainVideo, seen: Callable[[NDArray[np.generic]], None] | None = None) -> Film:
    """The film of a section on the common clock; FrameError when frames are lost and `truncated` does not accept it.

    seen: see `open_frames`.
    """
    film = open_frames(section.path, frame_rate=section.frame_rate, start=section.start, seen=seen)
    if section.clock == "declared":
        film = timed_as_declared(film, section)
    if film.truncated and section.truncated != "accept":
        film.close()
        raise FrameError(
            f"{'; '.join(film.warnings)}: copy the film from the camera again, or give "
            f'[{section.name}] truncated = "accept" to use the {len(film)} whole frames'
        )
    for text in film.warnings:
        warnings.warn(text, StageWarning, stacklevel=3)
    return film


def timed_as_declared(film: Film, section: RodVideo | GrainVideo) -> Film:
    """The film with its time stamps stretched to `frame_rate`; gaps in them stay gaps."""
    (rate,) = need(section, "frame_rate")
    if film.time_source == "declared" or len(film) < 2:
        return film
    film.close()
    film = open_frames(section.path, start=section.start)  # without a rate to disagree with
    step = float(np.median(np.diff(film.time)))
    film.time = film.time[0] + (film.time - film.time[0]) / (rate * step)
    return film


def warn_uncalibrated(calibration: Calibration | None, section: str) -> None:
    """Say so where a lens or marks are given that this stage does not use."""
    if calibration and (calibration.k1 or calibration.k2 or calibration.marks):
        warnings.warn(
            f"[calibration] distortion and marks are applied to [rod_video] only, not to [{section}]",
            StageWarning,
            stacklevel=3,
        )


def read_picture(path: Path) -> NDArray[np.generic]:
    """A single picture (height, width), grey."""
    with open_frames(path, frame_rate=1.0) as film:
        return film[0]
