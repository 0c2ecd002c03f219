"""Film readers: the door, the clock, arrays, image sequences and TIFF."""

from __future__ import annotations

import struct
import sys
import zlib
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
import tifffile

from jumpvision.films.frames import FrameError, open_frames
from jumpvision.films.frames.base import clock, luma
from jumpvision.films.frames.opening import READERS
from tests.worlds.film_files import check_film, film_of

ABSURD = [(10**9, 1000, 1000), (-1, 20, 30), (2**62, 64, 64)]


def grey_of(colour: np.ndarray) -> np.ndarray:
    return np.stack([luma(*np.moveaxis(c, 2, 0)) for c in colour])


@pytest.mark.parametrize("suffix", sorted(READERS))
def test_every_registered_reader_refuses_bad_files(suffix, tmp_path):
    for label, data in (("missing", None), ("empty", b""), ("noise", np.random.default_rng(3).bytes(5000))):
        path = tmp_path / f"{label}{suffix}"
        if data is not None:
            path.write_bytes(data)
        with pytest.raises(FrameError) as caught:
            open_frames(path, frame_rate=100.0)
        assert str(path.with_suffix("")) in str(caught.value)
        assert ";" in str(caught.value)  # every message ends in a remedy


def test_wrong_calls(tmp_path):
    (tmp_path / "film.xyz").write_bytes(b"abc")
    for file, keys, said in (
        ("film.xyz", {}, r"unknown film format '\.xyz'; allowed: .*\.avi .*\.tif"),
        ("film.xyz", {"frame_rate": -1.0}, "frame_rate"),
        ("film.xyz", {"frame_rate": float("nan")}, "frame_rate"),
        ("film.xyz", {"start": float("nan")}, "start"),
        ("*.png", {"frame_rate": 1.0}, "no image here"),
        (".", {"frame_rate": 1.0}, "no image here"),
    ):
        with pytest.raises(FrameError, match=said):
            open_frames(tmp_path / file, **keys)


# ---- the clock -------------------------------------------------------------------------------------------------------


def test_the_clock_of_a_film():
    """The file's stamps win, and the warning names both rates; without stamps the declared rate counts from start."""
    path, stamps = Path("film"), np.arange(50) / 200.0
    time, source, warnings = clock(path, 50, start=0.5, frame_rate=200.1, stamps=stamps)  # 0.05 %: agrees
    np.testing.assert_array_equal(time, 0.5 + stamps)
    assert (source, warnings) == ("file", [])
    time, source, warnings = clock(path, 50, start=0.0, frame_rate=500.0, stamps=stamps)
    assert source == "file" and len(warnings) == 1 and "500 Hz" in warnings[0] and "200 Hz" in warnings[0]
    np.testing.assert_array_equal(time, stamps)
    with pytest.raises(FrameError, match="no time stamps of its own; give frame_rate"):
        clock(path, 3, start=0.0, frame_rate=None)
    time, source, _ = clock(path, 3, start=1.0, frame_rate=4.0)
    assert time.tolist() == [1.0, 1.25, 1.5] and source == "declared"
    assert clock(path, 1, start=1.0, frame_rate=None).time.tolist() == [1.0]  # one image needs no rate
    stands = np.array([0.0, 0.1, 0.1, 0.2])
    with pytest.raises(FrameError, match=r"do not increase at frame 2; give frame_rate"):
        clock(path, 4, start=0.0, frame_rate=None, stamps=stands)
    time, source, warnings = clock(path, 4, start=0.0, frame_rate=10.0, stamps=stands)
    np.testing.assert_allclose(time, [0, 0.1, 0.2, 0.3], rtol=0, atol=1e-15)
    assert source == "declared" and "frame 2" in warnings[0]


def test_luma_is_exact_for_grey_and_rec601_for_colour():
    grey = np.arange(65536, dtype=np.uint16).reshape(256, 256)
    np.testing.assert_array_equal(luma(grey, grey, grey), grey)
    one, none = np.array([[1000]], np.uint16), np.zeros((1, 1), np.uint16)
    assert [int(luma(*c)[0, 0]) for c in ((one, none, none), (none, one, none), (none, none, one))] == [299, 587, 114]


