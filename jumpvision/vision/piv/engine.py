"""Displacement fields of image pairs and of films: coarse correlation, affine matching, validation."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from jumpvision.vision.piv import field as code
from jumpvision.vision.piv.field import VectorField
from jumpvision.vision.piv.predict import Mask, at, predict, slope
from jumpvision.vision.piv.refine import CONVERGED, COVERED, FLAT, RIM, Frame, prepare, refine, taper
from jumpvision.vision.piv.validate import local_median, normalised_median

Array = NDArray[np.float64]


def piv_pair(
    a: NDArray[np.generic],
    b: NDArray[np.generic],
    *,
    window: int,
    step: int,
    passes: tuple[int, ...],
    min_correlation: float,
    min_texture: float,
    outlier: float,
    mask: Mask | None = None,
    mask_b: Mask | None = None,
) -> VectorField:
    """Displacement from frame a to frame b, images (H, W) grey of any type; NaN pixels count as masked.

    window: [px] side of the matched window (odd sizes as they are, even sizes one more), under a Gaussian weight.
    step: [px] distance of the vectors. passes: [px] window sizes of the correlations that start the match, large to
    small; the first must exceed twice the largest displacement.
    min_correlation: matches below it are replaced. min_texture: [grey] standard deviation below which a window is
    empty. outlier: limit of the normalised median test, about 2.
    mask: (H, W) True = usable, in frame a and, without mask_b, in frame b.
    Raises ValueError for frames or masks of different shapes and for windows that do not fit.
    """
    return next(
        piv_film(
            (a, b),
            mask=None if mask is None else (lambda k: mask if k == 0 or mask_b is None else mask_b),
            gap=1,
            window=window,
            step=step,
            passes=passes,
            min_correlation=min_correlation,
            min_texture=min_texture,
            outlier=outlier,
        )
    )


def piv_film(
    images: Iterable[NDArray[np.generic]],
    *,
    mask: Callable[[int], Mask | None] | None,
    gap: int,
    window: int,
    step: int,
    passes: tuple[int, ...],
    min_correlation: float,
    min_texture: float,
    outlier: float,
    progress: Callable[[int], None] | None = None,
) -> Iterator[VectorField]:
    """Fields of the frame pairs (k, k + gap), k = 0, 1, ...; at most gap + 1 frames are held.

    mask(k): usable pixels (H, W) of frame k, or None. progress(k) is called after the pair (k, k + gap). Other
    arguments as in `piv_pair`; displacements are px per pair, not per frame.
    """
    held: deque[_Prepared] = deque()
    shape: tuple[int, ...] | None = None
    for k, image in enumerate(images):
        if shape is None:
            shape = image.shape
            _check(shape, window, step, passes, gap)
        if image.shape != shape:
            raise ValueError(
                f"frame {k} is {image.shape[-2:]} px (rows, columns), frame 0 is {shape}: crop them to one size"
            )
        held.append(_Prepared(image, None if mask is None else mask(k), k, window))
        if len(held) > gap:
            yield _match(held.popleft(), held[-1], window, step, passes, min_correlation, min_texture, outlier)
            if progress is not None:
                progress(k - gap)


def _check(shape: tuple[int, ...], window: int, step: int, passes: tuple[int, ...], gap: int) -> None:
    if len(shape) != 2:
        raise ValueError(f"frame 0 has shape {shape}: must be grey, (rows, columns)")
    for name, value, low in (("window", window, 7), ("step", step, 1), ("gap", gap, 1)):
        if value < low:
            raise ValueError(f"{name} = {value}: must be at least {low}")
    if not passes or min(passes) < 8:
        raise ValueError(f"passes = {passes}: must be window sizes of at least 8 px, large to small, as (64, 32)")
    if min(shape) < 2 * (window // 2) + 1:
        raise ValueError(f"window = {window} px does not fit into frames of {shape} px: choose a smaller window")


class _Prepared:
    """A frame with what each of its two pairs needs from it."""

    def __init__(self, image: NDArray[np.generic], mask: Mask | None, k: int, window: int):
        usable = np.isfinite(image)
        if mask is not None:
            if mask.shape != image.shape:
                raise ValueError(f"mask of frame {k} is {mask.shape} px, the frame {image.shape}: must be the same")
            usable &= mask
        grey = image.astype(np.float64)
        if not np.isfinite(grey).all():
            grey = np.where(np.isfinite(grey), grey, np.nanmean(grey) if np.isfinite(grey).any() else 0.0)
        self.usable = usable
        self.grey = grey.astype(np.float32)
        self.frame: Frame = prepare(grey, usable, window // 2 + RIM + 8)


def _match(
    a: _Prepared,
    b: _Prepared,
    window: int,
    step: int,
    passes: tuple[int, ...],
    min_correlation: float,
    min_texture: float,
    outlier: float,
) -> VectorField:
    x, y = (np.arange(window // 2, n - window // 2, step, dtype=np.float64) for n in a.grey.shape[::-1])
    shape = len(y), len(x)
    xx, yy = (q.ravel() for q in np.meshgrid(x, y))
    weight = taper(window)

    coarse = predict(a.grey, b.grey, a.usable, b.usable, passes=passes, outlier=outlier)
    fields = (coarse.u, coarse.v, *slope(coarse, coarse.u), *slope(coarse, coarse.v))
    seed = np.stack([at(coarse, f, x, y).ravel() for f in fields], axis=1)
    p, sigma, quality, state = refine(a.frame, b.frame, xx, yy, seed, weight, min_texture)

    reason = np.full(len(xx), code.VALID, np.int8)
    reason[state == COVERED] = code.MASKED
    reason[state == FLAT] = code.NO_TEXTURE
    open_ = (reason != code.MASKED) & (reason != code.NO_TEXTURE)
    reason[open_] = _judge(p, quality, state, shape, min_correlation, outlier)[open_]
    raw = np.where(open_[:, None], p, np.nan)

    # a second try, from the second correlation peak and from the neighbours, whichever is matched better
    again = np.flatnonzero(open_ & (reason != code.VALID))
    if len(again):
        good = np.where((reason == code.VALID)[:, None], p, np.nan)
        near = np.stack([local_median(good[:, k].reshape(shape))[0].ravel() for k in range(6)], axis=1)
        second = seed.copy()
        second[:, 0], second[:, 1] = (at(coarse, f, x, y).ravel() for f in (coarse.u2, coarse.v2))
        for start in (near, second):
            k = again[np.isfinite(start[again]).all(1)]
            trial = refine(a.frame, b.frame, xx[k], yy[k], start[k], weight, min_texture)
            better = (trial[3] == CONVERGED) & ((state[k] != CONVERGED) | (trial[2] > quality[k] + 1e-3))
            for old, new in zip((p, sigma, quality, state), trial):
                old[k[better]] = new[better]
            reason[k[better]] = code.SECOND_PEAK
        verdict = _judge(p, quality, state, shape, min_correlation, outlier)
        kept = again[(reason[again] == code.SECOND_PEAK) & (verdict[again] == code.VALID)]
        reason[again] = verdict[again]
        reason[again[verdict[again] == code.VALID]] = code.VALID
        reason[kept] = code.SECOND_PEAK
        edge = at(coarse, coarse.at_edge.astype(np.float64), x, y).ravel() > 0.5
        reason[again[edge[again] & ~np.isin(reason[again], code.MEASURED)]] = code.EDGE_PEAK

    measured = np.isin(reason, code.MEASURED)
    p = np.where(measured[:, None], p, np.nan)
    sigma = np.where(measured[:, None], sigma, np.nan)
    filled, spread = p[:, :2].copy(), sigma[:, :2].copy()
    for k in range(2):
        middle, scatter = (f.ravel() for f in local_median(p[:, k].reshape(shape)))
        holes = open_ & ~measured
        filled[holes, k], spread[holes, k] = middle[holes], scatter[holes]
    (u, v), (u_sigma, v_sigma) = filled.T.reshape(2, *shape), spread.T.reshape(2, *shape)
    return VectorField(
        x,
        y,
        u,
        v,
        u_sigma,
        v_sigma,
        quality.reshape(shape),
        reason.reshape(shape),
        raw[:, 0].reshape(shape),
        raw[:, 1].reshape(shape),
        p[:, 2:].T.reshape(2, 2, *shape),
        sigma[:, 2:].T.reshape(2, 2, *shape),
    )


def _judge(
    p: Array, quality: Array, state: NDArray[np.int64], shape: tuple[int, int], min_correlation: float, outlier: float
) -> NDArray[np.int8]:
    """Reason of each vector from its match and from its neighbours."""
    converged = state == CONVERGED
    trusted = (converged & (quality >= min_correlation)).reshape(shape)
    u, v = (np.where(trusted, p[:, k].reshape(shape), np.nan) for k in range(2))
    lonely = normalised_median(u, v) > outlier
    reason = np.full(len(p), code.VALID, np.int8)
    reason[lonely.ravel()] = code.INTERPOLATED
    reason[converged & (quality < min_correlation)] = code.LOW_CORRELATION
    reason[~converged] = code.NOT_CONVERGED
    return reason
