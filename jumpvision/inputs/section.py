"""What all sections share: a name, the file they may carry, and how a stage asks for a key."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar

from jumpvision.base.schema import REQUIRED, InputError, describe, param


class MissingKey(InputError):
    """A stage needs a key, or a section, that the folder does not give."""


class NotApplicable(InputError):
    """A stage finds that the folder has nothing for it to do: a film without a foot has no cone. Not a failure."""


class Section:
    """One table of the file; `name` is its TOML name."""

    name: ClassVar[str]


@dataclass(frozen=True)
class FileSection(Section):
    """A section that names a recording; `path` is where it lies (a glob stays a pattern)."""

    file: str = param(REQUIRED, "", "file in the experiment's folder")
    path: Path = Path()  # not a key of the file: set when the folder is read


def need(section: Any, *keys: str) -> list[Any]:
    """The values of `keys`, in order; MissingKey naming every one that is absent."""
    by_name = {f.name: f for f in fields(section)}
    missing = [k for k in keys if getattr(section, k) is None]
    if missing:
        raise MissingKey([f"[{section.name}] {k}: missing; give {k} = ... ({describe(by_name[k])})" for k in missing])
    return [getattr(section, k) for k in keys]


@dataclass(frozen=True)
class Header:
    """The keys above the first section."""

    schema: int = param(1, "", "version of this file format", lo=1, hi=1)
    name: str = param("", "", "unique in a campaign; default: the folder's name")
    ground: str = param("granular", "", "what the robot stands on", choices=("hard", "granular"))
    group: str = param("", "", "trials of one condition share a group")
    exclude: str = param("", "", "a reason: the experiment is skipped and listed with it")
