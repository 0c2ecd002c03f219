"""Odd names, places and files: refused in words, or taken as they are; no hang, no memory. (About 10 s.)"""

from __future__ import annotations

import json
import os
import shutil
import struct
import subprocess
import sys
import time
import unicodedata
from pathlib import Path

import h5py
import numpy as np
import pytest
import tifffile
from fault_lab import run_here, write_campaign
from test_frames_raw import STAMPS_S, write_cine

from jumpvision.base import storage
from jumpvision.base.schema import InputError, harmless
from jumpvision.cli import main
from jumpvision.experiment.inputs.experiment import open_campaign, open_experiment
from jumpvision.experiment.inputs.logs import LARGEST, read_log
from jumpvision.experiment.inputs.overrides import overrides_of
from jumpvision.experiment.inputs.sections import CraterDepth, RodVideo
from jumpvision.experiment.stages.bed.crater import read_map
from jumpvision.films.frames import FrameError, open_frames
from jumpvision.films.frames.tiff import MOST_PAGES

posix = pytest.mark.skipif(os.name == "nt", reason="needs pipes and devices in the file system")
SECONDS = 10.0  # what no file may take


@pytest.fixture
def campaign(tmp_path) -> Path:
    return write_campaign(tmp_path / "campaign", 2)


# ---- names -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    [
        "jumps.csv",
        "Report.HTML",
        ".cache",
        ".workflow",
        "CON",
        "com1.film",
        "a\x1b[2Jb",
        "a\nb",
        "ends.",
        "ends ",
        "ä" * 61,
    ],
)
def test_names_that_results_cannot_have(campaign, name, capsys):
    toml = campaign / "jump-0000" / "experiment.toml"
    toml.write_text(f"name = {json.dumps(name)}\n" + toml.read_text(), encoding="utf-8")
    assert main(["check", str(campaign)]) == 2
    err = capsys.readouterr().err
    assert "name = " in err and "\x1b" not in err


@pytest.mark.parametrize("pair", [("Loose", "loose"), ("é", unicodedata.normalize("NFD", "é")), ("straße", "STRASSE")])
def test_names_that_some_disks_take_for_one(campaign, pair):
    for k, name in enumerate(pair):
        toml = campaign / f"jump-000{k}" / "experiment.toml"
        toml.write_text(f"name = {json.dumps(name)}\n" + toml.read_text(), encoding="utf-8")
    with pytest.raises(InputError, match="names must be unique"):
        open_campaign(campaign)


def test_other_peoples_names_do_not_steer_the_terminal(campaign, capsys):
    log = campaign / "jump-0000" / "rod_track.csv"
    rows = log.read_text().splitlines()
    log.write_text("\n".join([rows[0], "0.0,\x1b]0;owned\x07", *rows[2:]]) + "\n")
    assert run_here(campaign, campaign.parent / "results") == 1
    out, err = capsys.readouterr()
    assert "\x1b" not in out + err and "\\x1b]0;owned" in err
    assert harmless("µ 粒 \x1b[1m\u202e") == "µ 粒 \\x1b[1m\\u202e"


def test_a_terminal_without_a_letter_is_no_reason_to_fail(campaign):
    toml = campaign / "jump-0000" / "experiment.toml"
    toml.write_text('name = "Größe 粒"\n' + toml.read_text(), encoding="utf-8")
    call = [sys.executable, "-c", "import sys; from jumpvision.cli import main; sys.exit(main(sys.argv[1:]))", "check"]
    done = subprocess.run([*call, str(campaign)], capture_output=True, env=os.environ | {"PYTHONIOENCODING": "ascii"})
    assert done.returncode == 0, done.stderr
    assert b"Gr\\xf6\\xdfe" in done.stdout


def test_lines_end_alike_and_long_names_are_written(tmp_path):
    storage.write_aside(tmp_path / ("x" * 240), "a\nb\n")
    assert (tmp_path / ("x" * 240)).read_bytes() == b"a\nb\n"


def test_a_file_that_is_open_elsewhere_is_waited_for_and_then_named(tmp_path, monkeypatch):
    """Windows refuses to replace what another program has open."""
    true, refusals = os.replace, []

    def replace(source, target):
        if len(refusals) < limit:
            refusals.append(target)
            raise PermissionError(13, "Access is denied", str(target))
        return true(source, target)

    monkeypatch.setattr(os, "replace", replace)
    monkeypatch.setattr(storage, "PATIENCE", (0.0, 0.0))
    limit = 1
    with pytest.raises(PermissionError, match="Access is denied"):
        storage.write_aside(tmp_path / "jumps.csv", "a")
    monkeypatch.setattr(storage.os, "name", "nt")
    refusals.clear()
    limit = 2
    storage.replace(_written(tmp_path / "aside"), tmp_path / "jumps.csv")
    assert (tmp_path / "jumps.csv").read_text() == "new"
    refusals.clear()
    limit = 9
    with pytest.raises(PermissionError, match="open in another program"):
        storage.replace(_written(tmp_path / "aside"), tmp_path / "jumps.csv")


