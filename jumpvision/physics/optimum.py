"""The best jump over one or more parameters of its law: a grid over a box, then smaller grids round its best point."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Jumps = Callable[[list[Array]], dict[str, NDArray]]


def best_jump(
    jumps: Jumps, low: ArrayLike, high: ArrayLike, *, points: int, rounds: int, key: str
) -> tuple[Array, dict[str, NDArray]]:
    """Where jumps(...)[key] is greatest, and the results there.

    low, high: (..., d) corners of the boxes searched. jumps takes d arrays of shape (..., n) and returns arrays of
    that shape. Each of the `rounds` + 1 grids has points^d nodes; a smaller one spans two cells of the one before, so
    the answer is right to (high - low) (2 / (points - 1))^rounds / (points - 1), where the first grid finds the
    highest peak. Returns ((..., d), {name: (...)}). NaN counts as lowest. ValueError with fewer than 4 points.
    """
    if points < 4:
        raise ValueError(f"points = {points} must be >= 4, or the grids do not shrink")
    lo, hi = np.broadcast_arrays(np.asarray(low, float), np.asarray(high, float))
    first_lo, first_hi = lo, hi
    shape, d = lo.shape[:-1], lo.shape[-1]
    nodes = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, points)] * d, indexing="ij"), axis=-1).reshape(-1, d)
    for i in range(rounds + 1):
        where = lo[..., None, :] + nodes * (hi - lo)[..., None, :]
        found = jumps([where[..., k] for k in range(d)])
        best = np.argmax(np.where(np.isnan(found[key]), -np.inf, found[key]), axis=-1)
        at = np.take_along_axis(where, best[..., None, None], axis=-2)[..., 0, :]
        cell = (hi - lo) / (points - 1)
        if i < rounds:
            lo, hi = np.maximum(at - cell, first_lo), np.minimum(at + cell, first_hi)
    return at, {n: np.take_along_axis(v, best[..., None], axis=-1)[..., 0].reshape(shape) for n, v in found.items()}
