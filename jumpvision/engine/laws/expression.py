"""A law in one line of text: arithmetic, comparisons and a few functions of declared symbols; nothing is executed.

The text is parsed to a tree (`tree`) once; the other files of this folder make of the tree what is needed.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from . import python
from .tree import ARGUMENTS, Node, Step, in_order
from .tree import LawError as LawError

LONGEST = 400  # characters of a law: a line that is read by eye
DEEPEST = 40  # steps within each other; the deepest law of a vocabulary has 14
LARGEST = 2000  # steps of a law with its named parts written out

BINARY = {ast.Add: Step.ADD, ast.Sub: Step.SUB, ast.Mult: Step.MUL, ast.Div: Step.DIV, ast.Pow: Step.POW}
COMPARED = {
    ast.Lt: Step.LT,
    ast.LtE: Step.LE,
    ast.Gt: Step.GT,
    ast.GtE: Step.GE,
    ast.Eq: Step.EQ,
    ast.NotEq: Step.NE,
}


@dataclass(frozen=True)
class Expression:
    """A law: called as law(xp, **symbols) with numbers, arrays that broadcast, or symbols of a namespace xp like numpy.

    text: as written, in its own names. root: its tree, under the names by which it is called.
    """

    text: str
    root: Node = field(repr=False)

    @cached_property
    def symbols(self) -> tuple[str, ...]:
        """Names that it is called with."""
        return tuple(n.name for n in in_order([self.root]) if n.step is Step.SYMBOL)

    def __call__(self, xp: Any, **symbols: Any) -> Any:
        return python.value(self.root, xp, symbols)

    def typeset(self, words: Mapping[str, str] = {}) -> str:
        """As mathtext without the dollars. words: how symbols and parameters read, e.g. a value in place of a name."""
        from . import mathtext

        return mathtext.typeset(self.root, words)

    def __str__(self) -> str:
        return self.text


def parse(text: str, names: Mapping[str, str], let: Mapping[str, str] = {}) -> Expression:
    """The law of a text. names: what it may use -> the name it is called by. let: names of parts of it -> their texts,
    which may use each other. Raises LawError with the remedy."""
    root = _Reader(names, let).tree(text)
    for n in in_order([root]):
        _check_constant(n)
    return Expression(text.strip(), root)


class _Reader:
    """One law being read, with the parts that were read before."""

    def __init__(self, names: Mapping[str, str], let: Mapping[str, str]) -> None:
        self.names, self.let = names, let
        for name in let:
            if name in names or name in ARGUMENTS or not name.isidentifier():
                raise LawError(f"let {name}: is no new name; call that part otherwise")
        self.parts: dict[str, Node | None] = {}  # None: being read

    def tree(self, text: str) -> Node:
        if len(text) > LONGEST:
            raise LawError(f"{len(text)} characters; at most {LONGEST} are read: write a shorter law")
        try:
            found = ast.parse(text.strip(), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError) as e:
            at = f" at character {e.offset}" if isinstance(e, SyntaxError) and e.offset else ""
            raise LawError(f"not a formula{at}: write it as q * sign(v) * z**2") from None
        if "^" in text:
            raise LawError("'^' is no power here; write **, as in abs(v)**1.5")
        return self.node(found, 0)

    def node(self, tree: ast.AST, depth: int) -> Node:
        if depth > DEEPEST:
            raise LawError(f"nested more than {DEEPEST} deep: write its parts under .let")
        out = self._node(tree, depth + 1)
        if out.size > LARGEST or out.depth > 4 * DEEPEST:
            raise LawError(f"more than {LARGEST} steps with its parts written out: write a shorter law")
        return out

    def _node(self, tree: ast.AST, depth: int) -> Node:
        if isinstance(tree, ast.BinOp) and type(tree.op) in BINARY:
            return Node(BINARY[type(tree.op)], (self.node(tree.left, depth), self.node(tree.right, depth)))
        if isinstance(tree, ast.UnaryOp) and isinstance(tree.op, ast.USub | ast.UAdd):
            inner = self.node(tree.operand, depth)
            if isinstance(tree.op, ast.UAdd):
                return inner
            return Node(Step.NUMBER, number=-inner.number) if inner.step is Step.NUMBER else Node(Step.NEG, (inner,))
        if isinstance(tree, ast.Constant) and isinstance(tree.value, int | float) and not isinstance(tree.value, bool):
            return Node(Step.NUMBER, number=_number(tree.value))
        if isinstance(tree, ast.Name):
            return self.named(tree.id)
        if isinstance(tree, ast.Compare):
            if len(tree.ops) != 1 or type(tree.ops[0]) not in COMPARED:
                raise LawError(
                    f"'{ast.unparse(tree)}': one comparison at a time; write where(z > a, where(z < b, ..., 0), 0)"
                )
            sides = (self.node(tree.left, depth), self.node(tree.comparators[0], depth))
            return Node(COMPARED[type(tree.ops[0])], sides)
        if isinstance(tree, ast.Call):
            return self.call(tree, depth)
        raise LawError(
            f"'{ast.unparse(tree)}' is not read; a law has + - * / **, comparisons, {', '.join(ARGUMENTS)}, numbers "
            "and declared symbols"
        )

    def call(self, tree: ast.Call, depth: int) -> Node:
        name = tree.func.id if isinstance(tree.func, ast.Name) else ast.unparse(tree.func)
        if name not in ARGUMENTS or tree.keywords:
            raise LawError(f"unknown function '{name}'; known: {', '.join(ARGUMENTS)}")
        if len(tree.args) != (count := ARGUMENTS[name]):
            raise LawError(f"{name} takes {count} argument{'s' if count > 1 else ''}, not {len(tree.args)}")
        return Node(Step(name), tuple(self.node(a, depth) for a in tree.args))

    def named(self, name: str) -> Node:
        """A symbol, or a part of the law by its name."""
        if name in self.let:
            if name not in self.parts:
                self.parts[name] = None
                try:
                    self.parts[name] = self.tree(self.let[name])
                except LawError as e:
                    raise LawError(f"let {name} = {self.let[name]!r}: {e}") from None
            if (part := self.parts[name]) is None:
                raise LawError(f"let {name} is made of itself; write it of other names")
            return part
        if name in self.names:
            return Node(Step.SYMBOL, name=self.names[name])
        if name == "pi":
            return Node(Step.NUMBER, number=math.pi)
        if name in ARGUMENTS:
            raise LawError(f"'{name}' is a function; write {name}(...)")
        known = ", ".join([*self.names, *self.let])
        raise LawError(f"unknown symbol '{name}'; known here: {known}; declare parameters under .parameters")


def _number(value: float) -> float:
    try:
        out = float(value)
    except OverflowError:
        out = math.inf
    if not math.isfinite(out):
        raise LawError("a number is too large: numbers reach to 1.8e308")
    return out


def _check_constant(n: Node) -> None:
    """Raises LawError where numbers alone give none: 9**9**9, 1 / 0; and for what is divided by a zero."""
    if n.step is Step.DIV and not n.of[1].symbols and python.constant(n.of[1]) == 0.0:
        raise LawError("divides by zero: a number or a difference of numbers below a / is 0")
    if not n.symbols and n.of and not math.isfinite(python.constant(n)):
        from . import mathtext

        raise LawError(f"the number {mathtext.plain(n)} is too large or none")
