"""Readers of high-speed camera files (.mraw, .seq, .cine) and of damaged files of every kind. (About 5 s.)

The writers here follow the formats' descriptions and share no code with the readers. The recordings of real cameras
are found through the environment variable JUMPVISION_REAL_DATA.
"""

from __future__ import annotations

import hashlib
import os
import struct
import time as clock
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
import tifffile
from test_frames import check_film, film_of

from jumpvision.films.frames import FrameError, open_frames

REAL = os.environ.get("JUMPVISION_REAL_DATA", "")
needs_real = pytest.mark.skipif(not REAL, reason="set JUMPVISION_REAL_DATA to the folder of real recordings")


def pack(values: np.ndarray, bits: int) -> bytes:
    """Pixels as bytes: whole little-endian words for 8 and 16 bits, else one string of bits, highest first."""
    if bits in (8, 16):
        return values.astype(f"<u{bits // 8}").tobytes()
    return np.packbits((values.reshape(-1, 1) >> np.arange(bits - 1, -1, -1)) & 1).tobytes()


def grey_film(n: int, bits: int, shape=(24, 40), seed: int = 1) -> np.ndarray:
    values = np.random.default_rng(seed).integers(0, 2**bits, (n, *shape))
    return values.astype(np.uint8 if bits == 8 else np.uint16)


# ---- Photron ---------------------------------------------------------------------------------------------------------


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


@pytest.mark.parametrize("header", [".cih", ".cihx"])
@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_mraw_reads_back(tmp_path, bits, header):
    truth = grey_film(7, bits)
    path = write_mraw(tmp_path, truth, bits, header=header, depth=bits)
    for name in (path, tmp_path / "film.mraw"):
        with open_frames(name, start=2.0) as film:
            check_film(film, truth, 2.0 + np.arange(7) / 5000.0)
            assert film.time_source == "file" and film.warnings == ()
            assert film.meta["bit_depth"] == bits and film.meta["recorded_rate_hz"] == 5000.0
            assert film.meta["exposure_s"] == pytest.approx(50e-6, rel=1e-12)  # 1/20000 s = 50000 ns


@pytest.mark.parametrize("header", [".cih", ".cihx"])
def test_mraw_skipped_frames_set_the_time_step(tmp_path, header):
    path = write_mraw(tmp_path, grey_film(4, 12), 12, rate=50000, skip=2500, header=header)
    with open_frames(path) as film:
        np.testing.assert_allclose(film.time, np.arange(4) * 0.05, rtol=0, atol=1e-15)
        assert "2500th" in film.warnings[0] and "50000 Hz" in film.warnings[0] and "20 Hz" in film.warnings[0]
    with open_frames(path, frame_rate=50000.0) as film:  # the header's step wins, both rates are named
        assert film.time[1] == pytest.approx(0.05) and "50000 Hz" in film.warnings[-1] and "20 Hz" in film.warnings[-1]


def test_mraw_high_side_is_shifted_down(tmp_path):
    truth = grey_film(3, 12)
    path = write_mraw(tmp_path, truth << 4, 16, side="Higher", depth=12)
    with open_frames(path) as film:
        check_film(film, truth, np.arange(3) / 5000.0)
        assert film.meta["bit_depth"] == 12


def test_mraw_truncated(tmp_path):
    truth = grey_film(6, 12)
    path = write_mraw(tmp_path, truth, 12)
    data = (tmp_path / "film.mraw").read_bytes()
    (tmp_path / "film.mraw").write_bytes(data[: int(3.7 * len(data) / 6)])
    with open_frames(path) as film:
        check_film(film, truth[:3], np.arange(3) / 5000.0)
        assert "promises 6 frames, 3 are whole, 3 are lost" in film.warnings[0]
    (tmp_path / "film.mraw").write_bytes(data[:100])
    with pytest.raises(FrameError, match="no whole frame"):
        open_frames(path)


def test_mraw_bad_headers(tmp_path):
    film = grey_film(3, 12)
    cases = [
        ({"frames": 10**9, "width": 10**6, "height": 10**6}, "damaged header"),
        ({"frames": -4}, "totalFrame"),
        ({"width": "many"}, "width"),
        ({"bits": 14}, "Color Bit = 14; allowed: 8, 10, 12 or 16"),
        ({"color": "Color"}, "Color Type 'Color'; allowed: Mono or Raw"),
        ({"format": "Tiff"}, "describes a 'Tiff' film"),
        ({"rate": 0}, "give frame_rate"),
    ]
    for entries, message in cases:
        with pytest.raises(FrameError, match=message):
            open_frames(write_mraw(tmp_path, film, 12, **entries))
    with open_frames(write_mraw(tmp_path, film, 12, frames=10**9)) as opened:
        assert len(opened) == 3 and "999999997 are lost" in opened.warnings[0]
    (tmp_path / "film.cihx").unlink()
    with pytest.raises(FrameError, match=r"film\.cihx \(or \.cih\) is missing"):
        open_frames(tmp_path / "film.mraw")
    write_mraw(tmp_path, film, 12)
    (tmp_path / "film.mraw").unlink()
    with pytest.raises(FrameError, match=r"film\.mraw are missing"):
        open_frames(tmp_path / "film.cihx")


