"""What moves with the foot, disc by disc: the plug's front and sides, its mass, the momentum (thesis Fig. 53).

A disc belongs to the plug where it goes down with at least SHARE of the foot's speed. No grid and no smoothing: these
are the discs' own numbers, the truth of whatever a film of them says.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array

SHARE = 0.9
ROWS = 6  # of discs that a side needs
INNER = 0.1, 0.9  # of the front's depth: the side is read off between


class Plug(NamedTuple):
    """At one instant: front [m] below the face, theta [deg] of the sides to the horizontal, plug [kg] the mass of its
    discs, momentum [kg m/s] of all discs, down. NaN where there is no plug, or no side.
    """

    front: float
    theta: float
    plug: float
    momentum: float


def plug_of(x: Array, y: Array, vy: Array, mass: Array, radius: Array, *, foot_y: float, foot_v: float) -> Plug:
    """x, y [m], vy [m/s] up, mass [kg], radius [m] of the discs (n,); foot_y [m], foot_v [m/s] of the face."""
    below = y < foot_y
    momentum = -float(np.sum((mass * vy)[below]))
    inside = below & (vy <= SHARE * foot_v)
    if not (foot_v < 0.0 and inside.any()):
        return Plug(math.nan, math.nan, math.nan, momentum)
    grain = 2.0 * float(np.mean(radius))
    depth = foot_y - y
    near = below & (np.abs(x) < 1.5 * grain)
    front = boundary(depth[near], inside[near])
    return Plug(front, side(x, depth, inside, grain, front), float(np.sum(mass[inside])), momentum)


def boundary(r: Array, inside: NDArray[np.bool_]) -> float:
    """Where discs at r (n,) that are `inside` end: the fewest on the wrong side; NaN where none is inside."""
    order = np.argsort(r, kind="stable")
    r, inside = r[order], inside[order]
    wrong = inside.sum() + np.concatenate([[0], np.cumsum(np.where(inside, -1, 1))])
    k = int(np.argmin(wrong))
    return float(0.5 * (r[k - 1] + r[min(k, r.size - 1)])) if k else math.nan


def side(x: Array, depth: Array, inside: NDArray[np.bool_], grain: float, front: float) -> float:
    """theta [deg] of the line |x| = a - z/tan(theta) by the ends of rows a grain high, left and right."""
    if not front > ROWS * grain:
        return math.nan
    places: list[tuple[float, float]] = []
    for top in np.arange(INNER[0] * front, INNER[1] * front - grain, grain):
        row = (depth >= top) & (depth < top + grain)
        for sign in (-1.0, 1.0):
            use = row & (sign * x > -0.25 * grain)
            if use.any():
                places.append((top + 0.5 * grain, boundary(sign * x[use], inside[use])))
    z, reach = np.array(places).reshape(-1, 2).T
    good = np.isfinite(reach)
    if good.sum() < ROWS:
        return math.nan
    return math.degrees(math.atan2(1.0, -np.polyfit(z[good], reach[good], 1)[0]))
