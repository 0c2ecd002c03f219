"""Downward momentum of the grains and the added mass of the foot (docs/physics.md section 4, thesis section 3.3.5)."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import Array
from jumpvision.films.calibration import ONE_SIDED

from .gradients import correlated_variance
from .grid import Plane

ANGLE = {"full": 2.0 * math.pi, "half": math.pi}  # rad of the disc that pushes grains: whole, or half at the wall
PUSHING = 0.5  # of the foot's speed: slower grains under it are not pushed by it (it is in the air, or has a gap below)
MIN_RATIO = 5.0  # foot speed / its sigma below which P / v is left out: it has no symmetric uncertainty there


class Momentum(NamedTuple):
    """value, sigma [kg m/s], positive DOWN. covered: share of the domain's volume that was measured or filled.

    Grains outside that share are not in the value. one_sided [kg m/s]: standard uncertainty that sigma does not hold,
    of one sign in all frames.
    """

    value: float
    sigma: float
    covered: float
    one_sided: float = 0.0


class Domain(NamedTuple):
    """Where momentum is summed up [m]: top is the foot's face (vectors above it do not count); bottom, left and right
    the edges of the picture or of the bed. axis: x of the foot's axis."""

    top: float
    bottom: float
    left: float
    right: float
    axis: float = 0.0


class Foot(NamedTuple):
    """radius [m] and velocity [m/s], positive up."""

    radius: float
    velocity: float


def grain_momentum(
    plane: Plane,
    domain: Domain,
    *,
    bulk_density: float,
    disc: str,
    correlation_length: float,
    error_length: float | None = None,
    foot: Foot | None = None,
) -> Momentum:
    """P = -rho phi c int int v r dr dh over left..right, bottom..top; c = 2 pi for a full disc, pi for a half foot.

    plane: v positive UP (the value, positive down, has the opposite sign). bulk_density rho phi [kg/m^3] of the bed.
    correlation_length: window width / grid step (`grains.gradients`); error_length: the same for the errors, where
    smoothing has made them alike over more than a window. foot: where known.

    Both half planes are measured and azimuthal symmetry is assumed: radii seen on both sides are averaged, radii seen
    on one side only count in full. Every cell is weighted with its exact int r dr inside the domain, and the outermost
    cells reach as far as their windows do, half a window from the centre. Missing vectors:

    - holes along a row narrower than a window (at least one cell) are interpolated linearly. A filled value carries,
      besides the errors of the two vectors beside it, their difference over sqrt(12) (it may lie anywhere between
      them), common to the cells of one hole;
    - cells within half a window of the next vector in their column (the gap below the foot's face) are extrapolated
      with the slope over the half window beyond it, where that is measured, else take its value; what the slope adds
      counts as uncertain by 1/sqrt(3) of itself, common to all such cells;
    - a foot that pushes (PUSHING) cannot pass through grains: where the slope would leave them slower than it at its
      face, they are interpolated linearly to its velocity there; the difference over sqrt(12), common to all;
    - the border of the picture beyond the outermost cells (half a window, and what the grid leaves over, less than a
      step) takes the value of the nearest vector; what the slope beside it would change there counts as uncertain by
      1/sqrt(3), common to all of the border;
    - the rest stays empty and lowers `covered`.

    Errors of vectors average out but for ONE_SIDED of what the flow makes of them (their sigma beyond that of the
    calmest quarter): where grains move one by one the slower side of a window matches better, everywhere alike. That is
    in `one_sided`.

    The sigma does not hold the errors of rho, phi, the scale and the axis, which are common to all frames.
    """
    v, sigma, ok, x, y = _checked(plane, domain, disc)
    top, bottom, left, right, axis = domain
    half = 0.5 * max(1.0, correlation_length)  # of a window, in grid steps
    factor = bulk_density * ANGLE[disc]

    def heights(reach: float) -> Array:
        return np.clip(_edges("y", y, v.shape[0], reach), bottom, top)

    def weights(reach: float) -> Array:
        height = np.abs(np.diff(heights(reach)))
        edges = np.clip(_edges("x", x, v.shape[1], reach), left, right) - axis
        return np.asarray(factor * height[:, None] * _ring(edges)[None, :])

    weight = weights(half + 1.0)  # the windows, and what the grid leaves beyond them
    total = factor * (top - bottom) * 0.5 * max(axis - left, right - axis, 0.0) ** 2
    if not ok.any() or not total > 0.0:
        return Momentum(math.nan, math.nan, 0.0)
    sums = _Sums(weight, v, ok)
    sums.fill_holes(x, max(2.0, 2.0 * half))
    sums.drift = _border_drift(weight - weights(0.5), v, ok, 0.5 * half + 0.75)
    inside = heights(half + 1.0)
    middle = 0.5 * (inside[1:] + inside[:-1])  # of the part of a cell below the face
    sums.fill_gap(y, middle, top, math.ceil(half), *_pushed(v, ok, x - axis, y, foot))
    noise = correlated_variance(
        np.where(ok, sums.shares * np.where(ok, sigma, 0.0), 0.0), error_length or correlation_length
    )
    value = -float(np.sum(sums.shares[ok] * v[ok])) - sums.at_face
    of_flow = np.sqrt(np.maximum(sigma[ok] ** 2 - np.quantile(sigma[ok], 0.25) ** 2, 0.0))
    one_sided = ONE_SIDED.value * float(np.sum(np.abs(sums.shares[ok]) * of_flow))
    variance = noise + sums.hole_variance + sums.drift**2 / 3.0 + sums.bridged**2 / 12.0
    return Momentum(value, math.sqrt(variance), sums.held / total, one_sided)


