"""Film readers: the door, the clock, arrays, image sequences and TIFF. (About 2 s.)"""

from __future__ import annotations

import importlib
import struct
import subprocess
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


# ---- the door --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", sorted(READERS))
def test_every_registered_reader_refuses_bad_files(suffix, tmp_path):
    module, name = READERS[suffix]
    assert hasattr(importlib.import_module(f"jumpvision.films.frames.{module}"), name)
    rng = np.random.default_rng(3)
    for label, data in (("missing", None), ("empty", b""), ("text", b"hello\n"), ("noise", rng.bytes(5000))):
        path = tmp_path / f"{label}{suffix}"
        if data is not None:
            path.write_bytes(data)
        with pytest.raises(FrameError) as caught:
            open_frames(path, frame_rate=100.0)
        assert str(path.with_suffix("")) in str(caught.value)
        assert ";" in str(caught.value)  # every message ends in a remedy


def test_wrong_calls(tmp_path):
    (tmp_path / "film.xyz").write_bytes(b"abc")
    with pytest.raises(FrameError, match=r"unknown film format '\.xyz'; allowed: .*\.avi .*\.tif"):
        open_frames(tmp_path / "film.xyz")
    for rate in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(FrameError, match="frame_rate"):
            open_frames(tmp_path / "film.xyz", frame_rate=rate)
    with pytest.raises(FrameError, match="start"):
        open_frames(tmp_path / "film.xyz", start=float("nan"))
    with pytest.raises(FrameError, match="no image here"):
        open_frames(tmp_path / "*.png", frame_rate=1.0)
    with pytest.raises(FrameError, match="no image here"):
        open_frames(tmp_path, frame_rate=1.0)


