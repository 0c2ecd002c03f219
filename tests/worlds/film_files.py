"""Files of films as cameras and FFmpeg write them; the writers share no code with the readers."""

from __future__ import annotations

import struct
from fractions import Fraction
from pathlib import Path

import av
import cv2
import h5py
import numpy as np
import pytest
import tifffile


def film_of(n: int = 6, shape: tuple[int, ...] = (24, 40), dtype: str = "uint8", seed: int = 1) -> np.ndarray:
    """(n, *shape) random pixels over the whole range of the type."""
    rng = np.random.default_rng(seed)
    if np.dtype(dtype).kind == "f":
        return rng.normal(size=(n, *shape)).astype(dtype)
    return rng.integers(0, np.iinfo(dtype).max + 1, (n, *shape)).astype(dtype)


def check_film(film, truth: np.ndarray, time: np.ndarray, seed: int = 2) -> None:
    """Frames and times equal the truth exactly, in order, in random order and from the end."""
    assert len(film) == len(truth)
    assert film.shape == truth.shape[1:]
    assert film.dtype == truth.dtype
    # 1e-12 s: rounding of sums of a few doubles below 1 s
    np.testing.assert_allclose(film.time, time, rtol=0, atol=1e-12)
    assert film.time.dtype == np.float64
    for image, expected in zip(film, truth, strict=True):
        assert image.dtype == expected.dtype
        np.testing.assert_array_equal(image, expected)
    for i in np.random.default_rng(seed).permutation(len(truth)):
        np.testing.assert_array_equal(film[int(i)], truth[i])
    np.testing.assert_array_equal(film[-1], truth[-1])
    film[0][:] = 0  # a frame is the caller's own: writing to it changes nothing
    np.testing.assert_array_equal(film[0], truth[0])
    with pytest.raises(IndexError, match="does not exist"):
        film[len(truth)]


def pack(values: np.ndarray, bits: int) -> bytes:
    """Pixels as bytes: whole little-endian words for 8 and 16 bits, else one string of bits, highest first."""
    if bits in (8, 16):
        return values.astype(f"<u{bits // 8}").tobytes()
    return np.packbits((values.reshape(-1, 1) >> np.arange(bits - 1, -1, -1)) & 1).tobytes()


def grey_film(n: int, bits: int, shape=(24, 40), seed: int = 1) -> np.ndarray:
    values = np.random.default_rng(seed).integers(0, 2**bits, (n, *shape))
    return values.astype(np.uint8 if bits == 8 else np.uint16)


def write_mraw(folder: Path, film: np.ndarray, packed: int, *, header: str = ".cihx", **entries) -> Path:
    h = {"rate": 5000, "skip": 1, "frames": len(film), "depth": min(packed, 12), "side": "Lower", "color": "Mono"}
    h |= {"width": film.shape[2], "height": film.shape[1], "bits": packed, "format": "Mraw"} | entries
    (folder / "film.mraw").write_bytes(b"".join(pack(image, packed) for image in film))
    if header == ".cih":
        text = (
            "#Camera Information Header\r\nDate : 2024/1/2\r\nCamera Type : FASTCAM Mini\r\n"
            f"Record Rate(fps) : {h['rate']}\r\nShutter Speed(s) : 1/20000\r\nTotal Frame : {h['frames']}\r\n"
            f"Original Total Frame : 9999\r\nSave Step : {h['skip']}\r\nImage Width : {h['width']}\r\n"
            f"Image Height : {h['height']}\r\nColor Type : {h['color']}\r\nColor Bit : {h['bits']}\r\n"
            f"File Format : {h['format']}\r\nEffectiveBit Depth : {h['depth']}\r\nEffectiveBit Side : {h['side']}\r\n"
            "Comment Text : width: 7, Total Frame : 3\r\n\r\n"
        )
        data = text.encode()
    else:
        text = (
            f"<cih><imageFileInfo><fileFormat>{h['format']}</fileFormat></imageFileInfo><imageDataInfo><resolution>"
            f"<width>{h['width']}</width><height>{h['height']}</height></resolution><colorInfo>"
            f"<type>{h['color']}</type><bit>{h['bits']}</bit></colorInfo><effectiveBit><depth>{h['depth']}</depth>"
            f"<side>{h['side']}</side></effectiveBit></imageDataInfo><frameInfo><totalFrame>{h['frames']}</totalFrame>"
            f"<skipFrame>{h['skip']}</skipFrame></frameInfo><recordInfo><recordRate>{h['rate']}</recordRate>"
            "<shutterSpeed>20000</shutterSpeed><shutterSpeedNsec>50000</shutterSpeedNsec></recordInfo></cih>"
        )
        data = b"!!! binary \xff\xfe before\0" + text.encode() + b"\0\x93 and after"
    (folder / f"film{header}").write_bytes(data)
    return folder / f"film{header}"


