"""Track: the rod's height in every frame, from the film of its ball."""

from __future__ import annotations

import warnings

import numpy as np
import pandas as pd

from ..fit.mean import weighted_mean
from ..params import TrackParams
from ..pipeline import StageWarning, stage
from ..records import Track
from ..sections import Actuation, Calibration, RodVideo
from ..vision.ball import BallSettings
from ..vision.ball_film import track_film
from ..vision.camera import Camera, camera
from .films import open_film


@stage(version=1)
def track(film: RodVideo, calibration: Calibration | None, actuation: Actuation | None, *, p: TrackParams) -> Track:
    """Height is zero at rest before the motor starts; a lost frame is flagged and holds NaN."""
    return Track(with_rest_zero(from_film(film, calibration, p), actuation))


def from_film(film: RodVideo, calibration: Calibration | None, p: TrackParams) -> pd.DataFrame:
    """Columns of Track, height along the rail from the camera's own zero."""
    with open_film(film) as frames:
        view = film_camera(film, calibration or Calibration(), frames.shape)
        diameter = p.diameter or (film.ball_diameter / view.scale if film.ball_diameter else None)
        exposure = film.exposure or float(frames.meta.get("exposure_s") or 0.0)
        interval = float(np.median(np.diff(frames.time))) if len(frames) > 1 else np.inf
        settings = BallSettings(
            diameter=diameter, polarity=p.polarity, method=p.method, search=p.search,
            seed=(p.seed[0], p.seed[1]) if p.seed else None, streak=exposure > 0,
            exposure_fraction=min(exposure / interval, 1.0),
        )  # fmt: skip
        found = track_film(frames, settings, scene=p.background == "static")[0]
        n, time = len(found.x), frames.time
    flag = np.array(found.flag, dtype=object)
    for i, reason in film.excluded().items():
        if i < n:
            flag[i] = reason
    bad = flag != ""
    if bad.all():
        raise ValueError(
            f"{film.path}: no ball found in any of {n} frames (first reason: {flag[0]}); "
            "check polarity, ball_diameter and scale, or give track.seed=[column, row]"
        )
    if bad.any():
        lost = np.flatnonzero(bad)
        warnings.warn(f"{lost.size} of {n} frames lost (first {lost[0]}: {flag[lost[0]]})", StageWarning, stacklevel=2)
    x, y, sigma = (np.where(bad, np.nan, v) for v in (found.x, found.y, found.sigma))
    return pd.DataFrame(
        {
            "frame": np.arange(n), "time_s": time[:n] + exposure / 2, "x_px": x, "y_px": y, "sigma_px": sigma,
            "height_m": view.height(x, y), "sigma_m": sigma * view.scale, "flag": flag,
        }
    )  # fmt: skip


def film_camera(film: RodVideo, calibration: Calibration, shape: tuple[int, int]) -> Camera:
    """The camera of a film; the distortion centre defaults to the image centre."""
    centre = calibration.centre or ((shape[1] - 1) / 2, (shape[0] - 1) / 2)
    return camera(
        scale=film.scale, up=film.up, tilt=calibration.tilt, marks=calibration.marks,
        k1=calibration.k1, k2=calibration.k2, centre=(centre[0], centre[1]),
    )  # fmt: skip


def with_rest_zero(motion: pd.DataFrame, actuation: Actuation | None) -> pd.DataFrame:
    """The same with height zero at rest: the weighted mean before the motor starts, or the first good frame."""
    start = actuation.start if actuation else None
    good = motion.height_m.notna().to_numpy()
    rest = good & (motion.time_s.to_numpy() < start) if start is not None else np.zeros_like(good)
    if start is not None and not rest.any():
        warnings.warn(
            f"no good frame before the motor starts at {start:g} s: the first good frame is taken as rest",
            StageWarning,
            stacklevel=2,
        )
    if not rest.any():
        rest[np.flatnonzero(good)[0]] = True
    zero = weighted_mean(motion.height_m[rest], motion.sigma_m[rest], "m").value
    return motion.assign(height_m=motion.height_m - zero)
