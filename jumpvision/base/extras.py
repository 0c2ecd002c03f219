"""Packages of the extras, which may not be installed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from .schema import InputError


@contextmanager
def needed(package: str, user: str, extra: str) -> Iterator[None]:
    """Turn "no module" of an import into the command that installs it.

    An installed package that cannot be imported says itself what it lacks: that error passes. Raises InputError.
    """
    try:
        yield
    except ModuleNotFoundError as e:
        if e.name != package:
            raise
        raise InputError([f"{user} needs {package}; install it with: pip install 'jumpvision[{extra}]'"]) from e
