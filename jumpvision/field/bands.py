"""Sides of the jammed cone: bands of shear as ridges of the shear rate, and the outline of what moves with the foot."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

Array = NDArray[np.float64]

REACH = 2  # vectors on each side of the greatest shear rate through which its parabola is laid
LEAST_RIDGE = 4.0  # sigmas of the shear rate below which a row has no ridge
LEAST_ROWS = 4  # on both sides together, beyond the three parameters
SOFT = 1.5  # robust sigmas beyond which a row weighs less


@dataclass(frozen=True)
class Sides:
    """places [m]: |x| on each row, shape (2, ny), left and right of the axis, NaN where there is none.

    theta [rad] against the horizontal, radius [m] at the face, offset [m] of the axis to the right: the two lines
    |x - offset| = radius - depth / tan(theta) through the places. Sigmas; reason: why the values are NaN.
    """

    places: Array
    theta: float
    theta_sigma: float
    radius: float
    radius_sigma: float
    offset: float
    n: int
    reason: str = ""


def shear_bands(
    rate: ArrayLike, sigma: ArrayLike, x: ArrayLike, y: ArrayLike, *, face: float, top: float, bottom: float,
    reach: float, correlation_length: float,
) -> Sides:  # fmt: skip
    """Ridges in the rows between the depths top and bottom [m] below the face, with |x| < reach [m], and their lines.

    rate, sigma [1/s]: shear rate and its standard uncertainty, (ny, nx), NaN where unknown. x (nx,), y (ny,), face [m],
    y up, x from the foot's axis, equally spaced. correlation_length: window over grid step, the rows over which errors
    of places are alike. A row's ridge is the vertex of a parabola through the 2 REACH + 1 rates around the greatest
    one on that side. Rows below the jammed cone have no band of it: bottom must not exceed the cone's height.
    """
    rate, sigma, x, y = (np.asarray(a, dtype=float) for a in (rate, sigma, x, y))
    depth, step = face - y, float(np.abs(x[1] - x[0]))
    places = np.full((2, y.size), np.nan)
    for i in np.flatnonzero((depth >= top) & (depth <= bottom)):
        for side, sign in enumerate((-1.0, 1.0)):
            places[side, i] = _ridge(rate[i], sigma[i], sign * x, reach, step)
    return _lines(places, depth, step, correlation_length)


def cone_outline(
    v: ArrayLike, valid: ArrayLike, x: ArrayLike, y: ArrayLike, *, speed: float, face: float, top: float, bottom: float,
    reach: float, correlation_length: float,
) -> Sides:  # fmt: skip
    """Where the grains' downward speed falls through `speed` [m/s] on the way outwards, and its two lines.

    v [m/s] up and valid: (ny, nx); the rest as in `shear_bands`. Grains inside move with the foot (thesis: 0.9 of its
    speed). Between two vectors the speed is taken as linear.
    """
    v, x, y = (np.asarray(a, dtype=float) for a in (v, x, y))
    down, depth, step = np.where(np.asarray(valid, bool), -v, np.nan), face - y, float(np.abs(x[1] - x[0]))
    places = np.full((2, y.size), np.nan)
    for i in np.flatnonzero((depth >= top) & (depth <= bottom)):
        for side, sign in enumerate((-1.0, 1.0)):
            places[side, i] = _crossing(down[i], sign * x, speed, reach)
    return _lines(places, depth, step, correlation_length)


def _lines(places: Array, depth: Array, step: float, correlation_length: float) -> Sides:
    """Both sides fitted together, rows far off weighing less; sigma: their scatter times sqrt(correlation_length)."""
    side, row = np.nonzero(np.isfinite(places))
    at, d = places[side, row], depth[row]
    if at.size < LEAST_ROWS + 3 or min(np.sum(side == 0), np.sum(side == 1)) < 3 or np.ptp(d) < 2.0 * step:
        reason = f"found in {at.size} rows of both sides; a line needs {LEAST_ROWS + 3}, 3 on each side"
        return Sides(places, math.nan, math.nan, math.nan, math.nan, math.nan, at.size, reason)
    sign = np.where(side == 1, 1.0, -1.0)
    design = np.stack([np.ones(at.size), -d, sign], axis=1)  # radius, 1/tan theta, offset
    start = np.linalg.lstsq(design, at, rcond=None)[0]
    noise = max(1.4826 * float(np.median(np.abs(at - design @ start))), 1e-3 * step)
    fit = least_squares(lambda p: (at - design @ p) / (SOFT * noise), start, loss="soft_l1")
    left = at - design @ fit.x
    weight = 1.0 / np.sqrt(1.0 + (left / (SOFT * noise)) ** 2)
    scatter = float(np.sum(weight * left**2)) / max(weight.sum() - 3.0, 1.0)
    cov = np.linalg.inv((design * weight[:, None]).T @ design) * scatter * max(1.0, correlation_length)
    radius, cot, offset = (float(p) for p in fit.x)
    angle_sigma = math.sqrt(cov[1, 1]) / (1.0 + cot * cot)
    return Sides(places, math.atan2(1.0, cot), angle_sigma, radius, math.sqrt(cov[0, 0]), offset, at.size)


def _crossing(down: Array, r: Array, speed: float, reach: float) -> float:
    """First r > 0, outwards, at which `down` falls below speed; NaN where it starts below or ends above."""
    order = np.argsort(r)
    r, down = r[order], down[order]
    use = (r > 0.0) & (r < reach)
    r, down = r[use], down[use]
    below = np.flatnonzero(~(down >= speed))
    if below.size == 0 or below[0] == 0 or not np.isfinite(down[below[0]]):
        return math.nan
    k = int(below[0])
    return float(r[k - 1] + (down[k - 1] - speed) / (down[k - 1] - down[k]) * (r[k] - r[k - 1]))


def _ridge(rate: Array, sigma: Array, r: Array, reach: float, step: float) -> float:
    """r > 0 of the greatest rate on one side, between vectors; NaN without one that stands out or at the edge."""
    use = (r > 0.0) & (r < reach) & np.isfinite(rate)
    if use.sum() < 2 * REACH + 1:
        return math.nan
    j = int(np.argmax(np.where(use, rate, -np.inf)))
    near = np.arange(j - REACH, j + REACH + 1)
    if near[0] < 0 or near[-1] >= r.size or not np.isfinite(rate[near]).all() or rate[j] < LEAST_RIDGE * sigma[j]:
        return math.nan
    k = np.arange(-REACH, REACH + 1, dtype=float)
    bend, slope, _ = np.polyfit(k, rate[near], 2)
    shift = -0.5 * slope / bend if bend < 0.0 else math.nan
    if not abs(shift) <= REACH:
        return math.nan
    return float(r[j] + shift * step * np.sign(r[min(j + 1, r.size - 1)] - r[max(j - 1, 0)]))
