"""`jumpvision dem`: a lattice's triangle, the mass of what moves, what made the files, errors that name the field."""

import json
import math

import numpy as np
import pytest
import xarray as xr

from jumpvision.cli import main
from jumpvision.laboratory.dem.discs import Box
from jumpvision.laboratory.dem.packing import lattice
from jumpvision.laboratory.dem.plug import plug_of

SMALL = ["--foot", "0.008", "--half-width", "0.02", "--depth", "0.03", "--stroke", "0.003", "--no-pictures"]


@pytest.mark.parametrize(
    "kind, fraction, neighbours", [("hexagonal", math.pi / math.sqrt(12.0), 6), ("square", math.pi / 4, 4)]
)
def test_touching_lattices_touch_their_neighbours(kind, fraction, neighbours):
    d = lattice(kind, Box(-0.01, 0.01, -0.02, 0.0), fraction, diameter=1e-3, density=1.0)
    apart = np.hypot(d.x[:, None] - d.x, d.y[:, None] - d.y)
    middle = np.argmin(np.hypot(d.x, d.y + 0.01))
    assert np.sum(np.isclose(apart[middle], 1e-3, rtol=1e-9)) == neighbours
    assert np.sort(d.x) == pytest.approx(np.sort(-d.x))  # the axis is a mirror
    assert np.sort(apart[middle])[1] >= 1e-3 * (1.0 - 1e-9)


def test_a_drawn_triangle_is_measured():
    """Discs inside a wedge of 50 degrees go with the foot: theta within a grain over the front, 2 degrees.

    The front is that of a column three grains wide: 0.75 grains * tan(50 degrees) short of the tip, and half a grain.
    """
    d = lattice("hexagonal", Box(-0.05, 0.05, -0.06, 0.0), 0.9, diameter=1e-3, density=1.0)
    foot, slope = 0.02, math.tan(math.radians(50.0))
    inside = np.abs(d.x) < foot + d.y / slope
    p = plug_of(d.x, d.y, np.where(inside, -1.0, -0.3), d.mass, d.radius, foot_y=0.0, foot_v=-1.0)
    assert p.theta == pytest.approx(50.0, abs=2.0)
    assert p.front == pytest.approx(foot * slope, abs=1.5e-3)
    assert p.plug == pytest.approx(d.mass[inside].sum())
    assert p.momentum == pytest.approx(d.mass[inside].sum() + 0.3 * d.mass[~inside].sum())


def test_a_hexagonal_lattice_makes_the_triangle_of_sixty_degrees(tmp_path):
    """Thesis Fig 53, without friction: its sides are rows of the lattice; a foot of 16 grains leaves 3 degrees."""
    assert main(["dem", "--bed", "hexagonal", *SMALL, "--results", str(tmp_path)]) == 0
    told = json.loads((tmp_path / "dem.json").read_text())
    assert told["numbers"]["theta_deg"] == pytest.approx(60.0, abs=3.0)
    assert told["bed"]["bed"] == "hexagonal" and "numba" in told["versions"] and told["command"]
    with xr.open_dataset(tmp_path / "dem.nc") as data:
        assert data.front.units == "m" and json.loads(data.attrs["bed"])["foot"] == 0.008
        last = data.isel(t=-1, bed=0)
        fall = (data.y.isel(t=-1) - data.y.isel(t=-2)).values / float(data.t[-1] - data.t[-2])
        sink = float(data.foot_y[0, -1] - data.foot_y[0, -2]) / float(data.t[-1] - data.t[-2])
        below = last.y.values < float(last.foot_y)
        own = float((data.mass.values * fall)[below].sum()) / sink
        assert float(last.added_mass) == pytest.approx(own, rel=1e-3)  # the discs' own momentum over the foot's speed
        assert float(last.plug) < float(last.added_mass)


def test_random_beds_scatter_and_are_the_same_again(tmp_path):
    args = ["dem", "--fraction", "0.6", "--friction", "0.5", *SMALL, "--beds", "2"]
    for name, workers in (("a", "2"), ("b", "1")):
        assert main([*args, "--workers", workers, "--results", str(tmp_path / name)]) == 0
    a, b = (json.loads((tmp_path / n / "dem.json").read_text())["numbers"] for n in "ab")
    assert a == b
    assert 0.0 < a["added_mass_sigma_kg"] < 0.5 * a["added_mass_kg"]


@pytest.mark.parametrize(
    "args, words",
    [
        (["--bed", "cubic"], ("bed", "cubic", "hexagonal")),
        (["--fraction", "0.9", "--bed", "square"], ("fraction", "0.9", "square", "touch")),
        (["--foot", "0.04", "--half-width", "0.045"], ("foot", "0.04", "half_width")),
        (["--speed", "nan"], ("speed", "must be")),
        (["--beds", "0"], ("beds", "0")),
    ],
)
def test_bad_input_is_named_and_writes_nothing(tmp_path, capsys, args, words):
    assert main(["dem", *args, "--results", str(tmp_path / "r")]) == 2
    said = capsys.readouterr().err
    assert all(word in said for word in words), said
    assert not (tmp_path / "r").exists()
