"""Film containers (AVI, MP4, MKV, MOV, WEBM): exact pixels, true times, every frame by number. (About 12 s.)

FFmpeg writes the films; what they hold is known because the codecs used are lossless where pixels are compared.
"""

from __future__ import annotations

import struct
import subprocess
import sys
import time as clock
import tracemalloc
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from test_frames import check_film, film_of

from jumpvision.films.frames import FrameError, open_frames, scan
from jumpvision.films.frames.base import luma
from jumpvision.films.frames.scan import spoiled

LOSSLESS_H264 = {"qp": "0", "g": "12", "bf": "3", "preset": "veryfast", "x264-params": "threads=1:scenecut=0"}


FAST = {"film.mp4": {"movflags": "faststart"}}  # the table before the frames


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


def even(n: int, rate: float) -> np.ndarray:
    return np.arange(n) / rate


# ---- pixels ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".mkv", ".avi"])
@pytest.mark.parametrize(("pixels", "bits"), [("gray", 8), ("gray10le", 10), ("gray12le", 12), ("gray16le", 16)])
def test_grey_films_keep_every_bit(tmp_path, suffix, pixels, bits):
    rng = np.random.default_rng(bits)
    truth = rng.integers(0, 2**bits, (20, 34, 50)).astype(np.uint8 if bits == 8 else np.uint16)
    options = {"level": "3", "g": "5", "slicecrc": "1"}
    path = write_film(tmp_path / f"film{suffix}", truth, "ffv1", pixels, options=options)
    with open_frames(path, start=0.5) as film:
        check_film(film, truth, 0.5 + even(20, 200))
        assert film.time_source == "file" and film.warnings == () and film.meta["bit_depth"] == bits


def test_a_film_is_looked_through_once_until_it_changes(tmp_path, monkeypatch):
    rng = np.random.default_rng(3)
    truth = rng.integers(0, 256, (9, 34, 50)).astype(np.uint8)
    path, passes = write_film(tmp_path / "film.mkv", truth[:5], "ffv1", "gray"), []
    whole = scan._scanned
    monkeypatch.setattr(scan, "_scanned", lambda *a: (passes.append(1), whole(*a))[1])
    for _ in range(3):
        with open_frames(path) as film:
            check_film(film, truth[:5], even(5, 200))
    assert len(passes) == 1
    write_film(path, truth, "ffv1", "gray")
    seen = []
    with open_frames(path, seen=seen.append) as film:  # whoever wants the frames of the pass gets them
        check_film(film, truth, even(9, 200))
    with open_frames(path, seen=seen.append) as film:
        check_film(film, truth, even(9, 200))
    assert len(passes) == 3 and len(seen) == 18


def test_raw_grey(tmp_path):
    truth = film_of(20)
    with open_frames(write_film(tmp_path / "film.avi", truth, "rawvideo", "gray")) as film:
        check_film(film, truth, even(20, 200))


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv", ".avi"])
def test_h264_with_reordered_frames(tmp_path, suffix):
    """Luma comes as stored; frames are displayed in another order than stored; AVI has no times of display at all."""
    truth = moving()
    path = write_film(tmp_path / f"film{suffix}", yuv(truth), "libx264", "yuv420p", options=LOSSLESS_H264)
    with open_frames(path) as film:
        check_film(film, truth, even(60, 200))
        assert film.warnings == () and film.meta["codec"] == "h264"


def test_colour_becomes_luma_by_the_documented_rule(tmp_path):
    rgb = film_of(6, (34, 50, 3))
    deep = film_of(6, (34, 50, 3), "uint16") % 4096
    write_film(tmp_path / "png.mov", rgb, "png", "rgb24")
    write_film(tmp_path / "raw.avi", rgb[:, :, :, ::-1], "rawvideo", "bgr24")
    write_film(tmp_path / "deep.mkv", deep, "ffv1", "gbrp12le")
    for name, colour in (("png.mov", rgb), ("raw.avi", rgb), ("deep.mkv", deep)):
        with open_frames(tmp_path / name) as film:
            check_film(film, np.stack([luma(*np.moveaxis(c, 2, 0)) for c in colour]), even(6, 200))


