"""Recordings as stages read them: films opened with warnings, the camera of each, errors a campaign shares."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jumpvision.base.arrays import Image
from jumpvision.estimate.estimate import Estimate
from jumpvision.experiment.inputs.experiment import Experiment
from jumpvision.experiment.inputs.sections import (
    BedImage,
    Calibration,
    Clock,
    CraterImage,
    GrainVideo,
    RodTrack,
    RodVideo,
    need,
)
from jumpvision.experiment.workflow.stage import StageWarning
from jumpvision.films.frames import Film, FrameError, open_frames
from jumpvision.films.resample import resample
from jumpvision.films.vision.camera import Camera, camera, straight_map, straight_points

from .pairs import in_pairs

SCALE_OF_PIXELS = 1.0  # m/px, where only the lens is undone


def open_film(section: RodVideo | GrainVideo, seen: Callable[[Image], None] | None = None) -> Film:
    """The film of a section on the common clock; FrameError when frames are lost and `truncated` does not accept it.

    seen: see `open_frames`.
    """
    film: Film
    if isinstance(section, GrainVideo) and section.pairs:
        film = in_pairs(section)
    else:
        rate, start = section.frame_rate, section.start
        film = open_frames(section.path, frame_rate=rate, start=start, seen=seen, axes=section.axes)
        own = film.rate if film.time_source == "file" else None
        if section.clock == "declared":
            film = timed_as_declared(film, section)
        _check_exposure(film, section, own)
    if film.truncated and section.truncated != "accept":
        film.close()
        raise FrameError(
            f"{'; '.join(film.warnings)}: copy the film from the camera again, or give "
            f'[{section.name}] truncated = "accept" to use the {len(film)} whole frames'
        )
    _refuse_outside(film, section)
    for text in film.warnings:
        warnings.warn(StageWarning("frames", text, section.name), stacklevel=3)
    if isinstance(section, RodVideo) and not section.exposure and film.meta.get("exposure_s", 0.0) > film.exposure:
        text = (
            f"{section.path}: an exposure of {film.meta['exposure_s']:g} s by its header, longer than from one frame "
            f"to the next ({1.0 / film.rate:.3g} s): taken as unknown; give [{section.name}] exposure = ... (s)"
        )
        warnings.warn(StageWarning("exposure", text, section.name), stacklevel=3)
    return film


def _check_exposure(film: Film, section: RodVideo | GrainVideo, own: float | None) -> None:
    """Raise FrameError for an exposure longer than from one frame to the next. own [Hz]: rate by its stamps."""
    exposure = getattr(section, "exposure", 0.0)
    if exposure * film.rate <= 1.0 + 1e-6 or len(film) < 2:
        return
    film.close()
    stamps = f"; {own:g} Hz by the film's own stamps" if own and own != film.rate else ""
    raise FrameError(
        f"{section.path}: [{section.name}] exposure = {exposure:g} s: longer than a frame at {film.rate:g} Hz "
        f"({1.0 / film.rate:.3g} s){stamps}: correct the rate, or the exposure (in ms? then give {exposure / 1e3:g})"
    )


def _refuse_outside(film: Film, section: Filmed) -> None:
    """Rows and columns of a section that an HDF5 film has not: its axes are the other way round, unless they are
    declared."""
    if film.meta.get("format") != "hdf5" or section.axes:
        return
    rows, columns = film.shape
    sizes = {"floor_row": rows, "foot_row": rows, "axis_column": columns}
    given = [(k, getattr(section, k, None), n) for k, n in sizes.items()]
    left, top, right, bottom = getattr(section, "roi", ()) or (0, 0, 0, 0)
    given += [("roi", max(left, right), columns), ("roi", max(top, bottom), rows)]
    for key, value, size in given:
        if value is not None and value > size:
            film.close()
            raise FrameError(
                f"{section.path}: [{section.name}] {key} = {value:g}: outside its pictures of {rows} rows x {columns} "
                'columns as the data set is read; give axes = "frame,column,row" (MATLAB\'s h5write), or correct it'
            )


def timed_as_declared(film: Film, section: RodVideo | GrainVideo) -> Film:
    """The film with its time stamps stretched to `frame_rate`; gaps in them stay gaps.

    Stamps may be rounded (Matroska: to 1 ms): frames whose stamps are those of an even rate are timed evenly, with the
    slots of missing frames left free.
    """
    (rate,) = need(section, "frame_rate")
    if film.time_source == "declared" or len(film) < 2:
        return film
    film.close()
    film = open_frames(section.path, start=section.start, axes=section.axes)  # without a rate to disagree with
    film.time = film.time[0] + slots(film.time - film.time[0], rate) / rate
    return film


def slots(time: NDArray[np.float64], rate: float) -> NDArray[np.float64]:
    """Number of each frame among those of an even rate, the first 0, from times [s] (n >= 2,), rounded or not.

    The rate is the declared one [Hz], or another at which the film was saved for playing; where no even rate explains
    the times within a third of a step or 1.01 ms, fractions of the median step.
    """
    number = np.rint(time * rate)
    if np.median(np.diff(number)) == 1.0 and _explains(number, time, 1.0 / rate):
        return number
    step = float(np.median(np.diff(time)))
    number = np.concatenate([[0.0], np.cumsum(np.rint(np.diff(time) / step))])
    return number if _explains(number, time, step) else time / step


def _explains(number: NDArray[np.float64], time: NDArray[np.float64], step: float) -> bool:
    line = np.polynomial.Polynomial.fit(number, time, 1)
    # Matroska keeps whole milliseconds
    return bool((np.diff(number) >= 1).all() and np.abs(time - line(number)).max() < max(step / 3.0, 1.01e-3))


class StraightFilm(Film):
    """A film whose frames are resampled as a camera without lens errors, square to the marks, would have seen them."""

    def __init__(self, film: Film, view: Camera, scale: float):
        self.__dict__.update(film.__dict__)  # its clock, shape, warnings and meta are those of the film
        self._film, self._map = film, straight_map(view, film.shape, scale)

    def _read(self, i: int) -> Image:
        return resample(self._film[i], *self._map)

    def close(self) -> None:
        self._film.close()


class Region(Film):
    """The rows and columns of a film between two corners, which belong to it."""

    def __init__(self, film: Film, corners: tuple[int, int, int, int]):
        self.__dict__.update(film.__dict__)  # its clock and meta are those of the film
        left, top, right, bottom = corners
        self._film, self._part = film, (slice(top, bottom + 1), slice(left, right + 1))
        self.shape = (bottom + 1 - top, right + 1 - left)

    def _read(self, i: int) -> Image:
        return self._film[i][self._part].copy()

    def close(self) -> None:
        self._film.close()


def open_grains(section: GrainVideo, calibration: Calibration | None) -> tuple[Film, GrainVideo]:
    """The grain film, and its section in the pixels of its frames: straightened where lens or marks are given, then
    cut to `roi`."""
    return straightened_and_cut(open_film(section), section, calibration)


def straightened_and_cut(film: Film, section: GrainVideo, calibration: Calibration | None) -> tuple[Film, GrainVideo]:
    """The same of an opened film with the pixels of the recorded one."""
    film, section = straight_grains(film, section, calibration)
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


def straight_grains(film: Film, section: GrainVideo, calibration: Calibration | None) -> tuple[Film, GrainVideo]:
    """The whole film and its section, both straightened where lens or marks are given."""
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
    film = open_frames(section.path, frame_rate=getattr(section, "frame_rate", None) or 1.0, axes=section.axes)
    _refuse_outside(film, section)
    for text in film.warnings if len(film) > 1 else ():
        warnings.warn(StageWarning("frames", text, section.name), stacklevel=3)
    return film


Filmed = RodVideo | BedImage | CraterImage | GrainVideo


def in_pixels(film: RodVideo, calibration: Calibration | None) -> bool:
    """Whether nothing says how many metres a pixel shows."""
    return film.scale is None and not (calibration and calibration.marks)


def view_of(calibration: Calibration | None, section: Filmed, shape: tuple[int, int]) -> Camera:
    """The camera; the distortion centre defaults to the image centre, the rail's tilt is that of the rod film alone."""
    view = bare_view(calibration, section, ((shape[1] - 1) / 2, (shape[0] - 1) / 2))
    if calibration and (doubt := calibration.centred(section.name, shape)):
        warnings.warn(StageWarning("place", doubt, section.name), stacklevel=3)
    if view.residual_px > 2.0:  # px rms: beyond, a wrong mark is more likely than a careless click
        said = f"[calibration] marks miss their places in [{section.name}] by {view.residual_px:.1f} px rms: check them"
        warnings.warn(StageWarning("place", said, "calibration", {"rms_px": view.residual_px}), stacklevel=3)
    return view


