"""`jv.triangulate`: one body in space from two cameras' tables."""

from __future__ import annotations

import cv2
import numpy as np
import pandas as pd
import scipy
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError
from jumpvision.films.calibration import CLICKED_MARK

from .motion import with_derivatives

COLUMNS = ["time_s", "x_px", "y_px", "sigma_px"]  # what two cameras' tables must have
MAX_MISS_SIGMA = 5.5  # by which the rays of one body miss each other: chance 4e-8
WHY = "lost by the first camera", "lost by the second camera", "the two rays miss each other: not the same body"


def triangulate(
    first: pd.DataFrame,
    second: pd.DataFrame,
    marks: ArrayLike,
    seen_first: ArrayLike,
    seen_second: ArrayLike,
    *,
    offset: float = 0.0,
    window: int = 7,
) -> pd.DataFrame:
    """Find one body in space from two cameras: a row a frame of the first camera.

    first, second: tables with time_s, x_px, y_px, sigma_px, as `jv.track` gives (x right, y down, no axes needed), of
    pictures without distortion. marks: (n, 3) [m], n >= 6, places that both cameras saw, not in one plane; seen_first,
    seen_second: (n, 2) column, row [px] of them. offset [s]: what is added to the second camera's clock. window: as in
    `jv.track`.

    Columns: frame, time_s; x_m, y_m, z_m in the axes of the marks; sigma_x_m ... independent from frame to frame;
    sigma_common_x_m ... of the calibration, shared by all frames; miss_sigma, by how much the two rays miss each other;
    vx_m_s ... az_m_s2 with v_sigma, a_sigma (of the worst axis); flag: "" or why there is no place (all NaN then).
    Raises InputError for marks or tables that cannot be used.

    Example: jv.triangulate(jv.track(film_a, frame_rate=500), jv.track(film_b, frame_rate=500), marks, seen_a, seen_b)
    """
    if missing := {*COLUMNS} - ({*first.columns} & {*second.columns}):
        raise InputError([f"jv.triangulate: a table without {sorted(missing)}; give what jv.track gives"])
    (p, changes_p), (q, changes_q) = _camera("first", marks, seen_first), _camera("second", marks, seen_second)
    (time, *a, sigma_a), (late, *b, sigma_b) = first[COLUMNS].to_numpy(float).T, second[COLUMNS].to_numpy(float).T
    good, late = np.isfinite(sigma_b), late + offset  # the second's pixels at the first's times: cubics, none at a gap
    known = np.interp(time, late, good, left=0.0, right=0.0) == 1.0
    b = np.where(known, scipy.interpolate.CubicSpline(late[good], np.array(b)[:, good], axis=1)(time), np.nan)
    base, sigma_b = _crossing(p, q, a, b), np.interp(time, late[good], sigma_b[good])
    by_pixels = [_crossing(p, q, a + sigma_a * e, b) for e in np.eye(2)[:, :, None]]
    by_pixels += [_crossing(p, q, a, b + sigma_b * e) for e in np.eye(2)[:, :, None]]
    by_cameras = [_crossing(p + d, q, a, b) for d in changes_p] + [_crossing(p, q + d, a, b) for d in changes_q]
    own, common = (np.sqrt(np.sum((np.array(moved) - base) ** 2, axis=0)) for moved in (by_pixels, by_cameras))
    miss = np.abs(base[3]) / np.hypot(own[3], common[3])
    flag = np.select([np.isnan(sigma_a), np.isnan(miss), miss > MAX_MISS_SIGMA], WHY, "")
    place, sigma = (np.where(flag == "", v[:3], np.nan) for v in (base, own))
    place += np.mean(np.asarray(marks, float), axis=0)[:, None]
    out = pd.DataFrame({"frame": range(len(time)), "time_s": time, **dict(zip(("x_m", "y_m", "z_m"), place))})
    for axis, one, shared in zip("xyz", sigma, common):
        out[f"sigma_{axis}_m"], out[f"sigma_common_{axis}_m"] = one, shared
    return with_derivatives(out.assign(miss_sigma=miss), place, sigma.max(axis=0), "xyz", "m", window).assign(flag=flag)


def _crossing(p: Array, q: Array, a: ArrayLike, b: ArrayLike) -> Array:
    """Return x, y, z [m] where the rays of pixels a, b (2, n) of cameras p, q (3, 4) meet, and a number that is 0
    where they do: (4, n), NaN where a pixel is."""
    rows = np.stack([c[k] - v[:, None] * c[2] for c, vs in ((p, a), (q, b)) for k, v in enumerate(np.asarray(vs))], 1)
    place = cv2.triangulatePoints(p, q, *(np.nan_to_num(v) for v in (a, b)))
    return np.vstack([place[:3] / place[3], np.linalg.det(np.nan_to_num(rows))]) + 0.0 * rows.sum(axis=(1, 2))


def _camera(name: str, marks: ArrayLike, seen: ArrayLike) -> tuple[Array, Array]:
    """Return the camera (3, 4), about the middle of the marks, by the direct linear transformation (Abdel-Aziz & Karara
    1971) with rows in pixels, and 11 independent changes (11, 3, 4) of it by one standard uncertainty."""
    place, pixel = np.asarray(marks, float), np.asarray(seen, float)
    said = f"jv.triangulate: {name} camera: pixels {pixel.shape}, marks {place.shape}: "
    if (place.shape[1:], pixel.shape) != ((3,), (len(place), 2)) or not np.isfinite(np.hstack([place, pixel])).all():
        raise InputError([said + "give (n, 2) of (n, 3), in the same order, all of them finite numbers"])
    ones, depth = np.column_stack([place - place.mean(axis=0), np.ones(len(place))]), np.ones(len(place))
    if len(place) < 6 or np.divide(*np.linalg.svd(ones[:, :3])[1][[2, 0]]) < 1e-2:
        raise InputError([said + "give 6 marks or more, not in one plane or nearly so"])
    rows = np.vstack([np.hstack([np.kron(e, ones), -v[:, None] * ones[:, :3]]) for e, v in zip(np.eye(2), pixel.T)])
    for _ in range(10):  # each takes the depths, by which rows count, from the one before
        design, wanted = rows / np.tile(depth, 2)[:, None], (pixel.T / depth).ravel()
        camera = np.append(np.linalg.lstsq(design, wanted)[0], 1.0)
        depth = ones @ camera[8:]
    if (depth <= 0.0).any() or np.linalg.det(camera.reshape(3, 4)[:, :3]) <= 0.0:  # behind it, or mirrored
        raise InputError([said + "no camera sees them so; are both in the same order, rows counted down?"])
    left, size = design @ camera[:11] - wanted, np.linalg.norm(design, axis=0)
    noise = np.sqrt(left @ left / (left.size - 11)) if left.size >= 14 else CLICKED_MARK.value
    _, s, turned = np.linalg.svd(design / size, full_matrices=False)
    changes = np.column_stack([noise * turned / s[:, None] / size, np.zeros(11)])
    return camera.reshape(3, 4), changes.reshape(11, 3, 4)
