"""NorPix StreamPix films (.seq): fixed blocks of raw pixels, each followed by its time stamp.

Layout after the StreamPix manual: little endian; 0 magic 0xFEED, 28 version, 548 width, height, bits a pixel as stored
and as real, bytes of an image, image format (100 = grey), 572 frames, 580 bytes from image to image, 584 suggested
rate (double), 620 compression. Pixels start at 8192 (version 5 on) or 1024; a stamp is uint32 s, uint16 ms, uint16 us.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from jumpvision.base.arrays import Image

from .base import Film, FrameError, Known, check_image, clock, lost
from .packed import frame_bytes, pixel_type, read_pixels

STAMP = np.dtype([("s", "<u4"), ("ms", "<u2"), ("us", "<u2")])


class SeqFilm(Film):
    """A NorPix film of uncompressed grey, 8 or 16 bits a pixel."""

    bare = True

    def __init__(self, path: Path, *, frame_rate: float | None, start: float) -> None:
        size = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(1024)
        if len(head) < 1024 or struct.unpack_from("<I", head)[0] != 0xFEED:
            raise FrameError(
                f"{path}: not a NorPix .seq film (no 0xFEED at its start); copy it again or export it anew"
            )
        version = struct.unpack_from("<i", head, 28)[0]
        width, height, bits, depth, image_bytes, kind, promised = struct.unpack_from("<7I", head, 548)
        step, rate = struct.unpack_from("<Id", head, 580)
        compression = struct.unpack_from("<I", head, 620)[0]
        if kind != 100 or compression:
            raise FrameError(
                f"{path}: image format {kind}, compression {compression}; allowed: 100 (grey), 0; export it as raw grey"
            )
        check_image(path, height, width)
        if bits not in (8, 16):
            raise FrameError(f"{path}: {bits} bits a pixel; allowed: 8 or 16; export it unpacked")
        nbytes = frame_bytes(path, height, width, bits)
        if image_bytes != nbytes or step < nbytes + STAMP.itemsize:
            raise FrameError(
                f"{path}: damaged header: {height} x {width} pixels of {bits} bits need {nbytes} bytes, "
                f"it says {image_bytes} in blocks of {step}"
            )
        self._step, self._bits = step, bits
        self._begin = 8192 if version >= 5 else 1024
        whole = (
            max(size - self._begin - nbytes - STAMP.itemsize + step, 0) // step
        )  # the last block may lack its padding
        n = min(whole, promised) if promised else whole
        if n < 1:
            raise FrameError(f"{path}: no whole frame in {size} bytes; copy it again")
        warnings = lost(path, whole, promised)
        if not promised:
            warnings = [f"{path}: its header counts no frames (recording not closed?); {n} whole ones are in the file"]
        stamps = np.empty(n, STAMP)
        with path.open("rb") as file:
            for i in range(n):
                file.seek(self._begin + i * step + nbytes)
                stamps[i] = np.frombuffer(file.read(STAMP.itemsize), STAMP)[0]
        us = np.where(stamps["us"] < 1000, stamps["us"], 0)  # older versions have only milliseconds, then padding
        ticks = stamps["s"].astype(np.int64) * 1_000_000 + stamps["ms"].astype(np.int64) * 1000 + us
        meta: Known = {"format": "seq", "bit_depth": int(depth) if 0 < depth <= bits else bits}
        if 0 < rate < 1e9:
            meta["recorded_rate_hz"] = rate
        super().__init__(
            path,
            shape=(height, width),
            dtype=pixel_type(bits),
            clock=clock(path, n, start=start, frame_rate=frame_rate, stamps=(ticks - ticks[0]) * 1e-6),
            warnings=warnings,
            meta=meta,
        )
        self._file = path.open("rb")

    def _read(self, i: int) -> Image:
        return read_pixels(self._file, self._begin + i * self._step, *self.shape, self._bits)

    def close(self) -> None:
        self._file.close()
