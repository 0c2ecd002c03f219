"""Discs beside a film (thesis Fig 53b, c): a film that is itself one of discs has the scale factor 1."""

import json
import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from conftest import SAMPLES

from jumpvision.cli import main
from jumpvision.experiment.inputs.parameters import FlowParams
from jumpvision.experiment.inputs.sections import GrainVideo, Robot
from jumpvision.experiment.stages.grains.flow import Sums, under_the_foot
from jumpvision.laboratory.dem.motion import Friction, discs_under_foot
from jumpvision.report.style import kind_of
from jumpvision.thesis.studies.sand import beside
from jumpvision.thesis.studies.sand.disc_field import field_of_discs
from jumpvision.thesis.studies.sand.discs import checked

FOOT, DENSITY, WIDTH = 0.008, 570.0, 1.5e-3
BED = checked({"diameter": 1e-3, "carpet": 40.0})
VIDEO = GrainVideo(file="discs", frame_rate=500.0, scale=1e-3, foot="half", foot_row=1.0, axis_column=1.0)
PLUNGE = 8e-3  # m


@pytest.fixture(scope="module")
def film() -> beside.Film:
    """A plunge of 8 mm in 30 ms, from the surface: discs of seed 3 in a bed of 40 x 30 mm, read as a film is."""
    times = np.arange(0.0, 0.0361, 2e-3)
    face = -PLUNGE * np.sin(0.5 * math.pi * np.clip(times / 0.03, 0.0, 1.0)) ** 2
    x, y = np.arange(-0.0155, 0.016, 1e-3), np.arange(-0.0195, 0.0, 1e-3)
    bed = (beside.WIDER * 0.016, beside.DEEPER * 0.02)
    discs, m = discs_under_foot(
        times, face, times, half_width=FOOT, bed=bed, diameter=1e-3, fraction=BED.filled,
        rng=np.random.default_rng(3), friction=Friction(40.0),
    )  # fmt: skip
    piv = field_of_discs(times, m.x, m.y, discs.mass, m.foot_y, grid_x=x, grid_y=y, width=WIDTH)
    read = under_the_foot(piv, Sums(piv.geometry, "half", DENSITY), VIDEO, Robot(foot_radius=FOOT), FlowParams())
    flow = xr.Dataset({n: ("t", v) for n, (v, _) in read.items()}, coords={"t": piv.field.t})
    return beside.Film("plunge", "single", piv, flow, FOOT, DENSITY, VIDEO, FlowParams())


def test_the_path_of_the_film_is_the_foot_s(film):
    """Means of means of neighbours: each misses a parabola of 22 m/s^2 over 2 ms by 11 um, 44 um at its kink."""
    times, face = beside.path_of(film)
    assert times == pytest.approx(np.arange(0.0, 0.0361, 2e-3), abs=1e-12)
    truth = -PLUNGE * np.sin(0.5 * math.pi * np.clip(times / 0.03, 0.0, 1.0)) ** 2
    assert face[1:-1] == pytest.approx(truth[1:-1], abs=11e-6 + 44e-6)
    assert 0.0 <= beside.hole_of(film) < 3e-4  # it is slower than min_speed before


def test_discs_beside_a_film_of_discs_have_the_scale_factor_one(film):
    """The same bed again, under the foot as filmed: 3 %, frames 10 %, since impacts part the ways of single grains.

    Another bed of the kind is as far off as beds differ; half the momentum is half the factor.
    """
    same, other = beside.read_discs(3, film, BED), beside.read_discs(4, film, BED)
    one = beside.compared(film, [same])
    assert one.scale == pytest.approx(1.0, abs=0.03) and one.scale_sigma is None and one.left < 0.1
    both = beside.compared(film, [same, other])
    assert both.scale_sigma == pytest.approx(
        abs(one.scale - beside.compared(film, [other]).scale) / 2.0, rel=1e-6
    )  # standard deviation of two over sqrt(2)
    half = film.flow.assign(momentum=0.5 * film.flow.momentum)
    assert beside.compared(replace(film, flow=half), [same]).scale == pytest.approx(0.5 * one.scale, rel=1e-9)
    table = beside.table_of(film, [same, other])
    assert len(table) == film.flow.sizes["t"] and table.momentum_discs_kg_m_s.max() > 0.0


