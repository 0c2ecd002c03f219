"""Logs as CSV, TDMS and MAT: the same numbers from each, and the same words where they cannot be."""

from __future__ import annotations

import datetime
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

from jumpvision.base.schema import InputError
from jumpvision.experiment.init.recognise import recognised
from jumpvision.experiment.inputs import logs
from jumpvision.experiment.inputs.logs import read_log
from jumpvision.experiment.inputs.recordings import MotorLog, SpringLog
from tests.worlds.logs import write

T = np.arange(12) / 250.0 + 0.5
X = 4e-3 * np.sin(9.0 * T)
SUFFIXES = (".csv", ".tdms", ".mat", "-v73.mat")


def motor(path, **keys):
    return MotorLog(path.name, path, **keys)


@pytest.mark.parametrize("ending", SUFFIXES)
def test_every_format_gives_the_same_numbers(tmp_path, ending):
    """To the last bit: nothing is rounded on the way. `init` knows the log by its columns."""
    file = write(tmp_path / f"motor{ending}", {"time_s": T, "position_m": X})
    d = read_log(motor(file), "time_s", "position_m", optional=("force_N",))
    assert list(d) == ["time_s", "position_m"]
    assert (d.time_s.to_numpy() == T).all() and (d.position_m.to_numpy() == X).all()
    found = recognised(tmp_path, file.name, None)
    assert (found.section, found.file) == ("motor_log", file.name)


def test_a_log_that_is_written_again_is_read_again(tmp_path, monkeypatch):
    """Though what was read is kept once the file has rested: here a minute has passed after each reading."""
    monkeypatch.setattr(logs, "time", SimpleNamespace(time=lambda: time.time() + 60.0))
    for shift in (0.0, 1e-3):
        file = write(tmp_path / "motor.csv", {"time_s": T, "position_m": X + shift})
        found = [read_log(motor(file), "time_s", "position_m").position_m.to_numpy() for _ in range(2)]
        np.testing.assert_array_equal(found, [X + shift] * 2)


@pytest.mark.parametrize(
    ("ending", "names"),
    [
        (".csv", ("t [ms]", "enc")),
        (".tdms", ("t", "enc")),
        (".mat", ("log.motor.t", "log.motor.enc")),
        ("-v73.mat", ("data(:,1)", "data(:,3)")),
    ],
)
def test_columns_may_be_called_otherwise_and_be_in_other_units(tmp_path, ending, names):
    """Time in ms, position in mm, the log 0.25 s late: each said in the experiment."""
    time, position = names
    held = names if ending != ".tdms" else ("Control/t", "Control/enc")
    channels = dict(zip(held, (1e3 * T, 1e3 * X)))
    if "(" in time:  # columns of a matrix
        channels = {"data": np.column_stack([1e3 * T, 7.0 + T, 1e3 * X])}
    file = write(tmp_path / f"log{ending}", channels)
    called = {"time_s": time if "[" in time else f"{time} [ms]", "position_m": f"{position} [mm]"}
    d = read_log(motor(file, columns=called, start=0.25), "time_s", "position_m")
    assert d.time_s.to_numpy() == pytest.approx(T + 0.25, rel=1e-14)
    assert d.position_m.to_numpy() == pytest.approx(X, rel=1e-14)


def test_a_tdms_file_says_its_units_and_its_rate(tmp_path):
    """unit_string is believed; where there is no time channel the waveform's rate and offset are the time."""
    step = {"wf_increment": 0.004, "wf_start_offset": 0.5, "wf_start_time": datetime.datetime(2024, 5, 1)}
    file = write(
        tmp_path / "a.tdms",
        {"Log/position_m": 1e3 * X, "Log/force_N": 2.0 + X},
        units={"Log/position_m": "mm", "Log/force_N": "kN"},
        properties=step,
    )
    d = read_log(motor(file), "time_s", "position_m", optional=("force_N",))
    assert d.time_s.to_numpy() == pytest.approx(T, abs=1e-15)
    assert d.position_m.to_numpy() == pytest.approx(X, rel=1e-14)
    assert d.force_N.to_numpy() == pytest.approx(1e3 * (2.0 + X), rel=1e-14)
    dates = np.datetime64("2024-05-01T10:00:00", "us") + (1e6 * (T - T[0])).round().astype("timedelta64[us]")
    file = write(tmp_path / "b.tdms", {"Log/time_s": dates, "Log/position_m": X})  # seconds since the first
    assert read_log(motor(file, start=0.5), "time_s", "position_m").time_s.to_numpy() == pytest.approx(T, abs=1e-9)


