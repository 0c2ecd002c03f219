"""The motor's feedback loop: its limit, its balance at rest, its force limit, and the spring ring that it damps."""

import math
import time

import numpy as np
import pytest
from test_granular import HARD, SAND, case

from jumpvision.physics.forcing import delayed, sinusoid
from jumpvision.physics.jump import simulate
from jumpvision.physics.loop import Loop
from jumpvision.physics.model import Model
from jumpvision.physics.parameters import ModelParameters


def test_stiff_loop_moves_as_the_law_to_first_order():
    """Halving 1/kp halves the distance of the track from the law-driven one."""
    model, _ = case("plain")
    law = sinusoid(7.0, 0.01875, math.pi / 2)  # from rest: no impulse, which no finite gain follows
    t = np.linspace(0.0, 0.6, 601)
    exact = simulate(model, law, t=t, rtol=1e-10, atol=1e-12).rod
    reduced = model.m_m * model.rod_mass / model.M
    off = []
    for kp in (2e5, 4e5, 8e5):
        kd = 2 * math.sqrt(kp * reduced)  # critical damping
        rod = simulate(model, Loop(law, kp, kd), t=t, rtol=1e-9, atol=1e-11).rod
        off.append(float(np.abs(rod - exact).max()))
    ratios = np.array(off[:-1]) / off[1:]
    # first order is a ratio of 2; the next order is smaller by the loop's slowness, w/sqrt(kp/mu) = 0.04 to 0.02
    np.testing.assert_allclose(ratios, 2.0, atol=0.3)
    assert off[-1] < 1e-3


@pytest.mark.parametrize("ground", ["granular", "hard"])
def test_robot_rests_without_sag_and_returns_to_the_command(ground):
    """A command that stands still moves nothing: the feed-forward carries m_m g."""
    model = case("cone")[0] if ground == "granular" else Model("hard", (), ModelParameters(), **HARD)
    loop = Loop(sinusoid(7.0, 1e-15, 0.0), kp=2e4, kd=120.0, max_force=100.0)
    m = simulate(model, loop, t=np.linspace(0, 1, 50), rtol=1e-9, atol=1e-12)
    assert len(m.events) == 0 and np.ptp(m.rod) < 1e-12 and np.ptp(m.motor) < 1e-12
    law = sinusoid(7.0, 0.004, math.pi / 2)
    m = simulate(model, Loop(law, kp=2e4, kd=120.0), t=np.linspace(0, 30, 300), rtol=1e-8, atol=1e-10)
    assert m.motor[-1] - m.rod[-1] == pytest.approx(float(law(30.0)[0][0]), abs=1e-6)  # the ring fades in 2 s
    assert m.jump_height > 0.0 or len(m.flights)


def test_force_is_limited():
    """Newton's law of the motor from its track: m_m (a_m + g) stays within the limit and reaches it."""
    model, law = case("plain")
    t = np.linspace(0.0, 0.4, 40001)
    limit = 30.0
    m = simulate(model, Loop(law, kp=5e4, kd=200.0, max_force=limit), t=t, rtol=1e-10, atol=1e-12)
    force = model.m_m * (np.diff(m.motor, 2) / (t[1] - t[0]) ** 2 + model.g)
    # second differences at 10 us: rounding 4e-17 / 1e-10 x 1.1 kg = 5e-7 N, tolerance 1e-12 / 1e-10 = 1e-2 N
    assert force.max() == pytest.approx(limit, abs=0.1)
    assert force.min() > -limit - 0.1


def test_lowered_gain_in_the_dwell_damps_the_spring():
    """PHYSICS.md, end of section 1: without it the ring of the first half cycle lives through a pause of 0.75 s."""
    p = ModelParameters(k1=2100.0, k2=2100.0, delta=0.01, C=2.7, mu=2.0, b=17.2)
    model = Model("granular", ("two_resistance", "depth_drag", "added_mass"), p, **SAND)
    law = delayed(7.0, 0.01875, math.pi / 2, 0.75)
    t = np.linspace(0.0, law.stop, 4000)
    end = (t > law.stop - 0.5 / 7.0 - 0.15) & (t < law.stop - 0.5 / 7.0)  # the last 150 ms of the pause
    ring = {}
    for gain in (1.0, 0.01):
        m = simulate(model, Loop(law, kp=2e4, kd=60.0, dwell_gain=gain), t=t, rtol=1e-8, atol=1e-10)
        ring[gain] = float(np.ptp(m.spring_force[end]))
    assert ring[0.01] < 0.5 * ring[1.0]


def test_bad_loops_are_named():
    law = case("plain")[1]
    with pytest.raises(ValueError, match="kp = 0"):
        Loop(law, 0.0, 1.0)
    with pytest.raises(ValueError, match="max_force = -1"):
        Loop(law, 1.0, 1.0, -1.0)
    lagging = Model("hard", ("motor_lag",), ModelParameters(tau=1e-3), **HARD)
    with pytest.raises(ValueError, match="motor_lag cannot act together"):
        simulate(lagging, Loop(law, 1e4, 1e2), t=[0.0, 1.0], rtol=1e-7, atol=1e-9)


def test_a_loop_costs_no_more_than_a_few_jumps():
    """The equations are not stiff: thousands of steps would tell."""
    model, law = case("cone")
    simulate(model, Loop(law, 2e4, 120.0), t=[0.0, 1.0], rtol=1e-7, atol=1e-9)
    began = time.process_time()
    simulate(model, Loop(law, 2e4, 120.0), t=[0.0, 1.0], rtol=1e-7, atol=1e-9)
    assert time.process_time() - began < 0.1  # about 1 ms
