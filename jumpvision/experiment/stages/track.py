"""Track: the rod's height in every frame, from the film of its ball."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jumpvision.base.schema import InputError
from jumpvision.estimate.height import at_rest, exposure_shift, shift_noise, shift_sigma
from jumpvision.estimate.mean import weighted_mean
from jumpvision.experiment.inputs.logs import read_log
from jumpvision.experiment.inputs.sections import Actuation, Calibration, RodCorrections, RodVideo, lacking
from jumpvision.experiment.results.tables import Track
from jumpvision.experiment.workflow.stage import StageWarning, stage
from jumpvision.films.frames import Film
from jumpvision.films.parameters import TrackParams
from jumpvision.films.vision.ball.film import FilmTracker, track_film
from jumpvision.films.vision.ball.track import BallSettings, BallTrack
from jumpvision.films.vision.camera import Camera
from jumpvision.films.vision.interlaced import INTERLACED, is_interlaced
from jumpvision.films.vision.repeats import Repeats, Seen, without_repeats
from jumpvision.films.vision.scene import scene_shift

from .recordings import SCALE_OF_PIXELS, height_share, in_pixels, open_film, other_lens, view_of, with_common

SAY_FROM = 3.0  # sigma: smaller shifts by the exposure, left in a frame beside a gap, are not worth a warning


def needs_of_track(film: RodVideo, calibration: Calibration | None, actuation: Actuation | None) -> list[str]:
    """A scale where a jump is to be measured; without one positions are in px."""
    return [] if in_px_alone(actuation) or not in_pixels(film, calibration) else lacking(film, "scale")


def in_px_alone(actuation: Actuation | None) -> bool:
    """Whether a track without a scale is of use: no motor moves, so that no height of a jump is asked for."""
    return actuation is None or actuation.kind == "none"


@stage(version=18, needs=needs_of_track)
def track(
    film: RodVideo,
    calibration: Calibration | None,
    actuation: Actuation | None,
    corrections: RodCorrections | None = None,
    *,
    p: TrackParams,
) -> Track:
    """Ball on the rod in every frame of [rod_video]: position [px], height [m], their uncertainties, a flag.

    Height is zero at rest before the motor starts; a lost frame is flagged and holds NaN. Where [rod_corrections]
    gives a frame, that is taken and marked, with what was found kept beside it. Without a scale, and without a motor
    whose jump is to be measured, positions are in px alone: heights are NaN.
    """
    film, p = readable(film, calibration, actuation, p)
    found = see_film(film, calibration, p)
    return as_result(found, film, calibration, actuation, places_of(corrections, len(found.time)), p)


def readable(
    film: RodVideo, calibration: Calibration | None, actuation: Actuation | None, p: TrackParams
) -> tuple[RodVideo, TrackParams]:
    """The film and the parameters that it is followed with: a pixel is the unit where no scale is needed or known."""
    if not (in_pixels(film, calibration) and in_px_alone(actuation)):
        return film, p
    blind = replace(film, scale=SCALE_OF_PIXELS, scale_sigma=0.0, ball_diameter=None)
    return blind, replace(p, exposure_correction="none")


@dataclass(frozen=True)
class Followed:
    """What a film shows of its balls, before any scale. time (n,), at mid-exposure, and exposure in [s]; shape (rows,
    columns) [px]."""

    tracks: list[BallTrack]
    time: NDArray[np.float64]
    exposure: float
    shape: tuple[int, int]


def see_film(film: RodVideo, calibration: Calibration | None, p: TrackParams) -> Followed:
    """The balls of a film, followed."""
    balls = BallFilm(film, p, partial(view_of, calibration, film))
    with open_film(film, balls.see if balls.ready else None) as frames:
        found = balls.followed(frames)
        # with a tenth of the frames lost, the film is asked whether it is interlaced
        if np.mean(found.tracks[0].flag != "") > 0.1 and is_interlaced(frames):
            warnings.warn(StageWarning("frames", INTERLACED, film.name), stacklevel=2)
        if said := scene_shift(frames):
            warnings.warn(StageWarning("place", said, film.name), stacklevel=2)
    return found


def as_result(
    found: Followed,
    film: RodVideo,
    calibration: Calibration | None,
    actuation: Actuation | None,
    given: pd.DataFrame | None,
    p: TrackParams,
) -> Track:
    """The result of the stage from what was followed. film, p: as `readable` gives them; given: as in `by_hand`."""
    motions, share = motions_of(found, film, calibration, p, given)
    if film.scale == SCALE_OF_PIXELS:
        unknown = dict.fromkeys(("height_m", "sigma_m", "exposure_shift_m", "exposure_shift_sigma_m", "lens_m"), np.nan)
        motions = [m.assign(**{c: x for c, x in unknown.items() if c in m}) for m in motions]
        motions = [m.drop(columns=list(PLACES), errors="ignore") for m in motions]
    else:
        motions = [with_common(with_rest_zero(motion, actuation), share) for motion in motions]
    return Track(motions[0], tuple(motions[1:]))


def from_film(
    film: RodVideo, calibration: Calibration | None, p: TrackParams, corrections: RodCorrections | None = None
) -> tuple[list[pd.DataFrame], float]:
    """`motions_of` a film that is followed for it."""
    found = see_film(film, calibration, p)
    return motions_of(found, film, calibration, p, places_of(corrections, len(found.time)))


def motions_of(
    found: Followed,
    film: RodVideo,
    calibration: Calibration | None,
    p: TrackParams,
    given: pd.DataFrame | None = None,
) -> tuple[list[pd.DataFrame], float]:
    """Columns of Track for every ball, height along the rail from the camera's own zero, sigma_m the noise alone; and
    the relative uncertainty that all heights share. given: places of the first ball, as in `by_hand`."""
    view, other = view_of(calibration, film, found.shape), other_lens(calibration, film, found.shape)
    motions = [ball_motion(film, ball, found.time, view, k + 1) for k, ball in enumerate(found.tracks)]
    if given is not None:
        motions[0] = by_hand(motions[0], given, view)
    motions = [through(other, motion) for motion in motions]
    corrected = [at_mid_exposure(motion, found.exposure, p.exposure_correction) for motion in motions]
    if film.origin:
        corrected = [in_axes(m, view, film.origin, found.exposure, p.exposure_correction) for m in corrected]
    return corrected, height_share(view, calibration)


PLACES = ("x_m", "y_m")


def in_axes(motion: pd.DataFrame, view: Camera, origin: tuple[float, ...], exposure: float, how: str) -> pd.DataFrame:
    """The motion with x_m to the right of the rail's upward direction and y_m along it, from the origin (column, row)
    [px]. height_m is still the camera's own; what the exposure adds is taken out of both where it is out of that."""
    across = view.across(motion.x_px, motion.y_px)
    if how == "apply" and exposure > 0:
        shift = exposure_shift(motion.time_s.to_numpy(float), across, exposure)
        across = across - np.where(np.isfinite(shift), shift, 0.0)
    zero = view.across(*origin), view.height(*origin)
    return motion.assign(x_m=across - zero[0], y_m=motion.height_m - zero[1])


