"""A decoded video frame as grey at its own depth."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from jumpvision.frames.base import FrameError, Image
from jumpvision.frames.grey import luma

# Luma in every second value of the one plane: which value it starts at.
INTERLEAVED = {"yuyv422": 0, "yvyu422": 0, "uyvy422": 1, "ya8": 0, "ya16le": 0, "ya16be": 0}
# Two-plane formats that keep their bits on the high side of 16.
HIGH_SIDE = {"p010": 6, "p210": 6, "p410": 6, "p012": 4, "p212": 4, "p412": 4}


def grey_type(pixels: Any) -> tuple[np.dtype[Any], int]:
    """(dtype, bits) of the grey image of a frame in the given av.VideoFormat."""
    bits = 8 if pixels.has_palette else int(pixels.components[0].bits)
    if pixels.name.startswith("grayf32"):
        return np.dtype(np.float32), 32
    return (np.dtype(np.uint8), bits) if bits <= 8 else (np.dtype(np.uint16), min(bits, 16))


def grey(frame: Any) -> Image:
    """(height, width) of a frame: the luma plane as stored (studio range is not stretched), or luma of RGB.

    Formats of neither kind (Bayer, one-bit) are first taken to RGB by FFmpeg.
    """
    pixels = frame.format
    dtype, bits = grey_type(pixels)
    if pixels.has_palette:
        index, colours = frame.to_ndarray()  # colours: (256, 4) of opacity, red, green, blue
        return luma(colours[:, 1], colours[:, 2], colours[:, 3])[index]
    if pixels.is_rgb and pixels.name.startswith("gbr") and "f" not in pixels.name:
        green, blue, red = (plane(frame, k, stored(pixels, dtype), 1) for k in range(3))
        return luma(red.astype(dtype), green.astype(dtype), blue.astype(dtype))
    if pixels.is_rgb or pixels.is_bayer or pixels.is_bit_stream or not pixels.components[0].is_luma:
        rgb = frame.to_ndarray(format="rgb24" if bits <= 8 else "rgb48le")
        return luma(rgb[:, :, 0], rgb[:, :, 1], rgb[:, :, 2])
    if pixels.name in INTERLEAVED:
        return plane(frame, 0, stored(pixels, dtype), 2)[:, INTERLEAVED[pixels.name] :: 2].astype(dtype)
    image = plane(frame, 0, stored(pixels, dtype), 1).astype(dtype)
    shift = HIGH_SIDE.get(pixels.name[:4], 0)
    return image >> shift if shift else image


def stored(pixels: Any, dtype: np.dtype[Any]) -> np.dtype[Any]:
    return dtype.newbyteorder(">" if pixels.is_big_endian and dtype.itemsize > 1 else "<")


def plane(frame: Any, k: int, dtype: np.dtype[Any], per_pixel: int) -> NDArray[Any]:
    """Plane k as (height, width * per_pixel) values, without the padding of its lines."""
    source = frame.planes[k]
    if source.line_size < 0:  # rows from the bottom; the buffer then starts at the last one
        raise FrameError(f"{frame.format.name} pixels with the bottom row first are not supported; convert with ffmpeg")
    lines = np.frombuffer(source, dtype).reshape(-1, source.line_size // dtype.itemsize)
    return lines[: frame.height, : frame.width * per_pixel]
