"""When, by whom and with what a recording was made: as the user gives it, and what is read off where nothing is."""

from __future__ import annotations

import os
from datetime import UTC, datetime

import numpy as np
import pytest
from test_experiment import make, problems_of
from test_frames_raw import grey_film, write_cine, write_mraw, write_seq

from jumpvision.base.schema import InputError
from jumpvision.engine.study.study import Recording
from jumpvision.engine.study.system import circumstances as of_recordings
from jumpvision.experiment.campaign.circumstances import circumstances
from jumpvision.experiment.inputs.experiment import open_campaign, open_experiment
from jumpvision.experiment.inputs.labels import Labels
from jumpvision.experiment.inputs.overrides import overrides_of
from jumpvision.films.frames.recorded import recorded_at

LAW = "[actuation]\nkind = 'sine'\nfrequency = 7.0\namplitude = 0.01\n[bed]\nvolume_fraction = 0.6\n"


def of(folder):
    return circumstances(open_campaign(folder).experiments)


def orders(folder):
    found = of(folder)
    return [c.order for c in found.values()], {c.source for c in found.values()}


def test_keys_of_an_experiment_and_labels_under_those_of_its_campaign(tmp_path):
    (tmp_path / "campaign.toml").write_text("session = 'monday'\n[labels]\noperator = 'A'\ntemperature_C = 21\n")
    make(tmp_path / "a", f"recorded = 2026-11-25T10:02:00\nsession = 'tuesday'\n{LAW}[labels]\noperator = 'B'\n")
    make(tmp_path / "b", "recorded = 2026-11-24T10:02:00\n")
    a, b = of(tmp_path).values()
    assert (a.session, b.session) == ("tuesday", "monday")
    assert (a.order, b.order) == (2.0, 1.0)
    assert a.time - b.time == 86400.0
    assert a.labels == {
        "operator": "B",
        "temperature_C": 21.0,
        "frequency": 7.0,
        "amplitude": 0.01,
        "delay": 0.0,
        "volume_fraction": 0.6,
    }
    assert b.labels == {"operator": "A", "temperature_C": 21.0}
    assert a.source == "`recorded` in experiment.toml"


def test_an_offset_from_utc_counts(tmp_path):
    make(tmp_path / "a", "recorded = 2026-11-25T10:00:00+02:00\n")
    make(tmp_path / "b", "recorded = 2026-11-25T09:00:00Z\n")
    a, b = of(tmp_path).values()
    assert b.time - a.time == 3600.0


def test_an_order_that_is_given_wins_over_times_and_names(tmp_path):
    make(tmp_path / "jump-1", "order = 5\nrecorded = 2026-11-25T10:00:00\n")
    make(tmp_path / "jump-2", "recorded = 2026-11-25T11:00:00\n")
    assert orders(tmp_path) == ([5.0, None], {"`order` in experiment.toml", ""})


@pytest.mark.parametrize(
    ("names", "numbers"),
    [
        (("jump-02", "jump-10", "jump-9"), [2.0, 10.0, 9.0]),
        (("01_stutter-7.0Hz", "12_sine-9.0Hz"), [1.0, 12.0]),
        (("run3", "run4"), [3.0, 4.0]),
        (("sine-7.0Hz-1", "sine-9.0Hz-1"), [None, None]),  # trials of conditions, each begun at 1
        (("sine-7.0Hz", "sine-9.0Hz"), [None, None]),  # frequencies
        (("phi0.57", "phi0.61"), [None, None]),
        (("jump-1", "jump-2", "spare"), [None, None, None]),
    ],
)
def test_else_the_number_in_the_name_of_the_folder(tmp_path, names, numbers):
    for n in names:
        make(tmp_path / n, "session = '7'\n")
    found, said = orders(tmp_path)
    assert found == numbers
    assert said == ({"the number in the folder's name"} if numbers[0] else {""})


@pytest.mark.parametrize(("apart", "known"), [(3601.0, [2.0, 1.0]), (60.0, [None, None])])
def test_dates_of_files_only_where_nothing_else_says_it_and_they_are_no_copy(tmp_path, apart, known):
    for name, at in (("a", 1e9 + apart), ("b", 1e9)):
        folder = make(tmp_path / name, "[rod_track]\nfile = 'rod.csv'\n", rod_csv="time_s,height_m\n0,0\n")
        os.utime(folder / "rod.csv", (at, at))
    found, said = orders(tmp_path)
    assert found == known
    assert said == {"the dates of the files, as nothing else says it" if known[0] else ""}


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("recorded = '2026-11-25'\n", ("recorded = '2026-11-25'", "not in quotes: 2026-11-25T10:02:00")),
        ("recorded = 2026-11-25\n", ("recorded = ", "a date with a time")),
        ("session = 3\n", ("session = 3", "text in quotes")),
        ("order = 'first'\n", ("order = 'first'", "must be a number")),
        ("[labels]\non = true\n", ("[labels] on = True", "finite number or text")),
        ("[labels]\nt = inf\n", ("[labels] t = inf", "finite number or text")),
        ("labels = 3\n", ("labels = 3", "written [labels]")),
    ],
)
def test_what_cannot_be_is_named_with_its_remedy(tmp_path, text, parts):
    (problem,) = problems_of(open_experiment, make(tmp_path, text))
    for part in ("experiment.toml", *parts):
        assert part in problem