def test_opening_imports_no_decoder():
    """The heavy libraries come only with the first film that needs them."""
    code = (
        "import sys, jumpvision.films.frames; print([m for m in ('av', 'cv2', 'h5py', 'tifffile') if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "[]"


def test_pattern_root(tmp_path, monkeypatch):
    np.save(tmp_path / "film.npy", film_of())
    monkeypatch.chdir("/")
    with open_frames("film.npy", frame_rate=10.0, pattern_root=tmp_path) as film:
        assert len(film) == 6


# ---- the clock -------------------------------------------------------------------------------------------------------


def test_clock_file_wins_and_the_warning_names_both_rates():
    stamps = np.arange(50) / 200.0
    path = Path("film")
    time, source, warnings = clock(path, 50, start=0.5, frame_rate=200.1, stamps=stamps)  # 0.05 %: agrees
    np.testing.assert_array_equal(time, 0.5 + stamps)
    assert (source, warnings) == ("file", [])
    time, source, warnings = clock(path, 50, start=0.0, frame_rate=500.0, stamps=stamps)
    assert source == "file" and len(warnings) == 1
    assert "500 Hz" in warnings[0] and "200 Hz" in warnings[0]
    np.testing.assert_array_equal(time, stamps)


def test_clock_without_stamps():
    with pytest.raises(FrameError, match="no time stamps of its own; give frame_rate"):
        clock(Path("film"), 3, start=0.0, frame_rate=None)
    time, source, _ = clock(Path("film"), 3, start=1.0, frame_rate=4.0)
    np.testing.assert_array_equal(time, [1.0, 1.25, 1.5])
    assert source == "declared"
    assert clock(Path("film"), 1, start=1.0, frame_rate=None).time.tolist() == [1.0]  # one image needs no rate


def test_clock_refuses_stamps_that_do_not_increase():
    stamps = np.array([0.0, 0.1, 0.1, 0.2])
    with pytest.raises(FrameError, match=r"do not increase at frame 2; give frame_rate"):
        clock(Path("film"), 4, start=0.0, frame_rate=None, stamps=stamps)
    time, source, warnings = clock(Path("film"), 4, start=0.0, frame_rate=10.0, stamps=stamps)
    np.testing.assert_allclose(time, [0, 0.1, 0.2, 0.3], rtol=0, atol=1e-15)
    assert source == "declared" and "frame 2" in warnings[0]


def test_luma_is_exact_for_grey_and_rec601_for_colour():
    grey = np.arange(65536, dtype=np.uint16).reshape(256, 256)
    np.testing.assert_array_equal(luma(grey, grey, grey), grey)
    one = np.array([[1000]], np.uint16)
    none = np.zeros((1, 1), np.uint16)
    assert [int(luma(*c)[0, 0]) for c in ((one, none, none), (none, one, none), (none, none, one))] == [299, 587, 114]


# ---- arrays ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
def test_arrays_read_back(tmp_path, dtype):
    truth = film_of(dtype=dtype)
    time = 0.25 + np.arange(6) / 500.0
    np.save(tmp_path / "film.npy", truth)
    np.save(tmp_path / "turned.npy", np.asfortranarray(truth))
    np.save(tmp_path / "big.npy", truth.astype(truth.dtype.newbyteorder(">")))
    with h5py.File(tmp_path / "film.h5", "w") as file:
        file.create_dataset("a/frames", data=truth, chunks=(1, 24, 40), compression="gzip")
        file["times"] = time  # other data sets do not disturb
    for name in ("film.npy", "turned.npy", "big.npy", "film.h5"):
        with open_frames(tmp_path / name, frame_rate=500.0, start=0.25) as film:
            check_film(film, truth, time)
            assert film.time_source == "declared" and len(film.warnings) == name.endswith(".h5")  # which axis is y
        with pytest.raises(FrameError, match="give frame_rate"):
            open_frames(tmp_path / name)


def test_arrays_single_image_and_colour(tmp_path):
    image = film_of(1)[0]
    np.save(tmp_path / "one.npy", image)
    with open_frames(tmp_path / "one.npy") as film:
        check_film(film, image[None], np.zeros(1))
    colour = film_of(3, (24, 40, 3))
    np.save(tmp_path / "colour.npy", colour)
    with open_frames(tmp_path / "colour.npy", frame_rate=1.0) as film:
        check_film(film, np.stack([luma(*np.moveaxis(c, 2, 0)) for c in colour]), np.arange(3.0))
    for channels in (2, 5):
        np.save(tmp_path / "bad.npy", film_of(3, (24, 40, channels)))
        with pytest.raises(FrameError, match=r"shape .* allowed"):
            open_frames(tmp_path / "bad.npy", frame_rate=1.0)


@pytest.mark.parametrize("dtype", ["int64", "int16", "uint32", "complex64"])
def test_arrays_refuse_types_that_would_change(tmp_path, dtype):
    np.save(tmp_path / "film.npy", np.zeros((3, 4, 5), dtype))
    with pytest.raises(FrameError, match="allowed: uint8, uint16, float"):
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


def test_no_pickles(tmp_path):
    np.save(tmp_path / "film.npy", np.array([print, {}], dtype=object), allow_pickle=True)
    with pytest.raises(FrameError, match="plain numbers"):
        open_frames(tmp_path / "film.npy", frame_rate=1.0)


@pytest.mark.parametrize("shape", [(10**9, 1000, 1000), (10, 10**6, 10**6), (-1, 20, 30), (2**62, 64, 64)])
def test_absurd_npy_header(tmp_path, shape):
    header = f"{{'descr': '|u1', 'fortran_order': False, 'shape': {shape}, }}".ljust(117).encode() + b"\n"
    (tmp_path / "film.npy").write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + bytes(500))
    with pytest.raises(FrameError):
        open_frames(tmp_path / "film.npy", frame_rate=1.0)


def test_hdf5_problems(tmp_path, monkeypatch):
    path = tmp_path / "film.h5"
    with h5py.File(path, "w") as file:
        file["a"], file["b"] = film_of(), film_of()
    with pytest.raises(FrameError, match=r"exactly one data set .* /a .*/b"):
        open_frames(path, frame_rate=1.0)
    with h5py.File(path, "w") as file:
        file.create_dataset("a", (10**9, 1000, 1000), "u2", chunks=(1, 1000, 1000))
    with pytest.raises(FrameError, match="does not hold"):
        open_frames(path, frame_rate=1.0)
    with h5py.File(path, "w") as file:
        file["a"] = film_of()
    path.write_bytes(path.read_bytes()[:-1000])
    with pytest.raises(FrameError, match="truncated"):
        open_frames(path, frame_rate=1.0)
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(FrameError, match=r"needs h5py; install it with: pip install 'jumpvision\[hdf5\]'"):
        open_frames(path, frame_rate=1.0)


# ---- image sequences -------------------------------------------------------------------------------------------------


def write_images(folder: Path, truth: np.ndarray, suffix: str, numbers=None) -> None:
    folder.mkdir(exist_ok=True)
    for k, image in zip(numbers if numbers is not None else range(len(truth)), truth):
        assert cv2.imwrite(str(folder / f"img{k}{suffix}"), image)


