"""The recipe "Add a mechanism" of CONTRIBUTING.md in a copy of the package: two files, and all else follows.

About 40 s on an idle core: the copy's solver is compiled.
"""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from recipe import package_with, run_there

pytestmark = pytest.mark.long
RECORDS = '''"""Mechanisms of the recipe."""

from .record import Body, Mechanism, Parameter, Prior

C_Q = Parameter("c_q", "kg/m", "quadratic drag of the rail", lambda m: Prior(0.0, 0.0, 50.0, 1.0), lo=0)
C_B = Parameter("c_b", "N s/m^2", "damping by the bed per depth", lambda m: Prior(0.0, 0.0, 1e4, 10.0), lo=0)
C_P = Parameter("c_p", "N s/m^2", "friction of the rail per metre of it", lambda m: Prior(0.0, 0.0, 1e3, 10.0), lo=0)
C_A = Parameter("c_a", "N s/m", "friction of a rail that leans", lambda m: Prior(0.0, 0.0, 50.0, 1.0), lo=0)
LEAN = Parameter("lean", "", "angle of the rail, rad", lambda m: Prior(0.5, 0.0, 1.5, 0.1), lo=0)
C_U = Parameter("c_u", "N s/m", "drag of the rail that follows late", lambda m: Prior(0.0, 0.0, 50.0, 1.0), lo=0)
T_U = Parameter("t_u", "s", "time by which it is late", lambda m: Prior(0.02, 1e-3, 1.0, 0.01), lo=0, open_lo=True)
V_TOP = Parameter("v_top", "m/s", "speed that the motor follows with", lambda m: Prior(1.0, 0.1, 9.0, 0.1), lo=0)
T_TOP = Parameter("t_top", "s", "time in which it follows", lambda m: Prior(0.01, 1e-3, 1.0, 0.01), lo=0, open_lo=True)
WORDS = "a law of the recipe", "what the recipe says", "a test"
RAIL_DRAG = Mechanism(
    "rail_drag", Body.CARRIAGE, (C_Q,), "quadratic drag of the rail", "the air in the rail", "a test", "c_q |v_m| v_m",
    "-c_q * abs(v_m) * v_m",
)
BED_DAMPING = Mechanism(
    "bed_damping", Body.FOOT, (C_B,), "viscous bed", "the viscosity of the bed", "a test", "c_b z |v|", "-c_b * z * v",
    grounds=("granular",),
)
PLACE = Mechanism("place", Body.CARRIAGE, (C_P,), *WORDS, "c_p |x_m| v_m", "-c_p * abs(x_m) * v_m")
ANGLE = Mechanism("angle", Body.CARRIAGE, (C_A, LEAN), *WORDS, "c_a tan(lean) v_m", "-c_a * tan(lean) * v_m")
LATE = Mechanism(
    "late", Body.CARRIAGE, (C_U, T_U), *WORDS, "c_u u", "-c_u * u", state="(v_m - u) / t_u", state_unit="m/s"
)
SLOW = Mechanism(
    "slow", Body.MOTOR, (V_TOP, T_TOP), *WORDS, "slow", "e / sqrt(1 + (e / v_top)**2) - V_c", {"e": "(X_c - X) / t_top"}
)
'''
SCRIPT = """
import json, sys
from dataclasses import replace
from types import SimpleNamespace as Some
import numpy as np
import jumpvision.jumper.mechanisms.registry as registry
from jumpvision.jumper.question.words import sentence
from jumpvision.jumper.question.jumper import candidates
from jumpvision.experiment.inputs.model import model_of
from jumpvision.jumper.mechanisms.own import parameters_with
from jumpvision.jumper.physics.batch import jump_batch
from jumpvision.jumper.physics.energy import energy_ledger
from jumpvision.jumper.physics.forcing import sinusoid
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand.jump import simulate
from jumpvision.jumper.planning.jumper import Drive, Jumper

assert registry.__file__.startswith(sys.argv[1]), registry.__file__
robot = json.loads(sys.argv[2])
out = {}
spec, problems = model_of({"terms": ["rail_drag"], "c_q": 20.0}, "x [model]", {}, {})
assert not problems
out["wrong"] = model_of({"terms": ["rail_drag"], "c_q": -1.0}, "x [model]", {}, {})[1]
model = Model("hard", spec.terms, registry.ModelParameters(**spec.parameters), **robot)
out["printed"] = str(model)
out["held"] = float(Jumper(model, Drive(), np).rail(-0.5, 0.0, 0.0))
m = simulate(model, sinusoid(4.0, 0.001, 0.5), t=np.linspace(0.0, 0.5, 51), rtol=1e-10, atol=1e-12)
out["rod"], out["modes"] = m.rod.tolist(), sorted(set(m.mode.tolist()))
bed = registry.ModelParameters(k1=2100.0, k2=1500.0, delta=0.009, alpha=40.0, c_q=20.0, c_b=2000.0)
sand = Model("granular", ("two_resistance", "inertial_drag"), bed, **robot)
both = Model("granular", (*sand.terms, "rail_drag", "bed_damping"), bed, **robot)
books = energy_ledger(both, sinusoid(6.0, 0.018, 0.5), end=0.6)
out["residual"], out["turnover"], out["losses"] = books.residual, books.turnover, books.losses
offered = candidates(sand, command_drives=True)
out["offered"] = {n: [p.name + " " + p.unit for p in offered[n].parameters] for n in ("rail_drag", "bed_damping")}
out["on hard ground"] = "bed_damping" in candidates(model, command_drives=True)
heights = [Some(kind="single", simulated_m=0.02 + x, measured_m=0.01) for x in (0, 1e-3)]
nothing = dict.fromkeys(("gain", "left_over", "discovered"))
named = dict(named=("rail_drag",), indistinguishable=(), varies=(), p_value=0.0, status="complete", **nothing)
out["sentence"] = sentence(Some(adequate=False, heights=heights, **named))
values = dict(c_v=0.0, c_p=200.0, c_a=5.0, lean=0.9, c_u=4.0, t_u=0.02, v_top=0.8, t_top=0.004)
drive, t = sinusoid(6.0, 0.018, 0.5), np.linspace(0.0, 0.8, 201)
def made(*terms, own=(), **more):
    p = parameters_with(own)(**{**vars(bed), **values, **more})
    return Model("granular", (*sand.terms, *terms), p, own=own, **robot)
def rod(model):
    return simulate(model, drive, t=t, rtol=1e-9, atol=1e-11)
out["still"] = rod(sand).rod.tolist()
for name in ("place", "angle", "late", "slow"):
    m = registry.MECHANISMS[name]
    units = {p.name: p for p in m.parameters}
    same = replace(m, name="own_" + name)
    found = rod(made(name))
    out[name] = {"rod": found.rod.tolist(), "own": rod(made(same.name, own=(same,))).rod.tolist()}
    books = energy_ledger(made(name), drive, end=0.8)
    out[name] |= {"residual": books.residual / books.turnover, "loss": books.losses.get(name, 0.0) / books.turnover}
    out[name]["batch"] = jump_batch(made(name), drive.rows, tail=0.55)["jump_height_m"].tolist()
    out[name]["height"] = found.jump_height
    x = found.motor - found.rod
    out[name]["speed"] = float(np.abs(np.gradient(x, t)).max())
    out[name]["offered"] = name in candidates(sand, command_drives=True)
out["angled"] = rod(made("viscous_friction", c_v=5.0 * float(np.tan(0.9)))).rod.tolist()
out["plan"] = Jumper(made("slow"), Drive(), np).states("stuck")
print(json.dumps(out))
"""
ROBOT = {
    "motor_mass": 1.125,
    "rod_mass": 0.175,
    "foot_mass": 0.04,
    "spring_stiffness": 3300.0,
    "spring_damping": 1.2,
    "gravity": 9.81,
}


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    """What a copy of the package with two more mechanisms says and does."""
    place = tmp_path_factory.mktemp("recipe")
    lines = {
        "from . import cone,": "from . import recipe, cone,",
        "        robot.VISCOUS_FRICTION,\n": "        robot.VISCOUS_FRICTION,\n        recipe.RAIL_DRAG,\n",
        "        robot.TIME_OFFSET,\n": "        robot.TIME_OFFSET,\n        recipe.BED_DAMPING,\n        "
        "recipe.PLACE,\n        recipe.ANGLE,\n        recipe.LATE,\n        recipe.SLOW,\n",
    }
    package_with(
        place,
        {"jumper/mechanisms/recipe.py": RECORDS},
        edited={"jumper/mechanisms/registry.py": lines},
        copied=("jumper/physics",),
    )
    return run_there(place, SCRIPT, str(place), json.dumps(ROBOT))


