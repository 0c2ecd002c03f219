"""The virtual laboratory against solve_ivp, closed forms, quadrature and counted photons."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from jumpvision.base.schema import InputError
from jumpvision.laboratory import samples
from jumpvision.laboratory.films.bed import bed_height, bed_picture
from jumpvision.laboratory.films.flow import Flow
from jumpvision.laboratory.films.grains import GrainScene, View
from jumpvision.laboratory.jumper import Law, Motion, Motor, Samples, motion_of
from jumpvision.laboratory.recordings import ENCODER_STEP, contact_log, motor_log, rod_track
from jumpvision.laboratory.samples import write_samples

HARD, SAND = samples.HARD_ROBOT, samples.SAND_ROBOT
CONE = samples.SAND_TRUTH


def sand(frequency, phase, terms=samples.SAND_TERMS, robot=SAND, **options) -> Motion:
    options = {"duration": 0.8, "dt": 1e-5, "every": 10} | options
    parameters = CONE | {"alpha": 73.0} | options.pop("parameters", {})
    law = Law(frequency, 0.01875, phase * math.pi, 0.05)
    return motion_of(robot, law, terms, parameters, ground="granular", bed_density=570.0, **options)


def hard(frequency, phase, terms=(), robot=HARD, amplitude=0.004, duration=0.8, parameters=None, **options) -> Motion:
    law = Law(frequency, amplitude, phase * math.pi, 0.05)
    return motion_of(robot, law, terms, parameters or {}, ground="hard", duration=duration, **options)


# ---------------------------------------------------------------------------------------------------------- the jumper


def test_grounded_phase_agrees_with_solve_ivp():
    """Too small an amplitude to lift off: M a_r = -M g + F_s - m_m X_m'' in x_r itself, here by DOP853."""
    f, A, phase, start = 7.0, 5e-5, 0.5 * math.pi, 0.05
    m = hard(f, 0.5, amplitude=A, duration=0.5)
    assert m.contact.all()
    w, M = 2 * math.pi * f, 1.178

    def rates(t, s):
        acc = -A * w * w * math.sin(w * (t - start) + phase) if start <= t < start + 1 / f else 0.0
        return s[1], -HARD.gravity + (-5760.6 * s[0] - 1.368 * s[1] - 1.003 * acc) / M

    x, t = np.array([-M * HARD.gravity / 5760.6, 0.0]), m.t
    out = []
    for a, b in ((0, start), (start, start + 1 / f), (start + 1 / f, 0.6)):
        inside = t[(t >= a) & (t < b)]
        s = solve_ivp(rates, (a, b), x, t_eval=np.append(inside, b), method="DOP853", rtol=1e-11, atol=1e-14)
        out.append(s.y[0, : len(inside)])
        x = s.y[:, -1]
    assert np.ptp(m.rod) > 1e-4
    # the steps of X'' fall on steps of the grid only to rounding: A w^2 dt^2 ~ 1e-12 m at worst
    np.testing.assert_allclose(m.rod, np.concatenate(out), atol=1e-10)


def test_intrusion_with_the_cone_agrees_with_solve_ivp():
    """(m_f + m_a) a_f = -push + F_p + b m_a' v^2 with eq. (33) written out, over a smooth stretch of the push-off."""
    m = sand(7.0, 0.5, dt=2e-6, every=50, duration=0.3)
    speed = np.where(m.added_mass > 0, -m.foot_rate, 0.0)
    middle = int(np.argmax(np.where(m.t > 0.15, speed, 0.0)))
    i, j = middle - 40, middle + 40
    assert (speed[i : j + 1] > 0.1).all()
    R, mu, tan, inertia = 0.0381, 2.0, math.tan(math.pi / 3), 2.7 * 570.0
    w, M = 2 * math.pi * 7.0, 1.3

    def rates(t, s):
        x_r, v_r, x_f, v_f = s
        z = -x_f
        acc = -0.01875 * w * w * math.sin(w * (t - 0.05) + 0.5 * math.pi)
        F_s = -3300.0 * (x_r - x_f) - 1.2 * (v_r - v_f)
        r = R - mu * z / tan
        m_a = inertia * math.pi * tan / 3 * (R**3 - r**3)
        a_f = (2100.0 * z + 17.2 * inertia * mu * math.pi * r * r * v_f**2 - F_s - 0.04 * 9.81) / (0.04 + m_a)
        return v_r, -9.81 + (F_s - 1.125 * acc) / M, v_f, a_f

    first = [m.rod[i], m.rod_rate[i], m.foot[i], m.foot_rate[i]]
    s = solve_ivp(rates, (m.t[i], m.t[j]), first, t_eval=m.t[i : j + 1], method="DOP853", rtol=1e-11, atol=1e-13)
    assert np.ptp(m.foot[i : j + 1]) > 2e-3
    np.testing.assert_allclose(m.foot[i : j + 1], s.y[2], atol=1e-9)
    np.testing.assert_allclose(m.rod[i : j + 1], s.y[0], atol=1e-9)


