"""Flights of any body from its track, for notebooks."""

from __future__ import annotations

import math
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from .flight import restitution
from .flight.table import as_table, columns_of, found_in
from .readings import looked

if TYPE_CHECKING:
    import pandas as pd


def flights(
    table: Any,
    height_m: ArrayLike | None = None,
    sigma_m: ArrayLike | None = None,
    *,
    gravity: float = 9.81,
    shortest: float = 0.0,
    max_gap: float | None = None,
) -> pd.DataFrame:
    """The free flights of any body, e.g. a ball's bounces, a toss or a drop: a row a flight, in order.

    table: with time_s [s] and height_m (or y_m, z_m) [m], up, as `jv.track` gives with a scale, and sigma_m where it is
    known; or times (n,) [s], then height_m (n,) [m], sigma_m: (n,) or one number, its standard uncertainty, up to
    a factor that the record shows; without it all of it is. NaN samples are left out; a gap longer than max_gap [s]
    (default 3.5 sample intervals) ends a flight. gravity [m/s^2] along the height. Flights shorter than `shortest` [s]
    are left out.

    Columns: lift_off_s, landing_s with lift_off_sigma_s, landing_sigma_s, NaN outside the record; time_s, time_sigma_s
    (with the correlation of the two); height_m = gravity time_s^2 / 8, height_sigma_m; curvature_m_s2, fitted freely,
    curvature_sigma_m_s2; begins, ends: "rest", "impact" (between two flights; its time is fitted with the ground of a
    row of bounces), "support" (a smooth motion met at an angle), "spring", "release", "contact" (none of these: good to
    a sample), "outside".
    `.attrs` holds restitution, (e, sigma) of successive bounces, NaN below two complete ones, and doubts, which say
    what the record contradicts, e.g. a free flight at 11.8 m/s^2 where the scale is wrong, as a Python warning does.
    Raises ValueError for arrays of different lengths, times that do not increase, a sigma that is not above 0.

    Example: jv.flights(jv.track(frames, frame_rate=500, scale=2e-4, origin=(320, 460)))
    """

    given: tuple[Any, Any, Any] = columns_of(table) if height_m is None else (table, height_m, sigma_m)
    t, h, sigma = given[0], np.asarray(given[1], float), given[2]
    if h.ndim == 1 and np.shape(t) == h.shape:
        seen = looked("flights", height_m=h)
        sigma = np.asarray(sigma, float)[seen.kept] if np.shape(sigma) == h.shape else sigma
        t, h = np.asarray(t, float)[seen.kept], seen.columns["height_m"]
    found = found_in(t, h, sigma, gravity=gravity, shortest=shortest, max_gap=max_gap)
    for doubt in found.doubts:
        warnings.warn(doubt, stacklevel=2)
    out, e = as_table(found, gravity), restitution(found, after=-math.inf)
    out.attrs |= {"restitution": (e.value, e.sigma), "doubts": [str(d) for d in found.doubts]}
    return out
