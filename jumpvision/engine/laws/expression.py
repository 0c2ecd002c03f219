"""A law in one line of text: arithmetic, comparisons and a few functions of declared symbols; nothing is executed.

The text is parsed to a tree once. From the tree come the value (over any array namespace), the dimension, the steps
of a stack machine that compiled code runs (`physics.sand.program`), and how it is typeset.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any

END, NUMBER, SYMBOL, ADD, SUB, MUL, DIV, POW, NEG, SQUARE, LT, LE, GT, GE, EQ, NE = range(16)
ABS, SIGN, SQRT, EXP, LOG, TAN, SIN, COS, MINIMUM, MAXIMUM, WHERE = range(16, 27)
"""Steps of the stack machine; NUMBER and SYMBOL carry an index, as step + WIDTH * index."""
WIDTH = 32
DEEPEST = 8  # numbers on the stack of the machine
LONGEST = 400  # characters of a law

FUNCTIONS = {
    "abs": (ABS, 1),
    "sign": (SIGN, 1),
    "sqrt": (SQRT, 1),
    "exp": (EXP, 1),
    "log": (LOG, 1),
    "tan": (TAN, 1),
    "sin": (SIN, 1),
    "cos": (COS, 1),
    "minimum": (MINIMUM, 2),
    "maximum": (MAXIMUM, 2),
    "where": (WHERE, 3),
}
BINARY: dict[type[ast.operator], tuple[int, str]] = {
    ast.Add: (ADD, "+"),
    ast.Sub: (SUB, "-"),
    ast.Mult: (MUL, "*"),
    ast.Div: (DIV, "/"),
    ast.Pow: (POW, "**"),
}
COMPARISONS: dict[type[ast.cmpop], tuple[int, str]] = {
    ast.Lt: (LT, "<"),
    ast.LtE: (LE, "<="),
    ast.Gt: (GT, ">"),
    ast.GtE: (GE, ">="),
    ast.Eq: (EQ, "=="),
    ast.NotEq: (NE, "!="),
}


class LawError(ValueError):
    """What is wrong with a law, with the remedy."""


@dataclass(frozen=True)
class Node:
    """One step of a law: its code, what it works on, and its number or the name of its symbol."""

    step: int
    of: tuple[Node, ...] = ()
    number: float = 0.0
    name: str = ""

    def walk(self) -> list[Node]:
        """This node after all that it works on."""
        return [n for child in self.of for n in child.walk()] + [self]


@dataclass(frozen=True)
class Expression:
    """A law: called as law(xp, **symbols) like those of the package, with arrays of any shapes that broadcast.

    text: as written, in its own names. names: its symbols under the names by which it is called.
    """

    text: str
    root: Node = field(repr=False)

    @cached_property
    def symbols(self) -> tuple[str, ...]:
        """Names that it is called with."""
        return tuple(dict.fromkeys(n.name for n in self.root.walk() if n.step == SYMBOL))

    def __call__(self, xp: Any, **symbols: Any) -> Any:
        return _value(self.root, xp, symbols)

    @cached_property
    def steps(self) -> tuple[tuple[int, ...], tuple[float | str, ...]]:
        """(codes, what they load: numbers, and symbols by name): reverse Polish, index k of a load in its code."""
        codes: list[int] = []
        loads: list[float | str] = []
        for n in self.root.walk():
            if n.step in (NUMBER, SYMBOL):
                what = n.number if n.step == NUMBER else n.name
                if what not in loads:
                    loads.append(what)
                codes.append(n.step + WIDTH * loads.index(what))
            else:
                codes.append(n.step)
        return tuple(codes), tuple(loads)

    def jumps_in(self, symbol: str) -> bool:
        """Whether its value may jump where the symbol passes zero: it has its sign, or compares it."""
        kinds = (SIGN, LT, LE, GT, GE, EQ, NE)
        return any(n.step in kinds and any(m.name == symbol for m in n.walk()) for n in self.root.walk())

    def typeset(self, words: Mapping[str, str] = {}) -> str:
        """As mathtext without the dollars. words: how symbols and parameters read, e.g. a value in place of a name."""
        return _typeset(self.root, words)[0]

    def __str__(self) -> str:
        return self.text


def parse(text: str, names: Mapping[str, str]) -> Expression:
    """The law of a text. names: what it may use -> the name it is called by. Raises LawError with the remedy."""
    if len(text) > LONGEST:
        raise LawError(f"{len(text)} characters; at most {LONGEST} are read: write a shorter law")
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError) as e:
        at = f" at character {e.offset}" if isinstance(e, SyntaxError) and e.offset else ""
        raise LawError(f"not a formula{at}: write it as q * sign(v) * z**2") from None
    if "^" in text:
        raise LawError("'^' is no power here; write **, as in abs(v)**1.5")
    out = Expression(text.strip(), _node(tree.body, names))
    if (deep := _deep(out.root)) > DEEPEST:
        raise LawError(f"nested {deep} deep; at most {DEEPEST}: write the longer part of each sum or product first")
    return out


def _node(tree: ast.AST, names: Mapping[str, str]) -> Node:
    if isinstance(tree, ast.BinOp) and type(tree.op) in BINARY:
        left, right = _node(tree.left, names), _node(tree.right, names)
        if isinstance(tree.op, ast.Pow) and right.step == NUMBER and right.number == 2.0:
            return Node(SQUARE, (left,))
        return Node(BINARY[type(tree.op)][0], (left, right))
    if isinstance(tree, ast.UnaryOp) and isinstance(tree.op, ast.USub | ast.UAdd):
        inner = _node(tree.operand, names)
        if isinstance(tree.op, ast.UAdd):
            return inner
        return Node(NUMBER, number=-inner.number) if inner.step == NUMBER else Node(NEG, (inner,))
    if isinstance(tree, ast.Constant) and isinstance(tree.value, int | float) and not isinstance(tree.value, bool):
        if not math.isfinite(number := float(min(tree.value, 1e308))):
            raise LawError(f"the number {ast.unparse(tree)} is too large")
        return Node(NUMBER, number=number)
    if isinstance(tree, ast.Name):
        if tree.id in names:
            return Node(SYMBOL, name=names[tree.id])
        if tree.id in FUNCTIONS:
            raise LawError(f"'{tree.id}' is a function; write {tree.id}(...)")
        known = ", ".join(names)
        raise LawError(f"unknown symbol '{tree.id}'; known here: {known}; declare parameters under .parameters")
    if isinstance(tree, ast.Compare):
        if len(tree.ops) != 1 or type(tree.ops[0]) not in COMPARISONS:
            raise LawError(
                f"'{ast.unparse(tree)}': one comparison at a time; write where(z > a, where(z < b, ..., 0), 0)"
            )
        return Node(COMPARISONS[type(tree.ops[0])][0], (_node(tree.left, names), _node(tree.comparators[0], names)))
    if isinstance(tree, ast.Call):
        name = tree.func.id if isinstance(tree.func, ast.Name) else ast.unparse(tree.func)
        if name not in FUNCTIONS or tree.keywords:
            raise LawError(f"unknown function '{name}'; known: {', '.join(FUNCTIONS)}")
        step, count = FUNCTIONS[name]
        if len(tree.args) != count:
            raise LawError(f"{name} takes {count} argument{'s' if count > 1 else ''}, not {len(tree.args)}")
        return Node(step, tuple(_node(a, names) for a in tree.args))
    raise LawError(
        f"'{ast.unparse(tree)}' is not read; a law has + - * / **, comparisons, {', '.join(FUNCTIONS)}, numbers and "
        "declared symbols"
    )


def _deep(node: Node) -> int:
    """Numbers on the stack at most."""
    return max((k + _deep(child) for k, child in enumerate(node.of)), default=1)


def _value(node: Node, xp: Any, symbols: Mapping[str, Any]) -> Any:
    if node.step == NUMBER:
        return node.number
    if node.step == SYMBOL:
        return symbols[node.name]
    of = [_value(n, xp, symbols) for n in node.of]
    return (_OPERATORS.get(node.step) or getattr(xp, _NAMES[node.step]))(*of)


_OPERATORS: dict[int, Callable[..., Any]] = {
    ADD: operator.add,
    SUB: operator.sub,
    MUL: operator.mul,
    DIV: operator.truediv,
    POW: operator.pow,
    NEG: operator.neg,
    SQUARE: lambda a: a * a,
    LT: operator.lt,
    LE: operator.le,
    GT: operator.gt,
    GE: operator.ge,
    EQ: operator.eq,
    NE: operator.ne,
}
_NAMES = {step: name for name, (step, _) in FUNCTIONS.items()}

Dimension = Mapping[str, float]
"""Exponents of the base dimensions, e.g. {"[length]": 1, "[time]": -1}."""


@cache
def dimension(unit: str) -> tuple[tuple[str, float], ...]:
    """Base dimensions of a unit such as `N s^0.5 m^-1.5` ("" or "1": none). LawError where it is none."""
    import pint

    try:
        found = _units().parse_units(unit.strip()).dimensionality if unit.strip() not in ("", "1") else {}
    except (pint.errors.PintError, AttributeError, ValueError, TypeError, AssertionError):
        raise LawError(f"unknown unit '{unit}'; write it as N s^0.5 m^-1.5, kg/m^3 or \"\" for none") from None
    return tuple(sorted((k, float(v)) for k, v in found.items()))


@cache
def _units() -> Any:
    import pint

    return pint.UnitRegistry()


def check_dimension(law: Expression, units: Mapping[str, str], wanted: str) -> None:
    """Raises LawError unless the law, with symbols of these units, has the unit that is wanted."""
    found = _dimension(law.root, {n: dict(dimension(u)) for n, u in units.items()})
    need = dict(dimension(wanted))
    if found is not None and _differ(found, need):
        missing = {k: need.get(k, 0.0) - found.get(k, 0.0) for k in {*found, *need}}
        raise LawError(
            f"has the dimension {_words(found)}, not that of {wanted or '1'}; a factor of {_words(missing)} is "
            "missing: look at the units of its parameters"
        )


def _differ(a: Dimension, b: Dimension) -> bool:
    return any(abs(a.get(k, 0.0) - b.get(k, 0.0)) > 1e-9 for k in {*a, *b})


_SI = {"[mass]": "kg", "[length]": "m", "[time]": "s", "[current]": "A", "[temperature]": "K"}


def _words(d: Dimension) -> str:
    parts = [f"{_SI.get(k, k)}^{v:g}".removesuffix("^1") for k, v in d.items() if abs(v) > 1e-9]
    return " ".join(parts) or "1"


def _dimension(node: Node, units: Mapping[str, dict[str, float]]) -> dict[str, float] | None:
    """Exponents of the base dimensions; None: a plain zero, which goes with every dimension."""
    if node.step == NUMBER:
        return None if node.number == 0.0 else {}
    if node.step == SYMBOL:
        return units[node.name]
    of = [_dimension(n, units) for n in node.of]
    first = of[0] or {}
    if node.step in (MUL, DIV):
        sign = 1.0 if node.step == MUL else -1.0
        second = of[1] or {}
        return {k: first.get(k, 0.0) + sign * second.get(k, 0.0) for k in {*first, *second}}
    if node.step == SQUARE:
        return {k: 2.0 * v for k, v in first.items()}
    if node.step == SQRT:
        return {k: 0.5 * v for k, v in first.items()}
    if node.step == POW:
        if _differ(of[1] or {}, {}):
            raise LawError(f"an exponent has the dimension {_words(of[1] or {})}; an exponent must be a plain number")
        if not _differ(first, {}):
            return {}
        if node.of[1].step != NUMBER:
            raise LawError(
                f"what has the dimension {_words(first)} is raised to a power that is not a number: divide it by a "
                "parameter of its unit first, as in abs(v / v_0)**p"
            )
        return {k: node.of[1].number * v for k, v in first.items()}
    if node.step in (EXP, LOG, TAN, SIN, COS):
        if _differ(first, {}):
            raise LawError(f"{_NAMES[node.step]} of a quantity of the dimension {_words(first)}: divide it by a scale")
        return {}
    if node.step == SIGN:
        return {}
    if node.step in (NEG, ABS):
        return of[0]
    pair = of[1:] if node.step == WHERE else of
    known = [d for d in pair if d is not None]
    if len(known) == 2 and _differ(known[0], known[1]):
        what = _NAMES.get(node.step) or next(s for c, s in (*BINARY.values(), *COMPARISONS.values()) if c == node.step)
        raise LawError(f"'{what}' of {_words(known[0])} and {_words(known[1])}: both sides need the same dimension")
    if node.step in range(LT, NE + 1):
        return {}
    return known[0] if known else None


_STRENGTH = {ADD: 1, SUB: 1, MUL: 2, DIV: 2, NEG: 2, POW: 4, SQUARE: 4}
_GREEK = ("alpha", "beta", "gamma", "delta", "theta", "lambda", "mu", "phi", "rho", "sigma", "tau")


def _typeset(node: Node, words: Mapping[str, str]) -> tuple[str, int]:
    """(mathtext, how strongly it binds)."""
    if node.step == NUMBER:
        return f"{node.number:g}", 9
    if node.step == SYMBOL:
        return words.get(node.name, _name(node.name)), 9
    of = [_typeset(n, words) for n in node.of]
    mine = _STRENGTH.get(node.step, 9)

    def side(k: int, least: int) -> str:
        text, binds = of[k]
        return text if binds >= least else rf"\left({text}\right)"

    if node.step in (ADD, SUB):
        return f"{side(0, 1)} {'+' if node.step == ADD else '-'} {side(1, 2)}", mine
    if node.step == MUL:
        return rf"{side(0, 2)}\,{side(1, 3)}", mine
    if node.step == DIV:
        return rf"\frac{{{of[0][0]}}}{{{of[1][0]}}}", 3
    if node.step in (POW, SQUARE):
        power = of[1][0] if node.step == POW else "2"
        return f"{side(0, 5)}^{{{power}}}", mine
    if node.step == NEG:
        return f"-{side(0, 2)}", mine
    if node.step == ABS:
        return rf"\left|{of[0][0]}\right|", 9
    if node.step == SQRT:
        return rf"\sqrt{{{of[0][0]}}}", 9
    if node.step == WHERE:
        return rf"\left[{of[1][0]}\ \mathrm{{if}}\ {of[0][0]}\ \mathrm{{else}}\ {of[2][0]}\right]", 9
    for code, sign in COMPARISONS.values():
        if code == node.step:
            shown = {"<=": r"\leq", ">=": r"\geq", "==": "=", "!=": r"\neq"}.get(sign, sign)
            return f"{of[0][0]} {shown} {of[1][0]}", 0
    inner = r",\,".join(t for t, _ in of)
    return rf"\mathrm{{{_NAMES[node.step]}}}\left({inner}\right)", 9


def _name(name: str) -> str:
    head, _, tail = name.partition("_")
    head = rf"\{head}" if head in _GREEK else head if len(head) == 1 else rf"\mathrm{{{head}}}"
    return rf"{head}_{{\mathrm{{{tail}}}}}" if tail else head