# ---- NorPix ----------------------------------------------------------------------------------------------------------


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


@pytest.mark.parametrize("version", [3, 5])
@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_seq_reads_back(tmp_path, dtype, version):
    truth = film_of(dtype=dtype)
    path = write_seq(tmp_path / "film.seq", truth, STAMPS_US.tolist(), version=version)
    with open_frames(path, start=0.5) as film:
        check_film(film, truth, 0.5 + (STAMPS_US - STAMPS_US[0]) * 1e-6)
        assert film.time_source == "file"
        (told,) = film.warnings
        assert "the time between frames varies, from 0.000401 to 0.00085 s (usually 0.00051 s)" in told
    with open_frames(path, frame_rate=100.0) as film:
        # 5 steps in 3001 us
        assert "100 Hz" in film.warnings[0] and "1666.11 Hz" in film.warnings[0]


def test_seq_truncated_and_unclosed(tmp_path):
    truth = film_of()
    path = write_seq(tmp_path / "film.seq", truth, STAMPS_US.tolist())
    data = path.read_bytes()
    path.write_bytes(data[: 8192 + 3 * 8192 + 24 * 40 + 8])  # the fourth frame has its stamp but not its padding
    with open_frames(path) as film:
        check_film(film, truth[:4], (STAMPS_US[:4] - STAMPS_US[0]) * 1e-6)
        assert "promises 6 frames, 4 are whole, 2 are lost" in film.warnings[0]
    path.write_bytes(data[: 8192 + 500])
    with pytest.raises(FrameError, match="no whole frame"):
        open_frames(path)
    with open_frames(write_seq(path, truth, STAMPS_US.tolist(), allocated=0)) as film:
        assert len(film) == 6 and "counts no frames" in film.warnings[0]
    with open_frames(write_seq(path, truth, STAMPS_US.tolist(), allocated=2)) as film:
        assert len(film) == 2 and "holds 6 frames, its header only 2; the rest is left out" in film.warnings[0]


def test_seq_bad_headers(tmp_path):
    for h, message in (
        ({"kind": 200}, "image format 200"),
        ({"compression": 1}, "compression 1"),
        ({"width": 10**6, "height": 10**6}, "damaged header"),
        ({"width": 80}, "damaged header"),
        ({"bits": 12}, "12 bits a pixel; allowed: 8 or 16"),
        ({"step": 0}, "damaged header"),
        ({"step": 100}, "damaged header"),
    ):
        with pytest.raises(FrameError, match=message):
            open_frames(write_seq(tmp_path / "film.seq", film_of(), STAMPS_US.tolist(), **h))
    back = STAMPS_US.copy()
    back[3] -= 2000
    with pytest.raises(FrameError, match="do not increase at frame 3; give frame_rate"):
        open_frames(write_seq(tmp_path / "film.seq", film_of(), back.tolist()))


# ---- Phantom ---------------------------------------------------------------------------------------------------------


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


@pytest.mark.parametrize("bits", [8, 12, 16])
@pytest.mark.parametrize("sign", [1, -1])
def test_cine_reads_back(tmp_path, bits, sign):
    truth = grey_film(6, bits)
    path = write_cine(tmp_path / "film.cine", truth, bits=bits, stamps=STAMPS_S, rate=8192, height_sign=sign)
    with open_frames(path, start=1.0) as film:
        check_film(film, truth, 1.0 + (STAMPS_S - STAMPS_S[0]))
        assert film.time_source == "file"
        (told,) = film.warnings
        assert "1 frame is missing by the time stamps" in told  # and the rate, of the median step, is no news
        assert film.meta["bit_depth"] == bits
        assert film.meta["exposure_s"] == pytest.approx(25e-6, abs=2.0**-33)  # the frames' exposures beat the setup's


def test_cine_of_an_older_camera_has_its_exposure_in_microseconds(tmp_path):
    """Without exposures frame by frame and without the later field of nanoseconds: ShutterNs 0, Shutter 20 us."""
    path = write_cine(tmp_path / "film.cine", grey_film(6, 8), bits=8, rate=8192)
    with open_frames(path) as film:
        assert film.meta["exposure_s"] == pytest.approx(20e-6, rel=1e-12)  # 20,000 ns
    data = bytearray(path.read_bytes())
    struct.pack_into("<I", data, 84 + 1568, 0)
    path.write_bytes(data)
    with open_frames(path) as film:
        assert film.meta["exposure_s"] == pytest.approx(20e-6, rel=1e-12)  # 20 us


