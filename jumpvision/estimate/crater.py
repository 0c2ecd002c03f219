"""Volume change of a crater from the height profile along one line through it, and the packing where it is zero."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import FROM_MAD, Array

from .estimate import TWO_SIDED_95, checked, checked_sigma, scatter_factor, widened

GROWTH = 1.15  # the step in which the radius of an integral is enlarged


def sum_sigma(weights: Array, residual: Array) -> float:
    """Standard uncertainty of sum(weights * values) on a regular grid of one or two dimensions.

    weights: shape of the grid. residual: same shape, what is left of the values where their truth is known (undisturbed
    ground less its plane), NaN elsewhere. The covariance is read from the residuals as a function of distance alone, up
    to its first zero, and taken to hold on the whole grid: var = sum_ij w_i w_j C(|i - j|).
    """
    known = np.isfinite(residual)
    shape = [2 * n for n in residual.shape]
    axes = tuple(range(residual.ndim))
    value = np.where(known, residual - np.mean(residual[known]), 0.0)

    def correlate(a: Array) -> Array:
        return np.fft.irfftn(np.abs(np.fft.rfftn(a, shape, axes)) ** 2, shape, axes)

    pairs, product = correlate(known.astype(float)), correlate(value)
    lag = np.sqrt(sum(np.minimum(k, n - k) ** 2.0 for k, n in zip(np.indices(shape), shape)))
    ring = np.rint(lag).astype(int)
    count = np.bincount(ring.ravel(), pairs.ravel())
    covariance = np.bincount(ring.ravel(), product.ravel()) / np.maximum(count, 0.5)
    # far lags have few pairs and hold what the plane took out: they end at the first zero
    far = min(int(np.argmax(np.r_[covariance, -1.0] <= 0.0)), max(residual.shape) // 3)
    covariance[far:] = 0.0
    return math.sqrt(max(float(np.sum(correlate(weights) * covariance[ring])), 0.0))


def settled_radius(
    values: Array, weights: Callable[[float], Array], residual: Callable[[float], Array], radius: float, limit: float
) -> tuple[float, float]:
    """(radius, cut): the smallest from `radius` up beyond which sum(weights(radius) * values) changes within its noise.

    The faint tail of a crater's rim is not seen in single values, but it is in the integral. residual(radius): what is
    left of the values outside, NaN inside. Stops below `limit`. cut: the noise of the next change, which is how much of
    a tail may have been missed.
    """
    while True:
        if not GROWTH * radius < limit:
            return radius, 0.0
        more = weights(GROWTH * radius) - weights(radius)
        cut = sum_sigma(more, residual(GROWTH * radius))
        # a change of the integral of 1.5 noise widths is none
        if abs(float(np.sum(more * values))) < 1.5 * cut:
            return radius, cut
        radius *= GROWTH


NAN = float("nan")
DISTURBED = 4.5  # noise widths by which the smoothed surface must leave its plane to belong to the crater
BEYOND = 1.15  # the crater's radius over the farthest place seen to be disturbed
# half width of 68.3 % for the mean of two values known only from their difference: Student's t, one degree of freedom
TWO_HALVES = float(scipy.special.stdtrit(1, 0.841345))


@dataclass(frozen=True)
class Crater:
    """A crater's volume change [m^3], negative where the bed has been compacted, with its standard uncertainty.

    noise_sigma: the part from noise, the undisturbed surface and a rim's tail too faint to see. half_difference
    [m^3]: volume by the half to the left minus that by the half to the right of the axis; NaN for a map. axis [m]: (x,)
    or (x, y). radius [m]: beyond it the surface is undisturbed. depth, rim_height [m]: deepest and highest place of
    the smoothed surface against the plane, both positive. reason: why the values are NaN.
    r, height, height_sigma: the profile over its distance from the axis [m], signed for a line.
    """

    volume: float
    sigma: float
    noise_sigma: float
    half_difference: float
    axis: tuple[float, ...]
    radius: float
    depth: float
    rim_height: float
    r: Array
    height: Array
    height_sigma: Array
    reason: str = ""


def no_crater(reason: str, axis: tuple[float, ...]) -> Crater:
    """A crater whose numbers are NaN, for the reason given."""
    empty = np.empty(0)
    return Crater(NAN, NAN, NAN, NAN, axis, NAN, NAN, NAN, empty, empty, empty, reason)


def line_crater(
    x: ArrayLike, height: ArrayLike, sigma: ArrayLike, *, axis: float | None = None, radius: float | None = None
) -> Crater:
    """The crater along a line; x [m] equally spaced and increasing, height, sigma [m] (up), shape (n,), NaN in gaps.

    axis [m]: place of the crater's axis on x (None: where the two halves agree best). radius [m]: distance from the
    axis beyond which the surface is undisturbed (None: found from where it leaves a straight line). A straight line
    through the undisturbed surface on both sides is height zero. Gaps are bridged by straight lines.
    """
    x, h, s = checked("line_crater", x=x, height=height, sigma=sigma)
    good = np.isfinite(h) & np.isfinite(s)
    if good.sum() < 24:
        return no_crater(f"{int(good.sum())} good columns; at least 24 are needed", (NAN,))
    filled = np.interp(x, x[good], h[good])
    found = _extent(x, filled, good, axis, radius)
    if isinstance(found, str):
        return no_crater(found, (NAN if axis is None else axis,))
    centre, reach = found
    if axis is None:
        centre = _symmetry_axis(x, _levelled(x, filled, good, centre, reach)[0], centre, reach)
        reach = radius if radius is not None else reach + abs(centre - found[0])
    step = x[1] - x[0]
    room = min(centre - x[0], x[-1] - centre) - 6 * step
    if not reach < room:
        return no_crater(
            f"the crater (axis {centre:.4g} m, radius {reach:.4g} m) reaches the end of the line, {x[0]:.4g} to "
            f"{x[-1]:.4g} m: the undisturbed surface on both sides is needed",
            (centre,),
        )
    # in gaps the values are bridged, so the weight of a gap rests on the good columns beside it
    bridge = np.array([np.interp(x, x[good], row) for row in np.eye(int(good.sum()))])
    side = np.where(x < centre, 1.0, -1.0)

    def weights(reach: float, halves: Array | float = 1.0) -> Array:
        """What the volume, the mean of both halves, takes of each height; halves = side: half their difference."""
        share = np.clip((reach - np.abs(x - centre)) / step + 0.5, 0.0, 1.0)
        own = math.pi * np.abs(x - centre) * share * step * halves
        _, line = _levelled(x, filled, good, centre, reach)
        outside = good & (np.abs(x - centre) > reach)
        return _spread(bridge @ own, good) - _spread(line @ own, outside)

    def rest(reach: float) -> Array:
        outside = good & (np.abs(x - centre) > reach)
        return np.where(outside, _levelled(x, filled, good, centre, reach)[0], np.nan)

    cut = 0.0
    if radius is None:
        reach, cut = settled_radius(filled, weights, rest, reach, room)
    level, _ = _levelled(x, filled, good, centre, reach)
    volume, half = float(weights(reach) @ filled), float(weights(reach, side) @ filled)
    inside = np.abs(x - centre) <= reach
    noise_sigma = math.hypot(sum_sigma(weights(reach), rest(reach)), cut)
    excess = max(half**2 - sum_sigma(weights(reach, side), rest(reach)) ** 2, 0.0)
    smooth = scipy.ndimage.uniform_filter1d(level, _window(x.size))[inside]
    return Crater(
        volume,
        math.sqrt(noise_sigma**2 + TWO_HALVES**2 * excess),
        noise_sigma,
        2.0 * half,
        (centre,),
        reach,
        float(max(-smooth.min(), 0.0)),
        float(max(smooth.max(), 0.0)),
        x - centre,
        np.where(good, level, np.nan),
        np.where(good, s, np.nan),
    )


def _window(n: int) -> int:
    """Columns over which the surface is smoothed to see where it is disturbed."""
    return 2 * max(2, n // 120) + 1


def _spread(values: Array, mask: NDArray[np.bool_]) -> Array:
    out = np.zeros(mask.size)
    out[mask] = values
    return out


def _levelled(x: Array, h: Array, good: NDArray[np.bool_], centre: float, reach: float) -> tuple[Array, Array]:
    """(h minus the straight line through the good columns beyond reach, the matrix (outside, all) that gives it)."""
    outside = good & (np.abs(x - centre) > reach)
    design = np.column_stack([np.ones_like(x), x - centre])
    plane = np.linalg.pinv(design[outside]).T @ design.T  # (outside, all): line at all x from values outside
    return h - h[outside] @ plane, plane


def _extent(
    x: Array, h: Array, good: NDArray[np.bool_], axis: float | None, radius: float | None
) -> tuple[float, float] | str:
    """(centre, radius) of what leaves a straight line through the two ends, or why there is none."""
    span = x[-1] - x[0]
    if axis is not None and radius is not None:
        return axis, radius
    centre, reach = 0.5 * (x[0] + x[-1]), 0.36 * span
    for _ in range(4):
        outside = good & (np.abs(x - centre) > reach)
        if outside.sum() < 12:
            return "fewer than 12 undisturbed columns beside the crater: give the axis and the radius"
        level = scipy.ndimage.uniform_filter1d(_levelled(x, h, good, centre, reach)[0], _window(x.size))
        noise = FROM_MAD * float(np.median(np.abs(level[outside])))
        away = np.abs(level) > DISTURBED * noise
        away &= np.abs(x - 0.5 * (x[0] + x[-1])) < 0.5 * span - 2 * _window(x.size) * (x[1] - x[0])
        if not away.any():
            return "no crater: the surface nowhere leaves its straight line"
        weight = np.abs(level) * away
        middle = axis if axis is not None else float(np.sum(weight * x) / weight.sum())
        distance = np.abs(x - middle)
        order = np.argsort(distance)
        total = np.cumsum(weight[order])
        farthest = float(distance[order][np.searchsorted(total, 0.998 * total[-1])])
        centre, reach = middle, radius if radius is not None else min(BEYOND * farthest, 0.45 * span)
    return centre, reach


def _symmetry_axis(x: Array, level: Array, guess: float, reach: float) -> float:
    """x0 where the two halves agree best: least sum over s of [h(x0 + s) - h(x0 - s)]^2."""
    step = x[1] - x[0]
    smooth = scipy.ndimage.uniform_filter1d(level, _window(x.size))
    s = np.arange(0.5 * step, reach, step)

    def differ(x0: float) -> Array:
        return np.interp(x0 + s, x, smooth) - np.interp(x0 - s, x, smooth)

    tries = guess + np.arange(-0.4 * reach, 0.4 * reach + step, step)
    best = float(tries[int(np.argmin([np.sum(differ(t) ** 2) for t in tries]))])
    for _ in range(5):
        d = differ(best)
        slope = (differ(best + step) - differ(best - step)) / (2.0 * step)
        best -= float(np.clip(slope @ d / max(slope @ slope, 1e-300), -step, step))
    return best


@dataclass(frozen=True)
class ZeroCrossing:
    """phi_c with its standard uncertainty (half the 68.3 % interval) and 95 % interval; slope dV/dphi [m^3].

    An end of an interval is infinite where the data do not bound phi_c on that side. reason: why value is NaN.
    """

    value: float
    sigma: float
    low95: float
    high95: float
    slope: float
    n: int
    chi2: float
    reason: str = ""
    sigma_common: float = 0.0  # the part of sigma that all points share

    def with_common(self, common: float) -> ZeroCrossing:
        """The same with one more standard uncertainty, which all points share; the interval widened on both sides."""
        if not common:
            return self
        low, high = widened(self.value, self.low95, self.high95, common)
        return replace(
            self,
            sigma=math.hypot(self.sigma, common),
            sigma_common=math.hypot(self.sigma_common, common),
            low95=low,
            high95=high,
        )


def critical_fraction(phi: ArrayLike, phi_sigma: ArrayLike, volume: ArrayLike, volume_sigma: ArrayLike) -> ZeroCrossing:
    """Zero of the line V = b (phi - phi_c) with errors in both phi and V [m^3]; shape (n,), NaN points left out.

    phi_c minimises chi2 = sum (V - b (phi - phi_c))^2 / (sigma_V^2 + b^2 sigma_phi^2), least over b for each phi_c; the
    interval is where chi2 stays within 1 (1.96^2 for 95 %) of its least value (likelihood profile, after Fieller), so
    it is not symmetric where the slope is uncertain. Where the points scatter more than stated, the stated errors are
    multiplied by the scatter factor. The slope b by York et al. 2004, Am. J. Phys. 72, 367.
    """
    phi, dphi, v, dv = checked(
        "critical_fraction", phi=phi, phi_sigma=phi_sigma, volume=volume, volume_sigma=volume_sigma
    )
    use = np.isfinite(phi) & np.isfinite(dphi) & np.isfinite(v) & np.isfinite(dv)
    phi, dphi, v, dv = phi[use], dphi[use], v[use], dv[use]
    checked_sigma("critical_fraction", dv)
    n = phi.size
    nan = math.nan
    if n < 3 or np.ptp(phi) == 0.0:
        return ZeroCrossing(nan, nan, nan, nan, nan, n, nan, "fewer than three craters at different volume fractions")
    if not (v.min() < 0.0 < v.max()):
        side = "compacted" if v.max() <= 0.0 else "dilated"
        return ZeroCrossing(nan, nan, nan, nan, nan, n, nan, f"every bed {side}: the volume change crosses no zero")
    span = float(np.ptp(phi))

    def profile(zero: float) -> tuple[float, float]:
        """(least chi2, b) of the line through (zero, 0): York's iteration for errors in both."""
        d = phi - zero
        b = float(np.sum(v * d / dv**2) / np.sum(d * d / dv**2))
        for _ in range(50):
            w = 1.0 / (dv**2 + (b * dphi) ** 2)
            lever = w * w * (d * dv**2 + b * v * dphi**2)
            b, before = float(np.sum(lever * v) / np.sum(lever * d)), b
            if abs(b - before) <= 1e-10 * abs(b):
                break
        return float(np.sum((v - b * d) ** 2 / (dv**2 + (b * dphi) ** 2))), b

    tries = np.linspace(phi.min() - 0.5 * span, phi.max() + 0.5 * span, 61)
    k = int(np.argmin([profile(z)[0] for z in tries]))
    found = scipy.optimize.minimize_scalar(
        lambda z: profile(z)[0],
        bounds=(tries[max(k - 1, 0)], tries[min(k + 1, 60)]),
        method="bounded",
        options={"xatol": 1e-7 * span},
    )
    value, least = float(found.x), float(found.fun)
    scatter = scatter_factor(least, n - 2) ** 2

    def end(widths: float, way: int) -> float:
        def over(step: float) -> float:
            return profile(value + way * step)[0] - least - scatter * widths**2

        inner, outer = 0.0, 0.02 * span
        while over(outer) < 0.0:
            inner, outer = outer, 1.7 * outer
            if outer > 20.0 * span:
                return way * math.inf
        return value + way * float(scipy.optimize.brentq(over, inner, outer, xtol=1e-5 * span))

    sigma = 0.5 * (end(1.0, 1) - end(1.0, -1))
    return ZeroCrossing(value, sigma, end(TWO_SIDED_95, -1), end(TWO_SIDED_95, 1), profile(value)[1], n, least)
