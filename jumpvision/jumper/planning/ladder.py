"""Plans for a ladder of heights that shift from one height to the next: branches of plans, followed over the target."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jumpvision.base.arrays import Array

from .plan import Plan, Planner
from .solve import Solution

CONTINUOUS = 0.25  # change of the trajectory in one step, of the motor's travel; beyond it the solver went elsewhere

Branch = list[Solution | None]


@dataclass(frozen=True)
class Ladder:
    """plans: one a height, None where none was found. excess: their objective over the least that any branch has
    there, less 1 (nan: no plan)."""

    plans: list[Plan | None]
    excess: Array


def ladder(planner: Planner, targets: Sequence[float]) -> Ladder:
    """Plans for apexes [m], increasing, all of one branch where a branch has them all.

    Every height is searched for itself, and each plan found is followed up and down the ladder in steps that change
    it little: a branch. Kept is the branch with most heights, of these the one whose objective is least (the sum of
    its logarithms); heights that it does not reach come from the next one.
    """
    began, solver = time.perf_counter(), planner.solver(planner.objective)
    seeds = [planner.search(a) for a in targets]
    branches = [_branch(planner, targets, i, s) for i, s in enumerate(seeds) if s is not None]
    cost = np.array([[s.cost if s else np.nan for s in b] for b in branches]).reshape(-1, len(targets))
    has = np.isfinite(cost)
    with np.errstate(invalid="ignore", divide="ignore"):
        excess = cost / np.min(np.where(has, cost, np.inf), axis=0, initial=np.inf) - 1.0
        total = np.where(has, np.log1p(excess), 0.0).sum(axis=1)
    order = np.lexsort((total, -has.sum(axis=1)))
    which = [next((k for k in order if has[k, i]), None) for i in range(len(targets))]
    kept = [None if k is None else branches[k][i] for i, k in enumerate(which)]
    plans = [planner.corrected(a, s, solver, began) if s else None for a, s in zip(targets, kept)]
    return Ladder(plans, np.array([np.nan if k is None else excess[k, i] for i, k in enumerate(which)]))


def _branch(planner: Planner, targets: Sequence[float], at: int, seed: Solution) -> Branch:
    """A plan followed from its height through all others, as far as it goes."""
    out: Branch = [None] * len(targets)
    out[at] = seed
    for heights in (range(at + 1, len(targets)), range(at - 1, -1, -1)):
        now: Solution | None = seed
        for i in heights:
            out[i] = now = now and follow(planner, now, targets[i])
    return out


def follow(planner: Planner, at: Solution, apex: float, halved: int = 0) -> Solution | None:
    """From a plan to another apex [m] without a jump of the trajectory; None where the branch ends."""
    found = planner.solver(planner.objective).solve(apex, planner.limits, warm=at)
    if found.solved and changed(at, found) < CONTINUOUS:
        return found
    if halved == 4:  # times at most
        return None
    middle = follow(planner, at, 0.5 * (at.apex + apex), halved + 1)
    return middle and follow(planner, middle, apex, halved + 1)


def changed(a: Solution, b: Solution) -> float:
    """Greatest difference of two commands before take-off, to which both are aligned, over the greater travel."""
    off = [float(s.durations[:-1].sum()) for s in (a, b)]
    before = np.linspace(0.0, max(off), 400)
    x, y = (s.command(np.maximum(t - before, 0.0))[0] for s, t in zip((a, b), off))
    return float(np.abs(x - y).max() / max(np.ptp(x), np.ptp(y)))
