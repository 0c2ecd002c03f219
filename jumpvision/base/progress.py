"""Progress of long work: the core iterates through `watch`, whoever shows it sets the hook; nothing is printed here."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sized
from contextvars import ContextVar
from typing import TypeVar

T = TypeVar("T")
Hook = Callable[[str, int, int | None], None]  # (what, done, total)
HOOK: ContextVar[Hook | None] = ContextVar("progress_hook", default=None)


def watch(items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
    """The items, each reported to the hook when it has been used."""
    hook = HOOK.get()
    if hook is None:
        yield from items
        return
    if total is None and isinstance(items, Sized):
        total = len(items)
    hook(what, 0, total)
    for done, item in enumerate(items, 1):
        yield item
        hook(what, done, total)