class _Sums:
    """P = -sum shares v over the measured cells, filled cells shared out to them, and by what the filling may be off.

    weight: of each cell, v, ok: measured, (ny, nx). held: weight of what is measured or filled.
    """

    def __init__(self, weight: Array, v: Array, ok: NDArray[np.bool_]):
        self.weight, self.v, self.ok = weight, v, ok
        self.shares, self.filled = np.where(ok, weight, 0.0), ok.copy()
        self.held = self.hole_variance = self.drift = self.at_face = self.bridged = 0.0

    def fill_holes(self, x: Array, widest: float) -> None:
        """Cells between two vectors of a row less than `widest` steps apart."""
        weight, v, shares = self.weight, self.v, self.shares
        for i in range(v.shape[0]):
            for a, b in pairwise(np.flatnonzero(self.ok[i]).tolist()):
                if not 1 < b - a <= widest:
                    continue
                k = np.arange(a + 1, b)
                part, w = (x[k] - x[a]) / (x[b] - x[a]), weight[i, k]
                shares[i, a] += float(np.sum(w * (1.0 - part)))
                shares[i, b] += float(np.sum(w * part))
                self.filled[i, k] = True
                self.hole_variance += (float(w.sum()) * (v[i, b] - v[i, a])) ** 2 / 12.0
        self.held = float(weight[self.filled].sum())

    def fill_gap(self, y: Array, middle: Array, top: float, base: int, under: NDArray[np.bool_], rising: float) -> None:
        """Cells up to `base` steps from the next vector in their column. middle (ny,): height of each row's cells
        below the face at `top`; under (nx,): columns under a foot that pushes, rising: its velocity."""
        weight, v, ok, shares = self.weight, self.v, self.ok, self.shares
        for i, j in zip(*np.nonzero(~self.filled & (weight > 0.0))):
            at = np.flatnonzero(ok[:, j])
            near = int(at[np.argmin(np.abs(at - i))]) if at.size else -1
            if near < 0 or abs(near - i) > max(1, base):
                continue
            far = near + base * (1 if near > i else -1)
            there = 0 <= far < y.size and ok[far, j]
            slope = (v[near, j] - v[far, j]) / (y[near] - y[far]) if there else 0.0
            self.held += float(weight[i, j])
            if under[j] and y[i] > y[near] and v[near, j] + slope * (top - y[near]) > rising:
                part = weight[i, j] * (middle[i] - y[near]) / (top - y[near])
                shares[near, j] += weight[i, j] - part
                self.at_face += float(part * rising)
                self.bridged += float(weight[i, j] * (rising - v[near, j]))
                continue
            reach = (middle[i] - y[near]) / (y[near] - y[far]) if there else 0.0
            shares[near, j] += weight[i, j] * (1.0 + reach)
            if reach:
                shares[far, j] -= weight[i, j] * reach
                self.drift += float(weight[i, j] * reach * (v[near, j] - v[far, j]))


