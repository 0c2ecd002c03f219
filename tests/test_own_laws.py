"""Laws in one line of text: read, refused with the remedy, and run inside the compiled jumper."""

from __future__ import annotations

import itertools
import math
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jumpvision.base.schema import InputError
from jumpvision.engine.laws.dimension import check_dimension
from jumpvision.engine.laws.expression import LawError, parse
from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.experiment.inputs.model import read_model
from jumpvision.jumper.mechanisms.own import mechanism, parameter, parameters_with, read_own
from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.batch import jump_batch
from jumpvision.jumper.physics.energy import energy_ledger
from jumpvision.jumper.physics.forcing import sinusoid
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.passivity import is_passive
from jumpvision.jumper.physics.sand.jump import beyond_seen, simulate
from jumpvision.jumper.planning.jumper import INTRUDE, Drive, Memory, State
from jumpvision.jumper.planning.jumper import Jumper as Planned

CREEP = {
    "acts_on": "foot",
    "law": "q * sign(v) * sqrt(abs(v)) * z",
    "words": "a drag of the root of speed",
    "parameters": {"q": {"unit": "N s^0.5 m^-1.5", "start": 0.0, "range": [0.0, 500.0], "sigma": 20.0}},
}
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
SAND = Model("granular", ("linear_penetration",), ModelParameters(k=3000.0), **ROBOT)
FORCING = sinusoid(7.0, 0.012, 0.0, 1.0)


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


@pytest.mark.parametrize(
    "term, parameters, acts_on, law, values",
    [
        ("viscous_friction", {"c_v": 3.0}, "carriage", "-c * v_m", {"c": (3.0, "N s/m")}),
        ("coulomb_friction", {"F_c": 1.5}, "carriage", "-F * sign(v_m)", {"F": (1.5, "N")}),
        ("inertial_drag", {"alpha": 5.0}, "foot", "q * v**2", {"q": (5.0, "kg/m")}),
        ("spring_hardening", {"k_3": 1e6}, "spring", "-k * stretch**3", {"k": (1e6, "N m^-3")}),
    ],
)
def test_a_law_in_text_moves_the_robot_as_the_built_in_one(term, parameters, acts_on, law, values):
    """To the last bit: both are the same tree, but for v^2 as drag and as a force of the foot."""
    t = np.linspace(0.0, 1.2, 1500)
    built_in = simulate(with_term(SAND, term, **parameters), FORCING, t=t, rtol=1e-9, atol=1e-11)
    written = simulate(having(SAND, own("mine", acts_on, law, values)), FORCING, t=t, rtol=1e-9, atol=1e-11)
    without = simulate(SAND, FORCING, t=t, rtol=1e-9, atol=1e-11)
    assert np.max(np.abs(built_in.rod - without.rod)) > 1e-4
    np.testing.assert_array_equal(built_in.rod, written.rod)
    assert [e["kind"] for e in built_in.events] == [e["kind"] for e in written.events]


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
    spring = own(
        "maxwell",
        "spring",
        "-q * u",
        {"q": (900.0, "N/m"), "tau": (0.03, "s")},
        state="stretch_rate - u / tau",
        state_unit="m",
    )
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


def test_dry_friction_that_changes_along_the_rail_holds_the_carriage():
    law = own("dry", "carriage", "-F * sign(v_m) * (1 + abs(x_m) / l)", {"F": (8.0, "N"), "l": (0.02, "m")})
    motion = simulate(having(SAND, law), FORCING, t=np.linspace(0.0, 1.5, 1000), rtol=1e-8, atol=1e-10)
    assert "rail_stick" in motion.events["kind"]
    assert np.ptp(motion.motor[-100:]) < 1e-9  # held at the end


def test_a_batch_varies_the_parameters_of_a_law_in_text():
    law = mechanism("mine", "carriage", "-c * v_m", [parameter("c", 3.0, 0.0, 10.0, "N s/m")])
    rows, c = FORCING.rows, np.array([0.0, 1.0, 3.0])
    both = [
        jump_batch(having(SAND, law), rows, mine_c=c)["jump_height_m"],
        jump_batch(with_term(SAND, "viscous_friction", c_v=1.0), rows, c_v=c)["jump_height_m"],
    ]
    np.testing.assert_allclose(*both, rtol=0, atol=1e-9)
    assert np.all(np.diff(both[0]) < 0)


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


def test_parameters_of_ones_own_survive_another_process():
    law = mechanism("mine", "carriage", "-c * v_m", [parameter("c", 3.0, 0.0, 10.0, "N s/m")])
    p = parameters_with((law,))(k=1.0, mine_c=2.0)
    assert pickle.loads(pickle.dumps(p)) == p


