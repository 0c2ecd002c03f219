"""Rest height and jump height of the rod from its track (docs/physics.md), and what the exposure does to them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import Array

from .estimate import Estimate, checked, checked_sigma, checked_times, scatter_factor
from .mean import difference_noise, weighted_mean

if TYPE_CHECKING:  # the flights are loaded where a height is asked for, not with every track
    from .flight.noise import Stretch

NAN = float("nan")
ALLOWED = 0.01  # chance that a window wholly on the parabola fails the chi2 test
LOST = 3.5  # intervals between samples: a longer one is a gap
HIGHER = 0.02  # of a height, by which a top in a gap must be higher: the speeds beside it are as good as that
SMALLEST = 5  # samples of the smallest window around the maximum
PRICE = 9.0  # twice the log likelihood by which noise must be the likelier one as a correlated one: three sigma


@dataclass(frozen=True)
class JumpHeight:
    """value [m]: greatest rod height after the motor stops minus rest; motor_rise [m]: the same while the motor runs.

    time [s] of the greatest height. n, chi2 of the fit at the apex. The sigmas hold rest's and the scatter factor.
    reason: why value is NaN.
    """

    value: float
    sigma: float
    time: float
    motor_rise: float
    motor_rise_sigma: float
    n: int
    chi2: float
    reason: str = ""
    gap: float = 0.0  # s, of the track, in which the top is


def at_rest(t: ArrayLike, until: float) -> NDArray[np.bool_]:
    """Which of the times t (n,) [s] show the robot at rest: those before the motor starts, at `until` [s]."""
    return np.asarray(t, float) < until


def rest_height(t: ArrayLike, h: ArrayLike, sigma: ArrayLike, *, until: float) -> Estimate:
    """Weighted mean height [m] before `until` [s], when the motor starts; NaN with a reason without samples there.

    t [s], h, sigma [m], shape (n,); NaN samples (lost frames) are left out. Sigma holds the scatter factor.
    """
    t, h, sigma = checked("rest_height", t=t, h=h, sigma=sigma)
    checked_sigma("rest_height", sigma)
    before = at_rest(t, until)
    mean = weighted_mean(h[before], sigma[before], "m")
    return replace(mean, reason=f"no good sample before {until:g} s") if mean.reason else mean


def jump_height(
    t: ArrayLike,
    h: ArrayLike,
    sigma: ArrayLike,
    *,
    motor_stop: float,
    rest: Estimate,
    foot_frequency: float | None,
    rest_until: float = -math.inf,
) -> JumpHeight:
    """Greatest rod height after the motor stops minus the rest height, sub-frame; and the rise while the motor runs.

    t [s] increasing, h [m] up, sigma [m] > 0, shape (n,); NaN samples (lost frames) are left out. motor_stop [s]; rest
    from `rest_height`. foot_frequency [Hz]: sqrt(k/m_f + k/M)/(2 pi) of a foot hanging from the spring, which shakes
    the rod in flight by m_f/(M + m_f) of its own motion; None without a foot mass. It is fitted along where given.

    A parabola of free curvature is fitted around the highest stretch of the track. Its window grows sample by sample
    on both sides as long as the samples stay on it (chi2, and the outer samples apart), so it ends where the flight
    does. A height still rising or falling at the motor's stop is its value there.

    Noise that is correlated from sample to sample, as the samples before rest_until [s] and those of the window show
    it, widens the sigmas, also that of rest.
    """
    from .flight.piece import Piece

    t, h, sigma = checked("jump_height", t=t, h=h, sigma=sigma)
    checked_sigma("jump_height", sigma)
    good = np.isfinite(t) & np.isfinite(h) & np.isfinite(sigma)
    checked_times("jump_height", np.where(good, t, np.nan))
    t, h, sigma = t[good], h[good], sigma[good]
    after, during, still = t >= motor_stop, t <= motor_stop, at_rest(t, rest_until)
    resting = [(Piece(t[still], h[still], sigma[still]), np.ones((int(still.sum()), 1)))] if still.sum() > 1 else []
    rise = _greatest(t[during], h[during], sigma[during], None, -math.inf, motor_stop, resting)
    apex = _greatest(t[after], h[after], sigma[after], foot_frequency, motor_stop, math.inf, resting)
    if apex is None:
        reason, apex = f"fewer than {SMALLEST} good samples after {motor_stop:g} s", (NAN, NAN, NAN, 0, NAN, 0.0)
    else:
        reason = "" if math.isfinite(rest.value) else f"no rest height: {rest.reason}"
    value, spread, when, n, chi2, rho = apex
    hidden, lost = top_in_gap(t[after], h[after])
    if hidden - value > max(5.0 * spread, HIGHER * (value - rest.value)):
        said = f"the track has a gap of {lost:.3g} s, in which it rises to about {hidden - rest.value:.3g} m"
        value, spread, when, reason = NAN, NAN, NAN, f"{said} above rest: is the top of the jump in the picture?"
    up, up_spread = rise[:2] if rise is not None else (NAN, NAN)
    rest_sigma = rest.sigma * math.sqrt((1.0 + rho) / (1.0 - rho))
    return JumpHeight(
        value - rest.value,
        math.hypot(spread, rest_sigma),
        when,
        up - rest.value,
        math.hypot(up_spread, rest_sigma),
        n,
        chi2,
        reason,
        0.0 if math.isfinite(value) else lost,
    )


def top_in_gap(t: Array, h: Array) -> tuple[float, float]:
    """(greatest height that the motion on both sides of a gap in the track t, h (n,) makes in it, the gap [s]).

    The cubic with height and speed of both sides is free flight's own parabola.
    """
    steps = np.diff(t)
    found = (-math.inf, 0.0)
    for k in np.flatnonzero(steps > LOST * np.median(steps)) if t.size > 2 * SMALLEST else ():
        sides = slice(max(k + 1 - SMALLEST, 0), k + 1), slice(k + 1, k + 1 + SMALLEST)
        if any(t[s].size < SMALLEST or np.ptp(t[s]) > 2.0 * SMALLEST * np.median(steps) for s in sides):
            continue
        ends = t[k], t[k + 1]
        lines = [np.polynomial.Polynomial.fit(t[s], h[s], 2) for s in sides]
        course = scipy.interpolate.CubicHermiteSpline(
            ends, [p(at) for p, at in zip(lines, ends)], [p.deriv()(at) for p, at in zip(lines, ends)]
        )
        found = max(found, (float(course(np.linspace(*ends, 101)).max()), float(steps[k])))
    return found


def curve_height(t: Array, h: Array, after: float) -> float:
    """`jump_height` of a model's curve, which has no noise: greatest height from the motor's stop on [unit of h].

    t (n,) [s] increasing, h (n,); after [s]: when the motor stops. The greatest value of the cubic spline through the
    samples since, carried back to the stop over less than one sample; beyond the last sample nothing is foretold. NaN
    where fewer than four samples are left.
    """
    late = t >= after
    t, h = t[late], h[late]
    if t.size < 4 or not np.isfinite(h).all():
        return NAN
    spline = scipy.interpolate.CubicSpline(t, h)
    turns = spline.derivative().roots(extrapolate=False)
    begin = max(after, 2.0 * t[0] - t[1])  # a film that begins later tells nothing of the stop
    at = np.concatenate([[begin], t, turns[np.isfinite(turns)]])
    return float(np.max(spline(at)))


def _greatest(
    t: Array, h: Array, sigma: Array, frequency: float | None, begin: float, end: float, resting: list[Stretch]
) -> tuple[float, float, float, int, float, float] | None:
    """(height, sigma, time, n, chi2, correlation of the noise) of the highest point of the samples given; None with too
    few.

    begin, end [s]: the interval that the samples stand for; the fit is carried on to it from the first or last sample.
    resting: what tells the correlation beside the window.
    """
    from .flight.noise import learned
    from .flight.piece import Piece

    if t.size < SMALLEST:
        return None
    smooth = np.convolve(h, np.full(3, 1.0 / 3.0), mode="valid")  # so that no single noisy sample is the maximum
    top = int(np.argmax(smooth)) + 1
    scale = max(1.0, difference_noise(h) / float(np.median(sigma)))
    lo = max(0, min(top - SMALLEST // 2, t.size - SMALLEST))
    hi = lo + SMALLEST
    growing = True
    while growing:
        growing = False
        for side in (0, 1):
            for step in (1, 2, 3):  # one chance failure does not end the window
                new = (lo - step, hi) if side == 0 else (lo, hi + step)
                if new[0] >= 0 and new[1] <= t.size and _on_parabola(t, h, scale * sigma, *new, side):
                    lo, hi = new
                    growing = True
                    break
    # the samples in which a departure built up before it was noticed
    trim = (hi - lo) // 10
    lo, hi = lo + (trim if lo > 0 else 0), hi - (trim if hi < t.size else 0)
    k = slice(lo, hi)
    when0, span = t[top], max(t[hi - 1] - t[top], t[top] - t[lo])
    design = _design(t[k], when0, span, frequency if hi - lo >= 9 else None)
    p, cov, chi2 = _solve(design, h[k], sigma[k])
    first = begin if lo == 0 and math.isfinite(begin) else t[lo]
    last = end if hi == t.size and math.isfinite(end) else t[hi - 1]
    fine = np.linspace(first, last, 16 * (hi - lo) + 1)
    curve = _design(fine, when0, span, frequency if hi - lo >= 9 else None)
    best = int(np.argmax(curve @ p))
    row = curve[best]
    factor = scatter_factor(chi2, hi - lo - p.size)
    window = Piece(t[k], h[k], sigma[k])
    noise = learned([*resting, (window, design)], PRICE)
    rho = noise.rho if noise is not None else 0.0
    shares = row @ cov @ (design / sigma[k][:, None]).T  # of each sample's error, in its sigmas
    apart = np.abs(np.subtract.outer(t[k], t[k])) / window.step
    spread = math.sqrt(float(shares @ rho**apart @ shares))  # with rho 0 that of white noise: 0^0 is 1
    return float(row @ p), factor * spread, float(fine[best]), hi - lo, chi2, rho


def _on_parabola(t: Array, h: Array, sigma: Array, lo: int, hi: int, side: int) -> bool:
    """Whether samples lo..hi lie on one parabola, and the three outermost of one side on that of the others."""
    design = _design(t[lo:hi], t[lo], t[hi - 1] - t[lo], None)
    p, _, chi2 = _solve(design, h[lo:hi], sigma[lo:hi])
    if chi2 > scipy.special.chdtri(hi - lo - 3, ALLOWED) or p[2] >= 0.0:
        return False
    if hi - lo < SMALLEST + 3:
        return True
    outer = np.zeros(hi - lo, dtype=bool)
    outer[: 3 if side == 0 else 0] = True
    outer[hi - lo - (0 if side == 0 else 3) :] = True
    q, cov, _ = _solve(design[~outer], h[lo:hi][~outer], sigma[lo:hi][~outer])
    miss = float(np.mean(h[lo:hi][outer] - design[outer] @ q))
    row = design[outer].mean(axis=0)
    spread = math.sqrt(float(row @ cov @ row) + float(np.mean(sigma[lo:hi][outer] ** 2)) / 3.0)
    return abs(miss) < 2.6 * spread


def _design(t: Array, centre: float, span: float, frequency: float | None) -> Array:
    d = (t - centre) / span
    columns = [np.ones_like(d), d, d * d]
    if frequency is not None:
        angle = 2.0 * math.pi * frequency * (t - centre)
        columns += [np.cos(angle), np.sin(angle)]
    return np.stack(columns, axis=1)


def _solve(design: Array, y: Array, sigma: Array) -> tuple[Array, Array, float]:
    a, b = design / sigma[:, None], y / sigma
    cov: Array = np.linalg.pinv(a.T @ a).astype(np.float64)
    p = cov @ (a.T @ b)
    return p, cov, float(np.sum((b - a @ p) ** 2))


def exposure_shift(time: Array, height: Array, exposure: float) -> Array:
    """By how much the mean over the exposure lies above the height at its middle [unit of height], (n,).

    To first order a T^2/24, with the acceleration a from the second difference of neighbours (steps may differ); for
    an oscillation of frequency f it is what the factor sinc(f T) takes from the amplitude. NaN where a neighbour is
    missing. time: (n,) [s], increasing; height: (n,), NaN = no data; exposure: T [s].
    """
    out = np.full(len(height), np.nan)
    if len(height) < 3:
        return out
    step = np.diff(time)
    speed = np.diff(height) / step
    acceleration = 2.0 * np.diff(speed) / (step[:-1] + step[1:])
    # an acceleration over gaps wider than 1.5 frames is not taken
    far = np.maximum(step[:-1], step[1:]) > 1.5 * np.median(step)
    out[1:-1] = np.where(far, np.nan, acceleration * exposure**2 / 24.0)
    return out


def shift_sigma(sigma: Array, time: Array, exposure: float) -> Array:
    """Standard uncertainty of height - exposure_shift from that of the heights, (n,), independent between frames."""
    part = (exposure / float(np.median(np.diff(time)))) ** 2 / 24.0  # of the second difference
    return np.asarray(sigma * np.sqrt((1.0 + 2.0 * part) ** 2 + 2.0 * part**2))


def shift_noise(sigma: Array, time: Array, exposure: float) -> Array:
    """Standard uncertainty of exposure_shift itself, (n,), from that of the heights, independent."""
    part = (exposure / float(np.median(np.diff(time)))) ** 2 / 24.0
    return np.asarray(math.sqrt(6.0) * part * sigma)


def parabolas(t: Array, values: Array, sigma: Array, window: int) -> list[tuple[Array, Array]]:
    """(rate, second derivative) of each of the values (k, n), then their sigma: by a parabola about every sample.

    t: (n,) [s]; sigma: (n,) of every value. window: samples of a parabola, weighted by their sigma, NaN left out; at
    the ends the nearest ones. NaN where fewer than three are good. The sigma is that of independent errors; what the
    third derivative adds within the window is not in it.
    """
    good = np.isfinite(values).all(axis=0) & np.isfinite(sigma)
    rates, bends = (np.full((len(values) + 1, t.size), np.nan) for _ in range(2))
    for i, use, weight, size, covariance in _parabolas(t, good, sigma, window):
        found = weight @ (values[:, use] / sigma[use]).T
        rates[:-1, i], bends[:-1, i] = found[1] / size[1], 2.0 * found[2] / size[2]
        rates[-1, i], bends[-1, i] = np.sqrt(np.diag(covariance)[1:]) / size[1:] * (1.0, 2.0)
    return list(zip(rates, bends))


def parabola_noise(
    t: Array, good: NDArray[np.bool_], sigma: Array, window: int
) -> tuple[scipy.sparse.csr_array, scipy.sparse.csr_array]:
    """Errors of the rate and of the second derivative of `parabolas` from those of the samples: (n, n) times a unit
    normal for each sample. Neighbours share samples, and so errors."""
    at: list[Array] = []
    entries: list[Array] = []
    for i, use, weight, size, _ in _parabolas(t, good, sigma, window):
        at.append(np.stack([np.full(use.size, i), use]))
        entries.append(np.stack([weight[1] / size[1], 2.0 * weight[2] / size[2]]))
    square, make = (t.size, t.size), scipy.sparse.csr_array
    if not at:
        return make(square), make(square)
    (row, column), (first, second) = np.concatenate(at, axis=1), np.concatenate(entries, axis=1)
    return make((first, (row, column)), shape=square), make((second, (row, column)), shape=square)


def _parabolas(
    t: Array, good: NDArray[np.bool_], sigma: Array, window: int
) -> Iterator[tuple[int, NDArray[np.intp], Array, Array, Array]]:
    """Of every sample with three good ones near it: its number, those, (3, k) of what a parabola about it takes of
    their values over sigma, the size of its three columns, their covariance."""
    n, half = t.size, window // 2
    for i in range(n):
        first = min(max(i - half, 0), max(n - window, 0))
        use = np.flatnonzero(good[first : first + window]) + first
        if use.size < 3:
            continue
        s = t[use] - t[i]
        size = np.array([1.0, *(float(np.max(np.abs(s))) ** k for k in (1, 2))])  # columns of one size
        design = np.stack([np.ones_like(s), s, s * s], axis=1) / size / sigma[use, None]
        covariance = np.linalg.inv(design.T @ design)
        yield i, use, covariance @ design.T, size, covariance