def test_interleaved_luma(tmp_path):
    values = film_of(4, (34, 52, 2))
    with open_frames(write_film(tmp_path / "film.avi", values, "rawvideo", "yuyv422")) as film:
        check_film(film, values[:, :, :, 0], even(4, 200))


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


def test_variable_frame_rate(tmp_path):
    truth = moving(40)
    rng = np.random.default_rng(8)
    stamps = np.cumsum(rng.integers(1, 60, 40))  # ms
    for name, codec, pixels, images, options in (
        ("film.mkv", "ffv1", "gray", truth, {"g": "7"}),
        ("film.mp4", "libx264", "yuv420p", yuv(truth), LOSSLESS_H264),
    ):
        path = write_film(tmp_path / name, images, codec, pixels, rate=1000, pts=stamps.tolist(), options=options)
        with open_frames(path) as film:
            check_film(film, truth, (stamps - stamps[0]) * 1e-3)
            (told,) = film.warnings
            assert "the time between frames varies, from" in told


@pytest.mark.parametrize("rate", [300, 700, 5000])
def test_times_rounded_by_the_container_are_made_exact(tmp_path, rate):
    """MKV rounds stamps to 1 ms: at 300 Hz steps of 3 and 4 ms, at 5000 Hz five frames with one stamp."""
    truth = film_of(60)
    path = write_film(tmp_path / "film.mkv", truth, "ffv1", "gray", rate=rate, options={"g": "6"})
    with open_frames(path) as film:
        check_film(film, truth, even(60, rate))


def test_dropped_frames_leave_gaps_in_time(tmp_path):
    truth = moving(30)
    stamps = np.delete(np.arange(33), [7, 8, 20])
    for name, codec, pixels, images, options in (
        ("film.mkv", "ffv1", "gray", truth, {}),
        ("film.mp4", "libx264", "yuv420p", yuv(truth), LOSSLESS_H264),
        ("film.avi", "ffv1", "gray", truth, {}),
    ):
        path = write_film(tmp_path / name, images, codec, pixels, rate=100, pts=stamps.tolist(), options=options)
        with open_frames(path, frame_rate=100.0) as film:
            check_film(film, truth, stamps / 100.0)
            assert [w.partition(": ")[2].partition(",")[0] for w in film.warnings] == [
                "3 frames are missing by the time stamps"  # and no wrong rate
            ]


def test_rate_mismatch_names_both(tmp_path):
    path = write_film(tmp_path / "film.mp4", yuv(moving(12)), "libx264", "yuv420p", rate=30)
    with open_frames(path, frame_rate=500.0) as film:
        assert "500 Hz" in film.warnings[0] and "30 Hz" in film.warnings[0]
        assert film.time[1] == pytest.approx(1 / 30, abs=1e-12)


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


