"""Sweeps and the named analyses of chapter II: rules of the axes, files, and the numbers of docs/physics.md section 7.

Truth: hard_jump and jump.simulate (tested elsewhere) for maps, energy balances for powers, the amplitude asked for of
the start-up ringing, column RK4 of docs/physics.md for the numbers. About 30 s on two cores, most of it the analyses.
"""

import functools
import itertools
import json
import math
import os
import re
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from conftest import later
from scipy.integrate import solve_ivp

from jumpvision.base.schema import InputError
from jumpvision.cli import main
from jumpvision.jumper.physics.batch import hard_points, resolve, simulated_points
from jumpvision.jumper.physics.energy import powers
from jumpvision.jumper.physics.forcing import Segments, delayed, sinusoid
from jumpvision.jumper.physics.hard.analysis import crossing, easiest_frequency, half_cycle_rows
from jumpvision.jumper.physics.hard.hopper import apexes, cycles_in_a_row, distinct, ringing_rows, scattered
from jumpvision.jumper.physics.hard.jump import HardRobot, hard_jump, hard_sweep, sine_rows
from jumpvision.jumper.physics.hard.loop import LoopGains, easiest_looped, looped_amplitude
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.oscillator import best_jump
from jumpvision.jumper.physics.sand.jump import simulate
from jumpvision.report.style import styled
from jumpvision.thesis.figures.sweeps import picture, sweep_figure
from jumpvision.thesis.studies.animals import HUMAN, SHIPPED
from jumpvision.thesis.studies.axes import AXES, read_axes
from jumpvision.thesis.studies.compute import RESULTS, write
from jumpvision.thesis.studies.setup import setup_of
from jumpvision.thesis.studies.study import Call, run, studies
from jumpvision.thesis.studies.thresholds import SEARCH, catapult

THESIS = {
    "motor_mass": 1.003,
    "rod_mass": 0.175,
    "stiffness": 5760.6,
    "damping": 1.368,
    "gravity": 0.276 * 9.81,
    "landing_loss": 0.0,
}
THESIS_ROBOT = HardRobot(**THESIS)
A = 4e-3
F0 = math.sqrt(5760.6 / 1.178) / (2 * math.pi)
HARD = setup_of("hard", None, {})
SAND = setup_of("granular", None, {})


@functools.cache
def study(name, ground="hard", **axes):
    """Data set and table rows of an analysis of the thesis' robot."""
    return run(Call(ground, axes, name, say=lambda text: None))


# -- axes ------------------------------------------------------------------------------------------------------------
def test_an_axis_is_a_value_or_equal_steps():
    axes = read_axes("hard", {"frequency": "4:12:5", "phase": "-1.5", "delay": "0"})
    np.testing.assert_array_equal(axes["frequency"], [4.0, 6.0, 8.0, 10.0, 12.0])
    assert axes["phase"].shape == () and axes["phase"] == -1.5 and axes["delay"] == 0.0
    assert list(axes) == ["frequency", "phase", "delay"]


@pytest.mark.parametrize(
    "name, text, words",
    [
        ("frequency", "0:5:10", "0 must be > 0 Hz"),
        ("frequency", "5:4:10", "LO < HI"),
        ("frequency", "4:5:1", "2 <= N"),
        ("frequency", "4:5:2.5", "whole number N"),
        ("frequency", "4:5", "one value or LO:HI:N"),
        ("frequency", "fast", "one value or LO:HI:N"),
        ("frequency", "nan", "nan must be > 0 Hz"),
        ("amplitude", "-0.001", "must be > 0 m"),
        ("zeta", "-0.1", "must be >= 0"),
        ("phase", "inf", "must be a finite number in rad"),
        ("phi", "0.6", "no meaning on hard ground"),
    ],
)
def test_a_bad_axis_is_named_with_value_range_and_remedy(name, text, words):
    with pytest.raises(InputError) as error:
        read_axes("hard", {name: text})
    assert f"--{name} {text}" in str(error.value) and words in str(error.value)


def test_every_problem_is_told_at_once_and_huge_sweeps_are_refused():
    with pytest.raises(InputError) as error:
        read_axes("granular", {"phi": "0.1", "rod_mass": "x", "zeta": "-1"})
    assert len(error.value.problems) == 3 and "--rod-mass x" in str(error.value)
    with pytest.raises(InputError, match="at most"):
        read_axes("hard", {"frequency": "1:2:100000", "phase": "0:1:100000"})


def test_rules_between_axes():
    mass, k, g = 1.178, 5760.6, THESIS["gravity"]
    v = resolve(HARD.values, {"alpha": 0.2})
    assert v["amplitude"] == pytest.approx(mass * g / (k * 0.2), rel=1e-14) and v["gravity"] == g
    v = resolve(HARD.values, {"alpha": 0.2, "amplitude": 0.01})
    assert v["gravity"] == pytest.approx(0.2 * k * 0.01 / mass, rel=1e-14) and v["amplitude"] == 0.01
    v = resolve(HARD.values, {"rod_mass": np.array([0.1, 0.4])})
    np.testing.assert_allclose(v["motor_mass"] + v["rod_mass"], mass, rtol=1e-14)
    v = resolve(HARD.values, {"rod_mass": 0.4, "motor_mass": 2.0, "zeta": 0.1})
    assert v["damping"] == pytest.approx(0.2 * math.sqrt(k * 2.4), rel=1e-14)
    for given, words in (
        ({"alpha": 0.1, "amplitude": 0.01, "gravity": 5.0}, "leave one out"),
        ({"rod_mass": 1.2}, "below the total mass"),
    ):
        with pytest.raises(ValueError, match=words):
            resolve(HARD.values, given)
    with pytest.raises(ValueError, match="cycles = 2"):
        hard_points(resolve(HARD.values, {"cycles": 2.0, "delay": 0.1}))


