"""Does the model fail at all, and where: size of the residuals, what each mechanism would leave, single cells."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.engine.document.values import Cell, Detectable

from .fitting import Fit, Problem
from .system import Candidate

LEVEL = 0.02  # below this p a model is called discrepant
DRAWS = 20_000  # of the noise, for the largest of many scores
WEAK, STRONG = 0.3, 30.0  # noise units: an effect outside is tried again with another strength


@dataclass(frozen=True)
class Direction:
    """What a mechanism at one shape would add to the whitened residuals, less what the fitted parameters can mimic.

    vector: (n,) unit vector over all residuals and priors; strength: of the mechanism at unit length of the vector.
    kept: share of the effect (length) that the fitted parameters cannot mimic; effect: (n,) all of it at `strength`.
    """

    mechanism: str
    shape: tuple[float, ...]
    vector: Array
    strength: float
    kept: float
    effect: Array


@dataclass(frozen=True)
class Detection:
    """p_value: of the better of two looks, corrected for looking twice. score: of each direction, N(0, 1) if none."""

    p_value: float
    p_chi2: float
    p_score: float
    chi2_per_dof: float
    directions: tuple[Direction, ...]
    score: Array

    @property
    def discrepant(self) -> bool:
        return self.p_value < LEVEL


class Span:
    """The residuals of a fit stacked with its priors, and the projection that removes what its parameters can do.

    without: a parameter that is taken as fixed.
    """

    def __init__(self, fit: Fit, without: str | None = None) -> None:
        rows, pull = fit.known.rows, fit.known.pull(fit.values)
        self.lengths, self.extra = [r.size for r in fit.residuals], pull.size
        self.residual = np.concatenate([*fit.residuals, pull])
        # a parameter at the end of its range cannot take up what would push it further
        free = [not p.at_end(x) and p.name != without for p, x in zip(fit.parameters, fit.values)]
        matrix = np.vstack([*fit.jacobian, rows])[:, free]
        scale = np.linalg.norm(matrix, axis=0)
        matrix = matrix[:, scale > 0] / scale[scale > 0]
        u, s, _ = np.linalg.svd(matrix, full_matrices=False) if matrix.size else (matrix, np.zeros(0), None)
        self.basis = u[:, s > 1e-9 * (s[0] if s.size else 1.0)]

    def off(self, x: Array) -> Array:
        """Columns x (n,) or (n, k), priors' rows included, less their part within the span."""
        return x - self.basis @ (self.basis.T @ x)

    def stack(self, parts: Sequence[Array]) -> Array:
        """Effects by observation as one column over residuals and priors."""
        return np.concatenate([*parts, np.zeros(self.extra)])


def directions(problem: Problem, fit: Fit, among: Sequence[str] | None = None) -> list[Direction]:
    """Directions of every mechanism not yet in the model (those that replace a term have none)."""
    span = Span(fit)

    def of_one(name: str, candidate: Candidate) -> list[Direction]:
        out = []
        amount = 0.02 * candidate.parameters[0].scale
        for shape in candidate.shapes:
            if (effect := _effect(problem, fit, name, candidate, shape, amount)) is None:
                continue
            parts, strength = effect
            amount = abs(strength)  # what shows in one shape shows in the next
            column = span.stack(parts)
            length = float(np.linalg.norm(column))
            rest = span.off(column)
            left = float(np.linalg.norm(rest))
            # less of a sensitivity beside the fitted parameters is rounding; a motion that runs away tells nothing
            if length > 0 and math.isfinite(left) and left > 1e-6 * length and strength / left != 0.0:
                out.append(Direction(name, shape, rest / left, strength / left, left / length, column / left))
        return out

    asked = {
        n: c
        for n, c in problem.system.candidates.items()
        if n not in fit.mechanisms and not c.replaces and (among is None or n in among)
    }
    return [d for found in problem.each(partial(of_one, n, c) for n, c in asked.items()) for d in found]


def _effect(
    problem: Problem, fit: Fit, name: str, candidate: Candidate, shape: tuple[float, ...], amount: float
) -> tuple[list[Array], float] | None:
    """Whitened change of the prediction by a weak mechanism, and how strong it was. amount: tried first."""
    strength, *others = candidate.parameters
    fixed = dict(zip((p.name for p in others), shape or [p.start for p in others]))
    mechanisms = (*fit.mechanisms, name)
    at = fit.named
    base = at.get(strength.name, candidate.null) if strength.name in at else candidate.null
    room_up, room_down = strength.high - base, base - strength.low
    sign = 1.0 if room_up > 0 else -1.0
    for _ in range(4):
        amount = min(amount, 0.9 * (room_up if sign > 0 else room_down))
        values = {**fixed, **at, strength.name: base + sign * amount}
        there = problem.residuals(mechanisms, values, frame=fit.frame)
        if there is None:
            amount *= 0.1
            continue
        parts = [a - b for a, b in zip(fit.residuals, there)]
        size = math.sqrt(sum(float(d @ d) for d in parts))
        if WEAK <= size <= STRONG or size == 0.0:
            break
        if amount * 3.0 / size > strength.scale and size < WEAK:  # nothing in this data shows it
            break
        amount *= 3.0 / size
    else:
        if there is None:
            return None
    return None if there is None or size == 0.0 else (parts, sign * amount)


