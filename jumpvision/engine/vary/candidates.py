"""Patterns as candidates beside the mechanisms: fitted, tested and weighed as they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.engine.system import Candidate, Parameter

from .patterns import Pattern, Weighed
from .variables import SINCE, Changes

FAR = 8.0  # spreads: as far as a coefficient may go


def coefficient(name: str, k: int) -> str:
    """Name of a pattern's k-th coefficient as a parameter."""
    return f"{name}:{k}"


def coefficients_of(patterns: Mapping[str, Pattern]) -> set[str]:
    """The parameters of all of these patterns."""
    return {coefficient(m, k) for m, p in patterns.items() for k in range(p.design.shape[1])}


def candidate(w: Weighed, log_price: float) -> Candidate:
    """log_price: of the number, among those asked of, and of the kind."""
    pattern = w.pattern
    free = tuple(
        Parameter(
            coefficient(pattern.name, k),
            0.0,
            max(-FAR * s, v.least),
            FAR * s,
            max(abs(float(x)), 0.01 * s),  # so that a search begins at the value that the screen found
            float(s),
        )
        for k, (v, x, s) in enumerate(zip(pattern.variables, w.coefficients, pattern.spreads))
    )
    shape = tuple(float(x) for x in w.coefficients[1:])
    begin = {**w.shared, **{p.name: float(x) for p, x in zip(free, w.coefficients)}}
    own = tuple(p.name for p in free[:-1]) if pattern.about_own else ()  # without which it is a mechanism's change
    return Candidate(free, shapes=(shape,), price=log_price + pattern.log_price, begin=begin, own=own)


def changes_of(
    patterns: Mapping[str, Pattern], mechanisms: Sequence[str], values: Mapping[str, float], count: int
) -> Changes:
    """What these patterns change in every recording; of one number several add up."""
    out: dict[str, Array] = {}
    for m in mechanisms:
        if (p := patterns.get(m)) is None:
            continue
        b = np.array([values.get(coefficient(m, k), 0.0) for k in range(p.design.shape[1])])
        for n, c in p.changes(b).items():
            out[n] = out.get(n, np.zeros(count)) + c
        if p.since is not None:
            out[SINCE] = p.since
    return out
