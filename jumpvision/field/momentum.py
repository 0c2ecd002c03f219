"""Downward momentum of the grains and the added mass of the foot (PHYSICS.md section 2, thesis section 3.3.5)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.field.correlation import correlated_variance

Array = NDArray[np.float64]

ANGLE = {"full": 2.0 * math.pi, "half": math.pi}  # rad of the disc that pushes grains: whole, or half at the wall


@dataclass(frozen=True)
class Momentum:
    """value, sigma [kg m/s], positive DOWN. covered: share of the bed's volume in view that was measured or filled;
    grains outside that share are not in the value."""

    value: float
    sigma: float
    covered: float


def grain_momentum(
    v: ArrayLike,
    x: ArrayLike,
    y: ArrayLike,
    v_sigma: ArrayLike,
    valid: ArrayLike,
    bed: ArrayLike,
    *,
    density: float,
    volume_fraction: float,
    axis_x: float,
    disc: str,
    max_hole: int,
    correlation_length: float,
) -> Momentum:
    """P = -rho phi c int int v r dr dh, c = 2 pi for a full disc and pi for a half foot at the wall.

    v, v_sigma [m/s], v positive UP (so the value, positive down, has the opposite sign): shape (ny, nx). x (nx,), y (ny,)
    [m] strictly monotonic cell centres. valid: vectors to trust. bed [bool]: cells that hold grains, so neither above
    the surface nor the foot itself. density rho [kg/m^3] of the grain material. axis_x [m]: the foot's axis.

    Both half planes are measured and azimuthal symmetry is assumed: radii seen on both sides are averaged, radii seen on
    one side only count in full. Every cell is weighted with its exact int r dr.

    Holes of up to max_hole cells in a row of the bed are filled by linear interpolation between the two vectors beside
    them. Each filled value carries, besides the errors of those two, half their difference over sqrt(3) (it may lie
    anywhere between them), fully correlated inside the hole. Larger holes and holes at an edge stay empty and lower
    `covered`. correlation_length: window width / grid step (`field.correlation`). The sigma does not hold the errors of
    rho, phi, the scale and the axis, which are common to all frames.
    """
    v, x, y = (np.asarray(a, dtype=float) for a in (v, x, y))
    sigma = np.asarray(v_sigma, dtype=float)
    inside = np.asarray(bed, dtype=bool)
    ok = np.asarray(valid, dtype=bool)
    for name, a in (("v_sigma", sigma), ("valid", ok), ("bed", inside)):
        if v.ndim != 2 or a.shape != v.shape:
            raise ValueError(f"grain_momentum: {name} has shape {a.shape}, v has {v.shape}; both must be (ny, nx)")
    if disc not in ANGLE:
        raise ValueError(f"grain_momentum: disc = {disc!r} must be 'half' (foot flush with the wall) or 'full'")
    ok = ok & inside & np.isfinite(v) & np.isfinite(sigma)
    if np.any(sigma[ok] < 0.0):
        raise ValueError("grain_momentum: v_sigma has a negative value at a valid vector")
    weight = np.abs(_widths("y", y, v.shape[0]))[:, None] * _ring(x, v.shape[1], axis_x)[None, :]
    weight = density * volume_fraction * ANGLE[disc] * weight

    total = float(weight[inside].sum())
    if not ok.any() or total == 0.0:
        return Momentum(math.nan, math.nan, 0.0)
    effective = np.where(ok, weight, 0.0)  # P = -sum effective v over the measured cells, filled holes shared out
    held, hole_var = float(effective.sum()), 0.0
    for i in range(v.shape[0]):
        for a, b in _holes(ok[i], inside[i], max_hole):
            k = np.arange(a + 1, b)
            share = (x[k] - x[a]) / (x[b] - x[a])
            w = weight[i, k]
            effective[i, a] += float(np.sum(w * (1.0 - share)))
            effective[i, b] += float(np.sum(w * share))
            held += float(w.sum())
            hole_var += (float(w.sum()) * (v[i, b] - v[i, a])) ** 2 / 12.0
    value = -float(np.sum(effective[ok] * v[ok]))
    noise = correlated_variance(np.where(ok, effective * np.where(ok, sigma, 0.0), 0.0), correlation_length)
    return Momentum(value, math.sqrt(noise + hole_var), held / total)


def added_mass(
    momentum: ArrayLike,
    momentum_sigma: ArrayLike,
    foot_speed: ArrayLike,
    foot_speed_sigma: ArrayLike,
    *,
    min_speed: float,
    min_ratio: float,
) -> tuple[Array, Array]:
    """(m_a, sigma) [kg] = P / v_foot; momentum [kg m/s] and foot_speed [m/s] both positive DOWN, any common shape.

    NaN where |v_foot| < min_speed [m/s] or < min_ratio of its own sigma: the quotient is singular there, and no value
    with a symmetric uncertainty exists. P and v_foot are taken as independent.
    """
    p, ps, v, vs = (np.asarray(a, dtype=float) for a in (momentum, momentum_sigma, foot_speed, foot_speed_sigma))
    use = (np.abs(v) >= min_speed) & (np.abs(v) >= min_ratio * vs) & (v != 0.0)
    v = np.where(use, v, np.nan)
    mass = p / v
    return mass, np.hypot(ps, mass * vs) / np.abs(v)


def _edges(name: str, x: Array, size: int) -> Array:
    step = np.diff(x)
    if x.shape != (size,) or size < 2 or not (np.all(step > 0.0) or np.all(step < 0.0)):
        raise ValueError(f"grain_momentum: {name} must be strictly monotonic with shape ({size},), got shape {x.shape}")
    return np.concatenate(([x[0] - 0.5 * step[0]], 0.5 * (x[1:] + x[:-1]), [x[-1] + 0.5 * step[-1]]))


def _widths(name: str, x: Array, size: int) -> Array:
    return np.diff(_edges(name, x, size))


def _ring(x: Array, size: int, axis_x: float) -> Array:
    """int w r dr of each cell [m^2], w = 1/2 at radii seen on both sides of the axis and 1 at those seen on one."""
    e = _edges("x", x, size) - axis_x
    lo, hi = float(e.min()), float(e.max())
    both = max(0.0, min(-lo, hi))  # radii up to here are in view on both sides

    def primitive(r: Array) -> Array:
        a = np.abs(r)
        inner = np.minimum(a, both)
        return np.sign(r) * (0.25 * inner**2 + 0.5 * (a**2 - inner**2))

    return np.abs(np.diff(primitive(e)))


def _holes(ok: NDArray[np.bool_], inside: NDArray[np.bool_], max_hole: int) -> list[tuple[int, int]]:
    """Pairs of neighbouring valid cells of a row with 1..max_hole bed cells, and nothing but bed, between them."""
    at = np.flatnonzero(ok)
    return [(int(a), int(b)) for a, b in zip(at[:-1], at[1:]) if 1 < b - a <= max_hole + 1 and inside[a:b].all()]