def write_seq(path: Path, film: np.ndarray, stamps_us, *, version: int = 5, allocated: int | None = None, **h) -> Path:
    n, height, width = film.shape
    bits = 8 * film.dtype.itemsize
    nbytes = height * width * film.dtype.itemsize
    begin = 8192 if version >= 5 else 1024
    step = -(-(nbytes + 8) // (8192 if version >= 5 else 512)) * (8192 if version >= 5 else 512)
    head = bytearray(begin)
    struct.pack_into("<I", head, 0, 0xFEED)
    head[4:28] = "Norpix seq\0\0".encode("utf-16le")
    struct.pack_into("<ii", head, 28, version, 1024)
    frames = n if allocated is None else allocated
    values = {"width": width, "height": height, "bits": bits, "depth": bits, "bytes": nbytes, "kind": 100} | h
    struct.pack_into(
        "<7I", head, 548, *(values[k] for k in ("width", "height", "bits", "depth", "bytes", "kind")), frames
    )
    struct.pack_into("<Id", head, 580, values.get("step", step), 25.0)
    struct.pack_into("<I", head, 620, values.get("compression", 0))
    blocks = []
    for image, us in zip(film, stamps_us):
        stamp = struct.pack("<IHH", us // 1_000_000, us // 1000 % 1000, us % 1000)
        blocks.append((image.astype(image.dtype.newbyteorder("<")).tobytes() + stamp).ljust(step, b"\0"))
    path.write_bytes(bytes(head) + b"".join(blocks))
    return path


# Seconds since 1970 that cross a second: a reader that drops or mixes the parts is off by 0.1 ms or more.
STAMPS_US = 1_435_776_075_998_300 + np.array([0, 510, 1000, 1750, 2600, 3001])


def write_cine(
    path: Path, film: np.ndarray, *, bits: int, stamps=None, rate: int = 1000, height_sign: int = 1, **h
) -> Path:
    """A cine of raw values: 8 or 16 bits bottom row first (for a positive height), packed 10 or 12 top row first."""
    n, height, width = film.shape
    setup = bytearray(6000)
    setup[140:142] = b"ST"
    struct.pack_into("<H", setup, 142, len(setup))
    struct.pack_into("<II", setup, 768, rate, 20)
    struct.pack_into("<I", setup, 808, h.get("cfa", 0))
    struct.pack_into("<I", setup, 896, h.get("depth", bits))
    struct.pack_into("<I", setup, 1568, 20_000)
    tags = b""
    if stamps is not None:
        fixed = b"".join(struct.pack("<Q", round(t * 2**32)) for t in stamps)
        tags = struct.pack("<IHH", 20, 1004, 1) + bytes(12) + struct.pack("<IHH", 8 + 8 * n, 1002, 1) + fixed
        tags += struct.pack("<IHH", 8 + 4 * n, 1003, 0) + struct.pack("<I", round(25e-6 * 2**32)) * n
    at_setup, at_offsets = 84, 84 + len(setup) + len(tags)
    bit_count, packing = {8: (8, 0), 16: (16, 0), 10: (16, 256), 12: (16, 1024)}[bits]
    frames = []
    for image in film:
        rows = image[::-1] if packing == 0 and height_sign > 0 else image
        pixels = pack(rows, bits)
        note = b"note" * 3
        frames.append(struct.pack("<I", 8 + len(note)) + note + struct.pack("<I", len(pixels)) + pixels)
    begin = at_offsets + 8 * n
    offsets = [begin + sum(len(f) for f in frames[:k]) for k in range(n)]
    for k, at in h.get("offsets", {}).items():
        offsets[k] = at
    head = struct.pack("<2sHHHiIiIIIIQ", b"CI", 44, h.get("compression", 0), 1, -5, 9999, -3, h.get("count", n), 44,
                       h.get("at_setup", at_setup), h.get("at_offsets", at_offsets), 1 << 62)  # fmt: skip
    bitmap = struct.pack("<IiiHHIIiiII", 40, h.get("width", width), height_sign * h.get("height", height), 1, bit_count,
                         packing, len(pack(film[0], bits)), 0, 0, 0, 0)  # fmt: skip
    table = struct.pack(f"<{n}q", *offsets)
    path.write_bytes(head + bitmap + bytes(setup) + tags + table + b"".join(frames))
    return path


# Exact in 32.32 fixed point, uneven, after an epoch of 2010: seconds kept apart from fractions or lost precision shows.
STAMPS_S = 1_270_000_000 + 2.0**-13 * np.array([0, 1, 2, 4, 5, 6])
LOSSLESS_H264 = {"qp": "0", "g": "12", "bf": "3", "preset": "veryfast", "x264-params": "threads=1:scenecut=0"}


def moving(n: int = 60, shape=(48, 80), seed: int = 5) -> np.ndarray:
    """A noisy picture that shifts by one column a frame, so that codecs predict and every frame is another."""
    rng = np.random.default_rng(seed)
    base = rng.integers(16, 236, (shape[0], shape[1] + n), dtype=np.uint8)
    return np.stack([base[:, k : k + shape[1]] for k in range(n)])


def write_film(path: Path, images, codec: str, pixels: str, *, rate=200, options=None, pts=None, tick=None, mux=None):
    """images: arrays in the layout that PyAV takes for `pixels`. pts: stamps in ticks of 1/rate s, or of `tick` s."""
    with av.open(str(path), "w", options=mux or {}) as container:
        stream = container.add_stream(codec, rate=rate, options=options or {})
        planes = pixels == "yuv420p"
        stream.height = images[0].shape[0] * 2 // 3 if planes else images[0].shape[0]
        stream.width, stream.pix_fmt = images[0].shape[1], pixels
        tick = tick or Fraction(1, rate)
        stream.codec_context.time_base = tick
        for k, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format=pixels)
            frame.pts, frame.time_base = (k if pts is None else pts[k]), tick
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def yuv(film: np.ndarray) -> list[np.ndarray]:
    """Luma planes with flat chroma below, as PyAV takes yuv420p."""
    chroma = np.full((film.shape[1] // 2, film.shape[2]), 128, np.uint8)
    return [np.vstack([image, chroma]) for image in film]


def samples(folder: Path) -> dict[str, Path]:
    """One small good file of each binary format (header files of Photron included)."""
    film = film_of(5, dtype="uint16")
    np.save(folder / "film.npy", film)
    tifffile.imwrite(folder / "stack.tif", film, photometric="minisblack")
    tifffile.imwrite(folder / "imagej.tif", film, imagej=True)
    write_mraw(folder, film % 4096, 12)
    write_seq(folder / "film.seq", film, STAMPS_US[:5].tolist())
    write_cine(folder / "film.cine", film, bits=16, stamps=STAMPS_S[:5])
    write_cine(folder / "packed.cine", film % 1024, bits=10, stamps=STAMPS_S[:5])
    cv2.imwrite(str(folder / "image.png"), film[0])
    cv2.imwrite(str(folder / "image.jpg"), (film[0] >> 8).astype(np.uint8))
    cv2.imwrite(str(folder / "image.bmp"), (film[0] >> 8).astype(np.uint8))
    (folder / "image.pgm").write_bytes(b"P5 40 24 65535\n" + film[0].astype(">u2").tobytes())
    with h5py.File(folder / "film.h5", "w") as file:
        file.create_dataset("film", data=film, chunks=(1, 24, 40), compression="gzip")
    return {p.name: p for p in folder.iterdir()}
