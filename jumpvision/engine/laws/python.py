"""A law evaluated by Python: over numbers, numpy's arrays, or the symbols of a namespace like numpy (CasADi's)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from .tree import COMPARISONS, Node, Step, in_order, replaced, symbol

FORMS = {
    Step.NEG: "-{0}",
    **{s: f"{{0}} {s.value} {{1}}" for s in (Step.ADD, Step.SUB, Step.MUL, Step.DIV, Step.POW, *COMPARISONS)},
}


def value(root: Node, xp: Any, symbols: Mapping[str, object]) -> Any:
    """The law's value; of plain numbers as IEEE arithmetic has it, without exceptions."""
    names, function = _function(root)
    given = [symbols[n] for n in names]
    if xp is not np:
        return function(xp, *given)
    try:
        out = function(np, *given)
    except (ZeroDivisionError, OverflowError):
        out = 1j
    if isinstance(out, complex):  # Python's own numbers raise, or leave the real axis
        out = function(np, *(np.float64(x) if isinstance(x, float | int) else x for x in given))
    return out


def constant(root: Node) -> float:
    """The value of a law without symbols; inf or NaN where it has none."""
    named = replaced(root, lambda n: symbol(repr(n.number)) if n.step is Step.NUMBER else None)
    with np.errstate(all="ignore"):
        return float(value(named, np, {n: float(n) for n in named.symbols}))


@lru_cache(4096)
def _function(root: Node) -> tuple[Sequence[str], Callable[..., object]]:
    """(names of its symbols, a function of xp and their values), line by line, each part once."""
    nodes = in_order([root])
    names = [n.name for n in nodes if n.step is Step.SYMBOL]
    at = {n: f"_{k}" for k, n in enumerate(nodes)}
    arguments = [f"_x{k}" for k in range(len(names))]
    at |= {n: arguments[names.index(n.name)] for n in nodes if n.step is Step.SYMBOL}
    at |= {n: f"({n.number!r})" for n in nodes if n.step is Step.NUMBER}
    lines = [f"def f({', '.join(['xp', *arguments])}):"]
    for n in nodes:
        if n.of:
            form = FORMS.get(n.step) or f"xp.{n.step.value}({', '.join(f'{{{k}}}' for k in range(len(n.of)))})"
            lines.append(f"    {at[n]} = {form.format(*(at[c] for c in n.of))}")
    space: dict[str, Any] = {}
    exec("\n".join([*lines, f"    return {at[root]}"]), space)  # of a tree: names are ours, numbers numbers
    return names, space["f"]
