"""Hard-ground jumps against an independent integration, closed forms, energy and the thesis' numbers.

The oracle integrates rod and motor as the two bodies they are (thesis eqs. 3, 4), with scipy's DOP853 and event
location; it knows nothing of y, of arcs or of closed forms. The file takes about 17 s on two slow cores, 12 s of it
compilation (5 s with a warm cache).
"""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import simpson, solve_ivp
from scipy.interpolate import CubicSpline

from jumpvision.jumper.physics.forcing import Segments, Spline, delayed, sincos, sinusoid
from jumpvision.jumper.physics.hard.arc import GAMMA, JERK, KIND, W2, evaluate, make_arc
from jumpvision.jumper.physics.hard.flow import safe_step
from jumpvision.jumper.physics.hard.jump import hard_jump, hard_map, hard_sweep, sine_rows

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
            sol = solve_ivp(
                rhs, (t, end), s, "DOP853", args=(on, grounded), events=(up_down, com_speed, rod_speed),
                rtol=3e-14, atol=1e-15, max_step=0.04 / max(f, math.sqrt(stiffness / mass) / 6.28),
            )  # fmt: skip
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
        amp = mass * g / k / rng.uniform(0.03, 0.4)
        f = f0 * (rng.uniform(0.15, 0.4) if i % 3 == 0 else rng.uniform(0.4, 1.6))
        yield robot, (f, amp, rng.uniform(0, 2 * math.pi), int(rng.integers(1, 4)))


@pytest.mark.long
def test_random_jumps_agree_with_an_independent_integration():
    compared, hops = 0, []
    for robot, law in draws(120, seed=3):
        t_end = law[3] / law[0] + 3.0 * math.sqrt(law[1] / robot["gravity"])
        flights, speeds, com, rod = oracle(law, t_end, **robot)
        if speeds and min(speeds) < 1e-6:
            continue  # a grazing contact: neither integration can decide it
        jump = hard_jump(**robot, forcing=sinusoid(*law), t=None, t_end=t_end)
        assert len(jump.lift_off) == len(flights), (robot, law)
        # the oracle's rtol 3e-14 makes about 1e-13 m; at a contact of speed u that is 1e-13/u s, u > 1e-3 m/s here
        np.testing.assert_allclose(np.c_[jump.lift_off, jump.landing], flights, rtol=0, atol=1e-10)
        size = 1e-10
        assert abs(jump.com_height - com) < size and abs(jump.jump_height - rod) < size
        late = flights[flights[:, 1] > law[3] / law[0]]
        if len(late):
            best = robot["gravity"] * np.max(late[:, 1] - late[:, 0]) ** 2 / 8
            assert abs(jump.flight_height - best) < size
            assert jump.n_jumps == np.flatnonzero(flights[:, 1] > law[3] / law[0])[0] + 1
        compared += 1
        hops.append(len(flights))
    assert compared >= 115 and max(hops) >= 7 and hops.count(0) < 40


def test_resonant_and_overdamped_springs_agree_with_the_integration():
    # closed forms change at f = f_0 without damping (secular) and at zeta = 1; both sides of each switch, and on it
    cases = [(zeta, ratio) for zeta in (0.0, 1e-4) for ratio in (1.0, 1.0 + 1e-9, 0.9991, 0.9989)]
    cases += [(zeta, 0.8) for zeta in (1.0 - 1e-12, 1.0, 1.0 + 1e-12, 3.0)]
    for zeta, ratio in cases:
        robot = THESIS | {"damping": zeta * 2 * math.sqrt(5760.6 * 1.178)}
        law = (ratio * F0, 3 * A, 1.0, 3)
        t_end = law[3] / law[0] + 0.5
        flights, _, com, rod = oracle(law, t_end, **robot)
        jump = hard_jump(**robot, forcing=sinusoid(*law), t=None, t_end=t_end)
        assert len(flights) > 0
        # the oracle alone errs by about 1e-13 m; cancellation beside the switch adds 1e3 * 20 eps * A = 2e-14 m
        np.testing.assert_allclose(np.c_[jump.lift_off, jump.landing], flights, rtol=0, atol=1e-10)
        assert abs(jump.com_height - com) < 1e-11 and abs(jump.jump_height - rod) < 1e-11


