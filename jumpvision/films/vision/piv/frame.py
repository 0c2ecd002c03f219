"""A film frame as a smooth function of place, smoothed lightly against noise and aliasing."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from jumpvision.base.arrays import Array, Float32
from jumpvision.base.threads import at_once
from jumpvision.films.calibration import FOLDED_PARTICLES, LEAST_WHITE

PREFILTER_PX = 0.8  # standard deviation of the Gaussian that frames are smoothed with


class Frame(NamedTuple):
    """A frame ready for matching."""

    grey: Float32  # (H, W) as it came, NaN filled
    usable: NDArray[np.bool_]  # (H, W)
    c: Float32  # cubic B-spline of the padded frame: (1, rows, columns) knots on pixels, or (2, 2 rows, columns) every
    # half pixel, those of even columns and of odd: pixel q then lies at 2 q + 1 / 2
    weight: NDArray[np.uint8]  # 0 or 1 for each pixel of the padded frame
    pad: int  # px of border around the frame
    rounding: float  # [grey^2] variance that whole grey levels leave after smoothing, 0 for frames of fractions
    noise: float  # [grey^2] variance that white noise leaves after smoothing, see `white`; NaN where not known


def prepare(image: NDArray[np.generic], mask: NDArray[np.bool_] | None, pad: int, fine: bool) -> Frame:
    """Spline of an image (H, W) [grey] and weights that stay 2 px away from unusable pixels.

    NaN pixels and those outside mask are unusable. fine: knots every half pixel; a cubic spline between those follows
    grains of 3 px to 0.002 px, on the pixels themselves only to 0.02 px.
    """
    grey = image.astype(np.float32)
    kept = 1 / (4 * math.pi * PREFILTER_PX**2)  # of the variance of white noise
    rounding = 0.0 if np.issubdtype(image.dtype, np.floating) else kept / 12
    usable = np.isfinite(grey)
    if not usable.all():
        grey = np.where(usable, grey, np.float32(grey[usable].mean() if usable.any() else 0.0))
    if mask is not None:
        usable = usable & mask
    padded = np.asarray(cv2.copyMakeBorder(grey, *(pad,) * 4, cv2.BORDER_REFLECT), np.float32)
    taps = _taps(fine)
    c = np.empty((len(taps), len(taps) * padded.shape[0], padded.shape[1]), np.float32)

    def noise_and_usable() -> tuple[float, NDArray[np.bool_]]:
        noise = white(image, mask)
        return noise, usable & ~body(grey, usable, noise if math.isfinite(noise) else 0.0)

    filters: list[Callable[[], Any]] = [
        functools.partial(_filtered, padded, kernel_x, kernel_y, c[of_columns, of_rows :: len(taps)], part)
        for of_rows, kernel_y in enumerate(taps)
        for of_columns, kernel_x in enumerate(taps)
        for part in _parts(len(padded), 1 if fine else 2)  # fine ones are four filters already
    ]
    (noise, usable), *_ = at_once([noise_and_usable, *filters])
    # the gradient stencil and the spline reach so far
    keep = usable if usable.all() else scipy.ndimage.binary_erosion(usable, iterations=2, border_value=1)
    weight = np.ascontiguousarray(np.pad(keep, pad), np.uint8)
    return Frame(grey, usable, c, weight, pad, rounding, kept * noise)


def _parts(rows: int, count: int) -> list[slice]:
    return [slice(k * rows // count, (k + 1) * rows // count) for k in range(count)]


def _filtered(
    f: Float32, kernel_x: NDArray[np.float64], kernel_y: NDArray[np.float64], out: Float32, part: slice
) -> None:
    """Some rows of f filtered along both axes, into those of out."""
    if part == slice(0, len(f)):
        cv2.sepFilter2D(f, -1, kernel_x, kernel_y, out, borderType=cv2.BORDER_REFLECT)
        return
    reach = len(kernel_y) // 2
    top, bottom = max(0, part.start - reach), min(len(f), part.stop + reach)
    near = cv2.sepFilter2D(f[top:bottom], -1, kernel_x, kernel_y, borderType=cv2.BORDER_REFLECT)
    out[part] = near[part.start - top : part.stop - top]


CELL = 4  # px, side of the blocks in which a body is looked for
EMPTY = 0.01  # of the usual contrast (a tenth of the usual grey): less is no texture
AT_LEAST = 6.0  # grains or particles in a disc: by chance one in 400 holds none
BY_CHANCE = 4.0  # such discs: empty regions that are larger are no chance


def body(grey: Float32, usable: NDArray[np.bool_], noise: float) -> NDArray[np.bool_]:
    """Pixels (H, W) of a body that shows no texture where most of the picture does, and its rim.

    A bar or a foot before the grains: what moves there is not what is asked for. It is 3 CELLs wide at least, or as
    wide as a disc that holds AT_LEAST particles elsewhere, and larger than chance leaves empty; one that is darker
    than the grains may show some texture. noise: [grey^2] variance of the picture's white noise.
    """
    out = np.zeros(grey.shape, bool)
    rows, columns = (n // CELL for n in grey.shape)
    if min(rows, columns) < 8:
        return out
    cells = np.ascontiguousarray(grey[: rows * CELL : 2, : columns * CELL : 2])
    mean = cv2.resize(cells, (columns, rows), interpolation=cv2.INTER_AREA)
    square = cv2.resize(cells * cells, (columns, rows), interpolation=cv2.INTER_AREA)
    there = usable[CELL // 2 :: CELL, CELL // 2 :: CELL][:rows, :columns]
    if not there.any():
        return out
    whole = np.zeros((rows, columns), np.uint8)
    for side in (3, 5, 7, 9, 13):
        disc = _disc(side)
        light, contrast = (
            cv2.filter2D(f, -1, disc / disc.sum(), borderType=cv2.BORDER_REFLECT) for f in (mean, square)
        )
        contrast = contrast - light * light - noise
        of_light = np.maximum(contrast, 0) / np.maximum(light * light, 1e-6)
        usual = [float(np.median(q[there][::4])) for q in (light, contrast, of_light)]
        if side == 3:
            # a body has little of the usual light and contrast; grains in the shade keep theirs over their light
            dark = (
                (light < 0.4 * usual[0])
                & (contrast + noise < 0.3**2 * (usual[1] + noise))
                & (of_light < 0.5**2 * usual[2])
            )
            # bright particles on a dark ground have gaps that are no body; a picture that is mostly dark has none
            if usual[2] <= 0.5 and not (dark & there).sum() > 0.6 * there.sum():
                whole |= cv2.dilate(
                    cv2.morphologyEx((dark & there).astype(np.uint8), cv2.MORPH_OPEN, _square(3)), _square(5)
                )
        # 0.674 standard deviations, which are mean / sqrt(number); upwards, as bodies lower the other quartile
        by_chance = float(np.quantile(contrast[there][::4], 0.75)) - usual[1]
        if usual[1] > 0 and (0.674 * usual[1]) ** 2 > AT_LEAST * by_chance**2:
            empty = (contrast < EMPTY * usual[1]) & (of_light < EMPTY * usual[2]) & there
            if not empty.any():
                break
            from skimage.measure import label  # here: its import takes a quarter of a second

            regions = label(cv2.dilate(empty.astype(np.uint8), disc))
            large = np.flatnonzero(np.bincount(regions.ravel())[1:] > BY_CHANCE * side**2) + 1
            empty &= np.isin(regions, large)
            if empty.sum() <= 0.6 * there.sum():
                whole |= cv2.dilate(empty.astype(np.uint8), _disc(side + 2))
            break
    out[: rows * CELL, : columns * CELL] = np.repeat(np.repeat(whole > 0, CELL, 0), CELL, 1)
    return out


def _square(side: int) -> NDArray[np.uint8]:
    return np.ones((side, side), np.uint8)


def _disc(side: int) -> NDArray[np.uint8]:
    """About as many cells as a square of that side has; an inclined bar holds it as well as an upright one."""
    n = np.arange(side) - side // 2
    return ((n**2 + n[:, None] ** 2) * np.pi <= side**2).astype(np.uint8)


@functools.cache
def _taps(fine: bool) -> list[NDArray[np.float64]]:
    """Smoothing and coefficients of the cubic spline, as weights of the neighbours along one axis.

    On the pixels, or on the places a quarter of a pixel before and behind them: there by least squares of the response
    to the waves that pixels carry, true to 0.001 below 2.6 rad/px.
    """
    if not fine:
        n = np.arange(-10, 11)
        bell = np.exp(-0.5 * (n / PREFILTER_PX) ** 2)
        return [np.convolve(bell / bell.sum(), math.sqrt(3) * (math.sqrt(3) - 2) ** np.abs(n), "same")]
    n = np.arange(-6, 7)
    k = np.pi * (np.arange(512) + 0.5) / 512  # [rad/px]; the spline has the samples (4 + 2 cos(k / 2)) / 6 there
    gain = np.exp(-0.5 * (PREFILTER_PX * k) ** 2) * 6 / (4 + 2 * np.cos(k / 2))
    # pictures hold next to nothing beyond 2.6 rad/px, and what they hold there is aliased in part
    weight = 1 / (1 + np.exp((k - 2.6) / 0.08)) + 1e-3
    waves = np.exp(1j * np.outer(k, n + 0.25)) * weight[:, None]
    before = np.linalg.lstsq(np.vstack([waves.real, waves.imag]), np.concatenate([gain * weight, 0 * k]))[0]
    before /= before.sum()
    return [before, before[::-1]]


def taper(window: int) -> Float32:
    """Weight along one side of the window, length 2 h + 1, h = window // 2; across it is the product."""
    h = window // 2
    # Gaussian; its standard deviation is 0.45 of half the window
    return np.exp(-0.5 * (np.arange(-h, h + 1) / (0.45 * (h + 0.5))) ** 2).astype(np.float32)


