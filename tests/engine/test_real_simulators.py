"""Simulators of others as they are: where MuJoCo, FMPy and SciPy behave otherwise than one remembers."""

from __future__ import annotations

import builtins
import itertools
import math
import sys

import numpy as np
import pytest
import scipy.optimize

import jumpvision as jv
from jumpvision.base.schema import InputError
from jumpvision.engine.simulators.fmu import _times_with_jumps
from jumpvision.engine.simulators.values import step_means
from jumpvision.estimate.estimate import least_squares_fit

T = np.arange(0.0, 1.0, 0.01)
FREE = """<mujoco><option timestep="2e-3" integrator="RK4" gravity="0 0 0"/><worldbody><body name="cart">
<joint name="x" type="slide" axis="1 0 0"/><geom name="block" size="0.05" mass="2.0"/></body></worldbody>
<actuator><motor name="pull" joint="x" {actuator}/></actuator>
<sensor><jointpos name="place" joint="x" {sensor}/><jointvel name="speed" joint="x"/></sensor></mujoco>"""
LATE = {"actuator": 'delay="0.05" nsample="26"', "sensor": 'delay="0.0305" nsample="17"'}


def recording(t=T, **inputs):
    return jv.Recording("one", t, np.zeros(t.size), inputs=inputs)


def free(channels, actuator="", sensor="", **given):
    pytest.importorskip("mujoco")
    return jv.from_mujoco(FREE.format(actuator=actuator, sensor=sensor), channels, **given)


