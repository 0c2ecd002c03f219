"""A number of [robot], a scale or a frame rate that is wrong is told by the declared model; a wrong ground is not
mistaken for one.

Truth: jumps of the laboratory, whose solver is its own, with noise in the track.
"""

from __future__ import annotations

import shutil

import numpy as np
import pandas as pd
import pytest
import tomlkit
from scipy.signal import bilinear, lfilter

from jumpvision.estimate.push import TICK, Pushed
from jumpvision.experiment.campaign.folder import as_campaign
from jumpvision.experiment.inputs.experiment import open_folder
from jumpvision.experiment.results.tables import RodMotion
from jumpvision.experiment.stages.modelled import modelled
from jumpvision.experiment.stages.preflight import made_now, preflight
from jumpvision.laboratory.campaign import write_campaign
from jumpvision.laboratory.protocol import MotorLog, Protocol, Records, RodTrack, jumps_of
from jumpvision.laboratory.samples import SAND_ROBOT

TERMS = ("two_resistance", "inertial_drag")
VALUES = {"k1": 2400.0, "k2": 1800.0, "delta": 0.012, "alpha": 60.0}


@pytest.fixture(scope="module")
def sand(tmp_path_factory):
    world = Protocol(
        SAND_ROBOT,
        jumps_of("stutter", [7.5], [0.016]),
        Records(rod_track=RodTrack(500.0, 3e-5, family="t3"), motor_log=MotorLog()),
        terms=TERMS,
        parameters=VALUES,
        duration=0.9,
        model={"terms": TERMS, **VALUES},
    )
    place = tmp_path_factory.mktemp("sand") / "c"
    write_campaign(place, world, seed=3)
    return place


def edited(campaign, place, section, key, factor):
    shutil.copytree(campaign, place)
    document = tomlkit.parse((place / "campaign.toml").read_text())
    document[section][key] = factor * float(document[section][key])
    (place / "campaign.toml").write_text(tomlkit.dumps(document))
    return as_campaign(open_folder(place)).experiments[0]


def said_of(e):
    confirmed, doubts = modelled("rod_track", e, made_now(e, RodMotion), None)
    return confirmed, [(d.kind, d.recording, d.values) for d in doubts]


def test_a_wrong_number_of_the_robot_is_told_with_the_right_one(sand, tmp_path):
    """The right one within 2 %: a ripple of 30 um in a motion of 60 mm leaves a part in 1000, the grid's end 3e-3."""
    for key, factor, true in (("spring_stiffness", 2.5, 3300.0), ("motor_mass", 0.5, 1.125)):
        e = edited(sand, tmp_path / key, "robot", key, factor)
        confirmed, [(kind, where, values)] = said_of(e)
        assert (confirmed, kind, where) == (False, "differs", "robot")
        assert values[key] == pytest.approx(true, rel=0.02)
    assert ("differs", "robot") in [(t["kind"], t["recording"]) for t in preflight(e)[1]]


def test_a_wrong_ground_is_none_of_these(sand, tmp_path):
    for key, factor in (("k1", 0.5), ("alpha", 3.0), ("delta", 0.5)):
        assert said_of(edited(sand, tmp_path / key, "model", key, factor))[1] == [], key


@pytest.mark.parametrize(
    ("change", "kind", "name", "true"),
    [
        (lambda d: d.assign(height_m=1.1 * d.height_m), "scale", "factor", 1 / 1.1),
        (lambda d: d.assign(height_m=-d.height_m), "sign", "factor", -1.0),
        (lambda d: d.assign(time_s=0.2 + 1.3 * (d.time_s - 0.2)), "clock", "pace", 1 / 1.3),
    ],
)
def test_a_wrong_track_is_told_with_its_factor(sand, tmp_path, change, kind, name, true):
    e = edited(sand, tmp_path / "c", "robot", "gravity", 1.0)
    file = e.path / "rod_track.csv"
    change(pd.read_csv(file, comment="#")).to_csv(file, index=False)
    confirmed, [(told, where, values)] = said_of(e)
    assert (confirmed, told, where) == (False, kind, "rod_track")
    assert values[name] == pytest.approx(true, rel=0.01)


def test_a_model_that_follows_confirms_and_one_without_values_says_nothing(sand, tmp_path):
    assert said_of(edited(sand, tmp_path / "c", "robot", "gravity", 1.0)) == (True, [])
    e = edited(sand, tmp_path / "d", "robot", "gravity", 1.0)
    toml = (tmp_path / "d" / "campaign.toml").read_text()
    (tmp_path / "d" / "campaign.toml").write_text(
        toml.replace("alpha = 60.0\n", "") + "[model.fit]\nalpha = [0.0, 300.0]\n"
    )
    e = as_campaign(open_folder(tmp_path / "d")).experiments[0]
    assert said_of(e) == (False, [])


def test_the_motors_push_is_filtered_as_scipy_would():
    """To the last bit: the same substitution s = 2/T (z - 1)/(z + 1), without its polynomials as objects."""
    x = np.sin(40.0 * TICK * np.arange(300)) ** 2
    pushed = Pushed(TICK * np.arange(300), x, 0.83, 60.0, 0.1, 1e-3)
    for w, damping in ((18.0, 0.0), (210.0, 1.7)):
        b, a = bilinear([0.83, 0.0, 0.0], [1.0, 2.0 * damping * w, w * w], 1.0 / TICK)
        assert np.array_equal(pushed.moved(w, damping), -lfilter(b, a, x - x[0]))