def test_landing_shares_the_foots_momentum_with_the_cone():
    """v_f -> m_f v_f / (m_f + m_a); 1e-6 s of deceleration by < 2000 m/s^2 beside it."""
    m = sand(5.0, 0.5, dt=1e-6, every=1, duration=0.35)
    i = int(np.flatnonzero(np.diff(m.contact.astype(int)) == 1)[0])
    share = 0.04 / (0.04 + m.added_mass[i + 1])
    assert share < 0.5
    assert m.foot_rate[i + 1] == pytest.approx(share * m.foot_rate[i], abs=2e-3 + 2e-3)


TWINS = [
    ("payload", {"dm": 0.1}, {"motor_mass": SAND.motor_mass + 0.1}),
    ("foot_mass", {"dm_f": 0.03}, {"foot_mass": 0.07}),
    ("spring_damping", {"dc": 0.7}, {"spring_damping": 1.9}),
    ("spring_stiffness", {"dk": -200.0}, {"spring_stiffness": 3100.0}),
    ("tilt", {"dg": 0.3}, {"gravity": 10.11}),
]


@pytest.mark.parametrize(("mechanism", "parameters", "robot"), TWINS)
def test_a_changed_robot_is_the_mechanism(mechanism, parameters, robot):
    a = sand(6.0, 0.5, (*samples.SAND_TERMS, mechanism), parameters=parameters)
    b = sand(6.0, 0.5, robot=SAND._replace(**robot))
    np.testing.assert_allclose(a.rod, b.rod, atol=1e-12)
    assert np.abs(a.rod - sand(6.0, 0.5).rod).max() > 1e-4


OTHERS = {  # parameters, and those with which nothing may be left of it, to what a late law moves the rod by
    "reintrusion_overshoot": ({"s": 3000.0, "lam": 0.005}, {"s": 3e-3, "lam": 0.005}),
    "stop_go_overshoot": ({"s_p": 1000.0, "lam": 0.005}, {"s_p": 1e-3, "lam": 0.005}),
    "compaction": ({"factor": 1.3}, {"factor": 1 + 1e-6}),
    "viscous_friction": ({"c_v": 1.0}, {"c_v": 1e-6}),
    "coulomb_friction": ({"F_c": 0.5}, {"F_c": 5e-7}),
    "spring_hardening": ({"k_3": 3e6}, {"k_3": 3.0}),
    "landing_loss": ({"e": 0.3}, {"e": 3e-7}),
    "motor_lag": ({"tau": 0.003}, {"tau": 3e-5}),  # the step must resolve it: late by tau, x 1.5 m/s at most
    "loop_bandwidth": ({"t_n": 0.003, "zeta": 0.6}, {"t_n": 2e-5, "zeta": 0.6}),  # late by 2 zeta t_n
    "speed_limit": ({"top_speed": 0.5}, {"top_speed": 10.0}),  # never met
    "stroke_limit": ({"reach": 0.02}, {"reach": 10.0}),
    "drive_play": ({"play": 1e-3, "flank": 0.0}, {"play": 1e-9, "flank": 0.0}),
}


@pytest.mark.parametrize("mechanism", OTHERS)
def test_every_mechanism_moves_the_rod_and_vanishes_with_its_parameter(mechanism):
    plain = sand(6.0, 0.5)
    full, nearly = (sand(6.0, 0.5, (*samples.SAND_TERMS, mechanism), parameters=p) for p in OTHERS[mechanism])
    assert np.abs(full.rod - plain.rod).max() > 3e-4
    late = mechanism in ("motor_lag", "loop_bandwidth")
    np.testing.assert_allclose(nearly.rod, plain.rod, atol=2e-4 if late else 2e-6)


def test_static_forces():
    """Settled depth from F_p(z_0) = (M + m_f) g: linear, and the RFT cone by quadrature of its areas."""
    weight = 1.34 * 9.81
    still = Law(5.0, 0.0, 0.0, 0.05)
    m = motion_of(SAND, still, ["linear_penetration"], {"k": 1900.0}, ground="granular", duration=0.02)
    assert -m.foot[0] == pytest.approx(weight / 1900.0, rel=1e-9)
    assert np.ptp(m.rod) < 1e-12

    p = {"k1": 1500.0, "sigma_cone": 2.5e5, "mu": 2.2, "theta": math.pi / 3}
    z0 = -motion_of(SAND, still, ["rft_cone"], p, ground="granular", duration=0.02).foot[0]
    R = 0.0381
    flat = quad(lambda z: (R - 2.2 * z / math.sqrt(3)) ** 2, 0, z0)[0] * math.pi
    force = 1500.0 / (math.pi * R * R) * flat + 2.5e5 * (math.pi * R * R * z0 - flat) / 0.5
    assert force == pytest.approx(weight, rel=1e-9)


