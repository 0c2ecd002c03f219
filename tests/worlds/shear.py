"""Flows whose gradient changes within a window: Gaussian particles of known motion, drawn without the package.

Particles of 2.5 px (e^-2), the light of each pixel integrated by the error function, drawn in both frames at their
exact places half a displacement before and behind mid-time. Noise in % of 255.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

Array = NDArray[np.float64]
Truth = Callable[[Array, Array], tuple[Array, Array]]

DIAMETER, DENSITY = 2.5, 0.03  # px, particles a px^2


class Case(NamedTuple):
    shape: tuple[int, int]
    truth: Truth


def parabola(height: int, peak: float = 8.0) -> Case:
    """Of a channel that fills the picture."""
    middle = (height - 1) / 2
    return Case((height, 384), lambda x, y: (peak * (1 - ((y - middle) / (height / 2)) ** 2), 0 * x))


def _layer(x: Array, y: Array) -> tuple[Array, Array]:
    """3 px either way over 20 px, inclined, so that every phase of the grid occurs."""
    f = np.tanh((y - 0.07 * x - 118) / 10)
    return 3 * f, 0.3 * f


def _jet(x: Array, y: Array) -> tuple[Array, Array]:
    f = 1 / np.cosh((y - 0.1 * x - 115) / 20) ** 2
    return 6 * f, 0.6 * f


def _vortex(x: Array, y: Array) -> tuple[Array, Array]:
    """Lamb-Oseen, core 25 px, 4 px at the fastest."""
    dx, dy = x - 121.3, y - 130.8
    s = (dx**2 + dy**2) / 25.0**2
    w = 4.0 / (25.0 * 0.638) * np.where(s > 1e-9, -np.expm1(-s) / np.maximum(s, 1e-9), 1.0)
    return -w * dy, w * dx


def _wake(x: Array, y: Array) -> tuple[Array, Array]:
    """A deficit of 80 % behind a body and the swing of its street."""
    lull = np.exp(-(((y - 128) / 22.0) ** 2))
    return 5.0 * (1 - 0.8 * lull), 1.5 * lull * np.sin(2 * np.pi * x / 90.0)


SQUARE = (256, 256)
CASES = {
    "parabola": parabola(110),
    "tanh": Case(SQUARE, _layer),
    "jet": Case(SQUARE, _jet),
    "vortex": Case(SQUARE, _vortex),
    "wake": Case(SQUARE, _wake),
}  # fmt: skip


def frames(case: Case, seed: int) -> tuple[Array, Array]:
    """Both frames [grey], before noise and rounding."""
    rng = np.random.default_rng(seed)
    rows, columns = case.shape
    n = rng.poisson(DENSITY * (rows + 30) * (columns + 30))
    x, y = rng.uniform(-15, columns + 15, n), rng.uniform(-15, rows + 15, n)
    light = rng.uniform(70, 220, n)
    u, v = case.truth(x, y)
    first, second = (_drawn(case.shape, x + t * u, y + t * v, light) for t in (-0.5, 0.5))
    return first, second


def _drawn(shape: tuple[int, int], x: Array, y: Array, light: Array) -> Array:
    out, width = np.full((shape[0] + 60, shape[1] + 60), 12.0), DIAMETER / 4 * np.sqrt(2)
    for px, py, grey in zip(x + 30, y + 30, light):
        i, j = int(px) - 4, int(py) - 4
        if not (0 <= i < out.shape[1] - 9 and 0 <= j < out.shape[0] - 9):
            continue
        gx, gy = (np.diff(erf((np.arange(10) - 0.5 + k - p) / width)) for k, p in ((i, px), (j, py)))
        out[j : j + 9, i : i + 9] += grey * np.outer(gy, gx) * width**2 * np.pi / 4
    return out[30:-30, 30:-30]


def seen(picture: Array, noise: float, rng: np.random.Generator) -> NDArray[np.uint8]:
    return np.clip(np.rint(picture + rng.normal(0, 2.55 * noise, picture.shape)), 0, 255).astype(np.uint8)