def bare_view(calibration: Calibration | None, section: Filmed, middle: tuple[float, float]) -> Camera:
    """The same without a word about marks that miss; middle: column, row of the picture's centre [px]."""
    c = calibration or Calibration()
    if not c.marks:
        need(section, "scale")
    centre = c.centre or middle
    up, tilt = (section.up, c.tilt) if isinstance(section, RodVideo) else ("-y", 0.0)
    return camera(
        scale=section.scale,
        up=up,
        tilt=tilt,
        marks=c.marks,
        k1=c.k1,
        k2=c.k2,
        centre=(centre[0], centre[1]),
        scale_sigma=section.scale_sigma,
    )


def other_lens(calibration: Calibration | None, section: Filmed, shape: tuple[int, int]) -> Camera | None:
    """The camera if k1 were one standard uncertainty larger (marks are then fitted anew); None where k1 is exact."""
    if calibration is None or not calibration.lens_sigma:
        return None
    other = replace(calibration, k1=calibration.k1 + calibration.lens_sigma)
    return bare_view(other, section, ((shape[1] - 1) / 2, (shape[0] - 1) / 2))


NOWHERE = (0.0, 0.0)  # px: centre of a picture whose size is not known, where neither lens nor marks need one


@dataclass(frozen=True)
class Shared:
    """Standard uncertainties that a rod recording shares with all others of its apparatus.

    scale: relative, of every height above rest (scale of the camera, and the angle of the rail). offset [s]: of the
    recording's start on the common clock. rate: relative, of the time since then. apparatus: equal for recordings with
    the same scale, scale_sigma and [calibration], whose errors of scale and lens are one and the same.
    """

    scale: float
    offset: float
    rate: float
    apparatus: str


