"""Readers of high-speed camera files (.mraw, .seq, .cine).

The recordings of real cameras are found through the environment variable JUMPVISION_REAL_DATA; damage: test_fuzz.py.
"""

from __future__ import annotations

import os
import struct
from pathlib import Path

import numpy as np
import pytest

from jumpvision.films.frames import FrameError, open_frames
from tests.worlds.film_files import (
    STAMPS_S,
    STAMPS_US,
    check_film,
    film_of,
    grey_film,
    write_cine,
    write_mraw,
    write_seq,
)

REAL = os.environ.get("JUMPVISION_REAL_DATA", "")
needs_real = pytest.mark.skipif(not REAL, reason="set JUMPVISION_REAL_DATA to the folder of real recordings")


# ---- Photron ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("header", [".cih", ".cihx"])
def test_mraw_reads_back(tmp_path, header):
    for bits in (8, 10, 12, 16):
        truth = grey_film(7, bits)
        path = write_mraw(tmp_path, truth, bits, header=header, depth=bits)
        for name in (path, tmp_path / "film.mraw"):
            with open_frames(name, start=2.0) as film:
                check_film(film, truth, 2.0 + np.arange(7) / 5000.0)
                assert film.time_source == "file" and film.warnings == ()
                assert film.meta["bit_depth"] == bits and film.meta["recorded_rate_hz"] == 5000.0
                assert film.meta["exposure_s"] == pytest.approx(50e-6, rel=1e-12)  # 1/20000 s = 50000 ns
    path = write_mraw(tmp_path, truth := grey_film(3, 12) << 4, 16, header=header, side="Higher", depth=12)
    with open_frames(path) as film:
        check_film(film, truth >> 4, np.arange(3) / 5000.0)
        assert film.meta["bit_depth"] == 12


@pytest.mark.parametrize("header", [".cih", ".cihx"])
def test_mraw_skipped_frames_set_the_time_step(tmp_path, header):
    path = write_mraw(tmp_path, grey_film(4, 12), 12, rate=50000, skip=2500, header=header)
    with open_frames(path) as film:
        np.testing.assert_allclose(film.time, np.arange(4) * 0.05, rtol=0, atol=1e-15)
        assert "2500th" in film.warnings[0] and "50000 Hz" in film.warnings[0] and "20 Hz" in film.warnings[0]
    with open_frames(path, frame_rate=50000.0) as film:  # the header's step wins, both rates are named
        assert film.time[1] == pytest.approx(0.05) and "50000 Hz" in film.warnings[-1] and "20 Hz" in film.warnings[-1]


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


@pytest.mark.parametrize(("dtype", "version"), [("uint8", 3), ("uint16", 5)])
def test_seq_reads_back(tmp_path, dtype, version):
    truth = film_of(dtype=dtype)
    path = write_seq(tmp_path / "film.seq", truth, STAMPS_US.tolist(), version=version)
    with open_frames(path, start=0.5) as film:
        check_film(film, truth, 0.5 + (STAMPS_US - STAMPS_US[0]) * 1e-6)
        assert film.time_source == "file"
        (told,) = film.warnings
        assert "varies, from 0.000401 to 0.00085 s (usually 0.00051 s)" in told
    with open_frames(path, frame_rate=100.0) as film:
        # 5 steps in 3001 us
        assert "100 Hz" in film.warnings[0] and "1666.11 Hz" in film.warnings[0]


@pytest.mark.parametrize("kind", ["mraw", "seq", "cine"])
def test_truncated_films_give_every_whole_frame(tmp_path, kind):
    """A cut in the fourth frame of .mraw and behind its stamp in .seq, before its padding; a .cine with damaged
    places of two frames and its last one cut: the others keep their times."""
    truth = grey_film(6, 8 if kind == "seq" else 12 if kind == "mraw" else 16)
    time = {"mraw": np.arange(6) / 5000.0, "seq": (STAMPS_US - STAMPS_US[0]) * 1e-6, "cine": STAMPS_S - STAMPS_S[0]}
    if kind == "mraw":
        path, whole = write_mraw(tmp_path, truth, 12), [0, 1, 2]
    elif kind == "seq":
        path, whole = write_seq(tmp_path / "film.seq", truth, STAMPS_US.tolist()), [0, 1, 2, 3]
    else:
        path, whole = tmp_path / "film.cine", [0, 2, 4]
        write_cine(path, truth, bits=16, stamps=STAMPS_S, offsets={1: -5, 3: 10**15})
    file = tmp_path / f"film.{kind}"
    data = file.read_bytes()
    cut, none = {"mraw": (int(3.7 * len(data) / 6), 100), "seq": (4 * 8192 + 24 * 40 + 8, 8692), "cine": (-100, 7000)}[
        kind
    ]
    file.write_bytes(data[:cut])
    with open_frames(path) as film:
        check_film(film, truth[whole], time[kind][whole])
        n = len(whole)
        assert f"promises 6 frames, {n} are whole, {6 - n} are lost" in film.warnings[0]
    file.write_bytes(data[:none])
    with pytest.raises(FrameError, match="no whole frame"):
        open_frames(path)
    if kind == "seq":  # never closed
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