def largest(vectors: Sequence[Array], rng: np.random.Generator, doubt: float | None = None) -> Array:
    """(DRAWS,) the largest score along unit vectors (n,) that noise alone makes, correlated as they are.

    doubt: standard uncertainty of the logarithm of the noise power.
    """
    matrix = np.stack(vectors, axis=1)
    w, v = np.linalg.eigh(matrix.T @ matrix)
    draws = rng.standard_normal((DRAWS, w.size)) @ (v * np.sqrt(np.maximum(w, 0.0))).T
    if doubt is not None:
        draws *= np.exp(0.5 * doubt * rng.standard_normal((DRAWS, 1)))
    return np.asarray(np.max(np.abs(draws), axis=1))


def detect(problem: Problem, fit: Fit, found: Sequence[Direction], rng: np.random.Generator) -> Detection:
    """Two looks at a fit: chi^2, and the largest score among the directions (correlated as they are)."""
    span = Span(fit)
    residual = span.off(span.residual)
    dof = max(problem.n + span.extra - span.basis.shape[1], 1)
    chi2 = float(residual @ residual)
    noise = problem.noise  # which is an estimate too
    doubt = noise.log_power**2 or (2.0 / noise.n if noise.n else 0.0)
    spread = math.sqrt((noise.kurtosis - 1.0) / dof + doubt)
    p_chi2 = float(scipy.stats.norm.sf(math.log(chi2 / dof) / spread + 0.5 * spread)) if chi2 > 0 else 1.0
    score, tau = np.array([d.vector @ residual for d in found]), noise.log_sigma
    p_score = 1.0
    # what was chosen because these residuals show it is no test of them
    candidates = problem.system.candidates
    asked = [k for k, d in enumerate(found) if d.mechanism not in candidates or candidates[d.mechanism].price == 0.0]
    if asked:
        top = float(np.max(np.abs(score[asked])))
        beyond = int(np.sum(largest([found[k].vector for k in asked], rng, tau) >= top))
        p_score = (beyond + 1) / (DRAWS + 1)
        if beyond < 20:  # beyond the draws: the sum over directions bounds it, with the same doubt about the noise
            grid, weight = np.polynomial.hermite_e.hermegauss(31)
            tails = 2.0 * scipy.stats.norm.sf(top / np.exp(0.5 * tau * grid))
            p_score = min(p_score, float(len(asked) * (weight @ tails) / weight.sum()))
    p = min(1.0, 2.0 * min(p_chi2, p_score))
    return Detection(p, p_chi2, p_score, chi2 / dof, tuple(found), score)


POWER = 0.9


def detectable(problem: Problem, fit: Fit, found: Detection, rng: np.random.Generator) -> list[Detectable]:
    """For every mechanism beside a fit that has a strength, the one at which the test would have called it discrepant.

    Linear in the strength, its shape the one nearest to the first values; by the largest score alone. Above the value
    at which it is absent, or below where the range ends there.
    """
    if not found.directions:
        return []
    chance = largest([d.vector for d in found.directions], rng, problem.noise.log_sigma)
    beyond = float(np.quantile(chance, 1.0 - LEVEL / 2.0)) + float(scipy.stats.norm.ppf(POWER))
    near: dict[str, tuple[float, Direction]] = {}
    for d in found.directions:
        others = problem.system.candidates[d.mechanism].parameters[1:]
        off = sum(((x - p.start) / p.scale) ** 2 for x, p in zip(d.shape, others))
        if d.mechanism not in near or off < near[d.mechanism][0]:
            near[d.mechanism] = (off, d)
    out = []
    for name, (_, d) in near.items():
        candidate = problem.system.candidates[name]
        p = candidate.parameters[0]
        null = fit.named.get(p.name, candidate.null)
        ends = [null + sign * beyond * abs(d.strength) for sign in (1.0, -1.0)]
        value = next((x for x in ends if p.low <= x <= p.high), math.nan)
        out.append(Detectable(name, p.name, value, p.unit or "1"))
    return out


def locate(problem: Problem, fit: Fit, by: tuple[str, ...], rng: np.random.Generator) -> list[Cell]:
    """Cells of equal labels `by` and part of the motion, the most significant first."""
    span = Span(fit)
    residual = span.off(span.residual)
    observations = problem.system.observations
    predicted = problem.system.predict(fit.mechanisms, fit.named, problem.all)
    cells: dict[tuple[tuple[str | float | None, ...], str], dict[int, NDArray[np.bool_]]] = {}
    for i, o in enumerate(observations):
        parts = o.parts if o.parts is not None else np.full(o.t.size, "all")
        for part in np.unique(parts):
            key = tuple(o.labels.get(b) for b in by), str(part)
            cells.setdefault(key, {})[i] = parts == part
    vectors, rows = [], []
    for key, masks in cells.items():
        raw = np.concatenate([(observations[i].y - predicted[i])[m] for i, m in masks.items()])
        if raw.size < 8:  # too few samples
            continue
        effect = [np.zeros(o.t.size) for o in observations]
        for i, m in masks.items():
            effect[i] = problem.whitening[i].whitened(m.astype(float), fit.frame[i])
        vector = span.off(span.stack(effect))
        length = float(np.linalg.norm(vector))
        if length < 1e-6:
            continue
        vectors.append(vector / length)
        rows.append((key, raw.size, float(raw.mean()), float(vector @ residual) / length))
    if not rows:
        return []
    chance = np.sort(largest(vectors, rng))
    cells_out = []
    for (labels, part), n, mean, z in rows:
        p = float(DRAWS - np.searchsorted(chance, abs(z)) + 1) / (DRAWS + 1)
        cells_out.append(Cell(str(dict(zip(by, labels)).get("kind")), part, mean, z, p, n))
    return sorted(cells_out, key=lambda c: -abs(c.z_score))
