"""The samples end to end: every stage recovers the truth they were drawn from within its own stated sigma."""

from __future__ import annotations

import json
import math
import os
import shutil
import signal
import subprocess
import sys
import tomllib
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from conftest import SAMPLES
from diagnosis_sample import diagnosis, parameter

import jumpvision as jv
from jumpvision.cli import main
from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.engine.document.values import (
    Closest,
    CommonError,
    Gain,
    Height,
    Outlier,
    Tails,
    WithoutFilms,
)

pytestmark = pytest.mark.long
RUN = [sys.executable, "-c", "import sys; from jumpvision.cli import main; sys.exit(main())", "run"]


def run(path: Path, results: Path, *options: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*RUN, str(path), "--results", str(results), *options], capture_output=True, text=True)


def processor_time() -> float:
    """Of all processes that ended under this one [s]."""
    t = os.times()
    return t.children_user + t.children_system


@pytest.fixture(scope="session")
def results(tmp_path_factory) -> Path:
    """Both samples analysed once, about 100 s on two cores; pictures of one are enough here."""
    root = tmp_path_factory.mktemp("results")
    for name, options in (("hard_ground", ()), ("loose_sand", ("--no-pictures", "--table"))):
        done = run(SAMPLES / name, root / name, *options)
        assert done.returncode == 0, done.stderr
        (root / f"{name}.out").write_text(done.stdout)
    return root


def summary(results: Path, name: str) -> dict:
    return json.loads((results / name / "summary.json").read_text())


def truth(name: str) -> dict:
    return json.loads((SAMPLES / name / "truth.json").read_text())


SAND = sorted(f.parent.name for f in (SAMPLES / "loose_sand").glob("*/experiment.toml"))
FILM = "loose_sand/stutter-7.0Hz-film"


def test_there_are_enough_jumps():
    kinds = [name.split("-")[0] for name in SAND]
    assert len(SAND) >= 21
    assert {"single", "stutter", "delayed_stutter"} <= set(kinds)


def test_jump_heights_of_the_campaign_lie_within_their_sigma(results):
    """25 heights: a share of 0.683 +- 3 sqrt(0.683 0.317/25) = 0.40..0.96 within one sigma, none beyond four."""
    pulls = []
    for name in SAND:
        s, t = summary(results, f"loose_sand/{name}"), truth(f"loose_sand/{name}")["summary"]
        pulls.append((s["jump_height_m"] - t["jump_height_m"]) / s["sigma_m"])
    inside = np.mean(np.abs(pulls) < 1)
    assert 0.40 <= inside <= 0.96, pulls
    assert np.max(np.abs(pulls)) < 4, pulls


def test_hard_ground_height_flight_and_ring_down(results):
    s, t = summary(results, "hard_ground"), truth("hard_ground")
    assert s["jump_height_m"] == pytest.approx(t["jump_height_m"], abs=4 * s["sigma_m"])
    assert s["n_jumps"] == t["n_jumps"]
    assert s["lift_off_s"] == pytest.approx(t["lift_off_s"], abs=3 * s["lift_off_s_sigma"])
    longest = max(t["flight_times_s"])
    assert s["flight_time_s"] == pytest.approx(longest, abs=3 * s["flight_time_s_sigma"])
    assert s["frequency_hz"] == pytest.approx(t["summary"]["frequency_hz"], abs=3 * s["frequency_hz_sigma"])
    assert s["zeta"] == pytest.approx(t["summary"]["zeta"], abs=3 * s["zeta_sigma"])
    assert s["zeta_sigma"] < 0.02 * s["zeta"]


@pytest.mark.parametrize("name", ["hard_ground", FILM])
def test_ball_positions_lie_within_their_sigma(results, name):
    """Errors about their mean (a height counts from rest): 65-71 % is the house's bar; 0.05 is 3 sigma of the share
    over 359 frames."""
    d = pd.read_csv(results / name / "track.csv")
    true = truth(name)["film"]
    good = d.flag.isna().to_numpy()
    assert good.mean() > 0.99
    for seen, real in ((d.x_px, np.broadcast_to(true["x_px"], len(d))), (d.y_px, np.array(true["y_px"]))):
        error = (seen.to_numpy() - real)[good]
        share = np.mean(np.abs(error - error.mean()) < d.sigma_px.to_numpy()[good])
        assert 0.60 < share < 0.80
        assert np.abs(error).max() < 0.05
    assert d.time_s.to_numpy() == pytest.approx(np.array(true["time_s"]), abs=1e-6)
    height = d.height_m - (np.array(true["rod_m"]) - truth(name)["rest_rod_m"])
    assert np.nanmedian(np.abs(height)) < 4e-6


