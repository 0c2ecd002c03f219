"""Sigma of a track is no less than its scatter about a smooth path, where pixels share their errors.

A fit's sigma rests on pixels that err independently. A codec's do not: blocks are copied from frame to frame, their
errors are those of neighbouring pixels. There the scatter of places about a smooth way is the lower bound: third
differences of white noise have sqrt(20) times its deviation, fifth ones sqrt(252) times, and smooth motion has little
of either. What a codec does to neighbouring rows alike, no difference shows: BLOCKS is by how much more a place errs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from jumpvision.base.arrays import FROM_MAD, Array, Image

from .track import BallTrack

PAIRS = 8  # of frames of which the correlation is taken
SHARED = 0.15  # of the noise of neighbouring pixels, from which on: white 0.01, a camera 0.08, x264 0.5 to 0.9
HALF = 20  # rows before and after one that its scatter is taken of
FEWEST = 4  # differences
BLOCKS = 1.1  # error over scatter, films of benchmarks/clips_coded.py, seed 1
ORDERS = {3: 20.0, 5: 252.0}  # of differences: sum of the squares of their coefficients


def shared_noise(frames: Sequence[Image], places: Array, d: float) -> float:
    """Correlate the noise of neighbouring pixels, by differences of frames beside the ball, which is at `places` (n, 2)
    and has diameter d [px]; 0 of a film without noise."""
    both = own = 0.0
    for i in np.unique(np.linspace(0, len(frames) - 2, min(PAIRS, len(frames) - 1)).astype(int)):
        change = np.asarray(frames[i + 1], np.float32) - np.asarray(frames[i], np.float32)
        yy, xx = np.ogrid[: change.shape[0], : change.shape[1]]
        for x, y in places[i : i + 2]:
            change[(xx - x) ** 2 + (yy - y) ** 2 < d * d] = np.nan
        size = np.abs(change)
        if not np.isfinite(size).any():
            continue
        # what moves is no noise
        noise = size < 6.0 * max(FROM_MAD * float(np.median(size[np.isfinite(size)])), 1.0)
        if not noise.any():
            continue
        change = np.where(noise, change - float(np.mean(change[noise])), 0.0)
        both += float(np.sum(change[:, 1:] * change[:, :-1]) + np.sum(change[1:] * change[:-1]))
        own += 2.0 * float(np.sum(change * change))
    return both / own if own > 0.0 else 0.0


def with_scatter(track: BallTrack) -> BallTrack:
    """Return the track with a sigma of at least BLOCKS times the scatter of the rows about it."""
    n = len(track.flag)
    if n < 4:
        return track
    scatter = np.min([_local(track, order) for order in ORDERS if n > order], axis=0)
    usual = _medians(_windows(track.sigma[:, None]))
    factor, known = np.ones(n), np.isfinite(scatter) & np.isfinite(usual)
    factor[known] = np.maximum(1.0, BLOCKS * scatter[known] / usual[known])
    return replace(track, sigma=factor * track.sigma)


def _local(track: BallTrack, order: int) -> Array:
    """Return the scatter about each row by differences of an order, (n,); inf where there are few of them."""
    places = np.stack([track.x, track.y], axis=1)
    size = np.abs(np.diff(places, order, axis=0)) / np.sqrt(ORDERS[order])
    padded = np.pad(size, ((order // 2, order - order // 2), (0, 0)), constant_values=np.nan)
    return FROM_MAD * _medians(_windows(padded))


def _medians(values: Array) -> Array:
    """Return the median of each row of values (n, m), inf where fewer than FEWEST are known."""
    known = np.count_nonzero(np.isfinite(values), axis=1) >= FEWEST
    out = np.full(len(values), np.inf)
    out[known] = np.nanmedian(values[known], axis=1)
    return out


def _windows(values: Array) -> Array:
    """Return the values of the rows about each, (n, 2 HALF + 1 times columns)."""
    padded = np.pad(values, ((HALF, HALF), (0, 0)), constant_values=np.nan)
    return sliding_window_view(padded, 2 * HALF + 1, axis=0).reshape(len(values), -1).copy()
