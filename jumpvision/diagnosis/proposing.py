"""The next experiment: the one that is expected to tell the remaining explanations apart best."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .fitting import STEP, Fit
from .noise import Noise

Array = NDArray[np.float64]


class Runnable(Protocol):
    """An experiment that could be done: its labels, its frames, and what a model predicts for it."""

    @property
    def labels(self) -> Mapping[str, Any]: ...
    @property
    def t(self) -> Array: ...
    def predict(self, mechanisms: tuple[str, ...], values: Mapping[str, float]) -> Array: ...


@dataclass(frozen=True)
class Proposal:
    """expected_log10_odds: for the right one of two explanations over the other, after one such jump."""

    labels: Mapping[str, Any]
    separates: tuple[str, str]
    expected_log10_odds: float


def propose(runnable: Sequence[Runnable], first: Fit, second: Fit, noise: Noise) -> Proposal | None:
    """The best of the experiments for telling two explanations apart; None when none can be predicted."""
    best: Proposal | None = None
    for r in runnable:
        odds = expected_log10_odds(r, first, second, noise)
        if odds is not None and (best is None or odds > best.expected_log10_odds):
            names = tuple("+".join(f.mechanisms) or "baseline" for f in (first, second))
            best = Proposal(r.labels, (names[0], names[1]), odds)
    return best


def expected_log10_odds(r: Runnable, first: Fit, second: Fit, noise: Noise) -> float | None:
    """Half the squared distance of the predictions in noise units, with both models' parameters as uncertain as they
    are: d^T (I + J S J^T)^-1 d / 2, the mean log-likelihood ratio of two Gaussian predictions."""
    at = [r.predict(f.mechanisms, f.named) for f in (first, second)]
    if not all(np.all(np.isfinite(y)) for y in at):
        return None
    columns = [np.ones((r.t.size, 1)) * 1e3 * noise.s]  # the zero level is unknown
    for f, y in zip((first, second), at):
        jac = np.zeros((r.t.size, len(f.parameters)))
        for i, p in enumerate(f.parameters):
            step = STEP * p.scale * (-1.0 if f.values[i] + STEP * p.scale > p.high else 1.0)
            there = r.predict(f.mechanisms, {**f.named, p.name: f.values[i] + step})
            jac[:, i] = np.nan_to_num((there - y) / step)
        w, v = np.linalg.eigh(f.covariance) if f.parameters else (np.zeros(0), np.zeros((0, 0)))
        columns.append(jac @ (v * np.sqrt(np.maximum(w, 0.0))))
    d = noise.whiten(r.t, at[0] - at[1])
    j = noise.whiten(r.t, np.hstack(columns))
    inner = np.linalg.solve(np.eye(j.shape[1]) + j.T @ j, j.T @ d)
    return float(d @ d - (j.T @ d) @ inner) / 2 / math.log(10)