@pytest.mark.parametrize(
    ("suffix", "dtype"),
    [
        (".png", "uint8"),
        (".png", "uint16"),
        (".bmp", "uint8"),
        (".tif", "uint16"),
        (".tif", "float32"),
        (".pgm", "uint8"),
    ],
)
def test_images_read_back(tmp_path, suffix, dtype):
    truth = film_of(12, dtype=dtype)  # img2 before img10: natural order
    write_images(tmp_path / "film", truth, suffix)
    (tmp_path / "film" / "notes.txt").write_text("not an image")
    time = 1.0 + np.arange(12) / 50.0
    for path in (tmp_path / "film", tmp_path / "film" / f"img*{suffix}"):
        with open_frames(path, frame_rate=50.0, start=1.0) as film:
            check_film(film, truth, time)
            assert film.warnings == ()
    with open_frames(tmp_path / "film" / f"img3{suffix}") as film:
        check_film(film, truth[3:4], np.zeros(1))


def test_pgm_16_bit_keeps_its_values(tmp_path):
    truth = film_of(1, dtype="uint16")[0] % 4096
    (tmp_path / "a.pgm").write_bytes(b"P5\n# camera\n40 24\n4095\n" + truth.astype(">u2").tobytes())
    with open_frames(tmp_path / "a.pgm") as film:
        np.testing.assert_array_equal(film[0], truth)


def test_colour_images_become_luma(tmp_path):
    rgb = film_of(1, (24, 40, 3), "uint16")[0]
    cv2.imwrite(str(tmp_path / "a.png"), rgb[:, :, ::-1])
    with open_frames(tmp_path / "a.png") as film:
        np.testing.assert_array_equal(film[0], luma(*np.moveaxis(rgb, 2, 0)))


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


def test_mixed_sizes_and_formats(tmp_path):
    write_images(tmp_path / "film", film_of(4), ".png")
    cv2.imwrite(str(tmp_path / "film" / "img2.png"), film_of(1, (30, 40))[0])
    with pytest.raises(FrameError, match=r"img2\.png: 30 x 40 pixels, but img0\.png has 24 x 40"):
        open_frames(tmp_path / "film", frame_rate=1.0)
    cv2.imwrite(str(tmp_path / "film" / "img2.bmp"), film_of(1)[0])
    with pytest.raises(FrameError, match=r"mixes 1 \.bmp, 4 \.png"):
        open_frames(tmp_path / "film", frame_rate=1.0)
    write_images(tmp_path / "depth", film_of(3), ".png")
    cv2.imwrite(str(tmp_path / "depth" / "img1.png"), film_of(1, dtype="uint16")[0])
    with open_frames(tmp_path / "depth", frame_rate=1.0) as film, pytest.raises(FrameError, match=r"img1\.png.*uint16"):
        film[1]


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".tif", ".pgm"])
@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 0.99])
def test_torn_image_is_named(tmp_path, suffix, share):
    y, x = np.mgrid[:120, :160]
    smooth = np.stack([(120 + 80 * np.sin(x / 9 + k) * np.cos(y / 13)).astype(np.uint8) for k in range(4)])
    write_images(tmp_path / "film", smooth, suffix)
    torn = tmp_path / "film" / f"img2{suffix}"
    data = torn.read_bytes()
    torn.write_bytes(data[: int(share * len(data))])
    with pytest.raises(FrameError, match=rf"img2\{suffix}"), open_frames(tmp_path / "film", frame_rate=1.0) as film:
        list(film)


def test_absurd_png_header(tmp_path):
    chunk = b"IHDR" + struct.pack(">IIBBBBB", 60_000, 60_000, 8, 0, 0, 0, 0)
    data = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk))
    good = film_of(1)[0]
    cv2.imwrite(str(tmp_path / "img0.png"), good)
    (tmp_path / "img1.png").write_bytes(data + bytes(200) + b"\0\0\0\0IEND\xaeB`\x82")
    with pytest.raises(FrameError, match=r"img1\.png: 60000 x 60000 pixels in"):
        open_frames(tmp_path, frame_rate=1.0)


# ---- TIFF ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
@pytest.mark.parametrize(
    "how", [{}, {"compression": "zlib"}, {"imagej": True}, {"byteorder": ">"}, {"bigtiff": True}, {"metadata": None}]
)
def test_tiff_stacks_read_back(tmp_path, dtype, how):
    truth = film_of(7, dtype=dtype)
    tifffile.imwrite(tmp_path / "film.tif", truth, photometric="minisblack", **how)
    with open_frames(tmp_path / "film.tif", frame_rate=70.0) as film:
        check_film(film, truth, np.arange(7) / 70.0)
        assert film.warnings == () and film.time_source == "declared"
        assert film.meta["bit_depth"] == truth.dtype.itemsize * 8
    with pytest.raises(FrameError, match="give frame_rate"):
        open_frames(tmp_path / "film.tif")


