"""The experiment that is expected to tell most, over all models that hold probability.

Each model k expects of an experiment a Gaussian N(m_k, 1 + U_k U_k^T) in noise units: m_k its prediction at the best
fit, U_k what its parameters, as uncertain as they are (J C^1/2), and the scatter from trial to trial make of it. The
gain is the mutual information between which model is right and the readings (Lindley 1956), by draws,
I = sum_k w_k E_k[ln p_k(y) / sum_j w_j p_j(y)]; the expected log-odds are those of the right model over all others
together.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.engine.fitting import Fit, Problem
from jumpvision.engine.naming import Explanation
from jumpvision.engine.system import parameters

HELD, MOST = 2e-3, 8  # probability of a model that is thought of, and how many are
DRAWS, SEED = 128, 5874934615388537135  # of the readings, by model
SAME = 0.02  # bits by which two gains are alike: the larger log-odds win then


@dataclass(frozen=True)
class Held:
    """A model with the probability that it holds, all of those thought of together 1."""

    fit: Fit
    weight: float

    @property
    def name(self) -> str:
        return "+".join(self.fit.mechanisms) or "baseline"


@dataclass(frozen=True)
class Prospect:
    """Hold the readings that each model expects of an experiment, in noise units.

    mean (n,); spread (n, k): by the model's parameters and by what scatters.
    """

    mean: tuple[Array, ...]
    spread: tuple[Array, ...]


@dataclass(frozen=True)
class Worth:
    """bits: expected information on which model is right. log10_odds: expected, of the right one over the others."""

    bits: float
    log10_odds: float


@dataclass(frozen=True)
class Proposal:
    """The experiment to be made next. separates: the two likeliest models; expected_log10_odds: of the right model over
    all others, after it."""

    labels: Mapping[str, Any]
    separates: tuple[str, str]
    expected_log10_odds: float


def belief(tried: Sequence[Explanation]) -> list[Held]:
    """The likeliest models that were tried, two to MOST of them, their probabilities scaled to 1."""
    kept = [e for k, e in enumerate(tried) if e.probability >= HELD or k < 2][:MOST]
    # a second one has some probability where nothing but the first is likely
    chances = [max(e.probability, 1e-9) for e in kept]
    return [Held(e.fit, p / sum(chances)) for e, p in zip(kept, chances)]


def prospect(problem: Problem, held: Sequence[Held], i: int) -> Prospect | None:
    """Of observation i of a system, its readings not yet made; None where a model cannot foretell it."""
    whitening, means, spreads = problem.whitening[i], [], []
    blank = [(np.zeros((problem.system.observations[i].t.size, 0)), np.zeros(0))]
    for h in held:
        mechanisms, free = h.fit.mechanisms, parameters(problem.system, h.fit.mechanisms)
        values = np.array([h.fit.named[p.name] for p in free])
        (y,) = problem.system.predict(mechanisms, h.fit.named, [i])
        if not np.all(np.isfinite(y)):
            return None
        at = [whitening.levelled(problem.system.observations[i].y - y)]
        (jacobian,) = problem.jacobian(mechanisms, free, values, at, [i], blank)
        ((q, size),) = problem.frame(mechanisms, h.fit.named, [i])
        means.append(whitening.levelled(y))
        spreads.append(np.hstack([jacobian @ root(h.fit.covariance), q * size]))
    return Prospect(tuple(means), tuple(spreads))


def root(covariance: Array) -> Array:
    """A matrix whose square, times its transpose, is a covariance (k, k)."""
    w, v = np.linalg.eigh(covariance) if covariance.size else (np.zeros(0), np.zeros((0, 0)))
    return np.asarray(v * np.sqrt(np.maximum(w, 0.0)))


def worth(p: Prospect, weights: Sequence[float], rng: np.random.Generator) -> Worth:
    """What an experiment is expected to tell, by draws of its readings from every model."""
    n, weight = len(weights), np.asarray(weights, float)
    differ = np.hstack([*p.spread, *(m[:, None] - p.mean[0][:, None] for m in p.mean[1:])])
    u, s, _ = np.linalg.svd(differ, full_matrices=False)
    basis = u[:, s > 1e-6]  # beyond it all models expect the same noise
    mean = [basis.T @ (m - p.mean[0]) for m in p.mean]
    factor = [np.linalg.cholesky(np.eye(basis.shape[1]) + (b := basis.T @ x) @ b.T) for x in p.spread]
    inverse = [np.linalg.inv(c) for c in factor]
    volume = [float(np.sum(np.log(np.diag(c)))) for c in factor]
    unit = rng.standard_normal((basis.shape[1], DRAWS))
    unit = np.hstack([unit, -unit])
    bits, odds = 0.0, 0.0
    for k in range(n):
        y = mean[k][:, None] + factor[k] @ unit
        log = np.stack(
            [-0.5 * np.sum((inverse[j] @ (y - mean[j][:, None])) ** 2, axis=0) - volume[j] for j in range(n)]
        )
        mixed = log + np.log(weight)[:, None]
        others = np.delete(mixed, k, axis=0)
        rest = np.logaddexp.reduce(others, axis=0) - math.log(max(1.0 - weight[k], 1e-300))
        bits += weight[k] * float(np.mean(log[k] - np.logaddexp.reduce(mixed, axis=0))) / math.log(2)
        odds += weight[k] * float(np.mean(log[k] - rest)) / math.log(10)
    return Worth(max(bits, 0.0), odds)


def propose(problem: Problem, which: Sequence[int], tried: Sequence[Explanation]) -> Proposal | None:
    """Return the best of the observations `which` of motions not yet made; None where none can be predicted.

    The most information wins; of those alike, where an answer is nearly sure, the largest log-odds.
    """
    held = belief(tried)
    if len(held) < 2:
        return None
    offered = {i: p for i in which if (p := prospect(problem, held, i)) is not None}
    if not offered:
        return None
    weights = [h.weight for h in held]
    # the same draws for each: differences are not chance
    worths = {i: worth(p, weights, np.random.default_rng(SEED)) for i, p in offered.items()}
    top = max(w.bits for w in worths.values())
    alike = [i for i, w in worths.items() if w.bits >= top - SAME]
    best = max(alike, key=lambda i: worths[i].log10_odds)
    labels = problem.system.observations[best].labels
    return Proposal(labels, (held[0].name, held[1].name), worths[best].log10_odds)
