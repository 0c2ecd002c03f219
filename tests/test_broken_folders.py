"""Broken folders: one clear error, exit code 1 or 2, no traceback, no partial result, nothing written to the input."""

from __future__ import annotations

import shutil
from pathlib import Path

import av
import numpy as np
import pytest

from jumpvision.cli import main
from jumpvision.laboratory import write

TOML = """
ground = "hard"
[robot]
motor_mass = 1.0
rod_mass = 0.2
spring_stiffness = 5000.0
[actuation]
kind = "stutter"
frequency = 8.0
amplitude = 0.004
start = 0.05
[rod_video]
file = "rod.avi"
scale = 5e-4
ball_diameter = 0.0095
[motor_log]
file = "motor.csv"
[contact_log]
file = "contact.csv"
[model]
terms = []
"""
GRAINS = """
[grain_video]
file = "grains.npy"
frame_rate = 500.0
scale = 3e-4
foot_row = 12.0
axis_column = 30.0
"""


def ball_film(n: int = 24) -> np.ndarray:
    """A bright disc that rises and falls; drawn coarsely, which is enough here."""
    y, x = np.mgrid[:90, :48]
    rng = np.random.default_rng(1)
    frames = []
    for i in range(n):
        r = np.hypot(x - 24.3, y - (60 - 0.08 * i * (n - i)))
        frames.append(20 + 180 * np.clip(9.5 - r + 0.5, 0, 1) + rng.normal(0, 2, x.shape))
    return np.clip(np.stack(frames), 0, 255).astype(np.uint8)


@pytest.fixture(scope="session")
def sound(tmp_path_factory) -> Path:
    """A small experiment that runs without an error."""
    folder = tmp_path_factory.mktemp("sound") / "exp"
    folder.mkdir()
    (folder / "experiment.toml").write_text(TOML)
    write.film(folder / "rod.avi", ball_film(), rate=200.0)
    t = np.arange(0, 0.4, 1e-3)
    phase = 2 * np.pi * 8 * np.clip(t - 0.05, 0, 0.125)
    rows = [f"{a:.4f},{0.004 * (np.cos(b) - 1):.7f}" for a, b in zip(t, phase)]
    (folder / "motor.csv").write_text("time_s,position_m\n" + "\n".join(rows) + "\n")
    (folder / "contact.csv").write_text("time_s,contact\n" + "\n".join(f"{a:.4f},{int(a < 0.12)}" for a in t) + "\n")
    return folder


@pytest.fixture
def folder(sound, tmp_path) -> Path:
    target = tmp_path / "campaign" / "exp"
    shutil.copytree(sound, target)
    return target


def edit(folder: Path, old: str, new: str) -> None:
    file = folder / "experiment.toml"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def rewrite(name, change):
    def act(folder: Path) -> None:
        file = folder / name
        file.write_bytes(change(file.read_bytes()))

    return act


def lines(change):
    """Change the list of lines of a text file."""
    return lambda data: b"\n".join(change(data.split(b"\n")))


def replaced(i, text):
    return lines(lambda rows: [*rows[:i], text, *rows[i + 1 :]])


def toml(old, new):
    return lambda folder: edit(folder, old, new)


def grains(*arrays, toml_text=GRAINS):
    def act(folder: Path) -> None:
        (folder / "experiment.toml").write_text(toml_text)
        np.save(folder / "grains.npy", *arrays)

    return act


def images_of_two_sizes(folder: Path) -> None:
    (folder / "film").mkdir()
    for i, shape in enumerate(((40, 30), (40, 30), (41, 30))):
        write.picture(folder / "film" / f"{i}.png", np.full(shape, 50, np.uint8))
    edit(folder, '"rod.avi"', '"film"\nframe_rate = 200.0')


def second_with_the_same_name(folder: Path) -> None:
    shutil.copytree(folder, folder.parent / "two")
    for f in (folder, folder.parent / "two"):
        edit(f, 'ground = "hard"', 'name = "same"\nground = "hard"')


def empty_film(folder: Path) -> None:
    (folder / "rod.avi").unlink()
    with av.open(str(folder / "rod.avi"), "w") as container:
        stream = container.add_stream("ffv1", rate=200)
        stream.width, stream.height, stream.pix_fmt = 48, 90, "gray"
        container.start_encoding()


def dark_film(folder: Path) -> None:
    write.film(folder / "rod.avi", np.full((20, 90, 48), 30, np.uint8), rate=200.0)


