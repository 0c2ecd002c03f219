"""One law, written once: all that is made of its tree is the same law.

Every mechanism, and a law of every symbol that a body offers, at random states: numpy, machine code, CasADi,
JavaScript, the integrator, derivatives.
"""

from __future__ import annotations

import ctypes
import json
import math
import os
import pickle
import shutil
import subprocess
import sys

import casadi
import numpy as np
import pytest
from numba import njit

from jumpvision.engine.laws import javascript
from jumpvision.engine.laws.compiled import Routine, module
from jumpvision.engine.laws.derivative import derivative, kinks
from jumpvision.engine.laws.dimension import check_dimension, dimension
from jumpvision.engine.laws.expression import LawError, parse
from jumpvision.engine.laws.python import value
from jumpvision.engine.laws.symbolic import NAMESPACE
from jumpvision.engine.laws.tree import smooth
from jumpvision.jumper.mechanisms.own import mechanism, parameter, parameters_with
from jumpvision.jumper.mechanisms.record import FORCES, STATE, Body, Mechanism
from jumpvision.jumper.mechanisms.registry import MECHANISMS, ModelParameters
from jumpvision.jumper.physics.forcing import sinusoid
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand import granular
from jumpvision.jumper.physics.sand.jump import pack, simulate

NODE = shutil.which("node")
DRAWS = 20
ROBOT = {
    "motor_mass": 1.0,
    "rod_mass": 0.2,
    "foot_mass": 0.05,
    "spring_stiffness": 5000.0,
    "spring_damping": 5.0,
    "gravity": 9.81,
    "foot_radius": 0.0254,
    "volume_fraction": 0.6,
    "grain_density": 1000.0,
}
EVERYTHING = (
    "q * sin({0}) * sqrt(1 + {0}**2) + q * where({0} > 0.1, {0}**3, abs({0})**1.5) - q * exp(-{0}) * sign({0}) "
    "+ q * minimum({0}, 0.2) / maximum(cos({0}), 0.3) + q * log(2 + {0}**2)**-2 * tan(x) "
    "- q * tanh({0} / 0.3)"
)


def made(name: str, body: Body, law: str, state: str = "") -> Mechanism:
    """A mechanism as one that is built in, with the parameters q and x."""
    return Mechanism(
        name,
        body,
        (parameter("q", 1.3, 0.0, 9.0, ""), parameter("x", 0.9, 0.0, 1.5, "")),
        *("a law of a test",) * 3,
        law=law,
        state=state,
        grounds=("granular",),
    )


OF_SYMBOLS = {
    f"{body.name}_{s}": made(f"of_{body.name}_{s}", body, EVERYTHING.format(s), "-u" if s == "u" else "")
    for body in Body
    for s in body.symbols
}
LAWS = {n: m for n, m in MECHANISMS.items() if m.expression} | OF_SYMBOLS
VALUES = {"theta": (0.8, 1.3), "scale": (0.9, 1.1), "phi": (0.5, 0.6), "rho": (900.0, 1100.0), "R": (0.02, 0.05)}
SIGNED = {"v", "v_m", "x_m", "x_r", "stretch", "stretch_rate", "h", "u", "X", "X_c", "V_c"}


def states(m: Mechanism, n: int = DRAWS) -> dict[str, np.ndarray]:
    """Values of all that a law is written in, (n,), on all its sides."""
    rng, out = np.random.default_rng(5), {}
    for s in m.symbols:
        low, high = VALUES.get(s, (-0.8, 0.8) if s in SIGNED else (0.01, 0.8))
        out[s] = rng.uniform(low, high, n)
    return out