# ---- round trips -----------------------------------------------------------------------------------------------------


def write_images(folder: Path, truth: np.ndarray, suffix: str, numbers=None) -> Path:
    folder.mkdir(exist_ok=True)
    for k, image in zip(numbers if numbers is not None else range(len(truth)), truth):
        assert cv2.imwrite(str(folder / f"img{k}{suffix}"), image)
    return folder


def images(suffix):
    def write(folder, truth):
        (write_images(folder / "film", truth, suffix) / "notes.txt").write_text("not an image")
        return folder / "film"

    return write


def tiff(**how):
    def write(folder, truth):
        tifffile.imwrite(folder / "film.tif", truth, **({"photometric": "minisblack"} | how))
        return folder / "film.tif"

    return write


def tiff_pages(folder, truth):
    with tifffile.TiffWriter(folder / "film.tif") as file:
        for image in truth:
            file.write(image, contiguous=False, metadata=None)
    return folder / "film.tif"


def tiff_lzw(folder, truth):
    """What OpenCV and many cameras write, and tifffile alone cannot decode."""
    assert cv2.imwritemulti(str(folder / "film.tif"), list(truth), [cv2.IMWRITE_TIFF_COMPRESSION, 5])
    return folder / "film.tif"


def tiff_imagej_single_directory(folder, truth):
    """ImageJ writes stacks above 4 GB with one directory; cut the chain of a small one to get the same."""
    tifffile.imwrite(folder / "film.tif", truth, imagej=True)
    data = bytearray((folder / "film.tif").read_bytes())
    first = struct.unpack_from("<I", data, 4)[0]
    entries = struct.unpack_from("<H", data, first)[0]
    struct.pack_into("<I", data, first + 2 + 12 * entries, 0)
    (folder / "film.tif").write_bytes(data)
    return folder / "film.tif"


def npy(change):
    def write(folder, truth):
        np.save(folder / "film.npy", change(truth))
        return folder / "film.npy"

    return write


def hdf5(folder, truth):
    with h5py.File(folder / "film.h5", "w") as file:
        file.create_dataset("a/frames", data=truth, chunks=(1, 24, 40), compression="gzip")
        file["times"] = np.arange(len(truth))  # other data sets do not disturb
    return folder / "film.h5"


U8, U16, F32 = "uint8", "uint16", "float32"
WRITERS = {
    "npy": (npy(np.asarray), U8, F32),
    "npy turned": (npy(np.asfortranarray), U16),
    "npy big-endian": (npy(lambda a: a.astype(a.dtype.newbyteorder(">"))), U16, F32),
    "hdf5": (hdf5, U8, F32),
    "png": (images(".png"), U8, U16),
    "bmp": (images(".bmp"), U8),
    "pgm": (images(".pgm"), U8),
    "tif images": (images(".tif"), U16, F32),
    "tif": (tiff(), U8, U16, F32),
    "tif zlib": (tiff(compression="zlib"), U16),
    "tif ImageJ": (tiff(imagej=True), U16),
    "tif big-endian": (tiff(byteorder=">"), U16),
    "tif big": (tiff(bigtiff=True), F32),
    "tif bare": (tiff(metadata=None), U8),
    "tif pages": (tiff_pages, U8),
    "tif lzw": (tiff_lzw, U8, U16, F32),
    "tif ImageJ single": (tiff_imagej_single_directory, U16),
}


@pytest.mark.parametrize("name", WRITERS)
def test_films_read_back(tmp_path, name):
    write, *kinds = WRITERS[name]
    for dtype in kinds:
        truth = film_of(12, dtype=dtype)  # img2 before img10: natural order
        path = write(tmp_path, truth)
        with open_frames(path, frame_rate=50.0, start=1.0) as film:
            check_film(film, truth, 1.0 + np.arange(12) / 50.0)
            assert film.time_source == "declared" and len(film.warnings) == (name == "hdf5")  # which axis is y
            if "tif" in name:
                assert film.meta["bit_depth"] == truth.dtype.itemsize * 8
        with pytest.raises(FrameError, match="give frame_rate"):
            open_frames(path)


