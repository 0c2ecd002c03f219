"""What the experiments of a campaign share: errors of scale, lens, tilt and clock, which no repetition averages out."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass

import numpy as np
import pandas as pd

from ..experiment import Experiment
from ..fit.estimate import Estimate
from ..sections import Calibration, Clock, RodTrack, RodVideo
from ..vision.camera import Camera
from .view import bare_view

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
