"""A law as mathtext, for figures and pages."""

from __future__ import annotations

from collections.abc import Mapping

from .tree import COMPARISONS, Node, Step

_STRENGTH = {Step.ADD: 1, Step.SUB: 1, Step.MUL: 2, Step.DIV: 2, Step.NEG: 2, Step.POW: 4}
_GREEK = ("alpha", "beta", "gamma", "delta", "theta", "lambda", "mu", "phi", "rho", "sigma", "tau")
_SHOWN = {Step.LE: r"\leq", Step.GE: r"\geq", Step.EQ: "=", Step.NE: r"\neq"}


def typeset(root: Node, words: Mapping[str, str] = {}) -> str:
    """Without the dollars. words: how symbols read, e.g. a value in place of a name."""
    return _typeset(root, words)[0]


def plain(root: Node) -> str:
    """Such as 9**9**9, for messages."""
    if root.step is Step.NUMBER:
        return f"{root.number:g}"
    if root.step is Step.SYMBOL:
        return root.name
    of = [plain(n) for n in root.of]
    if root.step is Step.NEG:
        return f"-{of[0]}"
    written = root.step.value.isalpha()
    return f"{root.step.value}({', '.join(of)})" if written else f"({of[0]} {root.step.value} {of[1]})"


def _typeset(node: Node, words: Mapping[str, str]) -> tuple[str, int]:
    """(mathtext, how strongly it binds)."""
    if node.step is Step.NUMBER:
        return f"{node.number:g}", 9
    if node.step is Step.SYMBOL:
        return words.get(node.name, _name(node.name)), 9
    of = [_typeset(n, words) for n in node.of]
    mine = _STRENGTH.get(node.step, 9)

    def side(k: int, least: int) -> str:
        text, binds = of[k]
        return text if binds >= least else rf"\left({text}\right)"

    if node.step in (Step.ADD, Step.SUB):
        return f"{side(0, 1)} {node.step.value} {side(1, 2)}", mine
    if node.step is Step.MUL:
        return rf"{side(0, 2)}\,{side(1, 3)}", mine
    if node.step is Step.DIV:
        return rf"\frac{{{of[0][0]}}}{{{of[1][0]}}}", 3
    if node.step is Step.POW:
        return f"{side(0, 5)}^{{{of[1][0]}}}", mine
    if node.step is Step.NEG:
        return f"-{side(0, 2)}", mine
    if node.step is Step.ABS:
        return rf"\left|{of[0][0]}\right|", 9
    if node.step is Step.SQRT:
        return rf"\sqrt{{{of[0][0]}}}", 9
    if node.step is Step.WHERE:
        return rf"\left[{of[1][0]}\ \mathrm{{if}}\ {of[0][0]}\ \mathrm{{else}}\ {of[2][0]}\right]", 9
    if node.step in COMPARISONS:
        return f"{of[0][0]} {_SHOWN.get(node.step, node.step.value)} {of[1][0]}", 0
    inner = r",\,".join(t for t, _ in of)
    return rf"\mathrm{{{node.step.value}}}\left({inner}\right)", 9


def _name(name: str) -> str:
    head, _, tail = name.partition("_")
    head = rf"\{head}" if head in _GREEK else head if len(head) == 1 else rf"\mathrm{{{head}}}"
    return rf"{head}_{{\mathrm{{{tail}}}}}" if tail else head
