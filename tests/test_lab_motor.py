"""The laboratory's motor with its feedback loop, and the bed compacted by an earlier footprint."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jumpvision.laboratory import samples
from jumpvision.laboratory.jumper import Law, Motion, Motor, Samples, motion_of

HARD, SAND = samples.HARD_ROBOT, samples.SAND_ROBOT


def sand(frequency=6.0, motor=None, terms=samples.SAND_TERMS, phase=0.5, parameters=None, **options) -> Motion:
    law = Law(frequency, 0.01875, phase * math.pi, 0.05)
    options = {"duration": 0.8, "dt": 1e-5, "every": 10} | options
    given = samples.SAND_TRUTH | (parameters or {})
    return motion_of(SAND, law, terms, given, ground="granular", bed_density=570.0, motor=motor, **options)


def test_feedback_loop_agrees_with_solve_ivp():
    """Motor and rod as two bodies with F_m between them, here in x_m and x_r by DOP853; no lift-off, no limit met."""
    kp, kd, c_v = 15000.0, 70.0, 0.8
    f, A, start = 7.0, 5e-5, 0.05
    law = Law(f, A, 0.5 * math.pi, start)
    m = motion_of(
        HARD, law, ["viscous_friction"], {"c_v": c_v}, ground="hard", duration=0.4, motor=Motor(kp, kd), every=100
    )
    assert m.contact.all()
    m_m, m_r, g, k, c = HARD.motor_mass, HARD.rod_mass, HARD.gravity, HARD.spring_stiffness, HARD.spring_damping

    def rates(t, s):
        x_m, v_m, x_r, v_r = s
        w, u = 2 * math.pi * f, t - start
        X, V = (A * (math.cos(w * u) - 1), -A * w * math.sin(w * u)) if 0 <= u < 1 / f else (0.0, 0.0)
        F = kp * (X - (x_m - x_r)) + kd * (V - (v_m - v_r)) + m_m * g
        return v_m, -g + (F - c_v * v_m) / m_m, v_r, -g + (-k * x_r - c * v_r - F) / m_r

    rest = -(m_m + m_r) * g / k
    s, out = np.array([rest, 0.0, rest, 0.0]), []
    for a, b in ((0, start), (start, start + 1 / f), (start + 1 / f, 0.5)):
        inside = m.t[(m.t >= a) & (m.t < b)]
        run = solve_ivp(rates, (a, b), s, t_eval=np.append(inside, b), method="DOP853", rtol=1e-11, atol=1e-14)
        out.append(run.y[:, : len(inside)])
        s = run.y[:, -1]
    x_m, _, x_r, _ = np.concatenate(out, axis=1)
    assert np.ptp(x_r) > 5e-5
    # the loop answers the steps of X'' one step of 2 us late at most: A w^2 dt^2 ~ 4e-13 m, and the integrator's rtol
    np.testing.assert_allclose(m.rod, x_r, atol=1e-11)
    np.testing.assert_allclose(m.motor, x_m - x_r, atol=1e-11)
    u = m.t - start
    command = np.where((u >= 0) & (u < 1 / f), A * (np.cos(2 * math.pi * f * u) - 1), 0.0)
    speed = np.where((u >= 0) & (u < 1 / f), -A * 2 * math.pi * f * np.sin(2 * math.pi * f * u), 0.0)
    force = kp * (command - m.motor) + kd * (speed - m.motor_rate) + m_m * g
    np.testing.assert_allclose(m.motor_force, force, atol=1e-6)


def test_a_stiff_loop_is_the_law():
    """The loop is off by (m_m m_r/M) X''/kp plus the rod's own acceleration: 1/kp, a ratio of 4 up to the next order
    in 1/kp, sqrt(m_r/kp)/(8 ms) ~ 10 %."""
    plain = sand()
    error = []
    for kp in (1e5, 4e5):
        m = sand(motor=Motor(kp, 2 * math.sqrt(kp * 0.1514)), dt=5e-6, every=20)
        u = m.t - 0.05  # 10 ms after the step of X'' the loop has settled
        error.append(np.abs(m.motor - plain.motor)[(u > 0.01) & (u < 1 / 6.0)].max())
    assert error[0] / error[1] == pytest.approx(4.0, rel=0.1)


def test_samples_are_played_as_the_law_they_were_taken_from():
    """Straight lines leave a sine by A w^2 dt^2 / 8 = 2.5e-8 m, and the loop follows them within a few times that."""
    motor, law = Motor(20000.0, 120.0), Law(6.0, 0.01875, 0.5 * math.pi, 0.05)
    t = np.arange(0.0, 1 / 6.0 + 0.5e-4, 1e-4)
    X = law.amplitude * (np.sin(2 * math.pi * 6.0 * t + law.phase) - 1.0)
    options = {"ground": "granular", "bed_density": 570.0, "motor": motor, "duration": 0.5, "dt": 1e-5, "every": 10}
    played = motion_of(SAND, Samples(X, 1e4, 0.05), samples.SAND_TERMS, samples.SAND_TRUTH, **options)
    plain = motion_of(SAND, law, samples.SAND_TERMS, samples.SAND_TRUTH, **options)
    np.testing.assert_allclose(played.motor, plain.motor, atol=1e-6)
    assert played.jump_height == pytest.approx(plain.jump_height, abs=1e-6)


def test_samples_without_a_loop_are_the_law():
    """The motor is where the lines are: rod as of the law; its force from the samples' second differences, which lag by
    up to one: A w^3 dt m_m = 0.11 N, but at the command's own steps of acceleration."""
    law = Law(6.0, 0.01875, 0.5 * math.pi, 0.05)
    t = np.arange(0.0, 1 / 6.0 + 0.5e-4, 1e-4)
    X = law.amplitude * (np.sin(2 * math.pi * 6.0 * t + law.phase) - 1.0)
    options = {"ground": "granular", "bed_density": 570.0, "duration": 0.5, "dt": 1e-5, "every": 10}
    played = motion_of(SAND, Samples(X, 1e4, 0.05), samples.SAND_TERMS, samples.SAND_TRUTH, **options)
    plain = motion_of(SAND, law, samples.SAND_TERMS, samples.SAND_TRUTH, **options)
    np.testing.assert_allclose(played.motor, plain.motor, atol=1e-7)
    assert np.abs(played.rod - plain.rod).max() < 2e-5  # a landing found one step of 10 us later, at 1 m/s: twice
    inside = (plain.t > 0.0505) & (plain.t < 0.05 + 1 / 6.0 - 5e-4)
    assert np.abs(played.motor_force - plain.motor_force)[inside].max() < 0.15
    assert np.ptp(plain.motor_force[inside]) > 30.0