def test_the_model_takes_it_and_prints_it(out):
    assert "M y'' = -M g + F_s - c_q |v_m| v_m" in out["printed"]
    assert "rail_drag: c_q = 20 kg/m" in out["printed"]
    assert out["wrong"] == ["x [model] c_q = -1.0: must be >= 0 kg/m (quadratic drag of the rail)"]


def test_the_motion_is_that_of_its_law(out):
    """The foot stays on hard ground: M a_r = -M g + F_s + F - m_m X'' by fixed steps of Runge and Kutta."""
    m_m, M, k, c, g = ROBOT["motor_mass"], 1.3, ROBOT["spring_stiffness"], ROBOT["spring_damping"], ROBOT["gravity"]
    w, A, phase, dt = 2 * math.pi * 4.0, 0.001, 0.5, 1e-4

    def slope(t, s, drag):
        u, a = (A * w * math.cos(w * t + phase), -A * w * w * math.sin(w * t + phase)) if t < 0.25 else (0.0, 0.0)
        v_m = s[1] + u
        return np.array([s[1], -g + (-k * s[0] - c * s[1] - drag * abs(v_m) * v_m - m_m * a) / M])

    def rod(drag):
        s, found = np.array([-M * g / k, -m_m / M * A * w * math.cos(phase)]), []
        for i in range(5001):
            t = i * dt
            if i % 100 == 0:
                found.append(s[0])
            if i == 2500:
                s = s + np.array([0.0, m_m / M * A * w * math.cos(w * 0.25 + phase)])
            half = t + 0.5 * dt
            k1 = slope(t, s, drag)
            k2 = slope(half, s + 0.5 * dt * k1, drag)
            k3 = slope(half, s + 0.5 * dt * k2, drag)
            s = s + dt / 6 * (k1 + 2 * k2 + 2 * k3 + slope(t + dt * (1 - 1e-9), s + dt * k3, drag))
        return np.array(found)

    assert out["modes"] == [1]  # at rest on the ground
    true, without = rod(20.0), rod(0.0)
    assert np.abs(true - without).max() > 1e-5  # m: what the drag does
    # both to about 1e-10 m: steps of 1e-4 s of a motion of 50 rad/s, (w dt)^4 of 1 mm, and |v| v bends at 0
    np.testing.assert_allclose(out["rod"], true, rtol=0, atol=2e-9)
    assert out["held"] == pytest.approx(20.0 * 0.25)  # N, by the planner's equations