def test_bed(results):
    b, t = json.loads((results / FILM / "bed.json").read_text()), truth(FILM)
    assert b["height_m"] == pytest.approx(t["bed"]["height_m"], abs=2 * b["sigma_m"])
    assert b["volume_fraction"] == pytest.approx(t["volume_fraction"], abs=2 * b["sigma_volume_fraction"])
    assert b["sigma_volume_fraction"] < 5e-4


def pairs() -> dict[str, np.ndarray]:
    return {k: np.array(v) for k, v in truth(FILM)["grain_film"]["pairs"].items()}


def test_the_foot_is_followed(results):
    with xr.open_dataset(results / FILM / "flow.nc") as f:
        true = pairs()
        # the truth is the speed at mid-time; over 2 ms the foot's acceleration changes it by some mm/s
        assert np.nanmedian(np.abs(f.foot_speed - true["foot_speed_m_s"])) < 0.01
        assert np.nanmedian(np.abs(f.foot_depth - true["foot_depth_m"])) < 3e-4


def test_grain_momentum_and_added_mass(results):
    """Momentum in view: within 3 % wherever it is above a tenth of its peak, the bar of the closed loop,
    and inside its two sigma in 95 % of the frames."""
    with xr.open_dataset(results / FILM / "flow.nc") as f:
        true = pairs()["momentum_in_view_kg_m_s"]
        # frames in which the grains start or stop half-way in the pair have no mid-time value to compare with
        moving = true > 0.1 * true.max()
        moving[1:] &= true[:-1] > 0
        moving[:-1] &= true[1:] > 0
        error = (f.momentum.values - true)[moving] / true[moving]
        assert moving.sum() > 12
        assert np.abs(error).max() < 0.03
        assert np.mean(np.abs(error) < 2.0 * (f.momentum_sigma.values / true)[moving]) >= 0.95
        assert np.median((f.momentum_sigma.values / true)[moving]) < 0.015  # and is of use
    s = summary(results, FILM)
    assert s["added_mass_kg"] == pytest.approx(
        truth(FILM)["summary"]["added_mass_kg"], abs=3 * s["added_mass_kg_sigma"]
    )


@pytest.mark.long
@pytest.mark.parametrize("name", ["single-7.0Hz", "delayed_stutter-7.0Hz"])
def test_the_jumps_of_the_grain_films_move_what_their_truth_says(name, tmp_path):
    """Momentum from a tenth of the peak on within 5 % of the peak, added mass within 10 %, the foot within 1.5 pixels,
    which all frames share: where on the foot its face lies. The stutter moves at least twice as much (thesis Fig 52).
    """
    folder = SAMPLES / "grain_films" / name
    assert main(["flow", str(folder), "--results", str(tmp_path)]) == 0
    true = json.loads((folder / "truth.json").read_text())["grain_film"]["pairs"]
    with xr.open_dataset(tmp_path / "flow.nc", decode_times=False) as f:
        at = {n: np.interp(f.t, true["time_s"], true[n]) for n in ("momentum_in_view_kg_m_s", "foot_depth_m")}
        momentum, mass = at["momentum_in_view_kg_m_s"], np.array(true["added_mass_in_view_kg"])
        use = momentum > 0.1 * momentum.max()
        assert use.sum() >= 12 and np.abs(f.momentum.values - momentum)[use].max() < 0.05 * momentum.max()
        assert f.foot_depth.values == pytest.approx(at["foot_depth_m"], abs=5e-4)
        pushed = use & np.isfinite(f.added_mass.values) & (np.interp(f.t, true["time_s"], mass > 0) == 1.0)
        assert pushed.sum() >= 11
        assert f.added_mass.values[pushed] == pytest.approx(np.interp(f.t, true["time_s"], mass)[pushed], rel=0.1)
        assert 2.0 * f.momentum.max() < max(pairs()["momentum_in_view_kg_m_s"])


def test_cone(results):
    s, t = summary(results, FILM), truth(FILM)["summary"]
    assert s["mu"] == pytest.approx(t["mu"], abs=3 * s["mu_sigma"])
    assert s["mu_sigma"] < 0.02
    assert s["beta_deg"] == pytest.approx(t["beta_deg"], abs=3 * s["beta_deg_sigma"])
    assert s["beta_deg_sigma"] < 0.1


