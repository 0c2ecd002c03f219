"""Random packings of discs at an area fraction; FIRE pushes overlaps apart (Bitzek et al., PRL 97, 170201, 2006)."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from jumpvision.base.arrays import Array

from .discs import Box, Discs
from .neighbours import neighbours

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


LATTICES = {"hexagonal": 2.0 * math.sqrt(3.0), "square": 4.0}  # area of a cell over (diameter/2)^2, discs touching


def lattice(kind: str, box: Box, fraction: float, *, diameter: float, density: float) -> Discs:
    """Resting discs of one size on a lattice that fills the box to the area fraction; rows lie along x.

    kind: "hexagonal" (at most 0.907) or "square" (0.785); diameter [m], density [kg/m^2]. The axis x = 0 is one of the
    lattice's mirrors. ValueError for another kind or fraction, or a box that is not finite.
    """
    if kind not in LATTICES:
        raise ValueError(f"lattice: kind = {kind!r} must be one of {', '.join(LATTICES)}")
    densest = math.pi / LATTICES[kind]
    if not 0.0 < fraction <= densest:
        raise ValueError(f"lattice: fraction = {fraction!r} must be in (0, {densest:.4f}], where {kind} discs touch")
    half, depth = min(-box.left, box.right), box.top - box.bottom
    if not (math.isfinite(half + depth) and half > diameter and depth > 2.0 * diameter):
        raise ValueError(f"lattice: the box {box} must be finite, about x = 0 and wider than two grains")
    step = diameter * math.sqrt(densest / fraction)
    rise, shift = (step * math.sqrt(0.75), 0.5) if kind == "hexagonal" else (step, 0.0)
    rows = int((depth - diameter) / rise) + 1
    places = []
    for row in range(rows):
        across = (np.arange(-math.ceil(half / step) - 1, math.ceil(half / step) + 2) + shift * (row % 2)) * step
        across = across[np.abs(across) <= half - 0.5 * diameter]
        places.append(np.stack([across, np.full(across.size, box.top - 0.5 * diameter - row * rise)]))
    x, y = np.concatenate(places, axis=1)
    return Discs.at_rest(x, y, 0.5 * diameter, density=density)


def pack(
    box: Box,
    fraction: float,
    *,
    diameter: float,
    density: float,
    rng: np.random.Generator,
    kind: str = "bi",
    spread: float = 0.1,
    tolerance: float = 1e-3,
    rounds: int = 20_000,
) -> Discs:
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


@nb.njit(cache=True)
def overlaps(p, start, partner, box, f):  # type: ignore[no-untyped-def]
    """Forces f (n, 2) = overlaps along the normals (k = 1) of discs and walls; returns the deepest overlap [m]."""
    n, deepest = len(p), 0.0
    left, right, bottom, top = box
    f[:] = 0.0
    for i in range(n):
        for q in range(start[i], start[i + 1]):
            j = partner[q]
            dx, dy, s = p[i, 0] - p[j, 0], p[i, 1] - p[j, 1], p[i, 4] + p[j, 4]
            d2 = dx * dx + dy * dy
            if 0.0 < d2 < s * s:
                d = math.sqrt(d2)
                deepest = max(deepest, s - d)
                force = (s - d) / d
                f[i, 0] += force * dx
                f[i, 1] += force * dy
                f[j, 0] -= force * dx
                f[j, 1] -= force * dy
        r = p[i, 4]
        across = max(left + r - p[i, 0], 0.0) - max(p[i, 0] + r - right, 0.0)
        along = max(bottom + r - p[i, 1], 0.0) - max(p[i, 1] + r - top, 0.0)
        f[i, 0] += across
        f[i, 1] += along
        deepest = max(deepest, abs(across), abs(along))
    return deepest


@nb.njit(cache=True)
def relax(p, box, skin, tolerance, rounds, partner):  # type: ignore[no-untyped-def]
    """Move the discs p (n, 6) in place until none overlaps by more than `tolerance` [m]; returns the deepest overlap.

    skin [m]: neighbours are listed so much farther than they touch. Unit masses and stiffness: time is in their units.
    """
    n = len(p)
    start, f, v = np.empty(n + 1, np.int64), np.zeros((n, 2)), np.zeros((n, 2))
    listed = np.full((n, 2), np.inf)  # where they were when neighbours were listed: not yet
    dt, mix, downhill, deepest = 0.1, 0.1, 0, np.inf
    for _ in range(rounds):
        moved = 0.0
        for i in range(n):
            moved = max(moved, (p[i, 0] - listed[i, 0]) ** 2 + (p[i, 1] - listed[i, 1]) ** 2)
        if 4.0 * moved > skin * skin:
            count = neighbours(p, n, skin, start, partner)
            if count > len(partner):
                partner = np.empty(2 * count, np.int64)
                neighbours(p, n, skin, start, partner)
            for i in range(n):  # an array put into another as a whole takes seconds to compile
                listed[i, 0], listed[i, 1] = p[i, 0], p[i, 1]
        deepest = overlaps(p, start, partner, box, f)
        if deepest <= tolerance:
            break
        power, vv, ff = 0.0, 0.0, 0.0
        for i in range(n):
            for c in range(2):
                power += f[i, c] * v[i, c]
                vv += v[i, c] ** 2
                ff += f[i, c] ** 2
        if power > 0.0:
            turn = mix * math.sqrt(vv / ff)
            for i in range(n):
                for c in range(2):
                    v[i, c] = (1.0 - mix) * v[i, c] + turn * f[i, c]
            downhill += 1
            if downhill > 5:
                dt, mix = min(1.1 * dt, 0.5), 0.99 * mix
        else:
            v[:] = 0.0
            dt, mix, downhill = 0.5 * dt, 0.1, 0
        for i in range(n):
            for c in range(2):
                v[i, c] += dt * f[i, c]
                p[i, c] += dt * v[i, c]
    return deepest
