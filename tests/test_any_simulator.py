"""Any simulator in question: truth by scipy's DOP853, the study's own integrator another; errors; processes; files."""

from __future__ import annotations

import json
import math
import multiprocessing
import os
import pickle
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numba import njit
from scipy.integrate import solve_ivp

import jumpvision as jv
from jumpvision.base.schema import InputError
from jumpvision.cli import main
from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.engine.study.runs import SimulatorError
from jumpvision.engine.study.walk import as_walk
from jumpvision.report.pages.study import page, search_rows
from tests.worlds import axis
from tests.worlds.axis import cause

T = np.arange(0.0, 2.0, 0.02)


def swing(p, r):
    """A user's own integrator: leapfrog, 10 steps a sample: 0.2 mrad off DOP853 at most, the noise is 1 mrad."""

    W, viscous, quadratic, dry = (p[n] for n in ("W", "viscous", "quadratic", "dry"))
    sin, tanh = math.sin, math.tanh
    a, out = r.inputs["start"], []
    w = -1e-3 * W * sin(a)
    for _ in r.t:
        out.append(a)
        for _ in range(10):  # written out: it is walked some ten million times
            a += 2e-3 * w
            w -= 2e-3 * (W * sin(a) + viscous * w + quadratic * abs(w) * w + dry * tanh(w / 0.02))
    return np.array(out)


def study(function=swing, **more):
    one = {"unit": "1", "scale": 0.1}
    mechanisms = [
        jv.Mechanism("viscous_drag", [jv.Parameter("viscous", 0.0, (0, 3), **one)], "drag of the speed"),
        jv.Mechanism("quadratic_drag", [jv.Parameter("quadratic", 0.0, (0, 3), **one)], "drag of the speed squared"),
        jv.Mechanism("dry_friction", [jv.Parameter("dry", 0.0, (0, 5), **one)], "dry friction in the bearing"),
    ]
    parameters = [jv.Parameter("W", 50.0, (30, 90), unit="1/s^2")]
    channels = [jv.Channel("angle", "rad", noise=1e-3)]
    return jv.Study(function, parameters, mechanisms, channels, **more)


def world(seed=1, n=4, noise=1e-3, **hidden):
    """Swings of a pendulum W = 60 by another integrator."""
    rng, out = np.random.default_rng(seed), []
    c, q, f = (hidden.get(k, 0.0) for k in ("viscous", "quadratic", "dry"))
    for k in range(n):
        a = 0.3 + 0.2 * k

        def rate(_, s):
            return [s[1], -60.0 * np.sin(s[0]) - c * s[1] - q * abs(s[1]) * s[1] - f * np.tanh(s[1] / 0.02)]

        true = solve_ivp(rate, (0, T[-1]), [a, 0.0], t_eval=T, method="DOP853", rtol=1e-9, atol=1e-11, max_step=5e-3)
        out.append(jv.Recording(f"swing {k}", T, true.y[0] + noise * rng.standard_normal(T.size), {"start": a}))
    return out


@pytest.fixture(scope="module")
def found():
    return jv.diagnose(world(dry=0.3), study())


def test_a_hidden_friction_is_named_with_its_value(found):
    assert found.named == ("dry_friction",)
    dry = found.fitted["dry"]
    assert abs(dry.value - 0.3) < 4 * dry.sigma + 0.01 * 0.3  # 1 %: the study's integrator at a reversal
    assert found.gain.ratio_ci95[0] > 1 and found.unit == "rad"
    assert "dry friction in the bearing" in found.sentence


def test_nothing_hidden_is_adequate():
    found = jv.diagnose(world(seed=2), study())
    assert found.adequate and found.named == () and found.p_value > 0.02


def test_the_record_reads_as_the_command_s(found, tmp_path):
    found.save(tmp_path)
    again = Diagnosis.load(tmp_path)
    assert again.values == json.loads((tmp_path / "diagnosis.json").read_text()) == found.values
    assert {"verdict", "causes", "gain", "noise", "unit", "runs", "fitted"} <= set(again.values)


