"""Campaigns of a benchmark as rows of a file: made in parallel, never twice, and kept where they failed."""

from __future__ import annotations

import json
import os
import time
import traceback
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from scipy import stats

Row = dict[str, Any]


class Case(Protocol):
    """What a row is made of; key: tells it from every other."""

    @property
    def key(self) -> str: ...


@dataclass(frozen=True)
class Numbered:
    """A case of a set that is drawn from a seed."""

    number: int
    seed: int

    @property
    def key(self) -> str:
        return f"{self.seed} #{self.number}"


def attempt(run: Callable[[Any], Row], case: Case) -> Row:
    """A row, with its seconds; one that says `failed` and why where it could not be made."""
    began = time.perf_counter()
    try:
        row = run(case)
    except Exception as e:  # a benchmark's table must show what broke, whatever it was
        where = traceback.extract_tb(e.__traceback__)[-1]
        row = {"failed": f"{type(e).__name__}: {str(e)[:160]} ({Path(where.filename).name}:{where.lineno})"}
    return {"key": case.key, "seconds": time.perf_counter() - began} | row


def gather(cases: Iterable[Case], run: Callable[[Any], Row], file: str | None, workers: int) -> list[Row]:
    """The rows of all cases: those already in `file`, and the others, which are added to it as they are done."""
    cases = list(cases)
    wanted = {c.key for c in cases}
    path = Path(file or os.devnull)
    found = (
        [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if file and path.exists() else []
    )
    found = [r for r in found if r["key"] in wanted]
    done = {r["key"] for r in found}
    left = [c for c in cases if c.key not in done]
    one = partial(attempt, run)
    with path.open("a", encoding="utf-8") as rows:

        def keep(row: Row) -> None:
            found.append(row)
            print(json.dumps(row, default=float), file=rows, flush=True)

        if workers <= 1:
            for case in left:
                keep(one(case))
            return found
        with ProcessPoolExecutor(workers) as pool:
            for future in as_completed([pool.submit(one, case) for case in left]):
                keep(future.result())
    return found


def interval(count: int, n: int) -> tuple[float, float]:
    """95 % interval of a share, count of n (Clopper-Pearson)."""
    found = stats.binomtest(count, n).proportion_ci(0.95)
    return float(found.low), float(found.high)


def share(count: int, n: int) -> str:
    """`4.0 % (1.1-9.9)`, with that interval; `-` of nothing."""
    if n == 0:
        return "-"
    low, high = interval(count, n)
    return f"{100 * count / n:.1f} % ({100 * low:.1f}-{100 * high:.1f})"
