"""One law, written once: all that is made of its tree is the same law; laws in one line of text, read or refused."""

from __future__ import annotations

import ctypes
import itertools
import json
import math
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import casadi
import numpy as np
import pytest
from numba import njit
from scipy.integrate import solve_ivp

from jumpvision.base.schema import InputError
from jumpvision.engine.laws import javascript
from jumpvision.engine.laws.compiled import Routine, module
from jumpvision.engine.laws.derivative import derivative, kinks
from jumpvision.engine.laws.dimension import check_dimension, dimension
from jumpvision.engine.laws.expression import LawError, parse
from jumpvision.engine.laws.python import value
from jumpvision.engine.laws.symbolic import NAMESPACE
from jumpvision.engine.laws.tree import smooth
from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.experiment.inputs.model import read_model
from jumpvision.jumper.mechanisms.own import mechanism, parameter, parameters_with, read_own
from jumpvision.jumper.mechanisms.record import FORCES, STATE, Body, Mechanism
from jumpvision.jumper.mechanisms.registry import MECHANISMS, ModelParameters
from jumpvision.jumper.physics.energy import energy_ledger
from jumpvision.jumper.physics.forcing import sinusoid
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.passivity import is_passive
from jumpvision.jumper.physics.sand import granular
from jumpvision.jumper.physics.sand.jump import beyond_seen, pack, simulate
from jumpvision.jumper.planning.jumper import INTRUDE, Drive, Memory, State
from jumpvision.jumper.planning.jumper import Jumper as Planned
from tests.worlds import sand

NODE = shutil.which("node")
DRAWS = 20
ROBOT = sand.ROBOT | {"motor_mass": 1.0, "rod_mass": 0.2, "spring_stiffness": 5000.0, "spring_damping": 5.0}
FORCING = sinusoid(7.0, 0.012, 0.0, 1.0)
SAND = Model("granular", ("linear_penetration",), ModelParameters(k=3000.0), **ROBOT)
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
    places = [granular.HOLE, granular.PAUSE, granular.LEFT, granular.CONTACT]
    memory[places] = at["z_g"], at["z_stop"], at["z_left"], 0.3
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


T = np.linspace(0.0, 1.0, 200)


def moved(*laws: Mechanism, **values: float) -> np.ndarray:
    """The rod of a jump on sand with these laws."""
    terms = (*SAND.terms, *(m.name for m in laws))
    parameters = parameters_with(tuple(m for m in laws if m.name not in MECHANISMS))(k=3000.0, **values)
    own = tuple(m for m in laws if m.name not in MECHANISMS)
    return simulate(Model("granular", terms, parameters, own=own, **ROBOT), FORCING, t=T, rtol=1e-9, atol=1e-11).rod


def test_a_law_of_the_motor_is_the_lag_in_closed_form():
    """(X_c - X) / tau - V_c as a law, integrated, is tau X' + X = command: to the tolerance of the steps."""
    lag = mechanism("mine", "motor", "g * ((X_c - X) / tau - V_c)",
                    [parameter("g", 1.0, 0.0, 1.0, ""), parameter("tau", 0.01, 1e-4, 1.0, "s")])  # fmt: skip
    closed = moved(MECHANISMS["motor_lag"], tau=0.01)
    np.testing.assert_allclose(moved(lag, mine_g=1.0, mine_tau=0.01), closed, rtol=0, atol=1e-9)
    assert np.abs(closed - moved()).max() > 1e-3
    np.testing.assert_allclose(moved(lag, mine_g=0.0, mine_tau=0.01), moved(), rtol=0, atol=1e-9)


def test_every_law_of_the_vocabulary_has_the_unit_of_its_body():
    for m in MECHANISMS.values():
        if m.expression:
            check_dimension(m.expression.root, m.units, m.acts_on.unit)
    assert {s for body in Body for s in body.symbols} | {"a"} == set(STATE)


