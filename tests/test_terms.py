"""Every registered force law: finite, of one shape, a force under a change of units; the cone; what a model refuses."""

import math
import re

import numpy as np
import pytest
from scipy.integrate import quad

from jumpvision.base.schema import InputError
from jumpvision.engine.laws.derivative import kinks
from jumpvision.engine.laws.python import value
from jumpvision.jumper.mechanisms import cone
from jumpvision.jumper.mechanisms.record import BED, FORCES, STATE, Body
from jumpvision.jumper.mechanisms.registry import MECHANISMS, STATIC, ModelParameters
from jumpvision.jumper.physics.model import Model

LAWS = {n: m.expression for n, m in MECHANISMS.items() if m.acts_on in FORCES}
FIELDS = ModelParameters.__dataclass_fields__
ROBOT = {
    "motor_mass": 1.125,
    "rod_mass": 0.175,
    "foot_mass": 0.04,
    "spring_stiffness": 3300.0,
    "spring_damping": 1.2,
    "gravity": 9.81,
    "foot_radius": 0.0381,
    "volume_fraction": 0.57,
    "grain_density": 1000.0,
}


def unit_of(name):
    return STATE[name][0] if name in STATE else FIELDS[name].metadata["unit"]


def exponents(unit):
    """(kg, m, s) exponents of a unit such as `N s/m` or `kg/m^3`."""
    base = {"kg": (1, 0, 0), "m": (0, 1, 0), "s": (0, 0, 1), "N": (1, 1, -2)}
    total = np.zeros(3, int)
    over, _, under = unit.partition("/")
    for part, sign in ((over, 1), (under, -1)):
        for factor in part.split():
            name, power = re.fullmatch(r"([A-Za-z]+)(?:\^(\d+))?", factor).groups()
            total += sign * int(power or 1) * np.array(base[name])
    return total


def draw(name, rng, n):
    """Values of a symbol in its physical range; arrays for what a track carries."""
    scale = {"z": 0.03, "z_g": 0.01, "z_stop": 0.01, "R": 0.04, "theta": 1.0, "mu": 1.0, "delta": 0.01, "lam": 0.01}
    value = scale.get(name, 2.0) * rng.uniform(0.5, 1.5, n if name in STATE and name not in ("R", "phi", "rho") else ())
    return value if np.ndim(value) else float(value)


@pytest.mark.parametrize("name", LAWS)
def test_law_is_finite_and_a_force(name):
    law, rng, n = LAWS[name], np.random.default_rng(7), 11
    # the declared parameters of the mechanism are exactly those the law takes
    assert set(MECHANISMS[name].names) == {s for s in law.symbols if s in FIELDS}

    values = {s: draw(s, rng, n) for s in law.symbols}
    force = law(np, **values)
    assert force.shape == (n,) and np.all(np.isfinite(force)) and np.any(force != 0)

    units = np.array([3.0, 0.7, 1.9])  # new units of kg, m, s
    scaled = {s: v / np.prod(units ** exponents(unit_of(s))) for s, v in values.items()}
    # the value is a number of newtons (of an inertia, kilograms) in the new units
    own = units ** exponents(MECHANISMS[name].acts_on.unit)
    np.testing.assert_allclose(law(np, **scaled) * np.prod(own), force, rtol=1e-12)


def test_every_parameter_is_declared_and_used():
    assert {p for m in MECHANISMS.values() for p in m.names} == set(FIELDS)
    rules = {Body.BED, Body.ROBOT, Body.LANDING, Body.DRIVE, Body.MOTOR, Body.HEIGHT, Body.TIME}
    for m in MECHANISMS.values():
        assert bool(m.equation) == (m.acts_on not in rules), m.name
        assert bool(m.law) == bool(m.acts_on.symbols), m.name
        assert (m.corrects in ROBOT) == (m.acts_on is Body.ROBOT), m.name
    assert ModelParameters().mu == 2.2 and ModelParameters().theta == pytest.approx(math.pi / 3)


@pytest.mark.parametrize("m", [m for m in MECHANISMS.values() if "z" in m.symbols], ids=lambda m: m.name)
def test_a_law_is_smooth_in_depth_on_each_side_of_its_bend_and_has_a_kink_there(m):
    """A solver's step that ends on the bend is of a smooth motion: on each side a polynomial of degree 15 is the law to
    1e-9 (a kink in the middle of a range of length L, of slope or curvature, leaves 1e-2 or 1e-3 of it), and that of
    one side is not the law of the other."""
    known = {"R": 0.0381, "theta": 1.05, "delta": 0.009, "lam": 0.05, "z_g": 1e-3, "k2": 2.0, "sigma_cone": 1e5}
    values = {s: known.get(s, 1.0) for s in m.symbols}
    bends = [float(value(k, np, values)) for k in kinks(m.expression.root, "z", (*m.names, *BED))]
    bend = bends[0] if bends else 0.1

    def law(z):
        return m.expression(np, **values | {"z": z})

    below, above = np.linspace(0.0, bend, 200), np.linspace(bend, 2.0 * bend, 200)
    scale = np.max(np.abs(law(np.concatenate([below, above]))))
    sides = [np.polynomial.Polynomial.fit(z, law(z), 15) for z in (below, above)]
    for z, side in zip((below, above), sides):
        np.testing.assert_allclose(side(z), law(z), atol=1e-9 * scale)
    if bends:
        assert np.max(np.abs(sides[0](above) - law(above))) > 1e-3 * scale


