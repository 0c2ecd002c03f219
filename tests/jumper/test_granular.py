"""The event-located jumper against the laboratory's fixed fine steps, scipy, closed forms, Newton's law."""

import math
from dataclasses import replace

import numpy as np
import pytest

from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.forcing import Spline, from_motion, sinusoid
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand.jump import equilibrium, simulate
from jumpvision.laboratory.jumper import Law, Robot, motion_of
from tests.worlds.cases import CASES, HARD, SAND, case

F0 = math.sqrt(5760.6 / 1.178) / (2 * math.pi)
AIR, REST, INTRUDE = 0, 1, 2


def by_the_laboratory(name, end, dt):
    """The same jump by fixed Runge-Kutta steps in x_r, v_r, x_f, v_f, the laboratory's own forces, every 2 ms."""
    model, (frequency, amplitude, phase, delay) = case(name)[0], CASES[name][2]
    law = Law(frequency, amplitude, phase, 0.0, delay=delay)
    robot = Robot(model.motor_mass, model.rod_mass, model.foot_mass, model.spring_stiffness, model.spring_damping,
                  model.foot_radius, model.gravity)  # fmt: skip
    values = {n: x for n, x in vars(model.parameters).items() if x is not None}
    return motion_of(robot, law, model.terms, values, ground=model.ground, bed_density=570.0, duration=end, dt=dt,
                     every=round(2e-3 / dt))  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_whole_jump_against_fixed_fine_steps(name):
    """0.5 s: push-off, hops, landings and intrusion of rod and foot. The laboratory finds an event at the end of
    a step: up to 1 us late at about 1 m/s, 1 um an event; what else its step does is told by a coarser one.
    """
    model, law = case(name)
    fine, coarse = (by_the_laboratory(name, 0.5, dt) for dt in (1e-6, 2e-6))
    motion = simulate(model, law, t=fine.t, rtol=1e-10, atol=1e-12)
    assert set(motion.mode) == ({AIR, REST} if model.ground == "hard" else {AIR, REST, INTRUDE})
    for found, a, b in ((motion.rod, fine.rod, coarse.rod), (motion.foot, fine.foot, coarse.foot)):
        bound = 3 * np.abs(a - b).max() + 1e-6 * len(motion.events)
        assert bound < 5e-5  # m: of a motion of 50 mm
        np.testing.assert_allclose(found, a, rtol=0, atol=bound)


def test_converges_with_tolerance():
    model, law = case("everything")
    run = lambda rtol: simulate(model, law, t=[0.0, 1.0], rtol=rtol, atol=1e-2 * rtol)  # noqa: E731
    best = run(1e-13)
    for rtol in (1e-6, 1e-8, 1e-10):
        got = run(rtol)
        # a tolerance per step of rtol x 20 mm, some hundred steps, amplified by the chain of landings: 100 x rtol
        assert abs(got.jump_height - best.jump_height) < 100 * rtol * 0.02
        assert abs(got.depth_max - best.depth_max) < 100 * rtol * 0.02
        assert len(got.events) == len(best.events)


def test_coulomb_friction_closed_form():
    """Ring-down on the ground: each half swing loses 2 F_c / k, and the carriage comes to rest for good."""
    F_c = 0.05
    model = Model("hard", ("coulomb_friction",), ModelParameters(F_c=F_c), **{**HARD, "spring_damping": 0.0})
    law = sinusoid(0.9 * F0, 0.00015, math.pi / 2)
    t = np.linspace(0.0, 1.5, 60001)
    m = simulate(model, law, t=t, rtol=1e-11, atol=1e-13)
    assert len(m.flights) == 0
    free = t > law.stop
    v, x = m.rod_velocity[free], m.rod[free]
    turns = np.flatnonzero(v[1:] * v[:-1] < 0)
    swing = np.abs(np.diff([max(x[i : i + 2], key=lambda z, i=i: abs(z - x.mean())) for i in turns]))
    assert len(swing) > 5
    np.testing.assert_allclose(np.diff(swing), -4 * F_c / 5760.6, atol=1e-8)  # between turns: 2 F_c/k from each side
    end = m.events["time"][m.events["kind"] == "rail_stick"][-1]
    assert end < 1.4
    assert np.ptp(m.rod[t > end]) < 1e-12
    assert abs(-5760.6 * m.rod[-1] - model.M * model.g) <= F_c