@pytest.mark.parametrize(
    ("first", "second", "part"),
    [
        (
            "recorded = 2026-11-25T10:00:00\n",
            "recorded = 2026-11-25T10:00:00Z\n",
            "with an offset from UTC; without an offset",
        ),
        ("[labels]\nx = 1\n", "[labels]\nx = 'one'\n", "[labels] x = one: words; a number in a"),
    ],
)
def test_what_cannot_be_compared_is_one_problem(tmp_path, first, second, part):
    make(tmp_path / "a", first)
    make(tmp_path / "b", second)
    (problem,) = problems_of(open_campaign, tmp_path)
    assert part in problem and "must be alike in all" in problem


@pytest.mark.parametrize("key", ["recorded = 2026-11-25T10:00:00", "order = 1"])
def test_a_campaign_has_no_time_and_no_place_of_its_own(tmp_path, key):
    (tmp_path / "campaign.toml").write_text(key + "\n")
    make(tmp_path / "a")
    (problem,) = problems_of(open_campaign, tmp_path)
    assert "an experiment's own key" in problem


def test_labels_may_be_set_on_the_command_line(tmp_path):
    e = open_experiment(make(tmp_path), overrides=overrides_of(("labels.humidity=0.4",)))
    assert e.section(Labels).values == {"humidity": 0.4}


def recording(name, **more):
    return Recording(name, np.arange(4.0), np.zeros(4), **more)


def test_recordings_of_a_study_are_ordered_by_their_times():
    late, early = datetime(2026, 11, 25, 10, tzinfo=UTC), datetime(2026, 11, 25, 9, tzinfo=UTC)
    a, b = of_recordings(
        [recording("a", recorded=late, labels={"mass": 2}, session="x"), recording("b", recorded=early)]
    )
    assert (a.order, b.order, a.time - b.time) == (2.0, 1.0, 3600.0)
    assert (a.labels, a.session, b.session) == ({"mass": 2.0}, "x", None)
    assert a.source == "`recorded` of the recordings"


def test_a_recording_of_a_study_without_an_order_has_none():
    a, b = of_recordings([recording("a", order=3), recording("b", recorded=7.0)])
    assert (a.order, a.source, b.order, b.source) == (3, "`order` of the recordings", None, "")
    assert of_recordings([recording("a", labels={"kind": None})])[0].labels == {}


def test_a_time_in_words_is_refused():
    with pytest.raises(InputError, match="recorded = 'noon': a datetime, or seconds"):
        recording("a", recorded="noon")


def test_a_table_names_the_columns_of_order_and_time():
    import pandas as pd

    t = [0.0, 1.0, 2.0, 3.0]
    table = pd.DataFrame({"recording": ["a"] * 4 + ["b"] * 4, "time_s": t * 2, "y": 0.0, "run": [2] * 4 + [1] * 4})
    made = Recording.of_table(table, ["y"], order="run", session="recording")
    assert [(r.order, r.session) for r in made] == [(2, "a"), (1, "b")]


def seq(folder, at):
    """A NorPix film of one frame, stamped at a time [s]."""
    folder.mkdir(parents=True, exist_ok=True)
    return write_seq(folder / "rod.seq", grey_film(1, 8), [round(1e6 * at)])


def test_films_say_when_they_were_recorded(tmp_path):
    at = datetime(2024, 1, 2, 15, 59, tzinfo=UTC).timestamp()
    assert recorded_at(seq(tmp_path, 1_435_776_075.25)) == pytest.approx(1_435_776_075.25)
    cine = write_cine(tmp_path / "a.cine", grey_film(2, 8), bits=8)
    assert recorded_at(cine) == 2.0**30
    header = write_mraw(tmp_path, grey_film(2, 8), 8, header=".cih")
    assert recorded_at(header) is None  # a date without a time
    header.write_bytes(header.read_bytes().replace(b"Date : 2024/1/2", b"Date : 2024/1/2\r\nTime : 15:59"))
    assert recorded_at(header) == recorded_at(tmp_path / "film.mraw") == at


def test_a_container_may_say_when_it_was_made(tmp_path):
    import av

    for name, more in (("a.mp4", {"creation_time": "2024-01-02T15:59:00Z"}), ("b.mp4", {})):
        with av.open(str(tmp_path / name), "w") as out:
            out.metadata.update(more)
            stream = out.add_stream("mpeg4", rate=30)
            stream.width, stream.height = 32, 32
            out.mux(stream.encode(av.VideoFrame.from_ndarray(np.zeros((32, 32, 3), np.uint8))))
            out.mux(stream.encode(None))
    assert recorded_at(tmp_path / "a.mp4") == datetime(2024, 1, 2, 15, 59, tzinfo=UTC).timestamp()
    assert recorded_at(tmp_path / "b.mp4") is None


@pytest.mark.parametrize("name", ["a.cine", "a.seq", "a.cih", "a.mp4", "a.avi", "missing.seq"])
def test_what_is_damaged_or_unset_says_nothing(tmp_path, name):
    if name != "missing.seq":
        (tmp_path / name).write_bytes(b"\0" * 9000)
    assert recorded_at(tmp_path / name) is None


def test_the_films_stamps_come_before_the_numbers_in_the_names(tmp_path):
    for name, at in (("jump-1", 1.5e9 + 60.0), ("jump-2", 1.5e9)):
        seq(tmp_path / name, at)
        make(tmp_path / name, "[rod_video]\nfile = 'rod.seq'\n")
    assert orders(tmp_path) == ([2.0, 1.0], {"the films' own stamps"})
    assert [c.time for c in of(tmp_path).values()] == [1.5e9 + 60.0, 1.5e9]
    make(tmp_path / "jump-3", "[rod_video]\nfile = 'rod.avi'\n", **{"rod.avi": "x"})  # without a stamp of its own
    found = of(tmp_path).values()
    assert [c.order for c in found] == [1.0, 2.0, 3.0] and {c.time for c in found} == {None}