def _written(path: Path) -> Path:
    path.write_text("new")
    return path


# ---- what never ends -------------------------------------------------------------------------------------------------


@posix
@pytest.mark.parametrize("what", ["pipe", "device"])
@pytest.mark.parametrize("where", ["experiment.toml", "rod_track.csv"])
def test_pipes_and_devices_are_refused(campaign, what, where, capsys):
    file = campaign / "jump-0000" / where
    file.unlink()
    os.mkfifo(file) if what == "pipe" else file.symlink_to("/dev/zero")
    began = time.monotonic()
    for command in ("check", "run"):
        assert main([command, str(campaign)]) == 2
        assert f"is a {what}" in capsys.readouterr().err
    assert time.monotonic() - began < SECONDS
    with pytest.raises(FrameError if where.endswith("csv") else InputError, match=r"is a|unknown film"):
        open_frames(file) if where.endswith("csv") else open_experiment(file.parent)


@posix
def test_a_film_that_is_a_pipe_is_refused(tmp_path):
    os.mkfifo(tmp_path / "a.avi")
    with pytest.raises(FrameError, match="is a pipe"):
        open_frames(tmp_path / "a.avi")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x = " + "[" * 100_000 + "]" * 100_000, "deep"),
        ("x = " + "9" * 5_000, "not valid TOML"),
        ("#" * 1_100_000, "1100000 bytes; at most 1000000"),
        ("[robot]\nmotor_mass = 1" + "0" * 400, "motor_mass"),
    ],
)
def test_absurd_toml(campaign, text, says, capsys):
    (campaign / "jump-0000" / "experiment.toml").write_text(text)
    assert main(["check", str(campaign)]) == 2
    assert says in (err := capsys.readouterr().err) and "Traceback" not in err


def test_absurd_settings():
    assert overrides_of(("robot.motor_mass=" + "9" * 5_000,))["robot"]["motor_mass"] == "9" * 5_000
    assert overrides_of(("robot.motor_mass=" + "[" * 100_000,))["robot"]["motor_mass"][0] == "["


def test_frames_left_out_take_no_memory(tmp_path):
    section = RodVideo(file="a.avi", exclude_frames=("5:999999999 lamp", "2"))
    assert section.check() == []
    assert section.excluded(7) == {2: "excluded: by the user", 5: "excluded: lamp", 6: "excluded: lamp"}
    (problem,) = RodVideo(file="a.avi", exclude_frames=("0:100000000000",)).check()
    assert "nine digits" in problem


def test_a_large_log_is_refused_with_its_size(tmp_path):
    with (tmp_path / "a.csv").open("wb") as f:
        f.truncate(int(LARGEST) + 10**9)
    with pytest.raises(InputError, match=r"1\.2 GB; logs of at most 0\.2 GB"):
        read_log(tmp_path / "a.csv", "time_s", "position_m")


def test_an_unpacked_map_has_a_cap(tmp_path, monkeypatch):
    monkeypatch.setattr("jumpvision.experiment.stages.bed.crater.LARGEST", 10**6)
    np.savez_compressed(tmp_path / "a.npz", depth=np.zeros((1000, 1000)))
    with pytest.raises(ValueError, match="bytes unpacked; at most 1000000"):
        read_map(CraterDepth(file="a.npz", path=tmp_path / "a.npz"))


def test_a_stack_of_very_many_pages_is_refused(tmp_path):
    n, tags = MOST_PAGES + 1, 9
    size = 2 + 12 * tags + 4
    head = [(256, 3, 4), (257, 3, 4), (258, 3, 8), (259, 3, 1), (262, 3, 1), (273, 4, 8 + n * size), (277, 3, 1)]
    head += [(278, 3, 4), (279, 4, 16)]
    page = struct.pack("<H", tags) + b"".join(struct.pack("<HHII", tag, kind, 1, v) for tag, kind, v in head)
    chain = b"".join(page + struct.pack("<I", 8 + (i + 1) * size if i < n - 1 else 0) for i in range(n))
    (tmp_path / "a.tif").write_bytes(b"II*\0" + struct.pack("<I", 8) + chain + bytes(16))
    began = time.monotonic()
    with pytest.raises(FrameError, match=f"more than {MOST_PAGES} pages"):
        open_frames(tmp_path / "a.tif", frame_rate=100.0)
    assert time.monotonic() - began < SECONDS


