"""A result with a file name, and numbers as JSON can hold them."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, ClassVar, Self


class RecordError(ValueError):
    """A result file does not hold what its record declares."""


class Record(ABC):
    """A result with a file name; `save` writes the file into a folder, `load` reads it back unchanged."""

    file: ClassVar[str]

    def _repr_html_(self) -> str:
        from .notebook import record

        return record(self)

    @abstractmethod
    def save(self, folder: Path) -> None:
        """Write the file into `folder`."""

    @classmethod
    @abstractmethod
    def load(cls, folder: Path) -> Self:
        """Read it back from `folder`."""


def plain(value: object) -> Any:
    """numpy and NaN as what JSON can hold: lists, numbers, null."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
