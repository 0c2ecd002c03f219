"""What numba has not compiled on this machine before takes it half a minute: whoever waits is told, once a run."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple


class Notice(NamedTuple):
    """To be given by one process of a run: by the one that removes the file `unsaid`. Picklable where `give` is."""

    unsaid: Path
    give: Callable[[], None]


_notice: Notice | None = None  # of the run that this process belongs to


@contextlib.contextmanager
def noticed(give: Callable[[], None]) -> Iterator[None]:
    """Within, the first of this process and its workers that has to compile calls `give`, as it begins."""
    file, name = tempfile.mkstemp(prefix="jumpvision-")
    os.close(file)
    unsaid = Path(name)
    before = notice()
    pass_on(Notice(unsaid, give))
    try:
        yield
    finally:
        pass_on(before)
        unsaid.unlink(missing_ok=True)


def notice() -> Notice | None:
    """That of this process, for its workers."""
    return _notice


def pass_on(notice: Notice | None) -> None:
    """In a worker as it begins: the notice of the process that started it."""
    global _notice
    _notice = notice


def begins() -> None:
    """Numba begins to compile in this process."""
    if _notice is None:
        return
    try:
        _notice.unsaid.unlink()
    except OSError:  # another process, or this one, was first
        return
    _notice.give()
