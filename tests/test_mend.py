"""Lines that would mend what varies: which they are, and that only an accepting user has them written."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import pytest
from diagnosis_sample import diagnosis
from test_varies_words import DAY, DRIFT, FASTER, LOST, NAMES, ODD, SCATTER, SOFT, varies

from jumpvision.base.schema import InputError
from jumpvision.engine.document.values import Suggested
from jumpvision.experiment.campaign.mend import accept, written
from jumpvision.experiment.inputs.experiment import open_campaign
from jumpvision.jumper.question.suggest import Written, suggested
from jumpvision.jumper.question.words import words_of
from tests.worlds.small import make, problems_of

WORDS = words_of(diagnosis())
VALUES = {
    ("rod_video", "scale"): 2e-4,
    ("rod_video", "start"): 0.5,
    ("actuation", "amplitude"): 0.01,
    ("model", "k1"): 2000.0,
    ("model", "k2"): 1000.0,
    ("robot", "gravity"): 9.81,
}
EVERY = {n: Written(f"{n}/experiment.toml", VALUES) for n in NAMES}


def lines(*told):
    return [(s.file, s.line) for s in suggested(told, EVERY, WORDS)]


def test_a_jump_that_stands_apart_is_left_out_once_with_the_reason():
    (line,) = suggested((ODD, FASTER), EVERY, WORDS)
    assert (line.file, line.section, line.key) == ("jump-15/experiment.toml", "", "exclude")
    assert line.value == (
        "jump-15 was not driven as its experiment.toml says: 1.15 times the amplitude fits it (jumpvision diagnose)"
    )
    assert line.why in line.value


def test_a_number_that_is_off_by_a_power_of_ten_is_put_right():
    wrong = varies("amplitude", "odd", 0.1, sigma=0.0005, recordings=("jump-2",))
    assert lines(wrong) == [("jump-2/experiment.toml", "[actuation] amplitude = 0.001")]
    assert "exclude" in lines(replace(wrong, low=0.1001, high=0.1003))[0][1]


def test_scales_and_clocks_of_a_day_are_put_right_in_its_recordings():
    """The film shows 1.04 times the height: its scale is 1.04 times too large."""
    day = lines(DAY)
    assert [f for f, _ in day] == [f"{n}/experiment.toml" for n in NAMES[12:]]
    assert {line for _, line in day} == {"[rod_video] scale = 0.000192308"}
    late = varies("clock_offset", "odd", 0.02, 0.0, unit="s", recordings=("jump-1",))
    assert lines(late) == [("jump-1/experiment.toml", "[rod_video] start = 0.52")]


def test_a_step_of_the_bed_or_the_robot_changes_each_of_its_numbers():
    step = varies("bed", "step", 1.15, of="order", recordings=("jump-24",))
    assert [x for _, x in lines(step)] == ["[model] k1 = 2300", "[model] k2 = 1150"]
    step = varies("gravity", "step", 9.71, 9.81, of="session", recordings=("jump-24",), unit="m/s^2")
    assert [x for _, x in lines(step)] == ["[robot] gravity = 9.71"]


def test_no_line_mends_a_slope_or_a_scatter_or_what_is_not_established():
    assert lines(DRIFT, SOFT, SCATTER, replace(ODD, established=False)) == []


def test_half_of_the_jumps_may_be_left_out_no_more():
    assert len(lines(LOST)) == 8
    assert lines(replace(LOST, recordings=NAMES[:13])) == []


def test_nothing_else_is_changed_in_a_jump_that_is_left_out():
    changed = lines(replace(ODD, recordings=("jump-24",)), DAY)
    assert [x for f, x in changed if f.startswith("jump-24")] == [x for f, x in changed if "exclude" in x]


TEXT = (
    "# my jumps\nname = 'a'   # the first\n\n[rod_video]\nfile = 'rod.avi'\nscale = 2.0e-4 # by a ruler\n"
    "[actuation]\nkind = 'sine'\nfrequency = 7.0\namplitude = 0.01\n"
)


def test_numbers_are_taken_from_where_they_stand_inherited_ones_too(tmp_path):
    (tmp_path / "campaign.toml").write_text("[robot]\nmotor_mass = 1.5\n[model]\nk1 = 2000.0\n")
    make(tmp_path / "folder-1", TEXT, **{"rod.avi": "x"})
    found = written(open_campaign(tmp_path).experiments)["a"]
    assert found.file == "folder-1/experiment.toml"
    assert found.values[("rod_video", "scale")] == 2e-4 and found.values[("robot", "motor_mass")] == 1.5
    assert found.values[("model", "k1")] == 2000.0 and found.values[("actuation", "amplitude")] == 0.01


@pytest.mark.parametrize("ends", ["\n", "\r\n"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_accepted_lines_are_written_and_all_else_stays(tmp_path, ends, mark):
    folder = make(tmp_path / "a", "", **{"rod.avi": "x"})
    file = folder / "experiment.toml"
    file.write_bytes((mark + TEXT.replace("\n", ends)).encode())
    made = accept(
        [
            Suggested("a/experiment.toml", "", "exclude", "the drive slipped", "slipped"),
            Suggested("a/experiment.toml", "rod_video", "scale", 1.92e-4, "scale is 4 % larger"),
            Suggested("a/experiment.toml", "robot", "gravity", 9.7, "tilted"),
        ],
        tmp_path,
    )
    assert made == [file] and [f.name for f in sorted(folder.iterdir())] == ["experiment.toml", "rod.avi"]
    text = file.read_bytes().decode()
    assert text.startswith(mark)
    table = tomllib.loads(text.removeprefix("\ufeff"))
    assert table["exclude"] == "the drive slipped" and table["robot"] == {"gravity": 9.7}
    assert table["rod_video"]["scale"] == 1.92e-4
    kept = [x for x in (mark + TEXT).split("\n") if "scale" not in x]
    assert [x for x in kept if x in text.split(ends)] == kept
    assert "# accepted of jumpvision diagnose: scale is 4 % larger" in text
    if not mark:
        assert open_campaign(tmp_path).excluded == {"a": "the drive slipped"}


@pytest.mark.parametrize("text", ["", "[robot]\ngravity = 9.8\n", "exclude = ''\n[robot]\n", "# only this\n"])
def test_a_reason_stands_above_the_first_section(tmp_path, text):
    file = make(tmp_path / "a", text) / "experiment.toml"
    accept([Suggested("a/experiment.toml", "", "exclude", "why", "why")], tmp_path)
    assert tomllib.loads(file.read_text()) == tomllib.loads(text) | {"exclude": "why"}


def test_nothing_is_written_where_one_file_cannot_be(tmp_path):
    for name in "ab":
        make(tmp_path / name, TEXT if name == "a" else "robot = 9.8\n")
    before = [(tmp_path / n / "experiment.toml").read_bytes() for n in "ab"]
    asked = [Suggested(f"{n}/experiment.toml", "robot", "rod_mass", 0.2, "") for n in "ab"]
    assert "cannot be edited" in problems_of(accept, asked, tmp_path)[0]
    assert [(tmp_path / n / "experiment.toml").read_bytes() for n in "ab"] == before


def test_accept_is_not_for_a_simulator_that_is_not_ours(tmp_path):
    from jumpvision.cli.folders import diagnose

    (tmp_path / "campaign.toml").write_text("")
    with pytest.raises(InputError, match="leave out --simulator"):
        diagnose(tmp_path, simulator="module:study", accept=True)


def test_the_command_writes_asks_again_and_tells_each_line(tmp_path, capsys, monkeypatch):
    from types import SimpleNamespace

    from jumpvision.cli import folders

    folder = make(tmp_path / "a", TEXT, **{"rod.avi": "x"})
    (tmp_path / "campaign.toml").write_text("")
    line = Suggested("a/experiment.toml", "rod_video", "scale", 1.92e-4, "scale is 4 % larger")
    answers = [diagnosis(suggested=(line,), sentence="First."), diagnosis(sentence="Then.")]

    def work(path, options, **_):
        found = answers.pop(0)
        return SimpleNamespace(diagnosis=found, campaign=open_campaign(tmp_path), files=[], failed=False, outcomes=())

    monkeypatch.setattr(folders, "work", work)
    assert folders.diagnose(tmp_path) == folders.DONE
    out = capsys.readouterr().out
    assert out.startswith(
        "First.\nto correct it (jumpvision diagnose --accept writes this):\n  a/experiment.toml: [rod_video]"
    )
    assert (folder / "experiment.toml").read_text() == TEXT
    answers.insert(0, diagnosis(suggested=(line,), sentence="First."))
    assert folders.diagnose(tmp_path, accept=True) == folders.DONE
    said = capsys.readouterr()
    assert said.out.startswith("Then.") and answers == []
    assert "experiment.toml: [rod_video] scale = 0.000192  (scale is 4 % larger)" in said.err
    assert "scale = 0.000192" in (folder / "experiment.toml").read_text()
