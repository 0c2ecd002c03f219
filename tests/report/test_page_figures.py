"""Figures of pages: drawn once, true to their data, with titles and links on their points, small and self-contained."""

from __future__ import annotations

import json
import math
import re
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

from jumpvision.base.arrays import measured
from jumpvision.cli import main
from jumpvision.engine.document.values import Trace
from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.experiment.inputs.sections import Actuation, MotorLog
from jumpvision.experiment.results.fields import Column
from jumpvision.experiment.results.tables import RodMotion
from jumpvision.experiment.results.values import Fits, Geometry
from jumpvision.report.figures.bed import air, air_of
from jumpvision.report.figures.diagnosis import recording
from jumpvision.report.figures.grains import column
from jumpvision.report.figures.logs import moved
from jumpvision.report.figures.pictures import ring_down
from jumpvision.report.pages.drawings import apparatus_figures, motion_figures
from jumpvision.report.pages.svg import MAX_MARKS, drawing
from jumpvision.report.style import label_points, styled
from tests.worlds.pages import grains_into

LAG, RATIO = 2e-3, 0.9


def axes_of(draw, *data):
    with styled() as Figure:
        return draw(*data, Figure).axes


def lines_of(axis):
    return {line.get_label(): np.array(line.get_data(), float) for line in axis.lines}


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
    data = Fits.load(results), experiment.section(MotorLog), experiment.section(Actuation)
    place, off, work = axes_of(moved, *data)
    (t, command), (_, encoder) = (lines_of(place)[k] for k in ("command", "encoder"))
    assert 0.14 < t[0] < 0.16 and 0.54 < t[-1] < 0.56  # shortly before to shortly after, not all of the log
    assert encoder == pytest.approx(RATIO * command, abs=1e-3)  # mm
    assert off.lines[0].get_ydata() == pytest.approx(encoder - command, abs=1e-9)
    x = encoder * 1e-3
    assert lines_of(work)["so far"][1] == pytest.approx(5 * x - 150 * x**2, abs=2e-5)
    assert "ratio 0.9000" in place.get_title(loc="left") and "lag 2.00" in off.get_title(loc="left")
    assert [d.caption for d in apparatus_figures(results, experiment)] == ["The motor"]
    assert list(apparatus_figures(results, None)) == []  # of results alone there is no log


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
    (axis,) = axes_of(ring_down, Fits.load(tmp_path), RodMotion.load(tmp_path))
    fit, seen = lines_of(axis)["fit"], lines_of(axis)["measured"]
    assert seen[0][0] == start and seen[0][-1] == pytest.approx(1.4, abs=5e-3)
    assert np.interp(seen[0], *fit) == pytest.approx(seen[1], abs=0.002)  # mm; 1,500 points in 8 periods
    assert [d.caption for d in apparatus_figures(tmp_path, None)] == ["Ring-down"]


def test_air_lifts_the_bed_where_its_drop_is_its_weight(tmp_path):
    (tmp_path / "e").mkdir()
    (tmp_path / "e" / "experiment.toml").write_text(
        "[bed]\nvolume_fraction = 0.58\nsolid_volume = 0.045\nlength = 0.56\nwidth = 0.56\ngrain_density = 1000.0\n"
        "grain_diameter = 0.001\n"
    )
    assert main(["run", str(tmp_path / "e"), "--results", str(tmp_path / "r"), "--no-pictures"]) == 0
    (axis,) = axes_of(air, air_of(Geometry.load(tmp_path / "r"), None))
    weight = lines_of(axis)["weight of the bed"][1][0]
    assert weight == pytest.approx(0.045 * 1000.0 * 9.81 / 0.56**2 / 1e3, rel=0.01)  # kPa; less the air's own
    laws, onsets = ([x.get_data() for x in axis.lines if x.get_marker() == mark] for mark in ("None", "o"))
    laws = [law for law in laws if len(law[0]) > 2]
    assert len(laws) == len(onsets) == 2
    for law, (speed, pressure) in zip(laws, onsets):
        assert pressure[0] == pytest.approx(weight) == pytest.approx(np.interp(speed[0], *law), rel=2e-3)


