"""Pictures and sequences of pictures: size, wholeness and pixels as grey."""

from __future__ import annotations

import os
import re
import struct
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Image

from .base import Film, FrameError, check_image, clock, single_channel, upright
from .names import numbering

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".tif", ".tiff")


def image_size(path: Path) -> tuple[int, int]:
    """(height, width) of an image. Raises FrameError when the file is empty, torn or no image."""
    nbytes = path.stat().st_size
    if nbytes == 0:
        raise FrameError(f"{path}: the image is empty (0 bytes); copy it again or leave it out")
    suffix = path.suffix.lower()
    if suffix in (".tif", ".tiff"):
        from .tiff import TiffFilm

        with TiffFilm(path, frame_rate=1.0, start=0.0) as film:
            if len(film) != 1:
                raise FrameError(
                    f"{path}: {len(film)} pages; an image sequence needs one a file; open the stack itself"
                )
            return film.shape
    with path.open("rb") as file:
        head = file.read(2**20)
        # cameras append notes, of up to 64 KiB, after a JPEG's end marker
        file.seek(max(nbytes - 2**16, 0))
        tail = file.read()
    size = {".png": png_size, ".bmp": bmp_size, ".pgm": pnm_size, ".ppm": pnm_size}.get(suffix, jpeg_size)(head, tail)
    if size is None:
        raise FrameError(f"{path}: the image is torn or no {suffix} image; copy it again or leave it out")
    # deflate reaches 1032 pixels a byte, JPEG fewer: a larger claim is a damaged header
    if size[0] * size[1] > 2000 * nbytes:
        raise FrameError(f"{path}: {size[0]} x {size[1]} pixels in {nbytes} bytes (damaged header?); copy it again")
    check_image(path, *size)
    return (size[1], size[0]) if orientation(path, head) > 4 else size


def read_image(path: Path) -> Image:
    """(height, width) grey at the file's own depth, turned as its EXIF note says, as every viewer shows it."""
    suffix = path.suffix.lower()
    if suffix in (".tif", ".tiff"):
        from .tiff import TiffFilm

        with TiffFilm(path, frame_rate=1.0, start=0.0) as film:
            return film[0]
    if suffix in (".pgm", ".ppm"):
        return single_channel(read_pnm(path), path)
    import cv2

    data = np.fromfile(path, np.uint8)
    try:
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise FrameError(f"{path}: cannot be decoded: {error}; copy it again or leave it out") from error
    if image is None or (suffix in (".jpg", ".jpeg") and not whole_jpeg(data.tobytes())):
        raise FrameError(f"{path}: the image is damaged and cannot be decoded whole; copy it again or leave it out")
    return upright(single_channel(np.asarray(image), path, order="bgr"), orientation(path, data[: 2**16].tobytes()))


def orientation(path: Path, head: bytes) -> int:
    """The EXIF orientation of a picture, 1 to 8; 1 (as stored) where it has none. head: begin of the file."""
    if b"Exif" not in head and b"eXIf" not in head:
        return 1
    from PIL import Image as Pictures

    try:
        with Pictures.open(path) as picture:
            return int(picture.getexif().get(0x0112, 1))
    except (OSError, ValueError, SyntaxError):  # notes that cannot be read turn nothing
        return 1


def whole_jpeg(data: bytes) -> bool:
    """Whether a JPEG's coded data are there to the end: what is missing OpenCV's decoder fills with grey, unsaid."""
    import av

    codec = av.CodecContext.create("mjpeg", "r")
    codec.options = {"err_detect": "explode"}
    try:
        codec.decode(av.Packet(data))
    except av.error.InvalidDataError:
        return False
    except av.error.FFmpegError:  # CMYK and other kinds that this decoder has not
        return True
    return True


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


def read_pnm(path: Path) -> NDArray[np.generic]:
    """Read a binary PGM or PPM, values as stored; of a torn one the error says how many are there."""
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


class ImageFilm(Film):
    """Images as the frames of a film; all of one size and depth. Times come from the declared frame rate and, where
    the files are numbered with gaps, from their numbers: a missing image leaves a gap in time, it shifts nothing."""

    def __init__(
        self, path: Path, *, names: Sequence[str] | None = None, frame_rate: float | None, start: float
    ) -> None:
        self._folder = path if path.is_dir() else path.parent
        self.names, positions, warnings = numbering(path, names or [path.name])
        sizes = [image_size(file) for file in self._paths()]  # before a pixel is decoded: a damaged size is refused
        first = read_image(self._folder / self.names[0])
        for file, size in zip(self._paths(), sizes):
            if size != first.shape:
                raise FrameError(
                    f"{file}: {size[0]} x {size[1]} pixels, but {self.names[0]} has {first.shape[0]} x "
                    f"{first.shape[1]}; a film needs one size; leave it out or give a pattern that does"
                )
        super().__init__(
            path,
            shape=(first.shape[0], first.shape[1]),
            dtype=first.dtype,
            clock=clock(path, len(self.names), start=start, frame_rate=frame_rate, positions=positions),
            warnings=warnings,
            meta={"format": "images", "bit_depth": 8 * first.dtype.itemsize},
        )

    @property
    def stems(self) -> list[str]:
        """The name of each frame's image without what stands behind its last point."""
        return [os.path.splitext(n)[0] for n in self.names]

    def _paths(self) -> Iterator[Path]:
        """The image of each frame: a path takes six times the memory of a name, so one at a time."""
        return map(self._folder.joinpath, self.names)

    def _read(self, i: int) -> Image:
        file = self._folder / self.names[i]
        image = read_image(file)
        if image.shape != self.shape or image.dtype != self.dtype:
            raise FrameError(
                f"{file}: {image.shape} {image.dtype}, but the film has {self.shape} {self.dtype}; "
                "save all images of a film alike"
            )
        return image

    def close(self) -> None:
        self.names = []


def image_names(path: Path) -> list[str]:
    """Names of the images of a folder or pattern. Raises FrameError for none or a mixed folder."""
    if path.is_dir():
        with os.scandir(path) as entries:
            names = [e.name for e in entries if _suffix(e.name) in SUFFIXES and e.name[0] != "." and e.is_file()]
        kinds = Counter(map(_suffix, names))
        if len(kinds) > 1:
            found = ", ".join(f"{n} {kind}" for kind, n in sorted(kinds.items()))
            raise FrameError(
                f"{path}: the folder mixes {found} images; give a pattern such as {path.name}/*{min(kinds)}"
            )
    else:
        names = [f.name for f in path.parent.glob(path.name) if f.is_file()]
        for name in names:
            if _suffix(name) not in SUFFIXES:
                raise FrameError(
                    f"{path.parent / name}: no image, but matches {path.name}; allowed: {' '.join(SUFFIXES)}; narrow "
                    "the pattern"
                )
    if not names:
        raise FrameError(f"{path}: no image here; allowed: {' '.join(SUFFIXES)}")
    return names


def _suffix(name: str) -> str:
    return os.path.splitext(name)[1].lower()