BLOCK, BLOCKS = 32, 40  # px, side of the blocks whose spectra are averaged (Welch 1967); of so many (50 waves each)


def white(image: NDArray[np.generic], mask: NDArray[np.bool_] | None) -> float:
    """Variance [grey^2] of the white noise of an image, by the corner of its spectrum; NaN without a block whose
    pixels are all usable.

    Sharp particles reach into the corner: what they hold there is continued from two rings further in, as the spectrum
    of a Gaussian falls, and taken off: grains and particles of 3 px and more leave up to 0.5 grey^2 there.
    Where the rings hardly fall, particles of 2 px and less are folded into the corner, and next to nothing is said to
    be noise: then less is taken for chance than is.
    """
    power = _spectrum(image, mask)
    if power is None:
        return math.nan
    (inner, of_inner), (outer, of_outer), (corner, of_corner) = (
        (float(power[r].mean()), float((FAR[r] ** 2).mean())) for r in RINGS
    )
    if corner < outer and inner - corner < FOLDED_PARTICLES.value * (outer - corner):
        return LEAST_WHITE.value * corner / float(HANN.sum()) ** 2
    ahead = (of_corner - of_outer) / (of_outer - of_inner)
    noise = corner
    for _ in range(20):  # a fixed point that comes to rest in a few turns
        left = outer - noise, inner - noise
        if not 0 < left[0] < left[1]:
            break
        noise = max(corner - left[0] * (left[0] / left[1]) ** ahead, LEAST_WHITE.value * corner)
    return noise / float(HANN.sum()) ** 2


