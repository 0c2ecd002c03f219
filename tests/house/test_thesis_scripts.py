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
from shared import ROOT

FOLDER = ROOT / "pipelines" / "thesis"
SCRIPTS = sorted(f.stem for f in FOLDER.glob("*.py") if f.stem != "common")
KNOWN = pd.read_csv(ROOT / "tests" / "data" / "thesis_numbers.csv", dtype={"known": str})


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
    expected = KNOWN[KNOWN.script == name]
    assert len(expected)
    for quantity, known, tolerance in zip(expected.quantity, expected.known, expected.tolerance):
        ours, known = numbers_of(rows[quantity]["ours"]), np.array(known.split(), float)
        assert len(ours) == len(known), (quantity, ours)
        np.testing.assert_allclose(ours, known, rtol=0, atol=tolerance, err_msg=quantity)


def test_every_animal_that_is_shipped_has_its_source_and_the_height_that_is_told():
    """Without a height its own (v sin(angle))^2/2g, at most v^2/2g, of a distance a quarter, to the digits written."""
    table = pd.read_csv(FOLDER / "animals.csv", comment="#")
    assert (table.kind == "animal").sum() >= 40 and table.animal.is_unique and table.source.str.len().min() > 20
    for row in table[~table.told.str.startswith("height")].itertuples():
        up = row.take_off_m_s * (math.sin(math.radians(row.angle_deg)) if np.isfinite(row.angle_deg) else 1.0)
        height = row.distance_m / 4 if row.told.startswith("distance") else up**2 / (2 * 9.81)
        assert row._4 == pytest.approx(height, abs=6e-5), row.animal
