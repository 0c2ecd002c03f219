"""The loaded spring against the laboratory's own integration of whole jumps on sand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jumpvision.jumper.physics.oscillator import RIPPLE, foot_frequency, foot_ripple, lift_off_amplitude
from jumpvision.laboratory.jumper import Law, motion_of
from jumpvision.laboratory.samples import PHASE, SAND_ROBOT, SAND_TERMS, SAND_TRUTH

M = SAND_ROBOT.motor_mass + SAND_ROBOT.rod_mass
SPRING = SAND_ROBOT.spring_stiffness, SAND_ROBOT.foot_mass, M


@pytest.mark.parametrize(("kind", "frequency"), [("single", 5.5), ("single", 10.0), ("stutter", 5.0), ("stutter", 7.0)])
def test_a_foot_in_flight_shakes_the_rod_by_less_than_allowed_and_at_its_frequency(kind, frequency):
    """Longest flight after the motor stops: the rod less its parabola is the foot's swing, seen in the rod."""
    law = Law(frequency, 0.01875, PHASE[kind], 0.1)
    m = motion_of(SAND_ROBOT, law, SAND_TERMS, SAND_TRUTH, ground="granular", duration=1.2, bed_density=570.0)
    begin, length = max(
        ((max(t, law.stop), t + f - max(t, law.stop)) for t, f in zip(m.lift_offs, m.flights, strict=True)),
        key=lambda flight: flight[1],
    )
    w = (m.t > begin + 1e-3) & (m.t < begin + length - 1e-3)
    swing = m.rod[w] - m.foot[w]  # the spring's stretch: nothing else happens between rod and foot in flight
    swing = swing - swing.mean()
    ripple = 0.5 * np.ptp(swing) * SAND_ROBOT.foot_mass / (M + SAND_ROBOT.foot_mass)
    assert ripple < foot_ripple(*SPRING, SAND_ROBOT.gravity)
    crossings = m.t[w][1:][np.diff(np.sign(swing)) != 0]
    # half periods between crossings; damping moves the frequency by zeta^2/2 = 0.3 %, the mean of the window by some %
    assert 0.5 / np.mean(np.diff(crossings)) == pytest.approx(foot_frequency(*SPRING), rel=0.05)


def test_the_spring_relaxes_at_the_lift_off_amplitude():
    """Upper turning point of an oscillation about rest: relaxed where the amplitude is the static deflection M g/k."""
    k, _, mass = SPRING
    assert k * lift_off_amplitude(k, mass, 9.81) == pytest.approx(mass * 9.81)
    assert math.isclose(foot_frequency(k, 1e12, mass), math.sqrt(k / mass) / (2 * math.pi), rel_tol=1e-6)


@pytest.mark.parametrize("foot", [0.02, 0.3, 3.0])
def test_a_swinging_foot_leaves_the_centre_of_mass_where_it_is(foot):
    """Two bodies on a spring that is stretched by the allowed swing and let go: half a period later the rod has moved
    by twice its amplitude. By integration; a foot of the rod's own mass takes the rod half of the way."""
    k, _, mass = SPRING
    swing = RIPPLE * lift_off_amplitude(k, mass, 9.81)

    def rate(t, s):
        return [s[2], s[3], -k / mass * (s[0] - s[1]), k / foot * (s[0] - s[1])]

    end = 0.5 / foot_frequency(k, foot, mass)
    rod = solve_ivp(rate, (0.0, end), [0.0, -swing, 0.0, 0.0], rtol=1e-10, atol=1e-14).y[0, -1]
    assert foot_ripple(k, foot, mass, 9.81) == pytest.approx(abs(rod) / 2.0, rel=1e-6)
