"""Values put into the text of an experiment.toml: its comments, its order and all other lines stay as they are."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Mapping
from functools import reduce
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from jumpvision.base.schema import InputError, Toml
from jumpvision.experiment.inputs.experiment import merged

from .measure import Values
from .text import item_of, line_of

HEADER = re.compile(r"\s*(?:#\s*)?\[([A-Za-z0-9_.]+)\]\s*(?:#.*)?$")
Edits = Mapping[str, Values]


def edited(text: str, edits: Edits, where: str) -> str:
    """The text with values (value, why) by section and key: in the key's place, in the line that keeps it open behind a
    #, else under the section's header, else in a new section at the end. Section "": above the first one.

    where: the file, to name. Raises InputError where another value would change with it, as where a section is none.
    """
    out, wanted = text, tomllib.loads(text)
    try:
        for section, values in edits.items():
            for key, (value, why) in values.items():
                out = _put(out, section, key, value, why)
            table: Toml = {key: value for key, (value, _) in values.items()}
            wanted = merged(wanted, reduce(lambda inner, part: {part: inner}, reversed(_path(section)), table))
        same = tomllib.loads(out) == wanted
    except (TOMLKitError, tomllib.TOMLDecodeError, TypeError):
        same = False
    if not same:
        raise InputError(
            [f"{where}: {', '.join(f'[{s}]' for s in edits)} cannot be edited; write each section under its [name]"]
        )
    return out


def _put(text: str, section: str, key: str, value: object, why: str) -> str:
    document = tomlkit.parse(text)
    if replaced(document, _path(section), key, value, why):
        return tomlkit.dumps(document)
    if not section:
        return _above(text, line_of(key, value, why))
    # what is kept open stands in comments, which are no part of a document
    return "\n".join(_with(text.split("\n"), section, line_of(key, value, why), key))


def _path(section: str) -> list[str]:
    return section.split(".") if section else []


def _above(text: str, line: str) -> str:
    """The text with a line above the first section, after the last key there."""
    lines = text.split("\n")
    end = next((i for i, x in enumerate(lines) if x.lstrip().startswith("[")), len(lines))
    last = max((i for i in range(end) if "=" in lines[i].partition("#")[0]), default=-1)
    return "\n".join([*lines[: last + 1], line, *([""] if last < 0 and end < len(lines) else []), *lines[last + 1 :]])


def replaced(table: Any, path: list[str], key: str, value: object, why: str) -> bool:
    """Put a value in the place of one that is there, however it is written; False where there is none."""
    for part in path:
        if part not in table:
            return False
        table = table[part]
    if key not in table:
        return False
    if table[key] != value:
        table[key] = item_of(key, value, why)
    return True


def difference(old: str, new: str) -> list[str]:
    """Lines of the unified difference of two texts, without its heads."""
    return list(difflib.unified_diff(old.split("\n"), new.split("\n"), lineterm="", n=1))[2:]


def _with(lines: list[str], section: str, line: str, key: str) -> list[str]:
    """The lines with one more: in place of that which keeps the key open, else the last of its section."""
    start = next((i for i, text in enumerate(lines) if _header(text) == section), None)
    if start is None:
        tail = lines[: len(lines) - (lines[-1] == "")]
        return [*tail, "", f"[{section}]", line, ""]
    head = f"[{section}]" if lines[start].lstrip().startswith("#") else lines[start]
    end = next((i for i in range(start + 1, len(lines)) if _header(lines[i]) is not None), len(lines))
    out = [*lines[:start], head, *lines[start + 1 : end]]
    at = next((i for i in range(start + 1, end) if re.match(rf"\s*#\s*{re.escape(key)}\s*=", lines[i])), None)
    if at is None:
        last = max((i for i in range(start, end) if lines[i].strip() and not lines[i].startswith("# [")), default=start)
        return [*out[: last + 1], line, *out[last + 1 :], *lines[end:]]
    return [*out[:at], line, *out[at + 1 :], *lines[end:]]


def _header(text: str) -> str | None:
    found = HEADER.match(text)
    return found[1] if found else None