def test_cone_is_the_integral_of_its_faces():
    """m_a and the RFT volumes against numerical quadrature of (23)-(25), below and beyond the complete cone."""
    mu, theta, R = 2.2, 1.05, 0.038
    complete = R * math.tan(theta) / mu
    for z in (0.3 * complete, complete, 1.7 * complete):
        for area, volume in ((cone.flat_area, cone.flat_volume), (cone.cone_area, cone.cone_volume)):
            own = {"mu": mu, "theta": theta, "R": R}
            truth = quad(lambda x, area=area, own=own: area(np, z=x, **own), 0, z, points=[min(complete, z)])[0]
            assert volume(np, z=z, **own) == pytest.approx(truth, rel=1e-9)
    whole = {"C": 2.7, "phi": 0.57, "rho": 1000.0, "mu": mu, "theta": theta, "R": R}
    mass = cone.cone_mass(np, z=2 * complete, **whole)
    assert mass == pytest.approx(2.7 * 0.57 * 1000 * math.pi * R**2 * R * math.tan(theta) / 3, rel=1e-12)
    # the printed polynomial (33)
    z, t = 0.4 * complete, math.tan(theta)
    printed = 2.7 * 570 * mu * z * math.pi * (R**2 + (mu * z) ** 2 / (3 * t * t) - R * mu * z / t)
    assert cone.cone_mass(np, z=z, **whole) == pytest.approx(printed, rel=1e-12)


def parameters(**changes):
    return ModelParameters(
        **{"k1": 2100.0, "k2": 1200.0, "delta": 0.012, "alpha": 73.0, "b": 17.2, "C": 2.7, "mu": 2.0, **changes}
    )


@pytest.mark.parametrize(
    "ground, terms, changes, said",
    [
        ("granular", ("two_resistence",), {}, "did you mean 'two_resistance'"),
        ("granular", ("two_resistance",), {"k2": None}, "k2: missing; 'two_resistance' needs it"),
        ("granular", ("inertial_drag",), {}, "exactly one static force"),
        ("granular", ("two_resistance", "linear_penetration"), {"k": 1.0}, "exactly one static force"),
        ("granular", ("two_resistance", "two_resistance"), {}, "listed twice"),
        ("hard", ("two_resistance",), {}, "does not act on hard ground"),
        ("granular", ("two_resistance", "added_mass"), {}, "would create energy"),
        ("granular", ("two_resistance", "added_mass", "depth_drag"), {"b": 0.4}, "would create energy"),
        ("granular", ("two_resistance", "inertial_drag"), {"alpha": -1.0}, "alpha = -1.0: must be >= 0"),
        ("granular", ("two_resistance", "foot_mass"), {"dm_f": -0.04}, "foot_mass: 0 kg; must be > 0"),
        ("hard", ("payload",), {"dm": -2.0}, "motor_mass: -0.875"),
        ("sand", (), {}, "ground = 'sand'"),
    ],
)
def test_model_refuses(ground, terms, changes, said):
    with pytest.raises(InputError) as error:
        Model(ground, terms, parameters(**changes), **ROBOT)
    assert said in str(error.value)


def test_model_names_every_problem_at_once():
    with pytest.raises(InputError) as error:
        Model("granular", ("two_resistance", "depth_drag", "tlit"), ModelParameters(k1=1.0), **ROBOT)
    for word in ("k2", "delta", " b:", " C:", "'tilt'"):
        assert word in str(error.value)


def test_model_accepts_and_corrects():
    model = Model(
        "granular",
        ("two_resistance", "inertial_drag", "added_mass", "payload", "tilt", "spring_stiffness", "spring_damping"),
        parameters(dm=0.1, dg=-0.2, dk=50.0, dc=0.3),
        **ROBOT,
    )
    assert (model.m_m, model.g, model.k_s, model.c_s) == pytest.approx((1.225, 9.61, 3350.0, 1.5))
    text = str(model)
    assert "alpha v^2" in text and "(m_f + m_a(z)) a_f" in text and "k1 = 2100 N/m" in text


@pytest.mark.parametrize("static", STATIC)
def test_forces_on_a_track(static):
    """Each law by name on arrays: the sum over a model is the sum of its laws; a missing symbol is named."""
    p = parameters(k=2000.0, sigma_cone=3e5)
    model = Model(
        "granular", (static, "depth_drag", "added_mass", "payload"), ModelParameters(**{**vars(p), "dm": 0.1}), **ROBOT
    )
    z, v, a = np.linspace(0, 0.04, 9), np.linspace(-1, 0, 9), np.linspace(5, -5, 9)
    found = model.forces(z=z, v=v, a=a)
    assert list(found) == [static, "depth_drag", "added_mass"]
    slope = 2.7 * 570 * 2.0 * math.pi * np.maximum(0.0381 - 2.0 * z / math.sqrt(3), 0) ** 2
    np.testing.assert_allclose(found["depth_drag"], 17.2 * slope * v**2, rtol=1e-12)
    with pytest.raises(ValueError, match="'added_mass' needs a"):
        model.forces(z=z, v=v)