@pytest.mark.parametrize(("bits", "sign"), [(8, 1), (12, 1), (16, -1)])
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


def test_cine_stamps_beat_the_header_rate_and_a_damaged_one_is_told(tmp_path):
    """A film whose last stamp was damaged ended at 2.5e7 s, and so did the field that was made of it."""
    stamps = 1_270_000_000 + np.arange(12) * 2.0**-10
    path = write_cine(tmp_path / "film.cine", grey_film(12, 16), bits=16, stamps=stamps, rate=10240)
    with open_frames(path) as film:
        np.testing.assert_array_equal(film.time, np.arange(12) / 1024)
        assert "10240 Hz" in film.warnings[0] and "1024 Hz" in film.warnings[0]
        assert film.meta["recorded_rate_hz"] == 10240.0
    stamps[-1] += 2.5e7
    path = write_cine(tmp_path / "film.cine", grey_film(12, 8), bits=8, stamps=stamps, rate=1024)
    with open_frames(path) as film:
        assert any("leap by 2.5e+07 s after frame 10" in w and "clock = 'declared'" in w for w in film.warnings)
    with open_frames(write_cine(tmp_path / "film.cine", grey_film(4, 8), bits=8, rate=500)) as film:
        np.testing.assert_allclose(film.time, np.arange(4) / 500, rtol=0, atol=1e-15)
        assert "no time stamps" in film.warnings[0] and film.time_source == "file"
    with pytest.raises(FrameError, match="give frame_rate"):
        open_frames(write_cine(tmp_path / "film.cine", grey_film(4, 8), bits=8, rate=0))


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
def test_real_phantom():
    """15 frames of bubbles; header 90 000 fps, saved every tenth: 9 000 fps by the stamps (upstream's own test). The
    legacy file's stamps have 1 us steps; their mean is the header's rate."""
    with open_frames(Path(REAL) / "cine_pims/cine_781.cine") as film:
        assert (len(film), film.shape, film.dtype) == (15, (256, 256), np.uint16)
        assert 1 / np.diff(film.time).mean() == pytest.approx(9000, rel=1e-3)
        assert film.meta["recorded_rate_hz"] == 90000.0 and "90000 Hz" in film.warnings[0]
        assert film[7].max() < 2**12
        # The needle enters from below: the lowest rows hold dark pixels, the highest ten none.
        assert film[0][-10:].min() < 500 < film[0][:10].min()
    with open_frames(Path(REAL) / "cine_pims/cine_legacy.cine", frame_rate=35087.0) as film:
        assert (len(film), film.shape, film.dtype, film.warnings) == (97, (128, 128), np.uint16, ())
        assert 1 / np.diff(film.time).mean() == pytest.approx(35087, rel=1e-3)


@needs_real
def test_real_norpix():
    with open_frames(Path(REAL) / "norpix_pims/sample_norpix6.seq") as film:
        assert (len(film), film.shape, film.dtype) == (6, (32, 36), np.uint8)
        np.testing.assert_allclose(film.time, [0, 0.032797, 0.065798, 0.0988, 0.135389, 0.168943], rtol=0, atol=1e-9)
        assert film.time_source == "file"


@needs_real
def test_real_photron():
    """A ball falls 2.65 px a frame (known from this recording), 12 bits packed; every 2500th frame of a beam."""
    for suffix in (".mraw", ".cihx"):
        with open_frames(Path(REAL) / f"photron_ball_12bit/ball_12bit{suffix}") as film:
            assert (len(film), film.shape, film.dtype) == (15, (384, 384), np.uint16)
            np.testing.assert_allclose(film.time, np.arange(15) / 30000.0, rtol=0, atol=1e-15)
            assert film.meta["exposure_s"] == pytest.approx(20e-6)
            rows = [np.mean(np.nonzero(image[:300] < 1500)[0]) for image in film]
            # a dark-pixel centroid is good to about 0.02 px; its slope over 15 frames to better than 0.01
            assert np.polyfit(np.arange(15), rows, 1)[0] == pytest.approx(2.65, abs=0.02)
    with open_frames(Path(REAL) / "photron_beam/beam.cihx") as film:
        assert (len(film), film.shape, film.dtype) == (4, (80, 1024), np.uint16)
        np.testing.assert_allclose(film.time, np.arange(4) * 2500 / 50000, rtol=0, atol=1e-15)
        assert film[0].max() < 2**12 and "2500th" in film.warnings[0]