@pytest.fixture(scope="module")
def by_node() -> dict[str, list[float]]:
    """Values of LAWS by JavaScript."""
    if NODE is None:
        pytest.skip("no node in PATH")
    lines = ["const laws = {"]
    for n, m in LAWS.items():
        lines.append(f"{n}: {javascript.function({'law': m.expression.root})},")
    asked = {n: [dict(zip(m.symbols, row)) for row in zip(*(x.tolist() for x in states(m).values()))]
             for n, m in LAWS.items()}  # fmt: skip
    lines += ["};", f"const asked = {json.dumps(asked)};", "const out = {};"]
    lines.append(
        "for (const n in laws) out[n] = asked[n].map((s) => laws[n](s).law);\nconsole.log(JSON.stringify(out));"
    )
    done = subprocess.run([NODE, "-"], input="\n".join(lines), capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def by_machine_code(m: Mechanism, at: dict[str, np.ndarray]) -> list[float]:
    """The law with its parameters and the bed as constants, its states as arguments."""
    inputs = tuple(n for n in m.symbols if n in m.acts_on.symbols and n not in ("R", "phi", "rho"))
    constants = tuple(n for n in m.symbols if n not in inputs)
    compiled = module(constants, {"law": Routine(inputs, (m.expression.root,))})
    array = ctypes.POINTER(ctypes.c_double)
    prepare = ctypes.CFUNCTYPE(None, array)(compiled.address["prepare"])
    law = ctypes.CFUNCTYPE(ctypes.c_double, array, *[ctypes.c_double] * len(inputs))(compiled.address["law"])
    out = []
    for i in range(DRAWS):
        numbers = np.zeros(compiled.size)
        numbers[: len(constants)] = [at[n][i] for n in constants]
        place = numbers.ctypes.data_as(array)
        prepare(place)
        out.append(law(place, *(float(at[n][i]) for n in inputs)))
    return out


@pytest.mark.parametrize("name", LAWS)
def test_all_that_is_made_of_a_law_is_the_same_law(name, by_node):
    m = LAWS[name]
    at = states(m)
    true = np.broadcast_to(m.expression(np, **at), DRAWS)
    assert np.all(np.isfinite(true)) and np.any(true != 0.0)
    scale = 1e-12 * np.abs(true).max()
    np.testing.assert_allclose(by_machine_code(m, at), true, rtol=1e-12, atol=scale)
    np.testing.assert_allclose(by_node[name], true, rtol=1e-12, atol=scale)
    symbols = {n: casadi.SX.sym(n) for n in m.symbols}
    symbolic = casadi.Function("law", list(symbols.values()), [m.expression(NAMESPACE, **symbols)])
    found = [float(symbolic(*(x[i] for x in at.values()))) for i in range(DRAWS)]
    np.testing.assert_allclose(found, true, rtol=1e-12, atol=scale)


@pytest.mark.parametrize("name", LAWS)
def test_derivatives_are_those_of_differences(name):
    """Central differences over h: off by h^2 of the third derivative and by rounding over h, 1e-7 and 1e-9 of the
    greatest value or slope; the smooth law the same."""
    m, h = LAWS[name], 1e-6
    at = states(m)
    for root in (m.expression.root, smooth(m.expression.root, 1e-3, 1e-2)):
        size = np.abs(value(root, np, at)).max()
        for n in m.symbols:
            slope = np.broadcast_to(value(derivative(root, n), np, at), DRAWS)
            up, down = (value(root, np, at | {n: at[n] + d}) for d in (h, -h))
            np.testing.assert_allclose(
                (up - down) / (2 * h), slope, rtol=1e-6, atol=1e-7 * (size + np.abs(slope).max())
            )


@njit
def asked(constants, t, s, v_m, x_m, x_r, stretch, rate):  # type: ignore[no-untyped-def]
    """Force and mass of the ground, forces of rail and spring, as the integrator has them."""
    p = constants[0]
    granular.prepare(p)
    force, mass = granular.resistance(t, -s[2], s[3], s, p)
    rail = granular.rail_law(p, (v_m, x_m, x_r, t, s[6])) if p.rail != 0 else 0.0
    spring = granular.spring_law(p, (stretch, rate, s[6])) if p.spring != 0 else 0.0
    return force, mass, rail, spring


@pytest.mark.parametrize("name", [n for n, m in LAWS.items() if m.acts_on in FORCES])
def test_the_integrator_has_the_law_of_the_record(name):
    m, rng = LAWS[name], np.random.default_rng(8)
    base = () if m.acts_on is Body.STATIC else ("linear_penetration",)
    extra = () if name == "inertial_drag" or m.acts_on is not Body.INERTIA else ("inertial_drag",)
    own = () if name in MECHANISMS else (m,)
    given = {"k": 2000.0, "alpha": 1e4, "q": 1.3, "x": 0.9} | {
        n: 0.5 for n in m.names if n not in ("q", "x", "k", "alpha", "theta")
    }
    names = parameters_with(own).__dataclass_fields__
    parameters = parameters_with(own)(**{n: x for n, x in given.items() if n in names})
    model = Model("granular", (*base, *extra, m.name), parameters, own=own, **ROBOT)
    constants = pack(model)
    z, v, v_m, x_m, x_r, stretch, rate, u, z_g, z_stop, z_left = rng.uniform(-0.5, 0.5, 11)
    at = {"z": abs(z), "v": -abs(v), "v_m": v_m, "x_m": x_m, "x_r": x_r, "stretch": stretch, "stretch_rate": rate,
          "z_g": abs(z_g), "z_stop": abs(z_stop), "z_left": abs(z_left), "u": u}  # fmt: skip
    at |= {"contact_s": 0.4, "time_s": 0.7}
    memory = np.zeros(granular.N_MEMORY)
    memory[[granular.HOLE, granular.PAUSE, granular.LEFT, granular.CONTACT]] = (
        at["z_g"],
        at["z_stop"],
        at["z_left"],
        0.3,
    )
    constants["memory"] = memory
    state = np.array([0.0, 0.0, -at["z"], at["v"], 0.0, 0.0, u])
    force, mass, rail, spring = asked(constants, 0.7, state, v_m, x_m, x_r, stretch, rate)
    of = {Body.INERTIA: mass, Body.CARRIAGE: rail, Body.RAIL: rail, Body.SPRING: spring}
    others = sum(
        float(model.force(model.mechanism(t), **at)) for t in base
    )  # the drag is of an inertia, not of a force
    softly = smooth(m.expression.root, 0.0, 1e-3) if m.acts_on is Body.SPRING else m.expression.root
    want = model.value(softly, **at)
    assert of.get(m.acts_on, force - others) == pytest.approx(float(want), rel=1e-12, abs=1e-12 * abs(force))


FORCING = sinusoid(7.0, 0.012, 0.0, 1.0)
SAND = Model("granular", ("linear_penetration",), ModelParameters(k=3000.0), **ROBOT)
T = np.linspace(0.0, 1.0, 200)


def moved(*laws: Mechanism, **values: float) -> np.ndarray:
    """The rod of a jump on sand with these laws."""
    terms = (*SAND.terms, *(m.name for m in laws))
    parameters = parameters_with(tuple(m for m in laws if m.name not in MECHANISMS))(k=3000.0, **values)
    own = tuple(m for m in laws if m.name not in MECHANISMS)
    return simulate(Model("granular", terms, parameters, own=own, **ROBOT), FORCING, t=T, rtol=1e-9, atol=1e-11).rod


def test_an_angle_is_an_angle_whatever_it_is_called():
    """-c tan(x) v_m is a viscous friction of c tan(x): by numpy and in the motion, built in and of one's own."""
    law, size = "-q * tan(x) * v_m", 5.0 * math.tan(0.9)
    built_in = made("angled", Body.CARRIAGE, law)
    given = [parameter("q", 5.0, 0.0, 9.0, "N s/m"), parameter("x", 0.9, 0.0, 1.5, "")]
    own = mechanism("angled", "carriage", law, given)
    assert built_in.expression(np, q=5.0, x=0.9, v_m=1.0) == pytest.approx(-6.30, abs=5e-3)
    plain = moved(MECHANISMS["viscous_friction"], c_v=size)
    assert np.abs(plain - moved()).max() > 1e-4
    for found in (moved(built_in, q=5.0, x=0.9), moved(own, angled_q=5.0, angled_x=0.9)):
        np.testing.assert_allclose(found, plain, rtol=0, atol=1e-12)


@pytest.mark.parametrize("law, state", [("-q * (1 + x_m / 0.05) * v_m", ""), ("-q * u", "(v_m - u) / 0.02")])
def test_position_and_memory_are_for_a_built_in_law_and_for_ones_own(law, state):
    built_in = made("mine", Body.CARRIAGE, law, state)
    own = Mechanism("mine", Body.CARRIAGE, tuple(parameter(f"mine_{n}", 1.0, 0.0, 9.0, "") for n in "qx"), "", "", "",
                    law=law, state=state, own=True)  # fmt: skip
    found = moved(built_in, q=5.0, x=0.9), moved(own, mine_q=5.0, mine_x=0.9)
    np.testing.assert_array_equal(*found)
    assert np.abs(found[0] - moved()).max() > 1e-5


def test_a_law_of_the_motor_is_the_lag_in_closed_form():
    """(X_c - X) / tau - V_c as a law, integrated, is tau X' + X = command: to the tolerance of the steps."""
    lag = mechanism("mine", "motor", "g * ((X_c - X) / tau - V_c)",
                    [parameter("g", 1.0, 0.0, 1.0, ""), parameter("tau", 0.01, 1e-4, 1.0, "s")])  # fmt: skip
    closed = moved(MECHANISMS["motor_lag"], tau=0.01)
    np.testing.assert_allclose(moved(lag, mine_g=1.0, mine_tau=0.01), closed, rtol=0, atol=1e-9)
    assert np.abs(closed - moved()).max() > 1e-3
    np.testing.assert_allclose(moved(lag, mine_g=0.0, mine_tau=0.01), moved(), rtol=0, atol=1e-9)


def test_a_law_in_other_symbols_is_refused_with_those_of_its_body():
    with pytest.raises(LawError, match=r"unknown symbol 'z'; known here: v_m, x_m, x_r, time_s, q, x"):
        made("wrong", Body.CARRIAGE, "-q * z")
    with pytest.raises(LawError, match="unknown symbol 'u'"):
        made("wrong", Body.CARRIAGE, "-q * u")  # without a state


def test_every_law_of_the_vocabulary_has_the_unit_of_its_body():
    for m in MECHANISMS.values():
        if m.expression:
            check_dimension(m.expression.root, m.units, m.acts_on.unit)
    assert {s for body in Body for s in body.symbols} | {"a"} == set(STATE)


def test_named_parts_of_a_law():
    let = {"depth": "maximum(z - a, 0)", "twice": "2 * depth"}
    law = parse("q * twice**2 + depth", {"z": "z", "a": "own_a", "q": "own_q"}, let)
    assert law(np, z=0.5, own_a=0.2, own_q=2.0) == pytest.approx(2.0 * 0.36 + 0.3)
    assert law(np, z=0.1, own_a=0.2, own_q=2.0) == 0.0
    with pytest.raises(LawError, match="made of itself"):
        parse("a", {}, {"a": "b + 1", "b": "a"})
    with pytest.raises(LawError, match="let z: is no new name"):
        parse("z", {"z": "z"}, {"z": "1"})
    with pytest.raises(LawError, match=r"let depth = 'z \+': not a formula"):
        parse("depth", {"z": "z"}, {"depth": "z +"})
    with pytest.raises(LawError, match="steps with its parts"):
        parse("a19", {"z": "z"}, {"a0": "z + z"} | {f"a{k + 1}": f"a{k} * a{k}" for k in range(19)})


@pytest.mark.parametrize(
    "law, said",
    [
        ("q / 0", "divides by zero"),
        ("q / (1 - 1)", "divides by zero"),
        ("q * 9**9**9", "too large"),
        ("1e309 * q", "too large"),
        ("-" * 390 + "q", "deep"),
        ("q" + " + (q" * 60 + ")" * 60, "deep"),
    ],
)
def test_what_is_no_law_is_refused_at_once(law, said):
    with pytest.raises(LawError, match=said):
        parse(law, {"q": "q"})


@pytest.mark.parametrize("unit", ["9**9**9**9 N s/m", "(" * 1000, "N " * 40, "N^9999999", "N s^(2", "__import__"])
def test_what_is_no_unit_is_refused_at_once(unit):
    with pytest.raises(LawError, match="unknown unit"):
        dimension(unit)


def test_kinks_are_where_a_law_bends():
    two = MECHANISMS["two_resistance"]
    (bend,) = kinks(two.expression.root, "z", two.names)
    assert value(bend, np, {"delta": 0.012}) == 0.012
    cone = MECHANISMS["added_mass"]
    (bend,) = kinks(cone.expression.root, "z", (*cone.names, "R", "phi", "rho"))
    assert value(bend, np, {"R": 0.04, "theta": 1.0, "mu": 2.0}) == pytest.approx(0.04 * math.tan(1.0) / 2.0, rel=1e-15)
    assert kinks(MECHANISMS["linear_penetration"].expression.root, "z", ("k",)) == ()


def test_a_tree_from_another_process_is_the_same_tree():
    """Its hash does not depend on the process, so that parts of both are found in one dictionary."""
    code = "import pickle, sys; from jumpvision.engine.laws.expression import parse; "
    code += "sys.stdout.buffer.write(pickle.dumps(parse('-q * exp(-z / q)', {n: n for n in 'qz'}).root))"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, check=True, env={"PYTHONHASHSEED": "1", **os.environ}
    )
    other, here = pickle.loads(done.stdout), parse("-q * exp(-z / q)", {n: n for n in "qz"}).root
    assert {other: 1} == {here: 1} and derivative(other, "z") == derivative(here, "z")
