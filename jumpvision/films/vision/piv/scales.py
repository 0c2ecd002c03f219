"""Vectors smoothed over scales where they differ by no more than noise, and how large that noise is.

Surfaces s_1, s_2, ... through the vectors s_0, each damping waves of twice the length of the one before; e_k =
s_(k-1) - s_k is what the field holds between two scales. Where its mean square around a place is P times what noise
alone would give, the share w = max(0, 1 - SCALE_NOISE / P) of e_k is kept: a Wiener filter of every scale and place.
Shear bands, P >> 1, stay as they were; weak motion that many vectors share stays too, since the noise of a stiff
surface is small. What is averaged or fitted later should not be smoothed before (`VectorField.matched`): the noise
goes by itself then, and what smoothing rounds off does not.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.films.calibration import CALM_PLACES, CALM_RANGE, CALM_WORTH, SCALE_NOISE, SEEN_WAVES, SMOOTHED_AWAY

from .surface import along_both, along_x, along_y, smoother
from .validate import response

ORDER = 3  # of the differences that the surfaces keep small: parabolas stay, waves of twice the length to 2 %
SHORTEST = 0.7  # rad a vector, a wave of 9 vectors: halved by the first surface; by the next half of it, and so on
COMPARED = 5  # vectors, side of the neighbourhood of P for the first surface, about half of that wave


class Noise(NamedTuple):
    """What the errors of vectors are made of: see `validate.response`."""

    window: int
    step: int
    stiffness: float
    times: int


class Smoothed(NamedTuple):
    """Smoothed vectors."""

    p: Array  # (2, ny, nx) [px]
    sigma: Array  # (2, ny, nx) [px]
    own: Array  # (ny, nx) share that each vector has of itself


def smoothed(p: Array, sigma: Array, by_chance: Array, noise: Noise) -> Smoothed:
    """p, sigma: (2, ny, nx) [px], p finite, sigma NaN where not measured.

    by_chance: (ny, nx) the share of sigma^2 that the noise of the pictures explains. The rest is motion that a window
    does not follow: no neighbour takes it away, and there smoothing would cost what they did resolve.
    """
    ny, nx = p.shape[1:]
    known = _known(sigma)
    levels = max(1, math.ceil(math.log2(max(ny, nx) * SHORTEST / (2 * math.pi))))
    halved = tuple(SHORTEST / 2**k for k in range(levels))
    surfaces = [_surface(q, ny, nx) for q in halved]
    cov = _covariance(ny, nx, noise, halved)
    fields, variance = [p], [np.where(known, sigma, 0.0) ** 2]
    shares, kept = [], np.zeros((ny, nx))
    lost = np.zeros_like(p)
    for k, surface in enumerate(surfaces, 1):
        side = min(COMPARED + 4 * (2 ** (k - 1) - 1), 2 * min(ny, nx) - 1)
        there = np.maximum(_around(known.astype(float), side), 1e-12)
        fields.append(along_both(*surface, p))
        variance.append(np.stack([np.maximum(_around(f, side), 0) for f in variance[0]]) / there)
        of_noise = (cov[k - 1, k - 1] - 2 * cov[k - 1, k] + cov[k, k]) * np.where(known, variance[-1], 1)
        chance = np.maximum(_around(np.where(known, by_chance, 0.0), side) / there, 1e-6)
        power = _around(_power(fields[-2] - fields[-1], chance * of_noise, known), side) / there
        w = np.where(there > 1e-9, np.clip(1 - SCALE_NOISE.value / np.maximum(power, 1e-12), 0, 1), 1)
        shares.append(w - kept)
        kept = w
        # signed, so that noise, which is above 1 as often as below, does not count
        # what smoothing took from the motion is told over twice the neighbourhood of P
        far = min(2 * side + 1, 2 * min(ny, nx) - 1)
        doubt = SMOOTHED_AWAY.value * math.sqrt(_spread(noise, SHORTEST)) * side / far
        over = _around((1 - w) ** 2 * (power - 1), far)
        lost += np.where(over > doubt, over, 0) * chance * of_noise
    shares.append(1 - kept)
    of_each = [a * np.sqrt(v) for a, v in zip(shares, variance)]
    total = np.zeros_like(p)
    for k, b in enumerate(of_each):
        total += b * (cov[k, k] * b + 2 * sum(cov[k, m] * of_each[m] for m in range(k)))
    best = np.asarray(sum(a * f for a, f in zip(shares, fields)))
    return Smoothed(best, np.sqrt(np.maximum(total, 0) + lost), shares[0])


def noise_factor(p: Array, sigma: Array, noise: Noise) -> float:
    """Factor on sigma that makes the shortest waves that a window sees as large as noise alone would.

    p, sigma as of `smoothed`. Waves along either axis are asked, and the calmest places of the calmer axis tell,
    so that bands and eddies have no say; it is pulled towards 1 where few vectors tell, and kept within CALM_RANGE.
    """
    ny, nx = p.shape[1:]
    known = _known(sigma)
    if not known.any():
        return 1.0
    by_window, by_vector = SEEN_WAVES.value
    halved = min(by_vector, noise.step / (by_window * noise.window))
    spread = _spread(noise, halved, along=True)
    expected = float(scipy.special.gammaincinv(1 / spread, CALM_PLACES.value)) * spread
    share = np.maximum(_around(known.astype(float), COMPARED), 1e-12)
    calm = []
    for down in (True, False):
        n = ny if down else nx
        s, cov = _smoother(halved, n), _along(n, noise, (halved,))
        rest = cov[0, 0] - 2 * cov[0, 1] + cov[1, 1]
        e = p - (along_y(s, p) if down else along_x(s, p))
        power = _power(e, (rest[:, None] if down else rest) * np.where(known, sigma, 1) ** 2, known)
        calm.append(float(np.quantile((_around(power, COMPARED) / share)[known], CALM_PLACES.value)) / expected)
    # less than 0.05 of the noise expected is none but equal pictures, which tell nothing of it
    if min(calm) < 0.05:
        return 1.0
    telling = known.sum() * spread  # neighbourhoods that do not share their noise
    found = (telling * min(calm) + CALM_WORTH.value) / (telling + CALM_WORTH.value)
    return float(np.clip(math.sqrt(found), *CALM_RANGE.value))


def _known(sigma: Array) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(sigma).all(0))


def _power(e: Array, of_noise: Array, known: NDArray[np.bool_]) -> Array:
    """Mean square of both components over what noise alone would give; 0 where not known."""
    return np.where(known, 0.5 * (e**2 / np.maximum(of_noise, 1e-30)).sum(0), 0.0)


def _around(f: Array, side: int) -> Array:
    return np.asarray(cv2.boxFilter(f, -1, (side, side), borderType=cv2.BORDER_REFLECT))


def _surface(theta: float, ny: int, nx: int) -> tuple[Array, Array]:
    """Smoothers along y and x that halve waves of theta rad a vector."""
    return _smoother(theta, ny), _smoother(theta, nx)


def _smoother(theta: float, n: int) -> Array:
    return smoother(n, theta ** (-2 * ORDER), ORDER)


def _covariance(ny: int, nx: int, noise: Noise, halved: tuple[float, ...]) -> NDArray[np.float64]:
    """Covariance of s_k and s_m over the variance of a vector: (1 + surfaces, 1 + surfaces, ny, nx).

    halved: [rad a vector] of the surfaces. The noise of neighbours is alike as along one axis times as along the other,
    to 3 % of the variance.
    """
    y, x = (_along(n, noise, halved) for n in (ny, nx))
    return y[:, :, :, None] * x[:, :, None, :]


@functools.lru_cache(maxsize=16)
def _along(vectors: int, noise: Noise, halved: tuple[float, ...]) -> NDArray[np.float64]:
    """The same along one axis, (1 + surfaces, 1 + surfaces, vectors).

    At its ends a surface is held by the vectors of one side only and has more than twice the variance.
    """
    n = min(max(128, 32 * noise.step), 1024)  # px, beyond which the response repeats itself
    seen = response(*noise, other=0.0, n=n)[0]
    along = np.fft.ifft((seen**2).sum(0)).real[: n // 2 : noise.step]
    alike = np.zeros(max(vectors, len(along)))
    alike[: len(along)] = along / along[0]
    c = alike[np.abs(np.subtract.outer(np.arange(vectors), np.arange(vectors)))]
    s = [np.eye(vectors), *(_smoother(q, vectors) for q in halved)]
    half = [np.asarray(q @ c) for q in s]
    return np.array([[(q * r).sum(1) for r in s] for q in half])


@functools.lru_cache(maxsize=16)
def _spread(noise: Noise, halved: float, along: bool = False) -> float:
    """Variance of P of a surface, or of smoothing along one axis, under noise alone, over the square of its mean.

    The mean square of a vector's two normal components has a variance of 1; those of two vectors are alike by rho^2.
    """
    n = min(max(128, 32 * noise.step), 1024)
    seen, surface = response(*noise, other=halved ** (-2 * ORDER), n=n, order=ORDER)
    left = 1 - (surface[:1] if along else surface)  # no wave along the other axis: no damping by it
    alike = np.fft.ifft2((seen * left) ** 2).real[: n // 2 : noise.step, : n // 2 : noise.step]
    apart = np.arange(min(COMPARED, len(alike)))
    pairs = np.where(apart > 0, 2, 1) * (COMPARED - apart)
    rho = alike[: len(apart), : len(apart)] / alike[0, 0]
    return float((np.outer(pairs, pairs) * rho**2).sum() / COMPARED**4)