def test_its_work_stands_in_the_ledger(out):
    """The energy balance closes only with the work of both laws in it."""
    assert abs(out["residual"]) < 1e-7 * out["turnover"]
    assert all(out["losses"][n] > 1e-3 * out["turnover"] for n in ("rail_drag", "bed_damping"))


def test_a_diagnosis_offers_and_names_it(out):
    assert out["offered"] == {"rail_drag": ["c_q kg/m"], "bed_damping": ["c_b N s/m^2"]}
    assert not out["on hard ground"]
    assert "because it lacks the air in the rail" in out["sentence"]


KINDS = ("place", "angle", "late", "slow")
"""A law of position, one with an angle, one with a memory, one of the actuator."""


@pytest.mark.parametrize("kind", KINDS)
def test_a_mechanism_of_any_kind_moves_the_robot(out, kind):
    """As one of the user's own does, to the last bit; in a batch, too; and its work closes the ledger."""
    found = out[kind]
    np.testing.assert_array_equal(found["rod"], found["own"])
    assert np.abs(np.subtract(found["rod"], out["still"])).max() > 1e-4
    assert found["batch"] == pytest.approx(found["height"], abs=1e-6)  # m: rtol 1e-7, of motions of 20 mm
    assert abs(found["residual"]) < 1e-7 and (found["loss"] > 1e-3 or kind == "slow")
    assert found["offered"]


def test_an_angle_is_an_angle_in_the_motion(out):
    np.testing.assert_allclose(out["angle"]["rod"], out["angled"], rtol=0, atol=1e-12)


def test_the_motor_is_no_faster_than_its_law_lets_it(out):
    assert out["slow"]["speed"] <= 0.8 and out["plan"] == ["y", "w", "X"]
    assert all(out[k]["speed"] > 0.6 for k in KINDS)
