"""Air through the bed, walls and floor: printed numbers of the thesis, limits that are known, and the check command."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from jumpvision.cli import main
from jumpvision.experiment.inputs.sections import Actuation, Robot
from jumpvision.experiment.stages.bed.geometry import reach
from jumpvision.jumper.physics.air import (
    bed_weight,
    bottom_force,
    bottom_height,
    ergun,
    floor,
    operating_point,
    side_walls,
    wu,
)

AIR = {"viscosity": 1.82e-5, "density": 1.2}


def test_the_onsets_of_the_thesis():
    """0.34 m/s after Ergun, 0.40 m/s after Wu for 1 mm grains of 1000 kg/m^3 at phi 0.57 (two digits printed)."""
    weight = bed_weight(0.57, 1000.0, 9.81)
    assert ergun(0.57, 1e-3, **AIR).speed(weight) == pytest.approx(0.34, abs=0.005)
    assert wu(0.57, 1e-3, **AIR).speed(weight) == pytest.approx(0.40, abs=0.0051)


def test_the_pressure_drops_worked_out_by_hand():
    """phi = 0.5, d = 1 mm, mu = 2e-5, rho = 1: Ergun 150 mu 0.25/(1e-6 0.125) = 6000 and 1.75 * 0.5/0.125/1e-3 = 7000.

    Wu: s = sqrt(0.5), tau = 1.5726, beta = 1/(1 - s); 72 mu tau 2e6 and 3 tau 0.5/(4e-3 0.125) (1.5 + ...).
    """
    air = {"viscosity": 2e-5, "density": 1.0}
    e = ergun(0.5, 1e-3, **air)
    assert (e.viscous, e.inertial) == pytest.approx((6000.0, 7000.0), rel=1e-12)
    w = wu(0.5, 1e-3, **air)
    s = 0.70710678
    tau = 0.5 * (1 + 0.35355339 + s * np.hypot(0.41421356, 0.5) / 0.29289322)
    assert w.viscous == pytest.approx(72 * 2e-5 * tau * 2e6, rel=1e-6)
    assert w.inertial == pytest.approx(3000 * tau * (1.5 + 0.29289322**4 - 2.5 * 0.29289322**2), rel=1e-6)
    assert e(e.speed(1234.0)) == pytest.approx(1234.0, rel=1e-12)


def test_the_force_that_a_floor_adds_worked_out_by_hand():
    """Nothing far above, -A at zeta, A ((1 - e)^2 - 1) = 0.9525 A one length 1/rate below it."""
    assert bottom_force([1.0, 0.09, 0.08], 0.09, 20.0, 100.0) == pytest.approx([0.0, -20.0, 39.05], abs=5e-3)
    said = floor(0.10, 45.0, 0.0381, 0.03, constant=7.7e-4, law=(1000.0, 50.0))
    zeta = 7.7e-4 * (45.0 / 0.0381) ** 0.5
    added = 1000.0 * np.pi * 0.0381**2 * ((1 - np.exp(50.0 * (zeta - 0.07))) ** 2 - 1)
    assert f"where the floor adds {added:.2g} N" in said.text


def test_the_fan_works_where_its_curve_crosses():
    """Drop 1000 v + 1000 v^2 Pa over 1 m, weight 2000 Pa (onset 1 m/s), fan 3000 - 1000 v."""
    from jumpvision.jumper.physics.air import Drop

    drop = Drop(1000.0, 1000.0)
    speed, pressure = np.array([0.0, 3.0]), np.array([3000.0, 0.0])
    # at rest 1000 v + 1000 v^2 = 3000 - 1000 v gives v = 1, just the onset; a stronger fan lifts the bed
    strong = operating_point(drop, 1.0, 2000.0, speed, 1.2 * pressure)
    assert strong[:2] == pytest.approx((1.6 / 1.2, 2000.0)) and strong[2]
    weak = operating_point(drop, 1.0, 2000.0, speed, 0.5 * pressure)
    v = (-1500 + np.sqrt(1500**2 + 4 * 1000 * 1500)) / 2000
    assert weak[:2] == pytest.approx((v, 1500 - 500 * v)) and not weak[2]
    duct = operating_point(drop, 1.0, 2000.0, speed, 0.5 * pressure, loss=1000.0)
    assert duct[0] == pytest.approx((-1500 + np.sqrt(1500**2 + 4 * 2000 * 1500)) / 4000)
    assert np.isnan(operating_point(drop, 1.0, 2000.0, [0.0, 0.2], [3000.0, 2900.0])[0])


def test_a_foot_goes_as_deep_as_weight_and_motor_press_it():
    """On 4,000 N/m: the weight, and the motor's mass times the greatest acceleration of its law, by differences."""
    robot, law = Robot(motor_mass=1.1, rod_mass=0.2, foot_mass=0.04), Actuation(frequency=7.0, amplitude=0.01)
    t = np.linspace(0.0, 1.0, 100_001)
    push = np.abs(np.diff(0.01 * np.sin(2.0 * math.pi * 7.0 * t), 2)).max() / 1e-10
    depth = (1.34 * robot.gravity + 1.1 * push) / 4000.0
    assert reach(robot, law, lambda z: 4000.0 * z) == pytest.approx(depth, rel=1e-5)
    assert reach(robot, None, lambda z: 4000.0 * z) == pytest.approx(1.34 * robot.gravity / 4000.0, rel=1e-9)


