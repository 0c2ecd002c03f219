"""The noise of a campaign from what needs no model, trials single; what films and tests measure beside the jumps."""

from __future__ import annotations

import json
import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_sample import diagnosis
from shared import later

from jumpvision.engine.detect import detect, directions
from jumpvision.engine.document.measured import CONTRADICT, compared
from jumpvision.engine.fitting import Problem
from jumpvision.engine.noise import readings
from jumpvision.engine.noise.learning import differences
from jumpvision.engine.noise.noise import Noise, Stretch, powers
from jumpvision.engine.noise.whitening import axes, joined
from jumpvision.engine.order import fit_baseline
from jumpvision.engine.priors import Measured, prior_of
from jumpvision.engine.system import Indexed, Parameter
from jumpvision.estimate.estimate import Estimate
from jumpvision.experiment.campaign.jumps import CONE, _read, _together
from jumpvision.experiment.results.values import Fits
from jumpvision.jumper.question import jumps as apparatus
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.jumps import Shared
from jumpvision.jumper.question.learning import learn_noise
from jumpvision.jumper.question.sources import of_stretches
from jumpvision.jumper.question.words import confirmed
from jumpvision.laboratory.blind import Nuisance, campaign, draw
from tests.worlds.jumps import jumps_of

FRAME = 0.005
NOISE = 5e-5  # m


def few(ground="hard", seed=1, trials=1, jumps="few", **world):
    """Four jumps of different conditions, the declared model true."""
    rng = np.random.default_rng([seed, 9])
    nuisance = Nuisance(**{"noise": NOISE, "rho": 0.0, "step": 0.0, **world})
    setting = draw(rng, ground=ground, hidden=(), nuisance=nuisance, trials=trials, jumps=jumps)
    return jumps_of(setting, campaign(setting, rng))


@pytest.fixture(scope="module")
def clean():
    return few()


def learned_of(made, **changed):
    jumps, fit, priors = made
    return learn_noise(Jumper([replace(j, **changed) for j in jumps], fit, priors, workers=1))


# -- single readings -----------------------------------------------------------------------------------------------


def test_single_readings_that_stand_off_are_found_with_their_size_and_the_others_left_alone():
    rng = np.random.default_rng(1)
    r = rng.standard_normal(400) + 3.0 * np.sin(np.arange(400) / 40.0)
    places, sizes = [0, 57, 130, 134, 300], [30.0, -12.0, 40.0, 25.0, 9.0]
    r[places] += sizes
    factor, off = readings.factors(r, 0.0)
    assert set(np.flatnonzero(off > readings.LISTED)) == set(places)
    # beyond BULK (3.5 sigma of white noise) a reading's factor is its distance over that: 4 is the noise of neighbours
    for i, size in zip(places, sizes):
        assert factor[i] == pytest.approx(abs(size) / (readings.BULK * readings.OWN), abs=4.0 / 3.5)
    assert np.mean(factor > 1.2) < 0.03


def test_what_a_source_says_of_a_noise_of_heavy_tails_is_as_uncertain_as_it_states():
    """Laplace's distribution has a kurtosis of 6: the logarithm of a standard deviation from n readings scatters by
    sqrt(5 / 4n), 1.6 times that of normal ones. 500 draws know their scatter to 3 %; three of these, and 1/n of 1 %."""
    rng, t, found = np.random.default_rng(21), np.arange(110) * FRAME, []
    for _ in range(500):
        stretch = Stretch(t, rng.laplace(0.0, NOISE / math.sqrt(2.0), t.size), powers(t, 1))
        found.append(of_stretches([stretch], Noise(NOISE, 0.0, FRAME), 6.0))
    assert np.std([math.log(f.sigma_m) for f in found]) == pytest.approx(found[0].log_sigma, rel=0.11)
    assert found[0].log_sigma == pytest.approx(math.sqrt(5.0 / 4.0 / 108.0), rel=1e-9)


# -- wander ----------------------------------------------------------------------------------------------------------


def test_differences_of_repeats_are_independent_and_each_has_the_noise_of_one():
    """As a matrix over the trials: its rows are orthonormal, and what all trials share is gone."""
    trials = [(y, np.ones(5)) for y in np.eye(5)]
    apart, spread = (np.array(x) for x in zip(*differences(trials)))
    np.testing.assert_allclose(apart @ apart.T, np.eye(4), atol=1e-15)
    np.testing.assert_allclose(apart.sum(axis=1), 0.0, atol=1e-15)
    np.testing.assert_allclose(spread, 1.0)