def shared_of(experiment: Experiment) -> Shared:
    """Of the rod film where there is one, else of the table tracked elsewhere; zeros where nothing is stated.

    The lens is not in it: its error differs from height to height, and stands in rod.csv (lens_m).
    """
    film, table = experiment.section(RodVideo), experiment.section(RodTrack)
    calibration = experiment.section(Calibration) or Calibration()
    clock = experiment.section(Clock) or Clock()
    scale, camera = 0.0, {}
    if film is not None:
        camera = {"rod_video": [film.scale, film.scale_sigma], "calibration": asdict(calibration)}
        marks = calibration.marks
        if film.scale or marks:
            # an undistorted mark is moved by the centre, but hardly the scale: the film need not be opened for it
            column, row = np.mean(marks, axis=0)[:2] if marks else NOWHERE
            scale = height_share(bare_view(calibration, film, (float(column), float(row))), calibration)
    elif table is not None:
        scale, camera = table.scale_sigma, {"rod_track": [table.scale_sigma]}
    return Shared(scale, clock.offset_sigma, clock.rate_sigma, json.dumps(camera, sort_keys=True))


def height_share(view: Camera, calibration: Calibration | None) -> float:
    """Relative standard uncertainty of all heights along the rail, of the camera's scale and of the rail's tilt."""
    return math.hypot(view.scale_share, foreshortening(calibration.tilt_sigma if calibration else 0.0))


def foreshortening(tilt_sigma: float) -> float:
    """Root mean square of 1 - cos(d), relative, for a normal error d of the rail's angle, tilt_sigma [rad].

    A ball that rises by h along a rail d away from where it is taken to be is seen to rise by h cos(d), whatever the
    tilt itself: to first order nothing, to second d^2/2, whose mean square is 3/4 tilt_sigma^4.
    """
    return 0.5 * math.sqrt(3.0) * tilt_sigma**2


def with_common(motion: pd.DataFrame, share: float) -> pd.DataFrame:
    """The motion above rest with sigma_common_m, and sigma_m (its noise until here) holding both.

    share: relative, of every height_m; lens_m [m]: of each, where the column is there. What rest itself is off is not
    seen in a height above it. A sigma_common_m that is there already counts beside them.
    """
    height = motion.height_m.to_numpy(float)
    common = share * np.abs(height)
    for column in ("lens_m", "sigma_common_m"):
        if column in motion:
            common = np.hypot(common, motion[column].to_numpy(float))
    motion = motion.drop(columns="sigma_common_m", errors="ignore")
    motion.insert(motion.columns.get_loc("sigma_m") + 1, "sigma_common_m", common)
    return motion.assign(sigma_m=np.hypot(motion.sigma_m.to_numpy(float), common))


def scaled(e: Estimate, *shares: float) -> Estimate:
    """The estimate with relative standard uncertainties that it shares with other experiments."""
    share = math.hypot(*shares)
    return e.with_common(share * abs(e.value)) if share else e


def timed(e: Estimate, clock: Clock | None, begin: float) -> Estimate:
    """The estimate of a time [s] on the common clock, with that clock's error; begin [s]: of its recording."""
    if clock is None:
        return e
    return e.with_common(math.hypot(clock.offset_sigma, clock.rate_sigma * abs(e.value - begin)))
