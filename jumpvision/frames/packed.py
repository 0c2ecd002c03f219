"""Raw pixel blocks of the high-speed camera formats: 8, 16 and packed 10 or 12 bits a pixel."""

from __future__ import annotations

from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from jumpvision.frames.base import FrameError, Image


def pixel_type(bits: int) -> np.dtype[Any]:
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
    if bits == 12:  # 3 bytes hold 2 pixels
        b = data.reshape(-1, 3).astype(np.uint16).T
        return np.stack([b[0] << 4 | b[1] >> 4, (b[1] & 15) << 8 | b[2]], axis=1).ravel()
    if bits == 10:  # 5 bytes hold 4 pixels
        b = data.reshape(-1, 5).astype(np.uint16).T
        pixels = [
            b[0] << 2 | b[1] >> 6,
            (b[1] & 63) << 4 | b[2] >> 4,
            (b[2] & 15) << 6 | b[3] >> 2,
            (b[3] & 3) << 8 | b[4],
        ]
        return np.stack(pixels, axis=1).ravel()
    raise ValueError(f"bits = {bits}; must be 8, 10, 12 or 16")
