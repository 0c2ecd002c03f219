"""Film containers (AVI, MP4, MKV, MOV, WEBM): exact pixels, true times, every frame by number.

FFmpeg writes the films; what they hold is known because the codecs used are lossless where pixels are compared.
"""

from __future__ import annotations

import struct
import tracemalloc
from pathlib import Path

import av
import numpy as np
import pytest

from jumpvision.films.frames import FrameError, open_frames
from jumpvision.films.frames.base import luma
from tests.worlds.film_files import LOSSLESS_H264, check_film, film_of, grey_film, moving, write_film, yuv


def even(n: int, rate: float) -> np.ndarray:
    return np.arange(n) / rate


# ---- pixels ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".mkv", ".avi"])
def test_grey_films_keep_every_bit(tmp_path, suffix):
    options, path = {"level": "3", "g": "5", "slicecrc": "1"}, tmp_path / f"film{suffix}"
    for pixels, bits in (("gray", 8), ("gray10le", 10), ("gray16le", 16)):
        truth = grey_film(20, bits, (34, 50))
        write_film(path, truth, "ffv1", pixels, options=options)
        with open_frames(path, start=0.5) as film:
            check_film(film, truth, 0.5 + even(20, 200))
            assert film.time_source == "file" and film.warnings == () and film.meta["bit_depth"] == bits
    with pytest.raises(FrameError, match="closed"):
        film[12]


def test_a_film_that_changes_is_looked_through_again(tmp_path):
    truth, path, seen = film_of(9, (34, 50)), tmp_path / "film.mkv", []
    for n in (5, 9, 9):
        write_film(path, truth[:n], "ffv1", "gray")
        with open_frames(path) as film:
            check_film(film, truth[:n], even(n, 200))
    with open_frames(path, seen=seen.append) as film:  # whoever wants the frames of the pass gets them
        check_film(film, truth, even(9, 200))
    assert len(seen) == 9


@pytest.mark.parametrize("suffix", [".mp4", ".mkv", ".avi"])
def test_h264_with_reordered_frames(tmp_path, suffix):
    """Luma comes as stored; frames are displayed in another order than stored; AVI has no times of display at all."""
    truth = moving()
    path = write_film(tmp_path / f"film{suffix}", yuv(truth), "libx264", "yuv420p", options=LOSSLESS_H264)
    with open_frames(path) as film:
        check_film(film, truth, even(60, 200))
        assert film.warnings == () and film.meta["codec"] == "h264"


def test_colour_becomes_luma_by_the_documented_rule(tmp_path):
    rgb, mixed = film_of(6, (34, 50, 3)), film_of(6, (34, 52, 2))
    deep = film_of(6, (34, 50, 3), "uint16") % 4096
    for name, images, codec, pixels, truth in (
        ("png.mov", rgb, "png", "rgb24", rgb),
        ("raw.avi", rgb[:, :, :, ::-1], "rawvideo", "bgr24", rgb),
        ("deep.mkv", deep, "ffv1", "gbrp12le", deep),
        ("interleaved.avi", mixed, "rawvideo", "yuyv422", mixed[:, :, :, [0, 0, 0]]),
    ):
        with open_frames(write_film(tmp_path / name, images, codec, pixels)) as film:
            check_film(film, np.stack([luma(*np.moveaxis(c, 2, 0)) for c in truth]), even(6, 200))


def test_bottom_up_and_palette_avi(tmp_path):
    """Uncompressed AVI of Windows software: rows from the bottom, grey through a palette."""
    truth = film_of(6, (34, 52))
    table = np.zeros((256, 4), np.uint8)
    table[:, :3] = np.arange(255, -1, -1)[:, None]  # entry k is grey 255 - k
    table[:, 3] = 255
    path = tmp_path / "film.avi"
    write_avi_dib(path, truth, table)
    with open_frames(path) as film:
        np.testing.assert_array_equal(film[2], 255 - truth[2][::-1])
        check_film(film, 255 - truth[:, ::-1], even(6, 100))