def test_walls_and_floor_of_the_thesis():
    """56 cm over 7.62 cm is 7.3 foot diameters; C = 7.7e-4 is what makes zeta_b 9 cm at 0.46 N/cm^3 and 25 cm."""
    ratio, room = side_walls(0.56, 0.56, 0.0381, ratio=5.0)
    assert ratio.value == pytest.approx(7.35, abs=0.01) and ratio.ok
    assert room.value == pytest.approx(0.2419, abs=1e-4) and room.ok
    assert not side_walls(0.56, 0.3, 0.0381, ratio=5.0)[0].ok
    force = 4.6e5 * np.pi * 0.0381**2 * 0.25
    assert bottom_height(force, 0.0381, 7.7e-4) == pytest.approx(0.09, abs=0.001)
    assert floor(0.25, force, 0.0381, 0.03, constant=7.7e-4).ok
    assert not floor(0.10, force, 0.0381, 0.03, constant=7.7e-4).ok


BED = """
[robot]
motor_mass = 1.125
rod_mass = 0.175
foot_radius = 0.0381
[actuation]
kind = "single"
frequency = 7.0
amplitude = 0.01875
[bed]
volume_fraction = 0.57
solid_volume = 0.045
length = 0.56
width = 0.56
grain_diameter = 0.001
[fan]
speed = [0.0, 0.3, 0.6, 0.9]
pressure = [2500.0, 2300.0, 1800.0, 500.0]
"""


def check(tmp_path, capsys, text):
    (tmp_path / "experiment.toml").write_text(text)
    assert main(["check", str(tmp_path), "--json"]) == 0
    out, err = capsys.readouterr()
    return json.loads(out), err


def test_check_warns_with_the_numbers(tmp_path, capsys):
    data, err = check(tmp_path, capsys, BED)
    assert data["warnings"] == [] and "warning" not in err
    (found,) = data["geometry"].values()
    assert found["fluidisation"]["fluidised"] is True
    assert found["fluidisation"]["onset_wu_m_s"] == pytest.approx(0.395, abs=0.001)
    data, err = check(tmp_path, capsys, BED.replace("width = 0.56", "width = 0.3").replace("2500", "900")
                      .replace("2300", "800").replace("1800", "600"))  # fmt: skip
    said = " ".join(w["message"] for w in data["warnings"])
    assert "3.94 foot diameters" in said and "112 mm" in said and "fan works at" in said
    assert err.count("warning: ") == 3
    assert check(tmp_path, capsys, "[robot]\nfoot_radius = 0.03\n")[0]["geometry"] == {}
    (tmp_path / "experiment.toml").write_text(BED.replace("[0.0, 0.3, 0.6, 0.9]", "[0.0, 0.3, 0.2, 0.9]"))
    assert main(["check", str(tmp_path)]) == 2
    assert "[fan] speed" in capsys.readouterr().err