@pytest.mark.parametrize("rms", [0.0, 4.0])
def test_a_wander_is_learned_in_units_of_the_noise(rms):
    """Ten stretches of a whole record: sines of random period, not the process that the analysis assumes."""
    rng = np.random.default_rng(3)
    t, noise, reach = np.arange(300) * FRAME, Noise(1.0, 0.0, FRAME), 300 * FRAME / readings.SHARE
    found = []
    for _ in range(20):
        stretches = []
        for _ in range(10):
            slow = np.sin(2 * np.pi * t / rng.uniform(1.2, 4.0) + rng.uniform(0, 2 * np.pi)) * math.sqrt(2.0)
            stretches.append(Stretch(t, rms * slow + rng.standard_normal(t.size), powers(t, 0)))
        found.append(readings.learn(stretches, noise, reach))
    if rms:
        assert np.median(found) == pytest.approx(rms, rel=0.4)  # a level goes with the zero; ten courses
    else:
        assert np.median(found) < 0.2


# -- jumps -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("ground", "world"),
    [
        ("hard", {}),
        ("granular", {"rho": 0.7}),
        *later(("hard", {"family": "outliers"}), ("granular", {"drift": 5e-5}), ("hard", {"step": 1e-4})),
    ],
    ids=str,
)
def test_four_single_jumps_show_their_noise(ground, world):
    """Learned s of some 400 samples at rest and in flight: 4 % (white), 9 % (correlated 0.7), three of them allowed; of
    tracks that are rounded some 170 lie a step apart. A correlation is known to 1/sqrt(n)."""
    learned = learned_of(few(ground, **world))
    true = math.hypot(NOISE, world.get("step", 0.0) / math.sqrt(12.0))
    assert learned.sigma == pytest.approx(true, rel=0.27 if "rho" in world else 0.12)
    told = 3.0 / math.sqrt(min(learned.noise.n, 400))
    assert learned.noise.rho == pytest.approx(world.get("rho", 0.0), abs=told)
    assert learned.warnings == ()
    assert learned.scatter == {}  # single trials tell nothing of it
    assert bool(learned.outliers) == ("family" in world)


@pytest.mark.long
def test_tracks_that_differ_each_have_their_own():
    made = few("granular", seed=4, ratio=8.0, jumps="full")
    learned = learned_of(made)
    stated = np.array([np.median(j.sigma) for j in made[0]])
    hidden = learn_noise(Jumper([replace(j, sigma=None) for j in made[0]], *made[1:], workers=1))
    for found in (learned, hidden):
        off = np.log(found.noise.s * found.tracks / stated)
        assert np.std(off) < 0.15  # about 60 samples a track: 9 %
        assert abs(np.median(off)) < 0.06
    assert np.ptp(np.log(stated)) > 1.2


def test_flights_that_run_into_the_ground_are_not_taken_for_noise(clean):
    """What went wrong before: the whole jump as a flight, s 26 to 34 times too large, correlation at its end."""
    learned = learned_of(clean)
    assert learned.sources["flight"].n > 100
    assert learned.sources["flight"].sigma_m == pytest.approx(NOISE, rel=0.15)
    assert learned.sources["rest"].sigma_m == pytest.approx(NOISE, rel=0.2)
    assert learned.sources["repeats"] is None


# -- what tracks state ------------------------------------------------------------------------------------------------


def stating(jumps, sigma):
    return [replace(j, sigma=np.full(j.t.size, sigma)) for j in jumps]


def test_a_statement_far_from_what_is_seen_is_said_with_both_numbers(clean):
    jumps, fit, priors = clean
    learned = learn_noise(Jumper(stating(jumps, NOISE / 5), fit, priors, workers=1))
    (warning,) = learned.warnings
    assert "state a noise of 0.01 mm" in warning and "check sigma_m" in warning
    assert learned.noise.s == pytest.approx(NOISE, rel=0.12)  # the statement is not obeyed
    assert learn_noise(Jumper(stating(jumps, NOISE), fit, priors, workers=1)).warnings == ()


@pytest.mark.parametrize("bad", [0.0, math.nan])
def test_a_statement_that_is_none_is_left_out_and_its_track_named(clean, bad):
    jumps, fit, priors = clean
    jumps = stating(jumps, NOISE)
    jumps[2].sigma[5] = bad
    learned = learn_noise(Jumper(jumps, fit, priors, workers=1))
    (warning,) = learned.warnings
    assert jumps[2].name in warning and "must be above 0" in warning
    assert learned.noise.s == pytest.approx(NOISE, rel=0.12)


