"""Coarse displacement: by dense inverse search, or by correlation of ever smaller windows where that fails."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from jumpvision.vision.piv.backend import NUMPY, Backend
from jumpvision.vision.piv.correlate import correlate, peaks
from jumpvision.vision.piv.frame import Frame
from jumpvision.vision.piv.validate import local_median, normalised_median

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]


FLOW_LEAST = 48  # px, smaller images leave the search no pyramid


class Coarse(NamedTuple):
    """Displacement on a coarse grid of windows, before any sub-pixel matching."""

    x: Array  # (nx,) [px]
    y: Array  # (ny,) [px]
    u: Array  # (ny, nx) [px], outliers replaced, finite
    v: Array
    u2: Array  # (ny, nx) [px] second peak
    v2: Array
    at_edge: NDArray[np.bool_]  # (ny, nx)


def predict(
    pairs: list[tuple[Frame, Frame]], *, passes: tuple[int, ...], outlier: float, on: Backend = NUMPY
) -> Coarse:
    """Correlation passes with window sizes `passes` [px]; the correlations of several pairs are averaged (ensemble).

    Windows overlap by half. Each pass shifts the two windows by whole pixels, half each, and searches up to half a
    window around. `outlier`: limit of the normalised median test; outliers try their second peak, then the median.
    on: where the correlations are computed.
    """
    height, width = pairs[0][0].grey.shape
    coarse: Coarse | None = None
    for size in passes:
        x, y = _centres(width, size), _centres(height, size)
        if coarse is None:
            u = v = np.zeros((len(y), len(x)))
        else:
            u, v = (np.rint(at(coarse, f, x, y)) for f in (coarse.u, coarse.v))
        # the split of an odd shift leaves the vector half a pixel from its window: of no account for a predictor
        ua, va = np.floor_divide(u, 2), np.floor_divide(v, 2)
        planes: list[Float32] = []
        light = np.full(u.size, np.inf)
        for a, b in pairs:
            first = _windows(a.grey, a.usable, x, y, -ua, -va, size)
            second = _windows(b.grey, b.usable, x, y, u - ua, v - va, size)
            planes.append(correlate(*first, *second, on))
            light = np.minimum(light, np.minimum(first[1].mean((1, 2)), second[1].mean((1, 2))))
        found = peaks(np.asarray(sum(planes[1:], planes[0]) / np.float32(len(planes)), np.float32))
        shape = u.shape
        u1, v1, u2, v2 = (
            s + q.reshape(shape)
            for s, q in ((u, found.u[:, 0]), (v, found.v[:, 0]), (u, found.u[:, 1]), (v, found.v[:, 1]))
        )
        blind = (light < 0.25) | (found.height[:, 0] <= 0)
        u1[blind.reshape(shape)] = np.nan
        v1[blind.reshape(shape)] = np.nan
        u1, v1 = _validated(u1, v1, u2, v2, outlier)
        coarse = Coarse(x, y, u1, v1, u2, v2, found.at_edge.reshape(shape))
    if coarse is None:
        raise ValueError("passes = (): at least one window size [px] is needed, for example (64, 32)")
    return coarse


def at(coarse: Coarse, f: Array, x: Array, y: Array) -> Array:
    """A field of the coarse grid, linearly interpolated at the columns x (nx,) and rows y (ny,)."""
    i = np.interp(x, coarse.x, np.arange(len(coarse.x)))
    j = np.interp(y, coarse.y, np.arange(len(coarse.y)))
    return ndimage.map_coordinates(f, np.meshgrid(j, i, indexing="ij"), order=1, mode="nearest")


def flow(a: Float32, b: Float32, x: Array, y: Array, step: int) -> tuple[Array, Array]:
    """Displacement at the columns x and rows y by dense inverse search (Kroeger et al. 2016).

    doi:10.1007/978-3-319-46493-0_29.

    To a fraction of a pixel, without masks and validation; zero for images too small for it.
    """
    if min(a.shape) < FLOW_LEAST:
        none = np.zeros((len(y), len(x)))
        return none, none
    low, high = (float(q) for q in np.percentile(a[::4, ::4], (0.5, 99.5)))
    gain = 255 / max(high - low, 1e-6)
    # the search ends at a quarter of the resolution, so half of it is enough to begin with
    part = 2 if min(a.shape) >= 2 * FLOW_LEAST else 1
    size = (a.shape[1] // part, a.shape[0] // part)
    first, second = (
        cv2.convertScaleAbs(
            cv2.resize(np.clip(f, low, high), size, interpolation=cv2.INTER_AREA), alpha=gain, beta=-low * gain
        )
        for f in (a, b)
    )
    search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    search.setVariationalRefinementIterations(0)
    search.setFinestScale(2 // part)
    found = search.calc(first, second, None)  # type: ignore[call-overload]
    found = cv2.GaussianBlur(found, (0, 0), step / (2 * part))
    rows, columns = (np.minimum(q.astype(np.intp) // part, n - 1) for q, n in ((y, size[1]), (x, size[0])))
    at_vectors = part * found[np.ix_(rows, columns)].astype(np.float64)
    return at_vectors[..., 0], at_vectors[..., 1]


def _centres(length: int, size: int) -> Array:
    """Window centres at half a window's distance, symmetric about the middle of the image; one at least."""
    n = max(1, 1 + (length - size) // (size // 2))
    first = (length - (n - 1) * (size // 2)) // 2
    return np.rint(first + size // 2 * np.arange(n)).astype(np.float64)


def _windows(image: Float32, mask: Mask, x: Array, y: Array, u: Array, v: Array, size: int) -> tuple[Float32, Float32]:
    """Windows around (x + u, y + v) and their weights, shape (ny nx, size, size); weight 0 outside the image."""
    height, width = image.shape
    offset = np.arange(size) - size // 2
    rows = ((y[:, None] + v).ravel()[:, None] + offset).astype(np.intp)
    columns = ((x + u).ravel()[:, None] + offset).astype(np.intp)
    inside = ((rows >= 0) & (rows < height))[:, :, None] & ((columns >= 0) & (columns < width))[:, None]
    rows, columns = np.clip(rows, 0, height - 1)[:, :, None], np.clip(columns, 0, width - 1)[:, None]
    return image[rows, columns], (inside & mask[rows, columns]).astype(np.float32)


def _validated(u: Array, v: Array, u2: Array, v2: Array, outlier: float) -> tuple[Array, Array]:
    """Outliers and holes replaced by the second peak if that fits its neighbours, else by the local median."""
    bad = ~np.isfinite(u) | (normalised_median(u, v) > outlier)
    good_u, good_v = np.where(bad, np.nan, u), np.where(bad, np.nan, v)
    with_second = normalised_median(np.where(bad, u2, good_u), np.where(bad, v2, good_v))
    second = bad & np.isfinite(u) & (with_second < outlier)
    u, v = (np.where(second, alt, good) for alt, good in ((u2, good_u), (v2, good_v)))
    while np.isnan(u).any():
        (fill_u, _), (fill_v, _) = local_median(u), local_median(v)
        holes = np.isnan(u) & np.isfinite(fill_u)
        if not holes.any():  # too little left to fill from: whatever there is, or no displacement
            mean_u, mean_v = (np.nanmedian(f) if np.isfinite(f).any() else 0.0 for f in (u, v))
            return np.where(np.isnan(u), mean_u, u), np.where(np.isnan(v), mean_v, v)
        u, v = np.where(holes, fill_u, u), np.where(holes, fill_v, v)
    return u, v