def places_of(corrections: RodCorrections | None, n: int) -> pd.DataFrame | None:
    """frame, x_px, y_px, sigma_px of [rod_corrections]; InputError for a frame that the film of n frames does not have
    or a sigma that is none."""
    if corrections is None:
        return None
    given = read_log(corrections, "frame", "x_px", "y_px", "sigma_px", at_least=0)
    for row, (frame, sigma) in enumerate(zip(given.frame, given.sigma_px), 1):
        if frame != int(frame) or not 0 <= frame < n:
            raise InputError(
                [f"{corrections.path}: row {row}, frame = {frame:g}: must be a frame of the film, 0 to {n - 1}"]
            )
        if not sigma > 0:
            raise InputError([f"{corrections.path}: row {row}, sigma_px = {sigma:g}: must be above 0 px"])
    return given


def by_hand(motion: pd.DataFrame, given: pd.DataFrame, view: Camera) -> pd.DataFrame:
    """The motion with the positions that a person gives (frame, x_px, y_px, sigma_px): corrected is 1 there, and
    x_found_px, y_found_px, flag_found hold what was found."""
    at = given.frame.to_numpy()
    x, y, sigma = (given[c].to_numpy(float) for c in ("x_px", "y_px", "sigma_px"))
    found = {"x_found_px": motion.x_px, "y_found_px": motion.y_px, "flag_found": motion.flag}
    motion = motion.assign(corrected=0, **found)
    values = {"x_px": x, "y_px": y, "sigma_px": sigma, "height_m": view.height(x, y), "sigma_m": sigma * view.scale}
    for column, value in (values | {"flag": "", "corrected": 1}).items():
        motion.loc[at.astype(int), column] = value
    return motion


