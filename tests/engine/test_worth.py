"""What planned recordings could show, and which experiment is the next: against closed forms and integrals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import norm

import jumpvision as jv
from jumpvision.base.schema import InputError
from jumpvision.engine.detect import LEVEL, POWER
from jumpvision.engine.fitting import Problem
from jumpvision.engine.noise.noise import Noise
from jumpvision.engine.system import Candidate, Observation, Parameter
from jumpvision.engine.worth.design import Held, Prospect, prospect, worth
from jumpvision.experiment.campaign.offers import usual
from jumpvision.experiment.inputs.sections import Actuation

TIMES = np.linspace(0.0, 1.0, 41)
SIGMA = 0.01
# What a line leaves of a bend has the variance 1/180, the amounts of lift 2/3: a share 0.2 of the cousin is no bend.
# Beside it a bend shows at 1/sqrt(0.2) = 2.2 times the strength, less than the 3 of twins (but 0.2 * 3 < 1)
LIFTS = np.sqrt(0.25 / 180 / (2 / 3))


def line(p, r):
    """Its twin bends as it does, its ghost does nothing that the shared line does not, its cousin also lifts."""
    bend = p["c"] + 2.0 * p["same"] + p["cousin"]
    return p["a"] + (p["b"] + p["ghost"]) * r.t + bend * r.t**2 + r.inputs["up"] * (p["lift"] + LIFTS * p["cousin"])


def study(*, noise: float | None = SIGMA, only: tuple[str, ...] = ()) -> jv.Study:
    causes = {
        "bend": ("c", (-50, 50)),
        "twin": ("same", (-50, 50)),
        "ghost": ("ghost", (-1, 1)),
        "lift": ("lift", (-5, 5)),
        "cousin": ("cousin", (-5, 5)),
    }
    mechanisms = [
        jv.Mechanism(n, [jv.Parameter(p, 0.0, ends)]) for n, (p, ends) in causes.items() if n in (only or causes)
    ]
    missing = {p: 0.0 for n, (p, _) in causes.items() if n not in (only or causes)}

    def simulate(p, r):
        return line({**missing, **p}, r)

    shared = [jv.Parameter("a", 0.0, (-50, 50)), jv.Parameter("b", 0.0, (-50, 50))]
    return jv.Study(simulate, shared, mechanisms, [jv.Channel("x", "m", noise=noise, consider=())])


def recordings() -> list[jv.Recording]:
    """Three that are lifted by different amounts and not made yet."""
    return [jv.Recording(f"run {k}", TIMES, np.full(TIMES.size, np.nan), {"up": float(k)}) for k in range(3)]


@pytest.fixture(scope="module")
def planned():
    return jv.isolable(recordings(), study())


def test_causes_with_one_effect_are_twins(planned):
    rows = planned.table["not distinguishable from"]
    assert "twin" in rows["bend"] and "bend" in rows["twin"]
    assert "twin" not in rows["lift"] and "cousin" not in rows["bend"]
    assert "cannot be distinguished from another by these" in planned.sentence


def test_strengths_that_show_are_those_of_least_squares(planned):
    """What a fit of the line leaves of each cause's column, all recordings together. z less what the power takes is
    the threshold of a score: the largest of as many scores as there are causes is beyond it by chance in half of the
    level, as the test of a diagnosis has a second look. 400,000 draws: 0.01 to three times 0.00016."""
    design = np.tile(np.stack([np.ones(TIMES.size), TIMES], axis=1), (3, 1))
    bend = np.tile(TIMES**2, 3)
    columns = {"bend": bend, "twin": 2.0 * bend, "lift": np.repeat(np.arange(3.0), TIMES.size)}
    found, scores = {c.mechanism: c for c in planned.causes}, []
    for name, column in columns.items():
        left = column - design @ np.linalg.lstsq(design, column, rcond=None)[0]
        scores.append(found[name].from_ * np.linalg.norm(left) / SIGMA)
    z = scores[0]
    assert scores == pytest.approx([z] * 3, rel=1e-3) and found["bend"].parameter == "c"
    rng = np.random.default_rng(1)
    largest = np.abs(rng.standard_normal((400_000, len(planned.causes)))).max(axis=1)
    assert np.mean(largest > z - norm.ppf(POWER)) == pytest.approx(LEVEL / 2.0, abs=5e-4)


def test_what_the_fit_makes_itself_shows_nowhere(planned):
    assert planned.table["shows from"]["ghost"] == "no value in its range would show"
    assert "no value in their range would show: ghost" in planned.sentence


def test_a_drift_over_the_recordings_is_a_row(planned):
    assert {"drift of a", "drift of b", "drift of scale"} <= set(planned.table.index)
    assert planned.table["shows from"]["drift of input up"] == "no value in its range would show"  # without a lift


def test_noise_is_stated_where_nothing_is_recorded():
    with pytest.raises(InputError, match=r"recording 'run 0'.*noise of x is not stated.*Channel\('x', noise=\.\.\.\)"):
        jv.isolable(recordings(), study(noise=None))


def test_recordings_need_their_study():
    with pytest.raises(InputError, match="isolable: recordings need the study"):
        jv.isolable(recordings())


RNG = np.random.default_rng


def gaussians(means, roots=None):
    """A prospect of models whose parameters make `roots` (n, k) of the readings."""
    roots = roots or [np.zeros((len(means[0]), 1))] * len(means)
    return Prospect(tuple(np.asarray(m, float) for m in means), tuple(roots))


def test_log_odds_of_two_gaussians_are_half_their_distance_squared():
    """Equal covariance S = 1 + u u^T: the mean log-likelihood ratio is d^T S^-1 d / 2, linear in the readings, and
    antithetic draws are exact in what is linear."""
    d, u = np.array([1.0, -2.0, 0.5, 3.0]), np.array([[0.5], [1.0], [0.0], [2.0]])
    known = worth(gaussians([np.zeros(4), d]), [0.5, 0.5], RNG(0))
    assert known.log10_odds == pytest.approx(d @ d / 2 / math.log(10), rel=1e-9)
    unsure = worth(gaussians([np.zeros(4), d], [u, u]), [0.5, 0.5], RNG(0))
    expected = d @ np.linalg.solve(np.eye(4) + u @ u.T, d) / 2 / math.log(10)
    assert unsure.log10_odds == pytest.approx(expected, rel=1e-9)


def test_bits_are_the_mutual_information():
    """Three models in one dimension, of different spreads and weights, against the integral over the reading."""
    means, spreads, weights = [0.0, 1.5, 4.0], [0.0, 0.7, 1.5], [0.5, 0.3, 0.2]
    found = [
        worth(gaussians([[m] for m in means], [np.array([[s]]) for s in spreads]), weights, RNG(k)).bits
        for k in range(60)
    ]
    y = np.linspace(-15, 20, 40001)
    density = [
        np.exp(-0.5 * (y - m) ** 2 / (1 + s * s)) / math.sqrt(2 * math.pi * (1 + s * s)) for m, s in zip(means, spreads)
    ]
    mixed = sum(w * p for w, p in zip(weights, density))
    exact = sum(w * np.trapezoid(p * np.log2(np.maximum(p, 1e-300) / mixed), y) for w, p in zip(weights, density))
    error = np.std(found) / math.sqrt(len(found))
    assert np.mean(found) == pytest.approx(exact, abs=4 * error)
    assert error < 0.01


def test_what_parameters_can_mimic_tells_nothing():
    d = np.array([1.0, 2.0, -1.0])
    free = [1e4 * d[:, None]] * 2
    assert worth(gaussians([np.zeros(3), d], free), [0.5, 0.5], RNG(1)).bits < 1e-3


class Lines:
    """y = b t, with a t^2 or s sin(40 t) beside it; trials scatter by a multiple of cos(7 t)."""

    baseline = (Parameter("b", 1.0, -100.0, 100.0, 1.0),)
    candidates = {n: Candidate((Parameter(n, 0.0, -1e3, 1e3, 1.0),)) for n in ("a", "s")}  # noqa: RUF012

    def __init__(self, readings):
        self.observations = [Observation(f"o{k}", T, y, f"g{k}", f"c{k}") for k, y in enumerate(readings)]

    def predict(self, mechanisms, values, which):
        return [sum(values.get(n, 0.0) * x for n, x in COLUMNS.items())] * len(which)

    def scatter(self, mechanisms, values, which):
        return {"start": [np.cos(7 * T)] * len(which)}


T = np.linspace(0.0, 1.0, 100)
COLUMNS = {"b": T, "a": T**2, "s": np.sin(40 * T)}
NOISE, SCATTER = 0.02, 0.05


def test_a_linear_model_expects_what_least_squares_foretells():
    """Means and covariances of a second recording, from the first, by the normal equations: both beside an unknown
    zero level, with scatter in either; the whole matrix, to the 0.1 % of a derivative."""
    rng = RNG(5)
    made = T + 0.02 * T**2 + 0.02 * COLUMNS["s"] + 0.05 * rng.standard_normal() * np.cos(7 * T)
    problem = Problem(
        Lines([made + NOISE * rng.standard_normal(T.size), 0.0 * T]), Noise(NOISE, 0.0, 0.01), {"start": SCATTER}
    )
    fits = [problem.over((0,)).fit((m,)) for m in ("a", "s")]
    found = prospect(problem, [Held(f, 0.5) for f in fits], 1)
    level = np.eye(T.size) - 1.0 / T.size
    own = level @ np.cos(7 * T) * SCATTER / NOISE
    inverse = np.linalg.inv(np.eye(T.size) + np.outer(own, own))
    for fit, mean, spread in zip(fits, found.mean, found.spread):
        columns = np.stack([COLUMNS["b"], COLUMNS[fit.mechanisms[0]]], axis=1)
        design_ = level @ columns / NOISE
        np.testing.assert_allclose(mean, design_ @ [fit.named["b"], fit.named[fit.mechanisms[0]]], atol=1e-9)
        covariance = np.linalg.inv(design_.T @ inverse @ design_)
        expected = design_ @ covariance @ design_.T + np.outer(own, own)
        np.testing.assert_allclose(spread @ spread.T, expected, atol=2e-3 * np.abs(expected).max())


def test_half_cycle_jumps_about_those_that_were_run_are_offered():
    laws = [Actuation("single", f, a, start=0.2) for f, a in ((9.0, 0.004), (12.0, 0.005), (15.0, 0.005))]
    offered = usual([*laws, Actuation("custom")])
    assert len(offered) == len(set(offered)) == 9 * (1 + 1 + 3)
    assert {x.amplitude for x in offered} == {0.005} and {x.cycles for x in offered} == {1.0}
    frequencies = sorted({x.frequency for x in offered})
    assert (frequencies[0], frequencies[-1]) == pytest.approx((0.8 * 9.0, 1.25 * 15.0), abs=0.051)
    assert {(x.kind, x.delay) for x in offered} == {
        ("single", 0.0), ("stutter", 0.0), *(("delayed_stutter", d) for d in (0.05, 0.1, 0.2)),
    }  # fmt: skip
    assert {x.kind: x.phase for x in offered}["single"] == pytest.approx(1.5 * math.pi)
    assert usual([Actuation("custom")]) == []
