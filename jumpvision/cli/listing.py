"""The commands, read from their sources: `jumpvision --help` imports none of them, and a command only its own file."""

from __future__ import annotations

import functools
import os
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from jumpvision.experiment.workflow.stage import declared, functions_under

ABOUT = (
    "From films of a jumping robot on hard ground and sand to tracks, fields, forces and tested models.",
    "Start with: jumpvision run data_samples/loose_sand",
)
COMMANDS, STAGES = "Commands", "One stage, with what it needs"  # groups of commands, as they are shown
FLAGS = {"--help (-h)": "Display this message and exit.", "--version": "Display application version."}
NARROW = 60  # columns: for less, names and texts need more thought


class Listed(NamedTuple):
    """A command: the file that has it, its group, and what it does, in a sentence."""

    module: str
    group: str
    says: str


@functools.cache
def listed() -> dict[str, Listed]:
    """All commands by name."""
    found = {name: Listed("folders", STAGES, stage.help) for name, stage in declared().items()}
    for file in Path(__file__).parent.glob("*.py"):
        for f in functions_under(file.read_text(encoding="utf-8"), "@app.command"):
            found[f.called or f.name] = Listed(file.stem, COMMANDS, f.help)
    return found


def page() -> str | None:
    """What `jumpvision --help` says, as the library of the command line would lay it out; None where that knows better.

    It takes a third of a second for it, most of which are imports.
    """
    unicode = (sys.stdout.encoding or "").lower().startswith("utf")
    columns = width()
    if columns < NARROW or os.name == "nt":
        return None
    bold, cyan, plain = ("\033[1m", "\033[36m", "\033[0m") if coloured() else ("", "", "")
    lines = [f"{bold}Usage: jumpvision COMMAND{plain}"]
    for text in ABOUT:
        lines += ["", *textwrap.wrap(text, columns)]
    lines.append("")
    corners, across, down = ("╭╮╰╯", "─", "│") if unicode else ("++++", "-", "|")
    for group in (COMMANDS, STAGES):
        rows = {n: c.says for n, c in sorted(listed().items()) if c.group == group}
        rows |= FLAGS if group == COMMANDS else {}
        names = max(map(len, rows))
        lines.append(corners[0] + f"{across} {group} ".ljust(columns - 2, across) + corners[1])
        for name, says in rows.items():
            for k, part in enumerate(textwrap.wrap(says, columns - names - 6)):
                first = f"{cyan}{(name if k == 0 else '').ljust(names)}{plain}"
                lines.append(f"{down} {first}  {part.ljust(columns - names - 6)} {down}")
        lines.append(corners[2] + across * (columns - 2) + corners[3])
    return "\n".join(lines)


def width() -> int:
    """Columns of the terminal, 80 where there is none."""
    return next(_widths(), 80)


def _widths() -> Iterator[int]:
    if (given := os.environ.get("COLUMNS", "")).isdigit():
        yield int(given)
    for stream in (0, 1, 2):
        try:
            yield os.get_terminal_size(stream).columns
        except OSError:
            continue


def coloured() -> bool:
    """Whether what is printed goes to a terminal that shows colours."""
    forced = bool(os.environ.get("FORCE_COLOR"))
    able = "NO_COLOR" not in os.environ and os.environ.get("TERM", "") not in ("dumb", "unknown")
    return able and (forced or sys.stdout.isatty())
