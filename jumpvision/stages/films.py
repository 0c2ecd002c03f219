"""Opening a film for a stage: its warnings are kept with the result, a cut film is refused unless it is accepted."""

from __future__ import annotations

import warnings

import numpy as np

from ..frames import Film, FrameError, open_frames
from ..pipeline import StageWarning
from ..sections import BedImage, Calibration, CraterImage, GrainVideo, RodVideo, need


def open_film(section: RodVideo | GrainVideo) -> Film:
    """The film of a section on the common clock; FrameError when frames are lost and `truncated` does not accept it."""
    film = open_frames(section.path, frame_rate=section.frame_rate, start=section.start)
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
            f"[calibration] distortion and marks are not applied to [{section}]: its film is taken as seen straight on",
            StageWarning,
            stacklevel=3,
        )


def open_pictures(section: BedImage | CraterImage) -> Film:
    """One picture or a series of them, on their own clock (frame_rate, else one a second)."""
    film = open_frames(section.path, frame_rate=getattr(section, "frame_rate", None) or 1.0)
    for text in film.warnings if len(film) > 1 else ():
        warnings.warn(text, StageWarning, stacklevel=3)
    return film
