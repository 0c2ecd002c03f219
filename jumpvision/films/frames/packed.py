"""Raw pixel blocks of the high-speed camera formats: 8, 16 and packed 10 or 12 bits a pixel."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import numpy as np
from numba import njit
from numpy.typing import NDArray

from jumpvision.base.arrays import Image

from .base import FrameError


def pixel_type(bits: int) -> np.dtype[np.generic]:
    return np.dtype(np.uint8 if bits == 8 else np.uint16)


def frame_bytes(path: Path, height: int, width: int, bits: int) -> int:
    """Bytes of one frame; packed frames must end on a byte."""
    if height * width * bits % 8:
        raise FrameError(f"{path}: {height} x {width} pixels of {bits} bits do not fill whole bytes (damaged header?)")
    return height * width * bits // 8


def read_pixels(file: BinaryIO, offset: int, height: int, width: int, bits: int) -> Image:
    """(height, width) pixels of 8, 10, 12 or 16 bits at `offset`; 10 and 12 packed, most significant bit first."""
    nbytes = height * width * bits // 8
    file.seek(offset)
    data = np.fromfile(file, np.uint8, nbytes)
    if len(data) < nbytes:
        raise FrameError(f"{file.name}: the file became shorter while it was read; open it again")
    return unpack(data, bits).reshape(height, width)


def unpack(data: NDArray[np.uint8], bits: int) -> Image:
    """Flat pixels from bytes: 8, 16 (little endian), or 10 and 12 bits packed with the most significant bit first."""
    if bits == 8:
        return data
    if bits == 16:
        return data.view("<u2").astype(np.uint16, copy=False)
    if bits in (10, 12):
        out = np.empty(len(data) * 8 // bits, dtype=np.uint16)
        (_unpack12 if bits == 12 else _unpack10)(data, out)
        return out
    raise ValueError(f"bits = {bits}; must be 8, 10, 12 or 16")


@njit(cache=True)
def _unpack12(b, out):  # type: ignore[no-untyped-def]
    """3 bytes hold 2 pixels."""
    for k in range(len(out) // 2):
        m = 3 * k
        out[2 * k] = np.uint16(b[m]) << 4 | b[m + 1] >> 4
        out[2 * k + 1] = np.uint16(b[m + 1] & 15) << 8 | b[m + 2]


@njit(cache=True)
def _unpack10(b, out):  # type: ignore[no-untyped-def]
    """5 bytes hold 4 pixels."""
    for k in range(len(out) // 4):
        m = 5 * k
        out[4 * k] = np.uint16(b[m]) << 2 | b[m + 1] >> 6
        out[4 * k + 1] = np.uint16(b[m + 1] & 63) << 4 | b[m + 2] >> 4
        out[4 * k + 2] = np.uint16(b[m + 2] & 15) << 6 | b[m + 3] >> 2
        out[4 * k + 3] = np.uint16(b[m + 3] & 3) << 8 | b[m + 4]
