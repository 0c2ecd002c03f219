"""The scripts of pipelines/thesis, with few points: their numbers beside those known otherwise.

Truth: an independent fine-step integration of the equations of docs/physics.md ("RK4"), the integrator of
test_sheet.py for jumps on sand, closed forms, and what the scripts gave with all points, where nothing else is known.
"""

import csv
import math
import re
import runpy
import sys

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from conftest import ROOT

FOLDER = ROOT / "pipelines" / "thesis"
SCRIPTS = sorted(f.stem for f in FOLDER.glob("*.py") if f.stem != "common")
KNOWN = {  # script: quantity: numbers, tolerance; half the last digit where no reason stands beside it
    "fig14_muscle": {  # means over other compliances than with all points
        "human: mean squat, countermovement, catapult, travels": ([0.28, 0.34, 0.32], 0.01),
        "bush baby: mean squat, countermovement, catapult, travels": ([3.1, 3.5, 4.1], 0.06),
        "insect: mean squat, countermovement, catapult, travels": ([8.85, 9.84, 17.3], 0.1),
    },
    "fig24_minimum_amplitude": {
        "easiest f/f_0, 1 cycle, phase 0.5 pi: within the forcing, one period later": ([0.74, 1.19], 0.005),  # RK4
        "easiest f/f_0, 5 cycles: least and greatest": ([0.964, 1.017], 0.001),
    },
    "fig26_lift_off_time": {
        "f_2/f_0 at phases pi/2, 3 pi/2": ([1.188, 1.098], 0.001),
        "f_5/f_0 at phases pi/2, 3 pi/2": ([1.017, 1.014], 0.001),
        "f_100/f_0 at phases pi/2, 3 pi/2": ([1.0, 1.0], 2e-4),  # resonance
        "f_100/f_0 with a loop of 5e4, 1e5, 2e5 N/m": ([0.960, 0.980, 0.990], 2e-3),  # RK4
        "least f_100/f_0 over damping ratios 0.0083 to 0.15": ([1.0001], 2e-4),
    },
    "fig27_map": {  # RK4
        "f_0, Hz": ([math.sqrt(5760.6 / 1.178) / (2.0 * math.pi)], 5e-4),
        "best f/f_0 of the stutter jump": ([0.7375], 0.0125),  # the step of its sweep
        "best f/f_0 of the single jump": ([1.54], 0.006),
        "f/f_0 of the single within 1 % of its best": ([1.39, 1.71], 0.006),
        "height of the best stutter jump, mm": ([41.0], 0.06),
        "height of the best single jump, mm": ([38.1], 0.06),
        "single / stutter, peak power at the best": ([1.52], 0.006),
        "single / stutter, peak power at 1.4 and 0.78 f_0": ([1.31], 0.006),
        "single / stutter, peak force at the best": ([1 / 1.33], 0.003),
    },
    "fig27_scatter": {  # fewer points than the medians of all
        "scatter of the flight height above 4 Hz, median, mm": ([0.08], 0.01),
        "the same in % of the height": ([0.4], 0.05),
    },
    "fig29_traces": {
        "best stutter: height, mm": ([41.0], 0.06),
        "best single: height, mm": ([38.1], 0.06),
        "best stutter: peak internal, external, absolute power, W": ([5.29, 7.91, 7.80], 0.01),
        "best single: peak internal, external, absolute power, W": ([8.04, 7.22, 5.46], 0.01),
        # half m (A w)^2 of the reduced mass m_m m_r / M, taken back at the end
        "work of the impulses at its start and end, J": (
            [s * 0.5 * 1.003 * 0.175 / 1.178 * (4e-3 * math.sqrt(5760.6 / 1.178)) ** 2 for s in (1, -1)],
            1e-6,
        ),
    },
    "fig32_alpha": {  # RK4
        "alpha where the stutter height passes the single's": ([0.12], 0.0007),
        "the same by flight time": ([0.108], 0.0007),
        "alpha where the stutter power passes the single's": ([0.276], 0.0005),
        "alpha up to which the stutter has more height per power": ([0.69], 0.005),
        "best f/f_0 at alpha 0.9, stutter": ([1.18], 0.0115),  # nodes of a grid of 0.02; the maximum is at 1.191
        "best f/f_0 at alpha 0.9, single": ([1.20], 0.0115),
        "best f/f_0 at alpha 1.2, stutter": ([1.20], 0.0115),
    },
    "fig32_height_amplitude": {
        "best f/f_0 of the stutter jump at 4 mm": ([0.7375], 0.0125),  # RK4
        "best f/f_0 of the single jump at 4 mm": ([1.54], 0.006),
        "best f/f_0 of the stutter jump at 8 mm": ([0.61], 0.005),
        "best f/f_0 of the single jump at 8 mm": ([1.58], 0.005),
    },
    "fig33_estimates": {
        "best f/f_0 by eq. (13)": ([1.194], 0.0005),
        # over fewer alphas than with all points
        "rms error of eq. (8), half a fall below alpha 0.9, f_0": ([0.160], 0.006),
        "rms error of eq. (10), fall and push below alpha 0.9, f_0": ([0.048], 0.002),
        "rms error of eq. (12), three parts below alpha 0.9, f_0": ([0.031], 0.002),
    },
    "fig35_animals": {
        "human alpha": ([78.0 * 9.81 / (28500.0 * 0.5)], 1e-4),
        "human stutter jump, m": ([2.1], 0.05),  # RK4
        "human single jump, m": ([5.2], 0.05),
        "animals between stutter and single": ([36, 44], 0),
    },
    "fig36_two_frequencies": {
        "height over the better of the others at alpha 0.14": ([1.76], 0.01),  # of a coarser grid
        "alpha from which it gains less than 1 % over the stutter": ([0.815], 0.045),  # between two of 40 alphas
        "first frequency below the stutter's, % of alphas": ([100.0], 0.0),
    },
    "fig45_height_phi": {
        "best single jump on loose sand, mm": ([49.0], 0.1),
        "the same over that on hard ground": ([0.39], 0.005),
        "best single jump on dense sand, mm": ([90.9], 0.1),
    },
    "fig45_jump_types": {  # test_sheet.py
        "single jump, loose and dense sand, mm": ([47.4, 85.8], 0.1),
        "stutter jump, loose and dense sand, mm": ([26.4, 99.3], 0.1),
        "delayed stutter, loose and dense sand, mm": ([61.0, 77.0], 0.1),
        "older model's stutter, loose and dense sand, mm": ([39.2, 101.2], 0.1),
        # 0.6076 with thirteen packings; the curve bends between five
        "packing whose single is as high as the delayed from after the hop": ([0.6076], 0.002),
    },
    "fig47_delay": {
        "best delay within one loaded period, ms": ([75.0], 0.5),
        "half a loaded period, ms": ([1e3 * math.pi * math.sqrt(1.3 * (1 / 3300.0 + 1 / 2100.0))], 0.01),
        "no delay, best delay, 0.75 s, mm": ([-2.8, 95.2, 71.2], 0.1),
        "best single jump, mm": ([47.4], 0.1),
        "ringing left in the heights of long delays, mm": ([0.1], 0.05),
    },
    "fig48_mantle": {
        "k_2 / k_1 by Li et al.: mean, least, greatest": ([0.70, 0.67, 0.72], 0.005),
        "k_2 / k_1 by Agarwal et al.: mean, least, greatest": ([0.95, 0.66, 1.24], 0.005),
        "k_2 over the predicted one, loose and dense sand": ([1.21, 0.61], 0.005),
        "single at 8 Hz on loose sand: own k_2, least, greatest, mm": ([47.7, 43.3, 50.5], 0.06),
    },
    "fig49_drag": {
        "alpha of the single jumps on loose sand, kg/m": ([69.7], 0.1),  # 67 to 76, by the frequencies fitted
        "rms of their heights, mm": ([1.97], 0.01),
        "spread of heights over the drags at 3 and 12 Hz, mm": ([0.7, 53.3], 0.05),
        "best single jump: cone, constant drag, mm": ([49.0, 49.4], 0.3),  # RK4, with alpha 73 kg/m
        "best stutter: cone, constant drag, mm": ([24.1, 36.8], 0.1),  # RK4
        "kink of alpha against packing": ([0.605], 0.002),
    },
    "fig60_force_models": {
        "static: height mm, mean force N, time of its peak ms, depth mm": ([27.7, 40.4, 51.5, 35.9], 0.06),
        "constant drag: height mm, mean force N, time of its peak ms, depth mm": ([33.3, 40.6, 44.2, 32.1], 0.06),
        "cone: height mm, mean force N, time of its peak ms, depth mm": ([14.2, 37.6, 37.6, 31.1], 0.06),
        "greatest added mass / mass of the foot": (
            [2.7 * 0.57 * 1000.0 * math.pi * 0.0381**3 * math.tan(math.pi / 3) / 3 / 0.04],  # C phi rho, its cone
            1e-3,
        ),
    },
    "fig64_plan_heights": {
        "rigid plan, rigid ground: error of the height, mean and deviation mm, %": ([0.1, 0.1, 0.3], 0.05),
        "granular plan, sand: error of the height, mean and deviation mm, %": ([0.3, 0.3, 0.7], 0.05),
        "rigid plan, sand: error of the height, mean and deviation mm, %": ([23.9, 2.9, 68.5], 0.1),
        "greatest miss of a plan by its own model, µm": ([0.0], 100.0),
    },
    "fig65_plan_strategies": {  # least power does not fix the travel: that differs between builds that round otherwise
        "peak power above the least of any shape, at most, %": ([0.0], 0.5),
    },
    "section_2_4_1_hopper": {
        "hops begin at f/f_0, going up": ([0.63], 0.03),  # its step
        "hops end at f/f_0, going down": ([0.4], 1e-9),  # the end of the sweep
    },
    "section_2_5_2_power_limit": {
        "power of the best stutter jump, W": ([5.3], 0.05),
        "power of the best single jump, W": ([8.0], 0.05),
        "stutter the higher one from a limit of, W": ([2.8], 0.05),
        "best stutter, single jump, mm": ([41.0, 38.1], 0.06),  # RK4
        # k d^2 / (2 M g) + M g / (2 k), less what the spring's damping takes
        "catapult of the same travel, mm": ([1e3 * (5760.6 * 8e-3**2 / 2 / 3.18951 + 3.18951 / 2 / 5760.6)], 1.8),
        "force of its catch, N": ([5760.6 * 8e-3 + 3.18951], 1e-3),
    },
    "section_3_4_drag_scale": {
        "added mass lowers the best single on loose sand by mm, %": ([1.4, 2.7], 0.06),
        "added mass lowers the best single on dense sand by mm, %": ([0.5, 0.5], 0.06),
        "b halved to doubled moves the single on loose sand at 3, 12 Hz by mm": ([0.4, 22.7], 0.06),
        "b halved to doubled moves the single on dense sand at 3, 12 Hz by mm": ([0.1, 9.0], 0.06),
    },
    "section_3_4_foot_radius": {
        "power of R of the added mass": ([3.0], 1e-4),
        "power of R of the drag": ([2.0], 1e-4),
        "best single jump at 25.4 and 60 mm, mm": ([23.4, 82.6], 0.06),
        "best stutter jump at 25.4 and 60 mm, mm": ([-1.5, 82.4], 0.06),
    },
}


