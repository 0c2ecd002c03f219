"""The motor's feedback loop: its limit, its balance at rest, its limits and dry friction beside the laboratory's."""

import math

import numpy as np
import pytest

from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.forcing import Loop, sinusoid
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand.jump import simulate
from jumpvision.laboratory import samples
from jumpvision.laboratory.jumper import Law, Motor, motion_of
from tests.worlds.cases import HARD, SAND, case


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


# The laboratory's own integrator puts limits and dry friction in after each fixed step, so that every event is up to
# dt = 2.5 us late at rates of about 1 m/s: 2.5 um an event, some ten of which add up.
@pytest.mark.parametrize(
    "limits, F_c", [({"stroke": 0.03}, 0.0), ({}, 8.0), ({"max_force": 45.0, "max_speed": 0.6, "stroke": 0.03}, 4.0)]
)
def test_limits_and_dry_friction_agree_with_the_laboratory(limits, F_c):
    law, terms = Law(6.0, 0.01875, 0.5 * math.pi, 0.05), samples.SAND_TERMS + ("coulomb_friction",) * (F_c > 0)
    truth = {**samples.SAND_TRUTH, **({"F_c": F_c} if F_c else {})}
    seen = motion_of(
        samples.SAND_ROBOT, law, terms, truth, ground="granular", bed_density=570.0, duration=0.8,
        motor=Motor(20000.0, 120.0, **limits), dt=2.5e-6, every=40,
    )  # fmt: skip
    model = Model("granular", terms, ModelParameters(**truth), **SAND)

    def ours(**limits):
        loop = Loop(sinusoid(6.0, 0.01875, 0.5 * math.pi, start=0.05), 20000.0, 120.0, **limits)
        return simulate(model, loop, t=seen.t, rtol=1e-9, atol=1e-11)

    m = ours(**limits)
    np.testing.assert_allclose(m.motor - m.rod, seen.motor, atol=1e-5)
    np.testing.assert_allclose(m.rod - m.rest, seen.rod - seen.rest, atol=1e-5)
    kinds = set(m.events["kind"])
    assert ("motor_held" in kinds) == bool(limits) and ("rail_stick" in kinds) == (F_c > 0)
    if limits:  # which without its limits would go elsewhere
        free = ours()
        assert np.abs(free.motor - free.rod - seen.motor).max() > 1e-4


def test_bad_loops_are_named():
    law = case("plain")[1]
    with pytest.raises(ValueError, match="kp = 0"):
        Loop(law, 0.0, 1.0)
    with pytest.raises(ValueError, match="max_force = -1"):
        Loop(law, 1.0, 1.0, -1.0)
    with pytest.raises(ValueError, match=r"max_speed = 0\.0, stroke = inf: both must be > 0"):
        Loop(law, 1.0, 1.0, max_speed=0.0)
    lagging = Model("hard", ("motor_lag",), ModelParameters(tau=1e-3), **HARD)
    with pytest.raises(ValueError, match="motor_lag stands for the delay of a feedback loop"):
        simulate(lagging, Loop(law, 1e4, 1e2), t=[0.0, 1.0], rtol=1e-7, atol=1e-9)
