"""Times that a hand waits, judged by the pace of the machine at that moment."""

from __future__ import annotations

import time
from collections.abc import Callable

TURNS = 1_000_000
IDLE_S = 0.055  # of that many turns: R = 1.1 s for 2e7 (docs/benchmarks.md), the machine on which limits are stated


def slower() -> float:
    """How many times as long as on that machine an empty loop takes here and now (1 where it takes less): the share
    that slower processors, and other programs on the same ones, have in any time that is measured beside it."""
    began = time.perf_counter()
    for _ in range(TURNS):
        pass
    return max((time.perf_counter() - began) / IDLE_S, 1.0)


def in_time(measure: Callable[[], float], limit: float, tries: int = 3) -> None:
    """That a time [ms] is within a limit in one of a few tries, in units of the pace before and after: what other
    programs take of the machine only adds."""
    took = []
    for _ in range(tries):
        before = slower()
        time_ms = measure()
        took.append((time_ms, 0.5 * (before + slower())))
        if time_ms <= limit * took[-1][1]:
            return
    raise AssertionError(f"limit {limit:g} ms; (time, times slower than the machine of the limit): {took}")
