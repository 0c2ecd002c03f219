"""Packages of the extras, which may not be installed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from .schema import InputError


@contextmanager
def require_extra(package: str, user: str, extra: str) -> Iterator[None]:
    """Turn "no module" of an import into an InputError with the command that installs it.

    The ImportError of a package that is installed passes: it states what is missing there.
    """
    try:
        yield
    except ModuleNotFoundError as e:
        if e.name != package:
            raise
        raise InputError([f"{user} needs {package}; install it with: pip install 'jumpvision[{extra}]'"]) from e
