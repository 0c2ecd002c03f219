"""What a function of arrays takes for grey images: any kind of number, any order of bytes, masked or not."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Image
from jumpvision.base.schema import StageWarning
from jumpvision.films.frames import Film, open_frames


def grey_images(name: str, frames: Any) -> list[Image]:
    """Images (H, W) of a stack (n, H, W) or a sequence, masked arrays as they are; uint8, uint16 or floats.

    A frame may be the path of a picture. bool becomes 0 and 1 as decimals, other whole numbers float32 or, where that
    loses digits, float64; the order of bytes becomes this machine's. ValueError names the frame and what it is where it
    is no grey image, FrameError a file that cannot be read.
    """
    images = [as_grey(name, picture(f) if is_path(f) else f, k) for k, f in enumerate(frames)]
    if len({i.shape for i in images}) > 1:
        shapes = ", ".join(sorted({f"{i.shape[0]} x {i.shape[1]}" for i in images})[:4])
        raise ValueError(f"{name}: images of different sizes ({shapes} pixels): cut them to one")
    return images


def is_path(given: object) -> bool:
    return isinstance(given, str | os.PathLike)


def film_at(path: str | os.PathLike[str], frame_rate: float | None = None) -> Film:
    """The film at a path, a pattern of pictures too; what is to be known of it as warnings. Raises FrameError."""
    film = open_frames(Path(path), frame_rate=frame_rate)
    for text in film.warnings:
        warnings.warn(StageWarning("frames", text), stacklevel=3)
    return film


def picture(path: str | os.PathLike[str]) -> Image:
    """The only frame of a file. Raises FrameError, ValueError where there are more."""
    with film_at(path, 1.0) as film:
        if len(film) > 1:
            raise ValueError(f"{path}: holds {len(film)} frames where one picture is asked for; give the film alone")
        return film[0]


def as_grey(name: str, frame: Any, k: int = 0) -> Image:
    """One of `grey_images`."""
    image = np.ma.asarray(frame) if np.ma.isMaskedArray(frame) else np.asarray(frame)
    if image.ndim != 2 or not image.size:
        colour = image.ndim == 3 and image.shape[-1] in (3, 4)
        remedy = "make it grey, e.g. image.mean(axis=-1)" if colour else "give grey images (H, W), two or a stack"
        raise ValueError(f"{name}: frame {k} has shape {image.shape}: {remedy}")
    if image.dtype.kind not in "buif":
        raise ValueError(f"{name}: frame {k} holds {image.dtype}: give real numbers")
    if image.dtype.kind == "u" and image.dtype.itemsize <= 2:
        return image.astype(image.dtype.newbyteorder("="), copy=False)
    wide = image.dtype.itemsize > 4 or (image.dtype.kind in "ui" and image.dtype.itemsize == 4)
    return image.astype(np.float64 if wide else np.float32, copy=False)


def usable_pixels(images: Sequence[Image]) -> list[NDArray[np.bool_]] | None:
    """Of each image the pixels that are neither masked nor infinite or NaN; None where all are."""
    out = [np.isfinite(np.ma.getdata(i)) & ~np.ma.getmaskarray(i) for i in images]
    return None if all(u.all() for u in out) else out


def only_numbers(name: str, images: Sequence[Image]) -> list[Image]:
    """The images, for what reads every pixel: ValueError names the frame where pixels are masked, infinite or NaN."""
    for k, usable in enumerate(usable_pixels(images) or ()):
        if not usable.all():
            y, x = (int(a[0]) for a in np.nonzero(~usable))
            raise ValueError(
                f"{name}: frame {k} has {int((~usable).sum())} pixels that are masked or no numbers, the first in row "
                f"{y}, column {x}: cut them off, or fill them (np.nan_to_num, masked.filled)"
            )
    return [np.ma.getdata(i) for i in images]


def in_grey(images: Sequence[Image]) -> list[Image]:
    """Decimals as grey values of a usual contrast, so that no result depends on gain and offset; uint8 and uint16 as
    they are. One factor and one offset for all, from the first image."""
    first = np.asarray(np.ma.getdata(images[0]), np.float64)
    if images[0].dtype.kind == "u":
        return [np.ma.getdata(i) for i in images]
    known = first[np.isfinite(first) & ~np.ma.getmaskarray(images[0])]
    spread = float(known.std()) if known.size else 0.0
    if not 0.0 < spread < math.inf:
        return [np.ma.getdata(i) for i in images]
    # decimals are brought to a standard deviation of about 32 grey, by a power of 2, so that no digit is lost
    factor = 2.0 ** round(math.log2(32.0 / spread))
    low = float(known.min())
    # decimals farther from 0 than 16 times their contrast are moved to it, so that float32 holds them
    offset = low if low < 0.0 or low > 16.0 * spread else 0.0
    if factor == 1.0 and offset == 0.0:
        return [np.ma.getdata(i) for i in images]
    with np.errstate(invalid="ignore", over="ignore"):
        return [((np.asarray(np.ma.getdata(i), np.float64) - offset) * factor).astype(np.float32) for i in images]


def scale_problem(name: str, scale: object) -> str:
    """What is wrong with a scale [m/px]; "" where nothing is."""
    if scale is None or (isinstance(scale, int | float) and not isinstance(scale, bool) and 0.0 < scale <= COARSEST):
        return ""
    return f"{name} scale = {scale!r}: must be a number in (0, {COARSEST:g}] m per pixel; None: results in px"


COARSEST = 0.01  # m/px, as in a folder: a larger one is a slip, such as mm or px/m