def _checked(plane: Plane, domain: Domain, disc: str) -> tuple[Array, Array, NDArray[np.bool_], Array, Array]:
    """v, sigma, which vectors count, x, y as arrays; ValueError where they, the domain or the disc make no sense."""
    v, x, y = (np.asarray(a, dtype=float) for a in (plane.v, plane.x, plane.y))
    sigma, ok = np.asarray(plane.sigma, dtype=float), np.asarray(plane.valid, dtype=bool)
    for name, field in (("sigma", sigma), ("valid", ok)):
        if v.ndim != 2 or field.shape != v.shape:
            raise ValueError(f"grain_momentum: {name} has shape {field.shape}, v has {v.shape}; both must be (ny, nx)")
    if disc not in ANGLE:
        raise ValueError(f"grain_momentum: disc = {disc!r} must be 'half' (foot flush with the wall) or 'full'")
    top, bottom, left, right, _ = domain
    if not (bottom < top and left < right):
        raise ValueError(
            f"grain_momentum: empty domain: bottom {bottom:g}, top {top:g}, left {left:g}, right {right:g} m"
        )
    ok = ok & np.isfinite(v) & np.isfinite(sigma) & (y < top)[:, None]
    if np.any(sigma[ok] < 0.0):
        raise ValueError("grain_momentum: sigma has a negative value at a valid vector")
    return v, sigma, ok, x, y


def peak_momentum(momentum: ArrayLike, added_mass: ArrayLike) -> int | None:
    """Index of the time with the greatest momentum of the grains, (t,), among those that have an added mass; None where
    none has."""
    known = np.isfinite(np.asarray(added_mass, dtype=float))
    return int(np.nanargmax(np.where(known, np.asarray(momentum, dtype=float), -np.inf))) if known.any() else None


def added_mass(
    momentum: ArrayLike,
    momentum_sigma: ArrayLike,
    foot_speed: ArrayLike,
    foot_speed_sigma: ArrayLike,
    *,
    min_speed: float,
) -> tuple[Array, Array]:
    """(m_a, sigma) [kg] = P / v_foot; momentum [kg m/s] and foot_speed [m/s] both positive DOWN, any common shape.

    NaN where |v_foot| < min_speed [m/s] or < MIN_RATIO of its own sigma: the quotient is singular there; a masked value
    is honest, a clipped one is not. P and v_foot are taken as independent.
    """
    p, ps, v, vs = (np.asarray(a, dtype=float) for a in (momentum, momentum_sigma, foot_speed, foot_speed_sigma))
    use = (np.abs(v) >= min_speed) & (np.abs(v) >= MIN_RATIO * vs) & (v != 0.0)
    v = np.where(use, v, np.nan)
    mass = p / v
    return mass, np.hypot(ps, mass * vs) / np.abs(v)


def _pushed(v: Array, ok: NDArray[np.bool_], r: Array, y: Array, foot: Foot | None) -> tuple[NDArray[np.bool_], float]:
    """Columns (nx,) under a foot that pushes grains, and its velocity; none where the uppermost vectors lag behind."""
    none = np.zeros(r.size, bool)
    if foot is None or not (math.isfinite(foot.velocity) and foot.velocity < 0.0):
        return none, 0.0
    under = (np.abs(r) < foot.radius) & ok.any(0)
    uppermost = v[np.argmax(np.where(ok, y[:, None], -np.inf), axis=0), np.arange(r.size)][under]
    pushes = uppermost.size and np.median(uppermost) < PUSHING * foot.velocity
    return (under, foot.velocity) if pushes else (none, 0.0)


def _edges(name: str, x: Array, size: int, half: float) -> Array:
    """Cell borders (size + 1,): halfway between centres, the outer two `half` steps from theirs."""
    step = np.diff(x)
    if x.shape != (size,) or size < 2 or not (np.all(step > 0.0) or np.all(step < 0.0)):
        raise ValueError(f"grain_momentum: {name} must be strictly monotonic with shape ({size},), got shape {x.shape}")
    return np.concatenate(([x[0] - half * step[0]], 0.5 * (x[1:] + x[:-1]), [x[-1] + half * step[-1]]))


def _border_drift(border: Array, v: Array, ok: NDArray[np.bool_], way: float) -> float:
    """What the slopes at the edge of the grid would change in the border's share, on average `way` steps beyond it."""
    total = 0.0
    for edge, inner in (
        (np.s_[0], np.s_[1]),
        (np.s_[-1], np.s_[-2]),
        (np.s_[:, 0], np.s_[:, 1]),
        (np.s_[:, -1], np.s_[:, -2]),
    ):
        both = ok[edge] & ok[inner]
        total += way * abs(float(np.sum((border[edge] * (v[edge] - v[inner]))[both])))
    return total


def _ring(edges: Array) -> Array:
    """int w r dr [m^2] between neighbouring edges (from the axis), w = 1/2 at radii seen on both sides, 1 on one."""
    both = max(0.0, min(-float(edges.min()), float(edges.max())))  # radii up to here are in view on both sides
    outer = np.abs(edges)
    inner = np.minimum(outer, both)
    return np.abs(np.diff(np.sign(edges) * (0.25 * inner**2 + 0.5 * (outer**2 - inner**2))))
