"""The noise of a set of tracks, learned where no model is needed, and what it makes of residuals.

Noise is taken as a first-order autoregression: standard deviation s, correlation rho from one frame to the next; beside
it each track may wander slowly (`wander`). Both are estimated by restricted maximum likelihood from stretches whose
true course is known up to a few linear coefficients: rest (a line), flight (a polynomial), the difference of two trials
made alike (a constant).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from jumpvision.base.arrays import Array


@dataclass(frozen=True)
class Stretch:
    """Noise on a smooth course: y (n,) at the times t (n,) [s]; design (n, k): what the course may be made of.

    spread: (n,) factor on the noise, where samples differ; track: whose it is (the later one of a difference).
    """

    t: Array
    y: Array
    design: Array
    spread: Array | None = None
    track: int = -1


@dataclass(frozen=True)
class Noise:
    """s: standard deviation [unit of y]; rho: correlation over `frame` [s]; n: samples it was learned from.

    log_sigma: standard uncertainty of the logarithm of the noise power at low frequencies, where a model's errors lie.
    log_power: that of the power at all frequencies (0: by n alone). kurtosis: of the whitened noise, 3 where normal.
    drift: rms of the slow wander of a track [unit of y], its memory `reach` [s].
    """

    s: float
    rho: float
    frame: float
    log_sigma: float = 0.0
    n: int = 0
    log_power: float = 0.0
    kurtosis: float = 3.0
    drift: float = 0.0
    reach: float = math.inf

    def weights(self, t: Array, spread: Array | None = None) -> tuple[Array, Array]:
        """a (n,), b (n - 1,) of `whiten`: a[i] r[i] - b[i - 1] r[i - 1]."""
        scale = np.full(t.size, 1.0 / self.s) if spread is None else 1.0 / (self.s * spread)
        rho = self.rho ** (np.diff(t) / self.frame) if self.rho > 0 else np.zeros(t.size - 1)
        q = 1.0 / np.sqrt(1.0 - rho * rho)
        return np.concatenate([scale[:1], scale[1:] * q]), rho * q * scale[:-1]

    def whiten(self, t: Array, r: Array, spread: Array | None = None) -> Array:
        """Columns r (n,) or (n, k) at t (n,) as independent numbers of unit variance, were they this noise."""
        return whiten(*self.weights(t, spread), np.asarray(r, float))


def whiten(a: Array, b: Array, r: Array) -> Array:
    """Columns r (n,) or (n, k) by the weights of a noise."""
    if r.ndim == 2:
        a, b = a[:, None], b[:, None]
    out = a * r
    out[1:] -= b * r[:-1]
    return out


def frame_of(times: Sequence[Array]) -> float:
    """Time between frames [s]: the median over all tracks."""
    return float(np.median(np.concatenate([np.diff(t) for t in times if t.size > 1])))


TOP = 0.97  # the greatest correlation; noise of cameras is not anticorrelated
LEARNED_FROM = 20  # samples at least: the size is then known to 16 %


def estimate(stretches: Sequence[Stretch], frame: float, floor: float = 0.0) -> Noise:
    """Noise of all stretches together. floor: the least s can be (rounding: step / sqrt(12)).

    Raises ValueError when the stretches hold fewer than LEARNED_FROM samples beyond their coefficients.
    """
    usable = [x for x in stretches if x.t.size > x.design.shape[1] + 2]
    if (free := samples(usable)) < LEARNED_FROM:
        raise ValueError(
            f"noise: {free} samples whose course is known; at least {LEARNED_FROM} are needed: record what is at rest, "
            "or repeat recordings (same `group`)"
        )
    grid = np.linspace(0.0, TOP, 9)
    score = [_profile(usable, float(rho), frame, free)[0] for rho in grid]
    best = int(np.argmin(score))
    ends = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, grid.size - 1)])
    found = scipy.optimize.minimize_scalar(
        lambda rho: _profile(usable, rho, frame, free)[0], bounds=ends, method="bounded", options={"xatol": 3e-3}
    )
    rho = float(found.x) if found.fun < score[best] else float(grid[best])
    return of_power(_profile(usable, rho, frame, free)[1], rho, frame, free, floor)


def of_power(power: float, rho: float, frame: float, free: int, floor: float = 0.0) -> Noise:
    """Noise of this variance and correlation, both learned from `free` samples."""
    # power at low frequency ~ s_e^2 / (1 - rho)^2: var(ln s_e^2) = 2/n, var(rho) = (1 - rho^2)/n
    log_sigma = math.sqrt(2.0 / free + 4.0 * (1.0 + rho) / (1.0 - rho) / free)
    return Noise(max(math.sqrt(power), floor), rho, frame, log_sigma, free)


def samples(stretches: Sequence[Stretch]) -> int:
    """Samples beyond the coefficients of their courses."""
    return sum(x.t.size - x.design.shape[1] for x in stretches)


def whitened(x: Stretch, rho: float, frame: float) -> tuple[Array, float]:
    """(the noise of a stretch as independent numbers of the variance s^2, less its course; -2 ln of what scales it)."""
    unit = Noise(1.0, rho, frame)
    white, design = unit.whiten(x.t, x.y, x.spread), unit.whiten(x.t, x.design, x.spread)
    steps = rho ** (np.diff(x.t) / frame) if rho > 0 else np.zeros(x.t.size - 1)
    logs = float(np.sum(np.log1p(-steps * steps)))
    if design.shape[1]:
        q, upper = np.linalg.qr(design)
        white = white - q @ (q.T @ white)
        logs += 2.0 * float(np.sum(np.log(np.abs(np.diag(upper)))))
    return white, logs


def _profile(stretches: Sequence[Stretch], rho: float, frame: float, free: int) -> tuple[float, float]:
    """-2 ln of the restricted likelihood at its best s, and that s^2."""
    total, logs = 0.0, 0.0
    for x in stretches:
        white, log = whitened(x, rho, frame)
        total, logs = total + float(white @ white), logs + log
    total = max(total, np.finfo(float).tiny)
    return free * math.log(total / free) + logs, total / free


def powers(t: Array, degree: int) -> Array:
    """Design (n, degree + 1) of a polynomial, its columns orthogonal."""
    u = 2.0 * (t - t[0]) / max(float(t[-1] - t[0]), 1e-300) - 1.0
    return np.polynomial.legendre.legvander(u, degree)


def rounding_step(y: Array) -> float:
    """Step of a table whose numbers were rounded [unit of y]; 0 when they were not (or only to display).

    A rounded track has few different values: their least spacing is the step.
    """
    values = np.unique(y)
    if values.size < 2 or values.size > 0.9 * y.size:
        return 0.0
    steps = np.diff(values)
    step = float(np.min(steps[steps > 1e-9 * np.ptp(values)]))
    off = np.abs(steps / step - np.round(steps / step))
    return step if float(np.max(off)) < 0.02 else 0.0


def step_apart(course: Array, step: float) -> NDArray[np.int64]:
    """Indices of a course (n,) at which it has moved by at least `step` since the last one.

    While a motion stays within a rounding step its readings share one rounding error. Which are kept must not hang on
    the readings themselves: those that flicker between two values are the ones that err most.
    """
    kept = [0]
    for i, y in enumerate(course):
        if abs(y - course[kept[-1]]) >= step:
            kept.append(i)
    return np.array(kept, dtype=np.int64)


def of_rounded(s: float, step: float) -> float:
    """Standard deviation of the errors of rounded readings, from s as repeated readings of one motion differ.

    Noise sigma and rounding err by sigma^2 + step^2/12 together, over all places between two steps. Repeated readings
    share what rounding does on average at a place: step^2 sum_m exp(-(2 pi m sigma / step)^2) / (2 pi^2 m^2).
    """
    m = np.arange(1, 400)

    def shared(sigma: float) -> float:
        return float(np.sum(step**2 * np.exp(-((2 * np.pi * m * sigma / step) ** 2)) / (2 * np.pi**2 * m**2)))

    uniform = step**2 / 12.0
    if s**2 <= uniform - shared(0.0):
        return math.sqrt(uniform)
    sigma = float(scipy.optimize.brentq(lambda x: x * x + uniform - shared(x) - s * s, 0.0, s))
    return math.sqrt(sigma**2 + uniform)


def coefficients(noise: Noise, x: Stretch) -> tuple[Array, Array]:
    """Coefficients (k,) of a stretch's design by generalised least squares, and their variances (k,)."""
    return solved(noise.whiten(x.t, x.y, x.spread), noise.whiten(x.t, x.design, x.spread))


