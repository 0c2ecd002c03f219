"""The tracker of the track stage, watched as it runs: what it found so far; stopped at any frame, or ended as there."""

from __future__ import annotations

import threading
import traceback
import warnings
from dataclasses import replace

from jumpvision.base.progress import HOOK
from jumpvision.base.schema import InputError
from jumpvision.experiment.inputs.sections import Calibration, RodVideo
from jumpvision.experiment.stages.recordings import SCALE_OF_PIXELS, open_film, view_of
from jumpvision.experiment.stages.track import BallFilm, Followed
from jumpvision.experiment.workflow.stage import StageWarning
from jumpvision.films.frames import FrameError
from jumpvision.films.parameters import TrackParams
from jumpvision.films.vision.ball.track import BallTrack, as_track

Row = tuple[float | None, float | None, float | None, str]  # x, y, sigma [px], flag


class Following:
    """One run over the film of a section in a thread of its own. rate [Hz]: where neither file nor section has one."""

    def __init__(self, film: RodVideo, calibration: Calibration | None, p: TrackParams, rate: float):
        self._section = section_of(film, calibration, rate)
        self._balls = balls_of(self._section, calibration, p)
        self._whole: Followed | None = None
        self._clock: Followed | None = None  # of the film, without tracks
        self._stop, self._thread = threading.Event(), threading.Thread(target=self._run, daemon=True)
        self._final: list[Row] | None = None
        self.frames, self.doing, self.problem, self.notes = 0, "opening the film", "", tuple[str, ...]()
        self._thread.start()

    @property
    def running(self) -> bool:
        return self._thread.is_alive()

    @property
    def finished(self) -> bool:
        """Whether the track is the one that the stage would give, and no part of it."""
        return self._final is not None

    def stop(self) -> None:
        """Ends the run; what was found stays."""
        self._stop.set()
        self._thread.join()

    def rows(self, since: int) -> list[Row]:
        """Frames from `since` on, as far as they are known."""
        if self._final is not None:
            return self._final[since:]
        follower = self._balls.follower
        return [_row(f.x, f.y, f.sigma, str(f.flag)) for f in follower.found[since:]] if follower is not None else []

    def candidates(self, frame: int) -> list[tuple[float, float, float, float]]:
        """x, y, diameter [px] and probability of what may be the ball in a frame, once all is followed."""
        follower = self._balls.follower
        return follower.candidates(frame) if self.finished and follower is not None else []

    def found(self, film: RodVideo, calibration: Calibration | None, p: TrackParams, rate: float) -> Followed:
        """What is followed so far, on the clock of `film`. InputError where there is nothing, or where the tracker
        would do something else with these values."""
        done, clock = self._whole, self._clock
        if done is None and clock is not None and self._balls.follower is not None:
            done = replace(clock, tracks=[as_track(self._balls.follower.found)])
        if done is None or not len(done.tracks[0].x):
            raise InputError(["track: none yet; track the film first"])
        section = section_of(film, calibration, rate)
        refuse_other(balls_of(section, calibration, p), self._balls, done)
        time = done.time
        if any(getattr(section, k) != getattr(self._section, k) for k in ("frame_rate", "clock", "start")):
            with warnings.catch_warnings(), open_film(section) as again:
                warnings.simplefilter("ignore")
                time = again.time + done.exposure / 2
        return replace(done, time=time[: len(done.tracks[0].x)])

    def _run(self) -> None:
        HOOK.set(self._progress)
        try:
            with warnings.catch_warnings(record=True) as said:
                warnings.simplefilter("always", StageWarning)
                track = self._track()
            if track is not None:
                self.notes = (*(str(w.message) for w in said), *track.notes)
                self._final = rows_of(track)
        except (ValueError, FrameError) as e:
            self.problem = "" if self._stop.is_set() else str(e)
        except Exception as e:
            traceback.print_exc()
            self.problem = f"the tracker failed: {type(e).__name__}: {e}"
        if self._stop.is_set() and self._balls.follower is not None:
            self._balls.follower.settle()  # what was seen is shown
        self.doing = ""

    def _track(self) -> BallTrack | None:
        with open_film(self._section) as film:
            self.frames = len(film)
            exposure, (rows, columns) = self._balls.exposure(film), film.shape
            self._clock = Followed([], film.time + exposure / 2, exposure, (rows, columns))
            for i, image in enumerate(film):
                if self._stop.is_set():
                    return None
                self._balls.see(image)
                self._progress("frames followed", i + 1, len(film))
            film.shown = True
            self._whole = self._balls.followed(film)
            return self._whole.tracks[0]

    def _progress(self, what: str, done: int, total: int | None) -> None:
        if self._stop.is_set():
            raise ValueError("stopped")  # out of whatever loop is watched
        self.doing = f"{what}: {done} of {total}"


def balls_of(section: RodVideo, calibration: Calibration | None, p: TrackParams) -> BallFilm:
    """The tracker of a section as `section_of` gives it."""
    return BallFilm(section, p, lambda shape: view_of(calibration, section, shape))


def refuse_other(wanted: BallFilm, made: BallFilm, of: Followed) -> None:
    """InputError where a tracker would give another track than the one that has made `of`."""
    if _rests_on(wanted, of) != _rests_on(made, of):
        raise InputError(["track: it was made with other values (ball, search, exposure); track the film again"])


def _rests_on(balls: BallFilm, of: Followed) -> tuple[object, ...]:
    film = balls.film
    settings = balls.settings(of.shape, of.exposure, film.frame_rate or 0.0 if of.exposure else 0.0)
    own = film.path, film.axes, film.truncated, film.exposure
    return settings, balls.scene, balls.markers, *own


def section_of(film: RodVideo, calibration: Calibration | None, rate: float) -> RodVideo:
    """The section as the tracker takes it: a pixel is the unit where no scale is known. rate [Hz]: where none is."""
    if film.scale is None and not (calibration and calibration.marks):
        film = replace(film, scale=SCALE_OF_PIXELS, scale_sigma=0.0, ball_diameter=None)
    return replace(film, frame_rate=film.frame_rate or rate)


def rows_of(track: BallTrack) -> list[Row]:
    """One row a frame."""
    return [_row(*row) for row in zip(track.x, track.y, track.sigma, map(str, track.flag), strict=True)]


def _row(x: float, y: float, sigma: float, flag: str) -> Row:
    return (None, None, None, flag) if flag else (float(x), float(y), float(sigma), "")
