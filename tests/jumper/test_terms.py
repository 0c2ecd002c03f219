"""The registered force laws: their parameters, the cone, their sum on a track; what a model refuses."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from jumpvision.base.schema import InputError
from jumpvision.jumper.mechanisms import cone
from jumpvision.jumper.mechanisms.record import Body
from jumpvision.jumper.mechanisms.registry import MECHANISMS, STATIC, ModelParameters
from jumpvision.jumper.physics.model import Model
from tests.worlds import sand

FIELDS = ModelParameters.__dataclass_fields__
ROBOT = sand.ROBOT


def test_every_parameter_is_declared_and_used():
    assert {p for m in MECHANISMS.values() for p in m.names} == set(FIELDS)
    rules = {Body.BED, Body.ROBOT, Body.LANDING, Body.DRIVE, Body.MOTOR, Body.HEIGHT, Body.TIME}
    for m in MECHANISMS.values():
        assert bool(m.equation) == (m.acts_on not in rules), m.name
        assert bool(m.law) == bool(m.acts_on.symbols), m.name
        assert (m.corrects in ROBOT) == (m.acts_on is Body.ROBOT), m.name
    assert ModelParameters().mu == 2.2 and ModelParameters().theta == pytest.approx(math.pi / 3)


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
        ("granular", ("two_resistance", "two_resistance"), {}, "listed twice"),
        ("hard", ("two_resistance",), {}, "does not act on hard ground"),
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
