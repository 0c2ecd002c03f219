"""Bags of ROS and MCAP files as logs: the messages' own stamps, names beside a series, refusals that name the file."""

from __future__ import annotations

import numpy as np
import pytest

from jumpvision.base.schema import InputError
from jumpvision.experiment.inputs.channels import READERS
from jumpvision.experiment.inputs.logs import read_log
from jumpvision.experiment.inputs.recordings import MotorLog

pytest.importorskip("rosbags")
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

T = np.linspace(0.0, 1.0, 101)


@pytest.fixture(scope="module", params=[StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def file(request, tmp_path_factory):
    """A hundred joint states, recorded 0.3 to 5 ms late; a topic without a stamp beside them."""
    types = get_typestore(Stores.ROS2_HUMBLE)
    State, Header, Time, Number = (
        types.types[f"{n[0]}/msg/{n[1]}"]
        for n in (
            ("sensor_msgs", "JointState"),
            ("std_msgs", "Header"),
            ("builtin_interfaces", "Time"),
            ("std_msgs", "Float64"),
        )
    )
    folder = tmp_path_factory.mktemp("bag") / "log"
    late = np.random.default_rng(1).uniform(3e5, 5e6, T.size).astype(int)
    with Writer(folder, version=9, storage_plugin=request.param) as out:
        states = out.add_connection("/joint_states", State.__msgtype__, typestore=types)
        plain = out.add_connection("/load", Number.__msgtype__, typestore=types)
        for k, t in enumerate(T):
            at = 1_700_000_000 * 10**9 + round(t * 1e9)
            head = Header(Time(at // 10**9, at % 10**9), "")
            state = State(head, ["wheel", "motor"], np.array([7.0, 0.01 * t]), np.array([]), np.array([]))
            out.write(states, at + int(late[k]), types.serialize_cdr(state, State.__msgtype__))
            out.write(plain, at, types.serialize_cdr(Number(float(k)), Number.__msgtype__))
    return next(f for f in folder.iterdir() if f.suffix in READERS)


def test_a_bag_is_read_by_its_own_stamps(file):
    held = READERS[file.suffix](file, ["/joint_states.position.motor", "/load.data"])
    motor = held.channels["/joint_states.position.motor"]
    assert np.array_equal(motor.values, 0.01 * T)
    assert np.allclose(motor.clock, T, atol=1e-9)  # whole nanoseconds
    assert np.array_equal(held.channels["/load.data"].values, np.arange(T.size))
    assert {"/joint_states.position.wheel", "/load.data"} <= set(held.names)


def test_a_bag_is_a_motor_log(file):
    """Its time is the file's own."""

    def read(name):
        return read_log(MotorLog(file.name, file, columns={"position_m": name}), "time_s", "position_m")

    table = read("/joint_states.position.motor")
    assert np.allclose(table["time_s"], T, atol=1e-9)
    assert np.allclose(table["position_m"], 0.01 * T)
    with pytest.raises(InputError, match=r"did you mean '/joint_states.position.motor'"):
        read("/joint_states.position.moter")
