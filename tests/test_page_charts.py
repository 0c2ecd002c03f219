"""Figures that a page draws by itself hold what is true of motor, ring-down, air and grain column."""

from __future__ import annotations

import json
import math

import numpy as np
import pandas as pd
import pytest
from test_report import grains_into

from jumpvision.estimate.estimate import Estimate
from jumpvision.estimate.robot import Bandwidth
from jumpvision.experiment.campaign.measured.actuator import Driven
from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.report.pages.apparatus_charts import air_chart, apparatus_charts, column_chart, motor_chart, ring_chart
from jumpvision.report.pages.charts import actuator_chart, numbers

LAG, RATIO = 2e-3, 0.9


def series_of(panel):
    return {s["name"]: s for s in panel["series"]}


def fits_into(folder, **values):
    folder.mkdir(parents=True, exist_ok=True)
    told = {k: {"value": v, "sigma": 1e-4, "unit": "1", "n": 9, "chi2": 1.0} for k, v in values.items()}
    (folder / "fits.json").write_text(json.dumps(told))


@pytest.fixture
def played(tmp_path):
    """A motor at 0.9 of its command; its force is 5 N - 300 N/m X, so its work 5 X - 150 X^2."""
    t = np.arange(0.0, 0.6, 1e-3)
    x = RATIO * 0.01 * np.where((t > 0.2) & (t < 0.45), np.sin(2 * np.pi * 4.0 * (t - 0.2)), 0.0)
    (tmp_path / "e").mkdir()
    log = pd.DataFrame({"time_s": t, "position_m": x, "force_N": 5.0 - 300.0 * x})
    log.to_csv(tmp_path / "e" / "motor.csv", index=False)
    (tmp_path / "e" / "experiment.toml").write_text(
        '[actuation]\nkind = "sine"\nfrequency = 4.0\namplitude = 0.01\nphase = 0.0\nstart = 0.2\n'
        '[motor_log]\nfile = "motor.csv"\n'
    )
    fits_into(tmp_path / "r", actuator_ratio=RATIO, actuator_lag_s=LAG, motor_work_J=0.0)
    return open_experiment(tmp_path / "e"), tmp_path / "r"


def test_the_motor_is_drawn_beside_its_command_with_the_work_so_far(played):
    experiment, results = played
    place, off, work = motor_chart(results, experiment)["panels"]
    t = np.array(series_of(place)["command"]["x"])
    assert 0.14 < t[0] < 0.16 and 0.54 < t[-1] < 0.56  # shortly before to shortly after, not all of the log
    command, encoder = (np.array(series_of(place)[k]["y"], float) for k in ("command", "encoder"))
    assert encoder == pytest.approx(RATIO * command, abs=1e-3)  # mm, five figures
    assert np.array(series_of(off)["difference"]["y"], float) == pytest.approx(encoder - command, abs=1e-3)
    x = encoder * 1e-3
    assert np.array(series_of(work)["work so far"]["y"]) == pytest.approx(5 * x - 150 * x**2, abs=2e-5)
    assert "ratio 0.9000" in place["title"] and "lag 2.00" in place["title"]
    assert motor_chart(results, None) is None  # of results alone there is no log


def test_a_ring_down_is_drawn_with_its_damped_cosine(tmp_path):
    zeta, f, a, start = 0.03, 9.0, 4e-3, 0.5
    t = np.arange(0.0, 1.5, 5e-3)
    omega0 = 2 * math.pi * f / math.sqrt(1 - zeta**2)
    wave = a * np.exp(-zeta * omega0 * (t - start)) * np.cos(2 * math.pi * f * (t - start) + 0.3) - 1e-3
    fits_into(
        tmp_path, frequency_hz=f, zeta=zeta, ring_amplitude_m=a, ring_offset_m=-1e-3, ring_phase_rad=0.3,
        ring_start_s=start, ring_stop_s=1.4,
    )  # fmt: skip
    pd.DataFrame({"time_s": t, "height_m": wave, "sigma_m": 1e-5}).to_csv(tmp_path / "rod.csv", index=False)
    (panel,) = ring_chart(tmp_path)["panels"]
    fit, seen = series_of(panel)["fit"], series_of(panel)["measured"]
    assert seen["x"][0] == start and seen["x"][-1] == pytest.approx(1.4, abs=5e-3)
    # times stand to 0.05 ms, in which it moves by 4 mm 2 pi 9 Hz 0.05 ms = 0.011 mm
    assert np.interp(seen["x"], fit["x"], fit["y"]) == pytest.approx(seen["y"], abs=0.012)