def test_the_column_is_drawn_with_its_speeds_front_and_angles(tmp_path):
    grains_into(tmp_path)
    history, profile, beta, front, theta, _ = axes_of(column, Fits.load(tmp_path), Column.load(tmp_path))
    (mesh,) = history.collections
    seen = np.ma.filled(mesh.get_array(), np.nan)
    levels = mesh.get_coordinates()[:, 0, 1]
    # of the largest, at so many mm below the foot; over its kink between rows of 4 mm
    true = np.exp(-1e-3 * (levels[1:] + levels[:-1]) / 2)
    known = np.isfinite(seen)
    assert known.mean() > 0.5
    assert seen[known] == pytest.approx(np.broadcast_to(true[:, None], seen.shape)[known], abs=2.6e-3)
    assert history.lines[0].get_ydata() == pytest.approx([2.0 * 2.5 * k for k in range(12)])  # mm: twice the depth
    assert lines_of(profile).keys() >= {"$a^{z+b}$", "jammed above"}
    assert beta.lines[0].get_ydata() == pytest.approx(np.ones(12))
    assert front.lines[0].get_ydata() == pytest.approx(2.0 * front.lines[0].get_xdata())
    assert [x.get_ydata()[0] for x in theta.lines[:2]] == [62.0, 60.0]
    assert [d.caption for d in motion_figures(tmp_path, None)][1:] == ["Added mass", "The central column and the cone"]


def test_a_recording_is_drawn_with_its_models_and_what_they_leave():
    t = np.linspace(0.0, 1.0, 50)
    x = Trace("fall", "y", "m", t, t**2, t**2 - 0.1, t**2 + 0.01)
    top, low = axes_of(recording, [x], True)
    assert (top.get_ylabel(), low.get_xlabel()) == ("y [m]", "time [s]")
    for name, y in (("measured", x.measured), ("simulated", x.simulated), ("extended", x.extended)):
        assert lines_of(top)[name] == pytest.approx(np.array([t, y]))
    assert lines_of(low)["simulated"][1] == pytest.approx(0.1) and lines_of(low)["extended"][1] == pytest.approx(-0.01)
    assert lines_of(axes_of(recording, [x], False)[1]).keys() & {"extended"} == set()


# --- as text in a page -----------------------------------------------------------------------------------------------


def titles_of(svg):
    return [e.text for e in ElementTree.fromstring(svg).iter("title")]


def points(rows):
    """A drawing function of one panel with these (name, x, y, sigma)."""

    def draw(Figure):
        figure = Figure(figsize=(4.0, 3.0))
        axis = figure.subplots()
        names, x, y, s = zip(*rows)
        axis.errorbar(x, y, s, fmt="o")
        label_points(axis, x, y, [f"{n}: {measured(v, w)} mm" for n, v, w in zip(names, y, s)])
        return figure

    return draw


ROWS = [("a & b", 1.0, 12.34, 0.05), ("c<d>", 2.0, 20.0, 0.02), ("e", 3.0, math.nan, 0.1), ("f", 4.0, 30.0, 0.1)]


@pytest.mark.parametrize("n", [1, 4])  # matplotlib writes one, few and many points differently
def test_points_carry_titles_and_links(n):
    svg = drawing("what it shows", points(ROWS[:n]), links={"a & b": "a%20%26%20b/report.html"})
    root = ElementTree.fromstring(svg)
    shown = [f"{name}: {measured(y, s)} mm" for name, _, y, s in ROWS[:n] if math.isfinite(y)]
    assert titles_of(svg) == shown
    (link,) = root.iter("a")
    assert link.get("href") == "a%20%26%20b/report.html" and link.find("title").text == shown[0]
    assert [e.tag for e in root.iter() if e.get("class") == "point"] == ["a", *["g"] * (len(shown) - 1)]
    assert (root.get("aria-label"), root.get("role")) == ("what it shows", "group")
    named = [e for p in root.iter() if p.get("class") == "point" for e in p.iter("use")]
    marks = [re.findall(r"[\d.]+", e.get("d")) for e in root.iter("path") if "marker:" in e.get("style", "")]
    if marks:  # each title stands where its mark does
        assert [float(e.get(k)) for e in named for k in "xy"] == pytest.approx(list(map(float, marks[0])), abs=0.02)


def test_a_long_series_is_thinned_and_keeps_its_shape():
    x = np.linspace(0.0, 1.0, 100_000)

    def draw(Figure):
        figure = Figure()
        axis = figure.subplots()
        axis.plot(x, np.sin(40 * x), ".")
        axis.plot(x, np.sin(40 * x))
        return figure

    svg = drawing("long", draw)
    assert len(svg) < 60_000
    root = ElementTree.fromstring(svg)
    (marks,) = (e for e in root.iter("path") if "marker:" in e.get("style", "") and len(e.get("d")) > 2000)
    at = np.array(re.findall(r"[\d.]+", marks.get("d")), float).reshape(-1, 2)
    assert MAX_MARKS / 2 < len(at) <= MAX_MARKS
    shown, half = np.sin(40 * x[:: 100_000 // len(at)]), np.ptp(at[:, 1]) / 2
    assert at[:, 1] == pytest.approx(at[:, 1].min() + half - half * shown, abs=0.2)  # pt