def test_resonance_without_lift_off_grows_as_the_secular_solution():
    # c = 0, omega = w0, phase 0: x = -g/w0^2 - (q A / 2) (sin w0 t + w0 t cos w0 t), v(0) = -q A w0 from the step
    robot, w0 = THESIS | {"damping": 0.0}, math.sqrt(5760.6 / 1.178)
    amp, q = 1e-6, 1.003 / 1.178
    t = np.linspace(0, 19.99 / F0, 997)
    jump = hard_jump(**robot, forcing=sinusoid(F0, amp, 0.0, 20), t=t, t_end=20 / F0)
    x = -THESIS["gravity"] / w0**2 - q * amp / 2 * (np.sin(w0 * t) + w0 * t * np.cos(w0 * t))
    np.testing.assert_allclose(jump.rod, x, rtol=0, atol=1e-16)  # eps * 20 cycles of phase * the amplitude, 1e-4 m
    assert len(jump.lift_off) == 0 and jump.n_jumps == 0 and jump.flight_height == 0.0


def test_centre_of_mass_keeps_its_velocity_through_a_step_of_the_law():
    forcing = sinusoid(8.0, A, 0.3, 1, start=0.1)
    q, step = 1.003 / 1.178, A * 2 * math.pi * 8.0 * math.cos(0.3)
    for edge, sign in ((0.1, 1.0), (forcing.stop, -1.0)):
        t = np.array([edge - 1e-12, edge])  # right-continuous
        jump = hard_jump(**THESIS, forcing=forcing, t=t, t_end=1.0)
        y_rate = jump.rod_velocity + q * forcing(t)[1]
        assert abs(y_rate[1] - y_rate[0]) < 1e-10  # 1e-12 s of accelerations below 100 m/s^2
        assert abs(jump.rod_velocity[1] - jump.rod_velocity[0] + sign * q * step) < 1e-10
        assert abs(jump.rod[1] - jump.rod[0]) < 1e-11
    before = hard_jump(**THESIS, forcing=forcing, t=[0.0, 0.09], t_end=1.0)
    np.testing.assert_allclose(before.rod, -1.178 * THESIS["gravity"] / 5760.6, rtol=1e-14)
    np.testing.assert_allclose(before.ground_force, 1.178 * THESIS["gravity"], rtol=1e-14)
    assert np.all(before.rod_velocity == 0.0) and np.all(before.motor == before.rod)


@pytest.mark.parametrize(
    "law", [sinusoid(8.2, A, np.pi / 2), sinusoid(3.1, 2 * A, 0.7, 2), delayed(9.0, A, 1.9, 0.03)], ids=str
)
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


def test_bounces_lose_what_the_landing_and_the_damper_take():
    law = sinusoid(17.0, A, 3 * np.pi / 2)
    # without damping the spring returns all: each free flight is sqrt(1 - e) times as long as the one before
    robot = THESIS | {"damping": 0.0, "landing_loss": 0.33}
    jump = hard_jump(**robot, forcing=law, t=None, t_end=20.0)
    free = (jump.landing - jump.lift_off)[jump.lift_off > law.stop]
    n = np.flatnonzero(free > 1e-3)[-1]
    assert n > 10
    # a rounding of 1e-18 m at a contact of speed u = g t/2 > 1e-3 m/s shifts it by 1e-15 s
    np.testing.assert_allclose(free[1 : n + 1] / free[:n], math.sqrt(0.67), rtol=1e-10)
    # almost without gravity the half cycle of the damped spring keeps exp(-pi zeta / sqrt(1 - zeta^2)) = 0.974 of the
    # speed, up to g / (w0 v) = 1e-7, the weight against the spring force
    jump = hard_jump(**THESIS | {"gravity": 1e-6}, forcing=law, t=None, t_end=4e6)
    free = (jump.landing - jump.lift_off)[jump.lift_off > law.stop]
    zeta = 1.368 / (2 * math.sqrt(5760.6 * 1.178))
    np.testing.assert_allclose(free[1:3] / free[:2], math.exp(-math.pi * zeta / math.sqrt(1 - zeta**2)), rtol=1e-6)


