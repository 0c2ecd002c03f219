"""Interactive figures as data: what static/plot.js draws, and the numbers of the table behind it.

A chart is {title, note, panels, stacked, legend}; a panel {title, x, y, series, spans, rules, equal}; an axis {label,
unit, log, zero, names}; a series {name, kind: line | points | bars | map, role: its colour, x, y, s: its sigma, label,
mark, hollow, dash, joined: by a thin line, tags: names of the legend that hide it}. Lists hold numbers in the axis'
unit, None where unknown; error bars and bands are drawn at 2 s.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

Chart = dict[str, Any]

MOST = 3000  # points of a series in a page: two a pixel
DIGITS = 5  # significant figures


def numbers(values: Any, factor: float = 1.0, digits: int = DIGITS) -> list[float | None]:
    """Values times factor with so many significant figures; None where they are not finite."""
    array = np.asarray(values, float) * factor
    return [float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in array]


def axis(label: str, unit: str = "", **more: Any) -> dict[str, Any]:
    """One axis; more: log, zero (it is in the picture), names (of categories at 0, 1, 2 ...)."""
    return {"label": label, "unit": unit, **more}


def series(name: str, role: str, x: Any, y: Any, s: Any = None, *, kind: str = "points", **more: Any) -> dict[str, Any]:
    """A series of numbers as they are; s may be None."""
    out = {"name": name, "role": role, "kind": kind, "x": numbers(x), "y": numbers(y), **more}
    return out if s is None else {**out, "s": numbers(s, digits=2)}


def panel(title: str, x: Any, y: Any, drawn: Sequence[dict[str, Any]], **more: Any) -> dict[str, Any]:
    """One panel."""
    return {"title": title, "x": x, "y": y, "series": list(drawn), **more}


def chart(title: str, panels: Sequence[dict[str, Any]], note: str = "", *, stacked: bool = False) -> Chart:
    """One figure; stacked panels share x."""
    return {"title": title, "note": note, "panels": list(panels), "stacked": stacked}


def column(rows: Sequence[Mapping[str, Any]], name: str, factor: float = 1.0) -> Any:
    """One column of a table as an array; NaN where unknown."""
    return np.array([np.nan if r.get(name) is None else r[name] for r in rows], float) * factor


def names(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """The experiments' names."""
    return [str(r["experiment"]) for r in rows]


def json_of(file: Path) -> dict[str, Any]:
    """A JSON object; {} where the file is not there."""
    return dict(json.loads(file.read_text(encoding="utf-8"))) if file.exists() else {}


def fits_of(results: Path) -> dict[str, Any]:
    """fits.json."""
    return json_of(results / "fits.json")