def test_the_command_writes_what_the_page_says(film, tmp_path, monkeypatch):
    monkeypatch.setattr(beside, "film_of", lambda folder, results: film)
    asked = ["dem", "--experiment", "plunge", "--diameter", "0.001", "--carpet", "40", "--beds", "1", "--workers", "1"]
    assert main([*asked, "--results", str(tmp_path)]) == 0
    told = json.loads((tmp_path / "dem.json").read_text())
    assert told["films"][0]["experiment"] == "plunge" and 0.7 < told["films"][0]["scale"] < 1.4
    assert {"momentum_film_kg_m_s", "added_mass_discs_kg"} < set(pd.read_csv(tmp_path / "dem.csv"))
    assert (tmp_path / "dem.png").exists()


JUMPS = ("grain_films/single-7.0Hz", "loose_sand/stutter-7.0Hz-film", "grain_films/delayed_stutter-7.0Hz")


@pytest.mark.long
def test_three_jumps_on_film_stand_beside_each_other(tmp_path, monkeypatch):
    """Thesis Fig 52, right inset, against truth.json: momentum from a tenth of the peak on within 5 % of the
    peak; the stutter moves most, and over depth all have the mass of one cone."""
    found = {}
    monkeypatch.setattr("jumpvision.thesis.figures.matter.png", lambda figure: found.update(figure=figure) or b"")
    asked = [w for name in JUMPS for w in ("--experiment", str(SAMPLES / name))]
    assert main(["dem", *asked, "--beds", "0", "--workers", "1", "--results", str(tmp_path)]) == 0
    table = pd.read_csv(tmp_path / "dem.csv")
    assert not any("discs" in c for c in table)
    peaks = {}
    for name in JUMPS:
        one = table[table.experiment == name.partition("/")[2]]
        true = json.loads((SAMPLES / name / "truth.json").read_text())["grain_film"]["pairs"]
        at = {k: np.interp(one.time_s, true["time_s"], true[k]) for k in ("momentum_in_view_kg_m_s", "foot_depth_m")}
        p, seen = at["momentum_in_view_kg_m_s"], one.momentum_film_kg_m_s
        use = p > 0.1 * p.max()
        assert use.sum() >= 12 and np.abs(seen - p)[use].max() < 0.05 * p.max(), name
        # within 1.5 pixels of either camera, which all frames share: where on the foot its face lies
        assert one.foot_depth_m.to_numpy() == pytest.approx(at["foot_depth_m"], abs=5e-4), name
        mass = np.array(true["added_mass_in_view_kg"])
        pushed = use & one.added_mass_film_kg.notna() & (np.interp(one.time_s, true["time_s"], mass > 0) == 1.0)
        assert pushed.sum() >= 11, name
        peaks[name] = p.max()
        ours = one.added_mass_film_kg[pushed]
        assert ours.to_numpy() == pytest.approx(np.interp(one.time_s, true["time_s"], mass)[pushed], rel=0.1), name
    assert peaks[JUMPS[1]] > 2.0 * max(peaks[JUMPS[0]], peaks[JUMPS[2]])
    left, right = found["figure"].axes
    looks = [kind_of(k).color for k in ("single", "stutter", "delayed_stutter")]
    for axis in (left, right):
        assert [line.get_color() for line in axis.lines] == looks
    assert np.sort(left.lines[1].get_ydata())[-1] == pytest.approx(57.7, abs=0.5)  # docs/dem.md


@pytest.mark.parametrize(
    "words, said",
    [
        (["--speed", "0.3"], "--speed: with --experiment it follows from the film"),
        (["--bed", "hexagonal"], "--bed hexagonal: with --experiment the bed is random"),
        ([], "[grain_video] or [piv_field], [robot] foot_radius, [bed] volume_fraction"),
    ],
)
def test_what_cannot_stand_beside_a_film_is_said(tmp_path, capsys, words, said):
    (tmp_path / "e").mkdir()
    (tmp_path / "e" / "experiment.toml").write_text('ground = "granular"\n')
    assert main(["dem", "--experiment", str(tmp_path / "e"), *words, "--results", str(tmp_path / "r")]) == 2
    assert said in capsys.readouterr().err