def test_kinks_are_where_a_law_bends():
    two = MECHANISMS["two_resistance"]
    (bend,) = kinks(two.expression.root, "z", two.names)
    assert value(bend, np, {"delta": 0.012}) == 0.012
    cone = MECHANISMS["added_mass"]
    (bend,) = kinks(cone.expression.root, "z", (*cone.names, "R", "phi", "rho"))
    assert value(bend, np, {"R": 0.04, "theta": 1.0, "mu": 2.0}) == pytest.approx(0.04 * math.tan(1.0) / 2.0, rel=1e-15)
    assert kinks(MECHANISMS["linear_penetration"].expression.root, "z", ("k",)) == ()


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
    [("q / (1 - 1)", "divides by zero"), ("q * 9**9**9", "too large"), ("1e309 * q", "too large"),
     ("-" * 390 + "q", "deep"), ("q" + " + (q" * 60 + ")" * 60, "deep")],
)  # fmt: skip
def test_what_is_no_law_is_refused_at_once(law, said):
    with pytest.raises(LawError, match=said):
        parse(law, {"q": "q"})


@pytest.mark.parametrize("unit", ["9**9**9**9 N s/m", "(" * 1000, "N " * 40, "N^9999999", "N s^(2", "__import__"])
def test_what_is_no_unit_is_refused_at_once(unit):
    with pytest.raises(LawError, match="unknown unit"):
        dimension(unit)


CREEP = {
    "acts_on": "foot",
    "law": "q * sign(v) * sqrt(abs(v)) * z",
    "words": "a drag of the root of speed",
    "parameters": {"q": {"unit": "N s^0.5 m^-1.5", "start": 0.0, "range": [0.0, 500.0], "sigma": 20.0}},
}


def own(name: str, acts_on: str, law: str, values: dict[str, tuple[float, str]], **more: str):
    return mechanism(name, acts_on, law, [parameter(n, v, v, v, u) for n, (v, u) in values.items()], **more)


def having(model: Model, *laws, **parameters: float) -> Model:
    """The model with these laws and parameters of built-in ones."""
    given = {**vars(model.parameters), **parameters}
    return replace(
        model, terms=(*model.terms, *(m.name for m in laws)), own=laws, parameters=parameters_with(laws)(**given)
    )


def with_term(model: Model, term: str, **parameters: float) -> Model:
    return replace(model, terms=(*model.terms, term), parameters=replace(model.parameters, **parameters))


def test_the_energy_of_a_law_in_text_stands_in_the_ledger():
    """As that of the built-in friction, under its own name; the ledger closes as well."""
    built_in = energy_ledger(with_term(SAND, "viscous_friction", c_v=3.0), FORCING, end=0.8)
    written = energy_ledger(having(SAND, own("mine", "carriage", "-c * v_m", {"c": (3.0, "N s/m")})), FORCING, end=0.8)
    assert written.losses["mine"] == pytest.approx(built_in.losses["viscous_friction"], rel=1e-6)
    assert abs(written.residual) < 1e-6 * written.turnover


def test_positions_and_internal_states_against_another_integrator():
    """On hard ground before lift-off the jumper is one equation, solved here by scipy: a rail whose friction grows with
    the carriage's position, and a spring with a Maxwell branch. 1e-8 m: both integrators are told 1e-11."""
    hard = replace(SAND, ground="hard", terms=(), foot_mass=0.0)
    rail = own("rail", "carriage", "-c * v_m * (1 + abs(x_m) / l)", {"c": (6.0, "N s/m"), "l": (0.004, "m")})
    values = {"q": (900.0, "N/m"), "tau": (0.03, "s")}
    spring = own("maxwell", "spring", "-q * u", values, state="stretch_rate - u / tau", state_unit="m")
    model = having(hard, rail, spring)
    forcing = sinusoid(4.0, 0.0008, 0.0, 2.0)
    t = np.linspace(0.0, 0.5, 400)
    motion = simulate(model, forcing, t=t, rtol=1e-11, atol=1e-13)
    m_m, m_r, k, c, g = 1.0, 0.2, 5000.0, 5.0, 9.81
    rest = -(m_m + m_r) * g / k

    def rates(t: float, s: np.ndarray) -> list[float]:
        y, w, u = s
        x, v = (float(a[0]) for a in forcing([t]))
        ratio = m_m / (m_m + m_r)
        x_r, v_r = y - ratio * x, w - ratio * v
        v_m, x_m = v_r + v, x_r + x - rest
        force = -k * x_r - c * v_r - 900.0 * u
        friction = -6.0 * v_m * (1.0 + abs(x_m) / 0.004)
        return [w, -g + (force + friction) / (m_m + m_r), v_r - u / 0.03]

    ratio = m_m / (m_m + m_r)
    found, y = np.empty(t.size), np.array([rest, 0.0, 0.0])
    edges = [0.0, forcing.stop, t[-1]]
    for a, b in itertools.pairwise(edges):  # X_m' jumps where the motor stops
        here = (t >= a) & (t <= b)
        done = solve_ivp(rates, (a + 1e-15, b - 1e-12), y, t_eval=np.clip(t[here], a + 1e-15, b - 1e-12), rtol=1e-11,
                         atol=1e-14, max_step=1e-3)  # fmt: skip
        found[here] = done.y[0] - ratio * forcing(np.clip(t[here], a, b))[0]
        y = done.y[:, -1]
    assert motion.events.size == 0 and np.ptp(found) > 3e-4
    assert np.max(np.abs(motion.rod - found)) < 1e-8


