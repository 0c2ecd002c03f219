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
    """Read the columns by their own names, `mass A/y` where several masses have one, without rows that a
    step without a mark leaves empty."""
    lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    head = _header(lines)
    if head is None:
        return Held([], {})
    row, mark, names = head
    comma = mark != ","
    cells = [[c.strip() for c in line.split(mark)] for line in lines[row + 1 :] if line.strip(f" {mark}")]
    places = [k for k, n in enumerate(names) if n in asked and n.rpartition("/")[2] in FIRST] or range(len(FIRST))
    full = [c for c in cells if all(len(c) > k and c[k] for k in places)]
    values = {n: np.array([_number(c[k] if k < len(c) else "", comma) for c in full]) for k, n in enumerate(names)}
    return Held(names, {n: Channel(n, values[n]) for n in asked if n in values})


def _header(lines: list[str]) -> tuple[int, str, list[str]] | None:
    """Return (row, separator, names) of the header, in one of the first three lines, below those of `#multi:` and the
    masses."""
    for row, line in enumerate(lines[:3]):
        for mark in ("\t", ";", ","):
            names = [re.sub(r"\s*[(\[].*", "", c).strip().lower() for c in line.rstrip(f"{mark} ").split(mark)]
            if tuple(names[: len(FIRST)]) == FIRST:
                return row, mark, _of_masses(names, lines[row - 1].split(mark) if row else [])
    return None


def _of_masses(names: list[str], above: list[str]) -> list[str]:
    """Return the names of the columns, each after the mass above it where another mass has one of that name."""
    mass, out = "", []
    for k, name in enumerate(names):
        mass = above[k].strip() if k < len(above) and above[k].strip() else mass
        out.append(f"{mass or k}/{name}" if names.count(name) > 1 else name)
    return out


def _number(cell: str, comma: bool) -> str:
    return cell.replace(",", ".") if comma else cell
