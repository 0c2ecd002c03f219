"""Folders: inheritance, every problem in one message, nothing written."""

from __future__ import annotations

import pytest

from jumpvision.experiment.inputs.experiment import is_campaign, open_campaign, open_experiment
from jumpvision.experiment.inputs.overrides import overrides_of
from jumpvision.experiment.inputs.sections import Actuation, MissingKey, MotorLog, Robot, need
from jumpvision.experiment.workflow.run import Pipeline, read_pipeline
from tests.worlds.small import make, problems_of

LOG = "time_s,position_m\n0,0\n0.001,0\n"


def test_an_experiment_inherits_its_campaign_key_by_key(tmp_path):
    (tmp_path / "campaign.toml").write_text(
        "ground = 'hard'\n[robot]\nmotor_mass = 1.0\nrod_mass = 0.2\n[robot.sigma]\nrod_mass = 0.01\n"
        "[params.track]\nsearch = 2.0\n"
    )
    make(tmp_path / "a", 'name = "first"\n[robot]\nmotor_mass = 1.5\n[motor_log]\nfile = "motor.csv"\n', motor_csv=LOG)
    make(tmp_path / "b")
    alone = open_experiment(tmp_path / "a")
    together = open_campaign(tmp_path).experiments
    assert alone == together[0]
    assert (alone.name, together[1].name) == ("first", "b")
    robot = alone.section(Robot)
    assert (robot.motor_mass, robot.rod_mass, robot.sigma.rod_mass) == (1.5, 0.2, 0.01)
    assert alone.ground == "hard"
    assert alone.params["track"]["search"] == 2.0
    assert alone.section(MotorLog).path == (tmp_path / "a" / "motor.csv")
    assert alone.section(Actuation) is None


def test_the_motor_stops_after_its_cycle_and_the_pause_in_it():
    law = {"frequency": 8.0, "amplitude": 0.01, "start": 0.25}
    assert Actuation(kind="stutter", **law).stop == 0.25 + 1 / 8
    assert Actuation(kind="delayed_stutter", delay=0.5, **law).stop == 0.25 + 1 / 8 + 0.5
    assert Actuation(kind="custom", start=0.25).stop == 0.25


def test_overrides_win_over_the_folder_which_wins_over_a_pipeline(tmp_path):
    make(tmp_path, "[params.piv]\nwindow = 48\n[robot]\nmotor_mass = 1.0\n")
    got = open_experiment(
        tmp_path,
        pipeline={"piv": {"window": 16, "step": 4}},
        overrides=overrides_of(("piv.gap=2", "robot.motor_mass=2.5", "track.polarity=dark")),
    )
    assert got.params == {"piv": {"window": 48, "step": 4, "gap": 2}, "track": {"polarity": "dark"}}
    assert got.section(Robot).motor_mass == 2.5


def test_every_problem_of_a_folder_in_one_error(tmp_path):
    make(
        tmp_path,
        "frobnicate = 3\n[robot]\nmotor_mass = -1\nrod_masss = 2\n[actuation]\nkind = 'stuter'\n[rod_video]\n"
        "file = 'x.avi'\nscale = 0.2\n[model]\nterms = ['inertial_dragg']\nalfa = 3\n[model.fit]\nalpha = [3, 1]\n"
        "[params.piv]\nwindw = 3\n[nonsense]\n",
    )
    problems = problems_of(open_experiment, tmp_path)
    wanted = ("frobnicate", "motor_mass = -1", "'rod_mass'", "'stutter'", "x.avi", "scale = 0.2", "'inertial_drag'",
              "'alpha'", "low must be below high", "'window'", "[nonsense]")  # fmt: skip
    for part in wanted:
        assert any(part in p for p in problems), part
    assert len(problems) == len(wanted)
    assert all("experiment.toml" in p for p in problems)
    assert [f.name for f in tmp_path.iterdir()] == ["experiment.toml"]


def test_one_problem_one_clear_line(tmp_path):
    for text, part in (
        ("robot = 3\n", "robot"), ("[motor_log]\nfile = 'nothere.csv'\n", "nothere.csv"), ("[motor_log]\n", "file"),
        ("[rod_video]\nfile = 'f/*.png'\n", "f/*.png"), ("schema = 2\n", "schema"), ("schema = 0\n", "schema"),
        ("name = 'a/b'\n", "name"), ("[actuation]\nkind = 'stutter'\ndelay = 0.1\ncycles = 2\n", "cycles"),
        ("[calibration]\nmarks = [[1,2,3]]\n", "marks"),
    ):  # fmt: skip
        (problem,) = problems_of(open_experiment, make(tmp_path / "e", text))
        assert part in problem
    make(tmp_path / "c" / "a", "[robot]\nmotor_mass = 0")
    make(tmp_path / "c" / "b", "[robot]\nrod_mass = 0")
    assert len(problems_of(open_campaign, tmp_path / "c")) == 2


def test_excluded_experiments_keep_their_reason(tmp_path):
    make(tmp_path / "a", 'exclude = "foot slipped"')
    make(tmp_path / "b")
    campaign = open_campaign(tmp_path)
    assert [e.name for e in campaign.experiments] == ["b"]
    assert campaign.excluded == {"a": "foot slipped"}


def test_campaign_or_experiment(tmp_path):
    make(tmp_path / "a")
    assert is_campaign(tmp_path)
    assert not is_campaign(tmp_path / "a")
    assert "no experiment.toml" in problems_of(open_experiment, tmp_path)[0]
    assert "does not exist" in problems_of(open_campaign, tmp_path / "none")[0]


def test_a_missing_key_is_named_with_unit_and_meaning():
    with pytest.raises(MissingKey) as e:
        need(Robot(rod_mass=0.1), "motor_mass", "rod_mass", "foot_radius")
    assert len(e.value.problems) == 2
    assert "[robot] motor_mass" in e.value.problems[0]
    assert "kg" in e.value.problems[0]


def test_settings_of_the_command_line():
    """bed is both a stage and a section; a number need not be written as TOML has it."""
    both = {"params": {"bed": {"method": "threshold"}}, "bed": {"width": 0.5}}
    assert overrides_of(("bed.method=threshold", "bed.width=0.5")) == both
    assert overrides_of(("labels.humidity=0.4",))["labels"] == {"humidity": 0.4}
    for text, value in ((".012", 0.012), ("5.", 5.0), ("-.5e-3", -5e-4), ("1.2.3", "1.2.3"), (".", ".")):
        assert overrides_of((f"model.delta={text}",)) == {"params": {}, "model": {"delta": value}}
    for bad in ("track.polarity", "nope.x=1", "track.polaritty=dark", "x=1"):
        assert bad.split("=")[0] in problems_of(overrides_of, (bad,))[0]


def test_pipeline_files(tmp_path):
    file = tmp_path / "p.toml"
    file.write_text('stages = ["piv"]\n[params.piv]\nwindow = 16\n')
    assert read_pipeline(file) == Pipeline(("piv",), {"piv": {"window": 16}})
    file.write_text('stages = ["rod", "spring", "summary"]\n')  # any stage, with parameters or without
    assert read_pipeline(file).stages == ("rod", "spring", "summary")
    file.write_text('stages = ["pivv"]\nextra = 1\n')
    assert len(problems_of(read_pipeline, file)) == 2
    assert "no such file; give one, or a name: granular" in problems_of(read_pipeline, tmp_path / "none.toml")[0]