def write_avi_dib(path: Path, film: np.ndarray, table: np.ndarray) -> None:
    """A minimal AVI 1.0 of 8-bit bitmaps, positive height (bottom row first), with a palette (B, G, R, x)."""
    n, height, width = film.shape

    def chunk(name: bytes, data: bytes) -> bytes:
        return name + struct.pack("<I", len(data)) + data + b"\0" * (len(data) % 2)

    palette = table[:, [2, 1, 0, 3]].copy()
    palette[:, 3] = 0
    avih = struct.pack("<14I", 10_000, 0, 0, 0x10, n, 0, 1, height * width, width, height, 0, 0, 0, 0)
    strh = b"vids" + b"DIB " + struct.pack("<IHHIIIIIIIIhhhh", 0, 0, 0, 0, 1, 100, 0, n, 0, 0, 0, 0, 0, width, height)
    strf = struct.pack("<IiiHHIIiiII", 40, width, height, 1, 8, 0, height * width, 0, 0, 256, 0) + palette.tobytes()
    header = chunk(
        b"LIST", b"hdrl" + chunk(b"avih", avih) + chunk(b"LIST", b"strl" + chunk(b"strh", strh) + chunk(b"strf", strf))
    )
    movi = b"movi" + b"".join(chunk(b"00db", image.tobytes()) for image in film)
    size = 8 + height * width
    index = b"".join(b"00db" + struct.pack("<III", 0x10, 4 + k * size, height * width) for k in range(n))
    path.write_bytes(chunk(b"RIFF", b"AVI " + header + chunk(b"LIST", movi) + chunk(b"idx1", index)))


# ---- times -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["film.mkv", "film.mp4"])
def test_stamps_of_variable_rate_and_of_dropped_frames(tmp_path, name):
    truth = moving(30)
    codec = ("libx264", "yuv420p") if name == "film.mp4" else ("ffv1", "gray")
    images, options = (yuv(truth), LOSSLESS_H264) if name == "film.mp4" else (truth, {"g": "7"})
    stamps = np.cumsum(np.random.default_rng(8).integers(1, 60, 30))  # ms
    path = write_film(tmp_path / name, images, *codec, rate=1000, pts=stamps.tolist(), options=options)
    with open_frames(path) as film:
        check_film(film, truth, (stamps - stamps[0]) * 1e-3)
        (told,) = film.warnings
        assert "the time between frames varies, from" in told
    stamps = np.delete(np.arange(33), [7, 8, 20])
    path = write_film(tmp_path / name, images, *codec, rate=100, pts=stamps.tolist(), options=options)
    with open_frames(path, frame_rate=100.0) as film:
        check_film(film, truth, stamps / 100.0)
        (told,) = film.warnings  # and no wrong rate
        assert "3 frames are missing by the time stamps" in told
    with open_frames(path, frame_rate=500.0) as film:
        assert any("500 Hz is declared" in w for w in film.warnings), film.warnings


@pytest.mark.parametrize("rate", [300, 5000])
def test_times_rounded_by_the_container_are_made_exact(tmp_path, rate):
    """MKV rounds stamps to 1 ms: at 300 Hz steps of 3 and 4 ms, at 5000 Hz five frames with one stamp."""
    truth = film_of(60)
    path = write_film(tmp_path / "film.mkv", truth, "ffv1", "gray", rate=rate, options={"g": "6"})
    with open_frames(path) as film:
        check_film(film, truth, even(60, rate))


def atom(data: bytes, name: bytes) -> int:
    """Where the content of a box begins that occurs once in an MP4."""
    assert data.count(name) == 1
    return data.index(name) + 4


