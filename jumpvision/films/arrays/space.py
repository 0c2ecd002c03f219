"""`jv.triangulate`: one body in space from two cameras' tables."""

from __future__ import annotations

import warnings

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError, StageWarning
from jumpvision.films.vision.stereo import FAR, Pinhole, at_times, pinhole
from jumpvision.films.vision.stereo import triangulate as places_of

from .motion import with_derivatives

COLUMNS = ("time_s", "x_px", "y_px", "sigma_px")  # what two cameras' tables must have


def triangulate(
    first: pd.DataFrame,
    second: pd.DataFrame,
    marks: ArrayLike,
    seen_first: ArrayLike,
    seen_second: ArrayLike,
    *,
    offset: float = 0.0,
    ball_diameter: float = 0.0,
    lens: bool = False,
    window: int = 7,
) -> pd.DataFrame:
    """One body in space from two cameras: a row a frame of the first camera.

    first, second: tables with time_s, x_px, y_px, sigma_px, as `jv.track` gives (x right, y down, no axes needed).
    marks: (n, 3) [m], n >= 6, places that both cameras saw, not in one plane; seen_first, seen_second: (n, 2) column,
    row [px] of them. offset [s]: what is added to the second camera's clock. ball_diameter [m]: of a ball, whose
    outline is not centred on it. lens: fit each camera's radial distortion too. window: as in `jv.track`.

    Columns: frame, time_s; x_m, y_m, z_m in the axes of the marks; sigma_x_m ... independent from frame to frame;
    sigma_common_x_m ... of the calibration, shared by all frames; miss_sigma, by how much the two rays miss each other;
    vx_m_s ... az_m_s2 with v_sigma, a_sigma (of the worst axis); flag: "" or why there is no place (all NaN then).
    Raises InputError for marks or tables that cannot be used.

    Example: jv.triangulate(jv.track(film_a, frame_rate=500), jv.track(film_b, frame_rate=500), marks, seen_a, seen_b)
    """
    cameras = tuple(
        _camera(name, pixel, marks, lens) for name, pixel in zip(("first", "second"), (seen_first, seen_second))
    )
    for name, table in (("first", first), ("second", second)):
        missing = [c for c in COLUMNS if c not in table.columns]
        if missing or len(table) < 2:
            what = f"columns missing: {missing}" if missing else "fewer than 2 rows"
            raise InputError([f"jv.triangulate: {name} table: {what}; give what jv.track gives"])
    time = first.time_s.to_numpy(float)
    pixels, sigmas = _pixels(first)
    others, other_sigmas = at_times(second.time_s.to_numpy(float) + offset, *_pixels(second), time)
    found = places_of((cameras[0], cameras[1]), (pixels, others), (sigmas, other_sigmas), ball_diameter / 2.0)
    lost = ~np.isfinite(found.place).all(axis=1)
    apart = ~lost & (found.miss > FAR)
    unseen = ~np.isfinite(pixels).all(axis=1)
    why = ["lost by the first camera", "lost by the second camera", "the two rays miss each other"]
    flag = np.select([unseen, lost, apart], why, "")
    if apart.any():
        text = f"{np.count_nonzero(apart)} of {len(time)} frames: the two rays miss each other by more than {FAR} sigma"
        said = f"{text}; do both follow the same body? check marks and offset too"
        warnings.warn(StageWarning("differs", said), stacklevel=2)
    place, sigma = (np.where((lost | apart)[:, None], np.nan, a) for a in (found.place, found.sigma))
    out = pd.DataFrame({"frame": range(len(time)), "time_s": time})
    for k, axis in enumerate("xyz"):
        out[f"{axis}_m"] = place[:, k]
    for k, axis in enumerate("xyz"):
        out[f"sigma_{axis}_m"], out[f"sigma_common_{axis}_m"] = sigma[:, k], found.common[:, k]
    return with_derivatives(out.assign(miss_sigma=found.miss), place.T, sigma.max(axis=1), "xyz", "m", window).assign(
        flag=flag
    )


def _camera(name: str, pixel: ArrayLike, marks: ArrayLike, lens: bool) -> Pinhole:
    pixel, marks = np.asarray(pixel, float), np.asarray(marks, float)
    if len(pixel) != len(marks):
        text = f"{len(pixel)} pixels of {len(marks)} marks; give one each, in the same order"
        raise InputError([f"jv.triangulate: {name} camera: {text}"])
    try:
        return pinhole(pixel, marks, lens=lens)
    except ValueError as error:
        raise InputError([f"jv.triangulate: {name} camera: {error}"]) from error


def _pixels(table: pd.DataFrame) -> tuple[Array, Array]:
    return table[["x_px", "y_px"]].to_numpy(float), table.sigma_px.to_numpy(float)
