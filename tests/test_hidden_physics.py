"""Laws that no other part of the code knows: what a listed cause could pass for is not named in their place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from jumpvision.laboratory.blind import Nuisance, campaign, draw
from tests.worlds.hidden import _foreign, made, truth
from tests.worlds.jumps import Task, diagnose_jumps, jumps_of


def asked(number):
    """The diagnosis of a campaign of seed 21."""
    return diagnose_jumps(Task(*jumps_of(*made(truth(number), 21))))


def test_without_its_law_the_robot_of_the_foreign_laws_is_the_laboratorys():
    """Two integrators of different coordinates: both within 0.01 mm of the exact motion (tests/test_lab_blind.py)."""
    rng = np.random.default_rng(3)
    setting = draw(rng, ground="hard", hidden=(), nuisance=Nuisance(1e-9, 0.0, 0.0), jumps="few")
    none = replace(truth(5), outside="cable", amplitude=0.0, noise=0.0)
    for r in campaign(setting, rng):
        t, y = r.track["time_s"], r.track["height_m"]
        own = _foreign(none, setting, r, rng).track["height_m"]
        early = t < 0.55  # before bounces part two motions
        assert np.max(np.abs(own - (y - y[:10].mean()))[early]) < 2e-5


def test_what_is_less_likely_than_no_cause_is_not_named():
    """A spring that loses 1 to 6 % a second, in 0.2 mm of noise: p = 0.01, and a damping would pass (campaign 21)."""
    d = asked(21)
    assert not d.adequate and d.named == () and d.discovered is None and d.status != "partial"
    assert max(c.probability for c in d.causes) < 0.2


@pytest.mark.parametrize(("number", "form"), [(117, "abs(h / h_0)**n"), (125, "h / h_0 * h_rate")])
def test_a_fault_of_the_camera_that_a_listed_one_hides_is_not_named_as_it(number, form):
    """A bent perspective passes the test as a scale, rows that are read one by one as a delay (campaign 21)."""
    d = asked(number)
    assert d.named == () and form in d.discovered.law


def test_a_true_scale_is_named_beside_a_bent_perspective_that_could_be_it():
    rng = np.random.default_rng(9)
    setting = draw(rng, ground="hard", hidden=("camera_scale",), nuisance=Nuisance(2e-4, 0.0, 0.0), jumps="few")
    d = diagnose_jumps(Task(*jumps_of(setting, campaign(setting, rng))))
    assert d.named == ("camera_scale",) and d.discovered is None
