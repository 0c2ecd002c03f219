"""What a hand waits for: times judged by the pace of the machine at that moment, and a page's last answer."""

from __future__ import annotations

import os
import time
from collections.abc import Callable

TURNS = 1_000_000
IDLE_S = 0.055  # of that many turns: R = 1.1 s for 2e7, the machine on which limits are stated


def slower() -> float:
    """How many times as long as on that machine, idle, something takes here and now: as an empty loop does, or as there
    are programs for each core (a loop that begins after a rest is not made to wait for them; a page and its server
    are). 1 where it takes less."""
    began = time.perf_counter()
    for _ in range(TURNS):
        pass
    loop = (time.perf_counter() - began) / IDLE_S
    return max(loop, os.getloadavg()[0] / (os.cpu_count() or 1), 1.0)


def in_time(measure: Callable[[], float], limit: float, tries: int = 5) -> None:
    """That a time [ms] is within a limit in one of a few tries, in units of the slower pace of before and after: what
    other programs take of the machine only adds."""
    took = []
    for _ in range(tries):
        before = slower()
        time_ms = measure()
        took.append((time_ms, max(before, slower())))
        if time_ms <= limit * took[-1][1]:
            return
    raise AssertionError(f"limit {limit:g} ms; (time, times slower than the machine of the limit): {took}")


class Questions:
    """What a page has asked its server, to be made before it asks."""

    def __init__(self, page) -> None:
        self.page, self.open, self.asked = page, set(), 0
        page.on("request", self._begun)
        for end in ("requestfinished", "requestfailed"):
            page.on(end, lambda request: self.open.discard(request))

    def _begun(self, request) -> None:
        self.open.add(request)
        self.asked += 1

    def answered(self, rest_ms: float = 400.0, limit_s: float = 60.0) -> None:
        """Waits until all is answered and nothing more is asked for a while: a control asks when it has rested."""
        end = time.monotonic() + limit_s
        while True:
            asked = self.asked
            self.page.wait_for_timeout(rest_ms)  # it is while the page is waited for that its events arrive
            if not self.open and self.asked == asked:
                return
            assert time.monotonic() < end, f"still unanswered: {[r.url for r in self.open]}"