@pytest.mark.parametrize("tau", [0.04, 1e-7])
def test_motor_lag_closed_form(tau):
    """tau X' + X = A (sin(w t + phase) - sin(phase)) from X = 0; to rounding, as the solver has it in closed form."""
    A, f, phase = 0.004, 8.0, 0.6
    model = Model("hard", ("motor_lag",), ModelParameters(tau=tau), **HARD)
    t = np.linspace(0, 0.12, 60)
    m = simulate(model, sinusoid(f, A, phase), t=t, rtol=1e-10, atol=1e-12)
    w = 2 * math.pi * f
    gain, shift = 1 / math.hypot(1, w * tau), math.atan(w * tau)
    steady = lambda x: A * gain * np.sin(w * x + phase - shift) - A * math.sin(phase)  # noqa: E731
    true = steady(t) - steady(0.0) * np.exp(-t / tau)
    np.testing.assert_allclose(m.motor - m.rod, true, atol=1e-15)


@pytest.mark.parametrize("name", ["spline", "resonance"])
def test_closed_form_steps_agree_with_runge_kutta(name):
    """A hardening too small to act (1e-9 N/m^3) sends every step through Runge-Kutta."""
    if name == "resonance":
        model = Model("hard", ("landing_loss",), ModelParameters(e=0.2), **{**HARD, "spring_damping": 0.0})
        rate = math.sqrt(model.k_s / model.M) / (2 * math.pi)
        law = sinusoid(rate * (1 + 1e-5), 0.004, 0.3)
    else:
        model, _ = case("cone")
        x = 0.01875 * np.array([[9e3, -4e3, 7e3], [-800.0, 500.0, -300.0], [0.0, 20.0, -12.0], [0.0, 0.3, 0.9]])
        law = Spline(np.array([0.0, 0.05, 0.09, 0.15]), x)
    stiffer = Model(model.ground, (*model.terms, "spring_hardening"),
                    ModelParameters(**{**vars(model.parameters), "k_3": 1e-9}),
                    **(SAND if model.foot_mass else {**HARD, "spring_damping": 0.0}))  # fmt: skip
    t = np.linspace(0.0, 0.8, 300)
    a = simulate(model, law, t=t, rtol=1e-10, atol=1e-12)
    b = simulate(stiffer, law, t=t, rtol=1e-10, atol=1e-12)
    assert len(a.events) == len(b.events) > 2
    np.testing.assert_allclose(a.events["time"], b.events["time"], atol=1e-7)
    np.testing.assert_allclose(a.rod, b.rod, atol=1e-7)  # 1e-10 x some hundred steps x the growth of hops
    np.testing.assert_allclose(a.spring_force, b.spring_force, atol=1e-3)


