"""LabVIEW measurement files: small ones written here as LabVIEW writes them, and real ones (JUMPVISION_REAL_DATA)."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

import numpy as np
import pytest

from jumpvision.base.schema import InputError, StageWarning
from jumpvision.experiment.inputs.logs import read_log
from jumpvision.experiment.inputs.recordings import MotorLog

REAL = Path(os.environ.get("JUMPVISION_REAL_DATA", "")) / "labview_lvm"
real = pytest.mark.skipif(not REAL.is_dir(), reason="JUMPVISION_REAL_DATA names no folder with labview_lvm")
X = 1e-3 * np.arange(8.0) ** 2  # position [m]


def segment(values, *, step="0.001000", time="09:51:40.5", samples=None, decimal=".", x=None, units=("m", "N")):
    """One segment of position_m and force_N: values (n, 2), with or without a column of X values (n,)."""
    head = f"Channels\t2\nSamples\t{samples or len(values)}\t{samples or len(values)}\nDate\t2024/05/01\t2024/05/01\n"
    head += f"Time\t{time}\t{time}\nY_Unit_Label\t{units[0]}\t{units[1]}\nX_Dimension\tTime\tTime\n"
    head += f"X0\t0.0000E+0\t0.0000E+0\nDelta_X\t{step}\t{step}\n***End_of_Header***\n"
    head += "X_Value\tposition_m\tforce_N\tComment\n"
    rows = [("" if x is None else f"{x[i]:.6f}", f"{a:.6f}", f"{b:.6f}") for i, (a, b) in enumerate(values)]
    text = head + "".join("\t".join(r) + "\n" for r in rows) + "\n"
    return text.replace(".", decimal) if decimal != "." else text


def saved(path, *segments, columns="No", decimal="."):
    head = (
        f"LabVIEW Measurement\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t{decimal}\nMulti_Headings\tYes\n"
    )
    head += f"X_Columns\t{columns}\nDate\t2024/05/01\nTime\t09:51:39{decimal}1\n***End_of_Header***\n\n"
    path.write_text(head + "".join(segments), encoding="latin-1")
    return path


def read(path, **keys):
    return read_log(MotorLog(path.name, path, **keys), "time_s", "position_m", optional=("force_N",))


TABLE = np.column_stack([X, 2.0 + X])


@pytest.mark.parametrize("decimal", [".", ","])
@pytest.mark.parametrize("columns", ["No", "One"])
def test_values_and_times_as_written(tmp_path, decimal, columns):
    x = None if columns == "No" else 1e-3 * np.arange(8)
    file = saved(tmp_path / "a.lvm", segment(TABLE, decimal=decimal, x=x), columns=columns, decimal=decimal)
    d = read(file, start=0.5)
    assert d.time_s.to_numpy() == pytest.approx(0.5 + 1e-3 * np.arange(8), abs=1e-12)
    assert d.position_m.to_numpy() == pytest.approx(X, abs=5.1e-7)
    assert d.force_N.to_numpy() == pytest.approx(2.0 + X, abs=5.1e-7)


def test_every_segment_stands_at_its_date(tmp_path):
    """The last segment alone was kept by the recipe that the docs gave; the gap of 0.25 s is one."""
    file = saved(tmp_path / "a.lvm", segment(TABLE[:4]), segment(TABLE[4:], time="09:51:40.75"))
    d = read(file)
    assert d.time_s.to_numpy() == pytest.approx(np.r_[0:4, 250:254] * 1e-3, abs=1e-9)
    assert d.position_m.to_numpy() == pytest.approx(X, abs=5.1e-7)


def test_x_values_that_go_on_count_from_the_first_segment(tmp_path):
    x = 1e-3 * np.arange(8)
    file = saved(
        tmp_path / "a.lvm", segment(TABLE[:4], x=x[:4]), segment(TABLE[4:], x=x[4:], time="09:51:40.504"), columns="One"
    )
    assert read(file).time_s.to_numpy() == pytest.approx(x, abs=1e-12)


def test_a_rounded_step_is_the_one_whole_rate_that_is_written_so(tmp_path):
    """0.000977 is 1/1024 s, which was taken at its word: 3.7 ms late after 16 s."""
    file = saved(tmp_path / "a.lvm", segment(TABLE, step="0.000977"))
    with pytest.warns(StageWarning, match="0.000977 s is rounded: timed by 1024 Hz"):
        d = read(file)
    assert d.time_s.to_numpy() == pytest.approx(np.arange(8) / 1024.0, rel=1e-12)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read(file, rate=1023.5).time_s.iloc[-1] == pytest.approx(7 / 1023.5)


def test_what_cannot_be_told_is_refused(tmp_path):
    """The rest of what is wrong with such files is in odd_files.py."""
    for text, words in (
        (segment(TABLE, step="0.000244"), "any rate from 4089.98 to 4106.78 Hz"),
        (segment(TABLE).replace("0.049000\t2.049000\n\n", "0.0490"), "2 values under 3 names"),
        (segment(TABLE[:4]) + segment(TABLE[4:]), "row 5, time_s = 0 after 0.003"),
        (segment(TABLE).partition("***End")[0], "a.lvm"),
    ):
        with pytest.raises(InputError, match=words):
            read(saved(tmp_path / "a.lvm", text))


def log_of(name, **columns):
    return MotorLog(name, REAL / name, columns=columns)


X_COLUMN = [0.0, 0.328878, 1.208397, 1.533401, 1.927769, 2.844771, 3.834297, 7.961557, 9.723275]
FILES = {  # a real file: channel [unit], its times, row and value of one of its cells
    "with_comments.lvm": ("Volume (ml) [mm]", X_COLUMN, 3, 89.8218e-3),
    "short.lvm": ("Response (Trigger) [m]", np.arange(10) / 25600.0, 9, 1.212775),
    "short_new_line_end.lvm": ("Excitation (Trigger) [m]", np.arange(10) / 25600.0, 9, 0.680572),
    "no_decimal_separator.lvm": ("az [m]", [0.0, 0.00025, 0.0005, 0.00075], 0, 0.021503),
    "multi_time_column.lvm": ("Acceleration [m]", [0.0, 1.953125e-5, 3.90625e-5], 2, 0.467541),
}


@real
@pytest.mark.filterwarnings("ignore::jumpvision.base.schema.StageWarning")  # one promises more samples than it has
@pytest.mark.parametrize("name", FILES)
def test_real_files_are_read_with_their_times(name):
    column, times, row, value = FILES[name]
    d = read_log(log_of(name, position_m=column), "time_s", "position_m")
    assert d.time_s.to_numpy() == pytest.approx(np.array(times), abs=1e-12)
    assert d.position_m.iloc[row] == pytest.approx(value, rel=1e-9)


@real
def test_two_real_segments_under_one_header_need_a_rate():
    log = log_of("long_single_header_multi_ch.lvm", position_m="m_1 [m]")
    with pytest.raises(InputError, match="16384 rows under one header, written 8192 at a time"):
        read_log(log, "time_s", "position_m")
    log = MotorLog(log.file, log.path, columns=log.columns, rate=1024.0)
    d = read_log(log, "time_s", "position_m")
    assert len(d) == 16384 and d.time_s.iloc[-1] == pytest.approx(16383 / 1024.0)
    assert d.position_m.iloc[[0, -1]].tolist() == [0.234571, 0.235689]


def test_init_notes_what_was_cut_off(tmp_path):
    from jumpvision.experiment.init.recognise import recordings

    file = saved(tmp_path / "a.lvm", segment(TABLE, samples=100))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (found,), notes = recordings(tmp_path, {})
    assert found.file == file.name and any("promises 100 samples, 8 are there" in n for n in notes)