NOISE = np.random.default_rng(0).integers(0, 255, (4, 60, 80), dtype=np.uint8)
BROKEN = {  # name: (how it is broken, what the message must say)
    "missing film": (lambda f: (f / "rod.avi").unlink(), ("[rod_video]", "rod.avi", "no such file")),
    "film cut in the middle": (rewrite("rod.avi", lambda d: d[: len(d) // 2]), ("rod.avi", "truncated")),
    "film cut in its header": (rewrite("rod.avi", lambda d: d[:60]), ("rod.avi",)),
    "film of 0 bytes": (rewrite("rod.avi", lambda d: b""), ("rod.avi", "0 bytes")),
    "film without frames": (empty_film, ("rod.avi",)),
    "text named .avi": (rewrite("rod.avi", lambda d: b"these are not frames\n" * 50), ("rod.avi",)),
    "film without a ball": (dark_film, ("rod.avi", "no ball")),
    "unknown film format": (
        lambda f: (edit(f, "rod.avi", "rod.xyz"), (f / "rod.xyz").write_bytes(b"1234")), ("rod.xyz", "allowed")),
    "frames of two sizes": (images_of_two_sizes, ("2.png",)),
    "five channels": (grains(np.zeros((3, 40, 50, 5), np.uint8)), ("grains.npy",)),
    "one grain frame": (grains(NOISE[:1]), ("grains.npy", "pair")),
    "grains without a foot": (grains(NOISE, toml_text=GRAINS.replace("12.0", "1200.0")), ("foot_row", "1200")),
    "empty log": (rewrite("motor.csv", lambda d: b""), ("motor.csv", "0 bytes")),
    "header only": (rewrite("motor.csv", lines(lambda r: r[:1])), ("motor.csv", "rows")),
    "NaN in a log": (rewrite("motor.csv", replaced(7, b"0.0060,nan")), ("motor.csv", "row 7", "position_m", "nan")),
    "word in a log": (rewrite("motor.csv", replaced(7, b"0.0060,oops")), ("motor.csv", "row 7", "'oops'")),
    "time goes back": (rewrite("motor.csv", replaced(7, b"0.0010,0")), ("motor.csv", "row 7", "goes back")),
    "time repeats": (rewrite("contact.csv", replaced(7, b"0.0050,1")), ("contact.csv", "row 7", "repeats")),
    "missing column": (rewrite("motor.csv", replaced(0, b"time_s,pos")), ("motor.csv", "position_m", "missing")),
    "binary log": (rewrite("motor.csv", lambda d: bytes(range(256)) * 20), ("motor.csv",)),
    "contact neither 0 nor 1": (rewrite("contact.csv", replaced(7, b"0.0060,5")), ("contact.csv", "row 7", "0 or 1")),
    "millimetres for metres": (toml("scale = 5e-4", "scale = 0.5"), ("[rod_video]", "scale = 0.5", "0.01] m/px")),
    "amplitude in millimetres": (toml("amplitude = 0.004", "amplitude = 4.0"), ("amplitude = 4.0", "m")),
    "negative mass": (toml("motor_mass = 1.0", "motor_mass = -1.0"), ("motor_mass = -1.0", "kg")),
    "NaN stiffness": (toml("5000.0", "nan"), ("spring_stiffness = nan",)),
    "unknown key": (toml("rod_mass", "rodmass"), ("rodmass", "did you mean 'rod_mass'")),
    "unknown section": (toml("[robot]", "[robott]"), ("[robott]", "did you mean 'robot'")),
    "not TOML": (toml("[robot]", "[robot"), ("not valid TOML", "line")),
    "not UTF-8": (rewrite("experiment.toml", lambda d: d + b"# \xff\xfe"), ("UTF-8",)),
    "no experiment.toml": (lambda f: (f / "experiment.toml").unlink(), ("experiment.toml",)),
    "scale missing": (toml("scale = 5e-4\n", ""), ("scale", "missing")),
    "mass missing": (toml("motor_mass = 1.0\n", ""), ("[robot] motor_mass", "missing")),
    "sand without parameters": (
        toml('ground = "hard"\n[robot]', 'ground = "granular"\n[robot]\nfoot_mass = 0.04'),
        ("granular ground needs exactly one static force",)),
    "unknown mechanism": (toml("terms = []", 'terms = ["magic"]'), ("unknown mechanism 'magic'",)),
    "a path that leads out": (toml('"motor.csv"', '"../../../motor.csv"'), ("[motor_log]", "outside")),
    "two experiments of one name": (second_with_the_same_name, ("same", "unique")),
}  # fmt: skip


def run(folder: Path, results: Path, capsys, *options: str) -> tuple[int, str, str]:
    code = main(["run", str(folder), "--results", str(results), "--no-pictures", *options])
    out, err = capsys.readouterr()
    return code, out, err


def test_the_sound_folder_runs(folder, tmp_path, capsys):
    code, _, err = run(folder, tmp_path / "results", capsys)
    assert code == 0, err
    assert (tmp_path / "results" / "summary.json").exists()


@pytest.mark.parametrize("name", BROKEN)
def test_broken(name, folder, tmp_path, capsys):
    act, parts = BROKEN[name]
    act(folder)
    before = {f: f.stat().st_mtime_ns for f in folder.parent.rglob("*")}
    results = tmp_path / "results"
    path = folder.parent if "two experiments" in name else folder
    code, _, err = run(path, results, capsys)
    assert code in (1, 2), err
    said = [t for t in err.splitlines() if t.startswith(("jumpvision: ", "error: "))]
    assert len(said) == 1, err
    for part in parts:
        assert part in said[0], said[0]
    assert "Traceback" not in err
    assert {f: f.stat().st_mtime_ns for f in folder.parent.rglob("*")} == before
    if code == 2:
        assert not results.exists()
    else:
        assert not (results / "summary.json").exists()
        assert not list(results.glob(".cache/writing-*"))


def test_all_problems_are_found_when_two_recordings_are_bad(folder, tmp_path, capsys):
    (folder / "motor.csv").write_text("time_s,position_m\n0,x\n1,y\n2,z\n")
    rewrite("rod.avi", lambda d: b"no film" * 20)(folder)
    code, _, err = run(folder, tmp_path / "results", capsys)
    said = [t for t in err.splitlines() if t.startswith("error: ")]
    assert code == 1
    assert any("rod.avi" in t for t in said)


def test_a_failed_rerun_takes_the_old_result_away(folder, tmp_path, capsys):
    """What lies in the results folder always belongs to the recordings as they are now."""
    results = tmp_path / "results"
    run(folder, results, capsys)
    assert (results / "track.csv").exists()
    dark_film(folder)
    code, *_ = run(folder, results, capsys)
    assert code == 1
    assert not (results / "track.csv").exists()
    assert not (results / "summary.json").exists()


def test_the_other_experiments_of_a_campaign_go_on(folder, tmp_path, capsys):
    shutil.copytree(folder, folder.parent / "bad")
    dark_film(folder.parent / "bad")
    code, _, err = run(folder.parent, tmp_path / "results", capsys, "--workers", "1")
    assert code == 1
    assert (tmp_path / "results" / "exp" / "summary.json").exists()
    assert not (tmp_path / "results" / "bad" / "summary.json").exists()
    assert "no ball" in (tmp_path / "results" / "jumps.csv").read_text()
    assert "1 of 2 experiments done" in err


def test_a_stage_without_its_recording_says_what_it_needs(folder, tmp_path, capsys):
    assert main(["bed", str(folder), "--results", str(tmp_path / "r")]) == 2
    assert "bed needs [bed_image]" in capsys.readouterr().err
    assert not (tmp_path / "r").exists()


def test_a_stage_runs_where_a_campaign_has_its_recording(folder, tmp_path, capsys):
    (folder.parent / "other").mkdir()
    (folder.parent / "other" / "experiment.toml").write_text("")
    assert main(["track", str(folder.parent), "--results", str(tmp_path / "r"), "--workers", "1"]) == 0
    assert (tmp_path / "r" / "exp" / "track.csv").exists()
    assert not (tmp_path / "r" / "other").exists()


@pytest.mark.parametrize(
    "call", [["run"], ["run", "/does/not/exist"], ["frobnicate"], ["track", ".", "--nope"], ["params", "nope"]]
)
def test_a_wrong_call_ends_with_code_2(call, capsys):
    assert main(call) == 2
    err = capsys.readouterr().err
    assert err.startswith("jumpvision: ")
    assert "Traceback" not in err


def test_a_film_alone_is_fine_and_claims_nothing_it_cannot_know(folder, tmp_path, capsys):
    """No actuation: no rest, no jump height, no ring-down of what may be a driven motion."""
    (folder / "experiment.toml").write_text('[rod_video]\nfile = "rod.avi"\nscale = 5e-4\nball_diameter = 0.0095\n')
    code, out, err = run(folder, tmp_path / "r", capsys)
    assert code == 0, err
    text = (tmp_path / "r" / "summary.json").read_text()
    for key in ("jump_height_m", "zeta", "frequency_hz", "simulated_height_m"):
        assert f'"{key}": null' in text
    assert "true" not in out


@pytest.mark.parametrize("key", ["{} = 1", "[{}]", "x = {{ {} = 1 }}"])
def test_a_key_of_endless_parts_is_refused_at_once(tmp_path, key):
    """tomllib took over a minute for 100,000 parts, and read them."""
    from time import process_time

    from jumpvision.experiment.inputs.model import read_toml

    file = tmp_path / "experiment.toml"
    file.write_text("ground = 'hard'\n" + key.format(".".join("a" * 100_000)) + "\n")
    begun = process_time()
    _, (said,) = read_toml(file)
    assert process_time() - begun < 1.0 and "line 2: a key of more than 100 parts" in said
    file.write_text(f"name = '{'.' * 500}'\nlist = [{'0.5, ' * 300}]\nwhat = \"{'a.' * 200}\" # {'.' * 99}\n")
    assert read_toml(file)[1] == []
