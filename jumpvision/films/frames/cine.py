"""Phantom films (.cine): headers, tagged blocks with per-frame times and exposures, then the frames.

Layout after Vision Research's description of the cine file format; everything little endian. File header at 0: type
"CI", 16 first image number, 20 image count, 24, 28, 32 offsets of the bitmap header, the setup, the frame offsets.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Image

from .base import Film, FrameError, Known, check_image, clock, differs, lost
from .packed import frame_bytes, pixel_type, read_pixels

# Places in the setup block [bytes].
MARK, LENGTH, FRAME_RATE, SHUTTER_US, CFA, REAL_BPP, SHUTTER_NS = 140, 142, 768, 772, 808, 896, 1568
TIMES, EXPOSURES = 1002, 1003  # tagged blocks: 32.32 and 0.32 fixed-point seconds, one a frame

# 10-bit packed pixels are coded; the format's table takes them to linear 12-bit values. Its steps, in base 36:
_STEPS = (
    "2311111111111101111111111111111011111111111111101111111111111110"
    "1111111111111111011111111111111101111111111111111011111111111111"
    "1011111111111101111111111111111121111111112111111211112111211121"
    "1121121121121121211212121121212121212122121221212212212212212221"
    "2221222122222122222221222222222222222222222223222222232222232223"
    "2223222322322322322323232232323232323232332323233233233233233323"
    "3323332333332333333332333333333333333333343333333343333433334333"
    "4334333433434334343343434343434343434434344344344344344434443444"
    "4344444434444444444444444444444444454444454444544454445445445445"
    "4454545445454545454554545455455455455455545554555545555554555555"
    "5555555555555555555655555565555655565556556556556565565656565656"
    "5656565665665656656665666566656666566666666566666666666666766666"
    "6667666676666766676676676676766767676767676767676776767767767776"
    "7776777677777677777777777677777877777777777877777877778777877877"
    "8778778787877878787878878787887887887887888788887888887888888888"
    "8888888888888888988888988889888988988988988989898898988v00000000"
)
LINEAR_12 = np.cumsum([int(step, 36) for step in "".join(_STEPS)]).astype(np.uint16)


class CineFilm(Film):
    """A Phantom film of grey: 8 or 16 bits a pixel, packed 12 bits, or packed 10 bits (given as linear 12-bit values).

    Per-frame time stamps beat the header's rate, which is wrong for a film saved with frames left out.
    """

    bare = True

    def __init__(self, path: Path, *, frame_rate: float | None, start: float) -> None:
        self._file = path.open("rb")
        try:
            self._open(path, frame_rate, start)
        except BaseException:
            self._file.close()
            raise

    def _open(self, path: Path, frame_rate: float | None, start: float) -> None:
        size = path.stat().st_size
        head = block(self._file, 0, 44, size, path)
        if head[:2] != b"CI":
            raise FrameError(f"{path}: not a Phantom .cine film (does not start with 'CI'); copy it again")
        compression = struct.unpack_from("<H", head, 4)[0]
        first, promised, at_bitmap, at_setup, at_offsets = struct.unpack_from("<iIIII", head, 16)
        bitmap = block(self._file, at_bitmap, 40, size, path)
        width, signed_height, _, bit_count, packing = struct.unpack_from("<iiHHI", bitmap, 4)
        setup = block(self._file, at_setup, 144, size, path)
        length = struct.unpack_from("<H", setup, LENGTH)[0] if setup[MARK:LENGTH] == b"ST" else 144
        setup = block(self._file, at_setup, max(length, 144), size, path)

        height = abs(signed_height)
        check_image(path, height, width)
        colour = entry(setup, CFA) & 0xFF
        if compression != 0 or colour:
            raise FrameError(
                f"{path}: compression {compression}, colour filter {colour}; allowed: 0, 0; save it as plain grey"
            )
        # 256 and 1024: bitmap compressions of packed 10 and 12 bits
        self._bits = {(0, 8): 8, (0, 16): 16, (256, 16): 10, (1024, 16): 12}.get((packing, bit_count), 0)
        if not self._bits:
            raise FrameError(
                f"{path}: {bit_count} bits a pixel packed as {packing}; allowed: grey of 8 or 16 bits, or packed 10, 12"
            )
        # Plain bitmaps have their bottom row first, unless the height is negative; packed ones are stored top down.
        self._flip = packing == 0 and signed_height > 0
        nbytes = frame_bytes(path, height, width, self._bits)

        room = min(max(size - at_offsets, 0) // 8, size // max(nbytes, 1))  # so many frames can be whole in the file
        self._file.seek(at_offsets)
        offsets = np.fromfile(self._file, "<i8", min(promised, room))
        pixels = pixel_offsets(self._file, offsets, nbytes, size)
        whole = np.flatnonzero(pixels)
        if not len(whole):
            raise FrameError(f"{path}: no whole frame of {promised} in {size} bytes; copy it again")
        self._pixels = pixels[whole]

        rate = float(entry(setup, FRAME_RATE) or struct.unpack_from("<H", setup)[0])
        tags = tagged_blocks(self._file, at_setup + length, min(at_offsets, size), promised)
        warnings = lost(path, len(whole), promised)
        stamps = None
        if TIMES in tags:
            ticks = tags[TIMES].view("<i8")
            stamps = (ticks - ticks[0])[whole] / 2.0**32
            if len(whole) > 1 and rate > 0 and differs(rate, stamps):
                recorded = (len(whole) - 1) / float(stamps[-1])
                warnings.append(
                    f"{path}: the header says {rate:g} Hz, the frames' time stamps {recorded:g} Hz "
                    f"(frames left out when it was saved?); the time stamps are used"
                )
        elif rate > 0:
            stamps = whole / rate
            warnings.append(f"{path}: no time stamps for the frames; the header's {rate:g} Hz is used")
        depth = {8: 8, 10: 12, 12: 12}.get(self._bits, entry(setup, REAL_BPP))
        meta: Known = {"format": "cine", "bit_depth": depth if 0 < depth <= 16 else 16, "first_frame": first}
        if rate > 0:
            meta["recorded_rate_hz"] = rate
        exposure = entry(setup, SHUTTER_NS) * 1e-9 or entry(setup, SHUTTER_US) * 1e-6
        if EXPOSURES in tags:
            exposure = float(np.median(tags[EXPOSURES].view("<u4")[whole])) / 2.0**32
        if exposure > 0:
            meta["exposure_s"] = exposure
        super().__init__(
            path,
            shape=(height, width),
            dtype=pixel_type(self._bits),
            clock=clock(path, len(whole), start=start, frame_rate=frame_rate, stamps=stamps),
            warnings=warnings,
            meta=meta,
        )

    def _read(self, i: int) -> Image:
        image = read_pixels(self._file, int(self._pixels[i]), *self.shape, self._bits)
        if self._bits == 10:
            image = LINEAR_12[image]
        return np.ascontiguousarray(image[::-1]) if self._flip else image

    def close(self) -> None:
        self._file.close()


def block(file: BinaryIO, offset: int, nbytes: int, size: int, path: Path) -> bytes:
    if offset + nbytes > size:
        raise FrameError(f"{path}: its header points to byte {offset + nbytes}, the file has {size}; copy it again")
    file.seek(offset)
    return file.read(nbytes)


def entry(setup: bytes, at: int) -> int:
    """A uint32 of the setup, 0 where this version of it ends before."""
    return int(struct.unpack_from("<I", setup, at)[0]) if at + 4 <= len(setup) else 0


def pixel_offsets(file: BinaryIO, offsets: NDArray[np.int64], nbytes: int, size: int) -> NDArray[np.int64]:
    """Where each frame's pixels begin, 0 where it is not whole. An annotation precedes them, ending in their size."""
    begin = np.zeros(len(offsets), np.int64)
    for i, at in enumerate(offsets.tolist()):
        if not 44 <= at <= size - 8 - nbytes:
            continue
        file.seek(at)
        pixels = at + struct.unpack("<I", file.read(4))[0]
        if at + 8 <= pixels <= size - nbytes:
            file.seek(pixels - 4)
            if struct.unpack("<I", file.read(4))[0] == nbytes:
                begin[i] = pixels
    return begin


def tagged_blocks(file: BinaryIO, at: int, end: int, n: int) -> dict[int, NDArray[np.uint8]]:
    """Contents of the tagged blocks that hold one item for each of n frames (the others are skipped), by their tag."""
    item = {TIMES: 8, EXPOSURES: 4}
    found = {}
    while at + 8 <= end:
        file.seek(at)
        nbytes, tag, more = struct.unpack("<IHH", file.read(8))
        if nbytes < 8 or at + nbytes > end:
            break
        if tag in item and nbytes >= 8 + n * item[tag]:
            found[tag] = np.fromfile(file, np.uint8, n * item[tag])
        if not more:
            break
        at += nbytes
    return found
