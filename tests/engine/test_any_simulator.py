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
from functools import partial

import numpy as np
import pandas as pd
import pytest
from shared import later

import jumpvision as jv
from jumpvision.base.schema import InputError
from jumpvision.cli import main
from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.engine.study.runs import SimulatorError
from jumpvision.report.pages.study import search_rows
from tests.worlds.pendulum import T, study, swing, world


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


def test_the_record_reads_as_the_command_s_and_holds_the_trace_of_the_search(found, tmp_path):
    """The steps of the search with their runs: what went before the first is the start's own."""
    found.save(tmp_path)
    read, sent = Diagnosis.load(tmp_path), pickle.loads(pickle.dumps(found))
    assert read.values == json.loads((tmp_path / "diagnosis.json").read_text()) == found.values == sent.values
    assert sent.samples.equals(found.samples)
    assert found.table.loc[0, "model"] == "dry_friction" and found.table.named[0]
    assert found.field.measured.sizes == {"recording": 4, "channel": 1, "time_s": T.size}
    assert "<table>" in found._repr_html_() and len(repr(found).splitlines()) < 24
    rows = search_rows(found)
    assert sum(int(r["simulations"]) for r in rows) == found.runs.made - found.search[0][1]


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


def test_the_walk_of_a_simulation_is_learned_from_repeats():
    """Truth: 2 mm/sqrt(s). Taken for independent noise it is a discrepancy, and something would be named."""
    asked = creeps(0, walk=2e-3)
    found = jv.diagnose(asked, syrup(process=True))
    source = found.noise.sources["random walk [per sqrt(s)]"]
    # the greatest over lags of independent estimates: never far below, seldom 2.5 sigma above
    assert -2.5 < math.log(source.sigma_m / 2e-3) / source.log_sigma < 4.0
    assert found.adequate, found.sentence
    assert not jv.diagnose(asked, syrup(noise=1e-3)).adequate
    assert jv.diagnose(creeps(0, walk=2e-3, offset=2.0), syrup(process=True)).named == ("offset",)


def test_constants_of_a_table_are_numbers():
    table = pd.DataFrame({"recording": "a", "time_s": np.arange(5.0), "x": 0.0, "drop": 0.3, "force": np.arange(5.0)})
    (only,) = jv.Recording.of_table(table, ["x"], inputs=["force"], constants=["drop"])
    assert only.inputs["drop"] == 0.3 and only.inputs["force"].shape == (5,)


def bad(what, p, r):
    """The pendulum, which fails as it is told to where W > 50."""
    if p["W"] > 50.0 and what == "raises":
        raise ZeroDivisionError("no such pendulum")
    if p["W"] > 50.0 and what == "dies":
        os.kill(os.getpid(), 11)
    while p["W"] > 50.0 and what == "hangs":
        time.sleep(0.05)
    y = swing(p, r)
    return {"nan": y * np.nan, "shape": y[:7]}.get(what, y) if p["W"] > 50.0 else y


@pytest.mark.parametrize(
    ("what", "how", "said"),
    [
        ("raises", {}, r"raised ZeroDivisionError: no such pendulum \(line \d+ of test_any_simulator.py\)"),
        ("nan", {}, "gave NaN or infinity, first at t = 0 s"),
        ("shape", {}, r"shape \(7,\); expected \(100, 1\)"),
        *later(
            ("dies", {"workers": 1}, "died by signal 11"),
            ("hangs", {"workers": 1, "limit": 2.0}, r"took longer than 2 s \(limit\)"),
        ),
    ],
)
def test_a_failing_run_is_told_with_its_parameters(what, how, said):
    with pytest.raises(SimulatorError, match=said) as caught:
        jv.diagnose(world(n=2), study(partial(bad, what)), **how)
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


def alone():
    return [jv.Recording(r.name, r.t, r.values, r.inputs) for r in creeps(1, walk=2e-3)]


BAD_LAW = jv.Mechanism("bad", [jv.Parameter("k", 0, (0, 1))], law="-k * z")
NO_ANGLE = pd.DataFrame({"recording": ["a"] * 5, "time_s": np.arange(5.0)})


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: jv.diagnose(world(n=1)), "need the study that simulates them"),
        (lambda: jv.diagnose(2 * world(n=1), study()), "recordings are called 'swing 0'"),
        (lambda: jv.Study(swing, [jv.Parameter("W", 50.0)]), "give range="),
        (lambda: jv.Study(swing, study().parameters, [jv.Mechanism("more", study().parameters)]), "of the baseline"),
        (lambda: jv.Study(swing, [], [BAD_LAW], [], symbols=("w",)), "mechanism 'bad': law = .*of the study: w"),
        (lambda: jv.Recording("a", [0.0, 1.0, 1.0, 2.0], [0.0] * 4), "increasing times.*row 2, t = 1 after 1 in row 1"),
        (lambda: jv.Recording("a", np.arange(10.0), np.zeros(9)), "values have 9 rows; t has 10"),
        (lambda: jv.Parameter("W", 20, range=(1, 4)), "start = 20 lies outside its range 1 to 4"),
        (lambda: jv.Recording.of_table(NO_ANGLE, ["angle"]), "has no column 'angle'; it has recording, time_s"),
        (lambda: jv.diagnose(alone(), syrup(process=True)), "no two recordings of one `group` have the same times"),
        (lambda: syrup(process=True, noise=1e-3), "leave noise out"),
    ],
)
def test_wrong_calls_say_what_is_allowed(call, said):
    with pytest.raises(InputError, match=said):
        call()


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


def diagnose(folder, simulator):
    """What the command gives, run beside the folder in a process of its own."""
    call = "import sys; from jumpvision.cli import main; sys.exit(main(sys.argv[1:]))"
    words = ["diagnose", str(folder), "--simulator", simulator, "--json", "--workers", "1"]
    return subprocess.run(
        [sys.executable, "-c", call, *words], capture_output=True, text=True, cwd=folder.parent, timeout=300
    )


@pytest.mark.long
def test_the_command_asks_a_simulator_that_is_named(campaign):
    done = diagnose(campaign, "mine:study")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["named"] == ["creep"] and abs(found["fitted"]["creep"]["value"] - 1e-3) < 1e-4
    results = campaign.parent / "results" / "rods"
    assert {"diagnosis.json", "samples.csv", "diagnosis.png", "report.html"} <= {f.name for f in results.iterdir()}
    assert json.loads(diagnose(campaign, "mine.py:study").stdout)["runs"]["made"] == 0  # kept beside the results
    wrong = "    print('hello')\n    import os\n    os._exit(3) if p['creep'] else None\n    x = np"
    (campaign.parent / "mine.py").write_text(textwrap.dedent(SIMULATOR.replace("    x = np", wrong)))
    done = diagnose(campaign, "mine:study")
    assert done.returncode == 2 and "died with exit status 3" in done.stderr and "creep = " in done.stderr
    assert "hello" not in done.stdout


def test_a_wrong_simulator_is_told(campaign, monkeypatch, capsys):
    (campaign / "inside.py").write_text(textwrap.dedent(SIMULATOR))
    monkeypatch.chdir(campaign.parent)
    for simulator, said in (
        ("mine:nothing", "has no attribute 'nothing'"),
        ("nowhere:study", "No module named 'nowhere'"),
        ("mine:simulate", "is a function, not a jumpvision Study"),
        ("mine", "must be MODULE:NAME"),
        ("rods/inside.py:study", "from which nothing is imported"),
    ):
        assert main(["diagnose", str(campaign), "--simulator", simulator, "--workers", "1"]) == 2
        assert said in capsys.readouterr().err
