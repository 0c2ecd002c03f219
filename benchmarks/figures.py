"""Every row of docs/figures.md in full, and the numbers beside it: `python -m benchmarks.figures [FIGURE ...]`.

The commands are run as the page has them, without the shorter axes of the tests. What they draw is held to the same
claims (axes, series, points; tests/test_thesis_figures.py), the tables of their studies to those of docs/granular.md, and
every number of tests/test_doc_numbers.py to its page. Rows that fail come first. All: about 15 minutes on two cores.
"""

from __future__ import annotations

import contextlib
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
from typing import NamedTuple

from jumpvision.cli import main as command
from jumpvision.thesis.studies import study

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


def kept(number: int) -> Kept:
    """Run the commands of a row and look at what they draw."""
    began, fails, axes = time.perf_counter(), [], []
    for words in figures.rows()[number]:
        with tables() as told, pictures.figures_made() as made:
            if code := in_full(words):
                fails.append(f"`{words}` ends with {code}")
        axes += [a for figure in made for a in figure.axes]
        fails += [text for name, rows in told for text in differing(name, rows)]
    for claim in figures.CLAIMS[number]:
        found = sum(figures.holds(a, claim) for a in axes)
        if found < claim.panels:
            fails.append(f"{found} of {claim.panels} panels {claim}")
    lines = [line for a in axes for line in a.lines]
    points = sum(len(line.get_xdata()) for line in lines)
    return Kept(number, fails, len(axes), len(lines), points, time.perf_counter() - began)


def in_full(text: str) -> int:
    """Exit code of a command of the page; a campaign that it needs is made first."""
    words = shlex.split(text.replace(" --results results", ""))
    if words[0] == "run" and Path(f"{words[1]}.toml").exists() and not Path(words[1]).exists():
        command(["synth", f"{words[1]}.toml", words[1]])
    if words[0] != "figures":
        words += ["--results", re.sub(r"\W+", "-", text)]
    with contextlib.redirect_stdout(io.StringIO()):
        return command(words)


@contextlib.contextmanager
def tables() -> Iterator[list[tuple[str, dict[str, str]]]]:
    """The tables of the studies that are run meanwhile: name of the study, what it tells by quantity."""
    found: list[tuple[str, dict[str, str]]] = []
    whole = study.Study.__call__

    def watched(self, given):
        data, rows = whole(self, given)
        found.append((self.name, {r["quantity"]: r["ours"] for r in rows}))
        return data, rows

    study.Study.__call__ = watched
    try:
        yield found
    finally:
        study.Study.__call__ = whole


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
