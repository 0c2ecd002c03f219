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
    ny, nx = p.shape[1:]
    rows, columns = (smoother(n, STIFF) for n in (ny, nx))
    # the noise of neighbours is alike as along one axis times as along the other, to 3 % of the variance
    squared, once = (np.outer(*q) for q in zip(*(_gains(n, window, step, stiffness, times) for n in (ny, nx))))
    rest = 1 - 2 * once + squared
    surface = np.stack([rows @ f @ columns.T for f in p])
    e = p - surface
    known = np.isfinite(sigma[0]) & np.isfinite(sigma[1])
    power = np.zeros(known.shape)
    power[known] = 0.5 * ((e[:, known] / sigma[:, known]) ** 2).sum(0) / rest[known]
    box, border = (AROUND, AROUND), cv2.BORDER_REFLECT
    total = cv2.boxFilter(power, -1, box, borderType=border)
    share = cv2.boxFilter(known.astype(np.float64), -1, box, borderType=border)
    w = np.clip(1 - CHANCE * share / np.maximum(total, 1e-12), 0, 1)
    w[share == 0] = 1
    return surface + w * e, np.sqrt(w**2 + (1 - w) ** 2 * squared + 2 * w * (1 - w) * once)


@functools.lru_cache(maxsize=16)
def _gains(vectors: int, window: int, step: int, stiffness: float, times: int) -> tuple[Array, Array]:
    """Of the variance of a vector: that of the surface, and the covariance of both; (vectors,) along one axis.

    At its ends the surface is held by the vectors of one side only and has more than twice the variance.
    """
    n = min(max(128, 32 * step), 1024)  # px, beyond which the response repeats itself
    seen = response(window, step, stiffness, times, STIFF, n)[0]
    along = np.fft.ifft((seen**2).sum(0)).real[: n // 2 : step]
    alike = np.zeros(max(vectors, len(along)))
    alike[: len(along)] = along / along[0]
    c = alike[np.abs(np.subtract.outer(np.arange(vectors), np.arange(vectors)))]
    s = smoother(vectors, STIFF)
    return ((s @ c) * s).sum(1), (s * c).sum(1)
