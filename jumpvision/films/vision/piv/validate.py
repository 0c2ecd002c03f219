"""Which vectors disagree with their neighbours, and what the noise of the pictures becomes in the vectors."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import FROM_MAD, Array
from jumpvision.base.threads import shared
from jumpvision.films.calibration import (
    CHANCE_MATCH,
    FINER_MOTION,
    FINER_NOISE,
    SHORT_WAVES,
    SHORTEST_WAVES,
)

from .frame import taper

MIN_NEIGHBOURS = 3


def normalised_median(
    u: Array,
    v: Array,
    slopes: tuple[tuple[Array, Array], tuple[Array, Array]] | None = None,
    certain: NDArray[np.bool_] | None = None,
) -> Array:
    """Residual of each vector against the median of its 8 neighbours, over their own scatter.

    u, v: (ny, nx) [px], NaN = no vector. slopes: change of u and of v per grid step (along x, along y), (ny, nx) each:
    every neighbour then speaks for the place of the vector instead of its own, by the mean of both slopes, so that a
    sheared or curved flow is no disagreement, nor along a wall. Without slopes the grid is continued linearly beyond
    its border. certain: (ny, nx) where the vector's own slopes are no chance: what slopes change on the way to its
    neighbours then counts as scatter, as a flow that bends within a step bends from there on.
    Above about 2 is an outlier. NaN with fewer than 3 neighbours or no vector. Westerweel & Scarano 2005,
    doi:10.1007/s00348-005-0016-6, eq. (2), both components together.
    """
    total = np.zeros(u.shape)
    for f, slope in zip((u, v), slopes or (None, None)):
        middle, scatter = _medians(*_bordered(f, 1, slope), 1, ~np.isnan(f), certain)
        # 0.1 px of disagreement is never an outlier by itself (Westerweel & Scarano 2005)
        total += ((f - middle) / (scatter + 0.1)) ** 2
    return np.sqrt(total)


def local_median(
    f: Array, slope: tuple[Array, Array] | None = None, wanted: NDArray[np.bool_] | None = None
) -> tuple[Array, Array]:
    """Median of the neighbours (3 x 3, else 5 x 5) and their robust scatter; NaN with fewer than 3 of them.

    slope as in `normalised_median`; where the place has none, the median of the neighbours' stands for it. What slopes
    change on the way counts as scatter. wanted: (ny, nx) where they are asked for, None: everywhere; NaN elsewhere.
    """
    if wanted is None:
        wanted = np.ones(f.shape, bool)
    middle, scatter = _medians(*_bordered(f, 1, slope), 1, wanted, wanted)
    lonely = wanted & np.isnan(middle)
    if lonely.any():
        far = _medians(*_bordered(f, 2, slope), 2, lonely, lonely)
        middle, scatter = (np.where(lonely, w, n) for n, w in zip((middle, scatter), far))
    return middle, FROM_MAD * scatter


def beyond_chance(correlation: Array, window: int) -> NDArray[np.bool_]:
    """Where a match is too good to be one of pictures that have nothing in common."""
    at_16, most = CHANCE_MATCH.value
    return np.asarray(correlation > 1 - min(at_16 * (window / 16) ** 3, most))


def _bordered(f: Array, reach: int, slope: tuple[Array, Array] | None) -> tuple[Array, Array, Array]:
    """f and its slopes with a border of `reach` vectors."""
    if slope is None:
        p = np.pad(f, reach, mode="reflect", reflect_type="odd")
        return p, np.zeros_like(p), np.zeros_like(p)
    bordered = np.full((3, f.shape[0] + 2 * reach, f.shape[1] + 2 * reach), np.nan)  # np.pad takes 20 times as long
    bordered[:, reach:-reach, reach:-reach] = f, *slope
    p, px, py = bordered
    return p, px, py


def _medians(
    p: Array, px: Array, py: Array, reach: int, wanted: NDArray[np.bool_], bent: NDArray[np.bool_] | None
) -> tuple[Array, Array]:
    """Median of the neighbours within `reach` and of their distances from it, of a bordered field, where `wanted`;
    where `bent`, with what the slopes change on the way."""
    middle, scatter = np.full(wanted.shape, np.nan), np.full(wanted.shape, np.nan)
    bent = np.zeros(wanted.shape, bool) if bent is None else bent
    _fill_medians(len(middle), p, px, py, reach, wanted, bent, middle, scatter)
    return middle, scatter


@shared()
def _fill_medians(first, last, p, px, py, reach, wanted, bent, middle, scatter):  # type: ignore[no-untyped-def]
    most = (2 * reach + 1) ** 2 - 1
    near, of_x, of_y, bend = np.empty(most), np.empty(most), np.empty(most), np.empty(most)
    for j in range(first, last):
        for i in range(middle.shape[1]):
            if not wanted[j, i]:
                continue
            x0, y0 = px[j + reach, i + reach], py[j + reach, i + reach]
            if not (math.isfinite(x0) and math.isfinite(y0)):
                n = 0
                for y in range(j, j + 2 * reach + 1):
                    for x in range(i, i + 2 * reach + 1):
                        if math.isfinite(p[y, x] + px[y, x] + py[y, x]):
                            of_x[n], of_y[n] = px[y, x], py[y, x]
                            n += 1
                if n > 0:
                    x0, y0 = _median(of_x, n), _median(of_y, n)
            n = 0
            for dj in range(-reach, reach + 1):
                for di in range(-reach, reach + 1):
                    y, x = j + reach + dj, i + reach + di
                    value = p[y, x] - 0.5 * (di * (px[y, x] + x0) + dj * (py[y, x] + y0))
                    if (dj != 0 or di != 0) and math.isfinite(value):
                        near[n] = value
                        bend[n] = 0.5 * abs(di * (px[y, x] - x0) + dj * (py[y, x] - y0))
                        n += 1
            if n >= MIN_NEIGHBOURS:
                m = _median(near, n)
                middle[j, i] = m
                for k in range(n):
                    near[k] = abs(near[k] - m)
                scatter[j, i] = _median(near, n)
                if bent[j, i]:
                    scatter[j, i] += _median(bend, n)


# comparisons that bring the middle two of eight values there: a sorting network less those that order the others
EIGHT = (
    *((0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7), (0, 1), (2, 3), (4, 5), (6, 7), (2, 4), (3, 5)),
    *((1, 4), (3, 6)),
)


@nb.njit(cache=True)
def _median(f, n):  # type: ignore[no-untyped-def]
    """Median of the first n values, which are sorted in place, or eight of them partly."""
    if n == 8:
        for i, j in EIGHT:
            low, high = min(f[i], f[j]), max(f[i], f[j])
            f[i], f[j] = low, high
        return 0.5 * (f[3] + f[4])
    for k in range(1, n):
        value, at = f[k], k
        while at > 0 and f[at - 1] > value:
            f[at] = f[at - 1]
            at -= 1
        f[at] = value
    return 0.5 * (f[(n - 1) // 2] + f[n // 2])


LAG = 5  # px, side of the box within which residuals count as correlated


def factors(window: int, step: int, stiffness: float, times: int, clumping: float) -> tuple[float, float]:
    """Factors from the covariance of one window's single step to the standard uncertainty of d and of its gradient.

    clumping: mean of e times its box mean over mean(e)^2, e the squared gradient of the texture: where few pixels hold
    most of it, the fit takes more of their noise, but never all.
    """
    shift, slope, _ = _gains(window, step, stiffness, times)
    left = 1 / (1 + fitted(window, step, stiffness, times, clumping))
    return float(np.sqrt(shift / left)), float(np.sqrt(slope / left))


def fitted(window: int, step: int, stiffness: float, times: int, clumping: float) -> float:
    """Noise that the fit takes out of the residuals, over what it leaves there; clumping as of `factors`."""
    return clumping * _gains(window, step, stiffness, times)[2]


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


def response(
    window: int, step: int, stiffness: float, times: int, other: float, n: int = 128, order: int = 2
) -> tuple[Array, Array]:
    """R W and the response of a surface of stiffness `other` and that order, on the same wave numbers (n, n)."""
    g = taper(window).astype(np.float64)
    k = 2 * np.pi * np.fft.fftfreq(n)
    one_window = (g * np.cos(np.outer(k, np.arange(len(g)) - len(g) // 2))).sum(1) / g.sum()
    each = one_window, _surface(k * step, stiffness), _folded(k * step, other, order)
    w, s, o = (np.outer(q, q) for q in each)
    missed = s * (1 - w)
    return w * (1 - missed**times) / (1 - missed), o


PART = 2 / 3  # of the window's side, a finer window that shows what the whole one averages away


@functools.lru_cache(maxsize=16)
def noise_within(window: int, step: int, stiffness: float, times: int) -> tuple[float, float]:
    """Variance of what a window of PART of the side would add to a vector, for white noise, over that of its own match,
    and how much neighbours along an axis share of it."""
    fine, g = (taper(w).astype(np.float64) for w in (round(PART * window), window))
    k = 2 * np.pi * np.fft.fftfreq(256)
    finer, whole = ((f * np.cos(np.outer(k, np.arange(len(f)) - len(f) // 2))).sum(1) / f.sum() for f in (fine, g))
    w, f, s = (np.outer(q, q) for q in (whole, finer, _surface(k * step, stiffness)))
    missed = s * (1 - w)
    seen = w * (1 - missed**times) / (1 - missed)
    # waves that the vectors do not carry stand about a vector as its own value
    left = np.where(s > 0, f * (1 - seen), f - seen)
    power = (left**2).mean()
    shared_by_neighbours = (left**2 * np.cos(k * step)).mean() / power
    return FINER_NOISE.value * float(power / ((fine**2).sum() / fine.sum() ** 2) ** 2), float(shared_by_neighbours)


def unresolved(
    finer: Array, measured: NDArray[np.bool_], window: int, step: int, by_chance: tuple[float, float]
) -> Array:
    """Squared error [px^2] (2, ny, nx) of what the windows average away, from what finer ones see of it.

    finer: see `scatter.within`; by_chance: `noise_within`. Over two windows about a vector the mean square of the
    finer step is compared with its noise. Of long waves the finer windows see all, and neighbours agree on it; of short
    ones they see the less the less their neighbours share: 1 - what they share is (k step)^2 / 2.
    """
    side = 2 * max(2, round(window / step)) + 1
    known = measured & np.isfinite(finer).all(0) & (finer[2:] > 0).all(0)
    if not known.any():
        return np.zeros_like(finer[:2])
    q, noise = np.where(known, finer[:2], 0), by_chance[0] * np.where(known, finer[2:], 0)
    weight = np.where(known, 1 / (noise.mean(0) + np.median(noise[:, known])), 0)

    def around(f: Array) -> Array:
        return np.asarray(cv2.boxFilter(f, -1, (side, side), borderType=cv2.BORDER_REFLECT))

    total = np.maximum(around(weight), 1e-30)
    square, chance = (np.stack([around(weight * f) / total for f in fields]) for fields in (q * q, noise))
    motion = np.maximum(square - chance, 0).sum(0)
    alike = _alike(q, weight, around) - by_chance[1] * chance.sum(0)
    apart = 1 - np.clip(alike / np.maximum(motion, 1e-30), 0, 1)
    short = np.minimum(apart * (window / (3 * step)) ** 2, SHORTEST_WAVES.value)
    return np.asarray((1 + SHORT_WAVES.value * short) * np.maximum(square - FINER_MOTION.value * chance, 0))


def _alike(q: Array, weight: Array, around: Callable[[Array], Array]) -> Array:
    """Mean product of both components with those of the next vector, along either axis."""
    product, total = np.zeros_like(weight), np.zeros_like(weight)
    for a, b in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        both = np.zeros_like(weight)
        both[a] = np.sqrt(weight[a] * weight[b])
        of = np.zeros_like(weight)
        of[a] = sum(f[a] * f[b] for f in q)
        product += around(both * of)
        total += around(both)
    return product / np.maximum(total, 1e-30)


@functools.lru_cache(maxsize=16)
def error_length(window: int, step: int, stiffness: float, times: int) -> float:
    """Side [px] of the square over which the errors of vectors are worth that of one.

    The integral of their correlation over the plane is its square: the power at k = 0 over its mean.
    """
    seen = response(window, step, stiffness, times, 0.0, min(max(128, 32 * step), 1024))[0]
    return float(1 / np.sqrt((seen**2).mean()))


def _surface(theta: NDArray[np.floating], stiffness: float) -> Array:
    """Response of the smoothed surface (`surface.axis`) to waves of theta rad a vector; none beyond the grid's."""
    return np.where(np.abs(theta) < np.pi, _folded(theta, stiffness, 2), 0)


def _folded(theta: NDArray[np.floating], stiffness: float, order: int) -> Array:
    """The same of vectors, which take shorter waves for longer ones."""
    return 1 / (1 + stiffness * (2 - 2 * np.cos(theta)) ** order)
