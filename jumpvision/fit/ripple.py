"""Force oscillations of the deep regime: the variance that the force gains below the bend (thesis, Fig 48)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jumpvision.fit.correlated import correlation_time
from jumpvision.fit.estimate import Estimate

Array = NDArray[np.float64]


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