def test_without_rest_and_flight_the_statement_stands_unchecked_or_there_is_an_error(clean):
    """Tracks of the push alone: from the motor's start to its stop."""
    jumps, fit, priors = clean
    cut = []
    for j in jumps:
        keep = (j.t >= j.forcing.start) & (j.t < j.stop)
        cut.append(replace(j, t=j.t[keep], y=j.y[keep], sigma=None))
    with pytest.raises(ValueError, match=r"no track states its sigma_m.*film the robot at rest"):
        learn_noise(Jumper(cut, fit, priors, workers=1))
    learned = learn_noise(Jumper(stating(cut, 7e-5), fit, priors, workers=1))
    assert learned.noise.s == pytest.approx(7e-5)
    assert "nothing in the campaign checks it" in learned.warnings[0]
    assert learned.noise.log_sigma > 0.5


def test_rest_that_moves_is_told_from_flight(clean):
    jumps, fit, priors = clean
    shaken = []
    for j in jumps:
        rest = j.t < j.forcing.start
        y = j.y + np.where(rest, 4e-4 * np.sin(2 * np.pi * 45.0 * j.t), 0.0)
        shaken.append(replace(j, y=y, sigma=None))
    learned = learn_noise(Jumper(shaken, fit, priors, workers=1))
    assert any("at rest" in w and "sigma apart" in w for w in learned.warnings)
    assert learned.noise.s < 3 * NOISE  # that of the motion


# -- what is common ----------------------------------------------------------------------------------------------------


def test_common_errors_move_the_prediction_as_the_apparatus_would(clean):
    jumps, fit, priors = clean
    lens = [np.linspace(0.0, 1e-4, j.t.size) for j in jumps]
    shared = [Shared("camera", 0.01, 1e-3, 1e-3, c) for c in lens]
    system = Jumper([replace(j, shared=s) for j, s in zip(jumps, shared)], fit, priors, workers=1)
    names = {"scale[0]", "offset[0]", "rate[0]", "lens[0]"}
    assert names <= {p.name for p in system.baseline}
    at = {p.name: p.start for p in system.baseline}
    which = range(len(jumps))
    plain = system.predict((), at, which)
    for a, b in zip(plain, system.predict((), {**at, "scale[0]": 1.02}, which)):
        assert b == pytest.approx(1.02 * a, abs=1e-12)
    for i, (a, b) in enumerate(zip(plain, system.predict((), {**at, "lens[0]": 2.0}, which))):
        assert b - a == pytest.approx(2.0 * lens[i][: a.size], abs=1e-12)
    late = system.predict((), {**at, "offset[0]": FRAME}, which)
    for a, b in zip(plain, late):  # a frame later, but for the events' own rounding
        assert b[:-1] == pytest.approx(a[1:], abs=2e-8)
    rate = system.predict((), {**at, "rate[0]": 1e-4}, which)
    for o, a, b in zip(system.observations, plain, rate):
        speed = np.gradient(a, o.t)
        assert np.median(np.abs(b - a - 1e-4 * o.t * speed)) < 0.1 * np.median(np.abs(b - a))


def test_the_name_of_a_parameter_that_several_have_keeps_what_it_is_of():
    name = pickle.loads(pickle.dumps(Indexed("scale", 1)))
    assert name == "scale[1]" and (name.of, name.number) == ("scale", 1) and json.dumps({name: 1}) == '{"scale[1]": 1}'


def test_recordings_of_two_cameras_err_apart():
    jumps, fit, priors = few()
    shared = [Shared(f"camera {i % 2}", 0.01) for i in range(4)]
    system = Jumper([replace(j, shared=s) for j, s in zip(jumps, shared)], fit, priors, workers=1)
    at = {p.name: p.start for p in system.baseline}
    moved = system.predict((), {**at, "scale[1]": 1.1}, range(4))
    for i, (a, b) in enumerate(zip(system.predict((), at, range(4)), moved)):
        assert b == pytest.approx(a * (1.1 if i % 2 else 1.0), abs=1e-12)


def test_a_scale_that_is_off_by_what_is_stated_is_no_discrepancy(clean):
    """Heights 1.5 % too large: a camera_scale where the scale is taken as exact, within the prior where it is not."""
    jumps, fit, priors = clean
    off = [replace(j, y=1.015 * j.y) for j in jumps]
    verdict = {}
    for sigma in (0.0, 0.01):
        asked = [replace(j, shared=Shared("camera", sigma)) for j in off]
        learned = learn_noise(Jumper(asked, fit, priors, workers=1))
        problem = Problem(learned.system, learned.noise, learned.scatter)
        base = fit_baseline(problem, np.random.default_rng(1))
        verdict[sigma] = detect(problem, base, directions(problem, base), np.random.default_rng(1)).discrepant
        if sigma:
            assert base.named["scale[0]"] == pytest.approx(1.015, abs=3 * base.sigma("scale[0]"))
            assert apparatus.is_common(Indexed("scale", 0)) and not apparatus.is_common("scale")
    assert verdict == {0.0: True, 0.01: False}


