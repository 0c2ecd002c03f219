"""One image file: its size without decoding it, whether it is whole, and its pixels as grey."""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jumpvision.frames.base import FrameError, Image, check_image
from jumpvision.frames.grey import single_channel

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".tif", ".tiff")
TAIL = 2**16  # bytes at the end of a file where a JPEG's end marker is looked for; cameras append notes after it
MAX_COMPRESSION = 2000  # pixels a byte; deflate reaches 1032, JPEG fewer: a larger claim is a damaged header


def image_size(path: Path) -> tuple[int, int]:
    """(height, width) of an image. Raises FrameError when the file is empty, torn or no image."""
    nbytes = path.stat().st_size
    if nbytes == 0:
        raise FrameError(f"{path}: the image is empty (0 bytes); copy it again or leave it out")
    suffix = path.suffix.lower()
    if suffix in (".tif", ".tiff"):
        from jumpvision.frames.tiff import TiffFilm

        with TiffFilm(path, frame_rate=1.0, start=0.0) as film:
            if len(film) != 1:
                raise FrameError(
                    f"{path}: {len(film)} pages; an image sequence needs one a file; open the stack itself"
                )
            return film.shape
    with path.open("rb") as file:
        head = file.read(2**20)
        file.seek(max(nbytes - TAIL, 0))
        tail = file.read()
    size = {".png": png_size, ".bmp": bmp_size, ".pgm": pnm_size, ".ppm": pnm_size}.get(suffix, jpeg_size)(head, tail)
    if size is None:
        raise FrameError(f"{path}: the image is torn or no {suffix} image; copy it again or leave it out")
    check_image(path, *size)
    if size[0] * size[1] > MAX_COMPRESSION * nbytes:
        raise FrameError(f"{path}: {size[0]} x {size[1]} pixels in {nbytes} bytes (damaged header?); copy it again")
    return size


def read_image(path: Path) -> Image:
    """(height, width) grey at the file's own depth, as stored: a turning note (EXIF) is not obeyed."""
    suffix = path.suffix.lower()
    if suffix in (".tif", ".tiff"):
        from jumpvision.frames.tiff import TiffFilm

        with TiffFilm(path, frame_rate=1.0, start=0.0) as film:
            return film[0]
    if suffix in (".pgm", ".ppm"):
        return single_channel(read_pnm(path), path)
    import cv2

    try:
        image = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise FrameError(f"{path}: cannot be decoded: {error}; copy it again or leave it out") from error
    if image is None:
        raise FrameError(f"{path}: the image is damaged and cannot be decoded; copy it again or leave it out")
    return single_channel(np.asarray(image), path, order="bgr")


def png_size(head: bytes, tail: bytes) -> tuple[int, int] | None:
    if not head.startswith(b"\x89PNG\r\n\x1a\n") or len(head) < 33 or b"IEND" not in tail:
        return None
    width, height = struct.unpack_from(">II", head, 16)
    return height, width


def bmp_size(head: bytes, tail: bytes) -> tuple[int, int] | None:
    if not head.startswith(b"BM") or len(head) < 54:
        return None
    width, height = struct.unpack_from("<ii", head, 18)
    return abs(height), width


def jpeg_size(head: bytes, tail: bytes) -> tuple[int, int] | None:
    if not head.startswith(b"\xff\xd8") or b"\xff\xd9" not in tail:
        return None
    at = 2
    while at + 9 <= len(head):
        if head[at] != 0xFF:
            return None
        marker = head[at + 1]
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):  # start of frame
            height, width = struct.unpack_from(">HH", head, at + 5)
            return height, width
        at += 2 + (struct.unpack_from(">H", head, at + 2)[0] if marker != 0xFF else -1)  # fill bytes: one step
    return None


PNM = re.compile(rb"P([56])" + 3 * rb"(?:\s+|\s*#[^\n]*\n\s*)+(\d{1,6})" + rb"\s")


def pnm_size(head: bytes, tail: bytes) -> tuple[int, int] | None:
    match = PNM.match(head[:4096])
    return (int(match[3]), int(match[2])) if match else None


def read_pnm(path: Path) -> NDArray[Any]:
    """Binary PGM or PPM, values as stored. (OpenCV 5.0 gives the two bytes of 16-bit PGM in the wrong order.)"""
    with path.open("rb") as file:
        match = PNM.match(file.read(4096))
        if match is None:
            raise FrameError(f"{path}: not a binary PGM or PPM image; save it as PNG")
        file.seek(match.end())
        width, height, largest = (int(g) for g in match.groups()[1:])
        check_image(path, height, width)
        dtype = np.dtype(np.uint8 if largest < 256 else ">u2")
        shape = (height, width) if match[1] == b"5" else (height, width, 3)
        data = np.fromfile(file, dtype, min(int(np.prod(shape)), path.stat().st_size // dtype.itemsize))
    if data.size < np.prod(shape):
        raise FrameError(f"{path}: the image is torn ({data.size} of {int(np.prod(shape))} values); copy it again")
    return data.reshape(shape)