def test_random_models_run_and_agree_with_runge_kutta():
    """24 random jumps on both grounds, heavy feet and strong drag included; then with friction and lag as well."""
    rng = np.random.default_rng(1)
    u = rng.uniform
    optional = ("inertial_drag", "depth_drag", "reintrusion_overshoot", "stop_go_overshoot", "compaction")
    for i in range(24):
        k1 = u(800, 8000)
        p = ModelParameters(k=k1, k1=k1, k2=u(500, 8000), delta=u(0.002, 0.02), sigma_cone=u(1e5, 1e6), mu=u(1.5, 3),
                            alpha=u(10, 100), b=u(0.5, 20), C=u(0, 4), s=u(0, 2000), s_p=u(0, 2000),
                            lam=u(1e-3, 1e-2), factor=u(0.8, 1.5), c_v=u(0, 2), F_c=u(0, 2), tau=u(1e-3, 1e-2),
                            e=u(0, 0.5), k_3=1e-9)  # fmt: skip
        hard = i % 4 == 3
        robot = {**SAND, "foot_mass": u(0.01, 0.3) * (i % 8 != 7), "spring_damping": u(0, 4)}
        static = ("two_resistance", "linear_penetration", "rft_cone")[i % 3]
        terms = ("landing_loss",) if hard else (static, *(t for t in optional if u() < 0.5))
        if "depth_drag" in terms and u() < 0.7:
            terms += ("added_mass",)
        law = sinusoid(u(4, 14), 0.01875, u(0, 2 * math.pi), float(rng.integers(1, 4)))
        ground, t = "hard" if hard else "granular", np.linspace(0, 1.2, 200)
        a = simulate(Model(ground, terms, p, **robot), law, t=t, rtol=1e-9, atol=1e-11)
        b = simulate(Model(ground, (*terms, "spring_hardening"), p, **robot), law, t=t, rtol=1e-10, atol=1e-12)
        # as in the convergence test 100 x rtol x 20 mm, times 50 for the most sensitive of 40 chains of up to 20 hops
        np.testing.assert_allclose(a.rod, b.rod, rtol=0, atol=1e-7)
        everything = ("viscous_friction", "coulomb_friction", "motor_lag")
        c = simulate(Model(ground, (*terms, *everything), p, **robot), law, t=t, rtol=1e-8, atol=1e-10)
        assert np.all(np.isfinite(c.rod)) and c.foot.min() >= -c.depth_max - 1e-12


def test_heights_are_those_of_the_sampled_track():
    model, law = case("cone")
    t = np.linspace(-0.1, 1.0, 110001)
    m = simulate(model, law, t=t, rtol=1e-10, atol=1e-12)
    # sampled every 10 us, the apex is missed by at most g dt^2 / 8 plus rounding
    assert m.jump_height == pytest.approx(m.rod[t >= law.stop].max() - m.rest, abs=1e-8)
    assert m.driven_height == pytest.approx(m.rod[t <= law.stop].max() - m.rest, abs=1e-6)
    com = (model.M * m.rod + model.m_m * (m.motor - m.rod) + model.m_f * m.foot) / (model.M + model.m_f)
    assert m.com_height == pytest.approx((com - com[0]).max(), abs=1e-8)
    assert m.depth_max == pytest.approx(-m.foot.min(), abs=1e-8)
    whole = simulate(model, law, t=t, rtol=1e-10, atol=1e-12, stop=0.5)
    assert whole.jump_height == pytest.approx(m.rod[t >= 0.5].max() - m.rest, abs=1e-8)
    # Newton's law of the whole robot: ground force = weight + momentum rate, in flight 0
    assert np.all(m.ground_force[m.mode == AIR] == 0.0)
    assert np.all(m.ground_force[m.mode == REST] > -1e-6)
    assert m.ground_force[0] == pytest.approx((model.M + model.m_f) * model.g)


def test_ground_force_is_the_rate_of_momentum():
    model, law = case("everything")
    model = Model(model.ground, tuple(x for x in model.terms if x != "viscous_friction"), model.parameters, **SAND)
    t = np.linspace(0, 0.6, 60001)
    m = simulate(model, law, t=t, rtol=1e-11, atol=1e-13)
    y = m.rod + model.m_m / model.M * (m.motor - m.rod)
    rate = np.diff(model.M * y + model.m_f * m.foot, 2) / (t[1] - t[0]) ** 2
    force = m.ground_force[1:-1] - (model.M + model.m_f) * model.g
    same = (m.mode[2:] == m.mode[1:-1]) & (m.mode[:-2] == m.mode[1:-1])
    # second difference: dt^2/12 of the fourth derivative, a few F w^2 = 100 N (300/s)^2 1e-10 / 12, and rounding
    # 4e-17 m / 1e-10 s^2 x 1.3 kg; steps begin anew within, so allow for their tolerance
    assert np.quantile(np.abs(rate - force)[same], 0.99) < 0.02


