"""Parameters of a step from recording to result: declared once, read from a folder's TOML or from keywords."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, TypeVar

from .schema import InputError, Toml, read


@dataclass(frozen=True)
class Params:
    """Parameters of one stage; `stage` is its name, and that of its table [params.<stage>]."""

    stage: ClassVar[str]

    def __init_subclass__(cls) -> None:
        PARAMS[cls.stage] = cls


PARAMS: dict[str, type[Params]] = {}
"""Stage -> its parameters."""
P = TypeVar("P", bound=Params)


def of_keywords(cls: type[P], given: Toml, *, folder: tuple[str, ...] = (), **above_0: float | None) -> P:
    """Parameters of a stage from keywords of its function of arrays.

    folder: those that only a folder's stage heeds; above_0: further numbers, None or finite and > 0. Raises InputError.
    """
    table = {k: list(v) if isinstance(v, tuple) else v for k, v in given.items()}
    made, problems = read(cls, table, f"jv.{cls.stage}")
    apart = [n for n in folder if n in given]
    problems += [f"jv.{cls.stage} {n}: not for arrays; it needs a folder (docs/notebook.md)" for n in apart]
    for key, value in above_0.items():
        if value is not None and not 0.0 < value < math.inf:
            problems.append(f"jv.{cls.stage} {key} = {value!r}: must be a finite number > 0")
    if problems:
        raise InputError(problems)
    found: P = made
    return found
