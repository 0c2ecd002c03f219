"""Displacement fields of image pairs and of films: coarse correlation, affine matching, validation."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from jumpvision.vision.piv import field as code
from jumpvision.vision.piv.field import VectorField
from jumpvision.vision.piv.predict import Mask, at, predict, slope
from jumpvision.vision.piv.refine import CONVERGED, COVERED, FLAT, Frame, prepare, refine, taper
from jumpvision.vision.piv.validate import local_median, normalised_median
from jumpvision.vision.piv.window import RIM

Array = NDArray[np.float64]

MAX_SIGMA = 2.0  # px, a match less certain than this is no match; below it, its sigma says what it is worth
ROUGH, FINE = 0.03, 0.01  # px, the last step of the first and of the final match; the error left is far smaller


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
    seed = np.zeros((len(xx), 12))
    seed[:, :6] = np.stack([at(coarse, f, x, y).ravel() for f in fields], axis=1)

    def match(k: NDArray[np.intp], start: Array, final: bool) -> tuple[Array, Array, Array, NDArray[np.int64]]:
        return refine(a.frame, b.frame, xx[k], yy[k], start, weight, min_texture, FINE if final else ROUGH, final)

    every = np.arange(len(xx))
    p, sigma, quality, state = match(every, seed, False)
    open_ = (state != COVERED) & (state != FLAT)
    reason = _judge(p, quality, state, shape, step, min_correlation, outlier)
    raw = np.where(open_[:, None], p, np.nan)

    # a second try, from the second correlation peak and from the neighbours, whichever is matched better
    again = np.flatnonzero(open_ & (reason != code.VALID))
    if len(again):
        second = seed[again]
        second[:, 0], second[:, 1] = (at(coarse, f, x, y).ravel()[again] for f in (coarse.u2, coarse.v2))
        good = np.where((reason == code.VALID)[:, None], p, np.nan)
        for start in (_around(good, shape, step)[0][again], second):
            k, start = again[np.isfinite(start).all(1)], start[np.isfinite(start).all(1)]
            trial = match(k, start, False)
            better = (trial[3] == CONVERGED) & ((state[k] != CONVERGED) | (trial[2] > quality[k] + 1e-3))
            for old, new in zip((p, sigma, quality, state), trial):
                old[k[better]] = new[better]
            reason[k[better]] = code.SECOND_PEAK
        second_try = reason == code.SECOND_PEAK
        reason = _judge(p, quality, state, shape, step, min_correlation, outlier)
        reason[second_try & (reason == code.VALID)] = code.SECOND_PEAK

    # the last match knows the curvature from the good neighbours
    k = np.flatnonzero(open_ & np.isin(reason, code.MEASURED))
    p[:, 6:] = _curvature(np.where(np.isin(reason, code.MEASURED)[:, None], p, np.nan), shape, step)
    p[k], sigma[k], quality[k], state[k] = match(k, p[k], True)
    sigma[:, :2] *= _curvature_noise(weight, step)
    last = _judge(p, quality, state, shape, step, min_correlation, outlier)
    reason = np.where(np.isin(last, code.MEASURED) & np.isin(reason, code.MEASURED), reason, np.maximum(last, reason))
    vague = np.nan_to_num(sigma[:, :2]).max(1) > MAX_SIGMA
    reason[vague & np.isin(reason, code.MEASURED)] = code.LOW_CORRELATION
    edge = at(coarse, coarse.at_edge.astype(np.float64), x, y).ravel() > 0.5
    reason[edge & ~np.isin(reason, code.MEASURED)] = code.EDGE_PEAK
    reason[state == COVERED] = code.MASKED
    reason[state == FLAT] = code.NO_TEXTURE

    measured = np.isin(reason, code.MEASURED)
    holes = ~measured & (reason != code.MASKED) & (reason != code.NO_TEXTURE)
    p[~measured], sigma[~measured] = np.nan, np.nan
    near, scatter = _around(p, shape, step)
    filled, spread = p[:, :2].copy(), sigma[:, :2].copy()
    filled[holes], spread[holes] = near[holes, :2], scatter[holes]
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
        p[:, 2:6].T.reshape(2, 2, *shape),
        sigma[:, 2:].T.reshape(2, 2, *shape),
    )


def _slopes(p: Array, shape: tuple[int, int], step: int) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Change of u and of v per grid step, from the gradients matched in the windows."""
    ux, uy, vx, vy = (step * p[:, k].reshape(shape) for k in range(2, 6))
    return (ux, uy), (vx, vy)