WAVES = np.abs(np.fft.fftfreq(BLOCK))
FAR = np.hypot(WAVES, WAVES[:, None])
RINGS = (FAR >= 0.3) & (FAR < 0.38), (FAR >= 0.44) & (FAR < 0.5), FAR >= 0.6
HANN = (0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(BLOCK) + 0.5) / BLOCK)) ** 2


def _spectrum(image: NDArray[np.generic], mask: NDArray[np.bool_] | None) -> Array | None:
    """Power of the waves of blocks, their mean; blocks with unusable or NaN pixels are left out, None without any."""
    rows, columns = (n // BLOCK for n in image.shape)
    blocks = _blocks(image, rows, columns)
    good = np.ones(len(blocks), bool) if mask is None else _blocks(mask, rows, columns).all((1, 2))
    if np.issubdtype(image.dtype, np.floating):
        good &= np.isfinite(blocks).all((1, 2))
    chosen = np.flatnonzero(good)
    if not len(chosen):
        return None
    some = blocks[chosen[:: -(-len(chosen) // BLOCKS)]].astype(np.float32)
    window = np.sqrt(np.outer(HANN, HANN)).astype(np.float32)
    waves = np.fft.rfft2((some - some.mean((1, 2), keepdims=True)) * window)
    power = (waves.real**2 + waves.imag**2).mean(0)
    other = np.roll(power[::-1, -2:0:-1], 1, axis=0)  # those of opposite sign, alike for real pictures
    return np.concatenate([power, other], axis=1)


def _blocks(f: NDArray[np.generic], rows: int, columns: int) -> NDArray[np.generic]:
    cut = f[: rows * BLOCK, : columns * BLOCK].reshape(rows, BLOCK, columns, BLOCK)
    return cut.swapaxes(1, 2).reshape(-1, BLOCK, BLOCK)
