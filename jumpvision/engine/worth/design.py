"""The experiment that is expected to tell most, over all models that hold probability.

Each model k expects of an experiment a Gaussian N(m_k, 1 + U_k U_k^T) in noise units: m_k its prediction at the best
fit, U_k what its parameters, as uncertain as they are (J C^1/2), and the scatter from trial to trial make of it. The
gain is the mutual information between which model is right and the readings (Lindley 1956), by draws,
I = sum_k w_k E_k[ln p_k(y) / sum_j w_j p_j(y)]; the expected log-odds are those of the right model over all others
together. Parameters are shared by the experiments of a batch, what scatters is not.
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
DRAWS = 128  # of the readings, by model
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
    """What each model expects of an experiment, in noise units: mean (n,); shared (n, k): by its parameters; own
    (n, m): by what scatters."""

    mean: tuple[Array, ...]
    shared: tuple[Array, ...]
    own: tuple[Array, ...]

    def beside(self, other: Prospect) -> Prospect:
        """Both experiments, one after the other."""
        blocks = [
            np.block([[a, np.zeros((len(a), b.shape[1]))], [np.zeros((len(b), a.shape[1])), b]])
            for a, b in zip(self.own, other.own)
        ]
        return Prospect(
            tuple(np.concatenate(x) for x in zip(self.mean, other.mean)),
            tuple(np.vstack(x) for x in zip(self.shared, other.shared)),
            tuple(blocks),
        )


@dataclass(frozen=True)
class Worth:
    """bits: expected information on which model is right. log10_odds: expected, of the right one over the others."""

    bits: float
    log10_odds: float


@dataclass(frozen=True)
class Choice:
    """An experiment of a batch: which of those offered, what it is expected to add to those chosen before, and what
    all so far bring together."""

    which: int
    worth: Worth
    together: Worth


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


def entropy(weights: Sequence[float]) -> float:
    """Of a belief [bits]."""
    return -sum(w * math.log2(w) for w in weights if w > 0)


def prospect(problem: Problem, held: Sequence[Held], i: int) -> Prospect | None:
    """Of observation i of a system, its readings not yet made; None where a model cannot foretell it."""
    whitening, means, shared, own = problem.whitening[i], [], [], []
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
        shared.append(jacobian @ root(h.fit.covariance))
        own.append(q * size)
    return Prospect(tuple(means), tuple(shared), tuple(own))


def measuring(held: Sequence[Held], relative: Mapping[str, float]) -> Prospect | None:
    """Of a measurement of parameters by themselves, each to a relative sigma; None where a model has them not free."""
    first, means, shared = held[0].fit.named, [], []
    if any(n not in h.fit.named for h in held for n in relative):
        return None
    sigma = np.array([abs(first[n]) * s for n, s in relative.items()])
    for h in held:
        at = [[p.name for p in h.fit.parameters].index(n) for n in relative]
        means.append(h.fit.values[at] / sigma)
        shared.append(root(h.fit.covariance)[at] / sigma[:, None])
    return Prospect(tuple(means), tuple(shared), tuple(np.zeros((len(relative), 0)) for _ in held))


def root(covariance: Array) -> Array:
    """A matrix whose square, times its transpose, is a covariance (k, k)."""
    w, v = np.linalg.eigh(covariance) if covariance.size else (np.zeros(0), np.zeros((0, 0)))
    return np.asarray(v * np.sqrt(np.maximum(w, 0.0)))


def worth(p: Prospect, weights: Sequence[float], rng: np.random.Generator) -> Worth:
    """What an experiment is expected to tell, by draws of its readings from every model."""
    n, weight = len(weights), np.asarray(weights, float)
    if n < 2:
        return Worth(0.0, 0.0)
    spread = [np.hstack(x) for x in zip(p.shared, p.own)]
    differ = np.hstack([*spread, *(m[:, None] - p.mean[0][:, None] for m in p.mean[1:])])
    u, s, _ = np.linalg.svd(differ, full_matrices=False)
    basis = u[:, s > 1e-6]  # beyond it all models expect the same noise
    mean = [basis.T @ (m - p.mean[0]) for m in p.mean]
    factor = [np.linalg.cholesky(np.eye(basis.shape[1]) + (b := basis.T @ x) @ b.T) for x in spread]
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


def batch(
    offered: Mapping[int, Prospect],
    costs: Mapping[int, float],
    weights: Sequence[float],
    size: int,
    rng: np.random.Generator,
) -> list[Choice]:
    """The experiments that tell most for their cost, one after the other, each beside those chosen before it.

    Greedy: the information of a set is submodular where readings are independent given the model, and nearly so here.
    """
    out: list[Choice] = []
    before: Prospect | None = None
    have = Worth(0.0, 0.0)
    left = dict(offered)
    seed = int(rng.integers(2**63))
    while left and len(out) < size:
        found = {}
        for i, p in left.items():
            both = p if before is None else before.beside(p)
            found[i] = worth(both, weights, np.random.default_rng(seed))  # the same draws: differences are not chance
        best = chosen({i: Worth(w.bits - have.bits, w.log10_odds - have.log10_odds) for i, w in found.items()}, costs)
        gained = Worth(found[best].bits - have.bits, found[best].log10_odds - have.log10_odds)
        have = found[best]
        out.append(Choice(best, gained, have))
        before = left[best] if before is None else before.beside(left[best])
        left.pop(best)
    return out


def chosen(gains: Mapping[int, Worth], costs: Mapping[int, float]) -> int:
    """The most information per cost; of those alike, where an answer is nearly sure, the largest log-odds per cost."""
    top = max(w.bits / costs[i] for i, w in gains.items())
    alike = [i for i, w in gains.items() if w.bits / costs[i] >= top - SAME]
    return max(alike, key=lambda i: gains[i].log10_odds / costs[i])


def propose(problem: Problem, which: Sequence[int], tried: Sequence[Explanation]) -> Proposal | None:
    """The best of the observations `which` of a system of motions not yet made; None where none can be foretold."""
    held = belief(tried)
    if len(held) < 2:
        return None
    offered = {i: p for i in which if (p := prospect(problem, held, i)) is not None}
    best = batch(offered, dict.fromkeys(offered, 1.0), [h.weight for h in held], 1, np.random.default_rng(0))
    if not best:
        return None
    labels = problem.system.observations[best[0].which].labels
    return Proposal(labels, (held[0].name, held[1].name), best[0].worth.log10_odds)
