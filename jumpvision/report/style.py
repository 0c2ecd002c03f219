"""One style for every figure: colour-blind-safe colours, quiet axes, sizes for a page."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

# Okabe & Ito: told apart by every kind of colour vision
MEASURED, MODEL, ACCENT, GREEN, QUIET = "#0072B2", "#D55E00", "#CC79A7", "#009E73", "#8a8a8a"
MAP, SIGNED = "viridis", "RdBu_r"


@contextmanager
def styled() -> Iterator[Any]:
    """pyplot-free matplotlib in the house style; gives `matplotlib.figure.Figure`."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(
        {
            "font.size": 9, "axes.titlesize": 9.5, "axes.titlelocation": "left", "axes.titleweight": "bold",
            "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.alpha": 0.25,
            "grid.linewidth": 0.6, "legend.frameon": False, "lines.linewidth": 1.4, "figure.facecolor": "white",
            "savefig.dpi": 140, "image.cmap": MAP, "font.family": "DejaVu Sans",
        }
    ):  # fmt: skip
        yield Figure
