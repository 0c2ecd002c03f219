"""The velocity field of discs on a grid: coarse graining with a Gaussian, laid out as the field that PIV measures.

    rho(r) = sum m_i W(r - r_i),   v(r) = sum m_i v_i W(r - r_i) / rho(r)

(Goldhirsch, Granular Matter 12, 239, 2010), W a Gaussian of standard deviation w, cut off at 3 w. The mass-weighted
mean conserves momentum: the integral of rho v over everything is the momentum of the discs.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numba as nb
import numpy as np
from numpy.typing import ArrayLike

from jumpvision import __version__
from jumpvision.base.arrays import Array

if TYPE_CHECKING:
    import xarray as xr


CUT = 3.0  # widths
LEAST_SIGMA = 1e-3  # of the greatest speed: discs at rest must not weigh without bounds
SPARSE = 0.5  # share of the median density below which a place holds no vector: beyond the free surface, in a hole


class Coarse(NamedTuple):
    """density [kg/m^2], u, v [m/s] and their standard uncertainties of shape (ny, nx); NaN where no disc is near.

    The uncertainty is that of the local mean as an estimate of the flow: the weighted scatter of the discs' velocities
    over the square root of their effective number (one disc alone has none: NaN).
    """

    density: Array
    u: Array
    v: Array
    u_sigma: Array
    v_sigma: Array


def coarse_grain(
    x: ArrayLike,
    y: ArrayLike,
    vx: ArrayLike,
    vy: ArrayLike,
    mass: ArrayLike,
    *,
    grid_x: ArrayLike,
    grid_y: ArrayLike,
    width: float,
) -> Coarse:
    """Fields on grid_x (nx,), grid_y (ny,) [m], each equally spaced and increasing; discs (n,) [m], [m/s], [kg].

    width [m]: standard deviation of the kernel.
    """
    gx, gy = np.asarray(grid_x, dtype=float), np.asarray(grid_y, dtype=float)
    for name, g in (("grid_x", gx), ("grid_y", gy)):
        if g.ndim != 1 or g.size < 2 or np.ptp(np.diff(g)) > 1e-6 * abs(g[1] - g[0]) or not g[1] > g[0]:
            raise ValueError(f"coarse_grain: {name} must be equally spaced and increasing")
    if not width > 0.0:
        raise ValueError(f"coarse_grain: width = {width!r} m must be > 0; a grain's diameter is a good one")
    sums = np.zeros((6, gy.size, gx.size))
    state = np.stack([np.asarray(a, dtype=float) for a in (x, y, vx, vy, mass)], axis=1)
    _spread(state, gx[0], gx[1] - gx[0], gy[0], gy[1] - gy[0], width, sums)
    m, mu, mv, muu, mvv, ww = sums
    with np.errstate(invalid="ignore", divide="ignore"):
        u, v, n = mu / m, mv / m, m * m / ww
        spread = [np.sqrt(np.maximum(q / m - a * a, 0.0) / (n - 1.0)) for q, a in ((muu, u), (mvv, v))]
    alone = ~(n > 1.0 + 1e-9)
    return Coarse(m, u, v, *(np.where(alone, np.nan, s) for s in spread))


@nb.njit(cache=True)
def _spread(state, x0, dx, y0, dy, width, sums):  # type: ignore[no-untyped-def]
    whole = 1.0 - math.exp(-0.5 * CUT * CUT)  # of the Gaussian inside the cut
    norm, reach = 1.0 / (2.0 * math.pi * width * width * whole), CUT * width
    ny, nx = sums.shape[1:]
    for k in range(len(state)):
        x, y, u, v, m = state[k]
        for i in range(max(math.ceil((y - reach - y0) / dy), 0), min(math.floor((y + reach - y0) / dy) + 1, ny)):
            for j in range(max(math.ceil((x - reach - x0) / dx), 0), min(math.floor((x + reach - x0) / dx) + 1, nx)):
                d2 = (x0 + j * dx - x) ** 2 + (y0 + i * dy - y) ** 2
                if d2 < reach * reach:
                    w = m * norm * math.exp(-0.5 * d2 / (width * width))
                    sums[0, i, j] += w
                    sums[1, i, j] += w * u
                    sums[2, i, j] += w * v
                    sums[3, i, j] += w * u * u
                    sums[4, i, j] += w * v * v
                    sums[5, i, j] += w * w


def as_piv(
    t: ArrayLike,
    x: ArrayLike,
    y: ArrayLike,
    mass: ArrayLike,
    foot_y: ArrayLike,
    *,
    grid_x: ArrayLike,
    grid_y: ArrayLike,
    width: float,
) -> xr.Dataset:
    """The data set of `piv.nc` from places x, y (T, n) [m] at the times t (T,) [s] and the foot's face foot_y (T,) [m].

    As a camera sees them: the velocity between two times is the displacement over their distance and belongs to
    mid-time and mid-way. Heights count from the foot's face at the first time, x from its axis. chc = 0 where there
    are few discs and above the foot's face. width [m]: standard deviation of the kernel; it acts like a square window
    of sqrt(12) width, which stands in `window_px` with the grid step as the pixel.
    """
    import xarray as xr

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
    data = xr.Dataset(
        {k: (("y", "x", "t"), cube[k], {"units": "m/s"}) for k in ("u", "v", "u_sigma", "v_sigma")}
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
        attrs={
            "delta_t": float(np.median(dt)),
            "files": [],
            "pivpy_schema_version": "1",
            "source": f"jumpvision {__version__}, discs",
            "scale_m_per_px": step,
            "window_px": math.sqrt(12.0) * width / step,
            "error_px": math.sqrt(12.0) * width / step,
            "step_px": 1,
            "image_rows": gy.size,
            "image_columns": gx.size,
            "origin_column_px": -gx[0] / step,
            "origin_row_px": (gy[-1] - origin) / step,
            "kernel": f"Gaussian of {width:g} m, cut at {CUT:g} of it",
        },
    )
    data["u"].attrs["standard_name"], data["v"].attrs["standard_name"] = "u_velocity", "v_velocity"
    return data.sortby("y", ascending=False)
