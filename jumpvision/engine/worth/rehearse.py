"""What an experiment is expected to say, by rehearsal: readings drawn from the likely models, and all of these fitted.

The linear forecast (`design.worth`) chooses among many experiments; of the chosen one it may state odds of hundreds of
decades, where a prediction linear in badly known parameters runs off, or a rival bends as no line tells. Here each
rival is fitted to what was measured and to the readings drawn, and weighed by its evidence, as it will be.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from jumpvision.base.arrays import Array
from jumpvision.engine.fitting import Fit, Problem
from jumpvision.engine.system import Observation, Part

from .design import Held, root

REHEARSALS = 12  # readings drawn, from each model as often as it is likely
POOL = 64  # of a model's parameters, of which some are chosen


@dataclass(frozen=True)
class Made(Part):
    """Some observations of a system, the last of them with these readings (n,)."""

    readings: Array

    @property
    def observations(self) -> Sequence[Observation]:
        *done, last = super().observations
        return [*done, replace(last, y=self.readings)]


def likely(problem: Problem, fit: Fit, size: int, rng: np.random.Generator) -> list[dict[str, float]]:
    """Values (size) of a model's parameters, as likely as a problem's data leave them: of many by the curvature at the
    best fit, chosen by what they cost; the best fit where none is possible."""
    names, spread = list(fit.named), root(fit.covariance)
    low, high = (np.array([getattr(p, end) for p in fit.parameters]) for end in ("low", "high"))
    z = rng.standard_normal((POOL, len(names)))
    pool = fit.values + z @ spread.T
    inside = np.all((pool >= low) & (pool <= high), axis=1)
    cost = [
        problem.cost(fit.mechanisms, dict(zip(names, x.tolist()))) if ok else math.inf for x, ok in zip(pool, inside)
    ]
    log = 0.5 * np.sum(z * z, axis=1) - 0.5 * np.array(cost)
    if not np.any(np.isfinite(log)):
        return [fit.named] * size
    chance = np.exp(log - np.max(log))
    return [dict(zip(names, pool[i].tolist())) for i in rng.choice(POOL, size, p=chance / chance.sum())]


def simulated_readings(
    problem: Problem, mechanisms: tuple[str, ...], values: Mapping[str, float], i: int, rng: np.random.Generator
) -> Array | None:
    """Readings (n,) of observation i by this model, with scatter, wander and noise; None where it foretells none."""
    (y,) = problem.system.predict(mechanisms, values, [i])
    if not np.all(np.isfinite(y)):
        return None
    ((q, size),) = problem.frame(mechanisms, values, [i])
    white = rng.standard_normal(y.size) + q @ (size * rng.standard_normal(size.size))
    a, b = problem.whitening[i].weights
    return np.asarray(y + scipy.linalg.solve_banded((1, 0), np.stack([a, -np.append(b, 0.0)]), white))


def log10_odds(
    problem: Problem, held: Sequence[Held], done: Sequence[int], new: int, rng: np.random.Generator
) -> Array:
    """What observation `new`, beside those that are done, adds to those of the right model over all others together:
    one number a rehearsal; none where no model can be followed there."""
    made = problem.over(done)
    before = [made.fit(h.fit.mechanisms, h.fit.named) for h in held]
    weight = np.array([h.weight for h in held])
    turns = np.searchsorted(np.cumsum(weight), (np.arange(REHEARSALS) + 0.5) / REHEARSALS * weight.sum())
    odds = []
    for k, right in enumerate(before):
        if right is None or not (turns == k).any():
            continue
        for true in likely(made, right, int(np.sum(turns == k)), rng):
            readings = simulated_readings(problem, right.mechanisms, true, new, rng)
            if readings is None:
                continue
            both = problem.asked_of(Made(problem.system, (*done, new), readings))
            gained = np.array([gain(both, fit, *([true] if fit is right else [])) for fit in before])
            rest = np.delete(gained + np.log(weight), k)
            odds.append(gained[k] - np.logaddexp.reduce(rest) + math.log(max(1.0 - weight[k], 1e-300)))
    decades = np.array(odds) / math.log(10)
    return decades[np.isfinite(decades)]  # no rival can be followed there: that says nothing of the right one


def gain(problem: Problem, fit: Fit | None, *starts: Mapping[str, float]) -> float:
    """ln of the evidence that a model gains by what is new in a problem, fitted from its values and from `starts`; -inf
    where it cannot be followed."""
    if fit is None:
        return -math.inf
    after = [problem.fit(fit.mechanisms, start) for start in (fit.named, *starts)]
    return max((f.log_evidence for f in after if f is not None), default=-math.inf) - fit.log_evidence