def test_what_a_film_has_wrong():
    """A clock fast by 0.3 % and a lens, applied to a motion that is known."""
    clock = own("clock", "film_time", "r * time_s", {"r": (0.003, "")})
    lens = own("lens", "film_height", "b * (h / h_0)**2", {"b": (1e-4, "m"), "h_0": (0.02, "m")})
    model = having(SAND, clock, lens)
    t, h = np.array([0.0, 0.5, 1.0]), np.array([0.0, 0.01, 0.04])
    np.testing.assert_allclose(model.shown(t), 1.003 * t, rtol=1e-14)
    np.testing.assert_allclose(model.filmed(h, t), h + 1e-4 * (h / 0.02) ** 2, rtol=1e-14)


def test_a_shutter_that_reads_row_by_row():
    """Two films, one after the other, of y = v t - g t^2 / 2 seen at t + a y: r h h_rate / h_0 with r = a h_0 is that
    to first order; the next is (a y)^2 g / 2 <= 7e-9 m. Differences of a parabola are exact inside, and off by g dt / 2
    at an end: a y g dt / 2 <= 1.1e-7 m."""
    a, v, g, dt = 2e-3, 0.6, 9.81, 1e-3
    shutter = own("shutter", "film_height", "r * h * h_rate / h_0", {"r": (a * 0.02, "s"), "h_0": (0.02, "m")})
    t = np.arange(0.0, 0.1, dt)
    y = v * t - g * t**2 / 2
    later = t + a * y
    seen = having(SAND, shutter).filmed(np.tile(y, 2), np.tile(t, 2))
    np.testing.assert_allclose(seen, np.tile(v * later - g * later**2 / 2, 2), rtol=0, atol=1.2e-7)
    assert np.max(np.abs(seen - np.tile(y, 2))) > 8e-6


BAD = [
    ("q * w", "unknown symbol 'w'"),
    ("q * v", "a factor of"),
    ("q / v * z", "dimension"),
    ("q * v ^ 2", "write **"),
    ("q * (", "not a formula"),
    ("__import__('os').system('true')", "unknown function"),
    ("q.real", "is not read"),
    ("q if z else v", "is not read"),
    ("exp(v) * q", "divide it by a scale"),
    ("z + v", "same dimension"),
    ("sqrt(v, z)", "1 argument"),
    ("q * " + "(" * 90 + "z" + ")" * 90 + "*z" * 150, "at most 400"),
]


@pytest.mark.parametrize("law, said", BAD)
def test_a_bad_law_is_refused_with_one_error_and_its_place(tmp_path, law, said):
    folder = written(tmp_path, law)
    with pytest.raises(InputError) as e:
        open_experiment(folder)
    assert len(e.value.problems) == 1
    assert said in e.value.problems[0] and "[mechanism.creep] law" in e.value.problems[0]
    assert "line 13" in e.value.problems[0]


