"""When, by whom and with what a recording was made: as the user gives it, and what is read off where nothing is."""

from __future__ import annotations

import os
from datetime import UTC, datetime

import av
import numpy as np
import pytest
from test_frames_raw import grey_film, write_cine, write_mraw, write_seq

from jumpvision.base.schema import InputError
from jumpvision.engine.study.study import Recording
from jumpvision.engine.study.system import circumstances as of_recordings
from jumpvision.experiment.campaign.circumstances import circumstances
from jumpvision.experiment.inputs.experiment import open_campaign, open_experiment
from jumpvision.films.frames.recorded import recorded_at
from tests.worlds.small import make, problems_of

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


def test_an_order_that_is_given_wins_over_times_and_names(tmp_path):
    make(tmp_path / "jump-1", "order = 5\nrecorded = 2026-11-25T10:00:00\n")
    make(tmp_path / "jump-2", "recorded = 2026-11-25T11:00:00\n")
    assert orders(tmp_path) == ([5.0, None], {"`order` in experiment.toml", ""})


def test_else_the_number_in_the_name_of_the_folder(tmp_path):
    for k, (names, numbers) in enumerate((
        (("jump-02", "jump-10", "jump-9"), [2.0, 10.0, 9.0]),
        (("01_stutter-7.0Hz", "12_sine-9.0Hz"), [1.0, 12.0]),
        (("sine-7.0Hz-1", "sine-9.0Hz-1"), [None, None]),  # trials of conditions, each begun at 1
        (("sine-7.0Hz", "sine-9.0Hz"), [None, None]),  # frequencies
        (("jump-1", "jump-2", "spare"), [None, None, None]),
    )):  # fmt: skip
        for n in names:
            make(tmp_path / str(k) / n, "session = '7'\n")
        assert orders(tmp_path / str(k))[0] == numbers


@pytest.mark.parametrize(("apart", "known"), [(3601.0, [2.0, 1.0]), (60.0, [None, None])])
def test_dates_of_files_only_where_nothing_else_says_it_and_they_are_no_copy(tmp_path, apart, known):
    for name, at in (("a", 1e9 + apart), ("b", 1e9)):
        folder = make(tmp_path / name, "[rod_track]\nfile = 'rod.csv'\n", rod_csv="time_s,height_m\n0,0\n")
        os.utime(folder / "rod.csv", (at, at))
    assert orders(tmp_path)[0] == known


def test_what_cannot_be_is_named(tmp_path):
    for text in ("recorded = '2026-11-25'", "recorded = 2026-11-25", "session = 3", "order = 'first'", "labels = 3",
                 "[labels]\non = true", "[labels]\nt = inf"):  # fmt: skip
        (problem,) = problems_of(open_experiment, make(tmp_path, text + "\n"))
        assert "experiment.toml" in problem and text.rpartition("\n")[2].partition(" ")[0] in problem
    with pytest.raises(InputError, match="recorded = 'noon'"):
        recording("a", recorded="noon")
    for k, (first, second) in enumerate((
        ("recorded = 2026-11-25T10:00:00\n", "recorded = 2026-11-25T10:00:00Z\n"),
        ("[labels]\nx = 1\n", "[labels]\nx = 'one'\n"),
    )):  # fmt: skip
        make(tmp_path / str(k) / "a", first)
        make(tmp_path / str(k) / "b", second)
        assert len(problems_of(open_campaign, tmp_path / str(k))) == 1
    for key in ("recorded = 2026-11-25T10:00:00", "order = 1"):
        (tmp_path / "c").mkdir(exist_ok=True)
        (tmp_path / "c" / "campaign.toml").write_text(key + "\n")
        make(tmp_path / "c" / "a")
        (problem,) = problems_of(open_campaign, tmp_path / "c")  # an experiment's own keys
        assert key.partition(" ")[0] in problem


def recording(name, **more):
    return Recording(name, np.arange(4.0), np.zeros(4), **more)


def test_recordings_of_a_study_are_ordered_by_their_times_or_have_no_order():
    late, early = datetime(2026, 11, 25, 10, tzinfo=UTC), datetime(2026, 11, 25, 9, tzinfo=UTC)
    first = recording("a", recorded=late, labels={"mass": 2}, session="x")
    a, b = of_recordings([first, recording("b", recorded=early)])
    assert (a.order, b.order, a.time - b.time) == (2.0, 1.0, 3600.0)
    assert (a.labels, a.session, b.session) == ({"mass": 2.0}, "x", None)
    a, b = of_recordings([recording("a", order=3), recording("b", recorded=7.0)])
    assert (a.order, a.source, b.order, b.source) == (3, "`order` of the recordings", None, "")
    assert of_recordings([recording("a", labels={"kind": None})])[0].labels == {}


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
    for name, more in (("a.mp4", {"creation_time": "2024-01-02T15:59:00Z"}), ("b.mp4", {})):
        with av.open(str(tmp_path / name), "w") as out:
            out.metadata.update(more)
            stream = out.add_stream("mpeg4", rate=30)
            stream.width, stream.height = 32, 32
            out.mux(stream.encode(av.VideoFrame.from_ndarray(np.zeros((32, 32, 3), np.uint8))))
            out.mux(stream.encode(None))
    assert recorded_at(tmp_path / "a.mp4") == datetime(2024, 1, 2, 15, 59, tzinfo=UTC).timestamp()
    assert recorded_at(tmp_path / "b.mp4") is None


def test_what_is_damaged_or_unset_says_nothing(tmp_path):
    for name in ("a.cine", "a.seq", "a.cih", "a.mp4", "a.avi"):
        assert recorded_at(tmp_path / name) is None
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