def test_bounces_below_grazing_speed_are_not_counted():
    # geometric bounces u_n = u_0 (1 - e)^(n/2) never end; those that leave and land below 1e-6 m/s are not counted
    robot = THESIS | {"damping": 0.0, "landing_loss": 0.5}
    law = sinusoid(17.0, A, 3 * np.pi / 2)
    short, long = (hard_jump(**robot, forcing=law, t=None, t_end=t_end) for t_end in (10.0, 60.0))
    free = short.lift_off > law.stop
    u0 = 0.5 * robot["gravity"] * (short.landing - short.lift_off)[free][0]
    assert len(short.lift_off) == len(long.lift_off)  # it does end, and time goes on
    assert free.sum() == 1 + math.floor(2 * math.log2(u0 / 1e-6))


def test_a_step_stays_below_the_third_derivative_and_before_the_first_root():
    # the two facts on which it rests that no contact is missed
    rng, kinds = np.random.default_rng(6), set()
    for i in range(2000):
        w0, q = 10 ** rng.uniform(0, 2), rng.uniform(0.5, 1.0)
        gam = w0 * rng.choice([0.0, 1e-5, 0.01, 0.5, 1.0, 4.0])
        om = w0 * (1.0 + rng.choice([0.0, 1e-6, 1e-4]) if i % 4 == 0 else rng.uniform(0.1, 3.0))
        cubic = rng.normal(size=4) * (i % 3 == 0) * [1, w0, w0**2, w0**3]
        piece = np.array([0.0, 10 / w0, *cubic, 10 ** rng.uniform(-2, 1), om, rng.uniform(0, 6)])
        tau, state = rng.uniform(0, 9 / w0), (rng.normal(), w0 * rng.normal())
        g = rng.uniform(0.1, 1) * w0**2
        turn = sincos(piece[7] * tau + piece[8])
        arc = make_arc(i % 5 > 0, piece, tau, 10 / w0 - tau, turn, *state, q, g, w0**2, gam)
        kinds.add(arc[KIND])
        s = np.linspace(0, 10 / w0 - tau, 300)
        _, v, a, _, _, _, motor_jerk = np.array([evaluate(arc, r, q, g) for r in s]).T
        jerk = -q * motor_jerk - 2 * arc[GAMMA] * a - arc[W2] * v  # the equation of motion, differentiated
        assert np.max(np.abs(jerk)) <= arc[JERK] * (1 + 1e-9)
    assert len(kinds) == 4
    for i in range(5000):
        f, f1, f2, j = (
            -(10 ** rng.uniform(-9, 0)),
            *rng.normal(size=2) * 10 ** rng.uniform(-2, 1, 2),
            10 ** rng.uniform(-2, 1),
        )
        if i % 2:  # a hump that only j lifts above zero: its height is below zero by less than j h1^3 / 6
            f1, f2 = abs(f1), -abs(f2)
            h1 = f1 / -f2
            f = -(h1 * f1 / 2 + rng.uniform(0, 1.5) * j * h1**3 / 6)
        roots = np.roots([j / 6, f2 / 2, f1, f])
        first = np.min(roots[(np.abs(roots.imag) < 1e-9) & (roots.real > 0)].real)
        cap = first * 10 ** rng.uniform(-1, 1.5)
        # np.roots itself is right to about 1e-7 where two roots all but meet
        assert safe_step(f, f1, f2, j, cap) == pytest.approx(min(first, cap), rel=1e-5)