@pytest.mark.parametrize("ending", SUFFIXES)
def test_the_same_errors_whatever_the_format(tmp_path, ending):
    for fault, words in {"nan": ("row 5", "position_m"), "back": ("row 5", "time_s"), "missing": ("position_m",),
                         "short": ("5 rows", "8")}.items():  # fmt: skip
        channels = {"time_s": T.copy(), "position_m": X.copy()}
        if fault == "nan":
            channels["position_m"][4] = np.nan
        elif fault == "back":
            channels["time_s"][4] = 0.0
        elif fault == "missing":
            channels["position"] = channels.pop("position_m")
        file = tmp_path / f"motor_{fault}{ending}"
        write(file, {k: v[:5] if fault == "short" else v for k, v in channels.items()})
        with pytest.raises(InputError) as e:
            read_log(motor(file), "time_s", "position_m", at_least=8)
        (said,) = e.value.problems
        assert str(file) in said and all(w in said for w in words), said


@pytest.mark.parametrize(("suffix", "library", "extra"), [(".tdms", "nptdms", "tdms"), ("-v73.mat", "h5py", "hdf5")])
def test_a_library_that_is_not_installed_is_named(tmp_path, monkeypatch, suffix, library, extra):
    file = write(tmp_path / f"a{suffix}", {"time_s": T, "position_m": X})
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(InputError, match=rf"{library}; install it with: pip install 'jumpvision\[{extra}\]'"):
        read_log(motor(file), "time_s", "position_m")


def test_a_mat_file_that_unpacks_to_gigabytes_is_refused(tmp_path, monkeypatch):
    """8 MB of zeros pack to 8 kB; the cap is lowered to 1 MB for it."""
    file = write(tmp_path / "bomb.mat", {"time_s": np.zeros(10**6), "position_m": np.zeros(10**6)})
    assert file.stat().st_size < 1e5
    monkeypatch.setattr("jumpvision.experiment.inputs.channels.UNPACKED", 1e6)
    with pytest.raises(InputError, match=r"more than 0\.001 GB when unpacked"):
        read_log(motor(file), "time_s", "position_m")


def test_data_in_another_file_is_refused(tmp_path):
    """Its change would not be noticed: the hash is of the file that is named."""
    h5py = pytest.importorskip("h5py")
    T.tofile(tmp_path / "raw.bin")
    file = write(tmp_path / "a-v73.mat", {"position_m": X})
    with h5py.File(file, "r+") as out:
        out.create_dataset("time_s", (12,), "f8", external=[(str(tmp_path / "raw.bin"), 0, T.nbytes)])
    with pytest.raises(InputError, match="lies in another file"):
        read_log(motor(file), "time_s", "position_m")


def test_an_index_beside_a_tdms_file_is_not_believed(tmp_path):
    """A stale index would give other numbers than those that are hashed."""
    file = write(tmp_path / "a.tdms", {"Log/time_s": T, "Log/position_m": X})
    other = write(tmp_path / "b.tdms", {"Log/time_s": T[:3], "Log/position_m": X[:3]})
    (tmp_path / "a.tdms_index").write_bytes(other.read_bytes().replace(b"TDSm", b"TDSh"))
    assert len(read_log(motor(file), "time_s", "position_m")) == 12


def test_a_spring_in_mat(tmp_path):
    from jumpvision.experiment.stages.spring import spring

    x = np.linspace(0.0, 0.004, 40)
    rng = np.random.default_rng(3)
    force = 3300.0 * x + rng.normal(0.0, 0.05, x.size)
    file = write(tmp_path / "spring.mat", {"test.u": 1e3 * x, "test.f": force})
    called = {"displacement_m": "test.u [mm]", "force_N": "test.f"}
    k = spring(SpringLog(file.name, file, columns=called)).values["fits"]["spring_stiffness"]
    assert abs(k["value"] - 3300.0) < 4.0 * k["sigma"] < 0.01 * 3300.0


def test_a_cut_element_of_a_mat_file_is_refused_before_a_reader_falls_over_it(tmp_path):
    """scipy's reader ended the process on a compressed element without its end."""
    file = write(tmp_path / "log.mat", {"time_s": T, "position_m": X})
    data = bytearray(file.read_bytes())
    length = int.from_bytes(data[132:136], "little")
    file.write_bytes(bytes(data[:132]) + (length - 6).to_bytes(4, "little") + bytes(data[136 : 136 + length - 6]))
    with pytest.raises(InputError, match=r"log.mat: not a MAT file, or damaged .element at byte 128 is cut"):
        read_log(motor(file), "time_s", "position_m")


