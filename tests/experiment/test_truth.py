"""What was found beside the truth: shown where truth.json states it, marked where it is outside 95 %, else nothing."""

from __future__ import annotations

import json
import math
import shutil

import numpy as np
import pytest
import xarray as xr
from diagnosis_sample import causes, confirmation, diagnosis, parameter
from shared import SAMPLES

from jumpvision.cli import terminal as show
from jumpvision.engine.document.values import Cause
from jumpvision.experiment.campaign.truth import (
    Truth,
    confirmation_rows,
    coverage_words,
    parameter_rows,
    true_added_mass,
    true_mass,
)
from jumpvision.experiment.inputs.experiment import open_campaign
from jumpvision.experiment.results.fields import Flow
from jumpvision.experiment.results.summary import Summary
from jumpvision.experiment.workflow.run import Outcome
from jumpvision.report.pages.page import causes_shown

SAND = SAMPLES / "loose_sand"
FILM = "stutter-7.0Hz-film"
TRUE = {"b": 17.2, "C": 2.7, "mu": 2.0, "theta": math.radians(60.0)}  # of truth.json


@pytest.fixture(scope="module")
def campaign():
    return open_campaign(SAND)


@pytest.fixture
def recorded(tmp_path):
    """Two experiments of the samples without any truth.json, as recordings are."""
    for name in ("stutter-7.0Hz-1", FILM):
        shutil.copytree(SAND / name, tmp_path / "sand" / name, ignore=shutil.ignore_patterns("truth.json"))
    shutil.copy(SAND / "campaign.toml", tmp_path / "sand")
    return open_campaign(tmp_path / "sand")


def diagnosed(named, parameters, rows=()):
    """One cause for each mechanism of the named model, and a rival."""
    rival = Cause("tilt", (), 0.9, (0.8, 0.95), 100.0, {"dg": parameter(0.1, 0.01, "m/s^2")})
    return diagnosis(named=tuple(named), causes=(*causes(tuple(named), parameters), rival), confirmation=tuple(rows))


def test_the_truth_stands_beside_each_parameter_and_is_marked_outside_95_per_cent(campaign):
    off = {"b": 1.95, "C": -1.95, "mu": 1.97, "theta": -3.0}  # sigmas, about the 1.96 of 95 %
    d = diagnosed(["depth_drag", "added_mass"], {n: parameter(TRUE[n] + 0.02 * z, 0.02) for n, z in off.items()})
    rows = {r["parameter"]: r for r in parameter_rows(d, campaign)}
    assert set(rows) == set(TRUE)  # not the rival's dg
    assert {n: r["true"] for n, r in rows.items()} == {"b": "17.200", "C": "2.700", "mu": "2.000", "theta": "1.047"}
    assert rows["b"]["fitted"] == "17.239 ± 0.020" and rows["b"]["90 %"] == "17.206 to 17.272"
    assert {n: r["truth is"] for n, r in rows.items()} == {
        "b": "inside 95 %", "C": "inside 95 %", "mu": "outside 95 % (2.0 sigma)", "theta": "outside 95 % (3.0 sigma)",
    }  # fmt: skip
    shown = [row["true"] for row in causes_shown(d, Truth.of(campaign))]
    assert shown[1:] == [""] and shown[0].endswith("; μ outside 95 % (2.0 σ), θ outside 95 % (3.0 σ)")


def test_what_the_truth_lacks_and_what_has_no_one_value_are_not_judged(campaign, tmp_path):
    (row,) = parameter_rows(diagnosed(["viscous_friction"], {"c_v": parameter(1.0, 0.1)}), campaign)
    assert (row["true"], row["truth is"]) == ("does not act", "")
    law = {"terms": ["depth_drag"], "parameters": {"b": [[0.57, 17.2], [0.63, 40.0]]}}
    (tmp_path / "truth.json").write_text(json.dumps(law))
    bare = type(campaign)(tmp_path, ())
    asked = diagnosed(["depth_drag"], {"b": parameter(17.2, 0.1)})
    (row,) = parameter_rows(asked, bare)
    assert (row["true"], row["truth is"]) == ("", "")
    (tmp_path / "truth.json").write_text(json.dumps({"terms": ["inertial_drag"], "parameters": {"b": 17.2}}))
    (row,) = parameter_rows(asked, bare)  # a number that no mechanism of the truth uses
    assert (row["true"], row["truth is"]) == ("does not act", "")


