"""The model to predict new recordings with, where no cause can be named: held-out errors are those of exact fits, and
fresh recordings are predicted better than by the bare model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import jumpvision as jv
from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.engine.fitting import Problem
from jumpvision.engine.study.processes import How
from jumpvision.engine.study.question import problem_of, studied
from jumpvision.engine.study.runs import Runs
from jumpvision.engine.worth.gain import PARTS, best_at_prediction, held_out_error

T = np.linspace(0.0, 1.0, 41)


def line(p, r):
    return p["a"] + p["b"] * r.t + p["c"] * r.t**2


def lines(c: float = 0.0, rough: float = 0.0, seed: int = 3) -> list[jv.Recording]:
    """Six recordings of a parabola; rough: of a sine that no model has."""
    rng = np.random.default_rng(seed)
    shape = 1.0 + 2.0 * T + c * T**2 + rough * np.sin(9.0 * T)
    return [jv.Recording(f"run {k}", T, shape + 0.01 * rng.standard_normal(T.size)) for k in range(6)]


STUDY = jv.Study(
    line,
    [jv.Parameter("a", 0.0, (-50, 50)), jv.Parameter("b", 0.0, (-50, 50))],
    [jv.Mechanism("bend", [jv.Parameter("c", 0.0, (-50, 50))])],
    [jv.Channel("x", "m", noise=0.01, consider=())],
)


def system_of(recordings: list[jv.Recording]) -> Problem:
    return problem_of(studied(STUDY, recordings, Runs(STUDY, recordings, How())))


def test_held_out_errors_are_those_of_fits_without_the_part():
    """Of a model that is linear, exactly: each recording by least squares of the five others."""
    recordings = lines(c=0.3)
    problem = system_of(recordings)
    fit = problem.fit(("bend",))
    design = np.stack([np.ones(T.size), T, T**2], axis=1)
    expected = []
    for k in range(6):
        rest = np.concatenate([r.values for i, r in enumerate(recordings) if i != k])
        x = np.linalg.lstsq(np.tile(design, (5, 1)), rest, rcond=None)[0]
        expected.append(np.sum(((recordings[k].values - design @ x) / 0.01) ** 2))
    np.testing.assert_allclose(held_out_error(problem, fit), expected, rtol=1e-4)  # ranges as weak priors: 1e-6


def test_one_recording_is_held_out_in_pieces():
    problem = system_of(lines()[:1])
    error = held_out_error(problem, problem.fit())
    assert error.size == PARTS
    spread = np.sqrt(2 * T.size)  # of chi^2; an end that is extrapolated to has up to some ten times its own variance
    assert T.size - 3 * spread < error.sum() < 3 * (T.size + 3 * spread)


@pytest.mark.parametrize("c, mechanisms", [(0.0, ()), (0.3, ("bend",))])
def test_the_simpler_model_is_taken_where_both_are_level(c, mechanisms):
    problem = system_of(lines(c=c))
    fits = [problem.fit(()), problem.fit(("bend",))]
    assert best_at_prediction(problem, fits)[0].mechanisms == mechanisms


def test_a_model_is_left_to_predict_with_where_no_cause_is_named():
    """A sine that nothing lists stays; the bend that is listed makes a part of it."""
    found = jv.diagnose(lines(c=0.6, rough=0.05), STUDY)
    fresh = lines(c=0.6, rough=0.05, seed=4)

    def error(model) -> float:
        return float(np.sqrt(np.mean([(STUDY.predict(model, r)[:, 0] - r.values) ** 2 for r in fresh])))

    assert found.status == "undetermined"
    assert found.prediction.mechanisms == ("bend",)
    better = error(found.fitted) / error(found.prediction)
    assert better == pytest.approx(found.prediction.ratio, rel=0.1)  # 246 readings of noise a model: 6 %
    assert better > 1.3
    assert "to predict new recordings, not as a cause: the model with bend" in repr(found)
    assert Diagnosis.from_values(found.values).prediction == found.prediction


def test_a_named_model_predicts():
    found = jv.diagnose(lines(c=0.3), STUDY)
    assert found.named == found.prediction.mechanisms == ("bend",)
    assert found.prediction.parameters["c"].value == found.fitted["c"].value


def test_a_function_that_takes_the_simulator_s_place_predicts():
    bent = jv.Mechanism("bent", function=lambda p, r: line({**p, "c": 0.6}, r))
    study = replace(STUDY, simulate=lambda p, r: line({**p, "c": 0.0}, r), mechanisms=[bent])
    found = jv.diagnose(lines(c=0.6), study)
    assert found.prediction.mechanisms == found.named == ("bent",)
    # runs held out are of that function too: a curvature of 0.6 leaves 0.6 sqrt(1/180) = 45 mm rms beside 10 mm
    assert found.gain.ratio > 3.0
    off = study.predict(found.prediction, lines(c=0.6, seed=4)[0])[:, 0] - lines(c=0.6, seed=4)[0].values
    assert np.sqrt(np.mean(off**2)) < 0.01 * (1 + 4 / np.sqrt(2 * T.size))  # the noise
