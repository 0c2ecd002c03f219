"""What noise becomes in the vectors when every window is matched to the surface through all of them, again and again.

In Fourier space, at wave numbers k [rad/px]: a window sees W D of a displacement D, the surface holds S d of the
vectors d. Then d_n = S d_(n-1) + W (D - S d_(n-1)), so d_n = R W D, R = sum of (S (1 - W))^j for j < n: the repetition
sharpens what the window blurs, and raises the noise. The matched field takes R W of the noise out of the residuals.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jumpvision.vision.piv.frame import taper

Array = NDArray[np.float64]

LAG = 5  # px, side of the box within which residuals count as correlated
LEAST = 0.2  # a smaller share of the residuals left says nothing about the noise


def factors(window: int, step: int, stiffness: float, times: int, clumping: float) -> tuple[float, float]:
    """Factors from the covariance of one window's single step to the standard uncertainty of d and of its gradient.

    clumping: mean of e times its box mean over mean(e)^2, e the squared gradient of the texture: where few pixels hold
    most of it, the fit takes more of their noise.
    """
    shift, slope, taken = _gains(window, step, stiffness, times)
    left = max(1 - clumping * taken, LEAST)
    return float(np.sqrt(shift / left)), float(np.sqrt(slope / left))


@functools.lru_cache(maxsize=16)
def _gains(window: int, step: int, stiffness: float, times: int) -> tuple[float, float, float]:
    """Variance gain of displacement and of gradient for white noise, and the share the fit takes out of it."""
    g = taper(window).astype(np.float64)
    xi = np.arange(len(g)) - len(g) // 2
    k = 2 * np.pi * np.fft.fftfreq(128)
    one_window = (g * np.cos(np.outer(k, xi))).sum(1) / g.sum()
    one_slope = (g * xi * np.sin(np.outer(k, xi))).sum(1) / (g * xi**2).sum()
    one_surface = _surface(k * step, stiffness)
    one_box = np.cos(np.outer(k, np.arange(-(LAG // 2), LAG // 2 + 1))).sum(1)
    w, s, box = (np.outer(q, q) for q in (one_window, one_surface, one_box))
    missed = s * (1 - w)
    seen, seen_before = (w * (1 - missed**n) / (1 - missed) for n in (times, times - 1))
    shift = (seen**2).mean() / ((g**2).sum() / g.sum() ** 2) ** 2
    gradient = k * s * seen_before + np.outer(one_window, one_slope) * (1 - s * seen_before)
    alone = (g**2).sum() / g.sum() ** 2 * (g**2 * xi**2).sum() / (g * xi**2).sum() ** 2
    return float(shift), float((gradient**2).mean() / alone), float((box * (2 * seen - seen**2)).mean())


def response(window: int, step: int, stiffness: float, times: int, other: float, n: int = 128) -> tuple[Array, Array]:
    """R W and the response of a surface of stiffness `other`, on the same wave numbers (n, n)."""
    g = taper(window).astype(np.float64)
    k = 2 * np.pi * np.fft.fftfreq(n)
    one_window = (g * np.cos(np.outer(k, np.arange(len(g)) - len(g) // 2))).sum(1) / g.sum()
    w, s, o = (np.outer(q, q) for q in (one_window, _surface(k * step, stiffness), _surface(k * step, other)))
    missed = s * (1 - w)
    return w * (1 - missed**times) / (1 - missed), o


@functools.lru_cache(maxsize=16)
def error_length(window: int, step: int, stiffness: float, times: int, other: float | None) -> float:
    """Side [px] of the square over which the errors of vectors are worth that of one.

    The integral of their correlation over the plane is its square: the power at k = 0 over its mean. other: stiffness
    of the surface that the vectors are drawn to afterwards, None where they are left alone.
    """
    seen, surface = response(window, step, stiffness, times, other or 0.0, min(max(128, 32 * step), 1024))
    power = (seen * surface if other is not None else seen) ** 2
    return float(1 / np.sqrt(power.mean()))


def _surface(theta: NDArray[np.floating[Any]], stiffness: float) -> Array:
    """Response of the smoothed surface (`surface.axis`) to waves of theta rad a vector; none beyond the grid's."""
    return np.where(np.abs(theta) < np.pi, 1 / (1 + stiffness * (2 - 2 * np.cos(theta)) ** 2), 0)
