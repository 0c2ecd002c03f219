"""Abrupt edges: where a flight meets a rest, a straight motion or the next flight, at the crossing of their curves."""

from __future__ import annotations

import math

import numpy as np

from .piece import Line


def crossing(a: Line, b: Line, near: float) -> float | None:
    """The time [s] at which two curves meet, the one nearest to `near`; None where they do not."""
    slope, value = a.slope(near) - b.slope(near), a.at(near) - b.at(near)
    bend = _bend(a) - _bend(b)
    if abs(bend) * abs(value) < 1e-12 * slope * slope or bend == 0.0:
        return near - value / slope if slope else None
    root = slope * slope - 4.0 * bend * value
    if root < 0.0:
        return None
    far = -0.5 * (slope + math.copysign(math.sqrt(root), slope))
    found = [far / bend] + ([value / far] if far else [])
    return near + min(found, key=abs)


def _bend(a: Line) -> float:
    return a.bend + (float(a.p[2]) if a.p.size > 2 else 0.0)


def moves(a: Line, b: Line, at: float) -> tuple[np.ndarray, np.ndarray]:
    """d time / d p of the two curves at their crossing: their difference over the jump of the slope."""
    jump = b.slope(at) - a.slope(at)
    return a.row(at) / jump, -b.row(at) / jump
