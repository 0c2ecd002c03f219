"""One name for two ways: a function of arrays that a folder can be given to."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any


def _is_recording(path: Path) -> bool:
    """A file that is no TOML, or a pattern of files."""
    return (path.is_file() and path.suffix != ".toml") or (not path.exists() and any(c in path.name for c in "*?["))


class ArraysOrFolder:
    """Calls of_arrays, of arrays and of the paths of recordings; where the first argument is a folder, its TOML, or an
    opened one, what of_folder() gives is called.

    The latter is asked for then, and for the help, which is its: it may import much. To `help` and editors it is a
    function with the signature of of_arrays.
    """

    def __init__(self, of_arrays: Callable[..., Any], of_folder: Callable[[], Callable[..., Any]]) -> None:
        functools.update_wrapper(self, of_arrays, assigned=("__name__", "__qualname__", "__annotations__"))
        self.__module__ = "jumpvision"
        self._of_folder = of_folder

    def __call__(self, first: object, *more: object, **settings: object) -> Any:
        folder = isinstance(first, str | os.PathLike) and not _is_recording(Path(first))
        return (self._of_folder() if folder else self.__wrapped__)(first, *more, **settings)  # type: ignore[attr-defined]

    def __get__(self, instance: object, owner: type | None = None) -> ArraysOrFolder:
        return self  # what pydoc takes for a function

    def __reduce__(self) -> str:
        return str(self.__name__)  # type: ignore[attr-defined]

    @property
    def __doc__(self) -> str | None:  # type: ignore[override]
        return self._of_folder().__doc__
