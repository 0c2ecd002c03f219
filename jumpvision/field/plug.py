"""The foot's motion from the grains that it pushes, where nothing else shows it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.field.profile import central_column

Array = NDArray[np.float64]

BELOW = (0.5, 1.5)  # windows below the face between which the grains are taken to move with the foot


class Plug(NamedTuple):
    """foot_y [m] (up, from the first place), foot_v [m/s] (up) and their standard uncertainties, shape (nt,)."""

    foot_y: Array
    foot_y_sigma: Array
    foot_v: Array
    foot_v_sigma: Array


def follow_plug(
    v: ArrayLike, v_sigma: ArrayLike, valid: ArrayLike, x: ArrayLike, y: ArrayLike, t: ArrayLike, *, half_width: float,
    window: float, correlation_length: float,
) -> Plug:  # fmt: skip
    """Mean velocity of the vectors just below the face on the axis, and its integral from the face at (0, 0), t[0].

    v, v_sigma [m/s], v up, valid [bool]: (ny, nx, nt); y (ny,) up and x (nx,) [m] from the face and axis at t[0];
    t (nt,) [s]. half_width [m] of the column; window [m]: side of the matched windows. NaN from the first time on that
    has no vector there. It is the foot only while the foot pushes grains: grains do not follow a foot that rises.
    """
    v, s, y, t = (np.asarray(a, dtype=float) for a in (v, v_sigma, y, t))
    ok = np.asarray(valid, dtype=bool)
    out = Plug(*(np.full(t.size, np.nan) for _ in Plug._fields))
    face = variance = 0.0
    for k in range(t.size):
        near = (y < face - BELOW[0] * window) & (y > face - BELOW[1] * window)
        down, sigma = central_column(
            v[near, :, k],
            s[near, :, k],
            ok[near, :, k],
            x,
            half_width=half_width,
            correlation_length=correlation_length,
        )
        rows = np.isfinite(down)
        if not rows.any():
            break
        speed = -float(np.mean(down[rows]))
        spread = float(np.max(sigma[rows]))  # the rows lie within one window: their errors are alike
        if k:
            half = 0.5 * (t[k] - t[k - 1])
            face += half * (speed + out.foot_v[k - 1])
            variance += half**2 * (spread**2 + out.foot_v_sigma[k - 1] ** 2)
        for a, value in zip(out, (face, np.sqrt(variance), speed, spread)):
            a[k] = value
    return out


def scatter_sigma(f: ArrayLike, valid: ArrayLike, correlation_length: float) -> float:
    """Standard uncertainty of one vector component from the second differences of neighbours along a row.

    f, valid: (ny, nx), any unit. Errors of neighbours are alike as far as their windows overlap (`field.correlation`).
    The median of the differences keeps bands of shear out; what the flow itself curves over three vectors adds to it.
    NaN where fewer than 10 triples are valid.
    """
    f, ok = np.asarray(f, dtype=float), np.asarray(valid, dtype=bool)
    whole = ok[:, :-2] & ok[:, 1:-1] & ok[:, 2:]
    second = (f[:, :-2] - 2.0 * f[:, 1:-1] + f[:, 2:])[whole]
    if second.size < 10:
        return float("nan")
    rho = np.maximum(0.0, 1.0 - np.arange(1, 3) / max(1.0, correlation_length))
    return float(np.median(np.abs(second)) / 0.6745 / np.sqrt(6.0 - 8.0 * rho[0] + 2.0 * rho[1]))