def through(other: Camera | None, motion: pd.DataFrame) -> pd.DataFrame:
    """The motion with lens_m [m]: by how much the other camera sees each height higher; as it is without one."""
    if other is None:
        return motion
    x, y = (motion[c].to_numpy(float) for c in ("x_px", "y_px"))
    return motion.assign(lens_m=other.height(x, y) - motion.height_m.to_numpy(float))


def at_mid_exposure(motion: pd.DataFrame, exposure: float, how: str) -> pd.DataFrame:
    """The motion with exposure_shift_m, what acceleration during the exposure [s] adds to a height, and its
    exposure_shift_sigma_m; NaN where unknown. how = "apply" takes it out of height_m, "report" says where it exceeds
    SAY_FROM sigma; where it does, what cannot be mended is said too."""
    time, height, sigma = (motion[c].to_numpy(float) for c in ("time_s", "height_m", "sigma_m"))
    shift = exposure_shift(time, height, exposure) if exposure > 0 else np.full(len(motion), np.nan)
    known = np.isfinite(shift)
    own = np.where(known, shift_noise(sigma, time, exposure), np.nan) if known.any() else shift
    motion = motion.assign(exposure_shift_m=shift, exposure_shift_sigma_m=own)
    if how == "none" or not known.any():
        return motion
    worst = int(np.nanargmax(np.abs(shift)))
    matters = abs(shift[worst]) > SAY_FROM * sigma[worst]
    size = f"shifts heights by up to {abs(shift[worst]):.2g} m ({abs(shift[worst]) / sigma[worst]:.1f} sigma)"
    left = np.count_nonzero(np.isfinite(height) & ~known)
    if how == "apply":
        if matters and left:
            text = f"exposure {exposure:g} s: acceleration {size}; not taken out of {left} frames without neighbours"
            warnings.warn(StageWarning("exposure", text, "rod_video"), stacklevel=2)
        better = np.where(known, shift_sigma(sigma, time, exposure), sigma)
        return motion.assign(height_m=height - np.where(known, shift, 0.0), sigma_m=better)
    if matters:
        text = f'exposure {exposure:g} s: acceleration {size}; track.exposure_correction = "apply" takes it out'
        warnings.warn(StageWarning("exposure", text, "rod_video"), stacklevel=2)
    return motion


def ball_motion(film: RodVideo, found: BallTrack, time: NDArray[np.float64], view: Camera, number: int) -> pd.DataFrame:
    """Columns of Track for one ball. time: (n,) mid-exposure [s]; number: of the ball, from 1."""
    n, which = len(found.x), f"ball {number}: " if number > 1 else ""
    flag = np.array(found.flag, dtype=object)
    for i, reason in film.excluded(n).items():
        flag[i] = reason
    bad = flag != ""
    if bad.all():
        raise ValueError(
            f"{film.path}: {which}no ball found in any of {n} frames (first reason: {flag[0]}); "
            "check polarity, ball_diameter and scale, or give track.seed=[column, row]"
        )
    if bad.any():
        lost = np.flatnonzero(bad)
        said = f"{which}{lost.size} of {n} frames lost (first {lost[0]}: {flag[lost[0]]})"
        numbers = {"lost": int(lost.size), "of": n, "frame": int(lost[0])}
        warnings.warn(StageWarning("frames", said, film.name, numbers), stacklevel=2)
    for note in found.notes:
        warnings.warn(StageWarning("frames", f"{which}{note}", film.name), stacklevel=2)
    x, y, sigma = (np.where(bad, np.nan, v) for v in (found.x, found.y, found.sigma))
    return pd.DataFrame(
        {
            "frame": np.arange(n),
            "time_s": time,
            "x_px": x,
            "y_px": y,
            "sigma_px": sigma,
            "height_m": view.height(x, y),
            "sigma_m": sigma * view.scale,
            "flag": flag,
        }
    )


