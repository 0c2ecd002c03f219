"""Compiled loops shared between threads, as many as NUMBA_NUM_THREADS says (default: one a core)."""

from __future__ import annotations

import concurrent.futures
import contextlib
import functools
import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

import numba as nb
from numba.core import event

from . import compiling

T = TypeVar("T")

BRIEF = 4e-4  # s; to wake another thread and to wait for it takes 0.1 to 0.2 ms
MANY = 1000  # sizes that are remembered

_limit: int | None = None  # of `at_most`
_pool: concurrent.futures.ThreadPoolExecutor | None = None
_within = threading.local()


def threads() -> int:
    """How many share a loop, this one included."""
    most = int(nb.config.NUMBA_NUM_THREADS)  # type: ignore[attr-defined]
    return most if _limit is None else max(1, min(most, _limit))


@contextlib.contextmanager
def at_most(number: int) -> Iterator[None]:
    """No more threads than that within."""
    global _limit
    before, _limit = _limit, number
    try:
        yield
    finally:
        _limit = before


def shared(**options: Any) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """f(first, last, *arguments), which works on rows first to last - 1 alone, becomes f(rows, *arguments) on all.

    It is compiled for one thread and called by several, without the interpreter's lock: numba's own `parallel=True`
    takes twice as long to compile. What a row becomes does not depend on the number of threads. A loop that took less
    than BRIEF is not shared the next time its arguments have the same sizes. options: of `njit`.
    """

    def over_rows(f: Callable[..., None]) -> Callable[..., None]:
        compiled = nb.njit(**{"cache": True, "nogil": True, **options})(f)
        brief: set[tuple[int, ...]] = set()  # sizes at which sharing takes longer than it saves, as last seen

        @functools.wraps(f)
        def call(rows: int, *arguments: object) -> None:
            sizes = (rows, *(getattr(a, "size", 0) for a in arguments))
            alone, begun = sizes in brief, time.perf_counter()
            if alone:
                compiled(0, rows, *arguments)
            else:
                size = max(1, -(-rows // (8 * threads())))  # eight pieces a thread: rows differ in work
                starts = range(0, rows, size)
                at_once([functools.partial(compiled, k, min(k + size, rows), *arguments) for k in starts])
            if (time.perf_counter() - begun < BRIEF) != alone:
                if len(brief) > MANY:
                    brief.clear()
                (brief.discard if alone else brief.add)(sizes)

        return call

    return over_rows


def at_once(calls: Sequence[Callable[[], T]], most: int | None = None) -> list[T]:
    """Results of calls that mostly work without the interpreter's lock, shared between the threads, or `most` of them.

    A call may share calls of its own: they stay in its thread.
    """
    several = 1 if getattr(_within, "a_call", False) else min(most or threads(), threads(), len(calls))
    if several == 1:
        return [call() for call in calls]
    waiting, out = iter(range(len(calls))), {}

    def work() -> None:
        _within.a_call = True
        try:
            for k in waiting:  # each goes to the thread that asks for it first
                out[k] = calls[k]()
        finally:
            _within.a_call = False

    others = [_workers().submit(work) for _ in range(several - 1)]
    try:
        work()
    finally:
        concurrent.futures.wait(others)
    for other in others:
        other.result()
    return [out[k] for k in range(len(calls))]


def _workers() -> concurrent.futures.ThreadPoolExecutor:
    global _pool
    if _pool is None:
        _pool = concurrent.futures.ThreadPoolExecutor(max(1, threads() - 1), "rows")
    return _pool


def _forget() -> None:
    """A forked process has none of the threads."""
    global _pool
    _pool = None


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)


class _Compiling(event.Listener):
    """Hears of every function that is compiled; of those, what is kept on the disk is compiled once only."""

    def on_start(self, event: event.Event) -> None:
        if event.data["dispatcher"].stats.cache_path is not None:
            compiling.begins()

    def on_end(self, event: event.Event) -> None:
        """Whoever waits sees the results."""


event.register("numba:compile", _Compiling())
