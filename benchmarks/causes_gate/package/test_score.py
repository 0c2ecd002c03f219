"""The score of sets of causes: against a hand calculation, dense normal densities, an integral, and its own odds."""

import math

import numpy as np
from scipy.integrate import quad
from scipy.stats import multivariate_normal, norm

from jumpvision.engine.score import Cause, Products, Search, inclusion, log_evidence


def density(y, covariance):
    """ln of a normal density less that of noise alone's constant."""
    return multivariate_normal(np.zeros(y.size), covariance).logpdf(y) + 0.5 * y.size * math.log(2.0 * math.pi)


def test_evidence_by_hand():
    """y = (2, 0), a column (1, 0): y'y - y'U (I + U'U)^-1 U'y = 4 - 2 4/2 = 2, det = 2."""
    y, column = np.array([2.0, 0.0]), np.array([[1.0], [0.0]])
    assert math.isclose(log_evidence(y, column), -0.5 * 2.0 - 0.5 * math.log(2.0), rel_tol=1e-14)
    found = Search([Cause("a", (1,), (np.ones(1),))], Products.of(y, column)).run()
    # a fifth each for sets of none and of one; -1/2 4 without a cause
    want = {frozenset(): -2.0 - math.log(5.0), frozenset({0}): -1.0 - 0.5 * math.log(2.0) - math.log(5.0)}
    for s in found:
        assert math.isclose(s.log, want[frozenset(k for k, _ in s.members)], rel_tol=1e-12)


def test_products_are_those_of_dense_densities():
    rng = np.random.default_rng(1)
    y, columns = rng.standard_normal(30), rng.standard_normal((30, 7))
    widths = np.array([0.5, 2.0])
    covariance = np.eye(30) + (columns[:, :2] * widths) @ (columns[:, :2] * widths).T
    whole = Products.of(y, columns).beside([1, 2], widths)
    causes = [Cause(k, (k,), (np.array([0.7]),)) for k in (5, 6, 7)]
    s = Search(causes, whole)
    pair = columns[:, 4:6] * 0.7
    want = density(y, covariance + pair @ pair.T) + s.prior([0, 1])
    assert math.isclose(s.scored(((0, 0), (1, 0))).log, want, rel_tol=1e-9)
    # a flat prior is the limit of a wide one, whose own width is taken off
    wide = 1e3
    flat = Products.of(y, columns).without([3, 4])
    broad = columns[:, 2:4] * wide
    want = density(y, np.eye(30) + broad @ broad.T + pair @ pair.T) + 2.0 * math.log(wide) + s.prior([0, 1])
    assert math.isclose(Search(causes, flat).scored(((0, 0), (1, 0))).log, want, abs_tol=1e-4)


def test_a_coefficient_of_one_sign_is_integrated_over_it():
    rng = np.random.default_rng(2)
    column = rng.standard_normal((12, 1))
    y, width = 0.4 * column[:, 0] + rng.standard_normal(12), 1.5

    def integrand(b):
        left = y - b * column[:, 0]
        return 2.0 * norm.pdf(b, scale=width) * math.exp(-0.5 * float(left @ left - y @ y))

    for sign, ends in ((1, (0.0, 10.0)), (-1, (-10.0, 0.0))):
        s = Search([Cause("a", (1,), (np.array([width]),), sign=sign)], Products.of(y, column))
        got = s.scored(((0, 0),)).log - s.prior([0]) + 0.5 * float(y @ y)
        assert math.isclose(got, math.log(quad(integrand, *ends, epsabs=1e-12)[0]), rel_tol=1e-7)


def test_a_change_of_known_size_and_members_of_one_cause():
    rng = np.random.default_rng(3)
    columns = 3.0 * rng.standard_normal((40, 3))
    y = columns[:, 0] + columns[:, 1] + rng.standard_normal(40)
    again = -math.log(3.0)
    causes = [Cause("lost", (k,), log_prior=-2.0, log_again=again) for k in (1, 2, 3)]
    best = Search(causes, Products.of(y, columns)).run()[0]
    left = y - columns[:, 0] - columns[:, 1]
    assert {k for k, _ in best.members} == {0, 1}
    assert math.isclose(best.log, -0.5 * float(left @ left) - 2.0 + again - math.log(5.0), rel_tol=1e-9)


def test_probabilities_are_those_with_which_causes_are_there():
    """Worlds are drawn from the prior itself: of what is said to be there with p, a share p is, to 4 sigma."""
    rng, told, true = np.random.default_rng(4), [], []
    widths = (np.array([1.0]), np.array([0.1]))
    for _ in range(120):
        columns = rng.standard_normal((60, 6)) + 0.7 * rng.standard_normal((60, 1))
        size = int(rng.integers(0, 5))
        hidden = rng.choice(6, size, replace=False)
        y = rng.standard_normal(60)
        for k in hidden:
            y = y + columns[:, k] * rng.choice([1.0, 0.1]) * rng.standard_normal()
        # in any order: 1/6 1/5 ... a set drawn without replacement has size! / (6 5 ...)
        causes = [Cause(k, (k + 1,), widths, log_prior=-math.log(6.0)) for k in range(6)]
        sets = []
        for s in Search(causes, Products.of(y, columns)).run():
            n = len(s.members)
            drawn = n * math.log(6.0) - sum(math.log(6.0 - k) for k in range(n))
            sets.append((frozenset(k for k, _ in s.members), s.log + drawn))
        chance = inclusion(sets)
        told += [chance.get(k, 0.0) for k in range(6)]
        true += [k in hidden for k in range(6)]
    p, there = np.array(told), np.array(true)
    for low, high in ((0.0, 0.3), (0.3, 0.9), (0.9, 1.01)):
        some = (p >= low) & (p < high)
        sigma = math.sqrt(float(np.sum(p[some] * (1.0 - p[some]))))
        assert some.sum() > 20
        assert abs(float(there[some].sum()) - float(p[some].sum())) < 4.0 * max(sigma, 1.0)


def test_inclusion_is_the_share_of_the_sets_that_hold_a_cause():
    chance = inclusion([(frozenset("ab"), 0.0), (frozenset("a"), math.log(2.0)), (frozenset(), math.log(1.0))])
    assert math.isclose(chance["a"], 0.75) and math.isclose(chance["b"], 0.25)