def test_air_lifts_the_bed_where_its_drop_is_its_weight(tmp_path):
    from jumpvision.cli import main

    (tmp_path / "e").mkdir()
    (tmp_path / "e" / "experiment.toml").write_text(
        "[bed]\nvolume_fraction = 0.58\nsolid_volume = 0.045\nlength = 0.56\nwidth = 0.56\ngrain_density = 1000.0\n"
        "grain_diameter = 0.001\n"
    )
    assert main(["run", str(tmp_path / "e"), "--results", str(tmp_path / "r"), "--no-pictures"]) == 0
    chart = air_chart(tmp_path / "r", open_experiment(tmp_path / "e"))
    (panel,) = chart["panels"]
    (weight,) = (r["y"] for r in panel["rules"])
    assert weight == pytest.approx(0.045 * 1000.0 * 9.81 / 0.56**2 / 1e3, rel=0.01)  # kPa; less the air's own
    lines = [s for s in panel["series"] if s["kind"] == "line"]
    onset = series_of(panel)["onset"]
    assert len(lines) == len(onset["x"]) == 2
    for line, speed in zip(lines, onset["x"]):
        assert np.interp(speed, line["x"], line["y"]) == pytest.approx(weight, rel=2e-3)  # 50 points of a parabola


def test_the_column_is_drawn_with_its_speeds_front_and_angles(tmp_path):
    grains_into(tmp_path)
    chart = column_chart(tmp_path)
    history, profile, beta, theta = chart["panels"]
    (map_,) = (s for s in history["series"] if s["kind"] == "map")
    assert np.shape(map_["z"]) == (len(map_["y"]), len(map_["x"])) and map_["y"] == sorted(map_["y"])
    # of the largest, at so many m below the foot; to three figures, and 2e-3 over its kink between rows of 4 mm
    true = np.exp(1e-3 * np.array(map_["y"]))
    seen = np.array(map_["z"], float)
    known = np.isfinite(seen)
    assert known.mean() > 0.5 and seen[known] == pytest.approx(
        np.broadcast_to(true[:, None], seen.shape)[known], abs=2.6e-3
    )
    front = series_of(history)["jammed front"]
    assert front["y"] == pytest.approx([-2.0 * 2.5 * k for k in range(12)])  # mm: twice the depth of the foot
    assert series_of(profile).keys() == {"exponential", "measured"}
    assert series_of(beta)["measured"]["y"] == [1.0] * 12
    assert series_of(theta)["measured"]["y"] == [60.0] * 12 and series_of(theta)["bands of shear"]["y"] == [62.0] * 12


def test_the_actuators_ratio_and_lag_with_the_level_of_3_dB():
    def known(v, s):
        return Estimate(v, s, "", 9, 1.0)

    rows = [
        Driven(f"f{f}", f, 0.01, {"actuator_ratio": (0.9, 0.01), "actuator_lag_s": (1e-3, 1e-4)}) for f in (4.0, 8.0)
    ]
    found = Bandwidth(known(16.0, 0.1), 15.8, 16.2, known(1.0, 0.01), known(0.01, 1e-4), 1)
    ratio, lag = actuator_chart(rows, found)["panels"]
    assert series_of(ratio)["ratio"]["y"] == [0.9, 0.9] and series_of(lag)["lag"]["y"] == [1.0, 1.0]  # ms
    assert {"y": 1.0 / math.sqrt(2.0)} in ratio["rules"] and ratio["spans"] == [(15.8, 16.2, "95 %")]


def test_numbers_of_a_page_have_five_figures_and_holes_stay_holes():
    values = [math.pi, -12345678.9, 1e-12, 0.0, math.nan, math.inf]
    assert numbers(values) == [3.1416, -12346000.0, 1e-12, 0.0, None, None]
    assert numbers([]) == [] and numbers([2.0 / 3.0], 1e3, digits=2) == [670.0]


def test_a_folder_without_results_has_no_figures(tmp_path):
    assert apparatus_charts(tmp_path, None) == []
