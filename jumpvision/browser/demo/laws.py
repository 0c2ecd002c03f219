"""The laws of the page's beds, in JavaScript made from the records of their mechanisms.

`python -m jumpvision.browser.demo.laws` writes static/physics/laws.js anew.
"""

from __future__ import annotations

from pathlib import Path

from jumpvision.engine.laws.javascript import function
from jumpvision.engine.laws.tree import Node, total
from jumpvision.jumper.mechanisms.cone import CONE_RADIUS
from jumpvision.jumper.mechanisms.record import Body, Mechanism
from jumpvision.jumper.mechanisms.registry import MECHANISMS

from .controls import SAND

TARGET = Path(__file__).with_name("static") / "physics" / "laws.js"
BEDS = SAND | {"drag_cone": ("two_resistance", "inertial_drag", "added_mass")}  # the last of sealed worlds alone
HEAD = """// The laws of the beds by name, from symbols and parameters in SI units to the static and the whole force on
// the intruding foot [N], the mass that moves with it [kg] and the radius of its flat face [m]. Written from the
// package's mechanisms by jumpvision.browser.demo.laws: change them there.
"""


def _on(mechanisms: list[Mechanism], *bodies: Body) -> Node:
    return total(m.expression.root for m in mechanisms if m.acts_on in bodies and m.expression)


def module() -> str:
    """The text of laws.js."""
    beds = []
    for name, terms in BEDS.items():
        mechanisms = [MECHANISMS[t] for t in terms]
        trees = {
            "static": _on(mechanisms, Body.STATIC),
            "force": _on(mechanisms, Body.STATIC, Body.DRAG),
            "mass": _on(mechanisms, Body.INERTIA),
            "radius": CONE_RADIUS.root,
        }
        beds.append(f"const {name} = {function(trees)};\n")
    return "\n".join([HEAD, *beds, f"export default {{ {', '.join(BEDS)} }};", ""])


if __name__ == "__main__":
    TARGET.write_text(module(), encoding="utf-8")