def written(tmp_path: Path, law: str, name: str = "creep", terms: str = '["linear_penetration", "creep"]') -> Path:
    text = f"""schema = 1
ground = "granular"
[robot]
motor_mass = 1.0
rod_mass = 0.2
spring_stiffness = 5000.0
foot_mass = 0.05
[model]
terms = {terms}
k = 3000.0
[mechanism.{name}]
acts_on = "foot"
law = {law!r}
[mechanism.{name}.parameters.q]
unit = "N s^0.5 m^-1.5"
start = 12.0
range = [0.0, 500.0]
"""
    (tmp_path / "experiment.toml").write_text(text)
    return tmp_path


def test_a_law_of_a_folder_reaches_the_model_and_a_name_that_shadows_is_refused(tmp_path):
    spec = open_experiment(written(tmp_path, "q * sign(v) * sqrt(abs(v)) * z")).sections["model"]
    (law,) = spec.mechanisms
    assert law.equation == "q * sign(v) * sqrt(abs(v)) * z" and law.names == ("creep_q",)
    assert read_model(tmp_path / "experiment.toml").mechanisms[0].equation == law.equation
    for name in ("tilt", "k1", "z"):
        with pytest.raises(InputError, match="is built in; give it another name"):
            open_experiment(written(tmp_path, "q * v", name))


def test_a_division_by_zero_at_rest_is_refused_with_its_symbol():
    table = {**CREEP, "law": "q * z / v", "parameters": {"q": {"unit": "N m^-1 m/s", "start": 1.0, "range": [0, 2]}}}
    _, problems = read_own({"creep": table}, "f: [mechanism]")
    assert len(problems) == 1 and "not finite at rest" in problems[0] and "v = z = 0" in problems[0]


def test_a_law_in_a_file_has_named_parts():
    table = {**CREEP, "law": "q * side * deep", "let": {"side": "sign(v) * sqrt(abs(v))", "deep": "maximum(z, 0)"}}
    found, problems = read_own({"creep": table}, "f: [mechanism]")
    whole, _ = read_own({"creep": {**CREEP, "law": "q * (sign(v) * sqrt(abs(v))) * maximum(z, 0)"}}, "f: [mechanism]")
    assert not problems and found["creep"].expression.root == whole["creep"].expression.root
    for let, said in ((3, "must be a table of texts"), ({"deep": "z +"}, "let deep = 'z +'"), ({"z": "1"}, "no new")):
        _, problems = read_own({"creep": {**table, "law": "q * deep", "let": let}}, "f: [mechanism]")
        assert len(problems) == 1 and said in problems[0]


def test_every_table_of_a_mechanism_is_checked_at_once():
    bad = {"q": {"unit": "zzz", "start": "a", "range": [2, 1]}}
    _, problems = read_own({"creep": {"acts_on": "leg", "law": 3, "word": "x", "parameters": bad}}, "f: [mechanism]")
    said = "\n".join(problems)
    for part in ("acts_on", "law = 3", "word: unknown key", "did you mean 'words'", "unit 'zzz'", "start = 'a'"):
        assert part in said


def test_dimensions_are_those_of_the_symbols():
    names = {"v": "v", "z": "z", "q": "q"}
    units = {"v": "m/s", "z": "m", "q": "N s^0.5 m^-1.5"}
    check_dimension(parse("q * sign(v) * sqrt(abs(v)) * z", names).root, units, "N")
    check_dimension(parse("maximum(q * sqrt(abs(v)) * z, 0)", names).root, units, "N")
    with pytest.raises(LawError, match="raised to a power that is not a number"):
        check_dimension(parse("abs(v)**(z/z)", names).root, units, "N")