def test_truncated_films_give_every_whole_frame(tmp_path):
    truth = moving(30)
    for name, codec, pixels, options in (
        ("film.avi", "ffv1", "gray", {"g": "1"}),
        ("film.mkv", "ffv1", "gray", {"g": "1"}),
        ("film.mp4", "libx264", "yuv420p", LOSSLESS_H264 | {"g": "1", "bf": "0"}),
    ):
        images = truth if pixels == "gray" else yuv(truth)
        path = write_film(tmp_path / name, images, codec, pixels, options=options, mux=FAST.get(name))
        place, size = packets(path)[18]
        path.write_bytes(path.read_bytes()[: place + size // 2])  # in the middle of frame 18
        with open_frames(path) as film:
            check_film(film, truth[:18], even(18, 200))
            lost = sum(int(w.split(f"{name}: ")[1].removeprefix("truncated; ").split()[0]) for w in film.warnings)
            assert lost == 12, film.warnings


def test_mp4_without_its_table_is_refused(tmp_path):
    path = write_film(tmp_path / "film.mp4", yuv(moving()), "libx264", "yuv420p", options=LOSSLESS_H264)
    path.write_bytes(path.read_bytes()[:-2000])  # the table stands at the end
    with pytest.raises(FrameError, match="its header is lost"):
        open_frames(path)


@pytest.mark.parametrize("suffix", [".mkv", ".avi"])
def test_one_damaged_frame_shifts_nothing(tmp_path, suffix):
    truth = film_of(20)
    options = {"level": "3", "g": "1", "slicecrc": "1"}
    path = write_film(tmp_path / f"film{suffix}", truth, "ffv1", "gray", options=options)
    data = bytearray(path.read_bytes())
    place, size = packets(path)[7]
    for k in range(20):
        data[place + size // 2 + k] ^= 0x55
    path.write_bytes(data)
    with open_frames(path) as film:
        check_film(film, np.delete(truth, 7, axis=0), np.delete(even(20, 200), 7))
        assert "1 frames are damaged" in film.warnings[0]


@pytest.mark.parametrize("suffix", [".mp4", ".mkv", ".avi"])
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


def test_spoiled_packets():
    key = [True, False, False, False, True, False, False, True, False]
    pts = [0, 3, 1, 2, 6, 4, 5, 7, 8]  # the second group's 4 and 5 lean on both groups
    assert spoiled(pts, key, set()) == set()
    assert spoiled(pts, key, {2}) == {2, 3, 5, 6}
    assert spoiled(pts, key, {4}) == {4, 5, 6}
    assert spoiled(pts, key, {8}) == {8}


def test_sound_alone_is_no_film(tmp_path):
    path = tmp_path / "film.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=8000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), format="s16", layout="mono")
        frame.sample_rate = 8000
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    with pytest.raises(FrameError, match="no video"):
        open_frames(path)


@pytest.mark.parametrize("suffix", [".avi", ".mkv", ".mp4"])
def test_damage_gives_frames_or_a_frame_error(tmp_path, suffix):
    """300 films with bytes changed anywhere, some cut short. Run apart: a crash of the decoder would be seen."""
    codec, pixels = ("libx264", "yuv420p") if suffix == ".mp4" else ("ffv1", "gray")
    images = yuv(moving(12, (32, 48))) if suffix == ".mp4" else film_of(8)
    path = write_film(tmp_path / f"film{suffix}", images, codec, pixels, options={"g": "4"})
    code = f"""
import time, numpy as np
from jumpvision.films.frames import FrameError, open_frames
good = np.fromfile({str(path)!r}, np.uint8)
rng = np.random.default_rng(4)
read = refused = 0
slowest = 0.0
for _ in range(300):
    data = good.copy()
    end = len(data) if rng.random() < 0.6 else min(len(data), 2000)
    at = rng.integers(0, end, rng.integers(1, 12))
    data[at] = rng.choice([0, 255, 127, 128, 1, int(rng.integers(256))], len(at))
    if rng.random() < 0.2:
        data = data[: rng.integers(1, len(data))]
    data.tofile({str(path)!r})
    began = time.perf_counter()
    try:
        with open_frames({str(path)!r}) as film:
            assert 1 <= len(film) and (np.diff(film.time) > 0).all()
            for image in film:
                assert image.shape == film.shape and image.dtype == film.dtype
            film[0]
        read += 1
    except FrameError:
        refused += 1
    slowest = max(slowest, time.perf_counter() - began)
print(read, refused, slowest)
"""
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert out.returncode == 0, out.stderr[-2000:]
    read, refused, slowest = (float(k) for k in out.stdout.split())
    assert read > 0 and refused > 0 and slowest < 5.0  # a good one takes 0.02 s


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


def test_seeking_back_does_not_decode_from_the_start(tmp_path):
    """Random access decodes at most a group: 400 frames read backwards cost no more than ten passes forward."""
    truth = moving(400, (96, 128))
    options = LOSSLESS_H264 | {"g": "20"}
    path = write_film(tmp_path / "film.mp4", yuv(truth), "libx264", "yuv420p", options=options)
    with open_frames(path) as film:
        began = clock.perf_counter()
        assert sum(1 for _ in film) == 400
        forward = clock.perf_counter() - began
        began = clock.perf_counter()
        for i in range(399, -1, -20):
            np.testing.assert_array_equal(film[i], truth[i])
        assert clock.perf_counter() - began < 10 * forward


def test_closed_film_says_so(tmp_path):
    with open_frames(write_film(tmp_path / "film.avi", film_of(20), "rawvideo", "gray")) as film:
        pass
    with pytest.raises(FrameError, match="closed"):
        film[12]
