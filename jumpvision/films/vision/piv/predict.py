"""Coarse displacement: by dense inverse search, or by masked correlation of ever smaller windows where that fails."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
import scipy.fft
from numpy.typing import NDArray

from jumpvision.base.arrays import Array, Float32

from .frame import Frame
from .validate import local_median, normalised_median

CHUNK = 512  # windows per batch of FFTs; larger batches leave the CPU cache
MIN_OVERLAP = 0.25  # share of the texture of each window that must take part in a match


class Peaks(NamedTuple):
    """Best and second-best shift of each window, in px from the first window to the second."""

    u: Array  # (n, 2) first and second peak
    v: Array  # (n, 2)
    height: Array  # (n, 2) normalised correlation
    at_edge: NDArray[np.bool_]  # (n,) the best shift lies on the edge of the search


def correlate(a: Float32, wa: Float32, b: Float32, wb: Float32) -> Float32:
    """Normalised correlation of window pairs for all shifts up to half a window.

    a, b: (n, s, s) grey; wa, wb: (n, s, s) weights 0..1. Returns (n, 2 r + 1, 2 r + 1), r = s // 2, axes (shift down,
    shift right), zero shift in the middle; -1 where too little texture overlaps.
    """
    n, size, _ = a.shape
    r = size // 2
    pad = scipy.fft.next_fast_len(size + r, real=True)
    out = np.empty((n, 2 * r + 1, 2 * r + 1), dtype=np.float32)
    shifts = np.arange(-r, r + 1) % pad

    def spectrum(w: Float32) -> NDArray[np.complex64]:
        return scipy.fft.rfftn(w, s=(pad, pad), axes=(1, 2), workers=-1)

    def shifted(p: Float32, q: Float32) -> Float32:
        plane = scipy.fft.irfftn(np.conj(spectrum(p)) * spectrum(q), s=(pad, pad), axes=(1, 2), workers=-1)
        return np.take(np.take(plane, shifts, axis=1), shifts, axis=2)

    # (shift, pixel): which pixels of a window lie in the other one, moved by the shift, and the reverse
    at = np.arange(size) + np.arange(-r, r + 1)[:, None]
    inside = ((at >= 0) & (at < size)).astype(np.float32)
    outside_in = np.flip(inside, axis=0)

    full = (wa == 1).all((1, 2)) & (wb == 1).all((1, 2))
    chunks = [q[k : k + CHUNK] for q in (np.flatnonzero(full), np.flatnonzero(~full)) for k in range(0, len(q), CHUNK)]
    for part in chunks:
        p, v, q, w = (x[part] for x in (a, wa, b, wb))
        f, g = _centred(p, v), _centred(q, w)
        ff, gg = f * f, g * g
        power_f, power_g = (np.sum(x, axis=(1, 2), keepdims=True) for x in (ff, gg))
        if full[part[0]]:  # sums over what overlaps need no transforms
            under_b, under_a = (m @ x @ m.T for m, x in ((inside, ff), (outside_in, gg)))
        else:
            under_b, under_a = shifted(ff, w), shifted(v, gg)
        enough = (under_b > MIN_OVERLAP * power_f) & (under_a > MIN_OVERLAP * power_g)
        power = np.where(enough, under_b * under_a, np.float32(1))
        out[part] = np.where(enough, shifted(f, g) / np.sqrt(power), np.float32(-1))
    return out


def _centred(window: Float32, weight: Float32) -> Float32:
    """Window minus its weighted mean, times its weight."""
    total = np.sum(weight, axis=(1, 2), keepdims=True)
    mean = np.sum(window * weight, axis=(1, 2), keepdims=True) / np.maximum(total, np.float32(1))
    return (window - mean) * weight


def peaks(r: Float32) -> Peaks:
    """Sub-pixel positions of the two highest peaks of correlation planes (n, 2 r + 1, 2 r + 1)."""
    n, size, _ = r.shape
    half = size // 2
    rest = r.copy()
    found = []
    for _ in range(2):
        flat = rest.reshape(n, -1).argmax(1)
        j, i = flat // size, flat % size
        found.append((j, i))
        near = (np.abs(np.arange(size) - j[:, None]) <= 2)[:, :, None] & (np.abs(np.arange(size) - i[:, None]) <= 2)[
            :, None
        ]
        rest[near] = -1
    k = np.arange(n)
    u, v, height = (np.empty((n, 2)) for _ in range(3))
    for p, (j, i) in enumerate(found):
        u[:, p] = i - half + _vertex(r[k, j, np.maximum(i - 1, 0)], r[k, j, i], r[k, j, np.minimum(i + 1, size - 1)])
        v[:, p] = j - half + _vertex(r[k, np.maximum(j - 1, 0), i], r[k, j, i], r[k, np.minimum(j + 1, size - 1), i])
        height[:, p] = r[k, j, i]
    j, i = found[0]
    at_edge = (j == 0) | (j == size - 1) | (i == 0) | (i == size - 1)
    return Peaks(u, v, height, at_edge)


def _vertex(left: Float32, middle: Float32, right: Float32) -> Array:
    """Offset of the top of the Gaussian through three points, -0.5..0.5; 0 where no Gaussian fits."""
    good = (np.minimum(left, right) > 0) & (middle >= left) & (middle >= right) & (middle > np.minimum(left, right))
    a, b, c = (np.log(np.where(good, q, s)).astype(np.float64) for q, s in ((left, 1), (middle, 2), (right, 1)))
    return np.where(good, 0.5 * (a - c) / (a - 2 * b + c), 0.0)


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


def predict(pairs: list[tuple[Frame, Frame]], *, passes: tuple[int, ...], outlier: float) -> Coarse:
    """Correlation passes with window sizes `passes` [px]; the correlations of several pairs are averaged (ensemble).

    Windows overlap by half. Each pass shifts the two windows by whole pixels, half each, and searches up to half a
    window around. `outlier`: limit of the normalised median test; outliers try their second peak, then the median.
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
            planes.append(correlate(*first, *second))
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
    return scipy.ndimage.map_coordinates(f, np.meshgrid(j, i, indexing="ij"), order=1, mode="nearest")


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
    rows, columns = (
        np.clip(q.ravel().astype(np.intp) + size - size // 2, 0, n + size)
        for q, n in zip((y[:, None] + v, x + u), image.shape)
    )
    grey, weight = (
        np.lib.stride_tricks.sliding_window_view(np.pad(f, size), (size, size))[rows, columns] for f in (image, mask)
    )
    return np.asarray(grey, np.float32), np.asarray(weight, np.float32)


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
