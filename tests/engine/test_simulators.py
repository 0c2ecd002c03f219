"""Simulators that people have: against closed forms, bad places refused by name."""

from __future__ import annotations

import pickle
import re
import sys
from pathlib import Path

import numpy as np
import pytest

import jumpvision as jv
from jumpvision.base.schema import InputError

T = np.arange(0.0, 1.0, 0.01)
MASS = """<mujoco><option timestep="2e-3" integrator="RK4" gravity="0 0 0"/><worldbody><body name="cart">
<joint name="x" type="slide" axis="1 0 0" stiffness="50"/><geom name="block" size="0.05" mass="2.0"/></body></worldbody>
<actuator><motor name="pull" joint="x"/></actuator><sensor><jointvel name="speed" joint="x"/></sensor></mujoco>"""


def recording(**inputs):
    return jv.Recording("one", T, np.zeros(T.size), inputs=inputs)


def swing(w, damping, x0):
    """A damped oscillator let go at x0, in closed form (rates per unit mass)."""
    d = 0.5 * damping
    v = np.sqrt(w * w - d * d)
    return x0 * np.exp(-d * T) * (np.cos(v * T) + d / v * np.sin(v * T))


@pytest.fixture(scope="module")
def cart():
    pytest.importorskip("mujoco")
    return jv.from_mujoco(
        MASS,
        {"x": "joint.x.qpos", "v": "sensor.speed"},
        model={"joint.x.damping": "b", "geom.block.mass": "m"},
        start={"joint.x.qpos": "x0"},
        drive={"actuator.pull.ctrl": "force"},
        law=("joint.x.qfrc_applied", {"v": "joint.x.qvel"}),
    )


def test_a_mujoco_model_is_the_oscillator_it_describes(cart):
    """Runge-Kutta's error after 1 s at 2 ms: T (w h)^4 / 120 w x0 < 1e-9 m."""
    got = cart({"b": 3.0, "m": 4.0}, recording(x0=0.1, force=0.0))
    assert np.allclose(got["x"], swing(np.sqrt(50 / 4), 3 / 4, 0.1), atol=1e-8)
    rate = np.gradient(got["x"], T)[1:-1]  # w^3 x0 dt^2/6 off
    assert np.allclose(got["v"][1:-1], rate, atol=1e-4)


def test_its_drive_and_a_law_act_at_every_stage(cart):
    """A force that rises evenly on a free mass, x = c t^3 / 6 m, exact in Runge-Kutta; a law -b v as a damper."""
    free = jv.from_mujoco(
        MASS.replace(' stiffness="50"', ""), {"x": "joint.x.qpos"}, drive={"actuator.pull.ctrl": "force"}
    )
    assert np.allclose(free({}, recording(force=3.0 * T))["x"], 3.0 * T**3 / 12.0, atol=1e-12)
    there = recording(x0=0.1, force=(np.array([0.0, 2.0]), np.zeros(2)))
    by_law = cart({"b": 0.0, "m": 2.0}, there, lambda v: -3.0 * v)["x"]
    assert np.allclose(by_law, swing(5.0, 1.5, 0.1), atol=1e-7)


def test_a_mujoco_model_can_be_sent_and_kept(cart, tmp_path):
    there, p = recording(x0=0.1, force=0.0), {"b": 3.0, "m": 4.0}
    assert np.array_equal(pickle.loads(pickle.dumps(cart))(p, there)["x"], cart(p, there)["x"])
    other = jv.from_mujoco(MASS.replace("2.0", "3.0"), {"x": "joint.x.qpos"})
    assert cart.version != other.version


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"channels": {"x": "joint.y.qpos"}}, "y"),
        ({"channels": {"x": "joint.x.qpso"}}, "did you mean 'qpos'"),
        ({"channels": {"x": "joint x"}}, "KIND.NAME.FIELD"),
        ({"channels": {"x": "joint.x.qpos[3]"}}, r"no qpos\[3\]"),
        ({"channels": {"x": "joint.x.qpos"}, "model": {"joint.y.damping": "b"}}, r"no joint called 'y' \(x\)"),
        ({"channels": {"x": "joint.x.qpos"}, "model": {"joint.x.dampng": "b"}}, "did you mean 'damping'"),
        ({"channels": {"x": "joint.x.qpos"}, "model": {"body.cart.mass": "m"}}, "geom.NAME.mass"),
    ],
)
def test_a_place_that_is_not_there_is_named(given, said):
    pytest.importorskip("mujoco")
    with pytest.raises(InputError, match=said):
        jv.from_mujoco(MASS, **given)