def test_a_million_offsets_of_a_phantom_film(tmp_path):
    """The header of a film of three frames says a million, and gives the place of each."""
    path, many = write_cine(tmp_path / "a.cine", np.zeros((3, 24, 40), np.uint16), bits=16, stamps=STAMPS_S[:3]), 10**6
    data = bytearray(path.read_bytes())
    at = struct.unpack_from("<I", data, 32)[0]
    first = struct.unpack_from("<q", data, at)[0]
    data[20:24] = many.to_bytes(4, "little")
    struct.pack_into("<I", data, 32, len(data))
    path.write_bytes(bytes(data) + struct.pack("<q", first) * many)
    began = time.monotonic()
    with open_frames(path, frame_rate=100.0) as film:
        assert len(film) <= path.stat().st_size // (24 * 40 * 2)
    assert time.monotonic() - began < SECONDS


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


@pytest.mark.parametrize(
    "script",
    [
        "ffconcat version 1.0\nfile 'film.avi'\n",
        "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nfilm.avi\n#EXT-X-ENDLIST\n",
    ],
)
def test_lists_of_films_that_call_themselves_a_film_are_refused(tmp_path, script):
    from jumpvision.laboratory import write

    write.film(tmp_path / "film.avi", np.zeros((5, 32, 32), np.uint8), rate=100.0)
    (tmp_path / "list.mkv").write_text(script)
    with pytest.raises(FrameError, match=r"list\.mkv"):
        open_frames(tmp_path / "list.mkv")
    assert len(open_frames(tmp_path / "film.avi")) == 5


def test_small_stacks_are_read_as_ever(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((7, 8, 9), np.uint8), photometric="minisblack")
    assert len(open_frames(tmp_path / "a.tif", frame_rate=1.0)) == 7


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="mounts read-only as Linux does")
def test_a_package_that_cannot_be_written_and_no_home(tmp_path):
    """Compiled code goes to a folder of the user's own among the temporary files."""
    package = Path(storage.__file__).parents[2]
    code = "import os, jumpvision.films.frames.packed; print(os.environ['NUMBA_CACHE_DIR'])"
    gone = {"NUMBA_CACHE_DIR", "XDG_CACHE_HOME"}
    env = {k: v for k, v in os.environ.items() if k not in gone}
    env |= {"HOME": "/proc/none", "TMPDIR": str(tmp_path), "PYTHONPATH": str(package)}
    script = f'mount --bind "{package}" "{package}" && mount -o remount,ro,bind "{package}" && exec "$0" -c "$1"'
    call = ["unshare", "-rm", "sh", "-c", script, sys.executable, code]
    done = subprocess.run(call, capture_output=True, text=True, env=env, cwd=tmp_path)
    if "unshare" in done.stderr or "mount" in done.stderr:
        pytest.skip(f"no right to mount here: {done.stderr.strip()}")
    assert done.returncode == 0, done.stderr
    own = Path(done.stdout.strip()).parent  # in it a folder a version
    assert own.parent == tmp_path and own.stat().st_mode & 0o777 == 0o700


def test_a_package_without_its_wheel_is_unknown_not_a_failure(monkeypatch):
    """conda-forge has OpenCV by another name."""
    import importlib.metadata as metadata

    from jumpvision.experiment.workflow.entries import versions

    known = metadata.version

    def version(name: str) -> str:
        if "opencv" in name:
            raise metadata.PackageNotFoundError(name)
        return known(name)

    monkeypatch.setattr(metadata, "version", version)
    assert versions.__wrapped__()["opencv-python-headless"] == "unknown"
    assert versions.__wrapped__()["numpy"] == known("numpy")


@pytest.mark.long
@pytest.mark.skipif(os.name == "nt", reason="modes of POSIX")
def test_a_run_needs_no_home_and_no_right_to_write_beside_the_package(tmp_path):
    """The package is copied to a folder that may not be written to; HOME is a folder that is not there, nor can be."""
    import jumpvision

    site = tmp_path / "site"
    shutil.copytree(Path(jumpvision.__file__).parent, site / "jumpvision", ignore=shutil.ignore_patterns("__pycache__"))
    campaign = write_campaign(tmp_path / "campaign", 1)
    folders = [site, *(d for d in site.rglob("*") if d.is_dir())]
    environment = {"PATH": os.environ["PATH"], "HOME": str(site / "none"), "PYTHONPATH": str(site)}
    call = [sys.executable, "-c", "import sys; from jumpvision.cli import main; sys.exit(main())", "run", str(campaign)]
    if os.getuid() == 0:  # root obeys modes only without this right
        if shutil.which("setpriv") is None:
            pytest.skip("root may write anywhere, and setpriv is not here to take that right away")
        call = ["setpriv", "--bounding-set=-dac_override", "--inh-caps=-dac_override", *call]
    for d in folders:
        d.chmod(0o555)
    try:
        call += ["--results", str(tmp_path / "results")]
        run = subprocess.run(call, env=environment, capture_output=True, text=True, cwd=tmp_path)
    finally:
        for d in folders:
            d.chmod(0o755)
    assert run.returncode == 0, run.stderr[-2000:]
    assert (tmp_path / "results" / "jump-0000" / "fits.json").exists()
    assert not list(site.rglob("__pycache__"))  # it could not write there, and did not need to
