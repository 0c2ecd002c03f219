"""Least amplitudes against scipy's linear response, and the estimates against the equations they solve. About 3 s."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import minimize_scalar

from jumpvision.jumper.physics.hard.analysis import (
    energy_after_one_cycle,
    minimum_amplitude,
    stutter_by_fall_and_push,
    stutter_by_half_fall,
    stutter_by_three_parts,
)
from jumpvision.jumper.physics.hard.jump import HardRobot, hard_map

THESIS = {"motor_mass": 1.003, "rod_mass": 0.175, "stiffness": 5760.6, "damping": 1.368, "gravity": 0.276 * 9.81}
ROBOT = HardRobot(**THESIS)
F0 = math.sqrt(5760.6 / 1.178) / (2 * math.pi)


@pytest.mark.parametrize("wait", [0.0, 1 / F0])
def test_least_amplitude_is_the_weight_over_the_unit_response(wait):
    # grounded, x_r = -M g/k + A h(t): the threshold is M g / (k max h), h from an integration of the unit law
    q, w2, c = 1.003 / 1.178, 5760.6 / 1.178, 1.368 / 1.178
    f, phases = np.array([5.0, 8.2, 13.0]), np.array([0.0, np.pi / 2, 3 * np.pi / 4, np.pi])
    found = minimum_amplitude(f, phases, cycles=2, wait=wait, largest=0.05, resolution=1e-9, robot=ROBOT)
    for i, j in np.ndindex(found.shape):
        w, ph, stop = 2 * np.pi * f[i], phases[j], 2 / f[i]
        rest, v, top = 0.0, -q * w * np.cos(ph), 0.0
        for drive, lo, hi in ((1.0, 0.0, stop), (0.0, stop, stop + wait)):
            if hi == lo:
                continue

            def rate(t, s, drive=drive, w=w, ph=ph):
                return [s[1], q * drive * w * w * np.sin(w * t + ph) - w2 * s[0] - c * s[1]]

            sol = solve_ivp(rate, (lo, hi), (rest, v), "DOP853", rtol=1e-11, atol=1e-13, dense_output=True)
            top = max(top, np.max(sol.sol(np.linspace(lo, hi, 20001))[0]))
            rest, v = sol.y[0, -1], sol.y[1, -1] + q * w * np.cos(ph)  # the law stops with a step
        # half a bracket; the grid hides (w dt)^2 / 8 < 1e-7 of the maximum
        assert abs(found[i, j] - 1.178 * THESIS["gravity"] / 5760.6 / top) < 0.5e-9 + 1e-7 * found[i, j]


def test_optimum_of_one_stutter_cycle_in_both_windows():
    # docs/physics.md section 7: at N = 1, phase pi/2 the two windows give f_opt = 0.74 and 1.19 f_0
    ratio = np.arange(0.3, 1.6, 0.005)
    for wait, best in ((0.0, 0.74), (1 / F0, 1.19)):
        a = minimum_amplitude(ratio * F0, [np.pi / 2], cycles=1, wait=wait, largest=0.02, resolution=1e-8, robot=ROBOT)
        assert abs(ratio[np.argmin(a[:, 0])] - best) < 0.0101
    none = minimum_amplitude([8.0], [np.pi / 2], cycles=1, wait=0.0, largest=1e-5, resolution=1e-6, robot=ROBOT)
    assert np.isnan(none).all()
    with pytest.raises(ValueError, match=r"^resolution = 0"):
        minimum_amplitude([8.0], [1.0], cycles=1, wait=0.0, largest=1e-2, resolution=0.0, robot=ROBOT)


def test_estimates_solve_the_equations_they_come_from():
    alpha = np.array([0.02, 0.13, 4 / (np.pi**2 + 2), 0.5, 0.9])
    # with k = M = 1, g = alpha, A = 1: f_0 = 1 / (2 pi), every duration in units of sqrt(M/k)
    f = stutter_by_half_fall(alpha) / (2 * np.pi)
    np.testing.assert_allclose(2.0 - 0.5 * alpha * (0.5 / f) ** 2, 0.0, atol=1e-13)  # (7)
    f = stutter_by_fall_and_push(alpha) / (2 * np.pi)
    np.testing.assert_allclose(2 * np.sqrt(1 / alpha) + np.pi, 1 / f, rtol=1e-13)  # (9)
    f = stutter_by_three_parts(alpha) / (2 * np.pi)
    first = np.sqrt(alpha / 8) / f
    speed = -alpha / (6 * np.sqrt(2)) * np.sqrt(alpha) / f
    height = 2.0 - alpha - alpha * alpha / (96 * f**2)
    fall = (speed + np.sqrt(speed**2 + 2 * alpha * height)) / alpha
    np.testing.assert_allclose(first + fall + np.pi, 1 / f, rtol=1e-12)


def test_energy_after_one_cycle_peaks_at_1_194():
    r = np.array([0.6, 0.9, 1.3, 2.0])
    printed = r**4 / (1 - r**2) ** 2 * (1 - np.cos(2 * np.pi / r))
    np.testing.assert_allclose(energy_after_one_cycle(r), printed, rtol=1e-13)
    assert abs(energy_after_one_cycle(1.0) - np.pi**2 / 2) < 1e-14
    best = minimize_scalar(lambda r: -float(energy_after_one_cycle(r)), bounds=(1.0, 1.6), method="bounded")
    assert abs(best.x - 1.194) < 0.0005  # docs/physics.md section 7
    # an exact jump without damping, almost without rod, that stays on the ground (alpha > 1) is highest at the same r
    robot = THESIS | {"damping": 0.0, "rod_mass": 1e-6, "landing_loss": 0.0}
    mass, ratio = 1.003 + 1e-6, np.arange(1.1, 1.3, 0.001)
    f0, amp = math.sqrt(5760.6 / mass) / (2 * math.pi), mass * THESIS["gravity"] / 5760.6 / 1.3
    jumps = hard_map(ratio * f0, [np.pi / 2], amplitude=amp, cycles=1, **robot)
    assert np.all(jumps["n_jumps"] == 1)
    assert abs(ratio[np.argmax(jumps["com_height_m"][:, 0])] - best.x) < 0.001  # the step of the grid
