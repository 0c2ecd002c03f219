"""`check` finds what `run` would, and what is odd: each with its number and the likely remedy. (About 10 s.)"""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from shared import SAMPLES

from jumpvision.base.schema import InputError
from jumpvision.cli import main
from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.experiment.stages.preflight import preflight
from jumpvision.experiment.stages.rod import other_spring
from tests.worlds.small import edit, write_campaign


def said(path: Path) -> list[str]:
    problems, warnings = preflight(open_experiment(path))
    assert problems == []
    return [w["message"] for w in warnings]


def test_a_sound_folder_raises_no_suspicion(folder, capsys):
    assert said(folder) == []
    assert main(["check", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["warnings"] == []


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
    "a log in millimetres": (scaled_log(1, 1e3), ("[motor_log] gives 4 m", "1e+03 times", "mm")),
    "a log of a thousandth": (scaled_log(1, 1e-3), ("[motor_log] gives 4e-06 m",)),
    "a log in milliseconds": (scaled_log(0, 1e3), ("[motor_log] moves from about 69 s", "start = 0.05", "in ms")),
    "a log of another clock": (late_log, ("[motor_log] moves from about 0.1", "start = 0.05", "common clock")),
    "another jump's amplitude": (
        toml("amplitude = 0.004", "amplitude = 0.04"),
        ("[motor_log] gives 0.004 m", "this experiment"),
    ),
    "a mark outside": (toml("[robot]", MARKS), ("mark 2 = 400, 80", "48 x 90", "outside")),
    "a ball in millimetres": (toml("scale = 5e-4", "scale = 5e-7"), ("1.9e+04 px", "mm")),
}


@pytest.mark.parametrize("what", ODD)
def test_what_is_odd_is_a_warning_with_its_number(what, folder):
    act, parts = ODD[what]
    act(folder)
    (text,) = said(folder)
    assert all(part in text for part in parts), text


def test_a_folder_named_after_another_jump(folder):
    for name, doubted in (("stutter-8Hz-1", ""), ("8.0Hz", ""), ("single_8Hz", "kind"), ("delayed-stutter-8Hz", "kind"),
                          ("stutter 8.2 Hz", "frequency")):  # fmt: skip
        folder = folder.rename(folder.parent / name)
        assert [doubted in t for t in said(folder)] == ([True] if doubted else [])


@pytest.mark.xfail(strict=True, reason="a free flight is found in a ringing of 3 g, and g is doubted before the spring")
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
    f = math.sqrt(5760.6 / 1.178) / (2 * math.pi)  # a hidden cause is no slip of units: 1.4 is not doubted, 1.5 is
    assert other_spring(f, 5760.6 * 1.4, 1.178) is other_spring(f, 5760.6 / 1.4, 1.178) is None
    assert "5761 N/m" in str(other_spring(f, 5760.6 * 1.5, 1.178))


def test_the_lens_of_a_crop_has_its_centre_where_the_sensor_has_it(folder):
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
    samples = SAMPLES / "hard_ground"
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


def test_what_a_run_refuses_in_a_log_or_a_field_check_refuses(folder):
    """A force that is no number, and a field that is none."""
    rows = (folder / "motor.csv").read_text().splitlines()
    told = [r + (",force_N" if i == 0 else ",nan" if i == 7 else ",1.0") for i, r in enumerate(rows)]
    (folder / "motor.csv").write_text("\n".join(told) + "\n")
    (folder / "field.nc").write_bytes(b"no field")
    with (folder / "experiment.toml").open("a") as file:
        file.write('\n[piv_field]\nfile = "field.nc"\n')
    problems, _ = preflight(open_experiment(folder))
    assert any("row 7, force_N = 'nan'" in p for p in problems) and any("field.nc" in p for p in problems)
