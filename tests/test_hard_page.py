"""The numbers that docs/hard_ground.md calls ours are those of the program (those that take less than a second)."""

import math
import re

import numpy as np
import pytest
from conftest import ROOT

from jumpvision.jumper.physics.hard.analysis import SINGLE, STUTTER, best_by_alpha, energy_after_one_cycle
from jumpvision.jumper.physics.hard.jump import hard_sweep, sine_rows
from jumpvision.thesis.studies.motions import best_jumps, grid
from jumpvision.thesis.studies.scaling import SEARCH
from jumpvision.thesis.studies.setup import setup_of
from jumpvision.thesis.studies.study import Sweep, studies

PAGE = (ROOT / "docs" / "hard_ground.md").read_text(encoding="utf-8")
ROWS = [
    [c.strip() for c in line.strip("|").split("|")] for line in PAGE.splitlines() if re.match(r"\| (Table|\d)", line)
]
HARD = setup_of("hard", None, {})
SWEEP = Sweep(grid, HARD, {}, {}, 1, print)
ROBOT = SWEEP.robot


def said(quantity):
    """The numbers of the column "ours" in the row of a quantity, with half of the last digit of each."""
    (row,) = [r for r in ROWS if r[1] == quantity]
    words = re.findall(r"\d+\.\d+|\d+", row[4])
    return [float(w) for w in words], [0.5000001 * 10.0 ** -len(w.partition(".")[2]) for w in words]


def check(quantity, *values):
    numbers, steps = said(quantity)
    assert len(numbers) == len(values), quantity
    for number, step, value in zip(numbers, steps, values):
        assert abs(number - value) <= step, (quantity, number, value)


def test_the_table_names_every_number_of_the_thesis_and_its_difference():
    assert len(ROWS) >= 30 and all(len(r) == 7 and r[4] for r in ROWS)
    # the difference of a row with one number on each side is ours - thesis, to the digits given
    for r in ROWS:
        thesis, ours, off = (re.fullmatch(r"(?:about )?([+-]?\d+\.?\d*)", r[i]) for i in (2, 4, 5))
        if thesis and ours and off:
            step = 10.0 ** -len(off[1].partition(".")[2])
            assert abs(float(ours[1]) - float(thesis[1]) - float(off[1])) <= step, r


def test_robot_and_bounce():
    mass, k, c = ROBOT.mass, ROBOT.stiffness, ROBOT.damping
    check("f_0 [Hz]", ROBOT.f0)
    zeta = c / (2.0 * math.sqrt(k * mass))
    check("damping ratio zeta", zeta)
    half = math.exp(-math.pi * zeta / math.sqrt(1.0 - zeta**2))  # of the speed, over half a period
    check("return of a bounce by zeta alone; with e = 0.33", half, half * math.sqrt(1.0 - 0.33))
    weight = mass * 9.81 / (k * 4e-3)
    check("alpha at g = 0.276 g_0; at g_0 cos 75 deg", 0.276 * weight, math.cos(math.radians(75.0)) * weight)


def best(**changed):
    """(f/f_0, com_height [mm]) of the best stutter and single jump, on a grid of 0.0005 f_0."""
    f = np.linspace(0.3, 2.5, 4401)
    found = []
    for phase in (STUTTER, SINGLE):
        height = hard_sweep(sine_rows(f * ROBOT.f0, 4e-3, phase, 1.0), **(ROBOT._asdict() | changed))["com_height_m"]
        found.append((f[height.argmax()], height.max() * 1e3))
    return found


def test_the_best_jumps():
    (f, h), (f_single, h_single) = best()
    check("best f/f_0 of the stutter (pi/2)", f)
    check("the same in Hz", f * ROBOT.f0)
    check("best f/f_0 of the single (3 pi/2), by COM height", f_single)
    check("best stutter height [mm]", h)
    check("best single height [mm]", h_single)
    (_, h), (_, h_single) = best(gravity=9.81 * math.cos(math.radians(75.0)))
    check("the same at g_0 cos 75 deg: stutter, single [mm]", h, h_single)
    f, phase = np.linspace(2.0 / ROBOT.f0, 1.4, 300)[:, None], np.linspace(0.0, 2.0 * np.pi, 241)
    jumps = hard_sweep(sine_rows(f * ROBOT.f0, 4e-3, phase, 1.0), **ROBOT._asdict())
    height = jumps["com_height_m"].max(axis=0) / 4e-3
    check("best height of a phase, f <= 1.4 f_0: least and greatest over the phases, in A", height.min(), height.max())
    check("most jumps of a multi-jump", jumps["n_jumps"][(f * ROBOT.f0 > 3.0)[:, 0]].max())
    (f, h), _ = best(landing_loss=0.33)
    assert (round(f, 3), round(h, 1)) == (0.718, 33.2)  # said in the column "why"
    for quantity, name in (
        ("single / stutter: peak power", "single / stutter peak power"),
        ("single / stutter: peak motor speed", "single / stutter peak motor speed"),
        ("stutter / single: peak force", "stutter / single peak force"),
    ):
        (row,) = [r["ours"] for r in best_jumps(SWEEP) if r["quantity"].startswith(name)]
        check(quantity, *(float(x) for x in row.split(";")))


def test_the_flat_maximum_at_alpha_09():
    found = best_by_alpha(
        [0.9, 0.9, 1.2],
        [STUTTER, SINGLE, STUTTER],
        ROBOT.rod_share,
        ROBOT.zeta,
        robot=ROBOT,
        search=SEARCH,
    )
    ratio = found["frequency_ratio"]
    check("f_opt/f_0 at alpha 0.9: stutter", ratio[0])
    check("f_opt/f_0 at alpha 0.9: single", ratio[1])
    check("f_opt/f_0 of the stutter beyond (alpha 1.2)", ratio[2])
    # why the fine-step integration has 1.18, 1.20, 1.20: the nodes of 0.02 f_0
    grid = np.arange(0.2, 2.0, 0.02)
    for i, (phase, want) in enumerate(((STUTTER, 1.18), (SINGLE, 1.2), (STUTTER, 1.2))):
        amplitude = found["amplitude_m"][i]
        height = hard_sweep(sine_rows(grid * ROBOT.f0, amplitude, phase, 1.0), **ROBOT._asdict())["com_height_m"]
        assert grid[height.argmax()] == pytest.approx(want, abs=1e-9)
        if i == 0:
            assert 2e-4 < 1.0 - height.max() / found["com_height_m"][0] < 4e-4


def test_the_estimate_for_large_alpha():
    ratio = np.linspace(0.6, 2.0, 14001)
    check("argmax of eq. (13)", ratio[np.argmax(energy_after_one_cycle(ratio))])


def test_every_analysis_has_its_command_and_picture():
    for name in (n for n, s in studies("hard").items() if s.source or s.of_campaign):
        assert f"--analysis {name}" in PAGE and f"images/hard_{name}.png" in PAGE
        assert (ROOT / "docs" / "images" / f"hard_{name}.png").stat().st_size < 200_000
