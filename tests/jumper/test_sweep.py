"""Maps of jumps over any axes: rules of the axes, files, robots.

Truth: hard_jump and jump.simulate (tested elsewhere) for maps, energy balances for powers.
"""

import itertools
import json
import math
import os
import re
import subprocess
import sys

import numpy as np
import pytest
import xarray as xr
from shared import ROOT

import jumpvision as jv
from jumpvision.base.schema import InputError
from jumpvision.cli import main
from jumpvision.experiment.inputs.sections import Robot
from jumpvision.jumper.physics.batch import hard_points, resolve, simulated_points
from jumpvision.jumper.physics.energy import powers
from jumpvision.jumper.physics.forcing import Segments, delayed, sinusoid
from jumpvision.jumper.physics.hard.jump import half_cycle_rows, hard_jump
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand.jump import simulate
from jumpvision.sweeps.axes import AXES, read_axes
from jumpvision.sweeps.robot import setup_of
from jumpvision.sweeps.sweep import RESULTS, sweep, write

THESIS = {
    "motor_mass": 1.003, "rod_mass": 0.175, "stiffness": 5760.6, "damping": 1.368, "gravity": 0.276 * 9.81,
    "landing_loss": 0.0,
}  # fmt: skip
A = 4e-3
HARD = setup_of("hard", None, {})
SAND = setup_of("granular", None, {})


def swept(ground="hard", **axes):
    """The map of the thesis' robot over axes as typed."""
    return sweep(ground, axes, say=lambda text: None)


# -- axes ------------------------------------------------------------------------------------------------------------
def test_an_axis_is_a_value_equal_steps_or_an_array():
    axes = read_axes("hard", {"frequency": "4:12:5", "phase": [1.0, 2.0, 5.0], "delay": "0", "alpha": np.float64(0.2)})
    np.testing.assert_array_equal(axes["frequency"], [4.0, 6.0, 8.0, 10.0, 12.0])
    np.testing.assert_array_equal(read_axes("hard", {"frequency": (4, 12, 5)})["frequency"], axes["frequency"])
    np.testing.assert_array_equal(axes["phase"], [1.0, 2.0, 5.0])
    assert axes["alpha"].shape == axes["delay"].shape == () and axes["delay"] == 0.0
    assert list(axes) == ["frequency", "phase", "delay", "alpha"]


@pytest.mark.parametrize(
    "name, given, words",
    [
        ("frequency", "0:5:10", "--frequency 0:5:10: 0 must be > 0 Hz"),
        ("frequency", "5:4:10", "LO < HI"),
        ("frequency", "4:5:2.5", "whole number N"),
        ("frequency", "fast", "one value or LO:HI:N"),
        ("frequency", (4, 12), "one value or LO:HI:N"),
        ("frequency", np.ones((2, 2)), "an array (n,)"),
        ("frequency", [4.0, -1.0], "-1 must be > 0 Hz"),
        ("frequenzy", 1.0, "did you mean 'frequency'"),
        ("phase", "inf", "must be a finite number in rad"),
        ("phi", "0.6", "no meaning on hard ground"),
    ],
)
def test_a_bad_axis_is_named_with_value_range_and_remedy(name, given, words):
    with pytest.raises(InputError, match=re.escape(words)):
        read_axes("hard", {name: given})


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
    data = swept(frequency="5:15:3", phase="0.4:5:4", alpha="0.1:0.4:2", zeta="0.05")
    assert data.com_height_m.dims == ("frequency", "phase", "alpha") and data.com_height_m.shape == (3, 4, 2)
    assert data.zeta.ndim == 0
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


def test_a_granular_point_is_a_simulated_jump():
    data = swept(ground="granular", frequency="5:9:2", phase="1.5708:4.7124:2", delay="0:0.1:2")
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


# -- the parts -------------------------------------------------------------------------------------------------------
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


# -- the command -----------------------------------------------------------------------------------------------------
EXAMPLE = str(ROOT / "pipelines" / "thesis" / "example_laws.toml")


@pytest.mark.parametrize(
    "words",
    [["hard", "--frequency", "6:10:4", "--phase", "1:5:3"],
     ["granular", "--laws", EXAMPLE, "--phi", "0.58:0.62:3", "--frequency", "8", "--phase", "4.712", "--workers", "1"]],
)  # fmt: skip
def test_the_command(words, tmp_path, capsys):
    assert main(["sweep", *words, "--results", str(tmp_path), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert [os.path.basename(f) for f in said["files"]] == ["sweep.nc", "sweep.png"]
    assert all(os.path.exists(f) for f in said["files"]) and said["numbers"]
    contract(tmp_path)


def test_a_bad_call_is_told_and_writes_nothing(tmp_path, capsys):
    for words, told in (
        (["hrad"], "did you mean 'hard'"),
        (["hard", "--alfa", "1:2:3"], "--alpha"),
        (["hard", "--rod-mass", "3"], "below the total mass"),
        (["hard", "--set", "robot.colour=1"], "unknown key"),
        (["granular", "--set", 'model.terms=["two_resistance"]', "--phi", "0.6"], "has no effect"),
        (["hard", "--laws", EXAMPLE], "no meaning on hard ground"),
        (["granular", "--model", "nowhere.toml"], "cannot be read"),
        (["granular", "--laws", EXAMPLE, "--phi", "0.5:0.6:3"], "outside 0.57 to 0.63"),
    ):
        assert main(["sweep", *words, "--results", str(tmp_path / "out")]) == 2
        assert told in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_an_experiment_gives_robot_law_and_model(tmp_path):
    (tmp_path / "experiment.toml").write_text(
        'ground = "hard"\n[robot]\nmotor_mass = 2.0\nrod_mass = 0.3\nspring_stiffness = 8000.0\nspring_damping = 2.0\n'
        'gravity = 5.0\n[actuation]\nkind = "single"\nfrequency = 12.0\namplitude = 0.006\n'
        '[model]\nterms = ["landing_loss", "payload"]\ne = 0.3\ndm = 0.1\n'
    )
    data = sweep("hard", {"amplitude": "0.005:0.007:3"}, experiment=tmp_path / "experiment.toml")
    robot = dict(zip(THESIS, (2.1, 0.3, 8000.0, 2.0, 5.0, 0.3)))
    jump = hard_jump(**robot, forcing=sinusoid(12.0, 0.006, 1.5 * math.pi), t=None, t_end=3.0)
    assert float(data.com_height_m[1]) == pytest.approx(jump.com_height, rel=1e-12)
    values = {"motor_mass": 2.1, "rod_mass": 0.3, "spring_stiffness": 8000.0, "spring_damping": 2.0, "gravity": 5.0}
    law, model = {"frequency": 12.0, "phase": 1.5 * math.pi, "amplitude": 0.006}, {"terms": ("landing_loss",), "e": 0.3}
    for given in (values, Robot(**values)):
        same = jv.sweep("hard", robot=given, model=model, **law)
        assert float(same.com_height_m) == pytest.approx(jump.com_height, rel=1e-12)
    with pytest.raises(InputError, match="its ground is 'hard'"):
        setup_of("granular", tmp_path, {})


def test_every_axis_moves_the_jump():
    """Each axis changes a result, so none is silently ignored."""
    for ground, base in (("hard", HARD), ("granular", SAND)):
        for name, axis in AXES.items():
            if ground not in axis.grounds:
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
