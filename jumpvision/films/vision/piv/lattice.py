"""Patterns that repeat: a displacement is then known but for their periods, and the smallest one is taken."""

from __future__ import annotations

import itertools
import math

import numpy as np
import scipy
from numpy.typing import NDArray

from jumpvision.base.arrays import Array, Float32

from .refine import Grid, Pairs, refine
from .solve import STEPPED

REPEATS = 0.5  # autocorrelation a period away: that of grains in contact is 0.3
ALIKE = 1.5  # ratio of what two matches leave (one less the correlation) over 16 px or more that is noise, above
ROUNDED = 0.005  # what interpolation leaves
SIDE, MOST = 192, 3  # px of the blocks that are looked through, as a part may repeat; of them either way
NEAR = 0.25  # of a period, within which a match still belongs to its start


def periods_of(grey: Float32, furthest: int) -> Array:
    """Return the periods (k, 2) [px, right and down] of a picture (H, W), k = 0 to 2, below `furthest`."""
    rows, columns = (
        np.unique(np.linspace(0, max(n - SIDE, 0), min(MOST, -(-n // SIDE))).astype(int)) for n in grey.shape
    )
    best, found = REPEATS, np.zeros((0, 2))
    for j, i in itertools.product(rows, columns):
        top, periods = _periods(grey[j : j + SIDE, i : i + SIDE].astype(np.float64), furthest)
        if top > best:
            best, found = top, periods
    return found


def _periods(block: Array, furthest: int) -> tuple[float, Array]:
    """Return the highest autocorrelation beyond the central peak, and the shortest periods that come near it."""
    f = block - scipy.ndimage.uniform_filter(block, 2 * furthest + 1)
    reach = [min(furthest, n // 2) for n in f.shape]
    shape = [scipy.fft.next_fast_len(n + r, real=True) for n, r in zip(f.shape, reach)]
    plane = scipy.fft.irfft2(np.abs(scipy.fft.rfft2(f, shape)) ** 2, shape)
    down, right = (np.arange(-r, r + 1) for r in reach)
    overlap = np.outer(f.shape[0] - np.abs(down), f.shape[1] - np.abs(right))
    plane = plane[np.ix_(down, right)] / overlap * f.size
    if not plane.max() > 0.0:
        return 0.0, np.zeros((0, 2))
    plane /= plane.max()
    peak = (plane == scipy.ndimage.maximum_filter(plane, 5)) & (np.hypot(*np.meshgrid(right, down)) > 3.0)
    peak[[0, -1]] = peak[:, [0, -1]] = False
    rows, columns = np.nonzero(peak & (plane > REPEATS))
    if not rows.size:
        return 0.0, np.zeros((0, 2))
    top = float(plane[rows, columns].max())
    high = plane[rows, columns] > 0.85 * top
    places = np.array([_vertex(plane, j, i) for j, i in zip(rows[high], columns[high])]) - reach[::-1]
    places = places[np.argsort(np.round(np.hypot(*places.T), 1), kind="stable")]
    first = places[0]
    other = [p for p in places if abs(p[0] * first[1] - p[1] * first[0]) > 0.3 * math.hypot(*p) * math.hypot(*first)]
    return top, np.array([first, *other[:1]])


def _vertex(plane: Array, j: int, i: int) -> Array:
    """Return column and row of the top of the parabolas through a peak and its neighbours."""
    out = []
    for a, b, c in ((plane[j, i - 1], plane[j, i], plane[j, i + 1]), (plane[j - 1, i], plane[j, i], plane[j + 1, i])):
        out.append(0.5 * (a - c) / min(a - 2.0 * b + c, -1e-12))
    return np.array([i + out[0], j + out[1]])


def smallest_alike(
    pairs: Pairs, grid: Grid, start: Array, periods: Array, texture: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Return (start (2, ny, nx) [px] with the smallest displacement of those that match alike; where several do).

    Matched from `start`, from all over the first cell of the lattice, and a period from the best of these; what differs
    by noise alone is alike. Of displacements as small as each other all windows take those on one side.
    """
    near = NEAR * float(np.hypot(*periods.T).min())

    def matched(begin: Array) -> tuple[Array, Array]:
        p = begin
        for _ in range(3):
            m = refine(pairs, grid, p, texture, None, False, None)
            p = np.where(np.isfinite(m.p[:2]), m.p[:2], begin)
        good = (m.state == STEPPED) & (np.hypot(*(p - begin)) < 2.0 * near)
        return p, np.where(good, 1.0 - m.quality, np.inf)

    def lattice(*steps: float) -> list[Array]:
        return [periods.T @ np.array(t) for t in itertools.product(steps, repeat=len(periods))]

    cell = [matched(np.broadcast_to(d[:, None, None], start.shape)) for d in lattice(-1 / 3, 0.0, 1 / 3)]
    places, rest = (np.array(q) for q in zip(matched(start), *cell))
    best = np.take_along_axis(places, np.argmin(rest, axis=0)[None, None], axis=0)[0]
    around = [matched(best + d[:, None, None]) for d in lattice(-1.0, 0.0, 1.0) if d.any()]
    places, rest = np.concatenate([places, [p for p, _ in around]]), np.concatenate([rest, [r for _, r in around]])
    alike = (rest <= ALIKE * rest.min(axis=0) + ROUNDED) & np.isfinite(rest)
    taken = np.zeros(start.shape)
    for _ in range(2):  # nearest to none, then to what most windows have then
        far = places - np.median(taken, axis=(1, 2))[:, None, None]
        chosen = np.argmin(np.where(alike, np.hypot(far[:, 0], far[:, 1]), np.inf), axis=0)
        taken = np.take_along_axis(places, chosen[None, None], axis=0)[0]
    apart = np.hypot(*np.moveaxis(places - taken, 1, 0))
    known = alike.any(axis=0)
    return np.where(known, taken, start), known & (alike & (apart > 2.0 * near)).any(axis=0)
