"""Jammed front and cone of discs, from each disc's displacement: no grid, no smoothing, nothing of the analysis.

A disc belongs to the plug where it goes down by at least SHARE of what the discs at the foot's face do (their median:
when the foot slows down the plug slides on ahead of it). A boundary is where the fewest discs lie on the wrong side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from dem_scene import Scene, mid_exposure

SHARE, LAYER = 0.9, 3  # of the displacement of the discs so many grains below the part that is not used
COLUMN = 0.005  # m, half width of the column in which the front is looked for
CLEAR = 0.002  # m below the face, not used
SIDE = 0.8  # of the front's depth: the side of the cone is looked for above it
WIDEST = 1.4  # foot half widths


@dataclass(frozen=True)
class Cone:
    """Of the pairs of frames: foot's depth and speed [m], [m/s], front's depth below the face [m], theta [deg]."""

    depth: np.ndarray
    speed: np.ndarray
    front: np.ndarray
    theta: np.ndarray


def cone_of_discs(scene: Scene, m) -> Cone:
    """The co-moving discs below the foot in each pair of frames; NaN where there are none."""
    t, x, y, face = mid_exposure(m)
    bottom = (scene.shape[0] - 0.5 - scene.surface_row) * scene.scale
    front, theta = [], []
    for k in range(len(t) - 1):
        at, top = 0.5 * (x[k] + x[k + 1]), 0.5 * (face[k] + face[k + 1])
        z = top - 0.5 * (y[k] + y[k + 1])
        use = (np.abs(at) < COLUMN) & (z > CLEAR) & (z < bottom + top)
        down = y[k] - y[k + 1]
        comoving = down >= SHARE * np.median(down[use & (z < CLEAR + LAYER * scene.grain)])
        front.append(boundary(z[use], comoving[use]))
        theta.append(side(scene, at, z, comoving, SIDE * front[-1]))
    return Cone(-0.5 * (face[1:] + face[:-1]), -np.diff(face) / np.diff(t), np.array(front), np.array(theta))


def crossing(depth: np.ndarray, speed: np.ndarray) -> float:
    """Depth [m] where a measured column (NaN: no vector) first falls below SHARE of its plateau, between its points.

    The plateau is the median of what exceeds 0.95 of the greatest speed; nothing is fitted. NaN where it never falls.
    """
    order = np.argsort(depth)
    z, v = depth[order], speed[order]
    z, v = z[np.isfinite(v)], v[np.isfinite(v)]
    if v.size == 0:
        return math.nan
    level = SHARE * float(np.median(v[: max(3, int(np.sum(v > 0.95 * v.max())))]))
    below = np.flatnonzero(v < level)
    if below.size == 0 or below[0] == 0:
        return math.nan
    k = int(below[0])
    return float(z[k - 1] + (v[k - 1] - level) / (v[k - 1] - v[k]) * (z[k] - z[k - 1]))


def slope(depth: np.ndarray, front: np.ndarray) -> float:
    """mu: the least-squares slope of the front's depth below the face against the foot's; NaN left out."""
    good = np.isfinite(front)
    return float(np.polyfit(depth[good], front[good], 1)[0])


def boundary(r: np.ndarray, inside: np.ndarray) -> float:
    """Where discs at r that are `inside` end: the fewest on the wrong side; NaN where none is inside."""
    order = np.argsort(r)
    r, inside = r[order], inside[order]
    wrong = inside.sum() + np.concatenate([[0], np.cumsum(np.where(inside, -1, 1))])
    k = int(np.argmin(wrong))
    return float(0.5 * (r[k - 1] + r[min(k, r.size - 1)])) if k else math.nan


def side(scene: Scene, x: np.ndarray, z: np.ndarray, comoving: np.ndarray, bottom: float) -> float:
    """theta [deg] of the least-squares line |x| = R - z/tan(theta) by the ends of rows a grain high, both sides."""
    places: list[tuple[float, float]] = []
    for row in np.arange(CLEAR, np.nan_to_num(bottom) - scene.grain, scene.grain):
        for sign in (-1, 1):
            use = (z >= row) & (z < row + scene.grain) & (sign * x > 0.0) & (sign * x < WIDEST * scene.foot)
            places.append((row + 0.5 * scene.grain, boundary(sign * x[use], comoving[use])))
    depth, reach = np.array(places).reshape(-1, 2).T
    good = np.isfinite(reach)
    if good.sum() < 8:
        return math.nan
    return math.degrees(math.atan2(1.0, -np.polyfit(depth[good], reach[good], 1)[0]))