def _around(p: Array, shape: tuple[int, int], step: int) -> tuple[Array, Array]:
    """Start values (n, 12) for a match from the neighbours that are not NaN, and the scatter of u and v (n, 2)."""
    start, scatter = np.zeros((len(p), 12)), np.empty((len(p), 2))
    for k, slope_k in enumerate(_slopes(p, shape, step)):
        middle, spread = local_median(p[:, k].reshape(shape), slope_k)
        start[:, k], scatter[:, k] = middle.ravel(), spread.ravel()
    for k in range(2, 6):
        start[:, k] = local_median(p[:, k].reshape(shape))[0].ravel()
    return start, scatter


def _curvature(p: Array, shape: tuple[int, int], step: int) -> Array:
    """Second derivatives (n, 6) [1/px] u_xx, u_xy, u_yy, v_xx, v_xy, v_yy from the gradients of the neighbours.

    Central differences of the gradients, averaged over 3 x 3 vectors; where a neighbour is missing, zero goes in.
    """
    out = []
    for first in (2, 4):
        fx, fy = (p[:, k].reshape(shape) for k in (first, first + 1))
        dx, dy = ([_central(f, axis) / (2 * step) for f in (fx, fy)] for axis in (1, 0))
        for k in (dx[0], 0.5 * (dx[1] + dy[0]), dy[1]):
            out.append(ndimage.uniform_filter(np.nan_to_num(k), 3, mode="nearest").ravel())
    return np.stack(out, axis=1)


def _curvature_noise(weight: NDArray[np.float32], step: int) -> float:
    """Factor by which taking the curvature from the neighbours raises the standard uncertainty of u and v.

    d with given K answers to white noise n as sum L n, L = W/sum W - s^2 (K_xx + K_yy)/2, s^2 the variance of the
    window W and K the differences of `_curvature` of the window's gradient responses W xi / sum W xi^2.
    """
    w = weight.astype(np.float64) / weight.sum()
    half = len(w) // 2
    xi = np.arange(-half, half + 1)
    s2 = float((w * xi**2).sum())
    reach = 2
    size = len(w) + 2 * reach * step
    k = np.zeros((size, size))
    for j in (-1, 0, 1):
        for i in (-1, 0, 1):
            for end in (-1, 1):
                y, x = (reach + j) * step, (reach + i + end) * step
                k[y : y + len(w), x : x + len(w)] += end * w * xi / s2 / (2 * step * 9)
    response = np.pad(w, reach * step) - 0.5 * s2 * (k + k.T)
    return float(np.sqrt((response**2).sum() / (w**2).sum()))


def _central(f: Array, axis: int) -> Array:
    """f of the next minus f of the last vector; NaN on the border."""
    p = np.pad(f, 1, constant_values=np.nan)
    return (np.roll(p, -1, axis) - np.roll(p, 1, axis))[1:-1, 1:-1]


def _judge(
    p: Array,
    quality: Array,
    state: NDArray[np.int64],
    shape: tuple[int, int],
    step: int,
    min_correlation: float,
    outlier: float,
) -> NDArray[np.int8]:
    """Reason of each vector from its match and from its neighbours."""
    converged = state == CONVERGED
    trusted = converged & (quality >= min_correlation)
    good = np.where(trusted[:, None], p, np.nan)
    u, v = good[:, 0].reshape(shape), good[:, 1].reshape(shape)
    reason = np.full(len(p), code.VALID, np.int8)
    reason[(normalised_median(u, v, _slopes(good, shape, step)) > outlier).ravel()] = code.INTERPOLATED
    reason[converged & (quality < min_correlation)] = code.LOW_CORRELATION
    reason[~converged] = code.NOT_CONVERGED
    return reason
