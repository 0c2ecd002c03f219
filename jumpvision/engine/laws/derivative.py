"""Derivatives of a law as trees, and its kinks: where a minimum, maximum, size or comparison changes its side."""

from __future__ import annotations

from collections.abc import Collection
from functools import lru_cache

from .tree import (
    COMPARISONS,
    ONE,
    ZERO,
    Node,
    Step,
    add,
    div,
    in_order,
    mul,
    negative,
    number,
    sub,
    where,
    with_symbols,
)


@lru_cache(4096)
def derivative(root: Node, name: str) -> Node:
    """d root / d name. Of what has a kink or jumps the one on its side; where both sides meet, either."""
    done: dict[Node, Node] = {}
    for n in in_order([root]):
        done[n] = _slope(n, [done[c] for c in n.of], name) if name in n.symbols else ZERO
    return done[root]


def _slope(n: Node, slopes: list[Node], name: str) -> Node:
    if n.step is Step.SYMBOL:
        return ONE
    a, da = n.of[0], slopes[0]
    if n.step is Step.NEG:
        return negative(da)
    if n.step in (Step.SIGN, *COMPARISONS):
        return ZERO
    if n.step is Step.ABS:
        return mul(Node(Step.SIGN, (a,)), da)
    if n.step is Step.WHERE:
        return where(a, slopes[1], slopes[2])
    return mul(_outer(n, a), da) if len(n.of) == 1 else _of_two(n, a, n.of[1], da, slopes[1], name)


def _outer(n: Node, a: Node) -> Node:
    """The derivative of a function of one argument by it."""
    if n.step is Step.SQRT:
        return div(number(0.5), n)
    if n.step is Step.EXP:
        return n
    if n.step is Step.LOG:
        return div(ONE, a)
    if n.step is Step.TAN:
        return add(ONE, mul(n, n))
    if n.step is Step.TANH:
        return sub(ONE, mul(n, n))
    return Node(Step.COS, (a,)) if n.step is Step.SIN else negative(Node(Step.SIN, (a,)))


def _of_two(n: Node, a: Node, b: Node, da: Node, db: Node, name: str) -> Node:
    if n.step is Step.ADD:
        return add(da, db)
    if n.step is Step.SUB:
        return sub(da, db)
    if n.step is Step.MUL:
        return add(mul(da, b), mul(a, db))
    if n.step is Step.DIV:
        return div(sub(da, mul(n, db)), b)
    if n.step in (Step.MINIMUM, Step.MAXIMUM):
        side = Step.LT if n.step is Step.MINIMUM else Step.GT
        return where(Node(side, (a, b)), da, db)
    if name not in b.symbols:
        less = number(b.number - 1.0) if b.step is Step.NUMBER else sub(b, ONE)
        return mul(mul(b, a if less == ONE else Node(Step.POW, (a, less))), da)
    return mul(n, add(mul(db, Node(Step.LOG, (a,))), div(mul(b, da), a)))


def kinks(root: Node, name: str, constants: Collection[str]) -> tuple[Node, ...]:
    """Values of the symbol, as trees of constants, at which the law bends or jumps: where what is compared, linear in
    the symbol, is equal. What depends on other symbols is left out."""
    out: dict[Node, None] = {}
    for n in in_order([root]):
        if n.step in (Step.ABS, Step.SIGN):
            gap = n.of[0]
        elif n.step in (Step.MINIMUM, Step.MAXIMUM, *COMPARISONS):
            gap = sub(*n.of)
        else:
            continue
        slope = derivative(gap, name)
        if slope != ZERO and gap.symbols <= {name, *constants} and name not in slope.symbols:
            out[div(negative(with_symbols(gap, {name: ZERO})), slope)] = None
    return tuple(out)