def test_sine_and_cosine_are_right_to_rounding():
    rng = np.random.default_rng(9)
    quarters = np.arange(-200, 200) * np.pi / 4  # where the polynomials change over
    x = np.r_[rng.uniform(-30, 30, 20000), 10 ** rng.uniform(-9, 9, 20000), quarters, quarters + 1e-9, 1e6 - 0.5]
    got = np.array([sincos(v) for v in x]).T
    # an ulp below 1 is 1.1e-16: ours may err by 0.8 of it, numpy's by as much
    np.testing.assert_allclose(got, [np.sin(x), np.cos(x)], rtol=0, atol=1.8e-16)


def test_a_jump_is_the_same_alone_and_beside_others():
    # near resonance, over-damped, with a phase of many turns and as usual
    rng = np.random.default_rng(12)
    n = 90
    mass, w0 = 10 ** rng.uniform(-1, 1, n), 10 ** rng.uniform(0.5, 2, n)
    robots = {
        "motor_mass": mass,
        "rod_mass": mass * rng.uniform(0.05, 0.5, n),
        "stiffness": 1.3 * mass * w0**2,
        "damping": 2 * 1.3 * mass * w0 * rng.choice([0.0, 1e-5, 0.01, 1.0, 2.0], n),
        "gravity": rng.uniform(1, 10, n),
        "landing_loss": rng.choice([0.0, 0.3], n),
    }
    f = np.sqrt(robots["stiffness"] / (robots["motor_mass"] + robots["rod_mass"])) / (2 * np.pi)
    f *= np.where(rng.random(n) < 0.2, 1.0, rng.uniform(0.3, 2.0, n))
    amplitude = robots["gravity"] / (2 * np.pi * f) ** 2 * 10 ** rng.uniform(-0.5, 1, n)
    phase = rng.uniform(0, 6, n) + np.where(rng.random(n) < 0.1, 1e6, 0.0)
    laws = sine_rows(f, amplitude, phase, rng.choice([0.5, 1.0, 3.0], n))
    both = hard_sweep(laws, **robots)
    for i in range(n):
        alone = hard_sweep(laws[i : i + 1], **{name: v[i : i + 1] for name, v in robots.items()})
        for name, v in alone.items():
            np.testing.assert_array_equal(v[0], both[name][i], err_msg=name)


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


def test_peaks_are_the_greatest_of_a_dense_sampling():
    for robot, law in draws(300, seed=5):
        f, amp, ph, cycles = law
        t = np.linspace(0, cycles / f * (1 - 1e-14), 3001)  # to just before the law stops
        jump = hard_jump(**robot, forcing=sinusoid(*law), t=t, t_end=cycles / f + 1.0)
        w, mass = 2 * np.pi * f, robot["motor_mass"] + robot["rod_mass"]
        accel = -amp * w * w * np.sin(w * t + ph)
        force = robot["motor_mass"] / mass * (jump.spring_force + robot["rod_mass"] * accel)  # F_m = m_m (a_m + g)
        power = force * amp * w * np.cos(w * t + ph)
        # never below the samples (to rounding of large cancelling terms); above by (w_max dt)^2 / 8 of the scale, with
        # w_max = w0 + w <= 8 w and dt = cycles / (3000 f): 3e-4 (3e-3 is ample), or by a damper's step at touchdown
        for peak, values in ((jump.peak_force_N, force), (jump.peak_power_W, power)):
            assert peak >= np.max(values) - 1e-11 * np.ptp(values)
        smooth = robot["damping"] == 0.0
        assert not smooth or jump.peak_force_N <= np.max(force) + 3e-3 * np.ptp(force)
        assert not smooth or jump.peak_power_W <= np.max(power) + 3e-3 * np.ptp(power)


