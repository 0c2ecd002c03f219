"""Displacement fields of image pairs and of films: a start, steps of all windows, validation."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.films.calibration import FEW_FINER, FEW_NOISE, FOREIGN_PIXEL, SPLINE_ERROR

from . import pair as code
from .frame import Frame, prepare
from .lattice import periods_of, smallest_alike
from .pair import TIMES, Settings, VectorField, coded_apart, combined
from .predict import Mask, at, flow, predict
from .refine import Grid, Match, Pairs, refine
from .scales import Noise, noise_factor, smoothed
from .solve import COVERED, FLAT, STEPPED
from .validate import (
    beyond_chance,
    error_length,
    factors,
    fitted,
    local_median,
    noise_within,
    normalised_median,
    unresolved,
)

Usable = Callable[[int], Mask]  # (H, W) of frame k, True where it is usable

LARGEST_STEP = 0.25  # of the window; a step further has left the texture it was computed from
STIFFNESS = 1.0  # of the surface through the vectors: damps noise between neighbours, keeps waves of 6 vectors to 1 %
FROM_NEIGHBOURS = 3  # turns at most in which failed vectors start from their neighbours: so many rows along a wall
TOLD = 0.05  # of the vectors that are known but for a period, from which it is told
LOST = 1 / 3  # of the vectors failed: the first search has gone astray, and all are tried again
MARGIN = 12  # px of border around a frame beyond half a window: gradient stencil, spline, half of a displacement


def piv_pair(
    a: NDArray[np.generic],
    b: NDArray[np.generic],
    *,
    mask: Mask | None = None,
    mask_b: Mask | None = None,
    **settings: Any,
) -> VectorField:
    """Displacement from frame a to frame b, images (H, W) grey of any type; NaN pixels count as masked.

    mask: (H, W) True = usable, in frame a and, without mask_b, in frame b. settings: see `Settings`.
    Raises ValueError for frames or masks of different shapes and for windows that do not fit.
    """
    masks = None if mask is None else (lambda k: mask if k == 0 or mask_b is None else mask_b)
    return next(piv_film((a, b), mask=masks, gap=1, **settings))


def piv_film(
    images: Iterable[NDArray[np.generic]],
    *,
    mask: Callable[[int], Mask | None] | None,
    gap: int,
    baseline: int = 1,
    ensemble: int = 1,
    stride: int = 1,
    coded: float = 0.0,
    progress: Callable[[int], None] | None = None,
    **settings: Any,
) -> Iterator[VectorField]:
    """Fields of the frame pairs (k, k + gap), k = 0, stride, ...; about ensemble + gap or baseline frames are held.

    mask(k): usable pixels (H, W) of frame k. baseline: pairs 3, 9, ... times as far apart about the same
    mid-time, up to that many frames, are combined with each (see `multiframe`). ensemble: so many consecutive pairs are
    matched together and give one field, for steady flow; the last may hold fewer. stride: frames from one pair to the
    next, 2 for double exposures, where baseline is 1 and gap below it. coded: error [px] that a codec adds to a
    displacement; it is one of the frames' places, so that of n consecutive pairs together is less by n / sqrt(gap).
    progress(k) is called after the pair (k, k + gap). settings: see `Settings`; displacements are px per pair
    (k, k + gap), not per frame.
    """
    s = Settings(**settings)
    if gap < 1:
        raise ValueError(f"gap = {gap}: must be at least 1")
    if stride > 1 and (baseline > gap or gap >= stride):
        raise ValueError(f"stride = {stride}, gap = {gap}, baseline = {baseline}: pairs apart have none about them")
    further: list[int] = []  # frames that the longer baselines reach beyond the pair on either side
    while gap * 3 ** (len(further) + 1) <= baseline:
        further.append(gap * (3 ** (len(further) + 1) - 1) // 2)
    reach = max(further, default=0)
    held: dict[int, Callable[[], Frame]] = {}  # made ready when they are first matched

    def about(first: int, end: int) -> VectorField:
        """The pairs from first to end and the longer ones about them, as far as the film goes; drops frames behind."""
        spans = [0, *(j for j in further if first >= j and end - 1 + gap + j in held)]

        def matched(j: int) -> VectorField:
            return _match([(held[q - j](), held[q + gap + j]()) for q in range(first, end, stride)], s)

        fields = [(gap + 2.0 * j, matched(j)) for j in spans]
        for q in range(first, end):
            held.pop(q - reach, None)
            if progress is not None and (q - first) % stride == 0:
                progress(q)
        n = (end - first - 1) // stride + 1  # pairs; the places of the frames that two of them share cancel
        one = coded * math.sqrt(min(gap, n) if stride == 1 else n) / n
        fields = [(baseline, coded_apart(f, one)) for baseline, f in fields]
        return combined(fields, code.FURTHEST_CODED if coded else code.FURTHEST)

    shape: tuple[int, ...] | None = None
    first, k = 0, -1
    for k, image in enumerate(images):
        shape = shape or image.shape
        usable = None if mask is None else mask(k)
        _check(k, image.shape, shape, s.window, usable)
        held[k] = functools.cache(functools.partial(_ready, image, usable, s))
        if k >= first + (ensemble - 1) * stride + gap + reach:
            yield about(first, first + ensemble * stride)
            first += ensemble * stride
    for rest in range(first, k + 1 - gap, ensemble * stride):
        yield about(rest, min(rest + ensemble * stride, k + 1 - gap))


def _ready(image: NDArray[np.generic], usable: Mask | None, s: Settings) -> Frame:
    return prepare(image, usable, s.window // 2 + MARGIN, s.preset != "fast")


def _check(k: int, shape: tuple[int, ...], first: tuple[int, ...], window: int, mask: Mask | None) -> None:
    if len(shape) != 2:
        raise ValueError(f"frame {k} has shape {shape}: must be grey, (rows, columns)")
    if shape != first:
        raise ValueError(f"frame {k} is {shape} px (rows, columns), frame 0 is {first}: crop them to one size")
    if min(shape) < 2 * (window // 2) + 1:
        raise ValueError(f"window = {window} px does not fit into frames of {shape} px: choose a smaller window")
    if mask is not None and mask.shape != shape:
        raise ValueError(f"mask of frame {k} is {mask.shape} px, the frame {shape}: must be the same")


def vector_places(pixels: int, window: int, step: int) -> Array:
    """Columns (or rows) [px] of the vectors in a picture of that many columns (rows); the same of windows of 31, 32 and
    33 px, and the like."""
    first = min(max(window // 2, (window + 1) // 4 * 2), (pixels - 1) // 2)
    return np.arange(first, pixels - first, step, dtype=np.float64)


def length_of_errors(window: int, step: int, preset: str) -> float:
    """Distance [px] over which unsmoothed vectors share their error.

    The error of a mean over an area is as if one vector in about (length)^2 were independent; sigma of a vector does
    not hold that.
    """
    return error_length(window, step, STIFFNESS, TIMES[preset])


def _match(pairs: Pairs, s: Settings) -> VectorField:
    x, y = (vector_places(n, s.window, s.step) for n in pairs[0][0].grey.shape[::-1])
    grid = Grid(x, y, s.step, s.window, STIFFNESS)
    times = TIMES[s.preset]

    start = np.mean([flow(a.grey, b.grey, x, y, s.step) for a, b in pairs], axis=0)
    periods, tied = periods_of(pairs[0][0].grey, s.passes[0] // 2), np.zeros(start.shape[1:], bool)
    if len(periods):
        start, tied = smallest_alike(pairs, grid, start, periods, s.min_texture)
    m = refine(pairs, grid, start, s.min_texture, None, False, None)
    raw, reason = m.p[:2], _judge(m, start, s)
    again = _to_try(reason) & ~tied
    edge = np.zeros(again.shape, bool)
    # where more than 1 % failed a correlation is asked for other starts
    if again.sum() > 0.01 * np.isin(reason, code.MATCHED).sum():
        m, reason, edge = _second_try(pairs, grid, m, reason, s)
    first, matched = reason, ~scipy.ndimage.binary_dilation(again, np.ones((3, 3)))
    for k in range(1, times):
        start = _whole(np.where(np.isin(reason, code.MEASURED), m.p, np.nan), s.step)
        m = refine(pairs, grid, start, s.min_texture, matched | (k > 1), k == times - 1, None)
        reason = _judge(m, start, s)
    raw = np.where(_to_try(first), raw, m.p[:2])
    if m.sigma is None or m.finer is None:
        raise ValueError("at least two steps are needed")
    factor = np.repeat(factors(s.window, s.step, STIFFNESS, times, m.clumping), (2, 4))
    sigma = m.sigma * factor[:, None, None]
    measured = np.isin(reason, code.MEASURED)
    reason[measured & _to_try(first)] = code.SECOND_PEAK
    # a match less certain than 2 px is none; below, its sigma says what it is worth
    reason[measured & ~(sigma[:2].max(0) < 2.0)] = code.LOW_CORRELATION
    measured = np.isin(reason, code.MEASURED)
    reason[edge & _to_try(reason)] = code.EDGE_PEAK
    p = np.where(measured, m.p, np.nan)
    sigma = np.where(measured, sigma, np.nan)
    holes = _to_try(reason)
    near, scatter = _around(p, s.step, holes)
    filled = np.where(holes, near, p[:2])
    whole = _whole(np.concatenate([filled, p[2:]]), s.step)
    noise = Noise(s.window, s.step, STIFFNESS, times)
    # few particles in a window: short waves of its errors are larger than those of white noise
    few = fitted(*noise, m.clumping)
    sigma *= noise_factor(whole, sigma[:2], noise) / (1 + FEW_NOISE.value * few)
    by_chance, shared_by_neighbours = noise_within(*noise)
    by_chance *= 1 + FEW_FINER.value * few
    missed = unresolved(m.finer, measured, s.window, s.step, (by_chance, shared_by_neighbours))

    period = float(np.hypot(*periods.T).min()) if tied.any() else 0.0
    unknown = np.where(tied, period**2, 0.0)

    def stated(spread: Array, share: Array | float) -> Array:
        sigma = np.sqrt(spread**2 + share * missed + SPLINE_ERROR.value[s.preset] ** 2 + unknown)
        return np.where(measured, sigma, np.where(holes, scatter, np.nan))

    matched = np.concatenate([filled, stated(sigma[:2], 1.0)])
    best = matched
    if s.smooth == "adaptive":
        of_pictures = np.mean([2 * min(a.noise, b.noise) for a, b in pairs]) / np.maximum(m.rest, 1e-12)
        if m.jump is not None:
            whole = _beside_jumps(pairs, grid, m, measured, whole, s)
        smooth = smoothed(whole, sigma[:2], np.fmin(of_pictures, 1.0), noise)
        # where neighbours count for more, no motion exceeded the noise
        best = np.concatenate([np.where(measured, smooth.p, filled), stated(smooth.sigma, smooth.own)])
    shape = reason.shape
    return VectorField(
        x,
        y,
        best[0],
        best[1],
        best[2],
        best[3],
        m.quality,
        reason,
        raw[0],
        raw[1],
        matched,
        p[2:].reshape(2, 2, *shape),
        sigma[2:].reshape(2, 2, *shape),
        period if tied.mean() > TOLD else 0.0,
    )


def _beside_jumps(pairs: Pairs, grid: Grid, m: Match, measured: NDArray[np.bool_], whole: Array, s: Settings) -> Array:
    """The vectors `whole` (2, ny, nx) with those beside jumps matched once more, without the pixels of the other side.

    Each then speaks for its own side; over both sides together their mean would be wrong, so `matched` has them not.
    What a smooth surface fits better than one that runs between the vectors is no jump; `fast` does not ask.
    """
    assert m.jump is not None
    usual = float(np.median(m.rest[np.isfinite(m.rest)]))
    foreign = FOREIGN_PIXEL.value * math.sqrt(max(usual, 0.01))  # grey^2: rounding leaves as much
    rows = np.flatnonzero((m.jump > 0).any(1))
    only = slice(rows[0], rows[-1] + 1)
    again = refine(pairs, grid, whole, s.min_texture, measured, False, foreign, only)
    near = np.hypot(*(again.p[:2] - whole)) < LARGEST_STEP * s.window
    jumps = m.jump > 0
    if s.preset != "fast":  # it would take a quarter more
        jumps &= refine(pairs, grid, whole, s.min_texture, measured, False, math.inf, only).rest < m.rest
    return np.where(measured & jumps & (again.state == STEPPED) & near, again.p[:2], whole)


def _second_try(
    pairs: Pairs, grid: Grid, m: Match, reason: NDArray[np.int8], s: Settings
) -> tuple[Match, NDArray[np.int8], NDArray[np.bool_]]:
    """The failed vectors matched again from the two peaks of a correlation, whichever matches better, then from what
    their neighbours say, as long as that finds some.

    Returns the match, its reasons and where the correlation's peak lies on the edge of its search.
    """
    coarse = predict(pairs, passes=s.passes, outlier=s.outlier)
    peaks: list[Array | None] = [
        np.stack([at(coarse, f, grid.x, grid.y) for f in peak])
        for peak in ((coarse.u, coarse.v), (coarse.u2, coarse.v2))
    ]
    for peak in [*peaks, *[None] * FROM_NEIGHBOURS]:
        again = _to_try(reason)
        if not again.any():
            break
        kept = _whole(np.where(np.isin(reason, code.MEASURED), m.p, np.nan), s.step)
        # where many failed, those that passed by chance would bend the surface through the others
        if peak is not None and again.sum() > LOST * np.isin(reason, code.MATCHED).sum():
            again = np.ones_like(again)
        start = kept if peak is None else np.where(again, peak, kept)
        rows = np.flatnonzero(again.any(1))
        trial = refine(pairs, grid, start, s.min_texture, None, False, None, slice(rows[0], rows[-1] + 1))
        better = again & (trial.state == STEPPED) & ~(trial.quality <= m.quality)
        m = Match(
            np.where(better, trial.p, m.p),
            None,
            None,
            np.nan,
            np.where(better, trial.quality, m.quality),
            m.rest,
            None,
            np.where(better, trial.state, m.state),
        )
        reason = _judge(m, np.where(better, start, kept), s)
        if peak is None and _to_try(reason).sum() > 0.8 * again.sum():
            break
    return m, reason, at(coarse, coarse.at_edge.astype(np.float64), grid.x, grid.y) > 0.5


def _to_try(reason: NDArray[np.int8]) -> NDArray[np.bool_]:
    """Vectors that have texture and light and yet no displacement."""
    return ~np.isin(reason, (*code.MEASURED, code.MASKED, code.NO_TEXTURE))


def _judge(m: Match, start: Array, s: Settings) -> NDArray[np.int8]:
    """Reason of each vector from its match, which started at `start` (2, ny, nx), and from its neighbours."""
    settled = (m.state == STEPPED) & ~(np.hypot(*(m.p[:2] - start)) > LARGEST_STEP * s.window)
    trusted = settled & (m.quality >= s.min_correlation)
    good = np.where(trusted, m.p, np.nan)
    reason = np.full(trusted.shape, code.VALID, np.int8)
    certain = beyond_chance(m.quality, s.window)
    reason[normalised_median(good[0], good[1], _slopes(good, s.step), certain) > s.outlier] = code.INTERPOLATED
    reason[settled & ~trusted] = code.LOW_CORRELATION
    reason[~settled] = code.NOT_CONVERGED
    reason[m.state == COVERED] = code.MASKED
    reason[m.state == FLAT] = code.NO_TEXTURE
    return reason


def _slopes(p: Array, step: int) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Change of u and of v per grid step, from the gradients matched in the windows."""
    ux, uy, vx, vy = step * p[2:]
    return (ux, uy), (vx, vy)


def _around(p: Array, step: int, wanted: NDArray[np.bool_]) -> tuple[Array, Array]:
    """u and v (2, ny, nx) as the neighbours that are not NaN say, and their scatter, where `wanted`, else NaN."""
    middle, spread = zip(*(local_median(f, slope, wanted) for f, slope in zip(p[:2], _slopes(p, step))))
    return np.stack(middle), np.stack(spread)


def _whole(p: Array, step: int) -> Array:
    """u and v (2, ny, nx) without holes: from the neighbours, else as the nearest vector, else zero."""
    out = p[:2]
    if np.isnan(out).any():
        out = np.where(np.isnan(out), _around(p, step, np.asarray(np.isnan(out).any(0)))[0], out)
        holes = np.isnan(out).any(0)
        if holes.all():
            return np.zeros(out.shape)
        if holes.any():
            nearest = scipy.ndimage.distance_transform_edt(holes, return_distances=False, return_indices=True)
            out = out[:, nearest[0], nearest[1]]
    return out
