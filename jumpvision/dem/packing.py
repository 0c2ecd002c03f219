"""Random packings of discs at a given area fraction."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from jumpvision.dem.discs import Box, Discs
from jumpvision.dem.relax import relax

Array = NDArray[np.float64]

BIDISPERSE = 1.4  # ratio of the two diameters, in equal numbers: the usual one, which does not crystallise

SWOLLEN, SPREADING = 0.9, 500  # area fraction to which the discs are blown up first, and rounds of their spreading


def sizes(kind: str, n: int, diameter: float, spread: float, rng: np.random.Generator) -> Array:
    """Radii (n,) [m] of the mean diameter [m]: "mono"; "bi" (ratio 1.4, equal numbers); "poly" (normal)."""
    if kind == "mono":
        return np.full(n, 0.5 * diameter)
    if kind == "bi":
        small = diameter / (1.0 + BIDISPERSE)
        return rng.permutation(np.where(np.arange(n) % 2 == 0, small, BIDISPERSE * small))
    if kind == "poly":
        return 0.5 * diameter * np.clip(rng.normal(1.0, spread, n), 1.0 - 3.0 * spread, 1.0 + 3.0 * spread)
    raise ValueError(f"sizes: kind = {kind!r} must be 'mono', 'bi' or 'poly'")


def pack(
    box: Box, fraction: float, *, diameter: float, density: float, rng: np.random.Generator, kind: str = "bi",
    spread: float = 0.1, tolerance: float = 1e-3, rounds: int = 20_000,
) -> Discs:  # fmt: skip
    """Resting discs that fill the box to the area fraction, no two overlapping by more than tolerance diameters.

    diameter [m]: mean; density [kg/m^2]. Thrown in at random, spread evenly and pushed apart. ValueError where
    they do not come apart in so many rounds: random discs of two sizes jam at about 0.84.
    """
    width, height = box.right - box.left, box.top - box.bottom
    if not (math.isfinite(width * height) and width > 2 * diameter and height > 2 * diameter):
        raise ValueError(f"pack: the box {box} must be finite and wider than two grains")
    if not 0.0 < fraction < 0.9:
        raise ValueError(f"pack: fraction = {fraction!r} must be in (0, 0.9)")
    mean_area = (
        0.25 * math.pi * diameter**2 * float(np.mean(sizes(kind, 10_000, 2.0, spread, np.random.default_rng(0)) ** 2))
    )
    radius = sizes(kind, round(fraction * width * height / mean_area), diameter, spread, rng)
    radius *= math.sqrt(fraction * width * height / (math.pi * np.sum(radius**2)))
    n = len(radius)
    xy = np.stack([rng.uniform(box.left, box.right, n), rng.uniform(box.bottom, box.top, n)], axis=1)
    order = np.lexsort((xy[:, 0], np.floor(xy[:, 1] / (2 * diameter))))
    p = np.zeros((n, 6))
    p[:, :2], p[:, 4] = xy[order], radius
    partner = np.empty(8 * n + 16, np.int64)
    # blown up beyond jamming they spread evenly; pushed apart at their own size only, they leave voids and clumps
    swollen = max(1.0, math.sqrt(SWOLLEN / fraction))
    walls = (box.left, box.right, box.bottom, box.top)
    p[:, 4] *= swollen
    relax(p, walls, 0.3 * diameter, 0.0, SPREADING, partner)
    p[:, 4] = radius
    worst = relax(p, walls, 0.3 * diameter, tolerance * diameter, rounds, partner)
    if worst > tolerance * diameter:
        raise ValueError(
            f"pack: discs still overlap by {worst / diameter:.1e} diameters after {rounds} rounds at area fraction "
            f"{fraction:g}; give a smaller fraction (random discs jam near 0.84) or more rounds"
        )
    return Discs.at_rest(p[:, 0], p[:, 1], p[:, 4], density=density)