def test_tiff_page_by_page_colour_and_channels(tmp_path):
    truth = film_of(5)
    with tifffile.TiffWriter(tmp_path / "film.tif") as file:
        for image in truth:
            file.write(image, contiguous=False, metadata=None)
    with open_frames(tmp_path / "film.tif", frame_rate=1.0) as film:
        check_film(film, truth, np.arange(5.0))
    rgb = film_of(3, (24, 40, 3))
    grey = np.stack([luma(*np.moveaxis(c, 2, 0)) for c in rgb])
    tifffile.imwrite(tmp_path / "rgb.tif", rgb, photometric="rgb")
    tifffile.imwrite(tmp_path / "planes.tif", np.moveaxis(rgb, 3, 1), photometric="rgb", planarconfig="separate")
    for name in ("rgb.tif", "planes.tif"):
        with open_frames(tmp_path / name, frame_rate=1.0) as film:
            check_film(film, grey, np.arange(3.0))
    for channels in (2, 5):
        extra = film_of(3, (24, 40, channels))
        tifffile.imwrite(tmp_path / "bad.tif", extra, photometric="minisblack", planarconfig="contig", metadata=None)
        with pytest.raises(FrameError, match=f"{channels} channels; allowed"):
            open_frames(tmp_path / "bad.tif", frame_rate=1.0)


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
def test_tiff_lzw(tmp_path, dtype):
    """What OpenCV and many cameras write, and tifffile alone cannot decode."""
    truth = film_of(5, dtype=dtype)
    assert cv2.imwritemulti(str(tmp_path / "film.tif"), list(truth), [cv2.IMWRITE_TIFF_COMPRESSION, 5])
    with open_frames(tmp_path / "film.tif", frame_rate=1.0) as film:
        check_film(film, truth, np.arange(5.0))
    rgb = film_of(1, (24, 40, 3), dtype)[0]
    assert cv2.imwrite(str(tmp_path / "rgb.tif"), rgb[:, :, ::-1], [cv2.IMWRITE_TIFF_COMPRESSION, 5])
    with open_frames(tmp_path / "rgb.tif") as film:
        np.testing.assert_array_equal(film[0], luma(*np.moveaxis(rgb, 2, 0)))


def test_tiff_mixed_sizes(tmp_path):
    with tifffile.TiffWriter(tmp_path / "film.tif") as file:
        for shape in ((24, 40), (24, 40), (20, 40)):
            file.write(film_of(1, shape)[0], contiguous=False, metadata=None)
    with pytest.raises(FrameError, match="page 2 is"):
        open_frames(tmp_path / "film.tif", frame_rate=1.0)


def test_tiff_imagej_single_directory(tmp_path):
    """ImageJ writes stacks above 4 GB with one directory; cut the chain of a small one to get the same."""
    truth = film_of(9, dtype="uint16")
    tifffile.imwrite(tmp_path / "film.tif", truth, imagej=True)
    data = bytearray((tmp_path / "film.tif").read_bytes())
    first = struct.unpack_from("<I", data, 4)[0]
    entries = struct.unpack_from("<H", data, first)[0]
    struct.pack_into("<I", data, first + 2 + 12 * entries, 0)
    (tmp_path / "film.tif").write_bytes(data)
    with open_frames(tmp_path / "film.tif", frame_rate=1.0) as film:
        check_film(film, truth, np.arange(9.0))


@pytest.mark.parametrize("how", [{}, {"imagej": True}, {"metadata": None, "compression": "zlib"}])
def test_tiff_truncated_keeps_every_whole_page(tmp_path, how):
    truth = film_of(8, dtype="uint16")
    path = tmp_path / "film.tif"
    with tifffile.TiffWriter(path, imagej=how.pop("imagej", False)) as file:
        if how:
            for image in truth:
                file.write(image, contiguous=False, **how)
        else:
            file.write(truth, photometric="minisblack")
    with tifffile.TiffFile(path) as file:
        ends = [p.dataoffsets[-1] + p.databytecounts[-1] for p in file.pages]
    path.write_bytes(path.read_bytes()[: ends[4] + 10])  # pages 0-4 are whole
    with open_frames(path, frame_rate=1.0) as film:
        check_film(film, truth[:5], np.arange(5.0))
        if not how:  # the description knows how many there were
            assert "promises 8 frames, 5 are whole, 3 are lost" in film.warnings[0]
