"""Logs as real programs write them, where a library behaves otherwise than one remembers."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest

from jumpvision.base.schema import InputError
from jumpvision.base.units import PLAIN, PREFIXES, WITH_PREFIX, WORDS, factor, unit_of
from jumpvision.experiment.init.recognise import recognised
from jumpvision.experiment.inputs.logs import read_log
from jumpvision.experiment.inputs.recordings import MotorLog

T = np.linspace(0.0, 1.0, 21)


def motor(file, **keys):
    return MotorLog(file.name, file, **keys)


# ------------------------------------------------------------------------------------------------------------- units
@pytest.mark.surprise(
    package="pint",
    version="0.25.3",
    behaviour="`px` is a CSS pixel, 1/96 inch, `Nm` a textile's metres per kilogram, `fps` feet per second, `G` gauss, "
    "and a revolution 2 pi, so that 1 rps is 6.283 Hz",
    here="has a list of its own: a pixel is no length, a turn is a turn, G is 9.80665 m/s^2; all else is refused",
)
def test_units_are_those_that_a_lab_means():
    """Each by what a laboratory's log means, beside what the library says of the same letters."""
    pint = pytest.importorskip("pint")
    said = pint.UnitRegistry()
    assert said.Quantity(1.0, "px").to("m").magnitude == pytest.approx(0.0254 / 96)
    assert said.Quantity(1.0, "rps").to("Hz").magnitude == pytest.approx(2.0 * math.pi)
    assert said.Quantity(1.0, "fps").is_compatible_with("m/s") and str(said.parse_units("G")) == "gauss"
    assert not said.Quantity(1.0, "Nm").is_compatible_with("N m")
    meant = [("rps", "Hz", 1.0), ("rpm", "Hz", 1 / 60), ("rpm", "rad/s", 2 * math.pi / 60), ("fps", "Hz", 1.0)]
    meant += [("G", "m/s^2", 9.80665), ("Nm", "N m", 1.0), ("mNm", "N m", 1e-3), ("px", "pixel", 1.0)]
    for unit, wanted, one in meant:
        assert factor(unit, wanted) == pytest.approx(one, rel=1e-15), unit
    refused = [("px", "m"), ("rpm", "1/s"), ("rad/s", "1/s"), ("G", "T"), ("degC", "K"), ("kg", "N"), ("furlong", "m")]
    for unit, wanted in refused:
        with pytest.raises(ValueError, match=r"unit"):
            factor(unit, wanted)


def test_the_list_agrees_with_the_library_where_both_mean_the_same():
    """Every name with every prefix that pint knows, to its definition; what a lab means otherwise is tested above."""
    pint = pytest.importorskip("pint")
    registry, compared = pint.UnitRegistry(), 0
    otherwise = {"px", "pixel", "rps", "rpm", "fps", "G", "hbar"}  # hbar is Planck's there
    names = {*PLAIN, *WORDS, *(p + n for n in WITH_PREFIX for p in ("", *PREFIXES))} - otherwise
    for name in names:
        if name not in registry or name.endswith("Nm"):
            continue
        size, powers = unit_of(name)
        given = registry.Quantity(1.0, name)
        for unit, power in powers.items():
            given = given / registry.Quantity(1.0, unit) ** power
        turns = 2.0 * math.pi if {"turn", "s"} <= {*powers} else 1.0  # a hertz is a radian a second there
        assert turns * given.to("dimensionless").magnitude == pytest.approx(size, rel=1e-12), name
        compared += 1
    assert compared > 100


@pytest.mark.parametrize(
    ("unit", "one"),
    [("Millimeters", 1e-3), ("µm", 1e-6), ("inches", 0.0254), ("mm", 1e-3), ("Micrometre", 1e-6), ("MM", None),
     ("px", None), ("pixel", None), ("counts", None), ("V", None), ("m/s", None), ("", 1.0)],
)  # fmt: skip
def test_a_logs_unit_is_converted_or_refused_by_name(tmp_path, unit, one):
    file = tmp_path / "motor.csv"
    called = f"pos [{unit}]" if unit else "pos"
    file.write_text("\n".join([f"time_s,{called}", *(f"{t},{t * t}" for t in T)]) + "\n", encoding="utf-8")
    log = motor(file, columns={"position_m": called})
    if one is None:
        with pytest.raises(InputError, match=rf"pos \[{unit}\] is in '{unit}', which is no m"):
            read_log(log, "time_s", "position_m")
    else:
        assert read_log(log, "time_s", "position_m").position_m.to_numpy() == pytest.approx(one * T * T, rel=1e-14)


