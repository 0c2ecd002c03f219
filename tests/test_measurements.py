"""What films and tests say beside the jumps: averaged by what is their own, and contradictions said in words."""

from __future__ import annotations

import math

import numpy as np
import pytest
from diagnosis_sample import diagnosis

from jumpvision.engine.document.measured import CONTRADICT, compared
from jumpvision.engine.priors import Measured
from jumpvision.estimate.estimate import Estimate
from jumpvision.experiment.campaign.jumps import CONE, _read, _together
from jumpvision.experiment.results.values import Fits
from jumpvision.jumper.question.words import confirmed

FITS = Fits(
    {
        "C": Estimate(2.7, 0.05, "", 9, 0.0, sigma_common=0.03),
        "mu_cone": Estimate(2.0, 0.02, "", 9, 0.0),
        "theta_cone_deg": Estimate(60.0, 0.5, "deg", 9, 0.0),
        "correlation_C_mu": Estimate(-0.5, 0.0, "", 9, 0.0),
        "correlation_mu_theta": Estimate(0.4, 0.0, "", 9, 0.0),
    }
)


def test_a_film_is_read_with_its_correlations_and_what_it_shares():
    seen, shared = _read(FITS, CONE, "film a")
    assert seen.names == ("C", "mu", "theta")
    assert seen.values == pytest.approx([2.7, 2.0, np.radians(60.0)])
    assert np.sqrt(np.diag(seen.covariance)) == pytest.approx([0.05, 0.02, np.radians(0.5)])
    own = seen.covariance - shared
    assert own[0, 1] == pytest.approx(-0.5 * 0.04 * 0.02)  # sqrt(0.05^2 - 0.03^2) = 0.04
    assert own[1, 2] == pytest.approx(0.4 * 0.02 * np.radians(0.5))
    assert shared[0, 0] == pytest.approx(0.03**2) and shared[1, 1] == 0.0
    nothing = Estimate(math.nan, math.nan, "", 0, math.nan, reason="no cone")
    assert _read(Fits({"C": nothing}), CONE, "film b") is None


def test_what_films_share_is_not_averaged_and_scatter_beyond_their_sigma_widens_the_mean():
    def films(offsets):
        return [
            ("x", Measured(("C",), np.array([2.7 + d]), np.array([[0.05**2]]), "film x"), np.array([[0.03**2]]))
            for d in offsets
        ]

    alike = _together("film", films(np.zeros(100)))
    assert alike.source == "100 grain films"
    assert alike.sigma("C") == pytest.approx(np.hypot(0.03, 0.04 / 10.0))  # not 0.05 / 10
    apart = _together("film", films([-0.2, 0.2, -0.2, 0.2]))
    chi2 = 4 * (0.2 / 0.04) ** 2
    assert apart.sigma("C") == pytest.approx(np.hypot(0.03, 0.04 / 2.0 * np.sqrt(chi2 / 3)))


@pytest.mark.parametrize("off, verdict", [(2.9, "agree"), (-3.1, "contradict")])
def test_a_contradiction_is_said_with_both_numbers(off, verdict):
    film = (2.0 + off * np.hypot(0.02, 0.03), 0.03)
    row = compared("mu", "film a", (2.0, 0.02), film, "1")
    assert row.z == pytest.approx(off) and (abs(off) > CONTRADICT) == (row.verdict == "contradict")
    assert row.verdict == verdict
    text = confirmed(diagnosis(confirmation=(row,), named=("added_mass",)))
    if verdict == "contradict":
        assert "contradict each other: mu is 1.89 ± 0.03 by film a, 2.00 ± 0.02 by the jumps alone (3.1 sigma" in text
    else:
        assert text is None  # no mass beside it