def test_the_sign_of_x_is_the_mode_everywhere():
    for robot, law in draws(150, seed=8):
        t_end = law[3] / law[0] + 1.0
        t = np.linspace(0, t_end, 401)
        jump = hard_jump(**robot, forcing=sinusoid(*law), t=t, t_end=t_end)
        air = np.zeros(401, bool)
        for lift, land in zip(jump.lift_off, np.nan_to_num(jump.landing, nan=np.inf)):
            air |= (t > lift) & (t < land)
        assert np.all(jump.rod[air] > 0) and np.all(jump.rod[~air] <= 0)
        assert np.all(jump.spring_force[air] == 0)


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


def test_map_is_the_jumps_it_is_made_of():
    # hard_jump is checked above; the map stops by its own rule, so its numbers must be those of a long jump
    f, ph = np.array([2.5, 4.0, 8.2, 12.0, 17.0]), np.linspace(0.1, 6.2, 7)
    result = hard_map(f, ph, amplitude=A, cycles=1, **THESIS)
    assert result["n_jumps"].shape == (5, 7) and result["n_jumps"].dtype == np.int64
    for i, j in np.ndindex(5, 7):
        jump = hard_jump(**THESIS, forcing=sinusoid(f[i], A, ph[j]), t=None, t_end=5.0)
        want = [jump.com_height, jump.flight_height, jump.jump_height, jump.n_jumps]
        want += [np.append(jump.lift_off, np.nan)[0], jump.peak_power_W, jump.peak_force_N, jump.peak_motor_speed]
        np.testing.assert_allclose([v[i, j] for v in result.values()], want, rtol=1e-12, atol=1e-15)
    laws = np.stack([delayed(8.0, A, np.pi / 2, d, start=0.2).rows for d in (0.01, 0.05)])
    swept = hard_sweep(laws[:, None], **THESIS | {"rod_mass": np.array([0.1, 0.2, 0.3])})
    assert swept["com_height_m"].shape == (2, 3)
    alone = hard_jump(**THESIS | {"rod_mass": 0.2}, forcing=Segments(laws[1]), t=None, t_end=5.0)
    np.testing.assert_allclose(swept["com_height_m"][1, 1], alone.com_height, rtol=1e-13)
    np.testing.assert_allclose(swept["lift_off_s"][1, 1], alone.lift_off[0] - 0.2, rtol=1e-13)


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


BAD = [("motor_mass", -1.0), ("rod_mass", -0.1), ("stiffness", 0.0), ("damping", -1.0), ("gravity", 0.0)]

NAN = [(name, math.nan) for name in (*THESIS, "amplitude", "cycles")]


@pytest.mark.parametrize(
    ("name", "value"),
    [*BAD, ("landing_loss", 1.0), ("amplitude", 0.0), ("amplitude", -A), ("cycles", 0), *NAN],
)
def test_a_bad_parameter_is_named_with_its_range(name, value):
    good = {"amplitude": A, "cycles": 1} | THESIS
    with pytest.raises(ValueError, match=rf"^{name} = .* must be (>|in)") as error:
        hard_map([8.0], [1.0], **good | {name: value})
    assert str(float(value)) in str(error.value)
    if name in THESIS:
        with pytest.raises(ValueError, match=f"^{name} = "):
            hard_jump(**THESIS | {name: value}, forcing=sinusoid(8.0, A, 1.0), t=None, t_end=1.0)


@pytest.mark.parametrize(
    ("name", "f", "phase"),
    [("frequency", 0.0, 1.0), ("frequency", -8.0, 1.0), ("frequency", math.nan, 1.0), ("phase", 8.0, math.inf)],
)
def test_a_bad_axis_of_a_map_is_named(name, f, phase):
    bad = f if name == "frequency" else phase
    with pytest.raises(ValueError, match=rf"^{name} = {bad} must be (> 0 Hz|a finite number rad)"):
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
