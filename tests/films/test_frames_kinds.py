"""What a picture's file says of its own pixels: palettes, inks, orientation, channels, whole data, names, clocks.

Truth: the picture that was written. Each was once read as another picture, or timed otherwise, without a word.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
import tifffile
from PIL import Image as Pictures

from jumpvision.cli import main
from jumpvision.experiment.stages.recordings import slots
from jumpvision.films.frames import FrameError, open_frames
from jumpvision.films.frames.names import numbering
from jumpvision.films.frames.pictures import image_size, read_image
from tests.worlds.film_files import LOSSLESS_H264, moving, write_film, yuv


def picture(shape=(40, 56)) -> np.ndarray:
    """A smooth face without symmetry, never square; 8 bits."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    return (40 + 3 * x + 0.8 * y + 20 * np.sin(0.2 * x * y / 40)).clip(0, 255).astype(np.uint8)


def test_tiff_palettes_inks_and_white_as_zero(tmp_path):
    """A palette in any order: the values are places in it, not grey. Ink takes light away: CMYK of a grey picture, by
    black alone or by the three colours."""
    file, truth = tmp_path / "a.tif", picture()
    tifffile.imwrite(file, 255 - truth, photometric="miniswhite")
    np.testing.assert_array_equal(read_image(file), truth)
    Pictures.fromarray(255 - truth).save(file, compression="tiff_lzw", tiffinfo={262: 0})
    np.testing.assert_array_equal(read_image(file), truth)
    for ink in ((0, 0, 0, 1), (1, 1, 1, 0)):
        tifffile.imwrite(file, (255 - truth)[..., None] * np.array(ink, np.uint8), photometric="separated")
        np.testing.assert_array_equal(read_image(file), truth)
    place = np.random.default_rng(1).permutation(256)
    colours = np.zeros((3, 256), np.uint16)
    colours[:, place] = 257 * np.arange(256)
    tifffile.imwrite(file, place[truth].astype(np.uint8), photometric="palette", colormap=colours)
    np.testing.assert_array_equal(read_image(file), truth)
    with open_frames(file, frame_rate=1.0) as film:
        assert film.dtype == np.uint8 and film.meta["bit_depth"] == 8


def test_tiff_hyperstacks_are_refused(tmp_path):
    """Channels and frames in one row are no film of as many frames; slices alone or frames alone are."""
    file, stack = tmp_path / "a.tif", np.stack([picture()] * 6)
    tifffile.imwrite(file, stack.reshape(3, 2, 40, 56), imagej=True, metadata={"axes": "TCYX"})
    with pytest.raises(FrameError, match="hyperstack of 2 channels, 3 frames"):
        open_frames(file, frame_rate=1.0)
    for axes in ("TYX", "ZYX"):
        tifffile.imwrite(file, stack, imagej=True, metadata={"axes": axes})
        assert len(open_frames(file, frame_rate=1.0)) == 6


SHOWN = {  # Exif 2.3, tag 274: how to show what is stored
    1: lambda a: a,
    2: lambda a: a[:, ::-1],
    3: lambda a: a[::-1, ::-1],
    4: lambda a: a[::-1],
    5: lambda a: a.T,
    6: lambda a: np.rot90(a, -1),
    7: lambda a: a.T[::-1, ::-1],
    8: lambda a: np.rot90(a),
}


@pytest.mark.parametrize("suffix", ["jpg", "png", "tif"])
def test_pictures_are_turned_as_their_note_says(tmp_path, suffix):
    file, stored = tmp_path / f"a.{suffix}", picture()
    for n, turn in SHOWN.items():
        if suffix == "tif":
            tifffile.imwrite(file, stored, extratags=[(274, 3, 1, n, True)])
        else:
            image = Pictures.fromarray(stored)
            note = image.getexif()
            note[274] = n
            image.save(file, exif=note, **({"quality": 98} if suffix == "jpg" else {}))
        truth = turn(stored)
        found = read_image(file)
        assert found.shape == truth.shape == image_size(file)
        assert np.abs(found.astype(int) - truth).max() <= (4 if suffix == "jpg" else 0)  # JPEG of quality 98


def test_half_a_jpeg_is_refused_even_with_an_end_mark(tmp_path):
    """What the coded data lack the decoder fills with grey."""
    file = tmp_path / "a.jpg"
    grain = np.random.default_rng(2).integers(0, 255, (64, 96), np.uint8)
    Pictures.fromarray(grain).save(file, quality=90)
    whole = file.read_bytes()
    assert read_image(file).shape == grain.shape
    for share in (0.3, 0.5, 0.9):
        file.write_bytes(whole[: int(share * len(whole))] + b"\xff\xd9")
        with pytest.raises(FrameError, match="cannot be decoded whole"):
            read_image(file)


def test_a_picture_may_not_ask_for_gigabytes(tmp_path, monkeypatch):
    file = tmp_path / "a.png"
    Pictures.fromarray(np.zeros((3000, 2000), np.uint8)).save(file)
    monkeypatch.setenv("JUMPVISION_MEGAPIXELS", "5")
    with pytest.raises(FrameError, match=r"allowed: 5 million .*JUMPVISION_MEGAPIXELS"):
        image_size(file)
    monkeypatch.setenv("JUMPVISION_MEGAPIXELS", "6")
    assert image_size(file) == (3000, 2000)


