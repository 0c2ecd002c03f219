"""Hard-ground jumps in closed form against an integration, energy, closed solutions and the thesis' numbers."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.interpolate import CubicSpline

from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.forcing import Segments, Spline, delayed, sincos, sinusoid
from jumpvision.jumper.physics.hard.jump import half_cycle_rows, hard_jump, hard_map, hard_sweep
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand.jump import simulate

THESIS = {
    "motor_mass": 1.003, "rod_mass": 0.175, "stiffness": 5760.6, "damping": 1.368, "gravity": 0.276 * 9.81,
    "landing_loss": 0.0,
}  # fmt: skip
A = 4e-3
F0 = math.sqrt(5760.6 / 1.178) / (2 * math.pi)


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
        amp = mass * g / k / rng.uniform(0.03, 0.4)
        f = f0 * (rng.uniform(0.15, 0.4) if i % 3 == 0 else rng.uniform(0.4, 1.6))
        yield robot, (f, amp, rng.uniform(0, 2 * math.pi), int(rng.integers(1, 4)))


def by_runge_kutta(law, t_end, robot):
    """The jump by the simulator of both grounds: a hardening too small to act sends its every step through RK."""
    names = {"stiffness": "spring_stiffness", "damping": "spring_damping"}
    given = {names.get(n, n): x for n, x in robot.items() if n != "landing_loss"}
    parameters = ModelParameters(e=robot["landing_loss"], k_3=1e-9)
    model = Model("hard", ("landing_loss", "spring_hardening"), parameters, foot_mass=0.0, **given)
    return simulate(model, law, t=[0.0, t_end], rtol=1e-12, atol=1e-14)


def test_random_jumps_agree_with_an_integration():
    """Flights and heights: a tolerance of 1e-12 a step, some hundred steps, at contacts of 1 mm/s and more."""
    hops = []
    for robot, given in draws(60, seed=3):
        law = sinusoid(*given)
        t_end = law.stop + 3.0 * math.sqrt(given[1] / robot["gravity"])
        jump = hard_jump(**robot, forcing=law, t=None, t_end=t_end)
        m = by_runge_kutta(law, t_end, robot)
        flights = np.c_[jump.lift_off, jump.landing]
        if (np.diff(flights, axis=1) * robot["gravity"] < 2e-3).any():
            continue  # a grazing contact: neither can decide it
        assert len(m.flights) == len(flights), (robot, given)
        np.testing.assert_allclose(flights, m.flights, rtol=0, atol=1e-7)
        assert abs(jump.com_height - m.com_height) < 1e-8 and abs(jump.jump_height - m.jump_height) < 1e-8
        hops.append(len(flights))
    assert len(hops) > 30 and max(hops) >= 5 and hops.count(0) < 20


def test_resonant_and_overdamped_springs_agree_with_the_integration():
    # closed forms change at f = f_0 without damping (secular) and at zeta = 1; both sides of each switch, and on it
    cases = [(zeta, ratio) for zeta in (0.0, 1e-4) for ratio in (1.0, 1.0 + 1e-9, 0.9991, 0.9989)]
    cases += [(zeta, 0.8) for zeta in (1.0 - 1e-12, 1.0, 1.0 + 1e-12, 3.0)]
    for zeta, ratio in cases:
        robot, law = THESIS | {"damping": zeta * 2 * math.sqrt(5760.6 * 1.178)}, sinusoid(ratio * F0, 3 * A, 1.0, 3)
        jump = hard_jump(**robot, forcing=law, t=None, t_end=law.stop + 0.5)
        m = by_runge_kutta(law, law.stop + 0.5, robot)
        assert len(m.flights) > 0
        np.testing.assert_allclose(np.c_[jump.lift_off, jump.landing], m.flights, rtol=0, atol=1e-8)
        assert abs(jump.com_height - m.com_height) < 1e-9 and abs(jump.jump_height - m.jump_height) < 1e-9


def test_resonance_without_lift_off_grows_as_the_secular_solution():
    # c = 0, omega = w0, phase 0: x = -g/w0^2 - (q A / 2) (sin w0 t + w0 t cos w0 t), v(0) = -q A w0 from the step
    robot, w0 = THESIS | {"damping": 0.0}, math.sqrt(5760.6 / 1.178)
    amp, q = 1e-6, 1.003 / 1.178
    t = np.linspace(0, 19.99 / F0, 997)
    jump = hard_jump(**robot, forcing=sinusoid(F0, amp, 0.0, 20), t=t, t_end=20 / F0)
    x = -THESIS["gravity"] / w0**2 - q * amp / 2 * (np.sin(w0 * t) + w0 * t * np.cos(w0 * t))
    np.testing.assert_allclose(jump.rod, x, rtol=0, atol=1e-16)  # eps * 20 cycles of phase * the amplitude, 1e-4 m
    assert len(jump.lift_off) == 0 and jump.n_jumps == 0 and jump.flight_height == 0.0


@pytest.mark.parametrize("law", [sinusoid(3.1, 2 * A, 0.7, 2), delayed(9.0, A, 1.9, 0.03)], ids=str)
def test_energy_balance_and_peaks(law):
    # motor work + impulses = change of energy + heat of damper and landings; quadrature between the events
    robot = THESIS | {"landing_loss": 0.33, "damping": 8.0}
    q, t_end = 1.003 / 1.178, law.stop + 0.8
    jump = hard_jump(**robot, forcing=law, t=None, t_end=t_end)
    lands = jump.landing[np.isfinite(jump.landing)]
    assert len(jump.lift_off) >= 2
    edges = np.unique(np.r_[law.rows[:, 0], law.stop, jump.lift_off, lands, t_end])
    work = heat = 0.0
    peaks = []
    for lo, hi in itertools.pairwise(edges):
        t = np.linspace(lo, hi, 4001)
        t[0], t[-1] = lo + 1e-13, hi - 1e-13  # inside the events
        m = hard_jump(**robot, forcing=law, t=t, t_end=t_end)
        row = law.rows[min(np.searchsorted(law.rows[:, 1], lo, "right"), len(law.rows) - 1)]
        accel = -row[3] * row[4] ** 2 * np.sin(row[4] * (t - row[0]) + row[5]) * (lo < law.stop)
        force = 1.003 * (m.spring_force + 0.175 * accel) / 1.178
        work += simpson(force * law(t)[1], x=t)
        heat += simpson(8.0 * m.rod_velocity**2 * (m.spring_force != 0.0), x=t)
        if lo < law.stop:
            peaks.append((np.max(force), np.max(force * law(t)[1])))
    after = hard_jump(**robot, forcing=law, t=lands, t_end=t_end).rod_velocity
    loss = (1.0 / math.sqrt(0.67) - 1.0) * after  # v_r before - after; y' = v_r + q X_m' falls by as much
    y_rate = after + q * law(lands)[1]
    heat += np.sum(0.5 * 1.178 * ((y_rate + loss) ** 2 - y_rate**2))
    ends = hard_jump(**robot, forcing=law, t=[law.start - 1.0, t_end], t_end=t_end)
    y = ends.rod + q * (ends.motor - ends.rod)
    spring = 0.5 * 5760.6 * np.minimum(ends.rod, 0.0) ** 2
    energy = 0.5 * 1.178 * ends.rod_velocity**2 + 1.178 * robot["gravity"] * y + spring
    # Simpson errs by less than (w dt)^4 / 180 < 1e-9 of each term (w dt < 2 pi 20 Hz * 0.3 s / 4000)
    assert abs(work + sum(jump.impulse_work_J) - heat - (energy[1] - energy[0])) < 1e-8 * heat
    # a grid of dt misses a peak by at most (w dt)^2 / 8 of itself, w = 4 pi 11 Hz, dt < 0.3 s / 4000: 1.4e-5
    assert -1e-12 <= jump.peak_force_N / max(p[0] for p in peaks) - 1 < 2e-5
    assert -1e-12 <= jump.peak_power_W / max(p[1] for p in peaks) - 1 < 2e-5
    speed = np.max(np.abs(law(np.linspace(law.start, law.stop - 1e-12, 100001))[1]))
    assert -1e-12 <= jump.peak_motor_speed / speed - 1 < 1e-7


def test_bounces_below_grazing_speed_are_not_counted():
    # geometric bounces u_n = u_0 (1 - e)^(n/2) never end; those that leave and land below 1e-6 m/s are not counted
    robot = THESIS | {"damping": 0.0, "landing_loss": 0.5}
    law = sinusoid(17.0, A, 3 * np.pi / 2)
    short, long = (hard_jump(**robot, forcing=law, t=None, t_end=t_end) for t_end in (10.0, 60.0))
    free = short.lift_off > law.stop
    u0 = 0.5 * robot["gravity"] * (short.landing - short.lift_off)[free][0]
    assert len(short.lift_off) == len(long.lift_off)  # it does end, and time goes on
    assert free.sum() == 1 + math.floor(2 * math.log2(u0 / 1e-6))


def test_sine_and_cosine_are_right_to_rounding():
    rng = np.random.default_rng(9)
    quarters = np.arange(-200, 200) * np.pi / 4  # where the polynomials change over
    x = np.r_[rng.uniform(-30, 30, 20000), 10 ** rng.uniform(-9, 9, 20000), quarters, quarters + 1e-9, 1e6 - 0.5]
    got = np.array([sincos(v) for v in x]).T
    # an ulp below 1 is 1.1e-16: ours may err by 0.8 of it, numpy's by as much
    np.testing.assert_allclose(got, [np.sin(x), np.cos(x)], rtol=0, atol=1.8e-16)


def test_no_contact_is_missed_however_short():
    # where the number of flights changes with the amplitude, the rod just touches the ground, or just leaves it
    def jump(f, ph, amp, t=None):
        return hard_jump(**THESIS, forcing=sinusoid(f, amp, ph, 2), t=t, t_end=2 / f)

    found = 0
    for f, ph in ((3.0, 0.4), (4.1, 2.0), (5.2, 1.2), (6.3, 4.0), (9.0, 5.5)):
        grid = np.linspace(0.1 * A, 2.5 * A, 40)
        counts = [len(jump(f, ph, a).lift_off) for a in grid]
        for i in np.flatnonzero(np.diff(counts)):
            lo, hi, n = grid[i], grid[i + 1], counts[i]
            while lo < 0.5 * (lo + hi) < hi:
                mid = 0.5 * (lo + hi)
                lo, hi = (mid, hi) if len(jump(f, ph, mid).lift_off) == n else (lo, mid)
            few, many = sorted((lo, hi), key=lambda a: len(jump(f, ph, a).lift_off))
            known = np.append(jump(f, ph, few).lift_off, -1.0)
            extra = [t for t in jump(f, ph, many).lift_off if np.min(np.abs(known - t)) > 1e-4]
            if not extra or 2 / f - extra[0] < 1e-3:
                continue  # a flight that begins as the law ends: no grazing
            x = jump(f, ph, few, extra[0] + np.linspace(-2e-4, 2e-4, 4001)).rod
            # a flight of speed 1e-6 m/s rises 1e-13 m; the grid of 1e-7 s hides as much
            assert np.min(np.abs(x)) < 1e-12
            found += 1
    assert found >= 5


def test_spline_of_a_sinusoid_converges_to_it():
    f, ph = 8.2, np.pi / 2  # X_m' = 0 at both ends, as clamped
    exact = hard_jump(**THESIS, forcing=sinusoid(f, A, ph), t=[0.05, 0.2], t_end=1.5)
    errors = []
    for n in (40, 80, 160):
        t = np.linspace(0, 1 / f, n + 1)
        pp = CubicSpline(t, A * (np.sin(2 * np.pi * f * t + ph) - 1.0), bc_type="clamped")
        got = hard_jump(**THESIS, forcing=Spline(pp.x, pp.c), t=[0.05, 0.2], t_end=1.5)
        assert got.n_jumps == exact.n_jumps == 2
        errors.append(np.max(np.abs(got.rod - exact.rod)))
        # a clamped spline errs by at most 5/384 h^4 max|d^4 X/dt^4|; the jump amplifies a stroke tenfold, 100 is ample
        bound = 100 * 5 / 384 * (2 * np.pi / n) ** 4 * A
        assert errors[-1] < bound and abs(got.com_height - exact.com_height) < bound
        # F_m follows X'', which errs by h^2/12 of itself, P also X', and X' by h^3/24
        assert abs(got.peak_power_W / exact.peak_power_W - 1) < (2 * np.pi / n) ** 2
        assert abs(got.peak_force_N / exact.peak_force_N - 1) < (2 * np.pi / n) ** 2
        assert abs(got.peak_motor_speed / exact.peak_motor_speed - 1) < (2 * np.pi / n) ** 3
    assert all(11 < a / b < 22 for a, b in itertools.pairwise(errors))  # fourth order: 16


def test_thesis_robot():
    # docs/physics.md section 7, column RK4: to its last printed digit, frequencies to the step of its sweep
    ratio = np.arange(0.4, 1.9, 0.0005)
    m = hard_map(ratio * F0, [np.pi / 2, 3 * np.pi / 2], amplitude=A, cycles=1, **THESIS)
    com, power, force, speed = (m[k] for k in ("com_height_m", "peak_power_W", "peak_force_N", "peak_motor_speed"))
    stutter, single = np.argmax(com, axis=0)
    assert abs(ratio[stutter] - 0.7375) < 0.0025 and abs(ratio[single] - 1.54) < 0.005
    assert abs(com[stutter, 0] - 0.0410) < 5e-5 and abs(com[single, 1] - 0.0381) < 5e-5
    good = ratio[com[:, 1] > 0.99 * com[single, 1]]
    assert abs(good[0] - 1.39) < 0.005 and abs(good[-1] - 1.71) < 0.005
    assert abs(power[single, 1] / power[stutter, 0] - 1.52) < 0.005
    assert abs(speed[single, 1] / speed[stutter, 0] - 2.09) < 0.005
    assert abs(force[stutter, 0] / force[single, 1] - 1.33) < 0.005
    assert m["n_jumps"][stutter, 0] == 2 and m["n_jumps"][single, 1] == 1
    a, b = np.argmin(np.abs(ratio - 0.78)), np.argmin(np.abs(ratio - 1.4))
    assert abs(power[b, 1] / power[a, 0] - 1.31) < 0.005 and abs(speed[b, 1] / speed[a, 0] - 1.79) < 0.005


BAD = {"motor_mass": -1.0, "rod_mass": -0.1, "stiffness": 0.0, "damping": -1.0, "gravity": math.nan}


@pytest.mark.parametrize("name", [*BAD, "amplitude", "cycles"])
def test_a_bad_parameter_is_named_with_its_range(name):
    value = BAD.get(name, 0.0)
    with pytest.raises(ValueError, match=rf"^{name} = {value}.* must be (>|in)"):
        hard_map([8.0], [1.0], **{"amplitude": A, "cycles": 1} | THESIS | {name: value})
    if name in THESIS:
        with pytest.raises(ValueError, match=f"^{name} = "):
            hard_jump(**THESIS | {name: value}, forcing=sinusoid(8.0, A, 1.0), t=None, t_end=1.0)


@pytest.mark.parametrize(("name", "f", "phase"), [("frequency", math.nan, 1.0), ("phase", 8.0, math.inf)])
def test_a_bad_axis_of_a_map_is_named(name, f, phase):
    with pytest.raises(ValueError, match=rf"^{name} = (nan|inf) must be (> 0 Hz|a finite number rad)"):
        hard_map([8.0, f], [1.0, phase], amplitude=A, cycles=1, **THESIS)


def test_a_bad_law_or_time_is_refused():
    law = sinusoid(8.0, A, 1.0)
    with pytest.raises(ValueError, match=r"t_end = 0\.1 "):
        hard_jump(**THESIS, forcing=law, t=None, t_end=0.1)
    with pytest.raises(ValueError, match="t must"):
        hard_jump(**THESIS, forcing=law, t=[0.0, 2.0], t_end=1.0)
    for column, value, words in ((3, -A, "amplitude A"), (1, 0.0, "t1 > t0"), (4, math.nan, "finite")):
        rows = law.rows.copy()
        rows[0, column] = value
        with pytest.raises(ValueError, match=words):
            hard_jump(**THESIS, forcing=Segments(rows), t=None, t_end=1.0)
    broken = delayed(8.0, A, 1.0, 0.1).rows
    broken[1, 2] += 1e-3
    with pytest.raises(ValueError, match="continuous"):
        hard_sweep(broken, **THESIS)
    with pytest.raises(ValueError, match="spline"):
        hard_jump(**THESIS, forcing=Spline(np.array([0.0, 1.0]), np.full((4, 1), np.nan)), t=None, t_end=1.0)


def test_the_impulse_of_a_velocity_step_is_the_kinetic_energy_that_it_gives():
    """At rest on the spring nothing else acts in an instant: momentum stays 0, and the motor leaves the rod at X_m'."""
    law = Segments(half_cycle_rows(6.0, 9.0, 0.01, 0.3, 0.0))
    step = 2.0 * math.pi * 6.0 * 0.01 * math.cos(0.3)
    rod = -1.1 * step / (1.1 + 0.2)
    found = hard_jump(
        motor_mass=1.1, rod_mass=0.2, stiffness=3300.0, damping=1.2, gravity=9.81, landing_loss=0.0, forcing=law,
        t=None, t_end=1.0,
    )  # fmt: skip
    energy = 0.5 * 0.2 * rod**2 + 0.5 * 1.1 * (rod + step) ** 2
    assert found.impulse_work_J[0] == pytest.approx(energy, rel=1e-12)


@pytest.mark.parametrize("delay", [0.0, 0.05])
def test_each_half_cycle_lasts_half_a_period_of_its_own(delay):
    rows = half_cycle_rows(5.0, 8.0, 0.01, 0.5 * math.pi, delay)
    assert rows[0, :2] == pytest.approx([0.0, 0.1]) and rows[-1, 1] == pytest.approx(0.1 + delay + 0.0625)
