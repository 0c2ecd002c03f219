"""Sides of the jammed cone: bands of shear, the outline of what moves with the foot, and where grains begin to lag."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import FROM_MAD, Array

from .gradients import correlated_variance
from .grid import Plane

REACH = 2  # vectors on each side of the greatest shear rate through which its parabola is laid
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


class Layer(NamedTuple):
    """Rows between the depths top and bottom [m] below the foot's face, which is at y = face [m], y up."""

    face: float
    top: float
    bottom: float

    def depths(self, y: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Depth of each row [m], and which rows lie in the layer."""
        depth = self.face - y
        return depth, (depth >= self.top) & (depth <= self.bottom)


def shear_bands(
    rate: ArrayLike,
    sigma: ArrayLike,
    x: ArrayLike,
    y: ArrayLike,
    layer: Layer,
    *,
    reach: float,
    correlation_length: float,
) -> Sides:
    """Ridges in the rows of the layer, with |x| < reach [m], and their lines.

    rate, sigma [1/s]: shear rate and its standard uncertainty, (ny, nx), NaN where unknown. x (nx,), y (ny,) [m],
    y up, x from the foot's axis, equally spaced. correlation_length: window over grid step, the rows over which errors
    of places are alike. A row's ridge is the vertex of a parabola through the 2 REACH + 1 rates around the greatest
    one on that side. Rows below the jammed cone have no band of it: the layer must not exceed the cone's height.
    """
    rate, sigma, x, y = (np.asarray(a, dtype=float) for a in (rate, sigma, x, y))
    (depth, rows), step = layer.depths(y), float(np.abs(x[1] - x[0]))
    places = np.full((2, y.size), np.nan)
    for i in np.flatnonzero(rows):
        for side, sign in enumerate((-1.0, 1.0)):
            places[side, i] = _ridge(rate[i], sigma[i], sign * x, reach, step)
    return _lines(places, depth, step, correlation_length)


def cone_outline(plane: Plane, layer: Layer, *, speed: float, reach: float, correlation_length: float) -> Sides:
    """Where the grains' downward speed falls through `speed` [m/s] on the way outwards, and its two lines.

    The rest as in `shear_bands`. Grains inside move with the foot (thesis: 0.9 of its
    speed). Between two vectors the speed is taken as linear.
    """
    v, x, y = (np.asarray(a, dtype=float) for a in (plane.v, plane.x, plane.y))
    (depth, rows), step = layer.depths(y), float(np.abs(x[1] - x[0]))
    down, places = np.where(np.asarray(plane.valid, bool), -v, np.nan), np.full((2, y.size), np.nan)
    for i in np.flatnonzero(rows):
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
    noise = max(FROM_MAD * float(np.median(np.abs(at - design @ start))), 1e-3 * step)
    fit = scipy.optimize.least_squares(lambda p: (at - design @ p) / (SOFT * noise), start, loss="soft_l1")
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
    # a row whose shear rate is below 4 sigma has no ridge
    if near[0] < 0 or near[-1] >= r.size or not np.isfinite(rate[near]).all() or rate[j] < 4.0 * sigma[j]:
        return math.nan
    k = np.arange(-REACH, REACH + 1, dtype=float)
    bend, slope, _ = np.polyfit(k, rate[near], 2)
    shift = -0.5 * slope / bend if bend < 0.0 else math.nan
    if not abs(shift) <= REACH:
        return math.nan
    return float(r[j] + shift * step * np.sign(r[min(j + 1, r.size - 1)] - r[max(j - 1, 0)]))


INSIDE, OUTSIDE = 1.5, 1.0  # windows from the line within which vectors count
LEAST_VECTORS = 40  # vectors, for eleven parameters
SHARPER = 1.5  # how much less the blur may be: it is known within about that factor
SHORTEST = 1.5  # windows: depth over which a shorter side has no angle
STEEP = (math.radians(15.0), math.radians(88.0))  # of a side that can be told from the face and from a wall
UNDETERMINED = math.radians(15.0)  # sigma of an angle that says nothing, and could not be propagated linearly
NAN = math.nan


@dataclass(frozen=True)
class ConeSide:
    """theta [rad] against the horizontal, radius [m] at the face, offset [m] of the axis to the right; n vectors.

    theta_sigma, radius_sigma: of the vectors' errors, widened where they scatter more than stated. shift_fitted,
    shift_sharper [rad]: changes of theta if the blur of the field is fitted too, and if it is SHARPER times less; alike
    in all frames, so the larger is a systematic error. blur [m]: the fitted one. reason: why the values are NaN.
    """

    theta: float
    theta_sigma: float
    shift_fitted: float
    shift_sharper: float
    radius: float
    radius_sigma: float
    offset: float
    blur: float
    n: int
    chi2: float
    reason: str = ""


def cone_side(
    plane: Plane,
    layer: Layer,
    *,
    start: tuple[float, float],
    speed: float,
    edge: float,
    window: float,
    blur: float,
    correlation_length: float,
) -> ConeSide:
    """Least squares of v = -V exp(-(a(t) S + (b0 + b1 t) n + c n^2)) around both sides |x - offset| = radius - d/tan.

    d depth below the face, n distance outwards from the side, t position along it: the complete second-order expansion
    of ln(V/v) outside the cone about the middle of its side (a = a0 + a1 t + a2 t^2, the step at the side), nothing
    inside; S (0 inside, 1 outside) and n (0 inside) are blurred by a Gaussian.

    start: (theta [rad], radius [m]). speed [m/s] V, fitted anew. Vectors count in the layer, INSIDE and OUTSIDE windows
    from the side and at |x| < edge [m] (under the foot). window [m]: side of the matched windows; blur [m]: the
    standard deviation of what the matching makes of a step. correlation_length: window over grid step.
    """
    v, sigma, x, y = (np.asarray(a, dtype=float) for a in (plane.v, plane.sigma, plane.x, plane.y))
    depth, rows = layer.depths(y)
    ok = np.asarray(plane.valid, bool) & np.isfinite(v) & (sigma > 0.0) & rows[:, None]
    d, r = np.broadcast_arrays(depth[:, None], x[None, :])
    p = np.array([start[0], start[1], 0.0, speed, 0.02, 0.0, 0.0, 0.3, 0.0, 0.0])
    middle, half = 0.5 * (layer.top + layer.bottom), 0.5 * (layer.bottom - layer.top)
    if not 2.0 * half >= SHORTEST * window:
        return _none(int(ok.sum()), f"the side is shorter than {SHORTEST:g} windows")

    def solved(q: Array, spread: float | None) -> tuple[Array, Array, float]:
        """Parameters, jacobian and chi2 with the blur `spread`, or with it as exp of an eleventh parameter."""

        beneath, beside, down, each = d[near], r[near], -v[near], sigma[near]
        t = (beneath - middle) / half

        def terms(q: Array) -> tuple[Array, Array, Array, Array, Array, Array]:
            """The blur's bell, S, n, the step along the side, what n is multiplied with, and exp(-lag) / sigma."""
            width = math.exp(q[10]) if spread is None else spread
            out = _outwards(q, beneath, beside)
            bell = np.exp(-0.5 * (out / width) ** 2) / math.sqrt(2.0 * math.pi)
            beyond = scipy.special.ndtr(out / width)
            n = (out * beyond + width * bell) / window
            step, fall = q[4] + q[5] * t + q[6] * t * t, q[7] + q[8] * t
            return bell, beyond, n, step, fall, np.exp(-(step * beyond + fall * n + q[9] * n * n)) / each

        def residual(q: Array) -> Array:
            return np.asarray(down / each - q[3] * terms(q)[-1])

        def slopes(q: Array) -> Array:
            width = math.exp(q[10]) if spread is None else spread
            bell, beyond, n, step, fall, share = terms(q)
            sine, cosine, off = math.sin(q[0]), math.cos(q[0]), beside - q[2]
            deeper = fall + 2.0 * q[9] * n
            by_lag = q[3] * share
            by_out = by_lag * (step * bell / width + deeper * beyond / window)
            columns = [
                by_out * ((np.abs(off) - q[1]) * cosine - beneath * sine),
                -sine * by_out,
                -sine * np.sign(off) * by_out,
                -share,
                *(by_lag * beyond * x for x in (1.0, t, t * t)),
                *(by_lag * n * x for x in (1.0, t, n)),
            ]
            if spread is None:
                out = _outwards(q, beneath, beside)
                columns.append(by_lag * bell * (deeper * width / window - step * out / width))
            return np.stack(columns, axis=1)

        scale = np.array([0.05, 1e-3, 1e-3, 0.01 * speed, *(0.1 for _ in q[4:])])
        found = scipy.optimize.least_squares(
            residual, q, slopes, x_scale=scale, loss="soft_l1", f_scale=2.0, ftol=1e-6, max_nfev=60
        )
        return found.x, found.jac, 2.0 * float(found.cost)

    for _ in range(3):  # the vectors are chosen from the line found
        out = _outwards(p, d, r)
        near = ok & (out < OUTSIDE * window) & (out > -INSIDE * window) & (np.abs(r - p[2]) < edge)
        sides = min(np.count_nonzero(near & (r > 0.0)), np.count_nonzero(near & (r < 0.0)))
        if sides < LEAST_VECTORS // 2:
            return _none(
                int(near.sum()), f"{near.sum()} vectors about both sides; {LEAST_VECTORS} are needed, half on each"
            )
        p, jacobian, chi2 = solved(p, blur)
        if not STEEP[0] < p[0] < STEEP[1]:
            return _none(int(near.sum()), "no line at which the grains begin to lag behind the foot")
    n = int(near.sum())
    wide = math.sqrt(max(1.0, chi2 / (n - p.size)))
    angle_sigma, radius_sigma = (wide * s for s in _sigmas(jacobian, near, correlation_length))
    if not angle_sigma < UNDETERMINED:
        return _none(n, "the vectors do not determine the side's angle")
    fitted, sharper = solved(np.append(p, math.log(blur)), None)[0], solved(p, blur / SHARPER)[0]
    if not (STEEP[0] < fitted[0] < STEEP[1] and STEEP[0] < sharper[0] < STEEP[1]):
        return _none(n, "the side cannot be distinguished from a blurred one")
    shifts = float(fitted[0] - p[0]), float(sharper[0] - p[0])
    return ConeSide(
        float(p[0]), angle_sigma, *shifts, float(p[1]), radius_sigma, float(p[2]), math.exp(fitted[10]), n, chi2
    )


def _outwards(p: Array, d: Array, r: Array) -> Array:
    """Distance [m] from the side, positive outside the cone."""
    return np.asarray((np.abs(r - p[2]) - p[1] + d / np.tan(p[0])) * np.sin(p[0]))


def _sigmas(jacobian: Array, near: NDArray[np.bool_], length: float) -> list[float]:
    """Of the first two parameters, from unit errors that are alike as far as windows overlap; NaN: undetermined."""
    size = np.linalg.norm(jacobian, axis=0)
    j = jacobian / np.where(size > 0.0, size, 1.0)
    if not (size > 0.0).all() or np.linalg.cond(j) > 1e6:
        return [NAN, NAN]
    out = []
    for row, scale in zip(np.linalg.pinv(j)[:2], size):
        share = np.zeros(near.shape)
        share[near] = row / scale
        out.append(math.sqrt(correlated_variance(share, length)))
    return out


def _none(n: int, reason: str) -> ConeSide:
    return ConeSide(NAN, NAN, NAN, NAN, NAN, NAN, NAN, NAN, n, NAN, reason)
