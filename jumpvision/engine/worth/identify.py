"""What motions not yet measured can tell of causes: the strength that would show, what is told from what, and what not.

Linear about a declared model: with F the information (whitened sensitivities, squared and summed) of the fitted
parameters b and of the strengths m of all mechanisms, S = F_mm - F_mb F_bb^-1 F_bm is what the fit cannot mimic. A
cause shows from z / sqrt(S_mm) on, beside a rival j from z / sqrt(S_mm - S_mj^2 / S_jj) on; z is that of the test of a
diagnosis with its power. Information adds up over motions, so that protocols are compared without new simulations.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from jumpvision.base.arrays import Array
from jumpvision.engine.detect import LEVEL, POWER
from jumpvision.engine.fitting import Problem
from jumpvision.engine.priors import prior_of
from jumpvision.engine.system import Parameter

TIMES = 3.0  # of the strength that shows: a rival from which such an effect is not told is a twin


@dataclass(frozen=True)
class Information:
    """each: (motions, k + m, k + m) of every motion; prior: (k + m, k + m); strengths: of the mechanisms, in order."""

    each: Array
    prior: Array
    strengths: Mapping[str, Parameter]
    nulls: Array

    @property
    def z(self) -> float:
        """Standard deviations at which a cause shows with POWER in a test of LEVEL, looked for among all of them."""
        tail = LEVEL / (4.0 * max(len(self.strengths), 1))  # two looks, two signs
        return float(scipy.stats.norm.isf(tail) + scipy.stats.norm.ppf(POWER))

    def left(self, which: Sequence[int]) -> Array:
        """S (m, m) of some of the motions."""
        whole = self.each[list(which)].sum(axis=0) + self.prior
        k = len(whole) - len(self.strengths)
        rest = whole[k:, k:] - whole[k:, :k] @ np.linalg.solve(whole[:k, :k], whole[:k, k:]) if k else whole
        size = np.diag(whole)[k:]
        # less of a sensitivity squared counts as nothing
        seen = np.diag(rest) > 1e-9 * np.maximum(size, 1e-300)
        return np.where(np.outer(seen, seen), rest, 0.0)

    def beside(self, which: Sequence[int]) -> Array:
        """(m, m): S_mm less what a rival mimics of it, row m, column j; the diagonal has S_mm itself."""
        s = self.left(which)
        own = np.diag(s)
        with np.errstate(divide="ignore", invalid="ignore"):
            lost = np.where(own[None, :] > 0, s * s / own[None, :], 0.0)
        np.fill_diagonal(lost, 0.0)
        return np.maximum(own[:, None] - lost, 0.0)


@dataclass(frozen=True)
class Shown:
    """What motions tell of a cause. from_: the strength from which it shows with power, NaN where none in its range
    does. twins: what it is not told from at TIMES that strength."""

    mechanism: str
    parameter: str
    unit: str
    from_: float
    twins: tuple[str, ...]


def information(problem: Problem) -> Information:
    """Of every motion of a system, at the declared values of its baseline, no mechanism acting."""
    system, observations = problem.system, problem.system.observations
    names = [n for n, c in system.candidates.items() if not c.replaces]
    base = system.baseline
    columns = [_columns(problem, (), base, len(base))]
    columns += [_columns(problem, (n,), system.candidates[n].parameters, 1) for n in names]
    stacked = [np.hstack([c[i] for c in columns]) for i in range(len(observations))]
    prior = np.zeros((stacked[0].shape[1],) * 2)
    wide = np.diag([12.0 / (p.high - p.low) ** 2 for p in base]) if base else np.zeros((0, 0))
    prior[: len(base), : len(base)] = prior_of(base, problem.measured).precision + wide
    strengths = {n: system.candidates[n].parameters[0] for n in names}
    nulls = np.array([system.candidates[n].null for n in names])
    return Information(np.stack([a.T @ a for a in stacked]), prior, strengths, nulls)


def _columns(problem: Problem, mechanisms: tuple[str, ...], free: Sequence[Parameter], keep: int) -> list[Array]:
    """d(whitened prediction)/d(the first `keep` parameters), observation by observation; 0 where it cannot be had."""
    system = problem.system
    values = np.array([p.start for p in free], float)
    if mechanisms:
        values[0] = system.candidates[mechanisms[0]].null
    frame = problem.frame((), {p.name: p.start for p in system.baseline})
    at = problem.residuals(mechanisms, dict(zip((p.name for p in free), values)), frame=frame)
    if at is None:
        return [np.zeros((o.t.size, keep)) for o in system.observations]
    found = problem.jacobian(mechanisms, free, values, at, None, frame)
    return [j[:, :keep] for j in found]


def limits_of_causes(info: Information, which: Sequence[int]) -> list[Shown]:
    """What some of the motions tell of every cause."""
    beside, names = info.beside(which), list(info.strengths)
    out = []
    for i, (name, p) in enumerate(info.strengths.items()):
        own = beside[i, i]
        need = info.z / math.sqrt(own) if own > 0 else math.inf
        ends = [info.nulls[i] + sign * need for sign in (1.0, -1.0)]
        at = next((x for x in ends if p.low <= x <= p.high), math.nan)
        twins = [n for j, n in enumerate(names) if j != i and beside[i, j] * TIMES**2 < own]
        out.append(Shown(name, p.name, p.unit or "1", at, tuple(twins)))
    return out


def shortest(info: Information, asked: Mapping[str, float], most: int) -> tuple[list[int], dict[str, list[str]]]:
    """(the motions, one after the other, that tell causes of these strengths from nothing and from all rivals; from
    which rivals not even all motions together tell them). Greedy; at most `most`."""
    names = list(info.strengths)
    every = info.beside(range(len(info.each)))
    rows = {names.index(m): abs(x - info.nulls[names.index(m)]) for m, x in asked.items()}
    never = {names[i]: [n for j, n in enumerate(names) if every[i, j] * s * s < info.z**2] for i, s in rows.items()}
    can = {i: [j for j in range(len(names)) if names[j] not in never[names[i]]] for i in rows}

    def lacking(which: Sequence[int]) -> float:
        """Sum over all that is to be told of how far it is from z^2, in e-foldings."""
        beside = info.beside(which)
        need = [beside[i, j] * s * s / info.z**2 for i, s in rows.items() for j in can[i]]
        return -sum(math.log(min(max(x, 1e-12), 1.0)) for x in need)

    taken: list[int] = []
    while len(taken) < most and lacking(taken) > 0:
        taken.append(min(range(len(info.each)), key=lambda k: lacking([*taken, k])))
    return taken, {m: x for m, x in never.items() if x}
