"""Noise as what makes the residuals of an observation independent and of unit variance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.engine.system import Block, Observation

from .noise import Noise, whiten
from .readings import shapes

DROWNED = 0.05  # noise units: a wander of less is not seen beside the noise


class Whitening:
    """An observation's noise, as what makes residuals independent and of unit variance."""

    def __init__(self, noise: Noise, o: Observation) -> None:
        blocks = o.blocks or (Block(slice(0, o.t.size), noise),)
        self.weights = _weights(blocks, o)
        levels, columns = [], []
        for b in blocks:
            one = np.zeros(o.t.size)
            one[b.readings] = 1.0
            if np.isinf(b.zero):
                white = whiten(*self.weights, one)
                levels.append(white / np.linalg.norm(white))
            elif b.zero > 0:
                columns.append(b.zero * one[:, None])
            if b.noise.drift > 0:
                slow = shapes(o.t[b.readings], b.noise.reach) * b.noise.drift
                columns.append(np.zeros((o.t.size, slow.shape[1])))
                columns[-1][b.readings] = slow
        self.levels = np.stack(levels, axis=1) if levels else np.zeros((o.t.size, 0))
        self.wander = self.levelled(np.hstack(columns) if columns else np.zeros((o.t.size, 0)))

    def levelled(self, r: Array) -> Array:
        """Columns r (n,) or (n, k) whitened, their unknown zero levels projected out."""
        white = whiten(*self.weights, r)
        return white - self.levels @ (self.levels.T @ white)

    def whitened(self, r: Array, frame: tuple[Array, Array]) -> Array:
        """The same, also shrunk along what scatters from trial to trial, so that all of it has unit variance."""
        white = self.levelled(r)
        q, size = frame
        if not size.size:
            return white
        shrink = 1.0 / np.sqrt(1.0 + size * size) - 1.0
        return white + q @ ((shrink[:, None] if white.ndim == 2 else shrink) * (q.T @ white))


def _weights(blocks: Sequence[Block], o: Observation) -> tuple[Array, Array]:
    """Weights of `whiten` over all readings: no noise goes over from one instrument to the next."""
    a, b = np.zeros(o.t.size), np.zeros(o.t.size - 1)
    for block in blocks:
        first, last, _ = block.readings.indices(o.t.size)
        spread = None if o.spread is None else o.spread[block.readings]
        a[first:last], b[first : last - 1] = block.noise.weights(o.t[block.readings], spread)
    return a, b


def axes(columns: Array) -> tuple[Array, Array]:
    """Orthonormal directions (n, k) of what is spread along columns (n, m), and how far (k,); not those that the noise
    drowns."""
    q, size, _ = np.linalg.svd(columns, full_matrices=False)
    return q[:, size > DROWNED], size[size > DROWNED]


def joined(columns: Array, axes: tuple[Array, Array]) -> tuple[Array, Array]:
    """The axes of what is spread along columns (n, m) and, independently, along given axes (n, k)."""
    q, size = axes
    every = np.hstack([columns, q * size])
    square, turned = np.linalg.eigh(every.T @ every)  # of a few columns: a quarter of the time of a QR and an SVD
    real = square > 1e-12 * square.max(initial=0.0)  # less is rounding
    size = np.sqrt(square[real])
    return every @ (turned[:, real] / size), size