# ------------------------------------------------------------------------------------------------------------ MuJoCo
@pytest.mark.surprise(
    package="mujoco",
    version="4.0.0",
    behaviour="a delay counts samples: with steps shorter than the XML's timestep, `nsample` of them are a shorter "
    "delay, and what is delayed begins at zero",
    here="shifts the drives' times and reads sensors later, whatever the step; before the start both are constant",
)
@pytest.mark.parametrize("rate", [100.0, 333.0, 1000.0])
def test_a_delay_is_as_long_at_every_rate(rate):
    """x = F t^2 / 2m from 0.05 s on; its sensor 30.5 ms later, by a straight line between steps: h^2 / 8 F / m off."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(FREE.format(**LATE))
    data = mujoco.MjData(model)
    model.opt.timestep, data.ctrl[0] = 4e-4, 3.0
    while data.qvel[0] == 0.0:
        mujoco.mj_step(model, data)
    assert data.time < 0.02  # MuJoCo's own: 26 samples
    t = np.arange(0.0, 0.5, 1.0 / rate)
    run = free({"x": "joint.x.qpos", "read": "sensor.place"}, **LATE, drive={"actuator.pull.ctrl": "force"})
    found = run({}, recording(t, force=(np.array([-1.0, 0.0, 0.0, 9.0]), np.array([0.0, 0.0, 3.0, 3.0]))))

    def place(t):
        return 0.75 * np.maximum(t - 0.05, 0.0) ** 2

    assert np.allclose(found["x"], place(t), atol=1e-9)
    assert np.allclose(found["read"], place(t - 0.0305), atol=1.5 * 2e-3**2 / 8 + 1e-9)


@pytest.mark.surprise(
    package="mujoco",
    version="4.0.0",
    behaviour="an actuator's exact lag (`filterexact`, `<position timeconst>`) makes RK4 first order",
    here="integrates the lag of such an actuator by RK4 as all else",
)
def test_an_exact_lag_keeps_the_order_of_rk4():
    """2 x'' = a, tau a' = 3 - a: errors of RK4 are of order (h / tau)^4 = 2.6e-6 of x; MuJoCo's own are h / tau."""
    tau = 0.05
    lag = FREE.replace("<motor", '<general dyntype="filterexact" dynprm="0.05"')
    run = jv.from_mujoco(
        lag.format(actuator="", sensor=""), {"x": "joint.x.qpos"}, drive={"actuator.pull.ctrl": "force"}
    )
    x = 1.5 * (T**2 / 2 - tau * T + tau**2 * (1.0 - np.exp(-T / tau)))
    assert np.allclose(run({}, recording(force=3.0))["x"], x, atol=2.6e-6 * x[-1])


def test_what_is_delayed_was_before_the_start_what_it_is_then():
    """At rest at 0.3 m: the sensor reads 0.3 from the first sample on, and the motor has its constant force."""
    run = free({"read": "sensor.place"}, sensor=LATE["sensor"], start={"joint.x.qpos": "x0"})
    assert np.array_equal(run({}, recording(x0=0.3))["read"], np.full(T.size, 0.3))
    run = free({"x": "joint.x.qpos"}, actuator=LATE["actuator"], drive={"actuator.pull.ctrl": "force"})
    assert np.allclose(run({}, recording(force=3.0))["x"], 0.75 * T**2, atol=1e-9)


def test_a_delay_may_be_a_parameter():
    run = free(
        {"x": "joint.x.qpos"}, **LATE, drive={"actuator.pull.ctrl": "force"}, model={"actuator.pull.delay": "late"}
    )
    step = (np.array([-1.0, 0.0, 0.0, 9.0]), np.array([0.0, 0.0, 3.0, 3.0]))
    for late in (0.0, 1e-4, 0.123):
        assert np.allclose(
            run({"late": late}, recording(force=step))["x"], 0.75 * np.maximum(T - late, 0.0) ** 2, atol=1e-9
        )
    with pytest.raises(InputError, match=r"has a delay of 0.05 s; a law acts at once"):
        free({"x": "joint.x.qpos"}, **LATE, law=("actuator.pull.ctrl", {"v": "joint.x.qvel"}))(
            {}, recording(), lambda v: -v
        )


def test_a_sensor_with_a_period_holds_what_it_read():
    run = free({"read": "sensor.place"}, sensor='interval="0.05" nsample="1"', start={"joint.x.qvel": "v"})
    read = run({}, recording(v=1.0))["read"]
    assert np.allclose(read, 0.05 * np.floor(T / 0.05 + 1e-6), atol=2e-3 + 1e-9)  # one step late at most
    assert np.unique(read.round(9)).size == 20


def test_a_drive_that_jumps_is_exact():
    """A force held for 30 ms and put off for 30 ms, by rows of equal times between the samples: x by hand."""
    held = np.repeat([1.0, -2.0, 3.0, 0.5, -1.0, 2.0, 0.0] * 5, 2)
    edges = 0.0303 * np.arange(held.size // 2 + 1)
    force = (np.repeat(edges, 2)[1:-1], held)
    v = x = 0.0
    exact = []
    for t0, t1, f in zip(edges, edges[1:], held[::2]):
        exact += [(t, x + v * (t - t0) + f / 4.0 * (t - t0) ** 2) for t in T[np.clip(T, t0, t1 - 1e-9) == T]]
        x, v = x + v * (t1 - t0) + f / 4.0 * (t1 - t0) ** 2, v + f / 2.0 * (t1 - t0)
    run = free({"x": "joint.x.qpos"}, drive={"actuator.pull.ctrl": "force"})
    assert np.allclose(run({}, recording(force=force))["x"], [x for _, x in exact], atol=1e-8)


@pytest.mark.surprise(
    package="mujoco",
    version="4.0.0",
    behaviour="RK4 does not compute sensors anew in its stages: what is made of one within a step is of first order",
    here="refuses a sensor among the symbols of a law, and names the state to be read instead",
)
def test_a_law_reads_the_state_and_no_sensor():
    """Damping by 1.5 / s of the speed from the state: RK4's 1e-10; from the sensor, as a callback may: above 1e-4."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(FREE.format(actuator="", sensor=""))
    off = {}
    for source in ("state", "sensor"):
        data = mujoco.MjData(model)
        data.qvel[0] = 1.0

        def damp(_, now, source=source):
            now.qfrc_applied[0] = -3.0 * (now.qvel[0] if source == "state" else now.sensordata[1])

        mujoco.set_mjcb_control(damp)
        try:
            for _ in range(500):
                mujoco.mj_step(model, data)
        finally:
            mujoco.set_mjcb_control(None)
        off[source] = abs(data.qvel[0] - math.exp(-1.5))
    assert off["state"] < 1e-10 and off["sensor"] > 1e-4
    with pytest.raises(InputError, match=r"'sensor.speed': a law reads the state, as joint.NAME.qvel"):
        free({"x": "joint.x.qpos"}, law=("joint.x.qfrc_applied", {"v": "sensor.speed"}))