def test_what_is_neither_parameter_nor_input_is_named(cart):
    with pytest.raises(InputError, match=r"'x0' is neither .*; allowed: b, force, m, x1"):
        cart({"b": 0.0, "m": 1.0}, recording(x1=0.1, force=0.0))
    with pytest.raises(InputError, match="one at each of the 100 times"):
        cart({"b": 0.0, "m": 1.0}, recording(x0=0.1, force=np.zeros(7)))


def test_an_unstable_run_is_an_error(cart):
    """MuJoCo itself starts anew from zero and goes on."""
    pytest.importorskip("mujoco")
    stiff = jv.from_mujoco(MASS, {"x": "joint.x.qpos"}, model={"joint.x.stiffness": "k"}, start={"joint.x.qpos": "x0"})
    with pytest.raises(RuntimeError, match=r"unstable.*Shorten"):
        stiff({"k": 1e12}, recording(x0=0.1))


PROGRAM = """
import csv, sys
import numpy as np
parameters = {r["name"]: float(r["value"]) for r in csv.DictReader(open(sys.argv[1]))}
rows = list(csv.DictReader(open(sys.argv[2])))
with open(sys.argv[3], "w") as out:
    print("time_s,height", file=out)
    for r in rows:
        print(r["time_s"], parameters["a"] * float(r["u"]) + parameters["start"], sep=",", file=out)
"""


def test_any_program_answers_by_csv(tmp_path):
    (tmp_path / "simulate.py").write_text(PROGRAM)
    command = [sys.executable, str(tmp_path / "simulate.py"), "{parameters}", "{inputs}", "{output}"]
    run = jv.from_program(command, ["height"])
    u = np.sin(T)
    assert np.array_equal(run({"a": 1 / 3}, recording(u=u, start=0.25, who="me"))["height"], 1 / 3 * u + 0.25)
    with pytest.raises(RuntimeError, match="no column 'hieght'; did you mean 'height'"):
        jv.from_program(command, ["hieght"])({"a": 1.0}, recording(u=u, start=0.0))
    with pytest.raises(RuntimeError, match="ended with 1: KeyError: 'start'"):
        run({"a": 1.0}, recording(u=u))
    with pytest.raises(InputError, match="no word holds"):
        jv.from_program(["./simulate"], ["height"])


@pytest.mark.long
def test_a_mujoco_model_is_questioned_and_its_law_named():
    """The page's own study; truth: the fall with quadratic drag in closed form, c = 0.05 N s^2/m^2 on 1 kg."""
    pytest.importorskip("mujoco")
    page = (Path(__file__).parents[2] / "docs" / "any_simulator.md").read_text(encoding="utf-8")
    block = re.search(r"## MuJoCo.*?```python\n(.*?)```", page, re.S)
    there: dict = {}
    exec(block[1], there)
    rng, t, drag = np.random.default_rng(1), np.arange(0.0, 0.8, 0.02), 0.05
    falls = [
        jv.Recording(
            f"fall {k}",
            t,
            h - np.log(np.cosh(np.sqrt(9.81 * drag) * t)) / drag + 3e-4 * rng.standard_normal(t.size),
            inputs={"height": h},
        )
        for k, h in enumerate((4.0, 5.0, 6.0))
    ]
    found = jv.diagnose(falls, there["study"])
    assert found.named == ("air_drag",)
    assert abs(found.fitted["c"].value - drag) < 3 * found.fitted["c"].sigma
