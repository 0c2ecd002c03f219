"""Odd names, places and files: refused in words, or taken as they are; no hang, no memory. (About 10 s.)"""

from __future__ import annotations

import json
import os
import struct
import unicodedata
from pathlib import Path

import h5py
import numpy as np
import pytest

from jumpvision.base.schema import InputError, harmless
from jumpvision.cli import main
from jumpvision.experiment.inputs.experiment import open_campaign
from jumpvision.experiment.inputs.logs import LARGEST, read_log
from jumpvision.experiment.inputs.sections import CraterDepth
from jumpvision.experiment.stages.bed.crater import read_map
from jumpvision.films.frames import FrameError, open_frames
from jumpvision.films.frames.tiff import MOST_PAGES
from jumpvision.laboratory import write
from tests.worlds.small import run_here, write_campaign

posix = pytest.mark.skipif(os.name == "nt", reason="needs pipes and devices in the file system")


@pytest.fixture
def campaign(tmp_path) -> Path:
    return write_campaign(tmp_path / "campaign", 2)


# ---- names -----------------------------------------------------------------------------------------------------------


def test_names_that_results_cannot_have(campaign, capsys):
    toml = campaign / "jump-0000" / "experiment.toml"
    text = toml.read_text()
    steering = ("a\x1b[2Jb", "a\nb")
    for name in (*steering, "jumps.csv", "Report.HTML", ".cache", "CON", "com1.film", "ends.", "ends ", "ä" * 61):
        toml.write_text(f"name = {json.dumps(name)}\n" + text, encoding="utf-8")
        assert main(["check", str(campaign)]) == 2, name
        err = capsys.readouterr().err
        assert "name = " in err and "\x1b" not in err


def test_names_that_some_disks_take_for_one(campaign):
    text = (campaign / "jump-0000" / "experiment.toml").read_text()
    for pair in (("Loose", "loose"), ("é", unicodedata.normalize("NFD", "é")), ("straße", "STRASSE")):
        for k, name in enumerate(pair):
            toml = campaign / f"jump-000{k}" / "experiment.toml"
            toml.write_text(f"name = {json.dumps(name)}\n" + text, encoding="utf-8")
        with pytest.raises(InputError, match="unique"):
            open_campaign(campaign)


def test_other_peoples_names_do_not_steer_the_terminal(campaign, capsys):
    log = campaign / "jump-0000" / "rod_track.csv"
    rows = log.read_text().splitlines()
    log.write_text("\n".join([rows[0], "0.0,\x1b]0;owned\x07", *rows[2:]]) + "\n")
    assert run_here(campaign, campaign.parent / "results") == 1
    out, err = capsys.readouterr()
    assert "\x1b" not in out + err and "\\x1b]0;owned" in err
    assert harmless("µ 粒 \x1b[1m\u202e") == "µ 粒 \\x1b[1m\\u202e"


# ---- what never ends -------------------------------------------------------------------------------------------------


@posix
@pytest.mark.timeout(60)
def test_pipes_and_devices_are_refused(campaign, capsys):
    for where in ("rod_track.csv", "experiment.toml"):
        file = campaign / "jump-0000" / where
        kept = file.read_bytes()
        for what in ("pipe", "device"):
            file.unlink()
            os.mkfifo(file) if what == "pipe" else file.symlink_to("/dev/zero")
            for command in ("check", "run"):
                assert main([command, str(campaign)]) == 2
                assert f"is a {what}" in capsys.readouterr().err
        file.unlink()
        file.write_bytes(kept)
    os.mkfifo(campaign / "a.avi")
    with pytest.raises(FrameError, match="is a pipe"):
        open_frames(campaign / "a.avi")


