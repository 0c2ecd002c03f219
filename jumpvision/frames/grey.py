"""Colour to grey, and the pixel types a film may have."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .base import FrameError, Image

NATIVE = ("uint8", "uint16", "float32")


def native(image: NDArray[Any], where: Path | str) -> Image:
    """The image (or stack) as uint8, uint16 or float32 in machine byte order; bool becomes 0 and 1.

    Other floats become float32. Raises FrameError for wider or signed integers: no value may change unseen.
    """
    kind = native_type(image.dtype, where)
    return np.ascontiguousarray(image, dtype=kind)


def native_type(dtype: np.dtype[Any], where: Path | str) -> np.dtype[Any]:
    if dtype.kind == "b":
        return np.dtype(np.uint8)
    if dtype.kind == "f":
        return np.dtype(np.float32)
    if dtype.kind == "u" and dtype.itemsize <= 2:
        return np.dtype(f"u{dtype.itemsize}")
    raise FrameError(f"{where}: pixels of type {dtype}; allowed: uint8, uint16, float; convert them before")


def luma(red: NDArray[Any], green: NDArray[Any], blue: NDArray[Any]) -> Image:
    """Grey of a colour image by Rec. 601, 0.299 R + 0.587 G + 0.114 B, at its own depth; exact where R = G = B."""
    if red.dtype.kind == "f":
        grey = 0.299 * red.astype(np.float64) + 0.587 * green + 0.114 * blue
        return np.where((red == green) & (green == blue), red, grey).astype(np.float32)
    wide = 299 * red.astype(np.uint32) + 587 * green.astype(np.uint32) + 114 * blue.astype(np.uint32)
    return ((wide + 500) // 1000).astype(red.dtype)


def single_channel(image: NDArray[Any], where: Path | str, *, order: str = "rgb") -> Image:
    """Grey (height, width) from (height, width) or (height, width, 1 | 3 | 4), the fourth (opacity) left out."""
    if image.ndim == 2:
        return native(image, where)
    if image.ndim != 3 or image.shape[2] not in (1, 3, 4):
        channels = image.shape[2] if image.ndim == 3 else f"an array of shape {image.shape}"
        raise FrameError(f"{where}: {channels} channels; allowed: 1 (grey), 3 (colour) or 4 (colour and opacity)")
    image = native(image, where)
    if image.shape[2] == 1:
        return np.ascontiguousarray(image[:, :, 0])
    r, g, b = (order.index(c) for c in "rgb")
    return luma(image[:, :, r], image[:, :, g], image[:, :, b])