@pytest.mark.parametrize(
    "before", ["", "sep=,\n", "# recorded by A\n# with the small foot, 3 kg\n", "\ufeffsep=,\n#\n"]
)
def test_lines_before_the_header_are_left_out(tmp_path, before):
    """By the reader and by init; rows are counted from the header on."""
    file, rows = tmp_path / "motor.csv", [f"{t},{t * t}" for t in T]
    file.write_text(before + "\n".join(["time_s,position_m", *rows]) + "\n", encoding="utf-8")
    assert np.array_equal(read_log(motor(file), "time_s", "position_m").position_m, T * T)
    assert recognised(tmp_path, file.name, None).section == "motor_log"
    file.write_text(before + "\n".join(["time_s,position_m", *rows[:4], "0.3,x", *rows[7:]]) + "\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"row 5, position_m = 'x'"):
        read_log(motor(file), "time_s", "position_m")


# -------------------------------------------------------------------------------------------------------- ROS, MCAP
def mcap(path, messages, profile=""):
    """A valid MCAP file of one topic /motor of JSON messages, by the format's specification."""

    def text(s):
        return struct.pack("<I", len(s)) + (s if isinstance(s, bytes) else s.encode())

    def record(kind, body):
        return struct.pack("<BQ", kind, len(body)) + body

    parts = [record(1, text(profile) + text("test"))]
    parts.append(record(3, struct.pack("<H", 1) + text("motor") + text("jsonschema") + text('{"type": "object"}')))
    parts.append(record(4, struct.pack("<HH", 1, 1) + text("/motor") + text("json") + struct.pack("<I", 0)))
    for k, (at, data) in enumerate(messages):
        parts.append(record(5, struct.pack("<HIQQ", 1, k, at, at) + data.encode()))
    parts += [record(15, struct.pack("<I", 0)), record(2, struct.pack("<QQI", 0, 0, 0))]
    path.write_bytes(b"\x89MCAP0\r\n" + b"".join(parts) + b"\x89MCAP0\r\n")


@pytest.mark.surprise(
    package="rosbags",
    version="0.11.9",
    behaviour="an MCAP file whose profile is not ros2 (JSON, Protobuf) is no bag: 'Profile is not ros2'",
    here="says so, and how the messages become a table; no tool that mends bags is named",
)
def test_an_mcap_of_json_messages_is_refused_with_what_helps(tmp_path):
    highlevel = pytest.importorskip("rosbags.highlevel")
    file = tmp_path / "motor.mcap"
    mcap(file, [(1_700_000_000 * 10**9 + k * 10**7, f'{{"position": {0.01 * k}}}') for k in range(20)])
    with pytest.raises(highlevel.AnyReaderError, match="Profile is not ros2"), highlevel.AnyReader([file]):
        pass
    with pytest.raises(InputError, match=r"profile ''.*save them as CSV.*log_time") as refused:
        read_log(motor(file, columns={"position_m": "/motor.position"}), "time_s", "position_m")
    assert "reindex" not in str(refused.value) and "recover" not in str(refused.value)


@pytest.fixture(scope="module")
def gone_back(tmp_path_factory):
    """A bag of ROS 2 recorded at 100 Hz; the clock of its stamps is set back by 20 ms after the eighth message."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    State, Header, Time = (
        types.types[n] for n in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    folder, empty = tmp_path_factory.mktemp("bag") / "log", np.array([])
    with rosbag2.Writer(folder, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP) as out:
        states = out.add_connection("/motor", State.__msgtype__, typestore=types)
        for k in range(T.size):
            at = 1_700_000_000 * 10**9 + k * 10**7
            stamp = at - (20_000_000 if k >= 8 else 0)
            state = State(Header(Time(stamp // 10**9, stamp % 10**9), ""), ["m"], np.array([0.01 * k]), empty, empty)
            out.write(states, at, types.serialize_cdr(state, State.__msgtype__))
    return next(f for f in folder.iterdir() if f.suffix == ".mcap")


def test_a_bag_whose_stamps_go_back_is_read_by_either_remedy(gone_back):
    position = {"position_m": "/motor.position.m"}
    with pytest.raises(InputError, match=r"stamp of message 9 is 0.01 s before that of message 8") as refused:
        read_log(motor(gone_back, columns=position), "time_s", "position_m")
    assert "columns.time_s = '/motor.recorded'" in str(refused.value) and "or give rate" in str(refused.value)
    for keys in ({"columns": {**position, "time_s": "/motor.recorded"}}, {"columns": position, "rate": 100.0}):
        table = read_log(motor(gone_back, **keys), "time_s", "position_m")
        assert np.allclose(table.time_s, 0.01 * np.arange(T.size), atol=1e-9)
        assert np.allclose(table.position_m, 0.01 * np.arange(T.size))


def test_a_cut_bag_names_the_tool_of_its_format(gone_back, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(gone_back.read_bytes()[:40])
    with pytest.raises(InputError, match=r"mend it: mcap recover"):
        read_log(motor(cut, columns={"position_m": "/motor.position.m"}), "time_s", "position_m")
