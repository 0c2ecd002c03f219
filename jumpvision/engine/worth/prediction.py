"""Which of the models that were fitted predicts best what it was not fitted to, whatever the causes are."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.engine.fitting import Fit, Problem

LEVEL = 1.05  # errors that are as good
PARTS = 4  # at least: fewer conditions than these are held out in pieces


def best_at_prediction(problem: Problem, fits: Iterable[Fit]) -> tuple[Fit, Array]:
    """(the fit with the fewest parameters among those whose held-out error is within LEVEL of the least; its squared
    errors by part)"""
    each = [(f, held_out_error(problem, f)) for f in fits]
    least = min(float(e.sum()) for _, e in each)
    level = [(f, e) for f, e in each if float(e.sum()) <= LEVEL**2 * least]
    return min(level, key=lambda x: (len(x[0].parameters), float(x[1].sum())))


def held_out_error(problem: Problem, fit: Fit) -> Array:
    """(parts,) sum of squared whitened residuals of each condition as predicted from the others: linear about the fit,
    a parameter kept within its range, one that its end holds left there. Fewer than PARTS conditions are held out in
    pieces, each of so many consecutive samples of every motion."""
    n = len(fit.parameters)
    rows = _parts(problem, fit)
    total = [(r, j) for part in rows for r, j in part]
    wide = np.diag([12.0 / p.width**2 for p in fit.parameters]) if n else np.zeros((0, 0))
    hessian = sum((j.T @ j for _, j in total), fit.known.precision + wide)
    slope = sum((j.T @ r for r, j in total), fit.known.rows.T @ fit.known.pull(fit.values))
    low, high = (np.array([getattr(p, end) for p in fit.parameters]) for end in ("low", "high"))
    free = np.array([not p.at_end(x) for p, x in zip(fit.parameters, fit.values)], bool)
    out = np.zeros(len(rows))
    for k, part in enumerate(rows):
        r, j = np.concatenate([r for r, _ in part]), np.vstack([j for _, j in part])
        step = np.zeros(n)
        if free.any():
            own = j[:, free]
            rest = hessian[np.ix_(free, free)] - own.T @ own
            step[free] = np.linalg.lstsq(rest, slope[free] - own.T @ r, rcond=None)[0]
            step = np.clip(fit.values + step, low, high) - fit.values
        out[k] = float(np.sum((r - j @ step) ** 2))
    return out


def _parts(problem: Problem, fit: Fit) -> list[list[tuple[Array, Array]]]:
    """Residuals and derivatives by part."""
    conditions: dict[str, list[int]] = {}
    for i, o in enumerate(problem.system.observations):
        conditions.setdefault(o.condition, []).append(i)
    pieces = -(-PARTS // len(conditions))
    out = []
    for held in conditions.values():
        cut = [(np.array_split(fit.residuals[i], pieces), np.array_split(fit.jacobian[i], pieces)) for i in held]
        out += [[(r[k], j[k]) for r, j in cut] for k in range(pieces)]
    return out
