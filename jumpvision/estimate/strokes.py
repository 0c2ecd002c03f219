"""A slow intrusion stroke by stroke: fresh samples and events, laws of overshoots, oscillations of the deep regime."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array

from .estimate import Estimate, scatter_factor
from .mean import correlation_time

SLOW = 0.25  # share of the typical intrusion speed below which the foot counts as paused


@dataclass(frozen=True)
class Fresh:
    """The samples of a log in which the foot enters grains that it had not reached before.

    index: their positions in the log, shape (n,). event: number of the last event before each, -1 before the first.
    event_depth [m], event_pause [s] (NaN after a withdrawal), event_kind ("reintrusion" | "stop_go"): shape (events,).
    """

    index: NDArray[np.intp]
    event: NDArray[np.intp]
    event_depth: Array
    event_pause: Array
    event_kind: tuple[str, ...]


def directions(t: Array, depth: Array, *, window: float) -> NDArray[np.int8]:
    """+1 intruding, -1 withdrawing, 0 paused, shape (n,); t [s] increasing, depth [m] positive down.

    The speed is a slope over `window` [s]; a rest shorter than that is the turning point of a stroke, not a pause.
    """
    half = max(1, round(0.5 * window / float(np.median(np.diff(t)))))
    lo, hi = np.maximum(np.arange(t.size) - half, 0), np.minimum(np.arange(t.size) + half, t.size - 1)
    speed = (depth[hi] - depth[lo]) / (t[hi] - t[lo])
    down = speed[speed > 0.05 * np.abs(speed).max()]
    state = np.zeros(t.size, dtype=np.int8)
    if down.size:
        state[np.abs(speed) > SLOW * float(np.median(down))] = 1
        state *= np.sign(speed).astype(np.int8)
    cuts = np.flatnonzero(np.diff(state)) + 1
    for i, j in zip([0, *cuts], [*cuts, t.size]):
        if state[i] == 0 and i > 0 and j < t.size and t[j] - t[i] < window:
            middle = (i + j) // 2
            state[i:middle], state[middle:j] = state[i - 1], state[j]
    return state


def fresh_samples(t: Array, depth: Array, *, window: float, rise: float) -> Fresh:
    """The samples that go deeper than all before them, and the events (pauses, withdrawals) between them.

    rise [m]: depth after an event that is left out, while the force builds up again.
    """
    state = directions(t, depth, window=window)
    cuts = np.flatnonzero(np.diff(state)) + 1
    index: list[NDArray[np.intp]] = []
    event: list[NDArray[np.intp]] = []
    depths: list[float] = []
    pauses: list[float] = []
    kinds: list[str] = []
    deepest, pause, withdrawn, begun = -np.inf, 0.0, False, False
    for i, j in zip([0, *cuts], [*cuts, t.size]):
        if state[i] < 0:
            withdrawn = True
        elif state[i] == 0:
            pause += float(t[min(j, t.size - 1)] - t[i]) + (1.0 - 2.0 * SLOW) * window  # lost in the smoothing
        else:
            before = np.maximum.accumulate(np.r_[deepest + (rise if begun else 0.0), depth[i : j - 1]])
            new = np.arange(i, j)[depth[i:j] > before]
            if new.size and j < t.size:  # the force relaxes as soon as the foot slows
                # of a short stroke, a fifth of its time is left out before it ends
                slows = min(window, 0.2 * float(t[j - 1] - t[new[0]]))
                new = new[t[new] <= t[j - 1] - slows]
            if new.size:
                if begun:
                    depths.append(deepest)
                    pauses.append(np.nan if withdrawn else pause)
                    kinds.append("reintrusion" if withdrawn else "stop_go")
                index.append(new)
                event.append(np.full(new.size, len(depths) - 1))
                pause, withdrawn, begun = 0.0, False, True
        deepest = max(deepest, float(depth[i:j].max()))
    empty = np.zeros(0, dtype=np.intp)
    return Fresh(
        np.concatenate(index) if index else empty,
        np.concatenate(event) if event else empty,
        np.array(depths),
        np.array(pauses),
        tuple(kinds),
    )


def proportionality(depth: Array, overshoot: Array, covariance: Array, left: Array) -> dict[str, Estimate]:
    """Whether the overshoots of one kind are in proportion to depth: `intercept` [N] and `exponent`, where they show.

    depth [m] of the events below the surface, overshoot [N] with covariance (m, m), left [N]: what compounding adds.
    intercept: of a straight line beside s (0 if proportional); exponent p of O ~ z^p (1 if proportional).
    """
    deep = depth > 0.0
    z, o, cov = depth[deep], (overshoot - left)[deep], covariance[np.ix_(deep, deep)]
    out = {}
    if z.size > 2:
        line = {"s": (z, "N/m"), "intercept": (np.ones_like(z), "N")}
        out["intercept"] = _generalised(line, o, cov)["intercept"]
        if np.all(o > 2.0 * np.sqrt(np.diag(cov))):  # a logarithm of what may be zero has no meaning
            logs = {"exponent": (np.log(z), ""), "level": (np.ones_like(z), "")}
            out["exponent"] = _generalised(logs, np.log(o), cov / o[:, None] / o[None, :])["exponent"]
    return out


def _generalised(columns: dict[str, tuple[Array, str]], y: Array, cov: Array) -> dict[str, Estimate]:
    """Generalised least squares of y (m,) on the columns; sigma with the scatter factor."""
    whiten = np.linalg.inv(np.linalg.cholesky(cov))
    x = whiten @ np.stack([c for c, _ in columns.values()], axis=1)
    inverse = np.linalg.pinv(x.T @ x)
    p = inverse @ (x.T @ (whiten @ y))
    chi2 = float(np.sum((whiten @ y - x @ p) ** 2))
    factor = scatter_factor(chi2, y.size - p.size)
    return {
        k: Estimate(float(p[i]), factor * math.sqrt(float(inverse[i, i])), unit, y.size, chi2)
        for i, (k, (_, unit)) in enumerate(columns.items())
    }


@dataclass(frozen=True)
class Ripple:
    """variance [N^2]: deep minus shallow, negative when there are no oscillations. amplitude [N]: its root times
    sqrt(2), that of a sine; NaN with a reason where the variance is within 3 sigma of 0. spacing [m]: of the peaks."""

    variance: Estimate
    amplitude: Estimate
    spacing: float


def deep_ripple(z: Array, residual: Array, *, surface: float, bend: float) -> Ripple:
    """Ripple of the residual force (n,) [N] at depths z [m]: below `bend` against between `surface` and `bend`."""
    deep, shallow = residual[z > bend], residual[(z > surface) & (z <= bend)]
    (a, sa), (b, sb) = _variance(deep), _variance(shallow)
    variance = Estimate(a - b, math.hypot(sa, sb), "N^2", deep.size, math.nan)
    if not variance.value > 3.0 * variance.sigma:
        none = "no oscillation above the fluctuations near the surface"
        return Ripple(variance, Estimate(math.nan, math.nan, "N", deep.size, math.nan, none), math.nan)
    amplitude = math.sqrt(2.0 * variance.value)
    sigma = variance.sigma / amplitude
    at, step = z[z > bend], float(np.median(np.diff(z[z > bend])))
    even = np.interp(np.arange(at[0], at[-1], step), at, deep)
    power = np.abs(np.fft.rfft((even - even.mean()) * np.hanning(even.size), 8 * even.size)) ** 2
    low = 16  # two periods in the record at least
    spacing = 8 * even.size * step / (low + int(np.argmax(power[low:])))
    return Ripple(variance, Estimate(amplitude, sigma, "N", deep.size, math.nan), spacing)


def _variance(x: Array) -> tuple[float, float]:
    """(variance, sigma) of a correlated Gaussian series: 2 v^2 / n_eff, the squares' correlation time for n_eff."""
    if x.size < 8:
        return math.nan, math.nan
    v = float(np.var(x))
    return v, v * math.sqrt(2.0 * correlation_time((x - x.mean()) ** 2) / x.size)
