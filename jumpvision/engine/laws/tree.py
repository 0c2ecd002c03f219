"""The tree of a law: one node a step. All that is made of a law is made from its tree, by a file of this folder."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache


class LawError(ValueError):
    """What is wrong with a law, with the remedy."""


class Step(Enum):
    """What a node does with those below it; the value is how a law writes it."""

    NUMBER = "number"
    SYMBOL = "symbol"
    ADD = "+"
    SUB = "-"
    MUL = "*"
    DIV = "/"
    POW = "**"
    NEG = "negative"
    LT = "<"
    LE = "<="
    GT = ">"
    GE = ">="
    EQ = "=="
    NE = "!="
    ABS = "abs"
    SIGN = "sign"
    SQRT = "sqrt"
    EXP = "exp"
    LOG = "log"
    TAN = "tan"
    SIN = "sin"
    COS = "cos"
    TANH = "tanh"
    MINIMUM = "minimum"
    MAXIMUM = "maximum"
    WHERE = "where"


COMPARISONS = (Step.LT, Step.LE, Step.GT, Step.GE, Step.EQ, Step.NE)
ARGUMENTS = {
    s.value: n
    for n, steps in {
        1: (Step.ABS, Step.SIGN, Step.SQRT, Step.EXP, Step.LOG, Step.TAN, Step.SIN, Step.COS, Step.TANH),
        2: (Step.MINIMUM, Step.MAXIMUM),
        3: (Step.WHERE,),
    }.items()
    for s in steps
}
"""Function of a law -> how many arguments it takes."""


@dataclass(frozen=True)
class Node:
    """One step: what it works on, and its number or the name of its symbol. size, depth: of the tree below it."""

    step: Step
    of: tuple[Node, ...] = ()
    number: float = 0.0
    name: str = ""
    size: int = field(init=False, compare=False, repr=False)
    depth: int = field(init=False, compare=False, repr=False)
    symbols: frozenset[str] = field(init=False, compare=False, repr=False)
    digest: int = field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "size", 1 + sum(n.size for n in self.of))
        put(self, "depth", 1 + max((n.depth for n in self.of), default=0))
        own = {self.name} if self.step is Step.SYMBOL else set()
        put(self, "symbols", frozenset(own.union(*(n.symbols for n in self.of))))
        put(
            self,
            "digest",
            hash((*map(_whole, (self.step.value, self.name)), self.number, *(n.digest for n in self.of))),
        )

    def __hash__(self) -> int:
        return self.digest


def _whole(text: str) -> int:
    """A number of a text that is the same in every process, as a tree may come from another one."""
    return zlib.crc32(text.encode())


def number(value: float) -> Node:
    return Node(Step.NUMBER, number=float(value))


def symbol(name: str) -> Node:
    return Node(Step.SYMBOL, name=name)


ZERO, ONE = number(0.0), number(1.0)


def add(a: Node, b: Node) -> Node:
    """a + b, less what adds nothing."""
    return b if a == ZERO else a if b == ZERO else Node(Step.ADD, (a, b))


def sub(a: Node, b: Node) -> Node:
    return a if b == ZERO else negative(b) if a == ZERO else Node(Step.SUB, (a, b))


def mul(a: Node, b: Node) -> Node:
    if ZERO in (a, b):
        return ZERO
    return b if a == ONE else a if b == ONE else Node(Step.MUL, (a, b))


def div(a: Node, b: Node) -> Node:
    return a if a == ZERO or b == ONE else Node(Step.DIV, (a, b))


def negative(a: Node) -> Node:
    if a.step is Step.NUMBER:
        return number(-a.number) if a.number else ZERO
    return a.of[0] if a.step is Step.NEG else Node(Step.NEG, (a,))


def where(condition: Node, a: Node, b: Node) -> Node:
    return a if a == b else Node(Step.WHERE, (condition, a, b))


def total(terms: Iterable[Node]) -> Node:
    """The sum, from the first to the last; 0 of none."""
    out = ZERO
    for term in terms:
        out = add(out, term)
    return out


def in_order(roots: Iterable[Node]) -> list[Node]:
    """Every different node of the trees, each after those that it works on."""
    out: dict[Node, None] = {}

    def visit(n: Node) -> None:
        if n not in out:
            for child in n.of:
                visit(child)
            out[n] = None

    for root in roots:
        visit(root)
    return [*out]


def replaced(root: Node, change: Callable[[Node], Node | None]) -> Node:
    """The tree with change(node) in the place of each node for which it is one, from the leaves up."""
    done: dict[Node, Node] = {}
    for n in in_order([root]):
        same = all(done[c] is c for c in n.of)
        new = n if same else Node(n.step, tuple(done[c] for c in n.of), n.number, n.name)
        done[n] = change(new) or new
    return done[root]


def with_symbols(root: Node, by: Mapping[str, Node]) -> Node:
    """The tree with trees in the place of symbols."""
    return replaced(root, lambda n: by.get(n.name) if n.step is Step.SYMBOL else None)


@lru_cache(1024)  # asked for at every point of a plan
def smooth(root: Node, size: float, width: float) -> Node:
    """The tree with abs(x) as sqrt(x^2 + size^2), sign(x) as x / sqrt(x^2 + width^2): both have derivatives at 0."""

    def rounded(x: Node, least: float) -> Node:
        return Node(Step.SQRT, (add(mul(x, x), number(least * least)),))

    def change(n: Node) -> Node | None:
        if n.step is Step.ABS and size:
            return rounded(n.of[0], size)
        return div(n.of[0], rounded(n.of[0], width)) if n.step is Step.SIGN and width else None

    return replaced(root, change)


def jumps_in(root: Node, name: str) -> bool:
    """Whether its value may jump where the symbol passes zero: it has its sign, or compares it."""
    return any(n.step in (Step.SIGN, *COMPARISONS) and name in n.symbols for n in in_order([root]))
