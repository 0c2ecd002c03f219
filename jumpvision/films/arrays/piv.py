"""`jv.piv` of images: a velocity field of two, or of every pair of a stack."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from jumpvision.base.parameters import of_keywords
from jumpvision.films.parameters import PivParams
from jumpvision.films.vision.piv.engine import Usable, best_prefilter
from jumpvision.films.vision.piv.light import light_of

from .velocities import Places, fields_of, header, matching, velocities


def piv(
    a: Any, b: Any = None, *, frame_rate: float = 1.0, scale: float | None = None, mask: Any = None, **parameters: Any
) -> xr.Dataset:
    """Velocity field from frame a to frame b, or of every neighbouring pair of the frames a (n, H, W) or a sequence.

    Images (H, W) grey, of any number type; NaN pixels count as masked. frame_rate [1/s]: default one frame a second,
    so that speeds are px per frame. scale [m/px]: speeds are in m/s and places in m with it, in px without.
    mask (H, W), or (n, H, W) of every frame: True where usable. parameters: those of [params.piv], such as window=32,
    step=8.

    Data set over (y, x), with t before them where there are more than two frames: u right, v up, u_sigma, v_sigma,
    correlation, reason (0: measured as it stands); x right and y up from the first pixel. Raises InputError for a
    parameter, ValueError for frames that differ in shape.
    """
    p = of_keywords(PivParams, parameters, folder=("foot_rows",), frame_rate=frame_rate, scale=scale)
    frames = [np.asarray(f) for f in (a if b is None else (a, b))]
    if len(frames) <= p.gap or any(f.ndim != 2 for f in frames):
        shapes = ", ".join(str(f.shape) for f in frames[:3])
        raise ValueError(f"piv: {len(frames)} frame(s) {shapes}: give two grey images (H, W), or more in one stack")
    masks = usable_of(mask, len(frames))
    light = light_of(frames, 1, p)
    first, second = light(frames[0], 0), light(frames[p.gap], p.gap)
    prefilter, begun = best_prefilter(first, second, mask=masks, gap=p.gap, **matching(p))
    time, at = np.arange(len(frames)) / frame_rate, Places("images", scale, 0.0, 0.0, 0.0)
    head = header(time, frames[0].shape, at, prefilter, 1, p)
    lit = (light(frame, k) for k, frame in enumerate(frames))
    fields = [velocities(f, scale, p.gap / frame_rate) for f in fields_of(lit, masks, prefilter, 1, p, begun)]
    whole = xr.concat(fields, dim="t").assign_coords(head.coords).assign_attrs(head.attrs)
    return whole if len(frames) > 2 else whole.isel(t=0)


def usable_of(mask: Any, n: int) -> Usable | None:
    """Usable pixels of frame k by one mask (H, W), or by one of each of n frames."""
    if mask is None:
        return None
    given = np.asarray(mask, bool)
    if given.ndim == 3 and len(given) != n:
        raise ValueError(f"piv: mask has shape {given.shape}: give one (H, W), or one of each of the {n} frames")
    return lambda k: given if given.ndim == 2 else given[k]
