"""Broken folders: one clear error, exit code 1 or 2, no traceback, no partial result, nothing written to the input."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from jumpvision.cli import main
from jumpvision.experiment.inputs.model import read_toml
from jumpvision.laboratory import write
from tests.worlds.small import edit

GRAINS = """
[grain_video]
file = "grains.npy"
frame_rate = 500.0
scale = 3e-4
foot_row = 12.0
axis_column = 30.0
"""


def rewrite(name, change):
    def act(folder: Path) -> None:
        file = folder / name
        file.write_bytes(change(file.read_bytes()))

    return act


def replaced(i, text):
    """Another text in line i."""
    return lambda data: b"\n".join([*(rows := data.split(b"\n"))[:i], text, *rows[i + 1 :]])


def toml(old, new):
    return lambda folder: edit(folder, old, new)


def grains(array, toml_text=GRAINS):
    def act(folder: Path) -> None:
        (folder / "experiment.toml").write_text(toml_text)
        np.save(folder / "grains.npy", array)

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


def dark_film(folder: Path) -> None:
    write.film(folder / "rod.avi", np.full((20, 90, 48), 30, np.uint8), rate=200.0)


NOISE = np.random.default_rng(0).integers(0, 255, (4, 60, 80), dtype=np.uint8)
BROKEN = {  # name: (how it is broken, what the message must say); what else is wrong with files is in odd_files.py
    "missing film": (lambda f: (f / "rod.avi").unlink(), ("[rod_video]", "rod.avi")),
    "film cut in the middle": (rewrite("rod.avi", lambda d: d[: len(d) // 2]), ("rod.avi", "truncated")),
    "film of 0 bytes": (rewrite("rod.avi", lambda d: b""), ("rod.avi",)),
    "frames of two sizes": (images_of_two_sizes, ("2.png",)),
    "NaN in a log": (rewrite("motor.csv", replaced(7, b"0.0060,nan")), ("motor.csv", "row 7", "position_m", "nan")),
    "missing column": (rewrite("motor.csv", replaced(0, b"time_s,Pos [mm]")), ("motor.csv", "position_m", "Pos [mm]")),
    "scale missing": (toml("scale = 5e-4\n", ""), ("scale", "missing")),
    "mass missing": (toml("motor_mass = 1.0\n", ""), ("[robot] motor_mass", "missing")),
    "film without a ball": (dark_film, ("rod.avi", "no ball")),
    "one grain frame": (grains(NOISE[:1]), ("grains.npy",)),
    "grains without a foot": (grains(NOISE, GRAINS.replace("12.0", "1200.0")), ("foot_row", "1200")),
    "contact neither 0 nor 1": (rewrite("contact.csv", replaced(7, b"0.0060,5")), ("contact.csv", "row 7")),
    "millimetres for metres": (toml("scale = 5e-4", "scale = 0.5"), ("[rod_video]", "scale = 0.5", "0.01] m/px")),
    "unknown key": (toml("rod_mass", "rodmass"), ("rodmass", "'rod_mass'")),
    "not TOML": (toml("[robot]", "[robot"), ("experiment.toml", "line")),
    "no experiment.toml": (lambda f: (f / "experiment.toml").unlink(), ("experiment.toml",)),
    "sand without parameters": (
        toml('ground = "hard"\n[robot]', 'ground = "granular"\n[robot]\nfoot_mass = 0.04'), ("static force",)),
    "unknown mechanism": (toml("terms = []", 'terms = ["magic"]'), ("'magic'",)),
    "a path that leads out": (toml('"motor.csv"', '"../../../motor.csv"'), ("[motor_log]", "outside")),
    "two experiments of one name": (second_with_the_same_name, ("same", "unique")),
}  # fmt: skip
ONLY_BY_RUN = {"film without a ball", "one grain frame", "grains without a foot", "sand without parameters"}


def run(folder: Path, results: Path, *options: str) -> int:
    return main(["run", str(folder), "--results", str(results), "--no-pictures", *options])


@pytest.mark.parametrize("name", BROKEN)
def test_check_and_run_refuse_in_one_line_and_write_nothing(name, folder, tmp_path, capsys):
    act, parts = BROKEN[name]
    act(folder)
    before = {f: f.stat().st_mtime_ns for f in folder.parent.rglob("*")}
    results = tmp_path / "results"
    path = folder.parent if "two experiments" in name else folder
    codes = {}
    for command in ("check", "run"):
        codes[command] = run(path, results) if command == "run" else main(["check", str(path)])
        err = capsys.readouterr().err
        if command == "check" and name in ONLY_BY_RUN:
            continue
        said = [t for t in err.splitlines() if t.startswith(("jumpvision: ", "error: "))]
        assert len(said) == 1 and all(part in said[0] for part in parts) and "Traceback" not in err, err
    assert codes["run"] in (1, 2) and codes["check"] == (0 if name in ONLY_BY_RUN else 2)
    assert {f: f.stat().st_mtime_ns for f in folder.parent.rglob("*")} == before
    if codes["run"] == 2:
        assert not results.exists()
    assert not (results / "summary.json").exists() and not list(results.glob(".cache/writing-*"))


def test_a_failed_rerun_takes_the_old_result_away(folder, tmp_path):
    """What lies in the results folder always belongs to the recordings as they are now."""
    results = tmp_path / "results"
    assert run(folder, results) == 0
    assert (results / "track.csv").exists() and (results / "summary.json").exists()
    dark_film(folder)
    assert run(folder, results) == 1
    assert not (results / "track.csv").exists() and not (results / "summary.json").exists()


def test_the_other_experiments_of_a_campaign_go_on(folder, tmp_path):
    shutil.copytree(folder, folder.parent / "bad")
    dark_film(folder.parent / "bad")
    results = tmp_path / "results"
    assert run(folder.parent, results, "--workers", "1") == 1
    assert (results / "exp" / "summary.json").exists() and not (results / "bad" / "summary.json").exists()
    assert "no ball" in (results / "jumps.csv").read_text()


def test_a_stage_runs_where_a_campaign_has_its_recording(folder, tmp_path, capsys):
    assert main(["bed", str(folder), "--results", str(tmp_path / "r")]) == 2
    assert "[bed_image]" in capsys.readouterr().err and not (tmp_path / "r").exists()
    (folder.parent / "other").mkdir()
    (folder.parent / "other" / "experiment.toml").write_text("")
    assert main(["track", str(folder.parent), "--results", str(tmp_path / "r"), "--workers", "1"]) == 0
    assert (tmp_path / "r" / "exp" / "track.csv").exists() and not (tmp_path / "r" / "other").exists()


def test_a_wrong_call_ends_with_code_2(capsys):
    for call in (["run"], ["run", "/does/not/exist"], ["frobnicate"], ["track", ".", "--nope"], ["params", "nope"]):
        assert main(call) == 2
        err = capsys.readouterr().err
        assert err.startswith("jumpvision: ") and "Traceback" not in err


def test_a_film_alone_is_fine_and_claims_nothing_it_cannot_know(folder, tmp_path):
    """No actuation: no rest, no jump height, no ring-down of what may be a driven motion."""
    (folder / "experiment.toml").write_text('[rod_video]\nfile = "rod.avi"\nscale = 5e-4\nball_diameter = 0.0095\n')
    assert run(folder, tmp_path / "r") == 0
    text = (tmp_path / "r" / "summary.json").read_text()
    assert all(f'"{k}": null' in text for k in ("jump_height_m", "zeta", "frequency_hz", "simulated_height_m"))


def test_a_key_of_endless_parts_is_refused_before_it_is_read(tmp_path):
    """tomllib took over a minute for 100,000 parts, and read them."""
    file = tmp_path / "experiment.toml"
    for key in ("{} = 1", "[{}]", "x = {{ {} = 1 }}"):
        file.write_text("ground = 'hard'\n" + key.format(".".join("a" * 5_000)) + "\n")
        (said,) = read_toml(file)[1]
        assert "line 2" in said and "more than 100 parts" in said
    file.write_text(f"name = '{'.' * 500}'\nlist = [{'0.5, ' * 300}]\nwhat = \"{'a.' * 200}\" # {'.' * 99}\n")
    assert read_toml(file)[1] == []
