"""Where the model fails: mean residual by kind and part of the motion, judged against the largest of as many cells."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .detect import Span
from .fitting import Fit, Problem

Array = NDArray[np.float64]

DRAWS = 20_000
FEWEST = 8  # samples of a cell


@dataclass(frozen=True)
class Cell:
    """mean_residual: measured minus predicted [unit of y]; z_score: of a shift of the whole cell, beside what the
    parameters can do; p_value: of as large a z in any cell, were there nothing."""

    labels: dict[str, Any]
    part: str
    n: int
    mean_residual: float
    z_score: float
    p_value: float


def locate(problem: Problem, fit: Fit, by: tuple[str, ...], rng: np.random.Generator) -> list[Cell]:
    """Cells of equal labels `by` and part of the motion, the most significant first."""
    span = Span(fit)
    residual = span.off(span.residual)
    observations = problem.system.observations
    predicted = problem.system.predict(fit.mechanisms, fit.named, problem.all)
    cells: dict[tuple[Any, ...], dict[int, NDArray[np.bool_]]] = {}
    for i, o in enumerate(observations):
        parts = o.parts if o.parts is not None else np.full(o.t.size, "all")
        for part in np.unique(parts):
            key = (*(o.labels.get(b) for b in by), str(part))
            cells.setdefault(key, {})[i] = parts == part
    vectors, rows = [], []
    for key, masks in cells.items():
        raw = np.concatenate([(observations[i].y - predicted[i])[m] for i, m in masks.items()])
        if raw.size < FEWEST:
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
    matrix = np.stack(vectors, axis=1)
    w, v = np.linalg.eigh(matrix.T @ matrix)
    draws = rng.standard_normal((DRAWS, w.size)) @ (v * np.sqrt(np.maximum(w, 0.0))).T
    largest = np.sort(np.max(np.abs(draws), axis=1))
    cells_out = [
        Cell(
            dict(zip(by, key[:-1])), key[-1], n, mean, z,
            float(DRAWS - np.searchsorted(largest, abs(z)) + 1) / (DRAWS + 1),
        )
        for key, n, mean, z in rows
    ]  # fmt: skip
    return sorted(cells_out, key=lambda c: -abs(c.z_score))