def test_notebook_comfort(found):
    lines = repr(found).splitlines()
    assert len(lines) < 24 and max(map(len, lines[1:])) <= 140
    assert "<table>" in found._repr_html_() and "base64" in found._repr_html_()
    assert found.table.loc[0, "model"] == "dry_friction" and found.table.named[0]
    assert "dry friction in the bearing: named" in found.explain("dry_friction")
    assert "not named" in found.explain("viscous_drag") or "no model" in found.explain("viscous_drag")
    assert found.field.measured.sizes == {"recording": 4, "channel": 1, "time_s": T.size}
    again = pickle.loads(pickle.dumps(found))
    assert again.values == found.values and again.samples.equals(found.samples)


def test_a_table_is_as_good_as_recordings(found):
    each = [pd.DataFrame({"recording": r.name, "time_s": r.t, "angle": r.values}) for r in world(dry=0.3)]
    starts = {r.name: r.inputs["start"] for r in world()}
    plain = study()

    def simulate(p, r):
        return swing(p, jv.Recording(r.name, r.t, r.values, {"start": starts[r.name]}))

    again = jv.diagnose(pd.concat(each), jv.Study(simulate, plain.parameters, plain.mechanisms, plain.channels))
    assert again.named == found.named and again.p_value == found.p_value