@pytest.mark.timeout(60)
def test_absurd_toml(campaign, capsys):
    for text, says in (
        ("x = " + "[" * 100_000 + "]" * 100_000, "deep"), ("x = " + "9" * 5_000, "not valid TOML"),
        ("#" * 1_100_000, "1100000 bytes"), ("[robot]\nmotor_mass = 1" + "0" * 400, "motor_mass"),
    ):  # fmt: skip
        (campaign / "jump-0000" / "experiment.toml").write_text(text)
        assert main(["check", str(campaign)]) == 2
        assert says in (err := capsys.readouterr().err) and "Traceback" not in err


def test_a_large_log_is_refused_with_its_size(tmp_path):
    with (tmp_path / "a.csv").open("wb") as f:
        f.truncate(int(LARGEST) + 10**9)
    with pytest.raises(InputError, match=r"1\.2 GB; logs of at most 0\.2 GB"):
        read_log(tmp_path / "a.csv", "time_s", "position_m")


def test_an_unpacked_map_has_a_cap(tmp_path, monkeypatch):
    monkeypatch.setattr("jumpvision.experiment.stages.bed.crater.LARGEST", 10**6)
    np.savez_compressed(tmp_path / "a.npz", depth=np.zeros((1000, 1000)))
    with pytest.raises(ValueError, match="at most 1000000"):
        read_map(CraterDepth(file="a.npz", path=tmp_path / "a.npz"))


@pytest.mark.timeout(60)
def test_a_stack_of_very_many_pages_is_refused(tmp_path):
    n, tags = MOST_PAGES + 1, 9
    size = 2 + 12 * tags + 4
    head = [(256, 3, 4), (257, 3, 4), (258, 3, 8), (259, 3, 1), (262, 3, 1), (273, 4, 8 + n * size), (277, 3, 1)]
    head += [(278, 3, 4), (279, 4, 16)]
    page = struct.pack("<H", tags) + b"".join(struct.pack("<HHII", tag, kind, 1, v) for tag, kind, v in head)
    chain = b"".join(page + struct.pack("<I", 8 + (i + 1) * size if i < n - 1 else 0) for i in range(n))
    (tmp_path / "a.tif").write_bytes(b"II*\0" + struct.pack("<I", 8) + chain + bytes(16))
    with pytest.raises(FrameError, match=f"more than {MOST_PAGES} pages"):
        open_frames(tmp_path / "a.tif", frame_rate=100.0)


# ---- films that lead elsewhere ---------------------------------------------------------------------------------------


def test_hdf5_that_lies_in_other_files_is_refused(tmp_path):
    np.zeros((3, 4, 5), np.uint8).tofile(tmp_path / "raw.bin")
    with h5py.File(tmp_path / "a.h5", "w") as f:
        f.create_dataset("film", (3, 4, 5), np.uint8, external=[("raw.bin", 0, 60)])
    with h5py.File(tmp_path / "b.h5", "w") as f:
        f.create_dataset("film", data=np.zeros((3, 4, 5), np.uint8))
    with h5py.File(tmp_path / "c.h5", "w") as f:
        layout = h5py.VirtualLayout((3, 4, 5), np.uint8)
        layout[:] = h5py.VirtualSource(tmp_path / "b.h5", "film", (3, 4, 5))
        f.create_virtual_dataset("film", layout)
    for name, other in (("a.h5", "raw.bin"), ("c.h5", "b.h5")):
        with pytest.raises(FrameError, match=f"lies in another file .*{other}"):
            open_frames(tmp_path / name, frame_rate=100.0)
    assert len(open_frames(tmp_path / "b.h5", frame_rate=100.0)) == 3


def test_lists_of_films_that_call_themselves_a_film_are_refused(tmp_path):
    write.film(tmp_path / "film.avi", np.zeros((5, 32, 32), np.uint8), rate=100.0)
    playlist = "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nfilm.avi\n#EXT-X-ENDLIST\n"
    for script in ("ffconcat version 1.0\nfile 'film.avi'\n", playlist):
        (tmp_path / "list.mkv").write_text(script)
        with pytest.raises(FrameError, match=r"list\.mkv"):
            open_frames(tmp_path / "list.mkv")
    assert len(open_frames(tmp_path / "film.avi")) == 5
