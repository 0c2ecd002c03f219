"""Long work: its progress, and its parts: in several processes, their results in order.

The core iterates through `watch`, whoever shows it sets the hook; nothing is printed here.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence, Sized
from concurrent.futures import Future, ProcessPoolExecutor
from contextvars import ContextVar
from multiprocessing.context import BaseContext
from typing import TypeVar

from . import compiling

T = TypeVar("T")
Hook = Callable[[str, int, int | None], None]  # (what, done, total)
HOOK: ContextVar[Hook | None] = ContextVar("progress_hook", default=None)


@contextlib.contextmanager
def setting(variable: ContextVar[T], value: T) -> Iterator[None]:
    """Within, a context variable has this value."""
    token = variable.set(value)
    try:
        yield
    finally:
        variable.reset(token)


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


Part = TypeVar("Part")
Result = TypeVar("Result")

WORKERS: ContextVar[int] = ContextVar("workers", default=1)  # processes that one experiment may use
ALONE = dict.fromkeys(("NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
FORKS = "forkserver" in multiprocessing.get_all_start_methods()


def processes() -> BaseContext:
    """How a worker begins: forked from a process that has no threads (to fork others is unsafe under OpenMP and OpenCV)
    and has imported what `ready` was told; from nothing where there are no forks."""
    return multiprocessing.get_context("forkserver" if FORKS else "spawn")


def ready(modules: Sequence[str]) -> None:
    """Begins to import these for workers that come, in a process of its own; the first call of a process counts."""
    if not FORKS:
        return
    from multiprocessing.forkserver import ensure_running

    # ALONE is read where numpy and numba are imported; from where this process imports, and not from its folder, too
    there = {"PYTHONSAFEPATH": "1", "PYTHONPATH": os.pathsep.join(p or os.getcwd() for p in sys.path)}
    set_for_it = ALONE | there
    kept = {n: os.environ.get(n) for n in set_for_it}
    os.environ |= set_for_it
    try:
        multiprocessing.set_forkserver_preload(list(modules))
        ensure_running()
    finally:
        for n, v in kept.items():
            os.environ.pop(n) if v is None else os.environ.__setitem__(n, v)


def in_parts(function: Callable[..., Result], parts: Sequence[Part], *arguments: object) -> Iterator[Result]:
    """function(part, *arguments) of every part, in order; as many results wait as there are processes.

    function and arguments must be picklable; with WORKERS = 1 all is done here.
    """
    n = min(WORKERS.get(), len(parts))
    if n <= 1:
        yield from (function(part, *arguments) for part in parts)
        return
    with worker_pool(n) as pool:
        waiting: deque[Future[Result]] = deque()
        try:
            for part in parts:
                waiting.append(pool.submit(function, part, *arguments))
                if len(waiting) > n:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:  # an error, or nobody asks for more
            pool.shutdown(cancel_futures=True)


def worker_pool(n: int) -> ProcessPoolExecutor:
    """n processes, each of one thread."""
    return ProcessPoolExecutor(n, processes(), _begin, (compiling.notice(),))


def _begin(notice: compiling.Notice | None) -> None:
    compiling.pass_on(notice)
    one_thread()


def one_thread() -> None:
    """Begin a worker: the processes are the parallel work. It ends when the process that started it is killed."""
    import threading

    os.environ |= ALONE
    import cv2

    cv2.setNumThreads(1)
    threading.Thread(target=end_with_parent, daemon=True).start()


def end_with_parent() -> None:
    """Wait until the process that started this one is gone, then end: for a thread of a worker."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