def test_velocity_field_against_the_prescribed_one(results):
    """On the axis, well inside the jammed plug, grains have the foot's speed: within 1 % on average while it pushes."""
    with xr.open_dataset(results / FILM / "piv.nc") as p:
        true = pairs()
        pushing = np.flatnonzero(true["grains_move"] & (true["foot_speed_m_s"] > 0.3))
        ratio = []
        for i in pushing[1:-1]:
            depth = true["foot_depth_m"][i] - truth(FILM)["grain_film"]["frames"]["foot_depth_m"][0]
            inside = (p.y < -depth - 0.005) & (p.y > -depth - 0.012) & (np.abs(p.x) < 0.01)
            ratio.append(float(-p.v.isel(t=i).where(inside).mean()) / true["foot_speed_m_s"][i])
        assert np.mean(ratio) == pytest.approx(1, abs=0.01)
        assert p.u.dims == ("y", "x", "t")
        assert float(p.y[0]) > float(p.y[-1])  # y up, rows from the top


def test_the_model_that_lacks_the_cone_over_predicts_stutter_jumps(results):
    """What the campaign is made to show: baseline minus measured, stutter against single jumps [mm]."""
    rows = pd.read_csv(results / "loose_sand" / "jumps.csv")
    excess = (rows.simulated_height_m - rows.jump_height_m) * 1e3
    assert excess[rows.kind == "stutter"].mean() > 5
    assert excess[rows.kind == "single"].mean() < 3


def test_the_adequate_model_leaves_only_noise(results):
    s, t = summary(results, "hard_ground"), truth("hard_ground")
    assert s["simulated_height_m"] == pytest.approx(t["jump_height_m"], abs=5e-6)
    track = pd.read_csv(results / "hard_ground" / "track.csv")
    model = pd.read_csv(results / "hard_ground" / "simulation.csv")
    left = track.height_m - np.interp(track.time_s, model.time_s, model.rod_m - model.rod_m[0])
    assert left.std() < 6e-6


def test_the_printed_table_shows_the_truth_beside_the_result(results):
    text = (results / "loose_sand.out").read_text()
    for word in ("height [mm]", "true height", "phi", "mu", "beta [deg]", "added mass [kg]", "true"):
        assert word in text
    named = text.partition("parameters of the named mechanisms")[2]
    rows = {line.split()[0]: line for line in named.splitlines() if line.strip()}
    for name, true in {"b": "17.2", "added": "0.150"}.items():
        assert true in rows[name] and "side 95 %" in rows[name]


