"""The recipe "Add a study" of CONTRIBUTING.md in a copy of the package: two files, and all else follows."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import xarray as xr
from recipe import package_with

import jumpvision

ROOT = Path(jumpvision.__file__).parent

STUDY = '''"""Heights against gravity (a study of the recipe)."""

import numpy as np

from jumpvision.jumper.physics.hard.jump import hard_sweep, sine_rows

from .compute import dataset
from .study import Found, Sweep, study


@study("weight", "hard", source="Fig 99", ranges={"gravity": np.linspace(1.0, 9.0, 5)}, values=("frequency",))
def weight(s: Sweep) -> Found:
    """Heights of the robot's own jump against gravity."""
    g, law = s.axis("gravity"), s.setup.values
    robot = {n: law[n] for n in ("motor_mass", "rod_mass", "stiffness", "damping", "landing_loss")}
    jumps = hard_sweep(sine_rows(law["frequency"], law["amplitude"], law["phase"], law["cycles"]), gravity=g, **robot)
    lost = jumps["com_height_m"][0] - jumps["com_height_m"][-1]
    data = dataset(s, {"gravity": g}, ("gravity",), jumps)
    return data, [s.number("height lost to gravity", f"{lost * 1e3:.1f} mm")]
'''
FIGURE = '''"""Figure of a study of the recipe."""

from jumpvision.thesis.figures.sweeps import figure_of
from jumpvision.thesis.studies.weight import weight


@figure_of(weight)
def heights(data, Figure):
    """Height against gravity."""
    figure = Figure(figsize=(4, 3))
    figure.subplots().plot(data.gravity, data.com_height_m, gid="drawn by the recipe")
    return figure
'''


SCRIPT = """
import contextlib, io, json, sys
sys.path.append(sys.argv[1])
from jumpvision import api
from jumpvision.cli import main

def said(*words):
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert main(list(words)) == 0
    return out.getvalue()

out = {"swept": json.loads(said("sweep", "hard", "--analysis", "weight", "--frequency", "8", "--json"))}
said("figures", "results/sweep", "--format", "svg")
out["listed"] = json.loads(said("sweep", "hard", "--analyses", "--json"))
try:
    api.sweep("hard", analysis="wieght")
except ValueError as e:
    out["told"] = str(e)
import tables
out["docs"] = tables.text()
print(json.dumps(out))
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with the package and the new study; its other rooms are linked, so that their compiled code is known."""
    place = tmp_path_factory.mktemp("recipe")
    package_with(place, {"thesis/studies/weight.py": STUDY, "thesis/figures/weight.py": FIGURE})
    return place


@pytest.fixture(scope="module")
def found(place):
    """What the package says of its new study."""
    environment = os.environ | {"PYTHONPATH": str(place)}
    call = [sys.executable, "-c", SCRIPT, str(ROOT.parent / "docs")]
    done = subprocess.run(call, cwd=place, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_the_command_runs_it_by_name_and_draws_its_figure(place, found):
    assert [Path(f).name for f in found["swept"]["files"]] == ["sweep.nc", "sweep.png"]
    assert found["swept"]["numbers"][0]["quantity"] == "height lost to gravity"
    with xr.open_dataset(place / "results" / "sweep" / "sweep.nc") as data:
        assert data.attrs["analysis"] == "weight" and data.com_height_m.dims == ("gravity",)
        assert (data.com_height_m[:-1].values > data.com_height_m[1:].values).all()
    assert "drawn by the recipe" in (place / "results" / "sweep" / "figures" / "sweep-weight.svg").read_text("utf-8")


def test_it_is_in_every_list(found):
    row = next(r for r in found["listed"] if r["analysis"] == "weight")
    assert row["thesis"] == "Fig 99" and row["shows"] == "Heights of the robot's own jump against gravity"
    assert "did you mean 'weight'" in found["told"]
    assert "weight | Fig 99 | Heights of the robot's own jump against gravity" in found["docs"]
