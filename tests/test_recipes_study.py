"""The recipe "Add a study" of CONTRIBUTING.md in a copy of the package: two files, and all else follows."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import xarray as xr

import jumpvision

ROOT = Path(jumpvision.__file__).parent
DOCS = ROOT.parent / "docs"

STUDY = '''"""Heights against gravity (a study of the recipe)."""

import numpy as np

from jumpvision.physics.hard.jump import hard_sweep, sine_rows

from .compute import dataset
from .study import Found, Sweep, study


@study("weight", "hard", source="Fig 99", ranges={"gravity": np.linspace(1.0, 9.0, 5)}, values=("frequency",))
def weight(s: Sweep) -> Found:
    """Heights of the robot's own jump against gravity."""
    g, law = s.axis("gravity"), s.machine.values
    robot = {n: law[n] for n in ("motor_mass", "rod_mass", "stiffness", "damping", "landing_loss")}
    jumps = hard_sweep(sine_rows(law["frequency"], law["amplitude"], law["phase"], law["cycles"]), gravity=g, **robot)
    lost = jumps["com_height_m"][0] - jumps["com_height_m"][-1]
    data = dataset(s, {"gravity": g}, ("gravity",), jumps)
    return data, [s.number("height lost to gravity", f"{lost * 1e3:.1f} mm")]
'''
FIGURE = '''"""Figure of a study of the recipe."""

from jumpvision.report.studies.sweeps import figure_of
from jumpvision.studies.weight import weight


@figure_of(weight)
def heights(data, Figure):
    """Height against gravity."""
    figure = Figure(figsize=(4, 3))
    figure.subplots().plot(data.gravity, data.com_height_m, gid="drawn by the recipe")
    return figure
'''


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with the package and the new study; its other rooms are linked, so that their compiled code is known."""
    place = tmp_path_factory.mktemp("recipe")
    copy = place / "jumpvision"
    copy.mkdir()
    for part in ROOT.iterdir():
        if part.name in ("studies", "report"):
            shutil.copytree(part, copy / part.name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            (copy / part.name).symlink_to(part)
    (copy / "studies" / "weight.py").write_text(STUDY, encoding="utf-8")
    (copy / "report" / "studies" / "weight.py").write_text(FIGURE, encoding="utf-8")
    return place


def python(place, code, *words):
    done = subprocess.run(
        [sys.executable, "-c", code, *words],
        cwd=place,
        env=os.environ | {"PYTHONPATH": str(place)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


COMMAND = "import sys; from jumpvision.cli import main; sys.exit(main(sys.argv[1:]))"


def test_the_command_runs_it_by_name_and_draws_its_figure(place):
    words = ["--analysis", "weight", "--frequency", "8", "--json", "--workers", "1"]
    found = json.loads(python(place, COMMAND, "sweep", "hard", *words))
    assert [Path(f).name for f in found["files"]] == ["sweep.nc", "sweep.png"]
    assert found["numbers"][0]["quantity"] == "height lost to gravity"
    with xr.open_dataset(place / "results" / "sweep" / "sweep.nc") as data:
        assert data.attrs["analysis"] == "weight" and data.com_height_m.dims == ("gravity",)
        assert (data.com_height_m[:-1].values > data.com_height_m[1:].values).all()
    python(place, COMMAND, "figures", "results/sweep", "--format", "svg")
    assert "drawn by the recipe" in (place / "results" / "sweep" / "figures" / "sweep-weight.svg").read_text("utf-8")


def test_it_is_in_every_list(place):
    listed = json.loads(python(place, COMMAND, "sweep", "hard", "--analyses", "--json"))
    row = next(r for r in listed if r["analysis"] == "weight")
    assert row["thesis"] == "Fig 99" and row["shows"] == "Heights of the robot's own jump against gravity"
    table = python(place, "import sys; sys.path.append(sys.argv[1]); import tables; print(tables.text())", str(DOCS))
    assert "weight | Fig 99 | Heights of the robot's own jump against gravity" in table
    ask = "from jumpvision import api\ntry: api.sweep('hard', analysis='wieght')\nexcept ValueError as e: print(e)"
    assert "did you mean 'weight'" in python(place, ask)