def test_half_cycles_are_the_laws_known_otherwise():
    rows = half_cycle_rows(8.0, 8.0, A, 1.3, np.array([0.0, 0.05]))
    t = np.linspace(-0.01, 0.2, 501)
    for one, law in zip(rows, (sinusoid(8.0, A, 1.3), delayed(8.0, A, 1.3, 0.05))):
        for got, want in zip(Segments(one)(t), law(t)):
            np.testing.assert_allclose(got, want, rtol=0, atol=1e-13)  # rounding of A omega
    # two frequencies: A (cos - 1) down in half a period of the first, up in half a period of the second
    x, v = Segments(half_cycle_rows(5.0, 20.0, A, math.pi / 2, 0.0))(np.array([0.1, 0.1125, 0.125]))
    np.testing.assert_allclose(x, [-2 * A, -A, 0.0], atol=1e-15)
    assert v[1] == pytest.approx(A * 2 * math.pi * 20.0, rel=1e-12)
    for bad in ({"frequency2": 0.0}, {"delay": -1.0}, {"amplitude": -A}, {"frequency": math.nan}):
        good = {"frequency": 8.0, "frequency2": 8.0, "amplitude": A, "phase": 0.0, "delay": 0.0}
        with pytest.raises(ValueError, match=f"^{next(iter(bad))} = "):
            half_cycle_rows(**(good | bad))