def test_nothing_is_said_of_a_truth_where_none_is_stated(recorded, capsys):
    d = diagnosed(["depth_drag"], {"b": parameter(17.0, 0.02)}, [confirmation("C", (2.7, 0.1), (2.6, 0.1))])
    assert not {"true", "truth is"} & {k for r in parameter_rows(d, recorded) for k in r}
    assert not {"true", "truth is"} & {k for r in confirmation_rows(d, recorded) for k in r}
    summary = Summary.of({"jump_height_m": 0.02, "sigma_m": 1e-5})
    assert coverage_words(recorded, [Outcome(FILM, recorded.path, summary=summary)]) == ""
    show.diagnosis(d, recorded, [], as_json=False)
    text = capsys.readouterr().out
    assert "17.000 ± 0.020" in text and "true" not in text and "95 %" not in text


def test_film_and_jumps_are_each_held_against_the_truth(campaign):
    """0.2 off: 2 sigma of the film's 0.1, 1 sigma of the jumps' 0.2."""
    rows = [confirmation("C", (2.8, 0.1), (2.6, 0.2)), confirmation("mu", (2.2, 0.1), (1.8, 0.2)),
            confirmation("b", (17.2, 0.1), (17.8, 0.2)), confirmation("mu", (2.1, 0.1), (3.0, 0.0))]  # fmt: skip
    shown = confirmation_rows(diagnosed([], {}, rows), campaign)
    assert [r["truth is"] for r in shown] == [
        "inside 95 %", "outside 95 % (2.0 sigma) by film", "outside 95 % (3.0 sigma) by the jumps", "inside 95 %",
    ]  # fmt: skip
    assert [r["z"] for r in shown[:3]] == ["+0.9", "+1.8", "-2.7"]
    assert shown[3]["jumps alone"] == "3.000"  # given, not fitted: nothing to judge


def test_the_true_mass_is_that_of_the_laboratorys_film(campaign):
    """Twice what the film's own truth has under half the foot, in every pair of frames in which the grains move.

    Over a pair the foot goes dz, so its middle is off the curve by at most |m''| dz^2 / 8, m'' = -C phi rho mu 2 pi r
    mu / tan(theta) with r < R; dz is the largest step from one pair to the next.
    """
    truth = json.loads((SAND / FILM / "truth.json").read_text())
    pairs = {k: np.array(truth["grain_film"]["pairs"][k]) for k in ("foot_depth_m", "added_mass_kg", "grains_move")}
    down = pairs["grains_move"] & (np.arange(pairs["grains_move"].size) < np.argmax(pairs["foot_depth_m"]))
    depth, mass = pairs["foot_depth_m"][down], 2.0 * pairs["added_mass_kg"][down]
    assert depth.size > 10
    bend = 2.7 * 571.0 * 2.0 * 2.0 * math.pi * 0.0381 * 2.0 / math.tan(TRUE["theta"])
    off = bend * np.max(np.diff(depth)) ** 2 / 8
    assert off < 0.01 * mass.min()
    for z, m in zip(depth, mass, strict=True):
        row = confirmation("added_mass", (0.1, 0.01), (0.1, 0.01), experiment=FILM, depth_m=float(z))
        assert true_mass(row, campaign, Truth.of(campaign)) == pytest.approx(m, abs=off)


def test_the_true_added_mass_is_that_of_the_time_it_was_measured_at():
    """Noise of the momentum moves its flat peak by a frame, where the foot slows down and the mass is another one."""
    pairs = {"time_s": [0.1, 0.102, 0.104, 0.106], "added_mass_in_view_kg": [0.063, 0.0687, 0.0754, 0.0]}
    mass = np.array([0.063, 0.069, 0.075, np.nan])
    for momentum, true in (([3.0, 4.01, 4.0, 4.2], 0.0687), ([3.0, 4.0, 4.01, 4.2], 0.0754)):
        values = {"momentum": ("t", momentum), "added_mass": ("t", mass)}
        field = xr.Dataset(values, coords={"t": np.array(pairs["time_s"]) + 1e-4})
        assert true_added_mass(pairs, Flow(field)) == true
    assert true_added_mass(pairs, Flow(field.assign(added_mass=field.added_mass * np.nan))) is None