def test_edit_list_hides_frames(tmp_path):
    """An edit list that starts the film at its 11th frame, in the middle of a group: players show 50 of 60."""
    truth = moving()
    path = write_film(tmp_path / "film.mp4", yuv(truth), "libx264", "yuv420p", options=LOSSLESS_H264)
    data = bytearray(path.read_bytes())
    at = atom(data, b"elst") + 8
    ticks = 12800 // 200  # a frame in the media's time scale, asserted here
    assert struct.unpack_from(">I", data, atom(data, b"mdhd") + 12)[0] == 12800
    length, begin = struct.unpack_from(">Ii", data, at)
    struct.pack_into(">Ii", data, at, length * 50 // 60, begin + 10 * ticks)
    path.write_bytes(data)
    with open_frames(path, start=3.0) as film:
        check_film(film, truth[10:], 3.0 + even(50, 200))
        (told,) = film.warnings
        assert "10 frames that the file's edit list hides are left out" in told


def test_turned_film_is_reported(tmp_path):
    truth = moving(12)
    path = write_film(tmp_path / "film.mp4", yuv(truth), "libx264", "yuv420p", options=LOSSLESS_H264)
    data = bytearray(path.read_bytes())
    struct.pack_into(">9i", data, atom(data, b"tkhd") + 40, 0, 1 << 16, 0, -(1 << 16), 0, 0, 0, 0, 1 << 30)
    path.write_bytes(data)
    with open_frames(path) as film:
        np.testing.assert_array_equal(film[5], truth[5])
        assert "90 degrees" in film.warnings[0]


# ---- damage ----------------------------------------------------------------------------------------------------------


def packets(path: Path) -> list[tuple[int, int]]:
    """(place, size) of the packets in a film's file."""
    with av.open(str(path)) as container:
        return [(p.pos, p.size) for p in container.demux(container.streams.video[0]) if p.size]


@pytest.mark.parametrize("name", ["film.avi", "film.mkv", "film.mp4"])
def test_truncated_films_give_every_whole_frame(tmp_path, name):
    truth = moving(30)
    how = {"images": truth, "codec": "ffv1", "pixels": "gray", "options": {"g": "1"}}
    if name == "film.mp4":  # the table before the frames
        how = {"images": yuv(truth), "codec": "libx264", "pixels": "yuv420p", "mux": {"movflags": "faststart"}}
        how["options"] = LOSSLESS_H264 | {"g": "1", "bf": "0"}
    path = write_film(tmp_path / name, **how)
    place, size = packets(path)[18]
    path.write_bytes(path.read_bytes()[: place + size // 2])  # in the middle of frame 18
    with open_frames(path) as film:
        check_film(film, truth[:18], even(18, 200))
        lost = sum(int(w.split(f"{name}: ")[1].removeprefix("truncated; ").split()[0]) for w in film.warnings)
        assert lost == 12, film.warnings


def test_one_damaged_frame_shifts_nothing(tmp_path):
    truth = film_of(20)
    options = {"level": "3", "g": "1", "slicecrc": "1"}
    for suffix in (".mkv", ".avi"):
        path = write_film(tmp_path / f"film{suffix}", truth, "ffv1", "gray", options=options)
        data = bytearray(path.read_bytes())
        place, size = packets(path)[7]
        for k in range(20):
            data[place + size // 2 + k] ^= 0x55
        path.write_bytes(data)
        with open_frames(path) as film:
            check_film(film, np.delete(truth, 7, axis=0), np.delete(even(20, 200), 7))
            assert "1 frames are damaged" in film.warnings[0]


@pytest.mark.parametrize("suffix", [".mp4", ".avi"])
def test_damage_in_a_predicted_film_ends_with_its_group(tmp_path, suffix):
    """Groups of 12 frames; a frame of the third group is destroyed: nothing before or after that group changes, and of
    that group only true pictures are given."""
    truth = moving()
    path = write_film(tmp_path / f"film{suffix}", yuv(truth), "libx264", "yuv420p", options=LOSSLESS_H264)
    data = bytearray(path.read_bytes())
    place, size = packets(path)[30]
    data[place + 8 : place + size] = np.random.default_rng(1).bytes(size - 8)
    path.write_bytes(data)
    with open_frames(path) as film:
        slots = np.rint(film.time * 200).astype(int)
        np.testing.assert_allclose(film.time, slots / 200.0, rtol=0, atol=1e-12)
        assert {*range(24), *range(36, 60)} <= set(slots.tolist()) and len(slots) < 60
        check_film(film, truth[slots], film.time)
        assert f"{60 - len(slots)} frames are damaged" in film.warnings[0]


def test_sound_alone_and_a_film_without_its_table_are_refused(tmp_path):
    path = tmp_path / "film.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=8000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), format="s16", layout="mono")
        frame.sample_rate = 8000
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    with pytest.raises(FrameError, match="no video"):
        open_frames(path)
    path = write_film(tmp_path / "film.mp4", yuv(moving(12)), "libx264", "yuv420p", options=LOSSLESS_H264)
    path.write_bytes(path.read_bytes()[:-900])  # the table stands at the end
    with pytest.raises(FrameError, match="its header is lost"):
        open_frames(path)


# ---- use -------------------------------------------------------------------------------------------------------------


def test_streaming_keeps_memory_flat(tmp_path):
    truth = film_of(1, (240, 320))[0]
    path = write_film(tmp_path / "film.avi", [truth] * 200, "rawvideo", "gray")
    tracemalloc.start()
    with open_frames(path) as film:
        for image in film:
            assert image.shape == (240, 320)
        peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20 * truth.nbytes  # 8 kept images, a few in flight, the index; the film has 200
