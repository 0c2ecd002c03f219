"""Every picture of the docs is one that docs/pictures.py made, and draws what the program gives now."""

from __future__ import annotations

import importlib
import json
import re
import sys

import numpy as np
import pytest
from conftest import ROOT, later
from test_readme import PAGES

sys.path.append(str(ROOT / "docs"))
pictures = importlib.import_module("pictures")
SLOW = ("hard_comparison", "dem_hexagonal", "planning", "granular-plan-strategies")
SLOW += ("granular-plan-heights", "hard_alpha", "hard_lift-off-time")
PLANS = ("planning", "granular-plan-heights", "granular-plan-strategies")


def test_each_file_is_of_the_command_and_shown_by_a_page():
    files = {f.stem for f in pictures.IMAGES.glob("*.png")}
    text = "".join(p.read_text(encoding="utf-8") for p in PAGES)
    assert files == set(pictures.PICTURES) == set(pictures.known()) == set(re.findall(r"images/([\w-]+)\.png", text))


@pytest.mark.parametrize("name", [*(n for n in pictures.PICTURES if n not in SLOW), *later(*SLOW)])
def test_a_picture_is_not_stale(name):
    if name in PLANS:
        pytest.importorskip("casadi", reason="planning needs CasADi: pip install 'jumpvision[plan]'")
    why = pictures.stale(name)
    assert why == "", f"docs/images/{name}.png is stale: {why}; run: python docs/pictures.py {name}"


def test_a_stale_picture_is_seen(tmp_path, monkeypatch):
    """Another robot, another word, another file; not another last digit."""
    name = "hard_height-amplitude"
    was = pictures.known()[name]
    monkeypatch.setitem(pictures.FEW, "height-amplitude", {"amplitude": "0.001:0.008:4", "stiffness": "5900"})
    assert "is now" in pictures.stale(name)
    monkeypatch.undo()
    off = json.loads(json.dumps(was["inputs"]).replace("amplitude A", "amplitude"))
    assert "'f / f_0" in pictures.differs(was["inputs"], off) or "is now" in pictures.differs(was["inputs"], off)
    assert pictures.differs([1.0, 2.345], [1.0, 2.346]) == "" and pictures.differs([1.0, 2.345], [1.0, 2.355])
    monkeypatch.setattr(pictures, "IMAGES", tmp_path)
    (tmp_path / f"{name}.png").write_bytes(b"another")
    assert "not the one that was made" in pictures.stale(name)


def test_what_is_drawn_is_lines_maps_markers_and_words():
    figure = pictures.Figure()
    axes = figure.subplots()
    axes.plot([0.0, 1.0], [2.0, np.nan], label="a line")
    axes.pcolormesh([[1.0, 3.0]])
    axes.scatter([1.0, 2.0, 3.0], [0.0, 0.0, 0.0])
    axes.set(title="t", xlabel="x [m]")
    axes.legend()
    (panel,) = pictures.drawn(figure)
    assert panel["words"] == "t | x [m] | a line"
    half = float(f"{0.5**0.5:.4g}")  # rms of 0 and 1
    assert panel["data"][0] == [2.0, 0.5, half, 2.0, 2.0]
    assert panel["data"][1] == [2.0, 2.0, 2.236]  # rms of 1 and 3
    assert panel["data"][2] == [6.0, 1.0, float(f"{(14 / 6) ** 0.5:.4g}")]  # of 1, 2, 3 and as many zeros
