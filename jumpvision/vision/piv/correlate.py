"""Masked normalised cross-correlation of many windows at once (Padfield 2012, doi:10.1109/TIP.2011.2181402)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from jumpvision.vision.piv.backend import NUMPY, Backend

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]

CHUNK = 512  # windows per batch of FFTs; larger batches leave the CPU cache
MIN_OVERLAP = 0.25  # share of the texture of each window that must take part in a match


class Peaks(NamedTuple):
    """Best and second-best shift of each window, in px from the first window to the second."""

    u: Array  # (n, 2) first and second peak
    v: Array  # (n, 2)
    height: Array  # (n, 2) normalised correlation
    at_edge: NDArray[np.bool_]  # (n,) the best shift lies on the edge of the search


def correlate(a: Float32, wa: Float32, b: Float32, wb: Float32, on: Backend = NUMPY) -> Float32:
    """Normalised correlation of window pairs for all shifts up to half a window.

    a, b: (n, s, s) grey; wa, wb: (n, s, s) weights 0..1. Returns (n, 2 r + 1, 2 r + 1), r = s // 2, axes (shift down,
    shift right), zero shift in the middle; -1 where too little texture overlaps. on: where it is computed.
    """
    n, size, _ = a.shape
    r = size // 2
    pad = scipy.fft.next_fast_len(size + r, real=True)
    out = np.empty((n, 2 * r + 1, 2 * r + 1), dtype=np.float32)
    shifts = on.put(np.arange(-r, r + 1) % pad)
    xp = on.xp
    # scipy's transforms use all cores
    fft, options = (scipy.fft, {"workers": -1}) if xp is np else (xp.fft, {})

    def spectrum(w: Any) -> Any:
        return fft.rfftn(w, s=(pad, pad), axes=(1, 2), **options)

    def shifted(p: Any, q: Any) -> Any:
        plane = fft.irfftn(xp.conj(spectrum(p)) * spectrum(q), s=(pad, pad), axes=(1, 2), **options)
        return xp.take(xp.take(plane, shifts, axis=1), shifts, axis=2)

    for first in range(0, n, CHUNK):
        part = slice(first, first + CHUNK)
        p, v, q, w = (on.put(x[part]) for x in (a, wa, b, wb))
        f, g = _centred(xp, p, v), _centred(xp, q, w)
        ff, gg = f * f, g * g
        power_f, power_g = (xp.sum(x, axis=(1, 2), keepdims=True) for x in (ff, gg))
        under_b, under_a = shifted(ff, w), shifted(v, gg)
        enough = (under_b > MIN_OVERLAP * power_f) & (under_a > MIN_OVERLAP * power_g)
        power = xp.where(enough, under_b * under_a, xp.ones_like(under_b))
        out[part] = on.get(xp.where(enough, shifted(f, g) / xp.sqrt(power), -xp.ones_like(power)))
    return out


def _centred(xp: Any, window: Any, weight: Any) -> Any:
    """Window minus its weighted mean, times its weight."""
    total = xp.sum(weight, axis=(1, 2), keepdims=True)
    mean = xp.sum(window * weight, axis=(1, 2), keepdims=True) / xp.where(total > 1, total, xp.ones_like(total))
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
