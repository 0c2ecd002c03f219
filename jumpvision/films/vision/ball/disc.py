"""Image of a disc, its fit to a crop of one frame, and what the fit of one frame teaches the next."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from jumpvision.base.arrays import Array

from .normal_equations import (
    DROPPED,
    OF_BACK,
    OF_BALL,
    OF_EDGE,
    PIXELS,
    RESIDUAL_SLOPE,
    RESIDUAL_STEP,
    ROOM,
    SECTORS,
    SLOPE_SQUARED,
    SQUARES,
    STEP_SQUARED,
    Zone,
    accumulate,
    pixels_in_use,
)
from .unknowns import BX, GY, WX, WY, A, B, R, S, X, Y

MAX_STEPS = 40


@njit(cache=True)
def margin(s):  # type: ignore[no-untyped-def]
    """Width of background used outside the disc [px]."""
    return max(4.0, 5.0 * s)


class DiscFit(NamedTuple):
    """Fit to one frame. p: parameters in the order of NAMES, px and grey levels; cov: their covariance for `noise`."""

    p: Array  # (12,)
    cov: Array  # (12, 12)
    noise: Array  # (3,) variance found in this frame: background, ball, excess at the edge [grey^2]
    chi2: float  # of this frame per degree of freedom, against the noise that was given; capped residuals
    sectors: Array  # (16,) contrast of each sector of the rim over the model's; 1 when all is well, NaN where no pixels
    shifts: Array  # (16,) by how much the rim of each sector lies outside the fitted circle [px], to first order
    shift_sigmas: Array  # (16,) their standard uncertainty [px]
    dropped: float  # part of the edge pixels that the robust weight drops
    converged: bool


@njit(cache=True)
def invert(h, n, inverse):  # type: ignore[no-untyped-def]
    """Inverse of the leading n x n block of a positive definite matrix by Cholesky; False if it is not one."""
    low = np.zeros((n, n))
    for i in range(n):
        for k in range(i + 1):
            total = h[i, k]
            for m in range(k):
                total -= low[i, m] * low[k, m]
            if i == k:
                if not total > 1e-12 * h[i, i]:
                    return False
                low[i, i] = math.sqrt(total)
            else:
                low[i, k] = total / low[k, k]
    inv_low = np.zeros((n, n))
    for i in range(n):
        inv_low[i, i] = 1.0 / low[i, i]
        for k in range(i):
            total = 0.0
            for m in range(k, i):
                total -= low[i, m] * inv_low[m, k]
            inv_low[i, k] = total / low[i, i]
    inverse[:] = 0.0
    for i in range(n):
        for k in range(n):
            total = 0.0
            for m in range(max(i, k), n):
                total += inv_low[m, i] * inv_low[m, k]
            inverse[i, k] = total
    return True


@njit(inline="always")
def _fit(img, p, n_par, noise, mean, weight):  # type: ignore[no-untyped-def]
    """Gauss-Newton from p (changed in place) with a prior `mean`, `weight` = 1/variance (0: flat) on each parameter."""
    h, g = np.zeros((12, 14)), np.zeros(12)
    cov = np.zeros((12, 12))
    classes, sectors = np.zeros((3, 6)), np.zeros((4, SECTORS))
    work = np.empty(ROOM)
    step = np.zeros(12)
    soft = 1e30
    settled = False
    good = frozen = False
    pixels, count = np.empty((3, 0)), 0
    size, enough = np.inf, 0.0
    for _ in range(MAX_STEPS):
        if not frozen:  # far from the answer the pixels follow it, and a part of the rows of a large ball will do
            wx, wy = (p[WX], p[WY]) if n_par == 12 else (0.0, 0.0)
            zone = Zone(p[X], p[Y], p[R], wx, wy, min(0.4 * p[R], 12.0), margin(p[S]))
            # a ball of 16 px radius is approached by every second row, of 24 px by every third
            pixels = pixels_in_use(img, zone, 1 if settled else max(1, int(p[R] / 8.0)))
            frozen, count = settled, pixels.shape[1]
            if count <= n_par:
                break
        # within 20 last steps the next may be the last, and its sums are kept
        near = settled and size < 20.0 * enough
        if near:
            classes[:] = 0.0
            sectors[:] = 0.0
        total = accumulate(pixels, p, n_par, noise, soft, near, work, h, g, classes, sectors)
        for m in range(n_par):
            h[m, m] += weight[m]
            g[m] += weight[m] * (mean[m] - p[m])
        if not invert(h, n_par, cov):
            break
        scale = 1.0
        for m in range(n_par):
            step[m] = 0.0
            for n in range(n_par):
                step[m] += cov[m, n] * g[n]
        # A step within the edge's width keeps the linear model valid
        limit = max(1.5 * p[S], 0.1 * p[R])
        for m in (X, Y, R):
            scale = min(scale, limit / max(abs(step[m]), 1e-9))
        scale = min(scale, 0.5 * p[S] / max(abs(step[S]), 1e-9))
        for m in range(n_par):
            p[m] += scale * step[m]
        p[S] = max(p[S], 0.29)  # px, the blur of a square pixel alone
        if not (abs(p[X]) < 1e6 and abs(p[Y]) < 1e6 and 1.5 < p[R] < 1e5 and p[S] < 2.0 * p[R]):
            break
        if not (abs(p[WX]) < 1e4 and abs(p[WY]) < 1e4):
            break
        size = max(abs(step[X]), abs(step[Y]), abs(step[R]))
        # the last step is a tenth of sigma; each is some tenth of the one before
        enough = max(3e-5, 0.1 * np.sqrt(min(cov[X, X], cov[Y, Y])))
        if size < 0.1 and not settled:
            settled = True
            soft = 1.0
        elif settled and size < enough:
            good = True
            if near:
                return cov, classes, sectors, total / max(1.0, count - n_par), True
            break
        elif not settled:  # far from the answer the misfit, not the noise, sets what is an outlier
            soft = max(1.0, total / count)
            if soft < 1.5:
                soft = 1.0
    soft = 1.0
    classes[:] = 0.0
    sectors[:] = 0.0
    last = n_par > 0  # True; as a literal it would have the sums compiled once more
    total = accumulate(pixels, p, n_par, noise, soft, last, work, h, g, classes, sectors)
    for m in range(n_par):
        h[m, m] += weight[m]
    if not invert(h, n_par, cov):
        good = False
    elif settled and not good:  # a pixel that goes in and out of the fit: the rest of the walk is a part of sigma
        # a fit that need not come to rest ends with a twentieth of sigma
        good = size < 0.05 * np.sqrt(max(cov[X, X], cov[Y, Y]))
    return cov, classes, sectors, total / max(1.0, count - n_par), good


def fit_disc(image: Array, start: Array, *, streak: bool, noise: Array, mean: Array, var: Array) -> DiscFit:
    """Fit the disc to `image` (row, column) [grey levels, NaN = no data]; row down, pixel centres at integers.

    start: (12,) in the order of NAMES. noise: (3,) variances of background, ball and edge excess, all used as given.
    mean, var: prior on each parameter (var = inf: none). The streak (wx, wy) is held at 0 unless `streak`.
    """
    return DiscFit(*fit_and_judge(np.ascontiguousarray(image), start, streak, noise, mean, var))


@njit(cache=True, nogil=True, error_model="numpy")
def fit_and_judge(image, start, streak, noise, mean, var):  # type: ignore[no-untyped-def]
    """The fields of DiscFit."""
    p, weight, centre = start.copy(), 1.0 / var, mean.copy()
    if not streak:
        p[WX] = p[WY] = 0.0
    for m in range(len(p)):
        if weight[m] == 0.0:
            centre[m] = 0.0
    cov, classes, sectors, chi2, good = _fit(image, p, 12 if streak else 10, noise, centre, weight)
    found, contrast, shifts, shift_sigmas = _summary(classes, sectors, p[A] - p[B], streak)
    dropped = classes[2, DROPPED] / max(classes[2, PIXELS], 1.0)
    return p, cov, found, chi2, contrast, shifts, shift_sigmas, dropped, good


@njit(cache=True)
def _median(values):  # type: ignore[no-untyped-def]
    """Of a few values; numpy's takes a second to compile."""
    n, x = len(values), values.copy()
    for i in range(1, n):
        for k in range(i, 0, -1):
            if x[k] < x[k - 1]:
                x[k], x[k - 1] = x[k - 1], x[k]
    return 0.5 * (x[(n - 1) // 2] + x[n // 2])


@njit(cache=True, error_model="numpy")
def _summary(classes, sectors, contrast, streak):  # type: ignore[no-untyped-def]
    """noise, sectors, shifts and shift_sigmas of DiscFit from the sums of the last step."""
    noise = np.zeros(3)
    # Degrees of freedom each class spends: level and gradient; centre, radius and blur (and streak)
    spent = (3.0, 3.0, 6.0 if streak else 4.0)
    square = np.zeros(3)
    for c in range(3):
        square[c] = classes[c, SQUARES] * classes[c, PIXELS] / max(classes[c, PIXELS] - spent[c], 1.0)
    noise[0], noise[1] = square[0] / classes[0, OF_BACK], square[1] / classes[1, OF_BALL]
    noise[2] = (square[2] - noise[0] * classes[2, OF_BACK] - noise[1] * classes[2, OF_BALL]) / classes[2, OF_EDGE]
    shares = 1.0 + sectors[RESIDUAL_STEP] / sectors[STEP_SQUARED] / contrast
    shifts, sigmas = sectors[RESIDUAL_SLOPE] / sectors[SLOPE_SQUARED], 1.0 / np.sqrt(sectors[SLOPE_SQUARED])
    least = 0.3 * _median(sectors[STEP_SQUARED])
    for q in range(SECTORS):
        if sectors[STEP_SQUARED, q] < least:  # outside the image, or no data
            shares[q] = shifts[q] = sigmas[q] = np.nan
    return noise, shares, shifts, sigmas


# Of the 16 sectors' shifts, what the fit leaves free; enters every sigma of a disc by the rim factor. Set on white
# noise, diameters of 10-40 px (2026-11-21); benchmarks/ball.py judges sigma on drawn discs of the same kind.
RIM_FREEDOM = 12.7
# Drift of the lighting gradients a frame, as part of the contrast: first guess (the background changes most, as the
# ball passes over it), least, and how fast it follows what the frames show
DRIFT = np.array([0.01, 0.01, 0.003, 0.003])
LEAST_DRIFT = 2e-4
DRIFT_GAIN = 0.15
NOISE_FRAMES = 30  # frames the noise is averaged over
LIGHT = slice(BX, GY + 1)
FIRST_LIGHT, LAST_LIGHT, BALL, BACK = BX, GY, A, B


@njit(cache=True, error_model="numpy")
def rim_faults(sectors, shifts, sigmas, rim, factor):  # type: ignore[no-untyped-def]
    """(sectors whose contrast is wrong, largest significant shift of a sector from its usual place `rim` [px])."""
    off, none, dent = 0, 0, 0.0
    for q in range(len(rim)):
        if not math.isfinite(sectors[q]):
            none += 1
            continue
        # a sector of the rim whose contrast is off by more than half is covered
        if not abs(sectors[q] - 1.0) < 0.5:
            off += 1
        moved = abs(shifts[q] - rim[q])
        # a shift of a sector counts from 6 standard deviations on
        if moved > 6.0 * sigmas[q] * math.sqrt(factor):
            dent = max(dent, moved)
    # sectors without data widen sigma; where more than a quarter of the rim has none, they count as covered
    return (off if none <= len(rim) // 4 else off + none), dent


class Memory(NamedTuple):
    """What the good fits so far have taught (`learn`), changed in place."""

    noise: Array  # (3,) running mean of DiscFit.noise
    last: Array  # (12,) parameters of the last fit
    light_var: Array  # (4,) variance of the prior on its lighting gradients
    drift: Array  # (4,) of the gradients from frame to frame, as part of the contrast
    rim: Array  # (16,) running mean shape of the rim, px outside the circle
    mean: Array  # (3,) running mean diameter [px], rim factor, good fits so far


DIAMETER, RIM_FACTOR, FRAMES = range(3)  # of Memory.mean


def empty_memory() -> Memory:
    return Memory(
        np.zeros(3), np.zeros(12), np.zeros(4), DRIFT.copy(), np.zeros(SECTORS), np.array([math.nan, 1.0, 0.0])
    )


@njit(cache=True, error_model="numpy")
def learn(memory, p, cov, noise, shifts, sigmas):  # type: ignore[no-untyped-def]
    """Takes a good fit (p, cov, noise, shifts, sigmas) into memory."""
    mean, rim, last = memory.mean, memory.rim, memory.last
    mean[FRAMES] += 1.0
    frames, d = mean[FRAMES], 2.0 * p[R]
    n = min(frames, NOISE_FRAMES)
    if frames == 1.0:
        mean[DIAMETER] = d
        for k in range(3):
            memory.noise[k] = noise[k]
    else:
        mean[DIAMETER] += (d - mean[DIAMETER]) / n
        for k in range(3):
            memory.noise[k] += (noise[k] - memory.noise[k]) / n
    moved = 0.0
    for q in range(len(rim)):
        by = shifts[q] - rim[q]
        if math.isfinite(by):
            moved += (by / sigmas[q]) ** 2
            rim[q] += by / n
    if frames > 1.0:
        moved *= (n - 1) / n / RIM_FREEDOM
        mean[RIM_FACTOR] += (min(moved, 10.0 * mean[RIM_FACTOR]) - mean[RIM_FACTOR]) / n
    contrast = abs(p[BALL] - p[BACK])
    for m in range(FIRST_LIGHT, LAST_LIGHT + 1):
        k, var = m - FIRST_LIGHT, cov[m, m]
        if frames > 1.0:
            # A fit moves its prior by (prior variance - posterior variance)^(1/2), if the drift allowed for is right
            ratio = (p[m] - last[m]) ** 2 / max(memory.light_var[k] - var, 1e-30)
            memory.drift[k] = max(memory.drift[k] * math.exp(0.5 * DRIFT_GAIN * (min(ratio, 9.0) - 1.0)), LEAST_DRIFT)
        memory.light_var[k] = var + (memory.drift[k] * contrast) ** 2
    for m in range(len(p)):  # an array put into another as a whole takes seconds to compile
        last[m] = p[m]
