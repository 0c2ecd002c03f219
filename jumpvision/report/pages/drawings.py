"""Drawings inside a page: SVG whose ink and house colours are the page's own, light or dark as the reader has it."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

from jumpvision.report.style import ACCENT, GREEN, MEASURED, MODEL, QUIET, styled

INK = "#010203"  # no figure draws in it
OWN = {
    INK: "currentColor",
    "#000000": "currentColor",
    MEASURED: "var(--measured)",
    MODEL: "var(--model)",
    GREEN: "var(--green)",
    ACCENT: "var(--accent)",
    QUIET: "var(--soft)",
}
RC: dict[Any, Any] = {
    **dict.fromkeys(("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color"), INK),
    "axes.facecolor": "none",
    "svg.hashsalt": "jumpvision",
}


def drawing(draw: Callable[..., Any], *data: Any) -> str:
    """The <svg> of a drawing function's figure in the house style, without a date or a background."""
    import matplotlib

    out = io.StringIO()
    with styled() as Figure, matplotlib.rc_context(RC):
        draw(*data, Figure).savefig(out, format="svg", transparent=True, metadata={"Date": None})
    text = out.getvalue()
    text = text[text.index("<svg") :]
    for fixed, own in OWN.items():
        text = text.replace(fixed.lower(), own)
    return text