ORDERED = {
    "a camera's number stands behind": ([f"run3_000{k}_cam1" for k in (1, 2, 3, 7)], [0, 1, 2, 6]),
    "a channel stands behind": (["img0001_c0", "img0002_c0", "img0004_c0"], [0, 1, 3]),
    "decimals without zeros": ([f"b_{t}s" for t in (0.25, 0.5, 0.75, 1, 1.25, 1.5, 2)], [0, 1, 2, 3, 4, 5, 7]),
    "before the trigger": (["f--3", "f--2", "f--1", "f-0", "f-1", "f-3"], [0, 1, 2, 3, 4, 6]),
    "a counter behind a point": (["run1.8", "run1.9", "run1.10", "run1.12"], [0, 1, 2, 4]),
    "every fifth": (["a_5", "a_10", "a_15", "a_25"], [0, 1, 2, 4]),
}


def test_the_number_that_varies_counts_the_frames():
    for stems, places in ORDERED.values():
        files = [f"{s}.png" for s in stems]
        mixed = [files[k] for k in np.random.default_rng(3).permutation(len(files))]
        found = numbering(Path("film"), mixed)
        assert found.names == files
        np.testing.assert_array_equal(found.positions, places)
        assert len(found.warnings) == 1 and "missing by the numbers" in found.warnings[0]
    # a name unlike the others may hide a gap
    (told,) = numbering(Path("film"), [f"{s}.png" for s in ("i_1", "i_2", "iA_4", "i_5")]).warnings
    assert "iA_4.png" in told


def test_pictures_counted_by_two_numbers_come_in_the_order_of_both():
    names = ["day10_2.png", "day2_10.png", "day2_9.png", "day10_1.png"]
    assert numbering(Path("film"), names).names == ["day2_9.png", "day2_10.png", "day10_1.png", "day10_2.png"]


def test_a_lost_frame_leaves_its_slot_where_stamps_are_whole_milliseconds():
    """A Matroska film without its 12th frame: the others stay on the grid of the declared rate, to rounding; saved at a
    playback rate of 30 Hz the steps are even to 3 %. Times that no even rate explains stay as they are."""
    numbers = np.delete(np.arange(60), 12)
    for rate in (240.0, 960.0):
        for saved in (rate, 30.0):
            np.testing.assert_array_equal(slots(np.rint(1e3 * numbers / saved) / 1e3, rate), numbers)
    time = np.cumsum(np.random.default_rng(4).uniform(0.5, 1.5, 40))
    np.testing.assert_allclose(slots(time - time[0], 240.0), (time - time[0]) / np.median(np.diff(time)))


def test_a_leap_of_the_clock_is_told(tmp_path):
    stamps = [*range(30), 10**7]
    path = write_film(
        tmp_path / "film.mp4", yuv(moving(31)), "libx264", "yuv420p", rate=100, pts=stamps, options=LOSSLESS_H264
    )
    with open_frames(path) as film:
        assert any("leap by 1e+05 s after frame 29" in w for w in film.warnings)


def turned(path):
    """A film of 5 frames, 20 rows x 30 columns, as MATLAB's h5write(file, "/film", F) keeps F(row, column, frame)."""
    truth = np.arange(5 * 20 * 30, dtype=np.uint16).reshape(5, 20, 30)
    with h5py.File(path, "w") as file:
        file["film"] = truth.transpose(0, 2, 1)
    return truth


def test_an_hdf5_film_says_how_it_is_read_and_may_be_turned(tmp_path):
    truth = turned(tmp_path / "a.h5")
    with open_frames(tmp_path / "a.h5", frame_rate=1.0) as film:
        assert film.shape == (30, 20) and "/film is read as 5 frames of 30 rows x 20 columns" in film.warnings[0]
    with open_frames(tmp_path / "a.h5", frame_rate=1.0, axes="frame,column,row") as film:
        assert film.shape == (20, 30) and film.warnings == () and np.array_equal(film[3], truth[3])
    np.save(tmp_path / "a.npy", truth)
    with pytest.raises(FrameError, match="axes = 'frame,column,row': only of an HDF5 film"):
        open_frames(tmp_path / "a.npy", frame_rate=1.0, axes="frame,column,row")
    with h5py.File(tmp_path / "a.h5", "a") as file:  # MATLAB's save marks its data sets, so that they need no key
        file["film"].attrs["MATLAB_class"] = np.bytes_("uint16")
    with open_frames(tmp_path / "a.h5", frame_rate=1.0) as film:
        np.testing.assert_array_equal(np.stack(list(film)), truth)


@pytest.mark.parametrize(
    "more",
    [
        "roi = [0, 0, 28, 18]\n",
        "axis_column = 25.0\nfoot_row = 3.0\n",
        "[calibration]\nmarks = [[2.0, 3.0, 0.0, 0.0], [27.0, 15.0, 0.01, 0.01]]\n",
    ],
)
def test_places_outside_a_turned_film_are_refused(tmp_path, more):
    turned(tmp_path / "a.h5")
    text = '[grain_video]\nfile = "a.h5"\nframe_rate = 100.0\n'
    for axes, code in (("", 2), ('axes = "frame,column,row"\n', 0)):
        (tmp_path / "experiment.toml").write_text(text + axes + more)
        assert main(["check", str(tmp_path)]) == code


@pytest.mark.parametrize("rate", [240, 1000])
def test_a_frame_that_an_ffv1_film_lost_is_told(tmp_path, rate):
    """Stamps of whole milliseconds: at 1000 Hz a lost frame moves them by no more than rounding may."""
    numbers = [k for k in range(60) if k != 12]
    path = write_film(tmp_path / "film.mkv", moving(59), "ffv1", "gray", rate=rate, pts=numbers)
    with open_frames(path) as film:
        assert film.time == pytest.approx(np.array(numbers) / rate, abs=1e-12)
        assert any("1 frame is missing by the time stamps, first after frame 11" in w for w in film.warnings)
