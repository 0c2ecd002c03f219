"""The field of discs of `laboratory.dem` as the record that stage piv makes, so that flow and column work on it."""

from __future__ import annotations

import math

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from jumpvision import __version__
from jumpvision.experiment.results.fields import Piv
from jumpvision.experiment.stages.grains.vectors import NAMED, WHERE
from jumpvision.films.grains.dataset import described
from jumpvision.films.grains.grid import VectorGrid
from jumpvision.laboratory.dem.field import CUT, Coarse, coarse_grain

LEAST_SIGMA = 1e-3  # of the greatest speed: discs at rest must not weigh without bounds
SPARSE = 0.5  # share of the median density below which a place holds no vector: beyond the free surface, in a hole


def field_of_discs(
    t: ArrayLike,
    x: ArrayLike,
    y: ArrayLike,
    mass: ArrayLike,
    foot_y: ArrayLike,
    *,
    grid_x: ArrayLike,
    grid_y: ArrayLike,
    width: float,
) -> Piv:
    """The record of stage piv from places x, y (T, n) [m] at the times t (T,) [s] and the foot's face foot_y (T,) [m].

    As a camera sees them: the velocity between two times is the displacement over their distance and belongs to
    mid-time and mid-way. Heights count from the foot's face at the first time, x from its axis. chc = 0 where there
    are few discs and above the foot's face. width [m]: standard deviation of the kernel; it acts like a square window
    of sqrt(12) width, which stands in `window_px` with the grid step as the pixel.
    """
    t, x, y, face = (np.asarray(a, dtype=float) for a in (t, x, y, foot_y))
    gx, gy = np.asarray(grid_x, dtype=float), np.asarray(grid_y, dtype=float)
    step, dt, origin = float(gx[1] - gx[0]), np.diff(t), float(face[0])
    fields = [
        coarse_grain(
            0.5 * (x[k] + x[k + 1]),
            0.5 * (y[k] + y[k + 1]),
            (x[k + 1] - x[k]) / dt[k],
            (y[k + 1] - y[k]) / dt[k],
            mass,
            grid_x=gx,
            grid_y=gy,
            width=width,
        )
        for k in range(dt.size)
    ]
    cube = {name: np.stack([getattr(f, name) for f in fields], axis=-1) for name in Coarse._fields}
    mid = 0.5 * (face[1:] + face[:-1])
    enough = cube["density"] > SPARSE * np.median(cube["density"][cube["density"] > 0.0])
    below = gy[:, None, None] < mid
    good = enough & below & np.isfinite(cube["u_sigma"])
    least = LEAST_SIGMA * float(np.nanmax(np.hypot(cube["u"], cube["v"])))
    for name in ("u_sigma", "v_sigma"):
        cube[name] = np.maximum(cube[name], least)
    grid = VectorGrid(
        delta_t=float(np.median(dt)),
        source=f"jumpvision {__version__}, discs",
        scale_m_per_px=step,
        window_px=math.sqrt(12.0) * width / step,
        step_px=1,
        error_correlation_length_px=math.sqrt(12.0) * width / step,
        image_rows=gy.size,
        image_columns=gx.size,
        origin_column_px=-gx[0] / step,
        origin_row_px=(gy[-1] - origin) / step,
    )
    data = xr.Dataset(
        {k: (("y", "x", "t"), cube[k], {"units": "m/s", **NAMED.get(k, {})}) for k in ("u", "v", "u_sigma", "v_sigma")}
        | {
            "chc": (("y", "x", "t"), good.astype(float), {"units": "1"}),
            "density": (("y", "x", "t"), cube["density"], {"units": "kg/m^2"}),
            "foot_y": ("t", mid - origin, {"units": "m"}),
            "foot_y_sigma": ("t", np.zeros(dt.size), {"units": "m"}),
            "foot_v": ("t", np.diff(face) / dt, {"units": "m/s"}),
            "foot_v_sigma": ("t", np.zeros(dt.size), {"units": "m/s"}),
        },
        coords={
            "x": ("x", gx, {"units": "m", "long_name": "right"}),
            "y": ("y", gy - origin, {"units": "m", "long_name": "up"}),
            "t": ("t", 0.5 * (t[1:] + t[:-1]), {"units": "s", "long_name": "mid-time of the pair"}),
        },
    )
    kernel = f"Gaussian of {width:g} m, cut at {CUT:g} of it"
    whole = described(data, grid, matched=False, files=[], where=WHERE, kernel=kernel)
    return Piv(whole.sortby("y", ascending=False))
