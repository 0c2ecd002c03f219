"""`check` finds what `run` would, and what is odd: each with its number and the likely remedy. (About 10 s.)"""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from fault_lab import write_campaign
from test_broken_folders import BROKEN, GRAINS, edit, folder, sound  # noqa: F401  (fixtures)

from jumpvision.base.schema import InputError
from jumpvision.cli import main
from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.experiment.stages.preflight import preflight
from jumpvision.experiment.stages.rod import other_spring


def said(path: Path) -> list[str]:
    problems, warnings = preflight(open_experiment(path))
    assert problems == []
    return [w["message"] for w in warnings]


def test_a_sound_folder_raises_no_suspicion(folder, capsys):  # noqa: F811
    assert said(folder) == []
    assert main(["check", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["warnings"] == []


SOON = {  # what a run finds in the recordings, of test_broken_folders: check finds it, too
    "film cut in its header", "text named .avi", "film of 0 bytes", "film without frames", "five channels",
    "frames of two sizes", "header only", "NaN in a log", "word in a log", "time goes back", "time repeats",
    "missing column", "binary log", "scale missing", "mass missing", "film cut in the middle",
}  # fmt: skip


@pytest.mark.parametrize("name", sorted(SOON))
def test_check_finds_what_a_run_would(name, folder, capsys):  # noqa: F811
    act, parts = BROKEN[name]
    act(folder)
    before = {f: f.stat().st_mtime_ns for f in folder.rglob("*")}
    assert main(["check", str(folder)]) == 2
    problems = [t for t in capsys.readouterr().err.splitlines() if t.startswith("jumpvision: ")]
    assert len(problems) == 1, problems
    for part in parts:
        assert part in problems[0]
    assert {f: f.stat().st_mtime_ns for f in folder.rglob("*")} == before


def test_a_film_without_a_frame_rate_is_a_problem(folder, capsys):  # noqa: F811
    np.save(folder / "grains.npy", np.zeros((4, 60, 80), np.uint8))
    toml = folder / "experiment.toml"
    toml.write_text(toml.read_text() + GRAINS.replace("frame_rate = 500.0", ""))
    assert main(["check", str(folder)]) == 2
    assert "frame_rate" in capsys.readouterr().err


def test_a_foreign_header_is_a_problem(folder, capsys):  # noqa: F811
    """As a drive's own software writes it."""
    log = folder / "motor.csv"
    log.write_text(log.read_text().replace("time_s,position_m", "Time [ms],ActPos [mm]"))
    assert main(["check", str(folder)]) == 2
    assert "column time_s missing; the header is 'Time [ms],ActPos [mm]'" in capsys.readouterr().err


def scaled_log(column: int, factor: float):
    def act(path: Path) -> None:
        rows = (path / "motor.csv").read_text().splitlines()
        table = [[float(v) for v in r.split(",")] for r in rows[1:]]
        for r in table:
            r[column] *= factor
        (path / "motor.csv").write_text(rows[0] + "\n" + "".join(f"{a:.7g},{b:.7g}\n" for a, b in table))

    return act


def late_log(path: Path) -> None:
    rows = (path / "motor.csv").read_text().splitlines()
    table = [[float(v) for v in r.split(",")] for r in rows[1:]]
    late = [[0.001 * i, 0.0] for i in range(100)] + [[a + 0.1, b] for a, b in table]
    (path / "motor.csv").write_text(rows[0] + "\n" + "".join(f"{a:.7g},{b:.7g}\n" for a, b in late))


def toml(old: str, new: str):
    return lambda path: edit(path, old, new)


MARKS = "[calibration]\nmarks = [[10, 10, 0, 0.04], [400, 80, 0, 0]]\n[robot]"
ODD = {  # what is wrong: what is said
    "grams": (toml("motor_mass = 1.0", "motor_mass = 1003"), ("motor_mass = 1003 kg", "grams", "1.003")),
    "newtons a millimetre": (toml("5000.0", "5.0"), ("spring_stiffness = 5 N/m", "2.35 m", "N/mm", "5000")),
    "start in milliseconds": (toml("start = 0.05", "start = 200"), ("[actuation] lasts from 200", "never meet")),
    "a log in millimetres": (scaled_log(1, 1e3), ("position_m moves by 8 m", "1e+03 times", "mm")),
    "a log in milliseconds": (scaled_log(0, 1e3), ("[motor_log] moves from about 69 s", "start = 0.05", "in ms")),
    "a log of another clock": (late_log, ("[motor_log] moves from about 0.1", "start = 0.05", "common clock")),
    "another jump's amplitude": (
        toml("amplitude = 0.004", "amplitude = 0.04"),
        ("moves by 0.008 m", "this experiment"),
    ),
    "a mark outside": (toml("[robot]", MARKS), ("mark 2 = 400, 80", "48 x 90", "outside")),
    "a ball in millimetres": (toml("scale = 5e-4", "scale = 5e-7"), ("1.9e+04 px", "mm")),
}


@pytest.mark.parametrize("what", ODD)
def test_what_is_odd_is_a_warning_with_its_number_and_remedy(what, folder, capsys):  # noqa: F811
    act, parts = ODD[what]
    act(folder)
    (text,) = said(folder)
    for part in parts:
        assert part in text, text
    assert main(["check", str(folder)]) == 0
    assert f"warning: {folder.name}: {text}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "doubted"),
    [("stutter-8Hz-1", ""), ("8.0Hz", ""), ("single_8Hz", "kind"), ("delayed-stutter-8Hz", "kind"),
     ("stutter-9Hz", "frequency"), ("stutter 8.2 Hz", "frequency")],
)  # fmt: skip
def test_a_folder_named_after_another_jump(folder, name, doubted):  # noqa: F811
    target = folder.rename(folder.parent / name)
    texts = said(target)
    assert [doubted in t for t in texts] == ([True] if doubted else [])


def test_a_track_in_millimetres_and_one_of_another_spring(tmp_path):
    """Truth: a robot of 1.178 kg that rings at 20 Hz on a spring said to have 5760.6 N/m, which would be 11.1 Hz."""
    path = write_campaign(tmp_path / "campaign", 1) / "jump-0000"
    assert said(path) == []
    t = np.arange(0, 3.0, 0.004)
    ring = 2e-3 * np.exp(-0.3 * t) * np.sin(2 * math.pi * 20.0 * t) + np.random.default_rng(0).normal(0, 1e-5, t.size)
    np.savetxt(path / "rod_track.csv", np.column_stack([t, ring]), "%.7f", ",", header="time_s,height_m", comments="")
    (text,) = said(path)
    stiffness = 1.178 * (2 * math.pi * 20.0) ** 2
    assert "rings at 20 Hz" in text and "11.1 Hz" in text and f"{stiffness:.4g} N/m"[:4] in text
    rows = np.column_stack([t, 1e4 * ring])
    np.savetxt(path / "rod_track.csv", rows, "%.7f", ",", header="time_s,height_m", comments="")
    assert any("in mm? then divide by 1000" in x for x in said(path))


def test_a_spring_may_be_off_by_a_third():
    """A hidden cause is no slip of units: a stiffness off by 1.4 is not doubted, one off by 1.5 is."""
    f = math.sqrt(5760.6 / 1.178) / (2 * math.pi)
    assert other_spring(f, 5760.6 * 1.4, 1.178) is other_spring(f, 5760.6 / 1.4, 1.178) is None
    assert "5761 N/m" in str(other_spring(f, 5760.6 * 1.5, 1.178))


def test_every_problem_of_a_campaign_at_once(folder, capsys):  # noqa: F811
    shutil.copytree(folder, folder.parent / "two")
    for f in (folder, folder.parent / "two"):
        (f / "motor.csv").write_text("a,b\n1,2\n")
    assert main(["check", str(folder.parent)]) == 2
    assert capsys.readouterr().err.count("column time_s missing") == 2
    with pytest.raises(InputError):
        open_experiment(folder.parent / "none")


def test_the_lens_of_a_crop_has_its_centre_where_the_sensor_has_it(folder):  # noqa: F811
    """A crop at (700, 300) of a sensor of 1280 x 1024: its axis lies at (-60.5, 211.5), outside it. Without a centre
    the heights were 0.23 mm off at a stated 2 um, and the right one drew the warning."""
    toml = folder / "experiment.toml"
    plain = toml.read_text()

    def with_lens(**keys):
        lines = "".join(f"{k} = {v}\n" for k, v in keys.items())
        toml.write_text(f"{plain}\n[calibration]\n{lines}")
        return [w for w in said(folder) if "[calibration]" in w]

    (told,) = with_lens(k1=2e-8)
    assert "k1 without centre" in told and 'Give sensor = "whole", or centre = [column, row]' in told
    assert with_lens(k1=2e-8, sensor='"whole"') == []
    assert with_lens(k1=2e-8, centre=[-60.5, 211.5]) == []
    (told,) = with_lens(k1=2e-8, centre=[-6050.0, 211.5])
    assert "would move a corner of [rod_video]" in told
    with pytest.raises(InputError, match='sensor = "whole": beside centre'):
        with_lens(k1=2e-8, sensor='"whole"', centre=[1.0, 2.0])


def test_times_in_ms_are_said_by_check_and_run_and_neither_fails(tmp_path, capsys):
    """Both logs of hard ground a thousand times as long: the same warnings, and no fit that divides by nothing."""
    samples = Path(__file__).parents[1] / "data_samples" / "hard_ground"
    shutil.copytree(samples, tmp_path / "jump", ignore=shutil.ignore_patterns("truth.json"))
    for name in ("motor", "contact"):
        file = tmp_path / "jump" / f"{name}.csv"
        head, *rows = file.read_text().splitlines()
        late = [f"{1e3 * float(row.partition(',')[0]):.6f},{row.partition(',')[2]}" for row in rows]
        file.write_text("\n".join([head, *late]) + "\n")
    assert main(["check", str(tmp_path / "jump")]) == 0
    checked = [x for x in capsys.readouterr().err.splitlines() if "in ms?" in x]
    assert len(checked) >= 3
    assert main(["run", str(tmp_path / "jump"), "--no-pictures"]) == 0
    ran = capsys.readouterr().err
    for text in checked:
        assert text.removeprefix("warning: jump: ") in ran
    fits = json.loads((tmp_path / "results" / "jump" / "fits.json").read_text())
    assert "are its times in ms?" in fits["actuator_ratio"]["reason"]


@pytest.mark.parametrize("given", [(), ("bed_image",), ("bed_image", "rod_video"), ("robot", "model")])
def test_check_and_run_lack_the_same_keys(given, tmp_path, capsys):
    """Of a jump on sand with a track, a bed and a robot, whose sections give nothing but their files."""
    sand = Path(__file__).parents[1] / "data_samples" / "loose_sand" / "stutter-7.0Hz-film"
    jump = tmp_path / "jump"
    jump.mkdir()
    for name in ("rod.avi", "bed.png", "motor.csv"):
        shutil.copy(sand / name, jump / name)
    sections = {
        "bed_image": 'file = "bed.png"',
        "rod_video": 'file = "rod.avi"',
        "robot": "motor_mass = 1.0\nfoot_radius = 0.02",
        "model": "terms = []",
        "actuation": 'kind = "stutter"\nfrequency = 7.0\namplitude = 0.01',
        "motor_log": 'file = "motor.csv"',
    }
    named = {n: sections[n] for n in (*given, "actuation", "motor_log")}
    text = "\n".join(f"[{n}]\n{s}" for n, s in named.items())
    (jump / "experiment.toml").write_text(f'ground = "hard"\n{text}\n')
    code = main(["check", str(jump)])
    checked = {
        x.partition("experiment.toml: ")[2] for x in capsys.readouterr().err.splitlines() if "missing; give" in x
    }
    assert main(["run", str(jump), "--no-pictures"]) == (1 if checked else 0)
    ran = {x.partition("experiment.toml: ")[2] for x in capsys.readouterr().err.splitlines() if "missing; give" in x}
    assert code == (2 if checked else 0) and ran == checked
    assert bool(checked) == bool(given)


def test_the_motors_push_is_filtered_as_scipy_would():
    """To the last bit: the same substitution s = 2/T (z - 1)/(z + 1), without its polynomials as objects."""
    from scipy.signal import bilinear, lfilter

    from jumpvision.estimate.push import TICK, Pushed

    x = np.sin(40.0 * TICK * np.arange(300)) ** 2
    pushed = Pushed(TICK * np.arange(300), x, 0.83, 60.0, 0.1, 1e-3)
    for w, damping in ((18.0, 0.0), (57.3, 0.02), (210.0, 1.7)):
        b, a = bilinear([0.83, 0.0, 0.0], [1.0, 2.0 * damping * w, w * w], 1.0 / TICK)
        assert np.array_equal(pushed.moved(w, damping), -lfilter(b, a, x - x[0]))
