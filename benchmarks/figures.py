"""Every row of docs/figures.md in full, and the numbers beside it: `python -m benchmarks.figures [FIGURE ...]`.

The commands are run as the page has them, without the shorter axes of the tests. What they draw is held to the same
claims (axes, series, at least so many points and cells; tests/test_thesis_figures.py), the tables of their studies to
those of granular.md, each number of tests/test_doc_numbers.py to its page. Rows that fail come first. All: 10 minutes.
"""

from __future__ import annotations

import contextlib
import functools
import importlib
import io
import os
import re
import shlex
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh

from jumpvision.cli import main as command
from jumpvision.thesis.studies import study
from jumpvision.thesis.studies.study import Found, Study

sys.path[:0] = [str(Path(__file__).parents[1] / name) for name in ("tests", "docs")]
pictures, numbers, figures = map(importlib.import_module, ("pictures", "test_doc_numbers", "test_thesis_figures"))


class Kept(NamedTuple):
    """A row of the page as it was run: what fails of it, how many panels, series and points were drawn."""

    number: int
    fails: list[str]
    panels: int
    series: int
    points: int
    seconds: float


class Drawn(NamedTuple):
    """What a command draws, and what fails of it."""

    axes: list[Axes]
    fails: list[str]


@functools.cache
def carried_out(words: str) -> Drawn:
    """A command of the page in full; several rows share one."""
    with tables() as told, pictures.figures_made() as made:
        code = in_full(words)
    fails = [f"`{words}` ends with {code}"] if code else []
    return Drawn([a for f in made for a in f.axes], fails + [x for n, rows in told for x in differing(n, rows)])


def kept(number: int) -> Kept:
    """Run the commands of a row and look at what they draw."""
    began = time.perf_counter()
    drawn = [carried_out(words) for words in figures.rows()[number]]
    axes, fails = [a for d in drawn for a in d.axes], [x for d in drawn for x in d.fails]
    for claim in figures.CLAIMS[number]:
        found = sum(holds(a, claim) for a in axes)
        if found < claim.panels:
            fails.append(f"{found} of {claim.panels} panels {claim.y} over {claim.x}, {claim}")
    lines = [line for a in axes for line in a.lines]
    points = sum(len(line.get_xdata()) for line in lines)
    return Kept(number, fails, len(axes), len(lines), points, time.perf_counter() - began)


def holds(axes: Axes, claim: Any) -> bool:
    """As in the tests, whose maps have the cells of the shorter axes: here there are as many or more."""
    cells = max((c.get_array().size for c in axes.collections if isinstance(c, QuadMesh)), default=0)
    return bool(figures.holds(axes, claim._replace(cells=0))) and cells >= claim.cells


def in_full(text: str) -> int:
    """Exit code of a command of the page; a campaign that it needs is made first. One worker: others draw unseen."""
    words = shlex.split(text.replace(" --results results", ""))
    if words[0] == "run" and Path(f"{words[1]}.toml").exists() and not Path(words[1]).exists():
        command(["synth", f"{words[1]}.toml", words[1]])
    if words[0] == "run":
        words += ["--workers", "1"]
    if words[0] != "figures":
        words += ["--results", re.sub(r"\W+", "-", text)]
    with contextlib.redirect_stdout(io.StringIO()):
        return command(words)


@contextlib.contextmanager
def tables() -> Iterator[list[tuple[str, dict[str, str]]]]:
    """The tables of the studies that are run meanwhile: name of the study, what it tells by quantity."""
    found: list[tuple[str, dict[str, str]]] = []
    whole = study.Study.__call__

    def watched(self: Study[Any], given: Any) -> Found:
        data, rows = whole(self, given)
        found.append((self.name, {str(r["quantity"]): str(r["ours"]) for r in rows}))
        return data, rows

    study.Study.__call__ = watched  # type: ignore[method-assign]
    try:
        yield found
    finally:
        study.Study.__call__ = whole  # type: ignore[method-assign]


def differing(name: str, told: dict[str, str]) -> list[str]:
    """Where the table of a study is not that of docs/granular.md."""
    stated = {c[0]: c[3] for n, row in numbers.TABLE if n == name and (c := [x.strip() for x in row.split("|")])}
    if not stated:
        return []
    if stated.keys() != told.keys():
        return [f"docs/granular.md, {name}: other quantities, {', '.join(stated.keys() ^ told.keys())}"]
    return [text for q, v in stated.items() if (text := pictures.differs(v, told[q], f"granular.md, {name}, {q}"))]


def main(*asked: str) -> None:
    """Print two tables: the rows of the page, and the numbers of the pages that differ."""
    wanted = [int(a) for a in asked] or list(figures.CLAIMS)
    home = Path.cwd()
    found = []
    with tempfile.TemporaryDirectory() as folder:
        figures.laid_out(Path(folder))
        os.chdir(folder)
        try:
            for number in wanted:
                found.append(kept(number))
                print(f"Fig {number}: {found[-1].seconds:.0f} s", file=sys.stderr, flush=True)
        finally:
            os.chdir(home)
    print("| figure | fails | panels | series | points | s |\n|---|---|---|---|---|---|")
    for k in sorted(found, key=lambda k: -len(k.fails)):
        print(f"| {k.number} | {'; '.join(k.fails)} | {k.panels} | {k.series} | {k.points} | {k.seconds:.0f} |")
    good = sum(not k.fails for k in found)
    print(f"\n{good} of {len(found)} rows of docs/figures.md are kept in full.")
    if not asked:
        wrong = [text for c in numbers.CLAIMS if (text := numbers.misses(c, numbers.page(c.page)))]
        print(f"{len(numbers.CLAIMS) - len(wrong)} of {len(numbers.CLAIMS)} sentences say what the program gives.")
        print("".join(f"- {text}\n" for text in wrong), end="")


if __name__ == "__main__":
    main(*sys.argv[1:])
