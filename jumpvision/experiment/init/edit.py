"""Values put into the text of an experiment.toml: its comments, its order and all other lines stay as they are."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Mapping

from jumpvision.base.schema import InputError
from jumpvision.experiment.inputs.experiment import merged

from .measure import Values
from .text import line_of

HEADER = re.compile(r"\s*(?:#\s*)?\[([A-Za-z0-9_.]+)\]\s*(?:#.*)?$")
Edits = Mapping[str, Values]


def edited(text: str, edits: Edits, where: str) -> str:
    """The text with values (value, why) by section and key: in the key's line, in the line that keeps it open behind a
    #, else under the section's header, else in a new section at the end.

    where: the file, to name. Raises InputError where the text cannot be edited by lines, as a list over several.
    """
    lines = text.split("\n")
    for section, values in edits.items():
        for key, (value, why) in values.items():
            lines = _with(lines, section, line_of(key, value, why), key)
    out = "\n".join(lines)
    wanted = tomllib.loads(text)
    for section, values in edits.items():
        table: object = {key: value for key, (value, _) in values.items()}
        for part in reversed(section.split(".")):
            table = {part: table}
        wanted = merged(wanted, table)  # type: ignore[arg-type]
    try:
        same = tomllib.loads(out) == wanted
    except tomllib.TOMLDecodeError:
        same = False
    if not same:
        raise InputError(
            [f"{where}: {', '.join(f'[{s}]' for s in edits)} cannot be edited line by line; write each key on one line"]
        )
    return out


def difference(old: str, new: str) -> list[str]:
    """Lines of the unified difference of two texts, without its heads."""
    return list(difflib.unified_diff(old.split("\n"), new.split("\n"), lineterm="", n=1))[2:]


def _with(lines: list[str], section: str, line: str, key: str) -> list[str]:
    start = next((i for i, text in enumerate(lines) if _header(text) == section), None)
    if start is None:
        tail = lines[: len(lines) - (lines[-1] == "")]
        return [*tail, "", f"[{section}]", line, ""]
    head = f"[{section}]" if lines[start].lstrip().startswith("#") else lines[start]
    end = next((i for i in range(start + 1, len(lines)) if _header(lines[i]) is not None), len(lines))
    own = re.compile(rf"\s*(#\s*)?{re.escape(key)}\s*=")
    found = [i for i in range(start + 1, end) if own.match(lines[i])]
    at = min(found, key=lambda i: lines[i].lstrip().startswith("#"), default=None)
    out = [*lines[:start], head, *lines[start + 1 : end]]
    if at is None:
        last = max((i for i in range(start, end) if lines[i].strip() and not lines[i].startswith("# [")), default=start)
        return [*out[: last + 1], line, *out[last + 1 :], *lines[end:]]
    return [*out[:at], line, *out[at + 1 :], *lines[end:]]


def _header(text: str) -> str | None:
    found = HEADER.match(text)
    return found[1] if found else None