def test_limits_hold():
    motor = Motor(20000.0, 120.0, max_force=45.0, max_speed=0.6, stroke=0.03)
    m = sand(motor=motor, dt=2e-6, every=50)
    assert np.abs(m.motor_rate).max() == pytest.approx(0.6, abs=1e-9)
    assert np.ptp(m.motor) <= 0.03 + 1e-12
    free = sand(motor=motor._replace(max_speed=math.inf, stroke=math.inf), dt=2e-6, every=50)
    assert np.abs(free.motor_force).max() == pytest.approx(45.0, rel=1e-9)
    assert np.abs(free.motor_rate).max() > 0.6


def test_loop_starts_and_ends_at_rest_without_sag():
    m = sand(motor=Motor(20000.0, 120.0), duration=0.04)
    assert np.abs(m.motor).max() < 1e-12
    assert np.ptp(m.rod) < 1e-12


def test_work_of_the_loop_becomes_energy():
    """No losses: energy gained = int F_m X_m' dt, F_m from the loop; trapezoids err by (omega dt)^2/12 ~ 1e-5."""
    robot = HARD._replace(spring_damping=0.0)
    law = Law(8.2, 0.004, 0.5 * math.pi, 0.05)
    m = motion_of(robot, law, [], {}, ground="hard", duration=0.6, motor=Motor(20000.0, 120.0))
    m_m, m_r = robot.motor_mass, robot.rod_mass
    v_m, x_m = m.rod_rate + m.motor_rate, m.rod + m.motor
    energy = 0.5 * m_m * v_m**2 + 0.5 * m_r * m.rod_rate**2 + robot.gravity * (m_m * x_m + m_r * m.rod)
    energy += 0.5 * robot.spring_stiffness * np.minimum(m.rod, 0.0) ** 2
    power = m.motor_force * m.motor_rate
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(m.t))])
    gained = energy - energy[0]
    assert gained[-1] > 0.05
    np.testing.assert_allclose(gained, work, atol=1e-4 * gained[-1])


def test_coulomb_friction_lets_a_soft_loop_stick():
    """Friction that the loop's error cannot overcome: at the end the carriage rests off its command, v_m = 0."""
    m = sand(motor=Motor(3000.0, 60.0), terms=(*samples.SAND_TERMS, "coulomb_friction"), parameters={"F_c": 8.0},
             duration=2.0)  # fmt: skip
    last = m.t > 1.8
    assert np.abs(m.rod_rate + m.motor_rate)[last].max() < 1e-3
    assert 1e-5 < abs(m.motor[-1]) < 8.0 / 3000.0


def test_bad_motors_are_refused():
    with pytest.raises(ValueError, match="kp > 0"):
        sand(motor=Motor(0.0, 120.0))
    with pytest.raises(ValueError, match="motor_lag"):
        sand(motor=Motor(2e4, 120.0), terms=(*samples.SAND_TERMS, "motor_lag"), parameters={"tau": 0.01})


def test_compaction_raises_k1_after_the_first_flight_only():
    """F_p = factor k1 z once the foot has left its print: from the recorded force of the intrusion, drag apart."""
    factor = 1.4
    terms, k = ("linear_penetration", "compaction"), 2100.0
    m = sand(frequency=7.0, phase=1.5, terms=terms, parameters={"k": k, "factor": factor})
    plain = sand(frequency=7.0, phase=1.5, terms=terms[:1], parameters={"k": k})
    first = m.lift_offs[0]
    before, after = m.t < first, m.t > first + m.flights[0]
    np.testing.assert_array_equal(m.rod[before], plain.rod[before])
    for part, ratio in ((before, 1.0), (after, factor)):
        going = part & m.contact & (m.foot_rate < -0.02)
        assert going.sum() > 50
        np.testing.assert_allclose(m.ground_force[going], ratio * k * -m.foot[going], rtol=1e-9)