def test_written_only_where_asked(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    jv.diagnose(world(n=2), study())
    assert list(tmp_path.iterdir()) == []
    jv.diagnose(world(n=2), study(), results=tmp_path / "out")
    made = {f.name for f in (tmp_path / "out").iterdir()}
    assert made == {"diagnosis.json", "samples.csv", "diagnosis.png", "report.html", "runs.sqlite"}


def test_the_page_holds_the_trace_of_the_search():
    """Its steps, in order, with their runs: what went before the first is the start's own."""
    found = jv.diagnose(world(n=3, dry=0.3), study())
    rows = search_rows(found)
    assert [r["step"].split(" (")[0] for r in rows][:3] == ["fitting the baseline", "testing it", "discrepant"]
    assert sum(int(r["simulations"]) for r in rows) == found.runs.made - found.search[0][1]
    text = page(found, b"", "pendulum")
    assert all(x in text for x in ("How it was searched", "Correlations of the parameters", "swing 0", "trying"))


def test_a_gain_over_two_recordings_has_no_interval():
    found = jv.diagnose(world(n=2, dry=0.3), study())
    assert found.gain.ratio_ci95 == (0.0, math.inf) and not found.gain.claimed
    assert "(3 groups are needed for its interval)" in found.sentence


def written(p, r, force):
    """The pendulum whose forces stand in lines of text."""
    a, w, out = r.inputs["start"], 0.0, []
    for _ in r.t:
        out.append(a)
        for _ in range(10):
            a += 1e-3 * w
            w -= 2e-3 * (p["W"] * math.sin(a) - force(w=w))
            a += 1e-3 * w
    return np.array(out)


def test_mechanisms_are_laws_where_the_simulator_takes_a_force():
    """The same hidden dry friction, named from text; the law of the study is smooth at rest as the truth is."""
    one = {"unit": "1", "scale": 0.1}
    laws = {"dry": "-f * w / (abs(w) + 0.01)", "quadratic": "-q * abs(w) * w"}
    mechanisms = [jv.Mechanism(n, [jv.Parameter(x[1], 0.0, (0, 3), **one)], law=x) for n, x in laws.items()]
    asked = jv.Study(written, study().parameters, mechanisms, study().channels, symbols=("w",))
    asked_of = [jv.Recording(r.name, r.t[:50], r.values[:50], r.inputs) for r in world(n=2, dry=0.3)]
    assert jv.diagnose(asked_of, asked).named == ("dry",)
    with pytest.raises(InputError, match=r"mechanism 'bad': law = '-k \* z'.*symbols of the study: w"):
        jv.Study(written, [], [jv.Mechanism("bad", [jv.Parameter("k", 0, (0, 1))], law="-k * z")], [], symbols=("w",))


def crept(p, r):
    """A body in syrup: its speed is the force over the drag."""
    steps = (r.inputs["force"] - p["offset"] - p["drift"] * r.t) / p["drag"] * np.gradient(r.t)
    return np.concatenate([[0.0], np.cumsum(steps)[:-1]])


def creeps(seed, walk=0.0, drag=200.0, offset=0.0):
    """Two repeats of 10 s under a logged force that differs a little, and random forces that nobody logged."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, 10.0, 0.02)
    out = []
    for k in range(2):
        force = 40.0 * np.sin(2 * np.pi * t / 5.0) + 0.2 * rng.standard_normal(t.size)
        v = (force - offset) / drag * 0.02 + walk * math.sqrt(0.02) * rng.standard_normal(t.size)
        y = np.concatenate([[0.0], np.cumsum(v)[:-1]])
        out.append(jv.Recording(f"run {k}", t, y, {"force": force}, group="runs", condition=f"run {k}"))
    return out


def syrup(**channel):
    drag = jv.Parameter("drag", 150.0, (100, 400), unit="N s/m", scale=5.0)
    causes = [("offset", (-5, 5), 0.1, "N"), ("drift", (-0.5, 0.5), 0.01, "N/s")]
    mechanisms = [jv.Mechanism(n, [jv.Parameter(n, 0.0, x, unit=u, scale=s)]) for n, x, s, u in causes]
    return jv.Study(crept, [drag], mechanisms, [jv.Channel("position", "m", **channel)])


@pytest.mark.parametrize("seed", range(3))
def test_the_walk_of_a_simulation_is_learned_from_repeats(seed):
    """Truth: 2 mm/sqrt(s). Taken for independent noise it is a discrepancy, and something would be named."""
    asked = creeps(seed, walk=2e-3)
    found = jv.diagnose(asked, syrup(process=True))
    source = found.noise.sources["random walk [per sqrt(s)]"]
    # the greatest over lags of independent estimates: never far below, seldom 2.5 sigma above
    assert -2.5 < math.log(source.sigma_m / 2e-3) / source.log_sigma < 4.0
    assert found.adequate, found.sentence
    assert not jv.diagnose(asked, syrup(noise=1e-3)).adequate
    assert jv.diagnose(creeps(seed, walk=2e-3, offset=2.0), syrup(process=True)).named == ("offset",)


def test_a_walk_needs_repeats():
    alone = [jv.Recording(r.name, r.t, r.values, r.inputs) for r in creeps(1, walk=2e-3)]
    with pytest.raises(InputError, match="no two recordings of one `group` have the same times"):
        jv.diagnose(alone, syrup(process=True))
    with pytest.raises(InputError, match="process=True learns the noise; leave noise out"):
        syrup(process=True, noise=1e-3)


def test_constants_of_a_table_are_numbers():
    table = pd.DataFrame({"recording": "a", "time_s": np.arange(5.0), "x": 0.0, "drop": 0.3, "force": np.arange(5.0)})
    (only,) = jv.Recording.of_table(table, ["x"], inputs=["force"], constants=["drop"])
    assert only.inputs["drop"] == 0.3 and only.inputs["force"].shape == (5,)
    with pytest.raises(SimulatorError, match=r"KeyError: 'start' .*the recording has the inputs force, drop"):
        jv.diagnose([only], jv.Study(swing, study().parameters, study().mechanisms, [jv.Channel("x", noise=1.0)]))


def failing(p, r):
    if p["W"] > 50.0:
        raise ZeroDivisionError("no such pendulum")
    return swing(p, r)


def nan(p, r):
    return swing(p, r) * (np.nan if p["W"] > 50.0 else 1.0)


def other_shape(p, r):
    return swing(p, r)[: 7 if p["W"] > 50.0 else None]


def dying(p, r):
    if p["W"] > 50.0:
        os.kill(os.getpid(), 11)
    return swing(p, r)


def leaving(p, r):
    if p["W"] > 50.0:
        os._exit(0)
    return swing(p, r)


def hanging(p, r):
    while p["W"] > 50.0:
        time.sleep(0.05)
    return swing(p, r)


@pytest.mark.parametrize(
    ("function", "how", "said"),
    [
        (failing, {}, r"raised ZeroDivisionError: no such pendulum \(line \d+ of test_any_simulator.py\)"),
        (nan, {}, r"gave NaN or infinity, first at t = 0 s"),
        (other_shape, {}, r"simulated values of shape \(7,\); expected \(100, 1\)"),
        (failing, {"workers": 1}, "raised ZeroDivisionError"),
        (dying, {"workers": 1}, "died by signal 11"),
        (leaving, {"workers": 1}, "died with exit status 0"),
        (hanging, {"limit": 2.0}, r"took longer than 2 s \(limit\)"),
    ],
    ids=["raises", "nan", "shape", "raises elsewhere", "dies", "leaves", "hangs"],
)
def test_a_failing_run_is_told_with_its_parameters(function, how, said):
    with pytest.raises(SimulatorError, match=said) as caught:
        jv.diagnose(world(n=2), study(function), **how)
    assert "recording 'swing" in str(caught.value) and "W = " in str(caught.value)
    assert caught.value.parameters["W"] > 50.0 and caught.value.parameters["dry"] == 0.0
    assert multiprocessing.active_children() == []


def test_an_interrupt_leaves_no_process():
    def interrupt(said):
        if said.startswith("simulations"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        jv.diagnose(world(n=4), study(), workers=2, progress=interrupt)
    assert multiprocessing.active_children() == []


def breaking(p, r):
    return swing(p, r) * (np.nan if p["viscous"] > 2.0 else 1.0)


def test_failures_may_be_avoided_and_are_told():
    found = jv.diagnose(world(n=2, dry=0.3), study(breaking), avoid=True)
    assert found.named == ("dry_friction",)
    assert all("gave NaN" in f and "viscous" in f for f in found.runs.failures)


def test_runs_are_kept_and_a_later_call_goes_on(tmp_path):
    file, asked = tmp_path / "runs.sqlite", world(n=2, dry=0.3)
    with pytest.raises(InputError, match=r"budget of 4 runs is used up; .*runs.sqlite keeps them"):
        jv.diagnose(asked, study(), budget=4, keep=file)
    begun = jv.diagnose(asked, study(), budget=60, keep=file)
    assert begun.verdict == "discrepant" and begun.status == "undetermined" and begun.p_value < 1e-6
    assert begun.named == () and "not known yet: the budget of 60 runs" in begun.sentence and begun.runs.made <= 60
    whole = jv.diagnose(asked, study())
    rest = jv.diagnose(asked, study(), keep=file)
    assert rest.runs.made + rest.runs.kept == whole.runs.made and 30 <= rest.runs.kept <= 64
    again = jv.diagnose(asked, study(), keep=file)
    assert again.runs.made == 0 and again.sentence == whole.sentence == rest.sentence


@pytest.mark.long
def test_other_processes_and_batches_give_the_same():
    asked = world(n=2, dry=0.3)
    here = jv.diagnose(asked, study())

    def batch(parameters, recordings):
        return [swing(p, r) for p, r in zip(parameters, recordings)]

    assert jv.diagnose(asked, study(), workers=2).values["causes"] == here.values["causes"]
    assert jv.diagnose(asked, study(batch, batch=True)).values["causes"] == here.values["causes"]


def test_an_alternative_function_takes_the_place_of_the_simulator():
    """Truth: gravity is a pendulum's; the study's baseline has the frequency of a spring at every amplitude."""

    def spring(p, r):
        return (
            swing({**p, "W": p["W"]}, jv.Recording(r.name, r.t, r.values, {"start": 1e-3})) * r.inputs["start"] / 1e-3
        )

    plain = study()
    mechanisms = [*plain.mechanisms, jv.Mechanism("pendulum", (), "gravity of a pendulum", function=swing)]
    found = jv.diagnose(world(), jv.Study(spring, plain.parameters, mechanisms, plain.channels))
    assert found.named == ("pendulum",)
    assert "gravity of a pendulum" in found.sentence and list(found.fitted) == ["W"]


def test_starts_of_every_recording_are_fitted_beside_the_model():
    """Each swing begins at an angle and a speed that are known to 20 mrad and 0.2 rad/s only, noise 1 mrad."""
    rng = np.random.default_rng(4)
    asked = []
    for r in world(seed=3, quadratic=0.05):
        guess = {"start": r.inputs["start"] + rng.normal(0, 0.02)}
        asked.append(jv.Recording(r.name, r.t, r.values, guess))
    plain = study()
    first = jv.Parameter("a0", lambda r: r.inputs["start"], sigma=0.02, unit="rad", each=True)

    def simulate(p, r):
        return swing(p, jv.Recording(r.name, r.t, r.values, {"start": p["a0"]}))

    found = jv.diagnose(asked, jv.Study(simulate, [*plain.parameters, first], plain.mechanisms, plain.channels))
    assert found.named == ("quadratic_drag",)
    q = found.fitted["quadratic"]
    assert abs(q.value - 0.05) < 4 * q.sigma + 0.01 * 0.05 and "a0" not in found.fitted


def test_two_channels_each_with_its_instrument():
    """Angle and rate; the rate's instrument shows 3 % too much, which is asked for, and nothing else is missing."""
    rng, asked = np.random.default_rng(5), []
    for r in world(seed=6):
        rate = np.gradient(r.values, r.t)  # replaced below by the true rate
        a = r.inputs["start"]
        true = solve_ivp(lambda _, s: [s[1], -60 * np.sin(s[0])], (0, T[-1]), [a, 0.0], t_eval=T, rtol=1e-9, atol=1e-11)
        rate = 1.03 * true.y[1] + 0.02 * rng.standard_normal(T.size)
        asked.append(jv.Recording(r.name, r.t, {"angle": r.values, "rate": rate}, r.inputs))

    def simulate(p, r):
        angle = swing(p, r)
        return {"angle": angle, "rate": np.gradient(angle, r.t, edge_order=2)}

    plain = study()
    channels = [plain.channels[0], jv.Channel("rate", "rad/s", noise=0.02, consider=("scale", "delay"))]
    found = jv.diagnose(asked, jv.Study(simulate, plain.parameters, plain.mechanisms, channels))
    assert found.named == ("rate_scale",) and found.unit == "noise"
    s = found.fitted["rate_scale"]
    # np.gradient of a swing of 7.7 rad/s at 20 ms shows 1 - (0.155)^2 / 6 = 0.4 % less, more at the third harmonic
    assert abs(s.value - 1.03) < 4 * s.sigma + 6e-3
    assert {x.channel: x.unit for x in found.traces} == {"angle": "rad", "rate": "rad/s"}


def test_wrong_calls_say_what_is_allowed():
    good = world(n=2)
    with pytest.raises(InputError, match="need the study that simulates them"):
        jv.diagnose(good)
    with pytest.raises(InputError, match="recordings are called 'swing 0'"):
        jv.diagnose([good[0], good[0]], study())
    with pytest.raises(InputError, match="give range="):
        jv.Study(swing, [jv.Parameter("W", 50.0)])
    with pytest.raises(InputError, match="is a parameter of a mechanism and of the baseline"):
        jv.Study(swing, [jv.Parameter("W", 50.0, (30, 90))], [jv.Mechanism("more", [jv.Parameter("W", 0, (0, 1))])])
    with pytest.raises(InputError, match="increasing times"):
        jv.Recording("a", [0.0, 1.0, 1.0, 2.0], [0.0] * 4)
    with pytest.raises(InputError, match="row 2, t = 1 after 1 in row 1"):
        jv.Recording("a", [0.0, 1.0, 1.0, 2.0], [0.0] * 4)
    with pytest.raises(InputError, match="values have 9 rows; t has 10"):
        jv.Recording("a", np.arange(10.0), np.zeros(9), {"start": 0.1})
    with pytest.raises(InputError, match="start = 20 lies outside its range 1 to 4"):
        jv.Parameter("W", 20, range=(1, 4))
    table = pd.DataFrame({"recording": ["a"] * 5, "time_s": np.arange(5.0)})
    with pytest.raises(InputError, match="has no column 'angle'; it has recording, time_s"):
        jv.Recording.of_table(table, ["angle"])
    wide = jv.Recording("a", np.arange(10.0), np.zeros((10, 2)), {"start": 0.1})
    with pytest.raises(InputError, match=r"values of shape \(10, 2\); expected \(10, 1\)"):
        jv.diagnose([wide], study())


BODY = """<mujoco><option timestep="1e-3" integrator="RK4"/><worldbody><body><joint name="z" type="slide" axis="0 0 1"/>
<geom size="0.05" mass="1.0" contype="0" conaffinity="0"/></body></worldbody></mujoco>"""
DROP, EVERY = 0.5, 5e-3  # s: length of a recording, between samples


def hopper() -> jv.Study:
    """A mass on a leg that pushes while it is shorter than at rest; what is missing is asked of leg, air and guide.

    MuJoCo's own "Euler" is half a step late in free flight (2 mm after 0.8 s at 0.5 ms): Runge-Kutta it has to be.
    """
    mujoco = pytest.importorskip("mujoco")

    model = mujoco.MjModel.from_xml_string(BODY)

    def simulate(p: dict[str, float], r: jv.Recording) -> np.ndarray:
        data, out = mujoco.MjData(model), np.empty(r.t.size)
        data.qpos[0] = r.inputs["height"]
        for i in range(r.t.size):
            out[i] = data.qpos[0]
            for _ in range(5):
                v = data.qvel[0]
                z = data.qpos[0] + 0.5 * model.opt.timestep * v  # the force of the middle of the step: second order
                leg = -p["k"] * z - p["damping"] * v + p["stiffening"] * z * z if z < 0 else 0.0
                data.qfrc_applied[0] = leg - p["drag"] * abs(v) * v - p["guide"] * math.tanh(v / 0.01)
                mujoco.mj_step(model, data)
        return out

    return jv.Study(
        simulate,
        [jv.Parameter("k", 1800.0, (1000, 4000), unit="N/m")],
        [
            cause("leg_damping", "damping", (0, 50), 1.0, "N s/m"),
            cause("leg_stiffening", "stiffening", (-2e4, 2e4), 1e3, "N/m^2"),
            cause("air_drag", "drag", (0, 1), 0.02, "N s^2/m^2"),
            cause("guide_friction", "guide", (0, 3), 0.05, "N"),
        ],
        [jv.Channel("height", "m", noise=3e-4, consider=("scale",))],
    )


@njit
def fall(start: float, n: int, d: float, s: float, q: float, f: float) -> np.ndarray:
    """Height by Runge-Kutta's fourth order at 10 us."""
    h, steps, out = 1e-5, 500, np.empty(n)
    x = np.array([start, 0.0])
    k = np.zeros((4, 2))
    for i in range(n):
        out[i] = x[0]
        for _ in range(steps):
            for j in range(4):
                y = x + (0.0 if j == 0 else h if j == 3 else 0.5 * h) * k[j - 1]
                leg = -2000.0 * y[0] - d * y[1] + s * y[0] ** 2 if y[0] < 0 else 0.0
                k[j, 0] = y[1]
                k[j, 1] = leg - 9.81 - q * abs(y[1]) * y[1] - f * math.tanh(y[1] / 0.01)
            x = x + h / 6.0 * (k[0] + 2.0 * k[1] + 2.0 * k[2] + k[3])
    return out


def hops(hidden: dict[str, float], rng: np.random.Generator) -> list[jv.Recording]:
    """Five drops onto the leg."""
    what = [hidden.get(n, 0.0) for n in ("leg_damping", "leg_stiffening", "air_drag", "guide_friction")]
    t, out = EVERY * np.arange(round(DROP / EVERY)), []
    for i in range(5):
        start = 0.02 + 0.02 * i
        y = fall(start, t.size, *what) * hidden.get("height_scale", 1.0)
        out.append(jv.Recording(f"drop {i}", t, y + 3e-4 * rng.standard_normal(t.size), {"height": start}))
    return out


def test_a_hopper_in_mujoco_is_questioned():
    asked = hops({"air_drag": 0.05}, np.random.default_rng(1))
    assert jv.diagnose(asked, hopper()).named == ("air_drag",)


def test_a_half_of_the_real_axis_is_predicted_from_the_other():
    """Structure as diagnosed on the whole record, the walk as learned there; bar of the axis: 2.5 mm over 12 s."""
    if not (real := os.environ.get("JUMPVISION_REAL_DATA")):
        pytest.skip("JUMPVISION_REAL_DATA is not set")
    halves = axis.strokes(Path(real) / "emps")
    walk = as_walk(4.23e-4, 7, 12.4, 0.01)
    channel = jv.Channel("position", "m", noise=walk.s, correlation=walk.rho)
    named = ("viscous_asymmetry", "friction_by_position", "offset_drift", "spring")
    study, error = axis.servo(), {}
    for what in ((), named):
        each = [axis.by_study(a, b, study, what, channel) - a.values for a, b in (halves, halves[::-1])]
        error[what] = axis.rms(np.concatenate(each))
    assert error[named] < 2.5 < error[()]


SIMULATOR = """
import numpy as np
import jumpvision as jv

def simulate(p, r):
    x = np.interp(r.t, r.inputs["motor_time_s"], r.inputs["motor_m"])
    return p["share"] * (x - x[0]) + p["creep"] * (r.t - r.t[0])

study = jv.Study(
    simulate,
    [jv.Parameter("share", 0.5, (0, 1), unit="1")],
    [jv.Mechanism("creep", [jv.Parameter("creep", 0.0, (-0.1, 0.1), unit="m/s")], "a slow creep")],
    [jv.Channel("height", "m", noise=5e-5, zero_sigma=5e-5)],  # heights count from the first frame, which has noise
    name="creeping rod",
)
"""


@pytest.fixture
def campaign(tmp_path):
    """Two recordings of a rod that follows a motor by 0.4 of its way and creeps by 1 mm/s."""
    rng, t = np.random.default_rng(7), np.arange(0.0, 1.0, 0.005)
    for k, f in enumerate((2.0, 3.0)):
        folder = tmp_path / "rods" / f"rod-{k}"
        folder.mkdir(parents=True)
        motor = np.where(t > 0.2, 5e-3 * np.sin(2 * np.pi * f * (t - 0.2)), 0.0)
        rod = 0.4 * motor + 1e-3 * t + 5e-5 * rng.standard_normal(t.size)
        for name, header, y in (("motor", "time_s,position_m", motor), ("rod_track", "time_s,height_m", rod)):
            np.savetxt(folder / f"{name}.csv", np.stack([t, y], axis=1), delimiter=",", header=header, comments="")
        (folder / "experiment.toml").write_text(
            'ground = "hard"\n[robot]\nmotor_mass = 1.0\nrod_mass = 0.2\nfoot_mass = 0.1\nspring_stiffness = 3000.0\n'
            'spring_damping = 1.0\n[rod_track]\nfile = "rod_track.csv"\n[motor_log]\nfile = "motor.csv"\n'
        )
    (tmp_path / "mine.py").write_text(textwrap.dedent(SIMULATOR))
    return tmp_path / "rods"


def command(*words, cwd):
    run = [sys.executable, "-c", "import sys; from jumpvision.cli import main; sys.exit(main(sys.argv[1:]))", *words]
    return subprocess.run(run, capture_output=True, text=True, cwd=cwd, timeout=300)


@pytest.mark.long
def test_the_command_asks_a_simulator_that_is_named(campaign):
    done = command(
        "diagnose", str(campaign), "--simulator", "mine:study", "--json", "--workers", "1", cwd=campaign.parent
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["named"] == ["creep"] and abs(found["fitted"]["creep"]["value"] - 1e-3) < 1e-4
    results = campaign.parent / "results" / "rods"
    assert {"diagnosis.json", "samples.csv", "diagnosis.png", "report.html"} <= {f.name for f in results.iterdir()}
    again = command(
        "diagnose", str(campaign), "--simulator", "mine.py:study", "--json", "--workers", "1", cwd=campaign.parent
    )
    assert json.loads(again.stdout)["runs"]["made"] == 0  # kept beside the results


@pytest.mark.parametrize(
    ("simulator", "said"),
    [
        ("mine:nothing", "has no attribute 'nothing'"),
        ("nowhere:study", "No module named 'nowhere'"),
        ("mine:simulate", "is a function, not a jumpvision Study"),
        ("mine", "must be MODULE:NAME"),
        ("rods/inside.py:study", "from which nothing is imported"),
    ],
)
def test_a_wrong_simulator_is_told(campaign, simulator, said, monkeypatch, capsys):
    (campaign / "inside.py").write_text(textwrap.dedent(SIMULATOR))
    monkeypatch.chdir(campaign.parent)
    assert main(["diagnose", str(campaign), "--simulator", simulator, "--workers", "1"]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.long
def test_what_a_simulator_does_wrong_does_not_end_the_command(campaign):
    text = SIMULATOR.replace(
        "    x = np", "    print('hello')\n    import os\n    os._exit(3) if p['creep'] else None\n    x = np"
    )
    (campaign.parent / "mine.py").write_text(textwrap.dedent(text))
    done = command(
        "diagnose", str(campaign), "--simulator", "mine:study", "--json", "--workers", "1", cwd=campaign.parent
    )
    assert done.returncode == 2 and "died with exit status 3" in done.stderr and "creep = " in done.stderr
    assert "hello" not in done.stdout