def test_one_image_a_pattern_and_a_root(tmp_path):
    truth = film_of(12)
    write_images(tmp_path / "film", truth, ".png")
    with open_frames(tmp_path / "film" / "img3.png") as film:
        check_film(film, truth[3:4], np.zeros(1))
    with open_frames("film/img*.png", frame_rate=10.0, pattern_root=tmp_path) as film:
        assert len(film) == 12
    np.save(tmp_path / "one.npy", truth[0])
    with open_frames(tmp_path / "one.npy") as film:
        check_film(film, truth[:1], np.zeros(1))
    deep = film_of(1, dtype="uint16")[0] % 4096
    (tmp_path / "a.pgm").write_bytes(b"P5\n# camera\n40 24\n4095\n" + deep.astype(">u2").tobytes())
    with open_frames(tmp_path / "a.pgm") as film:
        np.testing.assert_array_equal(film[0], deep)


def test_colour_becomes_luma_and_other_channels_are_refused(tmp_path):
    rgb = film_of(3, (24, 40, 3))
    np.save(tmp_path / "film.npy", rgb)
    cv2.imwrite(str(tmp_path / "a.png"), film_of(1, (24, 40, 3), "uint16")[0][:, :, ::-1])
    cv2.imwrite(str(tmp_path / "lzw.tif"), rgb[0][:, :, ::-1], [cv2.IMWRITE_TIFF_COMPRESSION, 5])
    tifffile.imwrite(tmp_path / "rgb.tif", rgb, photometric="rgb")
    tifffile.imwrite(tmp_path / "planes.tif", np.moveaxis(rgb, 3, 1), photometric="rgb", planarconfig="separate")
    for name, truth in (
        ("film.npy", rgb), ("rgb.tif", rgb), ("planes.tif", rgb), ("lzw.tif", rgb[:1]),
        ("a.png", film_of(1, (24, 40, 3), "uint16")),
    ):  # fmt: skip
        with open_frames(tmp_path / name, frame_rate=1.0) as film:
            check_film(film, grey_of(truth), np.arange(float(len(truth))))
    for channels in (2, 5):
        extra = film_of(3, (24, 40, channels))
        np.save(tmp_path / "bad.npy", extra)
        tifffile.imwrite(tmp_path / "bad.tif", extra, photometric="minisblack", planarconfig="contig", metadata=None)
        for name, said in (("bad.npy", r"shape .* allowed"), ("bad.tif", f"{channels} channels; allowed")):
            with pytest.raises(FrameError, match=said):
                open_frames(tmp_path / name, frame_rate=1.0)


# ---- damage ----------------------------------------------------------------------------------------------------------


def test_what_an_array_may_not_be(tmp_path):
    for array in (np.zeros((3, 4, 5), "int16"), np.zeros((3, 4, 5), "complex64"), np.array([print, {}], dtype=object)):
        np.save(tmp_path / "film.npy", array, allow_pickle=True)
        with pytest.raises(FrameError, match=r"allowed: uint8, uint16, float|plain numbers"):
            open_frames(tmp_path / "film.npy", frame_rate=1.0)
    for shape in ABSURD:
        header = f"{{'descr': '|u1', 'fortran_order': False, 'shape': {shape}, }}".ljust(117).encode() + b"\n"
        (tmp_path / "film.npy").write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + bytes(500))
        with pytest.raises(FrameError):
            open_frames(tmp_path / "film.npy", frame_rate=1.0)


def test_npy_truncated(tmp_path):
    truth = film_of(6, dtype="uint16")
    np.save(tmp_path / "film.npy", truth)
    data = (tmp_path / "film.npy").read_bytes()
    (tmp_path / "film.npy").write_bytes(data[: -int(2.5 * 24 * 40 * 2)])
    with open_frames(tmp_path / "film.npy", frame_rate=10.0) as film:
        check_film(film, truth[:3], np.arange(3) / 10.0)
        assert "promises 6 frames, 3 are whole, 3 are lost" in film.warnings[0]
    (tmp_path / "film.npy").write_bytes(data[:200])
    with pytest.raises(FrameError, match="no whole frame"):
        open_frames(tmp_path / "film.npy", frame_rate=10.0)


