"""Files and pictures as real programs write and read them, where these behave otherwise than one remembers."""

from __future__ import annotations

import warnings
from fractions import Fraction

import av
import cv2
import h5py
import numpy as np
import pytest
import tifffile
import xarray as xr

from jumpvision import statistics
from jumpvision.base.schema import InputError, StageWarning
from jumpvision.experiment.inputs.sections import RodVideo
from jumpvision.experiment.inputs.vectors import read_vectors
from jumpvision.experiment.stages.recordings import open_film
from jumpvision.films import FrameError, open_frames
from jumpvision.films.resample import resample

# Pictures ------------------------------------------------------------------------------------------------------------


def waves(rng, n=150, blur=1.6):
    """A grain picture of known values everywhere: waves whose spectrum is that of grains blurred by `blur` px."""
    k, phase = rng.normal(0, 1 / (blur * np.sqrt(2)), (n, 2)), rng.uniform(0, 2 * np.pi, n)

    def grey(x, y):
        x, y = np.asarray(x, np.float32), np.asarray(y, np.float32)
        return 120 + 45 * sum(np.cos(kx * x + ky * y + p) for (kx, ky), p in zip(k, phase)) / np.sqrt(n / 2)

    return grey


@pytest.mark.surprise(
    package="opencv-python-headless",
    version="5.0.0.93",
    behaviour="Its cubic interpolation (INTER_CUBIC) displaces a soft picture: by 0.048 px at a shift of 0.2 px, by "
    "nothing at 0.5 px, by -0.048 px at 0.8 px.",
    here="Pictures are resampled by cubic B-splines, which displace nothing, before anything is measured in them.",
)
@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
def test_a_picture_that_is_shifted_moves_by_the_shift(kind):
    """The displacement that least squares finds between the resampled picture and the drawn one. Rounding to whole
    grey levels, 0.29 rms, leaves 0.29 / (rms slope 13) / sqrt(6,400 px) = 0.0003 px."""
    grey, (rows, columns) = waves(np.random.default_rng(0), blur=2.5), np.mgrid[10:90, 10:90].astype(np.float32)
    whole = np.mgrid[:100, :100]
    picture = grey(whole[1], whole[0])
    picture = picture.astype(kind) if kind == np.float32 else np.clip(np.rint(picture), 0, 255).astype(kind)

    def error(shift, read):
        true, h = grey(columns + shift, rows), 1e-2
        slope = (grey(columns + shift + h, rows) - grey(columns + shift - h, rows)) / (2 * h)
        return np.sum((read(picture, columns + np.float32(shift), rows) - true) * slope) / np.sum(slope**2)

    for shift in (0.2, 0.5, 0.8):
        assert abs(error(shift, resample)) < 0.001
    assert resample(picture, columns, rows).dtype == kind
    if kind != np.float32:
        assert np.array_equal(resample(picture, columns, rows), picture[10:90, 10:90])
    cubic = error(0.2, lambda f, x, y: cv2.remap(f, x, y, cv2.INTER_CUBIC))
    assert abs(cubic) > 0.02  # the measure sees what is mended


def test_beyond_its_border_a_picture_goes_on_as_it_ends():
    for picture in (np.arange(12, dtype=np.uint8).reshape(3, 4), np.full((1, 1), 7, np.uint8)):
        rows, columns = np.mgrid[-3:8, -40:40]
        inside = np.clip(rows, 0, picture.shape[0] - 1), np.clip(columns, 0, picture.shape[1] - 1)
        assert np.array_equal(resample(picture, columns.astype(np.float32), rows.astype(np.float32)), picture[inside])


# Films ---------------------------------------------------------------------------------------------------------------

FILM = (10 * np.arange(1, 8, dtype=np.uint8))[:, None, None] + np.arange(32, dtype=np.uint8)[:, None] // 16
FILM = np.repeat(FILM, 40, axis=2)  # 7 frames of 32 rows x 40 columns