# -- points and files ------------------------------------------------------------------------------------------------
def contract(folder):
    """contract_check.py on a folder of results."""
    script = os.environ.get("JUMPVISION_CONTRACT_CHECK")
    if not script:
        pytest.skip("JUMPVISION_CONTRACT_CHECK does not name contract_check.py")
    done = subprocess.run([sys.executable, script, str(folder)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_map_point_is_a_single_jump(tmp_path):
    data, rows = study("map", frequency="5:15:3", phase="0.4:5:4", alpha="0.1:0.4:2", zeta="0.05")
    assert data.com_height_m.dims == ("frequency", "phase", "alpha") and data.com_height_m.shape == (3, 4, 2)
    assert data.zeta.ndim == 0 and rows
    for i, j, k in np.ndindex(3, 4, 2):
        f, phase, alpha = (float(data[n][m]) for n, m in zip(data.com_height_m.dims, (i, j, k)))
        amp = 1.178 * THESIS["gravity"] / (5760.6 * alpha)
        robot = THESIS | {"damping": 0.1 * math.sqrt(5760.6 * 1.178)}
        jump = hard_jump(**robot, forcing=sinusoid(f, amp, phase), t=None, t_end=8.0)
        one = data.isel(frequency=i, phase=j, alpha=k)
        for name, want in (
            ("com_height_m", jump.com_height), ("flight_height_m", jump.flight_height),
            ("jump_height_m", jump.jump_height), ("n_jumps", jump.n_jumps), ("peak_power_W", jump.peak_power_W),
            ("lift_off_s", np.append(jump.lift_off, np.nan)[0]), ("peak_force_N", jump.peak_force_N),
        ):  # fmt: skip
            assert float(one[name]) == pytest.approx(want, rel=1e-11, abs=1e-14, nan_ok=True), name
        assert int(one.jump_class) == min(jump.n_jumps, 3)
    write(data, tmp_path)
    with xr.open_dataset(tmp_path / "sweep.nc") as read:
        xr.testing.assert_identical(read.load(), data)
        assert all("units" in read[v].attrs for v in (*RESULTS, "frequency", "phase", "alpha"))
        assert read.attrs["robot"] == "thesis robot, hard ground"
        assert json.loads(read.attrs["constants"])["stiffness"] == 5760.6
        assert "jumpvision" in json.loads(read.attrs["versions"])
    assert [f.name for f in tmp_path.iterdir()] == ["sweep.nc"]  # nothing left over
    contract(tmp_path)


@pytest.mark.long
def test_the_integrated_path_agrees_with_the_exact_one():
    given = {"frequency": np.array([6.0, 8.2, 13.0, 17.0]), "phase": np.array([1.2, 1.57, 3.3, 4.7]), "zeta": 0.02}
    v = {n: np.broadcast_to(a, (4,)) for n, a in resolve(HARD.values, given).items()}
    exact = hard_points(v)
    found = simulated_points(HARD.model, v, rtol=1e-9, atol=1e-12)
    for name, (unit, _) in RESULTS.items():
        # peaks are those of 400 samples: (2 pi / 400)^2 / 8 = 3e-5 for F, twice the curvature for P; the rest follows
        # the integrator's tolerance
        bound = 4e-4 if name.startswith("peak") else 1e-6
        np.testing.assert_allclose(found[name], exact[name], rtol=bound, atol=1e-9, err_msg=f"{name} [{unit}]")


def test_a_granular_point_is_a_simulated_jump():
    data, _ = study("map", ground="granular", frequency="5:9:2", phase="1.5708:4.7124:2", delay="0:0.1:2")
    assert data.com_height_m.dims == ("frequency", "phase", "delay")
    one = data.isel(frequency=1, phase=1, delay=1)
    law = delayed(9.0, 0.01875, 4.7124, 0.1)
    t = np.linspace(0.0, law.stop + 0.6, 200001)
    motion = simulate(SAND.model, law, t=t, rtol=1e-7, atol=1e-10)
    assert float(one.jump_height_m) == pytest.approx(motion.jump_height, abs=2e-6)  # rtol 1e-6 of the sweep
    assert float(one.com_height_m) == pytest.approx(motion.com_height, abs=2e-6)
    assert float(one.flight_height_m) == pytest.approx(motion.flight_height, abs=1e-5)
    # force and power from the motor's own track: second differences, away from the law's corners and the impacts
    dt, x = t[1] - t[0], motion.motor
    force = 1.125 * ((x[2:] - 2 * x[1:-1] + x[:-2]) / dt**2 + 9.81)
    corners = np.concatenate([law.rows[:, 0], [law.stop], motion.events["time"]])
    clear = (np.min(np.abs(t[1:-1, None] - corners), axis=1) > 2 * dt) & (t[1:-1] < law.stop)
    power = force * law(t[1:-1])[1]
    assert float(one.peak_force_N) == pytest.approx(force[clear].max(), rel=2e-3)  # 400 samples of a law with corners
    assert float(one.peak_power_W) == pytest.approx(power[clear].max(), rel=2e-3)


def test_the_table_is_of_the_jumps_that_were_asked_for():
    data, rows = study("map", frequency="6:10:5", phase="1:2:3", amplitude="0.002")
    assert (
        len(rows) == 1
        and rows[0]["thesis"] == ""
        and f"{float(data.com_height_m.max()) * 1e3:.2f} mm" in rows[0]["ours"]
    )


def test_the_bed_on_an_axis():
    wide, _ = study("map", ground="granular", foot_radius="0.03:0.05:3", phase="4.7124", frequency="9")
    assert (np.diff(wide.jump_height_m) > 0).all()  # a wider foot sinks less
    loose, _ = study("map", ground="granular", phi="0.55:0.63:2", phase="4.7124", frequency="9")
    same, _ = study("map", ground="granular", phi="0.57", phase="4.7124", frequency="9")
    plain, _ = study("map", ground="granular", phase="4.7124", frequency="9")
    assert float(same.jump_height_m) == float(plain.jump_height_m)
    assert float(loose.jump_height_m[0]) < float(same.jump_height_m) < float(loose.jump_height_m[1])


# -- the parts -------------------------------------------------------------------------------------------------------
def test_the_best_of_two_parameters_is_found_in_every_box():
    peak = np.array([[0.3, 1.7], [-0.2, 2.2]])

    def hill(at):
        return {"h": -((at[0] - peak[:, :1]) ** 2) - 3 * (at[1] - peak[:, 1:]) ** 2, "x": at[0]}

    low, high = np.array([[-1.0, 1.0]] * 2), np.array([[1.0, 3.0]] * 2)
    at, best = best_jump(hill, low, high, points=9, rounds=4, key="h")
    np.testing.assert_allclose(at, peak, atol=2.0 * (2 / 8) ** 4 / 8)  # the width of the last cell
    np.testing.assert_array_equal(best["x"], at[:, 0])
    alpha = np.array([0.1, 0.2, 0.4, 0.8])
    assert crossing(alpha, [0.5, 1.5, 2.0, 0.5], rising=True) == pytest.approx(math.sqrt(0.02))
    assert np.isnan(crossing(alpha, [2.0, 1.5, 1.2, 1.1], rising=False))


@pytest.mark.parametrize("phase", [math.pi / 2, 2.5])
def test_powers_do_the_work_that_the_energies_say(phase):
    law, t_end = sinusoid(8.2, A, phase), 0.3
    flights = hard_jump(**THESIS, forcing=law, t=None, t_end=t_end)
    edges = np.unique(np.r_[0.0, law.stop, flights.lift_off, flights.landing[np.isfinite(flights.landing)], t_end])
    work = np.zeros(3)
    heat = motor = 0.0
    for lo, hi in itertools.pairwise(edges):
        t = np.linspace(lo + 1e-12, hi - 1e-12, 20001)
        m = hard_jump(**THESIS, forcing=law, t=t, t_end=t_end)
        p = powers(m, law, motor_mass=1.003, rod_mass=0.175, gravity=THESIS["gravity"])
        names = ("internal_power", "external_power", "absolute_power")
        work += [np.trapezoid(p[n], t) for n in names]
        motor += np.trapezoid(1.003 * THESIS["gravity"] * p["motor_velocity"], t)
        heat += np.trapezoid(1.368 * m.rod_velocity**2 * (m.spring_force != 0), t)
    m = hard_jump(**THESIS, forcing=law, t=[-1.0, t_end], t_end=t_end)
    p = powers(m, law, motor_mass=1.003, rod_mass=0.175, gravity=THESIS["gravity"])
    y = m.rod + 1.003 / 1.178 * (m.motor - m.rod)
    kinetic = 0.5 * 1.178 * p["com_velocity"][1] ** 2
    spring = 0.5 * 5760.6 * np.minimum(m.rod, 0.0) ** 2
    # trapezium rule: (w dt)^2 / 12 < 1e-6 of the work
    gained = kinetic + 1.178 * THESIS["gravity"] * (y[1] - y[0]) + spring[1] - spring[0]
    assert work[0] + sum(m.impulse_work_J) - heat == pytest.approx(gained, rel=1e-5)
    assert work[1] == pytest.approx(kinetic, rel=1e-5)  # impulses are internal: v_com does not step
    if phase == math.pi / 2:  # no impulses on the motor either
        assert work[2] - motor == pytest.approx(0.5 * 1.003 * p["motor_velocity"][1] ** 2, rel=1e-5)


def test_start_up_ringing_has_the_amplitude_asked_for():
    robot = THESIS | {"damping": 0.0}
    pause = 0.3 / F0
    rows = ringing_rows(sine_rows(8.0, A, 1.0, 1.0), 2e-5, pause, share=1.003 / 1.178, f0=F0)
    law = Segments(rows)
    t = np.array([law.rows[2, 0] - 1e-9])
    m = hard_jump(**robot, forcing=law, t=t, t_end=2.0)
    away = m.rod[0] + 1.178 * THESIS["gravity"] / 5760.6
    assert math.hypot(away, m.rod_velocity[0] / (2 * math.pi * F0)) == pytest.approx(2e-5, rel=1e-6)
    assert law.rows[2, 1] - law.rows[2, 0] == pytest.approx(1 / 8.0, rel=1e-12)


def test_scatter_is_proportional_to_the_ringing_and_absent_without():
    f, phase = np.array([8.2, 12.0]), np.array([1.6, 4.7])
    given = {"robot": HardRobot(**THESIS), "amplitude": A, "cycles": 1.0}

    def spread(ringing):
        rng = np.random.default_rng(5)
        jumps = scattered(f, phase, ringing=ringing, trials=40, rng=rng, **given)
        assert np.all(jumps["lift_off_s"] > 0)
        return jumps["com_height_m"].std(axis=2)

    small, large = spread(1e-7), spread(2e-7)
    np.testing.assert_allclose(large, 2 * small, rtol=0.02)  # the same draws; curvature ~ 1e-7 / 1e-5 of the slope
    exact = hard_sweep(sine_rows(f[:, None], A, phase, 1.0), **THESIS)["com_height_m"]
    still = scattered(f, phase, ringing=1e-15, trials=2, rng=np.random.default_rng(1), **given)["com_height_m"]
    np.testing.assert_allclose(still, np.repeat(exact[..., None], 2, axis=2), rtol=0, atol=1e-11)


def test_apexes_are_those_of_the_sampled_motion():
    robot, f = THESIS | {"landing_loss": 0.33}, np.array([9.0, 9.5])
    found, count = apexes(f, robot=HardRobot(**robot), amplitude=1e-3, settle=20, keep=6)
    law = cycles_in_a_row(f, amplitude=1e-3, cycles=26)
    t = np.linspace(law.rows[1, 0] + 20 / 9.5, law.stop, 400001)
    m = hard_jump(**robot, forcing=law, t=t, t_end=law.stop)
    y = m.rod + 1.003 / 1.178 * (m.motor - m.rod) + 1.178 * robot["gravity"] / 5760.6
    starts = m.lift_off[(m.lift_off >= t[0]) & (m.lift_off < law.stop)][-6:]
    ends = m.landing[np.isin(m.lift_off, starts)]
    assert count[1] == len(starts) > 2
    for apex, lo, hi in zip(found[1], starts, ends):
        if np.isfinite(hi):
            inside = y[(t >= lo) & (t <= hi)]
            assert apex == pytest.approx(inside.max(), abs=1e-9)  # g dt^2 / 8 with dt = 1.6 us, and the first sample
    heights = np.array([[1.0, 1.0 + 1e-9, 2.0, np.nan], [np.nan] * 4])
    np.testing.assert_array_equal(distinct(heights, tolerance=1e-6), [2, 0])
    with pytest.raises(ValueError, match="cycles = 0"):
        cycles_in_a_row(f, amplitude=1e-3, cycles=0)


# -- the named analyses ----------------------------------------------------------------------------------------------
SMALL = {  # fewer points where the defaults are for a figure
    "lift-off-time": {"frequency": "8:14.5:27", "amplitude": "0.00002:0.0006:20"},
    "scatter": {"frequency": "2.5:12:12", "phase": "0:6:9"},
    "bifurcation": {"frequency": "4.5:24:60", "amplitude": "0.0006:0.0014:3"},
    "two-frequency": {"alpha": "0.06:1.1:6"},
    "height-amplitude": {"amplitude": "0.001:0.008:8"},
}


ALL = [n for n, s in studies("hard").items() if not s.of_campaign]
LONG = ("lift-off-time", "alpha", "minimum-amplitude", "traces", "animals")


@pytest.mark.parametrize("name", [n for n in ALL if n not in LONG] + later(*LONG))
def test_every_analysis_gives_a_file_a_figure_and_numbers(name, tmp_path):
    data, rows = study(name, **SMALL.get(name, {}))
    assert rows and all(set(r) == {"quantity", "thesis", "RK4", "ours"} and r["ours"] for r in rows)
    assert all("units" in v.attrs for v in data.data_vars.values())
    write(data, tmp_path)
    assert picture(data).startswith(b"\x89PNG")
    contract(tmp_path)


def test_the_best_frequency_rises_with_amplitude_for_the_single_and_falls_for_the_stutter():
    """Fig 32(a, b), and at 4 mm the RK4 optima of the sheet (0.7375 and 1.54 f_0) to a step of the axis, 0.02 f_0."""
    data, _ = study("height-amplitude", **SMALL["height-amplitude"])
    best = data.best_frequency_Hz / data.attrs["f0_Hz"]
    assert (best.sel(jump="single").diff("amplitude") >= 0).all()
    assert (best.sel(jump="stutter").diff("amplitude") <= 0).all()
    np.testing.assert_allclose(best.sel(amplitude=0.004, method="nearest"), [0.7375, 1.54], atol=0.02)
    # where a jump is at its best it lifts off: above the white line
    for kind in ("stutter", "single"):
        least = np.interp(
            data.best_frequency_Hz.sel(jump=kind), data.frequency, data.minimum_amplitude_m.sel(jump=kind)
        )
        assert (least < data.amplitude).all()


def test_a_catapult_is_the_damped_oscillator_let_go():
    """scipy on M x'' = -M g - k e - c e' until the spring is relaxed; without damping k d^2/(2 M g) + M g/(2 k)."""
    for damping, travel in ((0.0, 0.008), (1.368, 0.008), (30.0, 0.02)):
        robot = HardRobot(1.003, 0.175, 5760.6, damping, 2.7)
        relaxed = robot.mass * robot.gravity / robot.stiffness

        def slope(t, s, robot=robot):
            return s[1], -(robot.stiffness * s[0] + robot.damping * s[1]) / robot.mass

        def leaves(t, s, relaxed=relaxed):
            return s[0] - relaxed

        leaves.terminal, leaves.direction = True, 1
        way = solve_ivp(slope, (0.0, 1.0), (-travel, 0.0), events=leaves, rtol=1e-10, atol=1e-13)
        height = relaxed + way.y[1, -1] ** 2 / (2 * robot.gravity)
        shot = catapult(robot, travel)
        assert shot.height_m == pytest.approx(height, rel=1e-7)
        assert shot.catch_force_N == pytest.approx(robot.stiffness * travel + robot.mass * robot.gravity)
        if not damping:
            energy = robot.stiffness * travel**2 / (2 * robot.mass * robot.gravity) + relaxed / 2
            assert shot.height_m == pytest.approx(energy, rel=1e-9)
    assert np.isnan(catapult(robot, 1e-4).height_m)


def test_less_power_never_jumps_higher_and_the_limits_hold():
    """At the highest limit the sheet's RK4: 41.0 and 38.1 mm, single / stutter peak power 1.52 where both are best."""
    data, rows = study("power-limit")
    height = data.com_height_m.fillna(0.0)
    assert (height.diff("power") >= 0).all() and (data.peak_power_W.fillna(0.0) <= data.power).all()
    np.testing.assert_allclose(1e3 * height.isel(power=-1), [41.0, 38.1], atol=0.06)
    # between two frequencies too: of the single the full stroke, once that lifts off, of the stutter never less
    amplitude = 1e3 * data.amplitude_m
    assert (amplitude.sel(jump="single")[data.power > 0.35] > 4.0 * 0.999).all()
    assert (amplitude.sel(jump="stutter").diff("power") > -4e-3).all()
    best = [float(x) for x in rows[0]["ours"].split(",")]
    assert best[1] / best[0] == pytest.approx(1.52, abs=0.006)


@pytest.mark.long
def test_a_power_with_which_none_lifts_off_has_no_best_jump():
    data, _ = study("power-limit", amplitude="0.002")
    lowest = data.isel(power=0)
    assert np.isnan(lowest.com_height_m).any() and np.isfinite(data.com_height_m.isel(power=-1)).all()


def ours(name, quantity):
    """The numbers of a row of the table."""
    rows = [r["ours"] for r in study(name, **SMALL.get(name, {}))[1] if r["quantity"].startswith(quantity)]
    assert len(rows) == 1, quantity
    return [float(w.strip("(),;%")) for w in rows[0].split() if w.strip("(),;%").replace(".", "").isdigit()]


@pytest.mark.parametrize(
    "name, quantity, rk4, tolerance",
    [  # docs/physics.md section 7, column RK4, to half its last digit, or to the step of its sweep where it names one
        ("map", "stutter (pi/2): best f/f_0", [0.7375, 8.21], 0.0125),
        ("map", "single (3 pi/2): best f/f_0", [1.54, 1.39, 1.71], 0.006),
        ("map", "best COM heights", [41.0, 38.1], 0.06),
        ("map", "single / stutter peak power", [1.52, 1.31], 0.006),
        ("map", "single / stutter peak motor speed", [2.09, 1.79], 0.006),
        ("map", "stutter / single peak force", [1.33], 0.005),
        ("minimum-amplitude", "f_opt/f_0 of A_min, N = 1, phase 0.5 pi", [0.74, 1.19], 0.005),
        ("alpha", "alpha where stutter height passes", [0.12, 0.108], 0.0007),
        ("alpha", "alpha where stutter power passes", [0.276], 0.0005),
        ("alpha", "stutter height/power above", [0.69], 0.005),
        # printed 1.18, 1.20 and 1.20 are nodes of a grid of 0.02 f_0; the maxima are at 1.191, 1.204, 1.194
        ("alpha", "f_opt/f_0 at alpha 0.9", [1.18, 1.20, 1.20], 0.0115),
        ("estimates", "argmax of eq. (13)", [1.194], 0.0005),
        ("animals", "human: stutter, single", [2.1, 5.2], 0.05),
    ],
)
def test_numbers_of_the_thesis_robot(name, quantity, rk4, tolerance):
    found = ours(name, quantity)
    assert len(found) == len(rk4)
    np.testing.assert_allclose(found, rk4, rtol=0, atol=tolerance)


@pytest.mark.long
def test_resonance_is_approached_from_above_whatever_the_damping():
    data, _ = study("lift-off-time", **SMALL["lift-off-time"])
    ratio = data.easiest_frequency_ratio
    assert float(abs(ratio.sel(cut_off=100) - 1).max()) < 2e-4 and (ratio.sel(cut_off=[20, 50, 100]) >= 1).all()
    # inertial forcing peaks at f_0/sqrt(1 - 2 zeta^2); from zeta = 0.15 on an overshoot of the first cycles
    # lifts the robot before the steady response does, so the law holds below, to 2e-3 at zeta = 0.1
    assert (data.easiest_ratio_damped >= 1).all()
    off = (data.easiest_ratio_damped - data.inertial_peak_ratio).sel(damping_ratio=slice(0.0, 0.1))
    assert float(abs(off).max()) < 2e-3


def by_small_steps(kp, kd, f, cycles, dt=2e-4):
    """Highest x [m] of each lane (n,) within its cycles for A = 1 m, by Runge and Kutta of the two bodies."""
    r = THESIS_ROBOT
    w, m_r, m_m = 2.0 * np.pi * f, r.rod_mass, r.motor_mass

    def rates(t, y):
        x, v, motor, rate = y  # of the motor: X_m
        asked = np.cos(w * t) - 1.0  # phase pi/2
        force = kp * (asked - motor) + kd * (-w * np.sin(w * t) - rate)
        a = (-force - r.stiffness * x - r.damping * v) / m_r
        return np.array([v, a, rate, force / m_m - a])

    y, most = np.zeros((4, f.size)), np.zeros(f.size)
    for i in range(int(cycles / f.min() / dt)):
        t = i * dt
        a = rates(t, y)
        b = rates(t + dt / 2, y + dt / 2 * a)
        c = rates(t + dt / 2, y + dt / 2 * b)
        d = rates(t + dt, y + dt * c)
        y = y + dt / 6 * (a + 2 * b + 2 * c + d)
        most = np.where(t + dt <= cycles / f, np.maximum(most, y[0]), most)
    return most


def test_the_stiffness_of_the_motors_loop_puts_the_easiest_frequency_below_the_natural_one():
    """f_100 = 0.960, 0.980, 0.990 f_0 at kp 5e4, 1e5, 2e5 N/m (docs/hard_ground.md), by an integrator of its own."""
    ratio = np.arange(0.94, 1.011, 0.005)
    stiff = np.repeat([5e4, 1e5, 2e5], ratio.size)
    most = by_small_steps(stiff, 120.0, np.tile(ratio, 3) * THESIS_ROBOT.f0, 100).reshape(3, -1)
    for kp, curve, sheet in zip((5e4, 1e5, 2e5), most, (0.960, 0.980, 0.990)):
        best = ratio[np.argmax(curve)]
        assert best == pytest.approx(sheet, abs=0.003)  # half its step
        loop = LoopGains(kp, 120.0)
        f, least = easiest_looped(0.5 * np.pi, robot=THESIS_ROBOT, loop=loop, cycles=100.0, search=SEARCH)
        assert f == pytest.approx(sheet, abs=2e-3)
        sag = THESIS_ROBOT.mass * THESIS_ROBOT.gravity / THESIS_ROBOT.stiffness
        every = looped_amplitude(ratio * THESIS_ROBOT.f0, 0.5 * np.pi, robot=THESIS_ROBOT, loop=loop, cycles=100.0)
        np.testing.assert_allclose(every, sag / curve, rtol=2e-3)  # 450 steps a cycle: the top is missed by 2.5e-5
        assert least <= every.min() * (1 + 1e-6)


def test_a_stiff_loop_is_a_motor_that_is_where_the_law_says():
    for cycles in (1.0, 5.0):
        given = {"robot": THESIS_ROBOT, "cycles": cycles, "search": SEARCH}
        held = easiest_looped(1.5 * np.pi, loop=LoopGains(1e9, 3e4), **given)
        stiff = easiest_frequency(1.5 * np.pi, largest=2e-3, resolution=2e-11, **given)
        assert held == pytest.approx(stiff, rel=1e-3)


@pytest.mark.long
def test_lift_off_takes_more_cycles_at_smaller_amplitudes():
    data, _ = study("lift-off-time", **SMALL["lift-off-time"])
    cycles = data.lift_off_cycles.fillna(np.inf).values
    assert (np.diff(np.where(np.isinf(cycles), 1e9, cycles), axis=2) <= 1e-9).all()
    assert np.nanmax(data.lift_off_cycles) > 5


def test_the_best_phases_stay_and_two_frequencies_always_win():
    data, rows = study("alpha")
    assert sum(r["ours"].startswith("at 18 of 18") for r in rows) == 2
    closed = data.region_low_by_zeta.sel(damping_ratio=slice(0.15, None))
    assert np.isnan(closed).all() and np.isfinite(data.region_low_by_zeta.sel(damping_ratio=slice(0, 0.14))).all()
    pair, _ = study("two-frequency", **SMALL["two-frequency"])
    best = pair.com_height_m
    assert (best.sel(jump="two frequencies") >= best.sel(jump=["stutter", "single"]).max("jump") * (1 - 1e-6)).all()
    one = pair.sel(jump="two frequencies")
    low = one.alpha < 0.85
    assert (one.frequency_ratio < pair.frequency_ratio.sel(jump="stutter")).where(low, True).all()
    assert (one.frequency2_ratio > pair.frequency_ratio.sel(jump="single")).where(low, True).all()


def test_the_driven_hopper_remembers_where_it_came_from():
    data, _ = study("bifurcation", **SMALL["bifurcation"])
    up, down = data.distinct_apexes.values
    slow = data.frequency_ratio.values < 0.6
    assert (up[slow] == 0).all() and (down[slow] == 1).all()  # at rest going up, one apex every cycle going down
    assert max(up.max(), down.max()) > 20 and (up == 2).any()  # chaos, and a doubled period


# -- the command -----------------------------------------------------------------------------------------------------
def test_the_command(tmp_path, capsys):
    law = ["--frequency", "6:10:4", "--phase", "1:5:3", "--results", str(tmp_path), "--json"]
    assert main(["sweep", "hard", *law]) == 0
    said = json.loads(capsys.readouterr().out)
    assert [os.path.basename(f) for f in said["files"]] == ["sweep.nc", "sweep.png"]
    assert all(os.path.exists(f) for f in said["files"]) and said["numbers"]
    contract(tmp_path)


@pytest.mark.parametrize(
    "words, told",
    [
        (["hrad"], "did you mean 'hard'"),
        (["hard", "--analysis", "alfa"], "did you mean 'alpha'"),
        (["granular", "--analysis", "alpha"], "of hard ground"),
        (["hard", "--analysis", "alpha", "--frequency", "1:2:3"], "takes a range of --alpha"),
        (["hard", "--analysis", "animals", "--delay", "0.1"], "does not use it"),
        (["hard", "--frequency", "5:1:3"], "LO < HI"),
        (["hard", "--rod-mass", "3"], "below the total mass"),
        (["hard", "--set", "robot.colour=1"], "unknown key"),
        (["granular", "--set", "model.terms=[\"two_resistance\"]", "--phi", "0.6"], "has no effect"),
        (["hard", "--experiment", "nowhere"], "does not exist"),
        (["hard", "--analysis", "alpha", "--table", "x.csv"], "--table x.csv: is for --analysis animals"),
    ],
)  # fmt: skip
def test_a_bad_call_is_told_and_writes_nothing(words, told, tmp_path, capsys):
    assert main(["sweep", *words, "--results", str(tmp_path / "out")]) == 2
    assert told in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_animals_of_a_table_stand_beside_the_simulated_ones(tmp_path):
    """Lengths in mm or m; an animal that jumps as the human model does is 1 of it, within the line's own step."""
    table = tmp_path / "animals.csv"
    table.write_text('# mine\nanimal,length [mm],height [m],source\nhopper,6,0.7,"Nature 424, 509"\nme,1800,5.25,\n')
    data, rows = run(Call("hard", {}, "animals", table=table))
    assert list(data.animal.values) == ["hopper", "me"]
    assert data.animal_length_m.values == pytest.approx([0.006, 1.8])
    assert float(data.share_of_simulated.sel(jump="single", animal="me")) == pytest.approx(1.0, abs=0.02)
    assert any(r["quantity"] == "hopper: height" and "117 body lengths" in r["ours"] for r in rows)
    assert picture(data).startswith(b"\x89PNG")
    for text, told in (
        ("animal,length,height [m]\na,1,1\n", "column length: unit '' must be one of m, cm, mm"),
        ("animal,length [m],height [m]\na,1,-1\n", "column height, row 1: must be > 0"),
        ("length [m],height [m]\n1,1\n", "column animal: missing"),
    ):
        table.write_text(text)
        with pytest.raises(InputError, match=re.escape(told)):
            run(Call("hard", {}, "animals", table=table))


def test_every_animal_that_is_shipped_has_its_source_and_the_height_that_is_told():
    """Without a height its own (v sin(angle))^2/2g, at most v^2/2g, of a distance a quarter, to the digits written."""
    table = pd.read_csv(SHIPPED, comment="#")
    assert (table.kind == "animal").sum() >= 40 and table.animal.is_unique and table.source.str.len().min() > 20
    for row in table[~table.told.str.startswith("height")].itertuples():
        up = row.take_off_m_s * (math.sin(math.radians(row.angle_deg)) if np.isfinite(row.angle_deg) else 1.0)
        height = row.distance_m / 4 if row.told.startswith("distance") else up**2 / (2 * 9.81)
        assert row._4 == pytest.approx(height, abs=6e-5), row.animal
    data, rows = study("animals")
    assert data.animal_height_m.values == pytest.approx(table["height [m]"].to_numpy())
    assert any(r["quantity"] == "animals between stutter and single" and r["ours"] == "36 of 44" for r in rows)


def test_the_number_of_an_animal_stands_beside_its_mark_alone():
    """As drawn: on no mark, no curve and no other number; each name stands below."""
    from matplotlib.text import Annotation

    data, _ = study("animals")
    with styled() as Figure:
        figure = sweep_figure(data, Figure)
        figure.draw_without_rendering()
        axis = figure.axes[0]
        numbers = [a for a in axis.texts if isinstance(a, Annotation)]
        boxes = [a.get_window_extent() for a in numbers]
        lines = np.concatenate([axis.transData.transform(line.get_xydata()) for line in axis.lines])
    assert len(numbers) == data.sizes["animal"]
    for k, box in enumerate(boxes):
        assert not any(box.contains(*p) for p in lines), numbers[k].get_text()
        assert not any(box.overlaps(b) for b in boxes[:k]), numbers[k].get_text()
    said = "\n".join(t.get_text() for sub in figure.subfigs for t in sub.texts)
    assert all(f"{k} {name}" in said for k, name in enumerate(data.animal.values, start=1))


@pytest.mark.parametrize("k", [10, 60])
def test_an_animal_jumps_as_its_own_mass_spring_and_stroke_do(k):
    """Mass as length^3, stiffness and stroke as length (thesis eq. 14): the results of the study, scaled from one
    dimensionless jump, are those of the animal itself in SI units, to the rounding of a jump."""
    data, _ = study("animals")
    share, zeta = (float(data.attrs[n]) for n in ("rod_share", "zeta"))
    length = float(data.length[k])
    size = length / HUMAN["length"]
    mass, stiffness, stroke = HUMAN["mass"] * size**3, HUMAN["stiffness"] * size, HUMAN["amplitude"] * size
    for i, phase in enumerate((math.pi / 2, 3 * math.pi / 2)):
        f = float(data.frequency_ratio[i, k]) * math.sqrt(stiffness / mass) / (2 * math.pi)
        own = hard_sweep(
            sine_rows(f, stroke, phase, 1.0), motor_mass=mass * (1 - share), rod_mass=mass * share, stiffness=stiffness,
            damping=2 * zeta * math.sqrt(stiffness * mass), gravity=9.81, landing_loss=0.0,
        )  # fmt: skip
        for name in RESULTS:
            assert float(data[name][i, k]) == pytest.approx(float(own[name]), rel=1e-6), name
        assert float(data.relative_height[i, k]) == pytest.approx(float(own["com_height_m"]) / length, rel=1e-6)


def test_power_over_k_a2_w0_is_a_pure_number():
    """The best jump at an alpha, made again by itself: its peak power over k A^2 w_0, w_0 = sqrt(k/M) in rad/s."""
    data, _ = study("alpha", alpha="0.1:0.4:3")
    for i, phase in enumerate((math.pi / 2, 3 * math.pi / 2)):
        stroke, f = float(data.amplitude_m[i, 1]), float(data.frequency_ratio[i, 1]) * F0
        own = hard_sweep(sine_rows(f, stroke, phase, 1.0), **THESIS)["peak_power_W"]
        scale = 5760.6 * stroke**2 * math.sqrt(5760.6 / 1.178)
        assert float(data.power_scaled[i, 1]) == pytest.approx(float(own) / scale, rel=1e-6)


def test_an_experiment_gives_robot_law_and_model(tmp_path):
    (tmp_path / "experiment.toml").write_text(
        'ground = "hard"\n[robot]\nmotor_mass = 2.0\nrod_mass = 0.3\nspring_stiffness = 8000.0\nspring_damping = 2.0\n'
        'gravity = 5.0\n[actuation]\nkind = "single"\nfrequency = 12.0\namplitude = 0.006\n'
        '[model]\nterms = ["landing_loss", "payload"]\ne = 0.3\ndm = 0.1\n'
    )
    data, _ = run(Call("hard", {"amplitude": "0.005:0.007:3"}, experiment=tmp_path / "experiment.toml"))
    robot = {
        "motor_mass": 2.1,
        "rod_mass": 0.3,
        "stiffness": 8000.0,
        "damping": 2.0,
        "gravity": 5.0,
        "landing_loss": 0.3,
    }
    jump = hard_jump(**robot, forcing=sinusoid(12.0, 0.006, 1.5 * math.pi), t=None, t_end=3.0)
    assert float(data.com_height_m[1]) == pytest.approx(jump.com_height, rel=1e-12)
    with pytest.raises(InputError, match="its ground is 'hard'"):
        setup_of("granular", tmp_path, {})


def test_every_axis_moves_the_jump():
    """Each axis changes a result, so none is silently ignored."""
    for ground, base in (("hard", HARD), ("granular", SAND)):
        for name, axis in AXES.items():
            if ground not in axis.grounds or name == "apex":  # a plan moves by it, not a jump
                continue
            starts = {"alpha": 0.14, "zeta": 0.01, "delay": 0.0, "phi": 0.57, "dwell_gain": 0.5}
            start = starts.get(name, base.values.get(name, 1.0))
            given = {name: np.array([start, start * 1.05 + (0.02 if name == "delay" else 0.0)])}
            pause = {"delay": np.array([0.1])} if name == "dwell_gain" else {}  # where it holds
            v = {n: np.broadcast_to(a, (2,)) for n, a in resolve(base.values, given | pause).items()}
            found = hard_points(v) if base.exact else simulated_points(base.model, v, rtol=1e-7, atol=1e-10)
            moved = "jump_height_m" if name == "cycles" else "com_height_m"  # the robot is in the air after one
            assert abs(np.diff(found[moved])[0]) > 1e-9, (ground, name)
    assert isinstance(SAND.model, Model)