def test_cine_packed_10_bits_are_made_linear(tmp_path):
    codes = np.arange(1024).repeat(2).reshape(2, 32, 32)[:, :, :].astype(np.uint16)
    codes = np.concatenate([codes, codes[:, :, ::-1]], axis=2)  # not square: 32 x 64
    with open_frames(write_cine(tmp_path / "film.cine", codes, bits=10, stamps=STAMPS_S[:2])) as film:
        linear = np.stack([film[0], film[1]])
        assert film.meta["bit_depth"] == 12 and film.dtype == np.uint16
    table = np.full(1024, -1)
    table[codes.ravel()] = linear.ravel()
    # One value a code, never falling; black and white as the format's description gives them.
    np.testing.assert_array_equal(table[codes], linear)
    assert (np.diff(table) >= 0).all()
    assert (table[0], table[64], table[1014], table[1023]) == (2, 64, 4064, 4095)
    # The coding is Rec. 709's between code 64 (value 64) and 1014 (4064): linear = 64 + 4000 V. The published table
    # departs from that curve by up to 2.4; a lost or doubled step of it would by more than 4 from there on.
    v = (np.arange(1, 1015) - 64) / 950
    curve = 64 + 4000 * np.where(v < 0.081, v / 4.5, ((np.maximum(v, 0) + 0.099) / 1.099) ** (1 / 0.45))
    assert np.abs(table[1:1015] - curve).max() < 3.5


def test_cine_stamps_beat_the_header_rate(tmp_path):
    stamps = 1_270_000_000 + np.arange(6) * 2.0**-10
    path = write_cine(tmp_path / "film.cine", grey_film(6, 16), bits=16, stamps=stamps, rate=10240)
    with open_frames(path) as film:
        np.testing.assert_array_equal(film.time, np.arange(6) / 1024)
        assert "10240 Hz" in film.warnings[0] and "1024 Hz" in film.warnings[0]
        assert film.meta["recorded_rate_hz"] == 10240.0


def test_cine_without_stamps(tmp_path):
    with open_frames(write_cine(tmp_path / "film.cine", grey_film(4, 8), bits=8, rate=500)) as film:
        np.testing.assert_allclose(film.time, np.arange(4) / 500, rtol=0, atol=1e-15)
        assert "no time stamps" in film.warnings[0] and film.time_source == "file"
    with pytest.raises(FrameError, match="give frame_rate"):
        open_frames(write_cine(tmp_path / "film.cine", grey_film(4, 8), bits=8, rate=0))


def test_cine_truncated_and_damaged_frames_keep_their_times(tmp_path):
    truth = grey_film(6, 16)
    path = write_cine(tmp_path / "film.cine", truth, bits=16, stamps=STAMPS_S, offsets={1: -5, 3: 10**15})
    data = path.read_bytes()
    path.write_bytes(data[:-100])  # and the last frame is cut
    with open_frames(path) as film:
        check_film(film, truth[[0, 2, 4]], (STAMPS_S - STAMPS_S[0])[[0, 2, 4]])
        assert "promises 6 frames, 3 are whole, 3 are lost" in film.warnings[0]
    path.write_bytes(data[:7000])
    with pytest.raises(FrameError, match="no whole frame"):
        open_frames(path)


def test_cine_bad_headers(tmp_path):
    film = grey_film(3, 16)
    for h, message in (
        ({"compression": 2}, "compression 2"),
        ({"cfa": 3}, "colour filter 3"),
        ({"width": 10**6, "height": 10**6}, "damaged header"),
        ({"at_setup": 2**31}, "points to byte"),
        ({"at_offsets": 2**31}, "no whole frame"),
        ({"at_offsets": 0}, "no whole frame"),
    ):
        with pytest.raises(FrameError, match=message):
            open_frames(write_cine(tmp_path / "film.cine", film, bits=16, stamps=STAMPS_S[:3], **h))
    path = write_cine(tmp_path / "film.cine", film, bits=16, rate=100, count=2**32 - 1)
    with open_frames(path) as opened:
        assert len(opened) == 3 and "4294967292 are lost" in opened.warnings[0]


# ---- real cameras ----------------------------------------------------------------------------------------------------


@needs_real
def test_real_phantom_781_decimated():
    """15 frames of bubbles; header 90 000 fps, saved every tenth: 9 000 fps by the stamps (upstream's own test)."""
    with open_frames(Path(REAL) / "cine_pims/cine_781.cine") as film:
        assert (len(film), film.shape, film.dtype) == (15, (256, 256), np.uint16)
        assert 1 / np.diff(film.time).mean() == pytest.approx(9000, rel=1e-3)
        assert film.meta["recorded_rate_hz"] == 90000.0 and "90000 Hz" in film.warnings[0]
        assert film[7].max() < 2**12
        # The needle enters from below: the lowest rows hold dark pixels, the highest ten none.
        assert film[0][-10:].min() < 500 < film[0][:10].min()