@pytest.mark.surprise(
    package="tifffile",
    version="2026.3.3",
    behaviour="A film of exactly 3 or 4 frames is saved as one colour picture of separate planes unless "
    "photometric='minisblack' is given.",
    here="Such a file is refused with the remedy, as nothing in it tells frames from colours.",
)
@pytest.mark.parametrize("n", [2, 3, 4, 5])
def test_no_film_is_read_as_one_colour_picture(tmp_path, n):
    tifffile.imwrite(tmp_path / "f.tif", FILM[:n], photometric="rgb" if n in (3, 4) else None)  # as it then chooses
    if n in (3, 4):
        with pytest.raises(FrameError, match=rf"{n} grey frames.*minisblack"):
            open_frames(tmp_path / "f.tif", frame_rate=10.0)
        tifffile.imwrite(tmp_path / "f.tif", FILM[:n], photometric="minisblack")
    with open_frames(tmp_path / "f.tif", frame_rate=10.0) as film:
        assert np.array_equal(list(film), FILM[:n])


def test_colour_pictures_stay_colour_pictures(tmp_path):
    colour = np.stack([FILM[:3]] * 2)  # 2 frames of 3 planes
    tifffile.imwrite(tmp_path / "planes.tif", colour, photometric="rgb", planarconfig="separate")
    tifffile.imwrite(tmp_path / "pixels.tif", np.moveaxis(colour, 1, -1), photometric="rgb")
    for name in ("planes", "pixels"):
        with open_frames(tmp_path / f"{name}.tif", frame_rate=1.0) as film:
            assert len(film) == 2 and film[0][0, 0] == round(0.299 * 10 + 0.587 * 20 + 0.114 * 30)


@pytest.mark.surprise(
    package="tifffile",
    version="2026.3.3",
    behaviour="The pages of an OME-TIFF are all planes one after another, channels and frames alike, and in a set of "
    "files only those of the first; what they are stands in the XML of the first page.",
    here="Several channels, slices and frames, or several files, are refused; TimeIncrement is the film's clock.",
)
def test_ome_tiff_says_which_pages_are_frames(tmp_path):
    file = tmp_path / "f.ome.tif"
    tifffile.imwrite(file, np.stack([FILM, FILM], axis=1), metadata={"axes": "TCYX"})
    with pytest.raises(FrameError, match=r"2 channels, 7 frames.*save one channel"):
        open_frames(file, frame_rate=10.0)
    times = {"TimeIncrement": 20.0, "TimeIncrementUnit": "ms"}
    tifffile.imwrite(file, FILM, metadata={"axes": "TYX", **times})
    with open_frames(file, frame_rate=100.0) as film:
        assert np.array_equal(list(film), FILM) and film.time[1] == pytest.approx(0.02)
        assert "frame_rate = 100 Hz is declared" in film.warnings[0] and "50 Hz" in film.warnings[0]
    colour = np.stack([FILM] * 3, axis=-1)
    tifffile.imwrite(file, colour, photometric="rgb", metadata={"axes": "TYXS"})
    with open_frames(file, frame_rate=100.0) as film:
        assert len(film) == 7 and not film.warnings


def test_one_file_of_an_ome_tiff_set_is_refused(tmp_path):
    """By the OME model every file names all of them, or the one file that does."""
    block = '<TiffData FirstT="{}" PlaneCount="3"><UUID FileName="f{}.ome.tif">urn:uuid:1</UUID></TiffData>'
    named = block.format(0, 0) + block.format(3, 1)
    pixels = '<Pixels SizeX="40" SizeY="32" SizeZ="1" SizeC="1" SizeT="6">'
    other = '<BinaryOnly MetadataFile="f0.ome.tif" UUID="urn:uuid:1"/>'
    for text in (f"<OME><Image>{pixels}{named}</Pixels></Image></OME>", f"<OME>{other}</OME>"):
        tifffile.imwrite(tmp_path / "f.ome.tif", FILM[:5], description=text, metadata=None, ome=False)
        with pytest.raises(FrameError, match=r"set of several files.*as one"):
            open_frames(tmp_path / "f.ome.tif", frame_rate=10.0)


def test_the_frame_interval_of_imagej_is_compared(tmp_path):
    tifffile.imwrite(tmp_path / "f.tif", FILM, imagej=True, metadata={"axes": "TYX", "finterval": 0.02})
    with open_frames(tmp_path / "f.tif", frame_rate=100.0) as film:
        assert "50 Hz" in film.warnings[0]


