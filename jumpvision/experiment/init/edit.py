"""Values put into the text of an experiment.toml: its comments, its order and all other lines stay as they are."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Mapping
from functools import reduce
from operator import getitem

import tomlkit
from tomlkit import TOMLDocument
from tomlkit.exceptions import NonExistentKey, TOMLKitError
from tomlkit.items import AoT, Comment, Item, Key, SingleKey, Table

from jumpvision.base.schema import InputError, Toml
from jumpvision.experiment.inputs.experiment import merged

from .measure import Values
from .text import item_of

Edits = Mapping[str, Values]


def edited(text: str, edits: Edits, where: str) -> str:
    """The text with values (value, why) by section and key: in the key's place, in the line that keeps it open behind a
    #, else after the section's last key, else in a new section at the end. Section "": above the first one.

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
    except (TOMLKitError, tomllib.TOMLDecodeError, TypeError, AttributeError):  # the section is none
        same = False
    if not same:
        raise InputError(
            [f"{where}: {', '.join(f'[{s}]' for s in edits)} cannot be edited; write each section under its [name]"]
        )
    return out


def _put(text: str, section: str, key: str, value: object, why: str) -> str:
    document, path = tomlkit.parse(text), _path(section)
    try:
        table = reduce(getitem, path, document)
    except NonExistentKey:  # its header is behind a #, or a new one
        opened = re.sub(rf"(?m)^[ \t]*#[ \t]*(\[{re.escape(section)}\][ \t]*(#.*)?)$", r"\1", text, count=1)
        document = tomlkit.parse(opened if opened != text else f"{text.rstrip()}\n\n[{section}]\n".lstrip())
        table = reduce(getitem, path, document)
    if table.get(key) != value:
        made = item_of(key, value, why)
        if key in table or not isinstance(table, Table | TOMLDocument):
            table[key] = made
        else:
            _insert(table.value.body if isinstance(table, Table) else table.body, key, made)
    return tomlkit.dumps(document)


def _path(section: str) -> list[str]:
    return section.split(".") if section else []


def _insert(body: list[tuple[Key | None, Item]], key: str, made: Item) -> None:
    """In place of the comment that keeps the key open, else after the last key of a table."""
    is_open = re.compile(rf"#\s*{re.escape(key)}\s*=").match
    at = next((i for i, (_, x) in enumerate(body) if isinstance(x, Comment) and is_open(x.trivia.comment)), None)
    if at is not None:
        body[at] = (SingleKey(key), made)
        return
    last = max((i for i, (k, x) in enumerate(body) if k and not isinstance(x, Table | AoT)), default=-1)
    if last >= 0:
        body[last][1].trivia.trail = "\n"  # the last line of a file may lack its end
    body.insert(last + 1, (SingleKey(key), made))


def difference(old: str, new: str) -> list[str]:
    """Lines of the unified difference of two texts, without its heads."""
    return list(difflib.unified_diff(old.split("\n"), new.split("\n"), lineterm="", n=1))[2:]