@needs_real
def test_real_phantom_legacy():
    with open_frames(Path(REAL) / "cine_pims/cine_legacy.cine", frame_rate=35087.0) as film:
        assert (len(film), film.shape, film.dtype) == (97, (128, 128), np.uint16)
        assert film.warnings == ()  # stamps have 1 us steps; their mean is the header's rate
        assert 1 / np.diff(film.time).mean() == pytest.approx(35087, rel=1e-3)


@needs_real
def test_real_norpix():
    with open_frames(Path(REAL) / "norpix_pims/sample_norpix6.seq") as film:
        assert (len(film), film.shape, film.dtype) == (6, (32, 36), np.uint8)
        np.testing.assert_allclose(film.time, [0, 0.032797, 0.065798, 0.0988, 0.135389, 0.168943], rtol=0, atol=1e-9)
        assert film.time_source == "file"


@needs_real
def test_real_photron_12_bit_packed():
    """A ball falls 2.65 px a frame (known from this recording)."""
    for suffix in (".mraw", ".cihx"):
        with open_frames(Path(REAL) / f"photron_ball_12bit/ball_12bit{suffix}") as film:
            assert (len(film), film.shape, film.dtype) == (15, (384, 384), np.uint16)
            np.testing.assert_allclose(film.time, np.arange(15) / 30000.0, rtol=0, atol=1e-15)
            assert film.meta["exposure_s"] == pytest.approx(20e-6)
            rows = [np.mean(np.nonzero(image[:300] < 1500)[0]) for image in film]
            # a dark-pixel centroid is good to about 0.02 px; its slope over 15 frames to better than 0.01
            assert np.polyfit(np.arange(15), rows, 1)[0] == pytest.approx(2.65, abs=0.02)


@needs_real
def test_real_photron_skip_frame_trap():
    with open_frames(Path(REAL) / "photron_beam/beam.cihx") as film:
        assert (len(film), film.shape, film.dtype) == (4, (80, 1024), np.uint16)
        np.testing.assert_allclose(film.time, np.arange(4) * 2500 / 50000, rtol=0, atol=1e-15)
        assert film[0].max() < 2**12 and "2500th" in film.warnings[0]


# ---- damage ----------------------------------------------------------------------------------------------------------


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


FUZZED = ["film.npy", "stack.tif", "imagej.tif", "film.mraw", "film.cihx", "film.seq", "film.cine", "packed.cine"]
FUZZED += ["film.h5", "image.png", "image.jpg", "image.bmp", "image.pgm"]


@pytest.mark.parametrize("name", FUZZED)
def test_damage_gives_frames_or_a_frame_error(tmp_path, name):
    """300 files with bytes changed, most of them in the headers, some cut short: frames of the stated kind come out, or
    a FrameError; nothing hangs (a good file takes some ms)."""
    path = samples(tmp_path)[name]
    good = np.frombuffer(path.read_bytes(), np.uint8)
    rng = np.random.default_rng(int(hashlib.sha256(name.encode()).hexdigest()[:8], 16))
    read = refused = 0
    for _ in range(300):
        data = good.copy()
        end = len(data) if rng.random() < 0.3 else min(len(data), 1200)
        at = rng.integers(0, end, rng.integers(1, 9))
        data[at] = rng.choice([0, 0xFF, 0x7F, 0x80, 1, int(rng.integers(256))], len(at))
        if rng.random() < 0.2:
            data = data[: rng.integers(1, len(data))]
        path.write_bytes(data.tobytes())
        began = clock.perf_counter()
        try:
            with open_frames(path, frame_rate=100.0) as film:
                assert 1 <= len(film) == len(film.time) and (np.diff(film.time) > 0).all()
                image = film[len(film) - 1]
                assert image.shape == film.shape and image.dtype == film.dtype
            read += 1
        except FrameError as error:
            assert str(tmp_path) in str(error)
            refused += 1
        assert clock.perf_counter() - began < 3
    assert read + refused == 300
    assert refused > 0  # the damage did reach what matters


def test_a_cine_whose_last_time_is_damaged_is_told(tmp_path):
    """It ended at 2.5e7 s, and so did the field that was made of it."""
    stamps = 1_270_000_000 + 2.0**-10 * np.arange(12)
    stamps[-1] += 2.5e7
    path = write_cine(tmp_path / "film.cine", grey_film(12, 8), bits=8, stamps=stamps, rate=1024)
    with open_frames(path) as film:
        assert any("leap by 2.5e+07 s after frame 10" in w and "clock = 'declared'" in w for w in film.warnings)
