"""The dimension of a law from the units of its symbols."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from jumpvision.base.units import unit_of

from .tree import COMPARISONS, LawError, Node, Step

Dimension = Mapping[str, float]
"""Exponents of the base units, e.g. {"m": 1, "s": -1}; angles have none."""


@cache
def dimension(unit: str) -> tuple[tuple[str, float], ...]:
    """Return the exponents of a unit such as `N s^0.5 m^-1.5` ("" or "1": none). Raises LawError where it is none."""
    try:
        _, powers = unit_of(unit)
    except ValueError as e:
        raise LawError(str(e)) from None
    return tuple((n, p) for n, p in powers.items() if n != "turn")


def check_dimension(law: Node, units: Mapping[str, str], wanted: str) -> None:
    """Raises LawError unless the law, with symbols of these units, has the unit that is wanted."""
    found = _dimension(law, {n: dict(dimension(u)) for n, u in units.items()})
    need = dict(dimension(wanted))
    if found is not None and _differ(found, need):
        missing = {k: need.get(k, 0.0) - found.get(k, 0.0) for k in {*found, *need}}
        raise LawError(
            f"has the dimension {_words(found)}, not that of {wanted or '1'}; a factor of {_words(missing)} is "
            "missing: look at the units of its parameters"
        )


def _differ(a: Dimension, b: Dimension) -> bool:
    return any(abs(a.get(k, 0.0) - b.get(k, 0.0)) > 1e-9 for k in {*a, *b})


def _words(d: Dimension) -> str:
    parts = [f"{k}^{v:g}".removesuffix("^1") for k, v in d.items() if abs(v) > 1e-9]
    return " ".join(parts) or "1"


def _dimension(node: Node, units: Mapping[str, dict[str, float]]) -> dict[str, float] | None:
    """Exponents of the base dimensions; None: a plain zero, which goes with every dimension."""
    if node.step is Step.NUMBER:
        return None if node.number == 0.0 else {}
    if node.step is Step.SYMBOL:
        return units[node.name]
    of = [_dimension(n, units) for n in node.of]
    first = of[0] or {}
    if node.step in (Step.MUL, Step.DIV):
        sign = 1.0 if node.step is Step.MUL else -1.0
        second = of[1] or {}
        return {k: first.get(k, 0.0) + sign * second.get(k, 0.0) for k in {*first, *second}}
    if node.step is Step.SQRT:
        return {k: 0.5 * v for k, v in first.items()}
    if node.step is Step.POW:
        return _of_power(node, first, of[1] or {})
    if node.step in (Step.EXP, Step.LOG, Step.TAN, Step.SIN, Step.COS, Step.TANH):
        if _differ(first, {}):
            raise LawError(f"{node.step.value} of a quantity of the dimension {_words(first)}: divide it by a scale")
        return {}
    if node.step is Step.SIGN:
        return {}
    if node.step in (Step.NEG, Step.ABS):
        return of[0]
    return _of_equal(node, of[1:] if node.step is Step.WHERE else of)


def _of_power(node: Node, base: dict[str, float], exponent: dict[str, float]) -> dict[str, float]:
    if _differ(exponent, {}):
        raise LawError(f"an exponent has the dimension {_words(exponent)}; an exponent must be a plain number")
    if not _differ(base, {}):
        return {}
    if node.of[1].step is not Step.NUMBER:
        raise LawError(
            f"what has the dimension {_words(base)} is raised to a power that is not a number: divide it by a "
            "parameter of its unit first, as in abs(v / v_0)**p"
        )
    return {k: node.of[1].number * v for k, v in base.items()}


def _of_equal(node: Node, sides: list[dict[str, float] | None]) -> dict[str, float] | None:
    known = [d for d in sides if d is not None]
    if len(known) == 2 and _differ(known[0], known[1]):
        raise LawError(
            f"'{node.step.value}' of {_words(known[0])} and {_words(known[1])}: both sides need the same dimension"
        )
    if node.step in COMPARISONS:
        return {}
    return known[0] if known else None