def solved(y: Array, design: Array) -> tuple[Array, Array]:
    """Coefficients (k,) of a design (n, k) that y (n,), of independent unit variance, is made of; their variances."""
    scale = np.maximum(np.linalg.norm(design, axis=0), 1e-300)
    inverse = np.linalg.pinv((design / scale).T @ (design / scale), rcond=1e-10)
    return inverse @ (design / scale).T @ y / scale, np.diag(inverse) / scale**2


def spread_of(found: Sequence[tuple[float, float]]) -> float:
    """Standard deviation between numbers known each with a variance: the likeliest, 0 when they do not scatter.

    found: (number, variance), mean 0. No scatter is said below a likelihood ratio of 2.7 (one-sided 5 %).
    """
    c, v = np.array(found).T
    good = np.isfinite(c) & (v > 0)
    c, v = c[good], v[good]
    if c.size < 3:
        return 0.0
    top = 3.0 * float(np.sqrt(np.mean(c * c)))
    tries = np.concatenate([[0.0], np.geomspace(1e-3 * top, top, 200)]) if top > 0 else np.zeros(1)
    total = v[:, None] + tries**2
    score = np.sum(np.log(total) + (c * c)[:, None] / total, axis=0)
    best = int(np.argmin(score))
    return float(tries[best]) if score[0] - score[best] > 2.7 else 0.0