def test_hdf5_problems(tmp_path, monkeypatch):
    path = tmp_path / "film.h5"

    def refused(said):
        with pytest.raises(FrameError, match=said):
            open_frames(path, frame_rate=1.0)

    with h5py.File(path, "w") as file:
        file["a"], file["b"] = film_of(), film_of()
    refused(r"exactly one data set .* /a .*/b")
    with h5py.File(path, "w") as file:
        file.create_dataset("a", (10**9, 1000, 1000), "u2", chunks=(1, 1000, 1000))
    refused("does not hold")
    with h5py.File(path, "w") as file:
        file["a"] = film_of()
    path.write_bytes(path.read_bytes()[:-1000])
    refused("truncated")
    monkeypatch.setitem(sys.modules, "h5py", None)
    refused(r"needs h5py; install it with: pip install 'jumpvision\[hdf5\]'")


def test_missing_images_leave_gaps_in_time(tmp_path):
    truth = film_of(6)
    write_images(tmp_path / "gap", truth, ".png", numbers=[10, 12, 14, 18, 20, 24])
    with open_frames(tmp_path / "gap", frame_rate=100.0) as film:
        check_film(film, truth, np.array([0, 1, 2, 4, 5, 7]) / 100.0)
        assert "2 images are missing" in film.warnings[0] and "img14.png" in film.warnings[0]
    write_images(tmp_path / "every", truth, ".png", numbers=range(0, 60, 10))  # every tenth saved: one frame a step
    with open_frames(tmp_path / "every", frame_rate=100.0) as film:
        np.testing.assert_allclose(film.time, np.arange(6) / 100.0, rtol=0, atol=1e-15)
        assert film.warnings == ()


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".tif", ".pgm"])
def test_torn_image_is_named(tmp_path, suffix):
    y, x = np.mgrid[:120, :160]
    smooth = np.stack([(120 + 80 * np.sin(x / 9 + k) * np.cos(y / 13)).astype(np.uint8) for k in range(4)])
    write_images(tmp_path, smooth, suffix)
    torn = tmp_path / f"img2{suffix}"
    data = torn.read_bytes()
    for share in (0.0, 0.02, 0.99):
        torn.write_bytes(data[: int(share * len(data))])
        with pytest.raises(FrameError, match=rf"img2\{suffix}"), open_frames(tmp_path, frame_rate=1.0) as film:
            list(film)


def test_absurd_png_header(tmp_path):
    chunk = b"IHDR" + struct.pack(">IIBBBBB", 60_000, 60_000, 8, 0, 0, 0, 0)
    data = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk))
    write_images(tmp_path, film_of(1), ".png")
    (tmp_path / "img1.png").write_bytes(data + bytes(200) + b"\0\0\0\0IEND\xaeB`\x82")
    with pytest.raises(FrameError, match=r"img1\.png: 60000 x 60000 pixels in"):
        open_frames(tmp_path, frame_rate=1.0)


def test_tiff_truncated_keeps_every_whole_page(tmp_path):
    truth = film_of(8, dtype="uint16")
    for write in (tiff(), tiff(imagej=True), tiff_pages):
        path = write(tmp_path, truth)
        with tifffile.TiffFile(path) as file:
            ends = [p.dataoffsets[-1] + p.databytecounts[-1] for p in file.pages]
        path.write_bytes(path.read_bytes()[: ends[4] + 10])  # pages 0-4 are whole
        with open_frames(path, frame_rate=1.0) as film:
            check_film(film, truth[:5], np.arange(5.0))
            if write is not tiff_pages:  # the description knows how many there were
                assert "promises 8 frames, 5 are whole, 3 are lost" in film.warnings[0]