# -- what is measured beside -------------------------------------------------------------------------------------------

FREE = (
    Parameter("mu", 2.2, 0.3, 6.0, 0.2, 0.4),
    Parameter("k", 100.0, 0.0, 200.0, 1.0),
    Parameter("theta", 1.0, 0.6, 1.45, 0.05, 0.1),
)


def test_priors_and_a_measurement_are_the_gaussians_they_state():
    m = Measured(("theta", "mu", "C"), np.array([1.1, 2.0, 9.0]), np.diag([0.02**2, 0.03**2, 1.0]) + 1e-4, "film")
    before = prior_of(FREE, [m])
    covariance = np.linalg.inv(before.precision + np.diag([0.0, 1e-9, 0.0]))
    sub = m.among(("mu", "theta"))
    assert sub.names == ("theta", "mu")
    prior, select = np.diag([0.1**2, 0.4**2]), np.linalg.inv(sub.covariance)
    expected = np.linalg.inv(select + np.linalg.inv(prior))
    assert covariance[np.ix_([2, 0], [2, 0])] == pytest.approx(expected, rel=1e-6)
    best = expected @ (select @ sub.values + np.linalg.inv(prior) @ [1.0, 2.2])
    x = np.array([best[1], 55.0, best[0]])
    assert before.rows.T @ before.pull(x) == pytest.approx(np.zeros(3), abs=1e-6)  # the minimum


def test_the_chance_of_a_measurement_is_that_of_the_prior_prediction():
    """ln p(m) / N(m | m, S) = ln N(m | c, S + P) - ln N(m | m, S), measurements one after the other as together."""
    a = Measured(("mu",), np.array([2.9]), np.array([[0.3**2]]), "film")
    expected = -0.5 * 0.7**2 / (0.3**2 + 0.4**2) - 0.5 * math.log((0.3**2 + 0.4**2) / 0.3**2)
    assert prior_of(FREE, [a]).log_chance == pytest.approx(expected)
    b = Measured(("mu",), np.array([2.5]), np.array([[0.2**2]]), "film")
    both = prior_of(FREE, [a, b]).log_chance
    covariance = np.full((2, 2), 0.4**2) + np.diag([0.3**2, 0.2**2])
    off = np.array([0.7, 0.3])
    together = -0.5 * off @ np.linalg.solve(covariance, off) - 0.5 * np.log(
        np.linalg.det(covariance) / (0.3 * 0.2) ** 2
    )
    assert both == pytest.approx(together)


def test_a_range_alone_says_of_a_measurement_what_its_mean_and_variance_say():
    """A parameter without a prior may lie anywhere in its range: numbers drawn there have the mean and the variance of
    the normal distribution that foretells its measurement."""
    q, drawn = Parameter("q", 3.0, 2.0, 10.0, 1.0), np.random.default_rng(4).uniform(2.0, 10.0, 1_000_000)
    m, s = 7.0, 0.5
    expected = -0.5 * (m - drawn.mean()) ** 2 / (s**2 + drawn.var()) - 0.5 * math.log((s**2 + drawn.var()) / s**2)
    measured = Measured(("q",), np.array([m]), np.array([[s**2]]), "film")
    assert prior_of((q,), [measured]).log_chance == pytest.approx(expected, abs=2e-3)


def test_axes_of_scatter_and_wander_are_those_of_both_together():
    rng = np.random.default_rng(7)
    slow, scatter = rng.standard_normal((50, 4)), rng.standard_normal((50, 2)) * 5.0
    twice = np.hstack([scatter, 2.0 * scatter[:, :1], np.zeros((50, 1))])  # no direction of their own
    for columns in (scatter, twice):
        q, size = joined(columns, axes(slow))
        both = np.hstack([columns, slow])
        assert q.shape == (50, 6)
        assert q.T @ q == pytest.approx(np.eye(6), abs=1e-12)
        assert (q * size**2) @ q.T == pytest.approx(both @ both.T, abs=1e-10)
    q, size = joined(np.zeros((50, 1)), (np.zeros((50, 0)), np.zeros(0)))
    assert q.shape == (50, 0) and size.size == 0


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