@pytest.mark.surprise(
    package="hdf5storage",
    version="0.2.2",
    behaviour="An array is written with its axes turned round, as MATLAB would see it; the attribute Python.Shape says "
    "how it was.",
    here="Its frames are those of the array that was saved.",
)
@pytest.mark.parametrize("kept", [FILM, np.stack([FILM] * 3, axis=-1), FILM[0]])
def test_a_film_of_hdf5storage_has_the_frames_that_were_saved(tmp_path, kept):
    with h5py.File(tmp_path / "f.h5", "w") as file:  # the attributes that 0.2.2 writes
        data = file.create_dataset("film", data=kept.T)
        data.attrs["MATLAB_class"], data.attrs["Python.Type"] = np.bytes_(b"uint8"), np.bytes_(b"numpy.ndarray")
        data.attrs["Python.Shape"] = np.array(kept.shape, np.uint64)
    for axes in ("", "frame,row,column"):
        with open_frames(tmp_path / "f.h5", frame_rate=10.0, axes=axes) as film:
            assert film.shape == (32, 40)
            assert np.array_equal(np.squeeze(list(film)), FILM if kept.ndim > 2 else FILM[0])
            assert any("read as" in w for w in film.warnings) == (not axes)


@pytest.mark.surprise(
    package="pyMRAW",
    version="0.33.0",
    behaviour="save_mraw writes 1 frame a second, a shutter of 1 s and 12 effective bits of 16 into the header unless "
    "it is told them.",
    here="An exposure that is longer than from one frame to the next is not used, with a warning.",
)
@pytest.mark.parametrize(("clock", "first", "said"), [("declared", 0.0, True), ("file", 0.5, False)])
def test_an_exposure_longer_than_the_time_between_frames_is_unknown(tmp_path, clock, first, said):
    FILM.astype("<u2").tofile(tmp_path / "f.mraw")
    header = {"Record Rate(fps)": "1", "Shutter Speed(s)": "1.000000", "Total Frame": 7, "Original Total Frame": 7}
    header |= {"Start Frame": 0, "Image Width": 40, "Image Height": 32, "Color Type": "Mono", "Color Bit": 16}
    header |= {"File Format": "MRaw", "EffectiveBit Depth": 12, "EffectiveBit Side": "Lower"}
    lines = [f"{k} : {v}\n" for k, v in header.items()]
    (tmp_path / "f.cih").write_text("#Camera Information Header\n" + "".join(lines))
    section = RodVideo("f.mraw", path=tmp_path / "f.mraw", frame_rate=1000.0, scale=1e-3, clock=clock)
    with pytest.warns(StageWarning) as told, open_film(section) as film:
        assert film.time[0] + film.exposure / 2 == pytest.approx(first)
        assert film.time[1] - film.time[0] == pytest.approx(1e-3 if said else 1.0)
    about = [str(w.message) for w in told if "by its header" in str(w.message)]
    assert len(about) == said and all("1 s by its header" in w and "give [rod_video] exposure" in w for w in about)