# ---------------------------------------------------------------------------------------------------------------- FMU
UNIT = '''
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real


class Unit(Fmi2Slave):
    """x' = n gear u, exactly for an input that is held over a step."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.n, self.gear, self.u, self.x = 1, 1, 0.0, 0.0
        self.register_variable(Integer("n", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))
        self.register_variable(Integer("gear", causality=Fmi2Causality.input, variability=Fmi2Variability.discrete))
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Real("x", causality=Fmi2Causality.output))

    def do_step(self, current_time, h):
        self.x += self.n * self.gear * self.u * h
        return True
'''


@pytest.fixture(scope="module")
def unit(tmp_path_factory):
    pytest.importorskip("fmpy")
    builder = pytest.importorskip("pythonfmu.builder")
    folder = tmp_path_factory.mktemp("fmu")
    (folder / "unit.py").write_text(UNIT)
    return builder.FmuBuilder.build_FMU(folder / "unit.py", dest=folder)


@pytest.mark.surprise(
    package="FMPy",
    version="0.3.32",
    behaviour="a unit for co-simulation holds its input over a step: driven by u = t, x' = u is .45 at 1 s "
    "by steps of .1",
    here="gives each step the mean of its drive: .50; two rows of one time are a jump",
)
def test_a_driven_unit_does_not_lag(unit):
    import fmpy

    t = np.linspace(0.0, 1.0, 11)
    given = np.array([*zip(t, t)], [("time", float), ("u", float)])
    plain = fmpy.simulate_fmu(str(unit), stop_time=1.0, output_interval=0.1, input=given, output=["x"])
    assert plain["x"][-1] == pytest.approx(0.45)
    run = jv.from_fmu(unit, {"x": "x"}, drive={"u": "drive"})
    assert np.allclose(run({}, recording(t, drive=t))["x"], t * t / 2.0, atol=1e-12)
    jump = (np.array([0.0, 0.33, 0.33, 1.0]), np.array([0.0, 0.0, 2.0, 2.0]))
    assert run({}, recording(t, drive=jump))["x"][4:] == pytest.approx(2.0 * (t[4:] - 0.33), abs=1e-12)
    with pytest.raises(InputError, match="times that do not go back"):
        run({}, recording(t, drive=(np.array([0.0, 0.5, 0.4]), np.zeros(3))))


def test_a_switch_keeps_its_last_value(unit):
    """An Integer input of one value a time is held until the next, not drawn straight to it; a half is refused."""
    run = jv.from_fmu(unit, {"x": "x"}, drive={"u": "drive", "gear": "gear"})
    gear = np.repeat([1.0, 3.0, 2.0, 0.0], 25)
    found = run({}, recording(drive=2.0, gear=gear))["x"]
    assert np.allclose(found, np.concatenate([[0.0], np.cumsum(0.02 * gear)])[:-1], atol=1e-12)
    with pytest.raises(InputError, match=r"gear is of type Integer: 'gear' must be a whole number"):
        run({}, recording(drive=2.0, gear=0.5 * gear))


def test_the_mean_of_a_step_is_the_integral():
    """Against a sum over 20,000 points, of a series with jumps that ends within the steps."""
    rng = np.random.default_rng(3)
    t = np.sort(rng.uniform(0.1, 0.9, 12))
    t[5], t[9] = t[4], t[8]
    x, ends = rng.standard_normal(12), np.linspace(0.0, 1.0, 8)
    fine = (np.arange(20_000) + 0.5) / 20_000
    whole = [np.interp(a + (b - a) * fine, t, x).mean() for a, b in itertools.pairwise(ends)]
    assert np.allclose(
        step_means(t, x, ends), whole, atol=6.0 / 20_000
    )  # a jump of less than 6 falls between two points


def test_a_jump_is_two_times_with_jumps_for_a_unit_that_integrates_by_itself():
    """As FMPy reads them: before the event the first, after it the second."""
    simulation = pytest.importorskip("fmpy.simulation")
    t, x = np.array([0.0, 0.5, 0.5, 1.0]), np.array([1.0, 1.0, 3.0, 3.0])
    every = _times_with_jumps([t, np.array([0.0, 1.0])])
    assert every.tolist() == [0.0, 0.5, 0.5, 1.0]
    for time, after, value in ((0.499999, False, 1.0), (0.5, False, 1.0), (0.5, True, 3.0), (0.75, False, 3.0)):
        assert simulation.Input.interpolate(time, every, x[None], after_event=after)[0] == pytest.approx(value)


