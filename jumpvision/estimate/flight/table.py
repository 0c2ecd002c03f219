"""Flights of any body as a table: a ball's bounces, a toss, a drop."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .flights import Flights
from .track import track_flights

if TYPE_CHECKING:
    import pandas as pd

HEIGHTS = {"height_m": "sigma_m", "y_m": "sigma_m", "z_m": "sigma_z_m"}  # columns of tracks, up, and of their noise
GAP = 3.5  # intervals between samples: a longer gap ends a flight


def columns_of(table: pd.DataFrame) -> tuple[Any, Any, Any]:
    """time [s], height [m], sigma [m] or None, of a table with the columns of a track."""
    if "time_s" not in table:
        raise ValueError(f"flights: the table has no column time_s (it has {', '.join(map(str, table.columns))})")
    height = next((c for c in HEIGHTS if c in table), None)
    if height is None:
        raise ValueError(f"flights: the table has none of {', '.join(HEIGHTS)}: a height in metres, up; give t and h")
    sigma = table.get(HEIGHTS[height])
    noise = None if sigma is None else sigma.to_numpy(float)
    return table["time_s"].to_numpy(float), table[height].to_numpy(float), noise


def found_in(t: Any, h: Any, sigma: Any, *, gravity: float, shortest: float, max_gap: float | None) -> Flights:
    """Flights of heights h (n,) [m] at t (n,) [s]; sigma: (n,), one number, or None: as the record scatters."""
    t, h = np.asarray(t, float), np.asarray(h, float)
    if sigma is not None:
        sigma = np.broadcast_to(np.asarray(sigma, float), h.shape)
    steps = np.diff(t[np.isfinite(t) & np.isfinite(h)])
    gap = GAP * float(np.median(steps)) if max_gap is None and steps.size else max_gap or np.inf
    return track_flights(t, h, sigma, gravity=gravity, shortest=shortest, max_gap=gap)


def as_table(found: Flights, gravity: float) -> pd.DataFrame:
    """A row a flight."""
    import pandas as pd

    time, sigma = found.time, found.time_sigma
    ends = np.array(found.kinds, dtype=object).reshape(-1, 2)
    return pd.DataFrame(
        {
            "lift_off_s": found.lift_off,
            "lift_off_sigma_s": found.lift_off_sigma,
            "landing_s": found.landing,
            "landing_sigma_s": found.landing_sigma,
            "time_s": time,
            "time_sigma_s": sigma,
            "height_m": gravity * time**2 / 8.0,
            "height_sigma_m": gravity * time / 4.0 * sigma,
            "curvature_m_s2": found.curvature,
            "curvature_sigma_m_s2": found.curvature_sigma,
            "begins": ends[:, 0],
            "ends": ends[:, 1],
        }
    )