@pytest.mark.parametrize(
    "acts_on, law, r, alone, part",
    [
        ("carriage", "-r * sign(v_m) * abs(v_m / v_0)**0.7", 0.3, True, True),
        ("carriage", "r * v_m / v_0", 0.3, False, False),
        ("carriage", "-r * sign(v_m) * (1 + x_m / x_0)", 0.3, False, False),  # negative friction below -x_0
        ("foot", "-r * exp(-z / x_0)", 30.0, False, False),  # pulls the foot into the bed
        ("foot", "-r * z / x_0", 0.1, False, True),  # a bed softer than the model's, which still resists
        ("spring", "-r * abs(stretch / x_0) * sign(stretch_rate)", 2.0, True, True),
        ("film_height", "r * (h / x_0)**2 * x_0", 2.0, None, None),
    ],
)
def test_what_gives_energy_is_told(acts_on, law, r, alone, part):
    """By the sign of the work over closed motions, which these laws show by eye."""
    sizes = {"v_0": (0.5, "m/s"), "x_0": (0.02, "m")}
    unit = "N" if acts_on != "film_height" else ""
    given = {"r": (r, unit), **{n: v for n, v in sizes.items() if n in law}}
    m = own("mine", acts_on, law, given)
    seen = {"z": (0.0, 0.03), "v": (-0.8, 0.0), "x_m": (-0.03, 0.03), "x_r": (-0.03, 0.03), "v_m": (-0.8, 0.8),
            "stretch": (-0.02, 0.005), "stretch_rate": (-0.5, 0.5)}  # fmt: skip
    model = having(replace(SAND, spring_damping=0.0), m)
    assert is_passive(model, m, seen, alone=True) is alone and is_passive(model, m, seen) is part


def test_a_maxwell_branch_takes_energy_and_its_negative_gives_it():
    seen = {"stretch": (-0.02, 0.005), "stretch_rate": (-0.5, 0.5)}
    for sign, passive in (("-", True), ("", False)):
        values = {"q": (900.0, "N/m"), "tau": (0.03, "s")}
        m = own("mine", "spring", f"{sign}q * u", values, state="stretch_rate - u / tau", state_unit="m")
        assert is_passive(having(SAND, m), m, seen) is passive


def test_a_plan_knows_the_law():
    """The planner's equations with a law in text are those with the built-in one, at states drawn at random."""
    rng = np.random.default_rng(3)
    mine = own("mine", "carriage", "-c * v_m", {"c": (3.0, "N s/m")})
    planners = [Planned(m, Drive(), np) for m in (with_term(SAND, "viscous_friction", c_v=3.0), having(SAND, mine))]
    for _ in range(20):
        state = dict(zip(("y", "w", "x_f", "v_f"), rng.normal(0.0, 0.1, 4)))
        command = tuple(rng.normal(0.0, 0.01, 3))
        rates = [p.equations(INTRUDE, State(**state), command, Memory(0.01)).rates for p in planners]
        np.testing.assert_allclose(*rates, rtol=1e-12)


def test_a_plan_refuses_a_law_with_a_memory():
    law = own("relaxing", "foot", "q * z * exp(-contact_s / tau)", {"q": (50.0, "N/m"), "tau": (0.1, "s")})
    with pytest.raises(InputError, match="depends on contact_s"):
        Planned(having(SAND, law), Drive(), np)


def test_leaving_the_range_that_was_seen_is_said_with_the_numbers():
    law = replace(own("mine", "foot", "q * v**2", {"q": (5.0, "kg/m")}), seen={"v": (-0.01, 0.0), "z": (0.0, 1.0)})
    model = having(SAND, law)
    said = beyond_seen(model, simulate(model, FORCING, t=np.linspace(0.0, 1.0, 500), rtol=1e-7, atol=1e-9))
    assert len(said) == 1 and "'mine' is used at v of -" in said[0] and "between -0.01 and 0" in said[0]


def test_a_plan_knows_what_a_law_carries_at_rest():
    """r exp(-z/l) is there before the foot moves; out of the ground, where a solver's iterates go, it does not grow."""
    law = own("mine", "foot", "r * exp(-z / l)", {"r": (6.0, "N"), "l": (0.008, "m")})
    plain, planner = (Planned(m, Drive(), np) for m in (SAND, having(SAND, law)))
    more = planner.yield_force(Memory(0.01)) - plain.yield_force(Memory(0.01))
    assert more == pytest.approx(6.0 * np.exp(-0.01 / 0.008), rel=1e-12)
    above = State(y=0.0, w=0.0, x_f=9.0, v_f=-0.1)
    assert np.isfinite(planner.equations(INTRUDE, above, (0.0, 0.0, 0.0), Memory(0.01)).rates).all()