def numbers_of(text):
    """The numbers of a cell."""
    return [float(x) for x in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", text)]


@pytest.mark.long
@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_gives_the_numbers_that_are_known(name, tmp_path, monkeypatch, capsys):
    if "planning" in (FOLDER / f"{name}.py").read_text(encoding="utf-8"):
        pytest.importorskip("casadi", reason="planning needs CasADi: pip install 'jumpvision[plan]'")
    monkeypatch.setattr(sys, "argv", [str(FOLDER / f"{name}.py"), "--small", "--out", str(tmp_path)])
    monkeypatch.syspath_prepend(str(FOLDER))
    try:
        runpy.run_path(sys.argv[0], run_name="__main__")
    finally:
        plt.close("all")
    assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    with (tmp_path / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        rows = {r["quantity"]: r for r in csv.DictReader(file)}
    printed = capsys.readouterr().out
    assert all(set(r) == {"quantity", "ours", "dissertation"} and q in printed for q, r in rows.items())
    for quantity, (known, tolerance) in KNOWN[name].items():
        ours = numbers_of(rows[quantity]["ours"])
        assert len(ours) == len(known), (quantity, ours)
        np.testing.assert_allclose(ours, known, rtol=0, atol=tolerance, err_msg=quantity)


def test_every_script_can_be_read_and_is_listed_with_its_figure():
    readme = (FOLDER / "README.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| \[`(\w+)\.py`\]\(\1\.py\) \|", readme, re.M)
    assert sorted(listed) == SCRIPTS == sorted(KNOWN)
    for name in [*SCRIPTS, "common"]:
        text = (FOLDER / f"{name}.py").read_text(encoding="utf-8")
        compile(text, name, "exec")
        assert name == "common" or re.match(r'"""(?:Text of )?(?:Figs?|Sections?) [\d.]+', text), name


def test_every_animal_that_is_shipped_has_its_source_and_the_height_that_is_told():
    """Without a height its own (v sin(angle))^2/2g, at most v^2/2g, of a distance a quarter, to the digits written."""
    table = pd.read_csv(FOLDER / "animals.csv", comment="#")
    assert (table.kind == "animal").sum() >= 40 and table.animal.is_unique and table.source.str.len().min() > 20
    for row in table[~table.told.str.startswith("height")].itertuples():
        up = row.take_off_m_s * (math.sin(math.radians(row.angle_deg)) if np.isfinite(row.angle_deg) else 1.0)
        height = row.distance_m / 4 if row.told.startswith("distance") else up**2 / (2 * 9.81)
        assert row._4 == pytest.approx(height, abs=6e-5), row.animal
