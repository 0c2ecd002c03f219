"""Checksums of FFV1 films. FFmpeg patches a slice whose checksum fails with the last picture and only logs it."""

from __future__ import annotations

import zlib

TRAILER = 8  # bytes: 3 of slice size, 1 of error status, 4 of checksum
REVERSED = bytes(int(f"{k:08b}"[::-1], 2) for k in range(256))


def checksums_hold(packet: bytes) -> bool:
    """Whether a packet is made of FFV1 slices (RFC 9043, section 4.9) with right checksums; False if it has none.

    The CRC-32 over a slice and its checksum is zero. Unlike zlib's it takes the highest bit first and starts from zero:
    bits are reversed byte by byte, and zlib's inversions undone.
    """
    end = len(packet)
    while end >= TRAILER:
        begin = end - TRAILER - int.from_bytes(packet[end - 8 : end - 5], "big")
        if begin < 0 or zlib.crc32(packet[begin:end].translate(REVERSED), 0xFFFFFFFF) != 0xFFFFFFFF:
            return False
        end = begin
    return end == 0
