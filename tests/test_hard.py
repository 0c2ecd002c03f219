"""Hard-ground jumps against an independent integration, closed forms, energy and the thesis' numbers.

The oracle integrates rod and motor as the two bodies they are (thesis eqs. 3, 4), with scipy's DOP853 and event
location; it knows nothing of y, of arcs or of closed forms. The file takes about 25 s on two slow cores, 7 s of it compilation.
"""

import math

import numpy as np
import pytest
from scipy.integrate import simpson, solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from jumpvision.physics.forcing import Segments, Spline, delayed, sinusoid
from jumpvision.physics.hard import hard_jump, hard_map, hard_sweep

THESIS = {
    "motor_mass": 1.003,
    "rod_mass": 0.175,
    "stiffness": 5760.6,
    "damping": 1.368,
    "gravity": 0.276 * 9.81,
    "landing_loss": 0.0,
}
A = 4e-3
F0 = math.sqrt(5760.6 / 1.178) / (2 * math.pi)


def oracle(law, t_end, *, motor_mass, rod_mass, stiffness, damping, gravity, landing_loss):
    """Flights [(lift-off, landing)], event speeds, com and jump height, from Newton's laws of the two bodies.

    law: (frequency, amplitude, phase, cycles). State: x_m, v_m, x_r, v_r. The motor force is the one that keeps
    x_m - x_r = X_m; a velocity step of the law is an internal impulse: momentum is conserved, v_m - v_r follows X_m'.
    """
    f, amp, ph, cycles = law
    w, stop = 2 * math.pi * f, cycles / f
    mass = motor_mass + rod_mass
    rest = -mass * gravity / stiffness

    def relative(t, on):
        return (w * amp * math.cos(w * t + ph), -w * w * amp * math.sin(w * t + ph)) if on else (0.0, 0.0)

    def rhs(t, s, on, grounded):
        f_s = -stiffness * s[2] - damping * s[3] if grounded else 0.0
        a_rel = relative(t, on)[1]
        # m_r a_r = -m_r g - F_m + F_s and m_m (a_r + a_rel) = -m_m g + F_m
        f_m = motor_mass * (rod_mass * a_rel + f_s) / mass
        return [s[1], -gravity + f_m / motor_mass, s[3], -gravity + (f_s - f_m) / rod_mass]

    def step(s, dv):  # v_m - v_r += dv, momentum kept
        return [s[0], s[1] + rod_mass / mass * dv, s[2], s[3] - motor_mass / mass * dv]

    def com(s):
        return (motor_mass * s[0] + rod_mass * s[2]) / mass

    def up_down(t, s, on, grounded):
        return s[2]

    def com_speed(t, s, on, grounded):
        return (motor_mass * s[1] + rod_mass * s[3]) / mass

    def rod_speed(t, s, on, grounded):
        return s[3]

    up_down.terminal, com_speed.direction, rod_speed.direction = True, -1, -1
    s, t, grounded, y0 = [rest, 0.0, rest, 0.0], 0.0, True, rest
    top, rod, flights, speeds = 0.0, -math.inf, [], []
    for on, end in ((True, stop), (False, t_end)):
        s = step(s, relative(t, True)[0] * (1 if on else -1))
        while t < end:
            up_down.direction = 1 if grounded else -1
            sol = solve_ivp(rhs, (t, end), s, "DOP853", args=(on, grounded), events=(up_down, com_speed, rod_speed),
                            rtol=3e-14, atol=1e-15, max_step=0.04 / max(f, math.sqrt(stiffness / mass) / 6.28))  # fmt: skip
            t, s = sol.t[-1], list(sol.y[:, -1])
            top = max([top, com(s) - y0] + [com(e) - y0 for e in sol.y_events[1]])
            if not on:
                rod = max([rod, sol.y[2, 0], s[2]] + [e[2] for e in sol.y_events[2]])
            if sol.status == 1:
                speeds.append(abs(s[3]))
                s[0], s[2] = s[0] - s[2], 0.0
                if grounded:
                    flights.append([t, math.nan])
                else:
                    flights[-1][1] = t
                    loss = (math.sqrt(1 - landing_loss) - 1) * s[3]
                    s[1], s[3] = s[1] + loss, s[3] + loss
                grounded = not grounded
    return np.array(flights).reshape(-1, 2), speeds, top, rod - rest


def draws(n, seed):
    """Robots and laws over a wide range; a third at low frequency, where the robot hops many times."""
    rng = np.random.default_rng(seed)
    for i in range(n):
        mass, share = 10 ** rng.uniform(-1, 1.5), rng.uniform(0.05, 0.5)
        f0, g = 10 ** rng.uniform(0.3, 1.5), rng.uniform(1.0, 10.0)
        k = mass * (2 * math.pi * f0) ** 2
        robot = {
            "motor_mass": mass * (1 - share),
            "rod_mass": mass * share,
            "stiffness": k,
            "damping": 2 * rng.choice([0.0, 0.0083, 0.1, 0.6]) * math.sqrt(k * mass),
            "gravity": g,
            "landing_loss": rng.choice([0.0, 0.33]),
        }
        amp = mass * g / k / rng.uniform(0.03, 0.6)
        f = f0 * (rng.uniform(0.15, 0.4) if i % 3 == 0 else rng.uniform(0.4, 1.6))
        yield robot, (f, amp, rng.uniform(0, 2 * math.pi), int(rng.integers(1, 4)))


def test_random_jumps_agree_with_an_independent_integration():
    compared, hops = 0, []
    for robot, law in draws(42, seed=3):
        t_end = law[3] / law[0] + 3.0 * math.sqrt(law[1] / robot["gravity"])
        flights, speeds, com, rod = oracle(law, t_end, **robot)
        if speeds and min(speeds) < 1e-6:
            continue  # a grazing contact: neither integration can decide it
        jump = hard_jump(**robot, forcing=sinusoid(*law), t=None, t_end=t_end)
        assert len(jump.lift_off) == len(flights), (robot, law)
        # errors of event times grow as 1/speed of the contact; 1e-13 s is the oracle's own error at 1 m/s
        np.testing.assert_allclose(np.c_[jump.lift_off, jump.landing], flights, atol=1e-9)
        size = 1e-9 * max(1.0, law[1] / 0.01)  # 1e-9 m at the thesis' scale; the random robots reach a stroke of metres
        assert abs(jump.com_height - com) < size and abs(jump.jump_height - rod) < size
        late = flights[flights[:, 1] > law[3] / law[0]]
        if len(late):
            best = robot["gravity"] * np.max(late[:, 1] - late[:, 0]) ** 2 / 8
            assert abs(jump.flight_height - best) < size
            assert jump.n_jumps == np.flatnonzero(flights[:, 1] > law[3] / law[0])[0] + 1
        compared += 1
        hops.append(len(flights))
    assert compared >= 40 and max(hops) >= 5 and hops.count(0) < 5