def test_contract(results):
    check = os.environ.get("JUMPVISION_CONTRACT_CHECK")
    if not check or not Path(check).is_file():
        pytest.skip("JUMPVISION_CONTRACT_CHECK does not name the contract's own checker")
    done = subprocess.run([sys.executable, check, str(results)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    assert "contract holds" in done.stdout


def test_results_are_complete_and_clean(results):
    for name in ("track.csv", "bed.json", "piv.nc", "flow.nc", "fits.json", "simulation.csv", "summary.json"):
        assert (results / FILM / name).exists()
    assert (results / "loose_sand" / "report.html").exists()
    left = [f for f in results.rglob("*") if f.suffix == ".tmp" or f.name.startswith("writing-")]
    assert left == []
    p = json.loads((results / FILM / "provenance.json").read_text())
    assert {"versions", "parameters", "inputs", "outputs", "command"} <= set(p)
    assert set(p["inputs"]) == {"rod.avi", "bed.png", "grains.mkv", "motor.csv"}
    import hashlib

    for name, digest in p["outputs"].items():
        assert hashlib.sha256((results / FILM / name).read_bytes()).hexdigest() == digest


LIBRARIES = "import numpy, pandas, xarray, numba, cv2, scipy.linalg, scipy.optimize, scipy.special"


def test_the_second_run_recomputes_nothing_and_says_so(results):
    """In processor time, which other work on the machine lengthens and never shortens: the least of three times is at
    most four times what loading its libraries takes (2.5 idle; above 50 when the diagnosis is done again)."""

    def least(command) -> float:
        used = []
        for _ in range(3):
            before = processor_time()
            command()
            used.append(processor_time() - before)
        return min(used)

    def again():
        done = run(SAMPLES / "loose_sand", results / "loose_sand", "--json", "--no-pictures")
        assert done.returncode == 0
        return done

    again()  # another command than the first: its pages are new
    done = again()
    assert "nothing recomputed" in done.stderr
    states = {s["state"] for e in json.loads(done.stdout)["experiments"] for s in e["stages"]}
    assert states == {"cached"}
    libraries = least(lambda: subprocess.run([sys.executable, "-c", LIBRARIES], check=True))
    assert least(again) < 4.0 * libraries


@pytest.mark.skipif(os.name == "nt", reason="needs SIGKILL")
def test_killed_in_the_middle_it_finishes_with_the_same_numbers(results, tmp_path):
    """Three experiments of the campaign (too few to diagnose), killed -9 at four moments, then run to the end."""
    part = tmp_path / "loose_sand"
    part.mkdir()
    shutil.copy(SAMPLES / "loose_sand" / "campaign.toml", part)
    chosen = [SAND[0], SAND[2], SAND[-2]]
    for name in chosen:
        shutil.copytree(SAMPLES / "loose_sand" / name, part / name)
    out = tmp_path / "out"
    for wait in (2.0, 3.0, 5.0, 9.0):
        p = subprocess.Popen(
            [*RUN, str(part), "--results", str(out), "--no-pictures"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        try:
            p.wait(wait)
        except subprocess.TimeoutExpired:
            os.killpg(p.pid, signal.SIGKILL)
            p.wait()
    done = run(part, out, "--no-pictures")
    assert done.returncode == 0, done.stderr
    for name in chosen:
        a, b = summary(results, f"loose_sand/{name}"), summary(out, name)
        assert a == b
    assert not list(out.glob(".cache/writing-*"))
    assert not list(out.rglob("*.tmp"))


def test_one_experiment_alone_inherits_its_campaign(results, tmp_path):
    done = run(SAMPLES / "loose_sand" / SAND[0], tmp_path / "alone", "--no-pictures")
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "alone" / "summary.json").read_text()) == summary(results, f"loose_sand/{SAND[0]}")


@pytest.mark.parametrize("path", ["hard_ground", "loose_sand/stutter-7.0Hz-1"])
def test_the_motor_log_drives_the_model_like_the_law_it_samples(path, tmp_path):
    """Both describe one motion; the spline through the 6.25 um log is off by up to 0.02 mm at the law's corners."""
    rods = []
    for driver in ("law", "log"):
        out = tmp_path / driver
        options = ["--results", str(out), "--set", f"simulate.driver={driver}"]
        assert main(["simulate", str(SAMPLES / path), *options]) == 0
        rods.append(pd.read_csv(out / "simulation.csv"))
    law, log = rods
    off = np.interp(law.time_s, log.time_s, log.rod_m) - law.rod_m
    assert np.abs(off[law.time_s < 0.55]).max() < 1.5e-4  # up to the second landing; bounces then grow any difference
    assert np.abs(off).max() > 0


@pytest.mark.parametrize(
    ("pipeline", "path", "made", "not_made"),
    [
        ("hard_ground", "hard_ground", ("track.csv", "fits.json", "simulation.csv", "summary.json"), ("piv.nc",)),
        ("granular", f"loose_sand/{SAND[0]}", ("rod.csv", "fits.json", "simulation.csv", "summary.json"), ("piv.nc",)),
        ("piv_only", FILM, ("piv.nc", "flow.nc", "column.nc"), ("track.csv", "summary.json")),
    ],
)
def test_pipeline_definitions(pipeline, path, made, not_made, tmp_path):
    file = SAMPLES.parent / "pipelines" / f"{pipeline}.toml"
    done = run(SAMPLES / path, tmp_path, "--pipeline", str(file), "--no-pictures")
    assert done.returncode == 0, done.stderr
    assert all((tmp_path / name).exists() for name in made)
    assert not any((tmp_path / name).exists() for name in not_made)


# --------------------------------------------------------------------------------------- what the simulation gets wrong
@pytest.fixture
def asked(results):
    """The folder of the sand's results, and its diagnosis.json."""
    folder = results / "loose_sand"
    return folder, json.loads((folder / "diagnosis.json").read_text())


def test_the_hidden_cone_of_the_samples_is_named(asked):
    """Truth (truth.json): two_resistance + depth_drag (b 17.2) + added_mass (C mu 5.4), asked of a constant drag."""
    _, d = asked
    assert d["verdict"] == "discrepant" and d["p_value"] < 1e-6
    assert set(d["named"]) == {"added_mass", "depth_drag"}
    assert d["unexplained"] is None
    p = {k: v for c in d["causes"] for k, v in c["parameters"].items()}
    assert p["b"]["value"] == pytest.approx(17.2, rel=0.03)
    assert p["C"]["value"] * p["mu"]["value"] == pytest.approx(5.4, rel=0.03)
    assert p["C"]["low"] < 2.7 < p["C"]["high"]
    g = d["gain"]
    assert g["ratio"] > 10 and g["ratio_ci95"][0] > 3 and g["claimed"]
    assert sorted(g["holdout"]) == SAND
    assert g["ratio"] == pytest.approx(g["rmse_track_before_m"] / g["rmse_track_after_m"], rel=1e-9)
    stutter = [h["simulated_m"] - h["measured_m"] for h in d["heights"] if h["kind"] == "stutter"]
    assert np.mean(stutter) > 5e-3
    assert "over-predicts stutter jumps" in d["sentence"]


def test_a_diagnosis_stands_by_the_heights_of_the_table(asked):
    """To the last digit, sigma too; and what the extended model leaves of held-out heights is no longer 0.66 mm."""
    results, d = asked
    table = pd.read_csv(results / "jumps.csv", float_precision="round_trip").set_index("experiment")
    assert len(d["heights"]) == len(SAND)
    for h in d["heights"]:
        row = table.loc[h["experiment"]]
        assert (h["measured_m"], h["sigma_m"]) == (row.jump_height_m, row.sigma_m)
    assert d["gain"]["rmse_height_after_m"] < 3e-4


def test_the_grain_film_confirms_the_mass_that_the_jumps_imply(asked):
    """Two measurements of one cone: truth.json has the mass under half a foot and how much of it is in view."""
    _, d = asked
    rows = {r["quantity"]: r for r in d["confirmation"]}
    assert set(rows) == {"C", "mu", "theta", "added_mass"}
    row = rows["added_mass"]
    pairs = json.loads((SAMPLES / "loose_sand" / row["experiment"] / "truth.json").read_text())["grain_film"]["pairs"]
    depth = np.array(pairs["foot_depth_m"])
    first = slice(0, int(np.argmax(depth)))  # on the way down
    true, seen = (
        2 * np.interp(row["depth_m"], depth[first], np.array(pairs[k])[first])
        for k in ("added_mass_kg", "added_mass_in_view_kg")
    )
    assert row["by_film"] == pytest.approx(seen, abs=3 * row["by_film_sigma"])
    assert row["by_film_sigma"] < 0.03 * seen
    assert row["by_jumps"] == pytest.approx(true, rel=0.03)
    assert all(abs(r["z"]) < 3 and r["verdict"] == "agree" for r in rows.values())
    assert row["experiment"] in d["confirmed"] and "sand moving with the foot" in d["confirmed"]


def test_the_film_sharpens_the_cone_that_the_jumps_imply(asked):
    """truth.json: C 2.7, mu 2, theta 60 deg. Jumps alone know mu to 5 % and more, jumps and film to about 1 %."""
    _, d = asked
    truth = {"C": 2.7, "mu": 2.0, "theta": math.radians(60.0)}
    p = {k: v for c in d["causes"] for k, v in c["parameters"].items()}
    alone = {r["quantity"]: r for r in d["confirmation"]}
    for name, true in truth.items():
        assert p[name]["low"] - 0.2 * (p[name]["high"] - p[name]["low"]) < true  # 95 % about a 90 % interval
        assert p[name]["high"] + 0.2 * (p[name]["high"] - p[name]["low"]) > true
        assert p[name]["high"] - p[name]["low"] < 0.5 * 3.3 * alone[name]["by_jumps_sigma"]
        assert alone[name]["by_jumps"] == pytest.approx(true, abs=3 * alone[name]["by_jumps_sigma"])


def test_what_is_known_of_the_noise_stands_with_its_sources(asked):
    """truth.json: white noise of 0.05 mm, stated; the film's own is far smaller."""
    _, d = asked
    noise = d["noise"]
    assert noise["sigma_m"] == pytest.approx(5e-5, rel=0.05)
    assert set(noise["sources"]) == {"stated", "rest", "flight", "repeats"}
    for source in noise["sources"].values():
        assert source["sigma_m"] == pytest.approx(5e-5, rel=3 * source["log_sigma"])
    assert noise["tails"] is None and noise["correlation"] < 0.15 and noise["drift_m"] < 1e-4
    assert noise["warnings"] == [] and "stutter-7.0Hz-film" in noise["tracks"]


def test_the_energies_of_both_models_close(asked):
    _, d = asked
    assert {(r["kind"], r["model"]) for r in d["energy"]} == {
        (k, m) for k in ("single", "stutter", "delayed_stutter") for m in ("baseline", "extended")
    }
    for r in d["energy"]:
        held = r["potential_J"] + r["kinetic_J"] + r["spring_J"] + sum(r["losses_J"].values())
        assert r["motor_J"] == pytest.approx(held, rel=1e-5)
    drag = {r["model"]: r["losses_J"] for r in d["energy"] if r["kind"] == "stutter"}
    assert drag["extended"]["depth_drag"] > 0.1 and "depth_drag" not in drag["baseline"]


def test_a_diagnosis_comes_back_from_its_file_as_it_was(asked, tmp_path):
    """The file of a whole analysis; what it has not, an unknown number among it, from parts."""
    results, _ = asked
    found = Diagnosis.load(results)
    found.save(tmp_path)
    assert (tmp_path / "diagnosis.json").read_bytes() == (results / "diagnosis.json").read_bytes()
    assert Diagnosis.from_values(found.values) == found
    assert found.named and found.models[0].parameters["C"].sigma > 0.0 and found.next_experiment.separates
    gain = Gain(("a", "b"), 2e-3, 1e-3, 4e-3, 1e-3, 4.0, (2.0, 6.0), True)
    told = diagnosis(
        closest=Closest(("tilt",), 0.5, {"dg": parameter(0.1, 0.01, "m/s^2")}, 1e-3, gain),
        heights=(Height("a", "single", None, 0.0, None, 0.02, 2e-5, math.nan, math.nan),),
        indistinguishable=(("tilt", "payload"), ("payload", "tilt")),
        noise=replace(diagnosis().noise, tails=Tails(4.0), outliers=(Outlier("a", 0.1, 7.0),), sources={"rest": None}),
        without_films=WithoutFilms({"C": 2.7}, 900.0),
        common=(CommonError("scale[0]", 1.0, math.inf, 1.01, 0.01, "1"),),
    )
    told.save(tmp_path)
    back = Diagnosis.load(tmp_path)
    assert back.values == told.values and list(back.values) == list(told.values)
    assert back.closest == told.closest and back.noise == told.noise
    assert math.isnan(back.heights[0].extended_m) and back.heights[0].frequency is None
    assert told.values["heights"][0]["simulated_m"] is None and "with" in found.values["causes"][0]
    assert "without_films" not in found.values and list(told.values).index("without_films") == 24
    older = {**told.values, "unexplained": {"terms": ["v"], "r2": 0.9, "where": "flight"}}
    assert Diagnosis.from_values(older) == back and back.values["unexplained"] is None


def test_the_extended_model_is_taken_by_simulate(asked, tmp_path):
    """Re-simulated with model.toml, the jump reaches the measured height; without, it misses by millimetres."""
    results, _ = asked
    model = tomllib.loads((results / "model.toml").read_text())
    assert set(model["model"]["terms"]) == {"two_resistance", "inertial_drag", "depth_drag", "added_mass"}
    height = {}
    for name, extra in (("own", []), ("extended", ["--model", str(results / "model.toml")])):
        out = tmp_path / name
        path = SAMPLES / "loose_sand" / "stutter-6.0Hz-1"
        assert main(["run", str(path), "--results", str(out), "--no-pictures", *extra]) == 0
        height[name] = json.loads((out / "summary.json").read_text())
    measured = height["own"]["jump_height_m"]
    assert height["extended"]["simulated_height_m"] == pytest.approx(measured, abs=1e-3)
    assert height["own"]["simulated_height_m"] - measured > 4e-3


def test_asked_again_nothing_is_computed(asked, capsys):
    results, _ = asked
    before = (results / "diagnosis.json").read_bytes()
    assert main(["diagnose", str(SAMPLES / "loose_sand"), "--results", str(results), "--no-pictures"]) == 0
    err = capsys.readouterr().err
    assert "fitting the baseline" not in err
    assert (results / "diagnosis.json").read_bytes() == before


def test_the_diagnosis_of_a_notebook_is_that_of_the_command(asked, monkeypatch):
    """It asks the same question to the last byte, so that the answer is the one already kept; the film is in it."""
    results, d = asked
    kept = {name: (results / name).read_bytes() for name in ("model.toml", "diagnosis.json")}
    for name in kept:
        (results / name).unlink()
    monkeypatch.setattr("jumpvision.experiment.campaign.diagnose._answer", None)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        jv.diagnose(SAMPLES / "loose_sand", results=results, workers=1)
    assert {name: (results / name).read_bytes() for name in kept} == kept
    assert any(r["by_film"] is not None for r in d["confirmation"])
