"""Repeated pauses whose overshoots compound (thesis Fig 69b): the jumper, the laboratory, the symbols of a plan."""

import math

import numpy as np
import pytest

from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.forcing import sinusoid
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand.jump import simulate
from jumpvision.jumper.planning.jumper import Drive, Jumper, Memory
from jumpvision.laboratory.jumper import Law, motion_of
from jumpvision.laboratory.jumper import Robot as LabRobot

K1, S_P, LAM = 2100.0, 150.0, 0.005
ROBOT = LabRobot(1.125, 0.175, 0.04, 3300.0, 1.2, 0.0381, 9.81)
TERMS = ("two_resistance", "inertial_drag", "stop_go_overshoot")
VALUES = {"k1": K1, "k2": K1, "delta": 0.01, "alpha": 70.0, "s_p": S_P, "lam": LAM}
FREQUENCY, AMPLITUDE, PHASE, CYCLES = 7.0, 0.0005, 0.5 * math.pi, 8  # pushes that grow, without a lift-off
PUSHES = sinusoid(FREQUENCY, AMPLITUDE, PHASE, cycles=CYCLES)


def model(carry):
    names = ("motor_mass", "rod_mass", "foot_mass", "spring_stiffness", "spring_damping", "foot_radius", "gravity")
    robot = dict(zip(names, ROBOT))
    return Model("granular", TERMS, ModelParameters(**VALUES, carry=carry), **robot, volume_fraction=0.57)


def overshoot(stops, carry):
    """[N] after the last of these stops (n,) [m]: every one's own, times `carry` a later stop, decayed to the last."""
    later = np.arange(len(stops))[::-1]
    return float(np.sum(S_P * np.asarray(stops) * carry**later * np.exp(-(stops[-1] - np.asarray(stops)) / LAM)))


@pytest.mark.parametrize("carry", [0.0, 0.4, 1.0])
def test_the_foot_yields_at_the_sum_of_what_every_pause_left(carry):
    """The push at each yield against the sum over all stops before it, to 1e-6 of the weight."""
    m = model(carry)
    events = simulate(m, PUSHES, t=np.array([0.0, 1.3]), rtol=1e-11, atol=1e-13).events
    found = simulate(m, PUSHES, t=np.r_[0.0, np.unique(events["time"])], rtol=1e-11, atol=1e-13)
    at = {t: i for i, t in enumerate(found.t)}
    stops = []
    for time, kind in events:
        i = at[time]
        z = -found.foot[i]
        if kind == "stop":
            stops.append(z)
        elif kind == "intrude" and stops:
            push = m.k_s * (found.foot[i] - found.rod[i]) - m.c_s * found.rod_velocity[i] + m.m_f * m.g
            assert push == pytest.approx(K1 * stops[-1] + overshoot(stops, carry), abs=1e-6 * m.M * m.g)
    assert "lift_off" not in events["kind"] and len(stops) >= 4


@pytest.mark.parametrize("carry", [0.0, 0.8])
def test_the_laboratory_says_the_same(carry):
    """Its own law and solver at two steps: within thrice their difference, far from the other `carry`."""
    law, parameters = Law(FREQUENCY, AMPLITUDE, PHASE, 0.0, CYCLES), VALUES | {"carry": carry}
    fine, coarse = (
        motion_of(ROBOT, law, TERMS, parameters, ground="granular", duration=1.3, dt=2e-6 * n, every=1000 // n)
        for n in (1, 2)
    )
    ours, other = (simulate(model(c), PUSHES, t=fine.t, rtol=1e-10, atol=1e-12) for c in (carry, 0.8 - carry))
    bound = 3.0 * np.abs(fine.foot - coarse.foot).max() + 1e-7
    np.testing.assert_allclose(ours.foot, fine.foot, rtol=0.0, atol=bound)
    assert np.abs(ours.foot - other.foot).max() > 10.0 * bound


def test_a_plan_remembers_every_pause():
    jumper, memory, stops = Jumper(model(0.6), Drive(), np), Memory(floor=0.004), []
    for z in (0.01, 0.012, 0.017):
        memory = Memory(z, 0.0, z, jumper.left(z, memory), moved=True)
        stops.append(z)
        assert jumper.static_force(z, memory) == pytest.approx(K1 * z + overshoot(stops, 0.6), rel=1e-12)