def test_bad_calls_are_named():
    model, law = case("plain")
    with pytest.raises(ValueError, match=r"t\[0\] = 0.1"):
        simulate(model, law, t=[0.1, 0.2], rtol=1e-7, atol=1e-9)
    with pytest.raises(ValueError, match="increasing"):
        simulate(model, law, t=[0.0, 0.0], rtol=1e-7, atol=1e-9)
    with pytest.raises(ValueError, match="rtol = 0"):
        simulate(model, law, t=[0.0, 1.0], rtol=0, atol=1e-9)
    soft = Model("granular", ("two_resistance",), ModelParameters(k1=100.0, k2=0.0, delta=0.01), **SAND)
    with pytest.raises(ValueError, match="cannot carry"):
        simulate(soft, law, t=[0.0, 1.0], rtol=1e-7, atol=1e-9)


def test_an_intrusion_over_before_it_is_seen_is_none():
    """A start phase a hair below pi/2 gives an impulse of 1e-8 m/s: the foot must not stop and start without end."""
    model = Model(
        "granular", ("two_resistance", "inertial_drag"), ModelParameters(k1=2100.0, k2=2100.0, delta=0.012, alpha=73.0),
        motor_mass=1.125, rod_mass=0.175, foot_mass=0.04, spring_stiffness=3300.0, spring_damping=1.2, gravity=9.81,
        foot_radius=0.0381, volume_fraction=0.57, grain_density=1000.0,
    )  # fmt: skip
    heights = []
    for off in (0.0, 2e-8, 2.7e-8, 1e-6, 3e-6, 1e-5):
        law = sinusoid(7.0, 0.01875, math.pi / 2 - off, 1.0, 0.1)
        heights.append(simulate(model, law, t=np.arange(0.0, 0.8, 0.005), rtol=1e-8, atol=1e-10).jump_height)
    assert heights == pytest.approx([heights[0]] * 6, abs=1e-8)  # the impulse of 1e-5 rad is worth less than 1e-8 m


def test_rest_is_balanced_in_any_bed():
    """F_p(z_0) = (M + m_f) g to rounding, also where a straight F_p lets the search hit the root in one step."""
    rng = np.random.default_rng(4)
    for k1, mass in zip(rng.uniform(1500.0, 3000.0, 300), rng.uniform(0.9, 1.3, 300)):
        p = ModelParameters(k1=k1, k2=2100.0, delta=0.01)
        model = Model("granular", ("two_resistance",), p, **(SAND | {"motor_mass": mass}))
        z = -equilibrium(model)[1]
        assert k1 * min(z, 0.01) + 2100.0 * max(z - 0.01, 0.0) == pytest.approx((model.M + model.m_f) * 9.81, rel=1e-12)


def test_a_motor_that_stands_still_pushes_no_foot_where_the_bed_remembers_a_pause():
    """A log's ripples of 2 um before the motion would leave the foot as after a pause, 6 N stronger."""
    model, law = case("cone")[0], sinusoid(8.0, 0.01875, 1.5 * math.pi, start=0.2)
    parameters = replace(model.parameters, s_p=1000.0, lam=0.005)
    model = replace(model, terms=(*model.terms, "stop_go_overshoot"), parameters=parameters)
    t, step = np.arange(0.0, 0.5, 1e-3), 6.25e-6
    log = from_motion(t, step * np.round(law(t)[0] / step), step / math.sqrt(12.0))
    assert log.start == pytest.approx(law.start, abs=2e-3)
    times = np.r_[0.0, t + 1e-3]
    by_log, by_law = (simulate(model, f, t=times, rtol=1e-8, atol=1e-10, stop=law.stop) for f in (log, law))
    assert by_log.events["time"][0] > 0.199
    # position good to 2 um, its rate to 2 mm/s at the corner of the law: 0.1 mm of 50
    assert by_log.jump_height == pytest.approx(by_law.jump_height, abs=2e-4)