def encoded(path, aspect, frames):
    """A film without loss whose pixels are `aspect` as wide as high."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264rgb", rate=100, options={"qp": "0"})
        (stream.height, stream.width), stream.pix_fmt = frames[0].shape, "rgb24"
        stream.codec_context.sample_aspect_ratio = aspect
        for grey in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.stack([grey] * 3, axis=-1), format="rgb24")))
        container.mux(stream.encode())


@pytest.mark.surprise(
    package="av",
    version="18.1.0",
    behaviour="A frame comes as stored where the file says that its pixels are not square (sample aspect ratio, as of "
    "camcorders); players stretch it.",
    here="Frames are resampled to square pixels, with a warning that gives the ratio.",
)
@pytest.mark.parametrize("aspect", [Fraction(4, 3), Fraction(3, 4), Fraction(1), Fraction(1281, 1280)])
def test_pixels_that_are_not_square_are_made_so(tmp_path, aspect):
    """A round spot is round, and moves as far to the right as it does down."""
    rows, columns = np.mgrid[:48, :64]
    wide, high = float(max(aspect, 1)), float(max(1 / aspect, 1))

    def spot(i):
        x, y = (columns + 0.5) * wide - 0.5, (rows + 0.5) * high - 0.5
        return np.rint(20 + 200 * np.exp(-((x - 20 - 3 * i) ** 2 + (y - 20 - 3 * i) ** 2) / 32)).astype(np.uint8)

    encoded(tmp_path / "f.mp4", aspect, [spot(i) for i in range(5)])
    seen = []
    with open_frames(tmp_path / "f.mp4", seen=seen.append) as film:
        stretched = abs(aspect - 1) > 0.1
        assert film.shape == (round(48 * high), round(64 * wide)) == film[0].shape
        assert [str(aspect) in w and "square" in w for w in film.warnings] == [True] * stretched
        assert all(np.array_equal(a, b) for a, b in zip(seen, film)) and len(seen) == 5
        for i, image in enumerate(film):
            light = image.astype(float) - 20
            y, x = np.indices(image.shape)
            middle = np.array([np.sum(light * x), np.sum(light * y)]) / light.sum()
            assert middle == pytest.approx(20 + 3 * i, abs=0.05)  # px; whole grey levels: 0.3 x 5 / 70


@pytest.mark.surprise(
    package="numpy",
    version="2.4.6",
    behaviour="save() to an open file, again and again, appends arrays; load() of its name gives the first alone.",
    here="A film file that holds more frames than its header counts is read as the header says, with a warning.",
)
def test_frames_beyond_the_header_are_told(tmp_path):
    with (tmp_path / "f.npy").open("wb") as file:
        np.save(file, FILM[:4])
        np.save(file, FILM[4:])
    with open_frames(tmp_path / "f.npy", frame_rate=10.0) as film:
        assert np.array_equal(list(film), FILM[:4])
        assert "holds 7 frames, its header only 4" in film.warnings[0]


# Fields --------------------------------------------------------------------------------------------------------------


def openpiv_field():
    """x, y, u, v of OpenPIV with 13 masked vectors among 225 that move."""
    x, y = np.meshgrid(16.0 * np.arange(1, 16), 16.0 * np.arange(15, 0, -1))
    masked = np.zeros(x.shape, bool)
    masked[5:8, 5:9] = masked[0, 0] = True
    return x, y, *(np.ma.masked_array(f, masked) for f in (2 + 0.01 * x, 1 + 0.005 * y)), masked


@pytest.mark.surprise(
    package="OpenPIV",
    version="0.26.1",
    behaviour="save() writes masked vectors as u = v = 0 with flag and mask 0, as if they were measured, unless mask= "
    "is given.",
    here="Vectors that are exactly 0 in both components are left out, with a warning.",
)
def test_masked_vectors_of_openpiv_do_not_count_as_measured(tmp_path):
    tools = pytest.importorskip("openpiv.tools")
    x, y, u, v, masked = openpiv_field()
    tools.save(tmp_path / "field.txt", x, y, u, v)
    with pytest.warns(StageWarning, match="13 of 225 measured vectors are exactly 0"):
        found = read_vectors(tmp_path / "field.txt")
    assert np.array_equal(found.valid[..., 0], ~masked)
    tools.save(tmp_path / "field.txt", x, y, u, v, mask=masked)
    with warnings.catch_warnings(action="error"):
        assert np.array_equal(read_vectors(tmp_path / "field.txt").valid[..., 0], ~masked)


@pytest.mark.surprise(
    package="pivpy",
    version="0.4.0",
    behaviour="load_openpiv_txt takes OpenPIV's mask column, 1 where masked, for 1 where measured: every u and v of a "
    "field becomes 0.",
    here="A field of zeros is refused, whatever `measured` says, with the advice to name OpenPIV's own text.",
)
@pytest.mark.parametrize("measured", [(), (0,), (1,)])
def test_a_field_of_zeros_is_refused_whatever_its_flags(tmp_path, measured):
    x, y, u, *_ = openpiv_field()
    zeros = (("y", "x", "t"), np.zeros((*u.shape, 1)))
    data = xr.Dataset(
        dict.fromkeys(("u", "v", "chc"), zeros), {"x": x[0], "y": y[:, 0], "t": [0.0]}, {"files": ["field.txt"]}
    )
    data.to_netcdf(tmp_path / "field.nc")
    with pytest.raises(InputError, match=r"0 or missing everywhere.*OpenPIV"):
        read_vectors(tmp_path / "field.nc", measured)
    with pytest.raises(InputError, match="0 or missing everywhere"):
        statistics(data, measured=measured)
