"""Tables of the program Tracker (physlets.org): a line with the mass's name, then t, x, y and what else was chosen,
between tabs, commas or semicolons; decimals after a point or a comma."""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path

import numpy as np

from .held import Channel, Held

FIRST = ("t", "x", "y")  # in that order, as Tracker writes them unless told otherwise
HEAD = 4096  # bytes in which the header stands


def is_tracker(path: Path) -> bool:
    """Whether a text file is such a table."""
    with path.open("rb") as f:
        text = f.read(HEAD).decode("utf-8-sig", errors="replace")
    return _header(text.splitlines()) is not None


def tracker(path: Path, asked: Collection[str]) -> Held:
    """Its columns by their own names; rows that a step without a mark leaves empty are left out."""
    lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    head = _header(lines)
    if head is None:
        return Held([], {})
    row, mark, names = head
    comma = mark != ","
    cells = [[c.strip() for c in line.split(mark)] for line in lines[row + 1 :] if line.strip(f" {mark}")]
    full = [c for c in cells if len(c) >= len(FIRST) and all(c[: len(FIRST)])]
    values = {n: np.array([_number(c[k] if k < len(c) else "", comma) for c in full]) for k, n in enumerate(names)}
    return Held(names, {n: Channel(n, values[n]) for n in asked if n in values})


def _header(lines: list[str]) -> tuple[int, str, list[str]] | None:
    """(row, what separates, names) of the header, in the first or second line."""
    for row, line in enumerate(lines[:2]):
        for mark in ("\t", ";", ","):
            names = [re.sub(r"\s*[(\[].*", "", c).strip().lower() for c in line.rstrip(f"{mark} ").split(mark)]
            if tuple(names[: len(FIRST)]) == FIRST:
                return row, mark, names
    return None


def _number(cell: str, comma: bool) -> str:
    return cell.replace(",", ".") if comma else cell
