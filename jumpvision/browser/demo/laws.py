"""The law of the page's bed, in JavaScript made from the records of its mechanisms."""

from __future__ import annotations

from collections.abc import Iterable

from jumpvision.engine.laws.javascript import function
from jumpvision.engine.laws.tree import Node, total
from jumpvision.jumper.mechanisms.cone import CONE_RADIUS
from jumpvision.jumper.mechanisms.record import Body
from jumpvision.jumper.mechanisms.registry import MECHANISMS


def bed_law(terms: Iterable[str]) -> str:
    """Give the function from symbols and parameters (SI units) to the static and the whole force on the foot [N], the
    mass that moves with it [kg] and the radius of its flat face [m]."""
    mechanisms = [MECHANISMS[name] for name in terms]

    def law(*bodies: Body) -> Node:
        return total(m.expression.root for m in mechanisms if m.acts_on in bodies and m.expression)

    static, force = law(Body.STATIC), law(Body.STATIC, Body.DRAG)
    return function({"static": static, "force": force, "mass": law(Body.INERTIA), "radius": CONE_RADIUS.root})
