"""A law as JavaScript: functions of one object with its symbols, for pages that compute themselves."""

from __future__ import annotations

from collections.abc import Mapping

from .tree import Node, Step, in_order

FORMS = {
    Step.NEG: "-{0}",
    Step.EQ: "{0} === {1}",
    Step.NE: "{0} !== {1}",
    Step.WHERE: "({0} ? {1} : {2})",
    Step.MINIMUM: "Math.min({0}, {1})",
    Step.MAXIMUM: "Math.max({0}, {1})",
    **{s: f"{{0}} {s.value} {{1}}" for s in (Step.ADD, Step.SUB, Step.MUL, Step.DIV, Step.POW)},
    **{s: f"{{0}} {s.value} {{1}}" for s in (Step.LT, Step.LE, Step.GT, Step.GE)},
}


def function(roots: Mapping[str, Node]) -> str:
    """An arrow function of an object of symbols that gives an object of values by these names."""
    nodes = in_order(roots.values())
    at = {n: f"t{k}" for k, n in enumerate(nodes)}
    at |= {n: f"s.{n.name}" for n in nodes if n.step is Step.SYMBOL}
    at |= {n: f"({n.number!r})" for n in nodes if n.step is Step.NUMBER}
    lines = []
    for n in nodes:
        if n.of:
            form = _product(n) or FORMS.get(n.step) or f"Math.{n.step.value}({{0}})"
            lines.append(f"  const {at[n]} = {form.format(*(at[c] for c in n.of))};")
    out = ", ".join(f"{name}: {at[root]}" for name, root in roots.items())
    return "\n".join(["(s) => {", *lines, f"  return {{ {out} }};", "}"])


def _product(n: Node) -> str:
    """A small whole power as a product, which engines calculate faster."""
    exponent = n.of[1].number if n.step is Step.POW and n.of[1].step is Step.NUMBER else 0.0
    return " * ".join(["{0}"] * int(exponent)) if exponent in (2.0, 3.0, 4.0) else ""