# ------------------------------------------------------------------------------------------------------------ the logs
def test_logs_say_what_the_motion_did():
    m = hard(8.2, 0.5)
    rng = np.random.default_rng(1)
    log = motor_log(m, rate=1000.0, force_noise=0.3, rng=rng)
    law = 0.004 * (np.cos(2 * math.pi * 8.2 * (log["time_s"] - 0.05)) - 1)
    moving = (log["time_s"] > 0.05) & (log["time_s"] < 0.05 + 1 / 8.2)
    assert np.abs(log["position_m"] - np.where(moving, law, 0.0)).max() <= 0.5 * ENCODER_STEP + 1e-8
    contact = contact_log(m, rate=1000.0)
    first = contact["time_s"][contact["contact"] == 0][0]
    assert 0 <= first - m.lift_offs[0] <= 1.1e-3

    track = rod_track(m, rate=200.0, noise=5e-5, zero=0.02, rng=rng, scale=1.01, dt=0.002)
    error = track["height_m"] - 1.01 * (np.interp(track["time_s"] + 0.002, m.t, m.rod) - 0.02)
    assert 0.75 < error.std() / 5e-5 < 1.25  # 161 samples: 3.5 / sqrt(2 n) = 0.2


# --------------------------------------------------------------------------------------------------------- the pictures


def test_bed_picture_shows_the_height():
    """The steepest fall of the mean brightness lies at the mean surface; roughness 0.4 grain over 420 columns and the
    light shining into the topmost grains leave less than half a pixel."""
    height = bed_height(0.583, solid_volume=0.045, length=0.56, width=0.56)
    assert 0.045 / (height * 0.56**2) == pytest.approx(0.583, rel=1e-12)
    picture, surface = bed_picture(
        height, scale=5e-4, floor_row=620.0, shape=(656, 420), grain_diameter=1e-3, rng=np.random.default_rng(4)
    )
    assert surface.mean() == pytest.approx(height, abs=1e-12)
    assert 2e-4 < surface.std() < 6e-4
    fall = -np.diff(picture.mean(axis=1))[:500]
    near = slice(int(np.argmax(fall)) - 3, int(np.argmax(fall)) + 4)
    edge = fall[near] @ (np.arange(500)[near] + 0.5) / fall[near].sum()
    assert edge == pytest.approx(620.0 - height / 5e-4, abs=0.5)


# ---------------------------------------------------------------------------------------------------------- the grains
@pytest.fixture(scope="module")
def flow() -> Flow:
    return Flow(0.0381, 2.0, math.pi / 3, 2.7, math.radians(45.0), 0.008, (0.0062, 0.031))


@pytest.mark.parametrize("z", [0.0062, 0.029])
def test_flow_carries_half_the_added_mass_of_the_jumps(flow, z):
    """rho phi pi int int v r dr dh, summed over the speed itself, is half of eq. (33); midpoint sums to 0.2 %."""
    r = (np.arange(1200) + 0.5) * 1e-4
    h = (np.arange(1500) + 0.5) * 2e-4
    share = flow.speed(r, h[:, None], z)
    half = 570.0 * math.pi * (share * r).sum() * 1e-4 * 2e-4
    s = 0.0381 * math.tan(math.pi / 3)  # eq. (33) as the difference of two cones of slope theta
    m_a = 2.7 * 570.0 * math.pi * 0.0381**2 / 3 * (s - (s - 2 * z) ** 3 / s**2)
    assert half == pytest.approx(0.5 * m_a, rel=2e-3)
    true = flow.truth(z, 0.4, bed_density=570.0, left=0.05, right=0.06, bottom=0.08)
    assert true["added_mass_kg"] == pytest.approx(0.5 * m_a, rel=1e-3)
    seen = [570.0 * math.pi * (share * r)[h < 0.08][:, r < x].sum() * 2e-8 for x in (0.05, 0.06)]
    assert true["added_mass_in_view_kg"] == pytest.approx(np.mean(seen), rel=3e-3)
    assert true["momentum_kg_m_s"] == pytest.approx(0.4 * true["added_mass_kg"])


def camera(flow: Flow) -> GrainScene:
    view = View((220, 310), 4e-4, 32.0, 150.0)
    return GrainScene(view, flow, 0.0062, diameter=1.2e-3, spread=0.15, rng=np.random.default_rng(6))


def test_frames_follow_the_foot_and_rest_when_it_retreats(flow):
    cam = camera(flow)
    cam.frame(np.array([0.012]))
    y = cam.grains.y.copy()
    lifted = cam.frame(np.array([0.010, 0.009]))
    np.testing.assert_array_equal(cam.grains.y, y)
    below = lifted[:, 100:200].mean(axis=1)
    assert below[int(32 + 0.011 / 4e-4)] == pytest.approx(46.0, abs=6.0)  # the gap under the lifted foot
    jammed = np.abs(cam.grains.x) < 0.02
    cam.frame(np.array([0.013]))
    moved = y[jammed] - cam.grains.y[jammed]
    near = y[jammed] > -0.02
    np.testing.assert_allclose(moved[near], 0.001, atol=1e-12)  # inside the cone grains go with the foot


# ----------------------------------------------------------------------------------------------------------- the files


@pytest.mark.parametrize("kind", ["hard_groundd", "samples"])
def test_samples_are_never_written_over(kind, tmp_path):
    (tmp_path / "hard_ground").mkdir()
    with pytest.raises(InputError, match="unknown kind" if kind == "hard_groundd" else "exists"):
        write_samples(kind, tmp_path)
    assert list((tmp_path / "hard_ground").iterdir()) == []


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
