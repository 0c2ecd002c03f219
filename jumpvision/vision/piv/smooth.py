"""Vectors drawn towards the smooth surface through them where they differ from it by no more than their noise."""

from __future__ import annotations

import functools

import cv2
import numpy as np
from numpy.typing import NDArray

from jumpvision.vision.piv.noise import response
from jumpvision.vision.piv.surface import smoother

Array = NDArray[np.float64]

STIFF = 10.0  # of the smooth surface: keeps waves of 20 vectors to 10 %, takes two thirds of the noise
CHANCE = 1.5  # times the variance expected of noise: a mean over AROUND^2 overlapping vectors exceeds it rarely
AROUND = 5  # vectors, side of the neighbourhood over which vectors are compared with the surface


def smoothed(p: Array, sigma: Array, window: int, step: int, stiffness: float, times: int) -> tuple[Array, Array]:
    """p, sigma: (2, ny, nx) [px], p finite, sigma NaN where not measured. Returns the vectors and the factor on sigma.

    A local Wiener filter: with e = d - (smooth surface), P its mean square over what noise alone would give, the vector
    becomes surface + w e, w = max(0, 1 - CHANCE / P). Shear bands, P >> 1, stay as they were.
    """
    rest, squared, once = _gains(window, step, stiffness, times)
    ny, nx = p.shape[1:]
    rows, columns = (smoother(n, STIFF) for n in (ny, nx))
    surface = np.stack([rows @ f @ columns.T for f in p])
    e = p - surface
    known = np.isfinite(sigma[0]) & np.isfinite(sigma[1])
    power = np.zeros(known.shape)
    power[known] = 0.5 * ((e[:, known] / sigma[:, known]) ** 2).sum(0) / rest
    box, border = (AROUND, AROUND), cv2.BORDER_REFLECT
    total = cv2.boxFilter(power, -1, box, borderType=border)
    share = cv2.boxFilter(known.astype(np.float64), -1, box, borderType=border)
    w = np.clip(1 - CHANCE * share / np.maximum(total, 1e-12), 0, 1)
    w[share == 0] = 1
    return surface + w * e, np.sqrt(w**2 + (1 - w) ** 2 * squared + 2 * w * (1 - w) * once)


@functools.lru_cache(maxsize=16)
def _gains(window: int, step: int, stiffness: float, times: int) -> tuple[float, float, float]:
    """Of the variance of a vector: that of its rest e, of the surface, and the covariance of vector and surface."""
    seen, surface = response(window, step, stiffness, times, STIFF)
    power = seen**2 / (seen**2).sum()
    return tuple(float((f * power).sum()) for f in ((1 - surface) ** 2, surface**2, surface))  # type: ignore[return-value]
