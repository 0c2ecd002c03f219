"""The diagnosis on systems whose truth is known: noise, detection, naming, gain, next experiment."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.optimize import minimize
from shared import later

from jumpvision.engine.detect import detect, directions
from jumpvision.engine.fitting import Problem, log_volume
from jumpvision.engine.naming import held_out_score, least_doubt
from jumpvision.engine.noise.noise import (
    Noise,
    Stretch,
    coefficients,
    estimate,
    of_rounded,
    powers,
    rounding_step,
    spread_of,
    step_apart,
)
from jumpvision.engine.noise.whitening import Whitening
from jumpvision.engine.order import Order, fit_baseline
from jumpvision.engine.system import Candidate, Observation, Parameter
from jumpvision.engine.worth.gain import gain, ratio_interval

FRAME = 0.005


def coloured(rng, n, s, rho):
    """First-order autoregression, standard deviation s."""
    e = rng.standard_normal(n)
    for i in range(1, n):
        e[i] = rho * e[i - 1] + math.sqrt(1 - rho * rho) * e[i]
    return s * e


class Falling:
    """y = c + v t - g t^2/2 + what candidates add: linear in nearly everything, so that truth is in closed form."""

    baseline = (Parameter("v", 1.0, -10.0, 10.0, 0.1), Parameter("g", 9.8, 5.0, 15.0, 0.1, sigma=0.5))
    candidates = {  # noqa: RUF012
        "cubic": Candidate((Parameter("a", 0.0, -50.0, 50.0, 1.0),)),
        "wave": Candidate(
            (Parameter("w", 0.0, -5.0, 5.0, 0.1), Parameter("f", 12.0, 4.0, 40.0, 1.0)),
            shapes=tuple((f,) for f in np.arange(6.0, 21.0, 2.0)),
        ),
        "kink": Candidate((Parameter("q", 0.0, -20.0, 20.0, 1.0),)),
        "twin": Candidate((Parameter("h", 0.0, -50.0, 50.0, 1.0),)),  # of kink, but for a millionth
    }

    def __init__(self, rng, s, rho=0.0, n=12, bed=0.0, zero=1.0, **truth):
        self.observations = []
        for i in range(n):
            t = np.arange(60) * FRAME
            values = {"v": 1.2, "g": 9.8, **truth}
            y = self._motion(t, tuple(truth), values) * (1.0 + bed * rng.standard_normal())
            y = y + coloured(rng, t.size, s, rho) + zero * rng.uniform(-1, 1)
            labels = {"kind": ("low", "high")[i % 2]}
            self.observations.append(Observation(f"run {i}", t, y, f"group {i // 2}", f"condition {i // 2}", labels))

    @staticmethod
    def _motion(t, mechanisms, p):
        y = p["v"] * t - 0.5 * p["g"] * t * t
        if "a" in p:
            y = y + p["a"] * t**3
        if "w" in p:
            y = y + p["w"] * np.sin(p["f"] * t * 2 * math.pi)
        for name, off in (("q", 0.0), ("h", 1e-4)):
            if name in p:
                y = y + p[name] * np.maximum(t - 0.15 - off, 0.0)
        return y

    def predict(self, mechanisms, values: Mapping[str, float], which: Sequence[int]):
        names = [p.name for m in mechanisms for p in self.candidates[m].parameters]
        p = {n: values[n] for n in ("v", "g", *names)}
        return [self._motion(self.observations[i].t, mechanisms, p) for i in which]

    def scatter(self, mechanisms, values, which):
        return {"bed": self.predict(mechanisms, values, which)}


def questioned(rng, **kw):
    s, rho = kw.pop("s", 1e-3), kw.get("rho", 0.0)
    system = Falling(rng, s, **kw)
    return system, Noise(s, rho, FRAME, 0.0, 10_000)


# -- noise ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rho", [0.7, *later(0.0)])
def test_noise_is_learned_and_its_uncertainty_is_true(rho):
    """Low-frequency power s_e^2 / (1 - rho)^2 against its stated uncertainty: 68 % within 1 sigma."""
    rng = np.random.default_rng(3)
    pulls, scales = [], []
    t = np.arange(40) * FRAME
    for _ in range(120):
        stretches = [Stretch(t, coloured(rng, 40, 2e-3, rho) + 0.3 - t, powers(t, 1)) for _ in range(12)]
        found = estimate(stretches, FRAME)
        power = found.s**2 * (1 + found.rho) / (1 - found.rho)
        pulls.append(math.log(power / (4e-6 * (1 + rho) / (1 - rho))) / found.log_sigma)
        scales.append(found.s)
    assert np.median(scales) == pytest.approx(2e-3, rel=0.03)
    # rho >= 0 is known, so at 0 the interval is wide; 120 draws: +-0.13 is three binomial sigmas
    assert (0.55 if rho else 0.6) < np.mean(np.abs(pulls) < 1) < (0.82 if rho else 1.01)


def test_whitened_noise_is_white_of_unit_variance_also_over_gaps():
    rng = np.random.default_rng(4)
    r = coloured(rng, 40_000, 2.0, 0.6)
    keep = np.sort(rng.choice(40_000, 30_000, replace=False))
    white = Noise(2.0, 0.6, FRAME).whiten(keep * FRAME, r[keep])
    assert white.std() == pytest.approx(1.0, abs=0.015)  # 30,000 numbers: 0.004
    assert np.corrcoef(white[1:], white[:-1])[0, 1] == pytest.approx(0.0, abs=0.02)


def test_too_little_rest_is_said():
    with pytest.raises(ValueError, match=r"at least 20 .* repeat recordings"):
        estimate([Stretch(np.arange(10) * FRAME, np.zeros(10), powers(np.arange(10) * FRAME, 0))], FRAME)


def test_rounding_is_seen_and_a_motion_within_a_step_counts_once():
    t = np.linspace(0, 1, 400)
    y = np.round(0.05 * np.sin(2 * t) / 1e-3) * 1e-3
    assert rounding_step(y) == pytest.approx(1e-3)
    assert rounding_step(np.random.default_rng(0).normal(size=400)) == 0.0
    assert step_apart(np.array([0, 0.2, -0.9, 1.1, 1.5, 2.2, 1.3, 1.1]), 1.0).tolist() == [0, 3, 5, 7]


@pytest.mark.parametrize("sigma", [0.02, 0.2, 0.6])
def test_noise_of_rounded_readings_from_repeated_ones(sigma):
    """Pairs of readings of one motion in steps of 1: what they share is added; within 1 % (200,000 pairs: 0.3 %)."""
    rng = np.random.default_rng(8)
    true = rng.uniform(0.0, 1.0, 200_000)
    a, b = (np.round(true + sigma * rng.standard_normal(true.size)) for _ in range(2))
    s = np.std(a - b) / math.sqrt(2.0)
    assert of_rounded(s, 1.0) == pytest.approx(np.std(a - true), rel=0.01)


def test_scatter_between_trials_is_told_from_the_error_of_its_estimates():
    rng = np.random.default_rng(5)
    v = np.full(30, 0.5**2)
    with_scatter = [spread_of(list(zip(rng.normal(0, math.hypot(2.0, 0.5), 30), v))) for _ in range(60)]
    without = [spread_of(list(zip(rng.normal(0, 0.5, 30), v))) for _ in range(60)]
    assert np.median(with_scatter) == pytest.approx(2.0, rel=0.1)
    assert np.mean(np.array(without) > 0) < 0.2  # 5 % expected; 60 draws
    t = np.arange(50) * FRAME
    c, var = coefficients(Noise(0.1, 0.3, FRAME), Stretch(t, 2.0 + 3.0 * t, np.column_stack([np.ones(50), t])))
    assert c == pytest.approx([2.0, 3.0], rel=1e-9)
    assert (var > 0).all()


# -- fit and detection ---------------------------------------------------------------------------------------


def test_a_fit_is_the_generalised_least_squares_solution():
    system, noise = questioned(np.random.default_rng(6), rho=0.5)
    fit = Problem(system, noise).fit()
    rows, rhs = [], []
    for o in system.observations:
        rows.append(Whitening(noise, o).levelled(np.column_stack([o.t, -0.5 * o.t**2])))
        rhs.append(Whitening(noise, o).levelled(o.y))
    rows.append(np.array([[0.0, 1 / 0.5]]))  # the prior on g
    rhs.append(np.array([9.8 / 0.5]))
    expected, *_ = np.linalg.lstsq(np.vstack(rows), np.concatenate(rhs), rcond=None)
    covariance = np.linalg.inv(np.vstack(rows).T @ np.vstack(rows))
    # the fit stops when chi^2 would fall by less than 1e-3, which is 0.03 sigma
    assert np.all(np.abs(fit.values - expected) < 0.05 * np.sqrt(np.diag(covariance)))
    # a uniform prior over the range is counted as a weak Gaussian one
    assert np.sqrt(np.diag(fit.covariance)) == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-3)


def test_false_alarms_are_as_rare_as_stated():
    rng = np.random.default_rng(7)
    p = []
    for _ in range(150):
        system, noise = questioned(rng, rho=0.7)
        problem = Problem(system, noise)
        fit = problem.fit()
        p.append(detect(problem, fit, directions(problem, fit), rng).p_value)
    assert np.mean(np.array(p) < 0.02) <= 0.05  # nominal 0.02: of 150, at most 7 (chance of more: 1 %)
    assert np.mean(np.array(p) < 0.2) <= 0.28
    assert np.mean(np.array(p) < 0.5) >= 0.2  # and it is not blind: Bonferroni over two looks halves what is below


class Waves:
    """y = sum of eight waves whose strengths are fitted, over three short records: a quarter of what is measured."""

    candidates: Mapping[str, Candidate] = {}
    baseline = tuple(Parameter(f"p{k}", 0.1, -5.0, 5.0, 0.1) for k in range(8))

    def __init__(self, rng, s):
        t = np.arange(12) * FRAME
        y = [self._motion(t + 0.2 * i, np.arange(8) / 8) + s * rng.standard_normal(t.size) for i in range(3)]
        self.observations = [Observation(f"run {i}", t + 0.2 * i, y[i], f"{i}", f"{i}") for i in range(3)]

    @staticmethod
    def _motion(t, strengths):
        return np.cos(np.multiply.outer(t, 7.0 * np.arange(1, 9))) @ strengths

    def predict(self, mechanisms, values: Mapping[str, float], which: Sequence[int]):
        p = np.array([values[q.name] for q in self.baseline])
        return [self._motion(self.observations[i].t, p) for i in which]


def test_chi2_is_held_against_the_freedoms_that_the_fit_leaves():
    """36 readings less three zero levels less eight strengths: chi^2 per freedom is 1 on average where the noise is as
    stated, of 150 campaigns to three times sqrt(2 / 25 / 150), and p is as often below a half as above."""
    rng = np.random.default_rng(18)
    ratio, p = [], []
    for _ in range(150):
        problem = Problem(Waves(rng, 1e-3), Noise(1e-3, 0.0, FRAME, 0.0, 10_000))
        found = detect(problem, problem.fit(), [], rng)
        ratio.append(found.chi2_per_dof)
        p.append(found.p_chi2)
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.07)
    assert np.mean(np.array(p) < 0.5) == pytest.approx(0.5, abs=0.13)


def test_a_detectable_strength_is_found_in_nine_of_ten_campaigns_and_its_score_is_the_noncentrality():
    """100 campaigns with the strength stated for one with nothing hidden: 90 %, three binomial sigmas are 9 %."""
    rng = np.random.default_rng(35)
    system, noise = questioned(rng)
    none = Order(Problem(system, noise), rng).all()
    assert none.adequate and {d.mechanism for d in none.detectable} == set(system.candidates)
    least = next(d for d in none.detectable if d.mechanism == "cubic")
    assert (least.parameter, least.unit) == ("a", "1")
    found, score, size = 0, [], []
    for _ in range(100):
        problem = Problem(Falling(rng, 1e-3, a=least.value), noise)
        fit = problem.fit()
        result = detect(problem, fit, directions(problem, fit), rng)
        found += result.discrepant
        i = [x.mechanism for x in result.directions].index("cubic")
        score.append(float(result.score[i]))
        size.append(least.value / result.directions[i].strength)
    assert 81 <= found <= 99
    assert np.mean(score) == pytest.approx(np.mean(size), abs=0.4)  # 1/sqrt(100) = 0.1
    assert np.std(score) == pytest.approx(1.0, abs=0.25)


def test_scatter_from_trial_to_trial_is_no_discrepancy():
    rng = np.random.default_rng(9)
    p, without = [], []
    for _ in range(40):
        system, noise = questioned(rng, bed=0.02)
        for scatter, out in (({"bed": 0.02}, p), ({}, without)):
            problem = Problem(system, noise, scatter)
            fit = problem.fit()
            out.append(detect(problem, fit, directions(problem, fit), rng).p_value)
    assert np.mean(np.array(p) < 0.02) <= 0.1
    assert np.mean(np.array(without) < 0.02) > 0.9  # and it would be one if it were not known


# -- naming --------------------------------------------------------------------------------------------------


def test_the_cause_is_named_with_its_value_its_gain_and_where():
    rng = np.random.default_rng(10)
    system, noise = questioned(rng, w=0.01, f=11.0, zero=0.0)
    d = Order(Problem(system, noise), rng, by=("kind",)).all()
    assert not d.adequate
    assert d.naming.named == ("wave",)
    assert not d.naming.twins
    fit = d.naming.best.fit
    assert fit.named["w"] == pytest.approx(0.01, abs=3 * fit.sigma("w"))
    assert fit.named["f"] == pytest.approx(11.0, abs=3 * fit.sigma("f"))
    assert d.gain.ratio > 2 and d.gain.ratio_ci95[0] > 1
    assert d.gain.track_after == pytest.approx(noise.s, rel=0.15)
    assert set(d.gain.held_out) == {o.name for o in system.observations}
    assert d.naming.tried[0].delta_score > 50


def test_two_causes_at_once():
    rng = np.random.default_rng(11)
    system, noise = questioned(rng, w=0.006, f=16.0, a=2.0)
    d = Order(Problem(system, noise), rng).all()
    assert set(d.naming.named) == {"cubic", "wave"}


def test_what_cannot_be_told_apart_is_said_to_be():
    rng = np.random.default_rng(12)
    system, noise = questioned(rng, q=0.3)
    d = Order(Problem(system, noise), rng).all()
    assert len(d.naming.named) == 1
    assert set(d.naming.named) <= {"kink", "twin"}
    assert set(d.naming.twins[0]) == {"kink", "twin"}


def test_an_effect_of_no_vocabulary_is_not_given_a_name():
    rng = np.random.default_rng(13)
    system, noise = questioned(rng)
    for o in system.observations:
        o.y[...] += 0.02 * np.exp(-0.5 * ((o.t - 0.08) / 0.008) ** 2)
    d = Order(Problem(system, noise), rng).all()
    assert not d.adequate
    assert d.naming.named == ()


def test_the_baseline_is_found_from_a_far_start():
    rng = np.random.default_rng(14)
    system, noise = questioned(rng)
    system.baseline = (Parameter("v", -8.0, -10.0, 10.0, 0.1), system.baseline[1])
    assert fit_baseline(Problem(system, noise), rng).named["v"] == pytest.approx(1.2, abs=0.01)


def test_the_held_out_score_is_that_of_fits_without_each_condition():
    """The closed form by curvature against real refits: exact for a linear system."""
    system, noise = questioned(np.random.default_rng(15))
    problem = Problem(system, noise)
    total = 0.0
    for k in range(6):
        held = [2 * k, 2 * k + 1]
        rest = [i for i in problem.all if i not in held]
        fit = problem.fit((), None, rest)
        r = np.concatenate(problem.residuals((), fit.named, held))
        o = system.observations
        j = np.vstack([Whitening(noise, o[i]).levelled(np.column_stack([o[i].t, -0.5 * o[i].t ** 2])) for i in held])
        covariance = np.eye(r.size) + j @ fit.covariance @ j.T
        total += -0.5 * r @ np.linalg.solve(covariance, r) - 0.5 * np.linalg.slogdet(covariance)[1]
    assert held_out_score(problem, problem.fit()) == pytest.approx(total, rel=2e-3)


# -- sets of causes, and what is left --------------------------------------------------------------------------


@pytest.mark.long
def test_a_cause_beside_misfit_of_no_vocabulary_is_named_in_part_with_wider_intervals():
    """A wave of 10 mm, and bumps of 0.6 mm at 80 ms that no mechanism makes: the wave is certain, it is not all."""
    rng = np.random.default_rng(32)
    system, noise = questioned(rng, s=1e-4, w=0.01, f=11.0)
    alone = Order(Problem(system, noise), rng).all().naming
    for o in system.observations:
        o.y[...] += 6e-4 * np.exp(-0.5 * ((o.t - 0.08) / 0.008) ** 2)
    found = Order(Problem(system, noise), rng).all().naming
    assert alone.named == found.named == ("wave",)
    assert (alone.status, found.status) == ("complete", "partial")
    assert 0 < found.left < 0.02 and found.widened > 2 and alone.widened == 1.0
    assert found.best.fit.sigma("w") > 2 * alone.best.fit.sigma("w")
    assert abs(found.best.fit.named["w"] - 0.01) < 2 * found.best.fit.sigma("w")
    assert found.probability("wave") > 0.99  # established; what else is fitted to the bumps is not likely for it
    assert max(found.probability(m) for m in found.probabilities if m != "wave") < 0.2


def test_the_least_doubt_of_a_p_value():
    """Sellke, Bayarri and Berger (2001), table 1: 0.05 leaves 0.289, 0.01 leaves 0.111, 0.001 leaves 0.0184."""
    assert [least_doubt(p) for p in (0.05, 0.01, 0.001)] == pytest.approx([0.289, 0.111, 0.0184], abs=6e-4)
    assert least_doubt(0.5) == 0.5 and least_doubt(0.0) == 0.0


@pytest.mark.parametrize("seed", range(3))
def test_the_evidence_is_the_integral_over_the_ranges_also_at_their_ends(seed):
    """A parabola of two parameters whose minimum lies inside or beyond their ranges; Simpson's rule is the truth."""
    rng = np.random.default_rng([33, seed])
    root = rng.normal(size=(2, 2))
    hessian = 10 * root @ root.T + np.eye(2)
    centre = 2 * rng.normal(size=2)
    free = (Parameter("a", 0.0, 0.0, 1.0, 1.0), Parameter("b", 0.0, -1.0, 3.0, 1.0))

    def cost(x):
        d = x - centre.reshape(2, *[1] * (x.ndim - 1))
        return 0.5 * np.einsum("i...,ij,j...", d, hessian, d)

    best = minimize(cost, [0.5, 0.5], jac=lambda x: hessian @ (x - centre), bounds=[(0, 1), (-1, 3)], tol=1e-12).x
    a, b = np.linspace(0, 1, 401), np.linspace(-1, 3, 801)
    grid = np.exp(cost(best) - cost(np.stack(np.meshgrid(a, b, indexing="ij"))))
    exact = math.log(simpson(simpson(grid, x=b), x=a) / 4.0)  # the mean over the prior
    assert log_volume(free, best, hessian, -hessian @ (best - centre)) == pytest.approx(exact, abs=0.05)