def with_rest_zero(motion: pd.DataFrame, actuation: Actuation | None) -> pd.DataFrame:
    """The same with height zero at rest: the weighted mean before the motor starts, or the first good frame."""
    start = actuation.start if actuation else None
    good = motion.height_m.notna().to_numpy()
    rest = good & at_rest(motion.time_s, start) if start is not None else np.zeros_like(good)
    if actuation is not None and actuation.kind != "none" and not rest.any():
        said = f"no good frame before the motor starts at {start:g} s: the first good frame is taken as rest"
        warnings.warn(StageWarning("missing", said, "rod_video"), stacklevel=2)
    if not rest.any():
        rest[np.flatnonzero(good)[0]] = True
    zeros = {
        c: weighted_mean(motion[c][rest], motion.sigma_m[rest], "m").value
        for c in ("height_m", "lens_m")
        if c in motion
    }
    return motion.assign(**{c: motion[c] - zero for c, zero in zeros.items()})


class BallFilm:
    """Give `see` to `open_film` where `ready`, then ask for the `tracks` of the film."""

    def __init__(self, film: RodVideo, p: TrackParams, camera: Callable[[tuple[int, int]], Camera]):
        self.film, self.p, self.camera = film, p, camera  # camera: of a frame's shape
        # a motion streak needs the frame rate, which a film that does not declare it tells at its end
        self.ready = not film.exposure or film.frame_rate is not None
        self.follower: FilmTracker | None = None
        self.repeats = Repeats()

    def see(self, image: NDArray[np.generic]) -> None:
        """The next frame of the film, in order."""
        if self.follower is None:
            settings = self.settings(image.shape, self.film.exposure, self.film.frame_rate or 0.0)
            self.follower = FilmTracker(settings, scene=self.scene, markers=self.markers)
        self.follower.see(image)
        self.repeats.see(image)

    def tracks(self, frames: Film) -> list[BallTrack]:
        """One track a ball, the first ball's first; the frames are read again only if `see` was not given all."""
        rate = 1.0 / float(np.median(np.diff(frames.time))) if len(frames) > 1 else 0.0
        settings, seen = self.settings(frames.shape, self.exposure(frames), rate), self.follower
        if seen is not None and frames.shown:
            guess, fraction = seen.settings, settings.exposure_fraction
            # a streak fit starts well from a rate that differs by a tenth
            near = abs(guess.exposure_fraction - fraction) <= 0.1 * fraction
            if near and replace(guess, exposure_fraction=fraction) == settings:
                return seen.finish(frames)
        self.repeats = Repeats()
        return track_film(Seen(frames, self.repeats), settings, scene=self.scene, markers=self.markers)

    def followed(self, frames: Film) -> Followed:
        """Return the tracks with the film's clock; see `tracks`."""
        tracks, said = without_repeats(self.tracks(frames), self.repeats)
        if said:
            warnings.warn(StageWarning("reading", said, self.film.name), stacklevel=3)
        exposure = self.exposure(frames)
        rows, columns = frames.shape
        return Followed(tracks, frames.time + exposure / 2, exposure, (rows, columns))

    def settings(self, shape: tuple[int, ...], exposure: float, rate: float) -> BallSettings:
        """How to follow the first ball at this exposure [s] and frame rate [Hz]."""
        film, p, scale = self.film, self.p, self.camera((shape[0], shape[1])).scale
        return BallSettings(
            diameter=p.diameter or (film.ball_diameter / scale if film.ball_diameter else None),
            polarity=p.polarity,
            method=p.method,
            search=p.search,
            seed=(p.seed[0], p.seed[1]) if p.seed else None,
            streak=exposure > 0,
            exposure_fraction=min(exposure * rate, 1.0),
        )

    @property
    def scene(self) -> bool:
        """Whether the still scene is to be taken out."""
        return self.p.background == "static"

    @property
    def markers(self) -> list[tuple[float, float]]:
        """Where the further balls are in the first frame [px]."""
        return [(m[0], m[1]) for m in self.p.markers]

    def exposure(self, frames: Film) -> float:
        """Exposure time [s], 0 where nobody knows it."""
        return self.film.exposure or frames.exposure
