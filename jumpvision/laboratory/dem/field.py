"""The velocity field of discs on a grid: coarse graining with a Gaussian.

    rho(r) = sum m_i W(r - r_i),   v(r) = sum m_i v_i W(r - r_i) / rho(r)

(Goldhirsch, Granular Matter 12, 239, 2010), W a Gaussian of standard deviation w, cut off at 3 w. The mass-weighted
mean conserves momentum: the integral of rho v over everything is the momentum of the discs.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array

CUT = 3.0  # widths


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
