"""Opening a film for a stage: its warnings are kept with the result, a cut film is refused unless it is accepted."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..frames import Film, FrameError, open_frames
from ..sections import BedImage, Calibration, CraterImage, GrainVideo, RodVideo, need
from ..stage import StageWarning
from ..vision.camera import Camera
from ..vision.rectify import straight_map, straight_points
from .view import view_of

SCALE_OF_PIXELS = 1.0  # m/px, where only the lens is undone


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


class StraightFilm(Film):
    """A film whose frames are resampled as a camera without lens errors, square to the marks, would have seen them."""

    def __init__(self, film: Film, view: Camera, scale: float):
        self.__dict__.update(film.__dict__)  # its clock, shape, warnings and meta are those of the film
        self._film, self._map = film, straight_map(view, film.shape, scale)

    def _read(self, i: int) -> NDArray[Any]:
        import cv2

        return np.asarray(cv2.remap(self._film[i], *self._map, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))

    def close(self) -> None:
        self._film.close()


class Region(Film):
    """The rows and columns of a film between two corners, which belong to it."""

    def __init__(self, film: Film, corners: tuple[int, int, int, int]):
        self.__dict__.update(film.__dict__)  # its clock and meta are those of the film
        left, top, right, bottom = corners
        self._film, self._part = film, (slice(top, bottom + 1), slice(left, right + 1))
        self.shape = (bottom + 1 - top, right + 1 - left)

    def _read(self, i: int) -> NDArray[Any]:
        return self._film[i][self._part].copy()

    def close(self) -> None:
        self._film.close()


def open_grains(section: GrainVideo, calibration: Calibration | None) -> tuple[Film, GrainVideo]:
    """The grain film, and its section in the pixels of its frames: straightened where lens or marks are given, then
    cut to `roi`."""
    film, section = straight_grains(section, calibration)
    if not section.roi:
        return film, section
    left, top, right, bottom = (round(v) for v in section.roi)
    if right >= film.shape[1] or bottom >= film.shape[0]:
        film.close()
        raise ValueError(
            f"[grain_video] roi = {list(section.roi)}: must lie in columns 0 to {film.shape[1] - 1}, rows 0 to "
            f"{film.shape[0] - 1} of the film"
        )
    row, column = section.foot_row, section.axis_column
    moved = replace(
        section,
        roi=(),
        foot_row=None if row is None else row - top,
        axis_column=None if column is None else column - left,
    )
    return Region(film, (left, top, right, bottom)), moved


def straight_grains(section: GrainVideo, calibration: Calibration | None) -> tuple[Film, GrainVideo]:
    """The whole film and its section, both straightened where lens or marks are given."""
    film = open_film(section)
    if not calibration or not (calibration.k1 or calibration.k2 or calibration.marks):
        return film, section
    # a lens can be undone without a scale: one pixel is then the unit
    view = view_of(calibration, section if section.scale else replace(section, scale=SCALE_OF_PIXELS), film.shape)
    known = view.scale if section.scale or calibration.marks else None
    straight = replace(section, scale=known, scale_sigma=view.scale_sigma)
    if section.foot_row is not None and section.axis_column is not None:
        seen = np.array([section.axis_column]), np.array([section.foot_row])
        column, row = straight_points(view, film.shape, view.scale, *seen)
        straight = replace(straight, axis_column=float(column[0]), foot_row=float(row[0]))
    return StraightFilm(film, view, view.scale), straight


def open_pictures(section: BedImage | CraterImage) -> Film:
    """One picture or a series of them, on their own clock (frame_rate, else one a second)."""
    film = open_frames(section.path, frame_rate=getattr(section, "frame_rate", None) or 1.0)
    for text in film.warnings if len(film) > 1 else ():
        warnings.warn(text, StageWarning, stacklevel=3)
    return film