@pytest.mark.surprise(
    package="FMPy",
    version="0.3.32",
    behaviour="cuts 2.6 for an Integer down to 2 without a word, raises a bare Exception for the start of an output, "
    "and leaves out a drive of what is no input",
    here="refuses each by its name, the last two before anything runs",
)
def test_what_a_unit_cannot_be_given_is_refused_by_name(unit):
    import fmpy

    cut = fmpy.simulate_fmu(str(unit), stop_time=0.1, start_values={"n": 2.6, "u": 1.0}, output=["n"])
    assert cut["n"][-1] == 2
    with pytest.raises(Exception, match="could not be set"):
        fmpy.simulate_fmu(str(unit), stop_time=0.1, start_values={"x": 1.0})
    with pytest.raises(InputError, match=r"n is of type Integer: 'count' must be a whole number"):
        jv.from_fmu(unit, {"x": "x"}, model={"n": "count"})({}, recording(count=2.6))
    assert jv.from_fmu(unit, {"x": "x"}, model={"n": "count"}, drive={"u": "force"})(
        {}, recording(count=2.0, force=1.0)
    )["x"] == pytest.approx(2.0 * T)
    with pytest.raises(InputError, match=r"model: x \(output\) takes no value at the start"):
        jv.from_fmu(unit, {"x": "x"}, model={"x": "x0"})
    with pytest.raises(InputError, match=r"drive: x \(output\) is no input"):
        jv.from_fmu(unit, {"x": "x"}, drive={"x": "force"})
    with pytest.raises(InputError, match="no variable 'z'"):
        jv.from_fmu(unit, {"x": "z"})


# ----------------------------------------------------------------------------------------------------------- packages
@pytest.mark.surprise(
    package="mujoco",
    version="4.0.0",
    behaviour="`pip install -U mujoco` from 3.17 leaves an import that fails with its own remedy; `pip check` is "
    "content",
    here="says how to install only what is not there; any other ImportError passes with its own words",
)
def test_an_import_that_fails_says_so_itself(monkeypatch):
    real = builtins.__import__

    def broken(name, *rest, **more):
        if name == "mujoco":
            raise error
        return real(name, *rest, **more)

    monkeypatch.delitem(sys.modules, "mujoco", raising=False)
    monkeypatch.setattr(builtins, "__import__", broken)
    for error in (ImportError("reinstall mujoco"), ModuleNotFoundError("No module named 'lz4'", name="lz4")):
        with pytest.raises(ImportError, match=str(error)):
            jv.from_mujoco("<mujoco/>", {})
    error = ModuleNotFoundError("No module named 'mujoco'", name="mujoco")
    with pytest.raises(InputError, match=r"pip install 'jumpvision\[mujoco\]'"):
        jv.from_mujoco("<mujoco/>", {})


# -------------------------------------------------------------------------------------------------------------- SciPy
@pytest.mark.surprise(
    package="scipy",
    version="1.17.1",
    behaviour="`least_squares` from a start of 1e-9, or of 0 on a bound, returns the start and success",
    here="fits the change from the start in units of the parameter's scale",
)
@pytest.mark.parametrize("start", [0.0, 1e-12, 1e-9, -1e-9, 1e-3, 1.0])
@pytest.mark.parametrize("slopes", [False, True])
def test_a_fit_leaves_a_small_start(start, slopes):
    """A line through the origin with slope 0.5, sigma 0.01: found to the solver's 1e-8, whatever the start."""
    t = np.linspace(0.0, 1.0, 50)

    def residual(p):
        return (0.5 * t - p[0] * t) / 0.01

    if start == 1e-9:
        plain = scipy.optimize.least_squares(residual, [start], method="trf")
        assert plain.success and plain.x[0] < 1e-8
    p, covariance, chi2 = least_squares_fit(
        residual, [start], scale=0.1, jacobian=(lambda p: -t[:, None] / 0.01) if slopes else None
    )
    assert p[0] == pytest.approx(0.5, abs=1e-6) and chi2 < 1e-6
    assert math.sqrt(covariance[0, 0]) == pytest.approx(0.01 / math.sqrt(t @ t), rel=1e-6)