BAD = [
    ("q * w", "unknown symbol 'w'"),
    ("q * v", "a factor of"),
    ("q * v**p", "unknown symbol 'p'"),
    ("q / v * z", "dimension"),
    ("q * v ^ 2", "write **"),
    ("q * (", "not a formula"),
    ("__import__('os').system('true')", "unknown function"),
    ("(lambda: q)()", "unknown function"),
    ("q.real", "is not read"),
    ("q if z else v", "is not read"),
    ("[q for q in z]", "is not read"),
    ("exp(v) * q", "divide it by a scale"),
    ("tanh(v) * q", "tanh of a quantity of the dimension"),
    ("z + v", "same dimension"),
    ("sqrt(v, z)", "1 argument"),
    ("q * " + "(" * 90 + "z" + ")" * 90 + "*z" * 150, "at most 400"),
    ("5", "dimension"),
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


def test_a_law_of_a_folder_reaches_the_model(tmp_path):
    spec = open_experiment(written(tmp_path, "q * sign(v) * sqrt(abs(v)) * z")).sections["model"]
    (law,) = spec.mechanisms
    assert law.equation == "q * sign(v) * sqrt(abs(v)) * z" and law.names == ("creep_q",)
    assert read_model(tmp_path / "experiment.toml").mechanisms[0].equation == law.equation


@pytest.mark.parametrize("name", ["tilt", "k1", "z"])
def test_a_name_that_shadows_is_refused(tmp_path, name):
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
    for let, said in (
        (3, "must be a table of texts"),
        ({"deep": "z +"}, "let deep = 'z +'"),
        ({"z": "1"}, "no new name"),
    ):
        _, problems = read_own({"creep": {**table, "law": "q * deep", "let": let}}, "f: [mechanism]")
        assert len(problems) == 1 and said in problems[0]


def test_every_table_of_a_mechanism_is_checked_at_once():
    table = {
        "acts_on": "leg",
        "law": 3,
        "word": "x",
        "parameters": {"q": {"unit": "zzz", "start": "a", "range": [2, 1]}},
    }
    _, problems = read_own({"creep": table}, "f: [mechanism]")
    said = "\n".join(problems)
    for part in (
        "acts_on",
        "law = 3",
        "word: unknown key",
        "did you mean 'words'",
        "unknown unit 'zzz'",
        "start = 'a'",
    ):
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
        ("carriage", "-r * x_m / x_0", 0.3, True, True),  # a spring of the rail: what it takes it gives back
        ("carriage", "-r * sign(v_m) * (1 + x_m / x_0)", 0.3, False, False),  # negative friction below -x_0
        ("foot", "r * exp(-z / x_0)", 2.0, True, True),
        ("foot", "-r * exp(-z / x_0)", 30.0, False, False),  # pulls the foot into the bed
        ("foot", "-r * z / x_0", 0.1, False, True),  # a bed softer than the model's, which still resists
        ("spring", "-r * abs(stretch / x_0) * sign(stretch_rate)", 2.0, True, True),
        ("spring", "r * abs(stretch / x_0) * sign(stretch_rate)", 2.0, False, False),
        ("film_height", "r * (h / x_0)**2 * x_0", 2.0, None, None),
    ],
)
def test_what_gives_energy_is_told(acts_on, law, r, alone, part):
    """By the sign of the work over closed motions, which these laws show by eye."""
    sizes = {"v_0": (0.5, "m/s"), "x_0": (0.02, "m")}
    unit = "N" if acts_on != "film_height" else ""
    given = {"r": (r, unit), **{n: v for n, v in sizes.items() if n in law}}
    m = own("mine", acts_on, law, given)
    seen = {
        "z": (0.0, 0.03),
        "v": (-0.8, 0.0),
        "x_m": (-0.03, 0.03),
        "x_r": (-0.03, 0.03),
        "v_m": (-0.8, 0.8),
        "stretch": (-0.02, 0.005),
        "stretch_rate": (-0.5, 0.5),
    }
    model = having(replace(SAND, spring_damping=0.0), m)
    assert is_passive(model, m, seen, alone=True) is alone and is_passive(model, m, seen) is part


@pytest.mark.parametrize("sign, passive", [("-", True), ("", False)])
def test_what_gives_energy_with_an_internal_state(sign, passive):
    """A Maxwell branch takes energy, its negative gives it."""
    values = {"q": (900.0, "N/m"), "tau": (0.03, "s")}
    m = own("mine", "spring", f"{sign}q * u", values, state="stretch_rate - u / tau", state_unit="m")
    seen = {"stretch": (-0.02, 0.005), "stretch_rate": (-0.5, 0.5)}
    assert is_passive(having(SAND, m), m, seen) is passive


def test_a_law_is_typeset():
    law = parse("-r * sign(v) * abs(v / v_0)**1.5 * exp(-z / l)", {n: n for n in ("r", "v", "v_0", "z", "l")})
    assert math.isclose(law(np, r=2.0, v=-0.5, v_0=0.5, z=0.0, l=1.0), 2.0)
    from matplotlib.mathtext import MathTextParser

    MathTextParser("path").parse(f"${law.typeset()}$")


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


def test_a_plan_knows_what_a_law_carries_at_rest():
    """r exp(-z/l) is there before the foot moves; out of the ground, where a solver's iterates go, it does not grow."""
    law = own("mine", "foot", "r * exp(-z / l)", {"r": (6.0, "N"), "l": (0.008, "m")})
    plain, planner = (Planned(m, Drive(), np) for m in (SAND, having(SAND, law)))
    more = planner.yield_force(Memory(0.01)) - plain.yield_force(Memory(0.01))
    assert more == pytest.approx(6.0 * np.exp(-0.01 / 0.008), rel=1e-12)
    above = State(y=0.0, w=0.0, x_f=9.0, v_f=-0.1)
    assert np.isfinite(planner.equations(INTRUDE, above, (0.0, 0.0, 0.0), Memory(0.01)).rates).all()


def test_a_plan_refuses_a_law_with_a_memory():
    law = own("relaxing", "foot", "q * z * exp(-contact_s / tau)", {"q": (50.0, "N/m"), "tau": (0.1, "s")})
    with pytest.raises(InputError, match="depends on contact_s"):
        Planned(having(SAND, law), Drive(), np)


def test_leaving_the_range_that_was_seen_is_said_with_the_numbers():
    law = replace(own("mine", "foot", "q * v**2", {"q": (5.0, "kg/m")}), seen={"v": (-0.01, 0.0), "z": (0.0, 1.0)})
    model = having(SAND, law)
    said = beyond_seen(model, simulate(model, FORCING, t=np.linspace(0.0, 1.0, 500), rtol=1e-7, atol=1e-9))
    assert len(said) == 1 and "'mine' is used at v of -" in said[0] and "between -0.01 and 0" in said[0]