def test_links_of_a_mat_file_to_other_files_are_not_followed(tmp_path):
    h5py = pytest.importorskip("h5py")
    write(tmp_path / "other-v73.mat", {"time_s": T, "position_m": X})
    file = write(tmp_path / "log-v73.mat", {"time_s": T})
    with h5py.File(file, "r+") as out:
        out["position_m"] = h5py.ExternalLink("other-v73.mat", "/position_m")
        out["gone"] = h5py.SoftLink("/nowhere")
    with pytest.raises(InputError, match="position_m"):
        read_log(motor(file), "time_s", "position_m")


def waveform(path, steps, starts=(None, None), counts=(12, 12)):
    """Two channels of a TDMS file, each with its rate and date as LabVIEW's waveforms state them."""
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(path) as out:
        for name, step, start, n in zip(("position_m", "force_N"), steps, starts, counts):
            told = {"wf_increment": step, "wf_start_offset": 0.0} | ({} if start is None else {"wf_start_time": start})
            out.write_segment([nptdms.ChannelObject("Log", name, np.arange(float(n)), told)])
    return path


BEGAN = datetime.datetime(2024, 5, 1, 10)


@pytest.mark.parametrize(
    ("steps", "starts", "counts"),
    [
        ((1e-3, 2e-3), (None, None), (12, 12)),
        ((1e-3, 2e-3), (BEGAN, BEGAN), (12, 6)),
        ((1e-3, 1e-3), (BEGAN, BEGAN + datetime.timedelta(milliseconds=5)), (12, 12)),
    ],
)
def test_channels_with_clocks_of_their_own_are_refused(tmp_path, steps, starts, counts):
    """The first channel's clock served all: forces at 2 ms were taken for such at 1 ms, 5 ms late ones for prompt."""
    file = waveform(tmp_path / "a.tdms", steps, starts, counts)
    with pytest.raises(InputError, match=r"position_m and force_N have clocks of their own: 12 values, one a 0.001 s"):
        read_log(motor(file), "time_s", "position_m", optional=("force_N",))
    assert read_log(motor(file), "time_s", "position_m").time_s.iloc[-1] == pytest.approx(0.011)


def test_a_date_that_was_never_set_is_no_date(tmp_path):
    """LabVIEW writes 1904 for it; two channels of one rate go together then, and the declared rate goes before both."""
    file = waveform(tmp_path / "a.tdms", (1e-3, 1e-3), (datetime.datetime(1904, 1, 1), BEGAN))
    read = read_log(motor(file), "time_s", "position_m", optional=("force_N",))
    assert read.time_s.to_numpy() == pytest.approx(1e-3 * np.arange(12))
    read = read_log(motor(file, rate=500.0, start=1.0), "time_s", "position_m")
    assert read.time_s.to_numpy() == pytest.approx(1.0 + 2e-3 * np.arange(12))


def test_a_rate_beside_times_is_refused_and_one_without_times_is_the_clock(tmp_path):
    file = write(tmp_path / "a.csv", {"time_s": T, "position_m": X})
    with pytest.raises(InputError, match="rate = 250 beside the column of times time_s"):
        read_log(motor(file, rate=250.0), "time_s", "position_m")
    file = write(tmp_path / "b.csv", {"position_m": X})
    assert read_log(motor(file, rate=250.0), "time_s", "position_m").time_s.to_numpy() == pytest.approx(T - 0.5)


ROWS = [f"{t:.3f},{x:.6f}," for t, x in zip(T, X)]


@pytest.mark.parametrize(
    ("comments", "words"),
    [
        ({3: '"lamp off', 7: 'again"'}, r"row 4: a quotation mark opens the cell 'lamp off' and closes it 4 lines on"),
        ({3: '"lamp off'}, r"line 5: a quotation mark opens a cell that never ends: close or remove it"),
    ],
)
def test_a_quotation_mark_that_is_not_closed_swallows_no_rows(tmp_path, comments, words):
    """Rows 4 to 8 were one cell, and 8 of 12 rows were read without a word."""
    file = tmp_path / "motor.csv"
    file.write_text("time_s,position_m,note\n" + "\n".join(r + comments.get(i, "") for i, r in enumerate(ROWS)) + "\n")
    with pytest.raises(InputError, match=words):
        read_log(motor(file), "time_s", "position_m")
