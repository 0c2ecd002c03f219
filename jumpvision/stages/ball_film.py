"""The balls of a rod video, followed while the film is decoded for the first time, so that once is enough."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..frames import Film
from ..params import TrackParams
from ..sections import RodVideo
from ..vision.ball import BallSettings, BallTrack
from ..vision.ball_film import FilmTracker, track_film
from ..vision.camera import Camera

RATES_ALIKE = 0.1  # relative difference of declared and recorded rate that a streak fit starts well with


class BallFilm:
    """Give `see` to `open_film` where `ready`, then ask for the `tracks` of the film."""

    def __init__(self, film: RodVideo, p: TrackParams, camera: Callable[[tuple[int, int]], Camera]):
        self.film, self.p, self.camera = film, p, camera  # camera: of a frame's shape
        # a motion streak needs the frame rate, which a film that does not declare it tells at its end
        self.ready = not film.exposure or film.frame_rate is not None
        self.follower: FilmTracker | None = None

    def see(self, image: NDArray[np.generic]) -> None:
        """The next frame of the film, in order."""
        if self.follower is None:
            settings = self.settings(image.shape, self.film.exposure, self.film.frame_rate or 0.0)
            self.follower = FilmTracker(settings, scene=self.scene, markers=self.markers)
        self.follower.see(image)

    def tracks(self, frames: Film) -> list[BallTrack]:
        """One track a ball, the first ball's first; the frames are read again only if `see` was not given all."""
        rate = 1.0 / float(np.median(np.diff(frames.time))) if len(frames) > 1 else 0.0
        settings, seen = self.settings(frames.shape, self.exposure(frames), rate), self.follower
        if seen is not None and frames.shown:
            guess, fraction = seen.settings, settings.exposure_fraction
            near = abs(guess.exposure_fraction - fraction) <= RATES_ALIKE * fraction
            if near and replace(guess, exposure_fraction=fraction) == settings:
                return seen.finish(frames)
        return track_film(frames, settings, scene=self.scene, markers=self.markers)

    def settings(self, shape: tuple[int, ...], exposure: float, rate: float) -> BallSettings:
        """How to follow the first ball at this exposure [s] and frame rate [Hz]."""
        film, p, scale = self.film, self.p, self.camera((shape[0], shape[1])).scale
        return BallSettings(
            diameter=p.diameter or (film.ball_diameter / scale if film.ball_diameter else None),
            polarity=p.polarity, method=p.method, search=p.search, seed=(p.seed[0], p.seed[1]) if p.seed else None,
            streak=exposure > 0, exposure_fraction=min(exposure * rate, 1.0),
        )  # fmt: skip

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
        return self.film.exposure or float(frames.meta.get("exposure_s") or 0.0)
