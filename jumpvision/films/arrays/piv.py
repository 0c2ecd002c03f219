"""`jv.piv` of images: a velocity field of two, or of every pair of a stack."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import Image
from jumpvision.base.parameters import of_keywords
from jumpvision.base.schema import InputError, StageWarning
from jumpvision.films.parameters import LARGEST_PASS, PivParams
from jumpvision.films.vision.compression import coding
from jumpvision.films.vision.piv.engine import LOST, Usable
from jumpvision.films.vision.piv.light import MeanMotion, doubts_of, light_of, three_of
from jumpvision.films.vision.piv.pair import MATCHED, MEASURED, REASONS, VectorField

from .images import film_at, grey_images, in_grey, scale_problem, usable_pixels
from .velocities import Places, fields_of, header, velocities


def piv(
    a: ArrayLike | str | os.PathLike[str],
    b: ArrayLike | str | os.PathLike[str] | None = None,
    *,
    frame_rate: float | None = None,
    scale: float | None = None,
    mask: ArrayLike | None = None,
    pairs: str = "each",
    pair_time: float | None = None,
    **parameters: Any,
) -> xr.Dataset:
    """Velocity field from frame a to frame b, or of every neighbouring pair of the frames a (n, H, W) or a sequence.

    Images (H, W) grey, of any number type, or paths, of two pictures or of a film; masked, infinite and NaN pixels are
    left out; gain and offset of decimals do not matter. frame_rate [1/s]: default the film's own; of arrays without it
    times are in frames and speeds per frame. scale [m/px]: places and speeds are in m with it, in px without. mask
    (H, W), or (n, H, W) of every frame: True where usable.
    pairs="AB": double exposures A1, B1, A2, B2, ...: A is matched with its own B alone, `ensemble` takes whole pairs
    together, frame_rate is that of the pairs and pair_time [s] from A to B (without both: from A to B is a frame).
    parameters: those of [params.piv], such as window=32, step=8.

    Data set over (y, x), with t before them where there are more than two frames: u right, v up, u_sigma, v_sigma,
    correlation, reason (0: measured as it stands); x right and y up from the first pixel. Raises InputError for a
    parameter, ValueError for frames that differ in shape, or where no vector can be found.
    """
    if problem := scale_problem("jv.piv", scale):
        raise InputError([problem])
    p = of_keywords(PivParams, parameters, folder=("foot_rows",), frame_rate=frame_rate or 1.0)
    film = film_at(a, frame_rate) if b is None and isinstance(a, str | os.PathLike) else None
    given = grey_images("piv", film or (a if b is None else (a, b)))
    known_rate = frame_rate is not None or (film is not None and pairs == EACH)
    rate = frame_rate or (film.rate if film else 1.0)
    if len(given) <= p.gap:
        raise ValueError(f"piv: {len(given)} frame(s): give two grey images (H, W), or more in one stack")
    stride, time = clock(len(given), pairs, pair_time, rate, known_rate, p)
    masks = both(usable_of(mask, given), usable_pixels(given))
    frames = in_grey(given)
    light = light_of(frames, stride, p)
    at = Places("images", scale, 0.0, 0.0, 0.0, "s" if known_rate or pair_time else "frame")
    head = header(time, frames[0].shape, at, stride, p)
    lit = (light(frame, k) for k, frame in enumerate(frames))
    coded, said = coding(film, frames)
    if said:
        warnings.warn(StageWarning("frames", said), stacklevel=2)
    moved = MeanMotion()
    matched = list(moved.watch(fields_of(lit, masks, stride, p, coded)))
    larger = larger_passes((frames[0], frames[p.gap]), masks, p) if has_few_vectors(matched[0]) else ""
    fields = [velocities(f, at, float(time[p.gap] - time[0])) for f in matched]
    if not any(np.isfinite(f.u).any() for f in fields):
        raise ValueError(f"piv: no vector in the field: {larger or reasons(fields[0])}")
    if larger:
        warnings.warn(StageWarning("frames", f"piv: few vectors in the field: {larger}"), stacklevel=2)
    three = [light(frames[k], k) for k in three_of(len(frames), stride, p.gap)]
    for text in () if larger else doubts_of(three, moved, len(frames), p.gap):
        warnings.warn(StageWarning("light", text), stacklevel=2)
    whole = xr.concat(fields, dim="t").assign_coords(head.coords).assign_attrs(head.attrs)
    return whole if len(frames) > 2 else whole.isel(t=0)


EACH, DOUBLE = "each", "AB"  # every frame with the next; double exposures


def clock(
    n: int, pairs: str, apart: float | None, rate: float, known_rate: bool, p: PivParams
) -> tuple[int, NDArray[np.float64]]:
    """(frames from one pair to the next, times (n,) of the frames [s]). apart: pair_time. Raises InputError."""
    if pairs not in (EACH, DOUBLE):
        raise InputError([f'jv.piv pairs = {pairs!r}: must be "each" (frames 1-2, 2-3, ...) or "AB" (1-2, 3-4, ...)'])
    if pairs == EACH:
        if apart is not None:
            raise InputError([f'jv.piv pair_time = {apart!r}: only of double exposures; give pairs="AB"'])
        return 1, np.arange(n) / rate
    problems = []
    if n % 2:
        problems.append(f'jv.piv pairs = "AB": {n} frames; one has no partner: give A1, B1, A2, B2, ...')
    if p.gap != 1 or p.baseline != 1:
        problems.append('jv.piv pairs = "AB": gap and baseline must be 1: A is matched with its own B alone')
    if known_rate and apart is None:
        problems.append('jv.piv pair_time: missing; with pairs="AB" and a frame_rate give the time from A to B [s]')
    if apart is not None and not 0.0 < apart < 1.0 / rate:
        most = f"(0, {1.0 / rate:g}) s, less than from one pair to the next; frame_rate is that of the pairs"
        problems.append(f"jv.piv pair_time = {apart!r}: must be in {most}")
    if problems:
        raise InputError(problems)
    if not known_rate and apart is None:
        return 2, np.arange(float(n))
    return 2, np.repeat(np.arange(n // 2) / rate, 2) + np.tile([0.0, apart or 0.0], n // 2)


def usable_of(mask: ArrayLike | None, frames: Sequence[NDArray[np.generic]]) -> Usable | None:
    """Usable pixels of frame k by one mask (H, W), or by one of each frame (n, H, W)."""
    if mask is None:
        return None
    given, shape = np.asarray(mask, bool), frames[0].shape
    if given.shape not in (shape, (len(frames), *shape)):
        raise ValueError(f"piv: mask has shape {given.shape}: give {shape}, or one of each of the {len(frames)} frames")
    return lambda k: given if given.ndim == 2 else given[k]


def both(a: Usable | None, pixels: Sequence[NDArray[np.bool_]] | None) -> Usable | None:
    """Usable by a mask and by the pixels themselves."""
    if pixels is None:
        return a
    return lambda k: pixels[k] if a is None else pixels[k] & a(k)


def has_few_vectors(f: VectorField, common: float = 1.0) -> bool:
    """Return True if so few windows with texture were measured that these may be chance.

    common: share of the picture that both frames show.
    """
    return bool(np.isin(f.reason, MEASURED).sum() < (1.0 - LOST) * common * np.isin(f.reason, MATCHED).sum())


def larger_passes(pair: tuple[Image, Image], usable: Usable | None, p: PivParams) -> str:
    """Name the passes with which a pair without vectors is measured, and the shift of the whole pictures; "" where
    larger passes do not help."""
    a, b = (np.nan_to_num(np.asarray(f, np.float32)) for f in pair)  # copies: phaseCorrelate writes into its pictures
    size = a.shape[::-1]
    shift, _ = cv2.phaseCorrelate(a, b, cv2.createHanningWindow(size, cv2.CV_32F))
    first = 2 ** math.ceil(math.log2(2.0 * max(map(abs, shift)) + 1.0))
    if first <= p.passes[0] or first > LARGEST_PASS:
        return ""
    again = replace(p, passes=(first, *p.passes), gap=1, baseline=1, ensemble=1)
    shown = usable and (lambda k: usable(k * p.gap))
    common = math.prod(1.0 - abs(d) / n for d, n in zip(shift, size))
    if has_few_vectors(next(fields_of(pair, shown, 1, again)), common):
        return ""
    return f"the pictures are {math.hypot(*shift):.3g} px apart, beyond the first of passes: give passes={again.passes}"


def reasons(field: xr.Dataset) -> str:
    """Why there are no vectors, the most usual reason first."""
    kinds, counts = np.unique(field.reason.to_numpy(), return_counts=True)
    order = np.argsort(-counts)
    return ", ".join(f"{counts[k]} x {REASONS[int(kinds[k])]}" for k in order[:3])