def test_the_evidence_at_an_end_of_a_range_does_not_hang_on_the_last_step_of_the_fit():
    """Three parameters nearly alike, one at its low end, from the fit of a curve; a step of 1e-3 of chi^2 along the
    valley changes the evidence by no more than that. It was 2e7 off where such a step left a slope."""
    t = np.linspace(0.0, 0.6, 60)
    rows = np.stack([t, np.expm1(t), 0.6 * t * np.exp(t)], axis=1) / 0.02
    hessian, free = (
        rows.T @ rows,
        [Parameter(n, 1.0, low, 2.0, 1.0) for n, low in (("b", -2.0), ("a", 0.0), ("w", 1.0))],
    )
    best, push = np.array([1.1, 0.6, 1.0]), np.array([0.0, 0.0, -1e-4])
    truth = log_volume(free, best, hessian, push)
    for k in range(20):
        step = np.random.default_rng(k).normal(size=3) * [1, 1, 0]
        step *= math.sqrt(1e-3 / (step @ hessian @ step))
        assert log_volume(free, best + step, hessian, push - hessian @ step) == pytest.approx(truth, abs=0.02)


@pytest.mark.parametrize(("groups", "least"), [(3, 0.9), (24, 0.9)])
def test_the_interval_of_a_gain_holds_the_true_one_with_few_groups_too(groups, least):
    """Mean squares of groups scatter by a factor of 1.6; the true ratio is that of endless groups. 300 draws: 1.3 %."""
    rng = np.random.default_rng([34, groups])
    inside = 0
    for _ in range(300):
        before, after = (scale * np.exp(0.5 * rng.standard_normal(groups)) for scale in (9.0, 1.0))
        low, high = ratio_interval(np.stack([before, after], axis=1))
        inside += low < 3.0 < high
    assert least <= inside / 300 <= 0.995
    for few in ([[9.0, 1.0]], [[9.0, 1.0], [8.0, 1.1]]):
        assert ratio_interval(np.array(few)) == (0.0, math.inf)


def test_a_gain_is_judged_on_jumps_that_neither_model_was_fitted_to():
    """Four conditions of two jumps, each condition held out: the error is that of fits to the other three."""
    system, noise = questioned(np.random.default_rng(36), n=8)
    problem, off = Problem(system, noise), []
    for k in range(4):
        fit = problem.fit((), None, [i for i in problem.all if i // 2 != k])
        held = [2 * k, 2 * k + 1]
        off += [system.observations[i].y - y for i, y in zip(held, system.predict((), fit.named, held))]
    found = gain(problem, lambda part, _: part.fit(), [0.0] * 8, np.random.default_rng(0), (), lambda p, base, _: base)
    assert (
        found.track_before == found.track_after == pytest.approx(np.sqrt(np.mean(np.concatenate(off) ** 2)), rel=1e-9)
    )


def test_the_gain_is_that_of_mechanisms_chosen_without_the_jumps_held_out():
    rng = np.random.default_rng(36)
    system, noise = questioned(rng, w=0.01, f=11.0, zero=0.0)
    gained = Order(Problem(system, noise), rng, by=("kind",)).all().gain
    assert sum(n for _, n in gained.selection) == 4
    assert dict(gained.selection)[("wave",)] == 4
