"""Tests that would notice: faults of the kinds that people make, one at a time, in a copy of the tree.

`python -m benchmarks.mutations [--wing WING] [--only NAME ...] [--list] [--jobs N] [--copy FOLDER]`

Each fault changes one expression of the physics to one that runs and is wrong: a sign, a factor, an axis, a unit, off
by one, a thing forgotten, names swapped, a term of an uncertainty dropped. Then the short run of the tests that should
notice (`-m 'not long'`, as by default) is made on it, without a fault first. Where the code has moved on, a fault says
what to look for, and the program fails. --copy keeps the copied tree, whose compiled code the next call finds again.
"""

from __future__ import annotations

import argparse
import ast
import functools
import math
import os
import queue
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
COPIED = ("jumpvision", "tests", "data_samples", "docs", "pipelines", "benchmarks", "*.md", "*.toml", "*.cff")
SLOWER, LEAST = 4.0, 300.0  # times what the tests take without a fault, and s: a fault may recompile, or never end
COMPILED = re.compile(r"\bnumba\b|^@(?:law|shared|kernel|inlined)\b", re.MULTILINE)
FIRST = re.compile(r"^(?:FAILED|ERROR) (?:tests/)?(?:\w+/)*(\S+?)(?:\[.*)?(?: - .*)?$", re.MULTILINE)


class Fault(NamedTuple):
    """A fault. file: where the expression is, found by name; old, new: the expression, blanks of no account. tests:
    files that should notice, anywhere below tests/; select: which of their tests (`pytest -k`), where all take long."""

    name: str
    wing: str
    kind: str
    file: str
    old: str
    new: str
    tests: str
    select: str = ""


def faults() -> list[Fault]:
    """Read mutations.txt: name | wing | kind | file | tests | select, the expression after -, the fault after +."""
    out = []
    for entry in Path(__file__).with_suffix(".txt").read_text(encoding="utf-8").strip().split("\n\n"):
        head, old, new = entry.split("\n")
        name, wing, kind, file, *rest = head.split(" | ")
        out.append(Fault(name, wing, kind, file, old.removeprefix("- "), new.removeprefix("+").strip(), *rest))
    return out


class Place(NamedTuple):
    """A file below the root, and its text with the fault in it."""

    file: Path
    text: str


class Outcome(NamedTuple):
    """What became of a fault: caught by a test, SURVIVED, or why it was not measured; s it took."""

    fault: Fault
    by: str
    seconds: float

    @property
    def caught(self) -> bool | None:
        """None where it was not measured."""
        return None if self.by.startswith("not ") else self.by != SURVIVED


SURVIVED = "SURVIVED"


def place_of(fault: Fault) -> Place:
    """The one place of a fault in the package, in a file of its name or else in any. LookupError: what to look for."""
    tokens = re.findall(r"\w+|[^\w\s]", fault.old)
    pattern = re.compile(r"\s*".join(map(re.escape, tokens)))
    files = [f for f in sorted((ROOT / "jumpvision").rglob("*.py")) if "laboratory" not in f.parts]
    for some in ([f for f in files if f.name == fault.file], files):
        texts = {f: f.read_text(encoding="utf-8") for f in some}
        found = [(f, m) for f, text in texts.items() for m in pattern.finditer(text)]
        if len(found) > 1:
            raise LookupError(f"not unique: {fault.old} is there {len(found)} times: write more of it")
        for f, m in found:
            text = texts[f][: m.start()] + fault.new + texts[f][m.end() :]
            ast.parse(text)
            return Place(f.relative_to(ROOT), text)
    raise LookupError(f"not found: look for {fault.old} (it was in a {fault.file}) and write it as it is now")


def copied(target: Path) -> None:
    """The tree as it is now, times of files and all, so that compiled code of an earlier copy is known again."""
    for f in target.rglob("*.py"):
        if not (ROOT / f.relative_to(target)).exists():
            f.unlink()
    target.mkdir(parents=True, exist_ok=True)
    for f in (f for pattern in COPIED for f in ROOT.glob(pattern)):
        copy = functools.partial(shutil.copytree, dirs_exist_ok=True) if f.is_dir() else shutil.copy2
        copy(f, target / f.name)


def tested(copy: Path, fault: Fault, limit: float, compiled: str = "") -> tuple[int | None, str]:
    """(pytest's exit code, None beyond the limit; what it said) of a fault's tests in a copy. compiled: where numba
    keeps code, its own place where none is given."""
    call = [sys.executable, "-m", "pytest", "-n", "0", "-x", "-q", "-p", "no:cacheprovider", "--tb=line"]
    files = [str(f.relative_to(copy)) for name in fault.tests.split() for f in (copy / "tests").rglob(name)]
    call += files + (["-k", fault.select] if fault.select else [])
    own = {"PYTHONPATH": str(copy)} | ({"NUMBA_CACHE_DIR": compiled} if compiled else {})
    with tempfile.TemporaryFile("w+", encoding="utf-8") as said:
        run = subprocess.Popen(
            call, cwd=copy, env={**os.environ, **own}, stdout=said, stderr=subprocess.STDOUT, start_new_session=True
        )
        try:
            code = run.wait(limit)
        except subprocess.TimeoutExpired:
            os.killpg(run.pid, signal.SIGKILL)
            run.wait()
            code = None
        said.seek(0)
        return code, said.read()


class Bench:
    """A copy of the tree in which one fault at a time is put; what its tests take without one is asked once."""

    def __init__(self, copy: Path):
        copied(copy)
        self.copy, self.calm = copy, dict[tuple[str, str], float | str]()

    def without(self, fault: Fault) -> float | str:
        """Time [s] that the tests of a fault take without it, or why they do not pass."""
        key = fault.tests, fault.select
        if key not in self.calm:
            began = time.perf_counter()
            code, said = tested(self.copy, fault, 10.0 * LEAST)
            why = (FIRST.findall(said) or said.strip().splitlines() or ["no answer"])[-1]
            self.calm[key] = time.perf_counter() - began if code == 0 else f"not measured: without the fault {why}"
        return self.calm[key]

    def judged(self, fault: Fault) -> Outcome:
        """Whether the fault's tests notice it."""
        began = time.perf_counter()
        try:
            place = place_of(fault)
        except LookupError as e:
            return Outcome(fault, str(e), 0.0)
        calm = self.without(fault)
        if isinstance(calm, str):
            return Outcome(fault, calm, time.perf_counter() - began)
        target, began = self.copy / place.file, time.perf_counter()
        kept = target.with_name(target.name + ".kept")
        target.rename(kept)  # renamed back it has its old time, and what was compiled of it is known again
        try:
            target.write_text(place.text, encoding="utf-8")
            with tempfile.TemporaryDirectory() as fresh:  # numba sees no change of what a function calls elsewhere
                compiled = fresh if COMPILED.search(place.text) else ""
                code, said = tested(self.copy, fault, LEAST + SLOWER * calm, compiled)
        finally:
            kept.replace(target)
        took = time.perf_counter() - began
        by = "no end" if code is None else SURVIVED if code == 0 else (FIRST.findall(said) or ["no test: an error"])[0]
        return Outcome(fault, by, took)


def outcomes(faults: list[Fault], jobs: int, folder: Path) -> Iterator[Outcome]:
    """Of every fault in their order, so many at a time, each job with a copy in the folder."""
    free: queue.SimpleQueue[Bench] = queue.SimpleQueue()
    for k in range(jobs):
        free.put(Bench(folder / f"tree-{k}"))

    def one(fault: Fault) -> Outcome:
        bench = free.get()
        try:
            return bench.judged(fault)
        finally:
            free.put(bench)

    with ThreadPoolExecutor(jobs) as pool:
        for found in pool.map(one, faults):
            print(f"{found.fault.name}: {found.by} ({found.seconds:.0f} s)", file=sys.stderr, flush=True)
            yield found


def share(caught: int, n: int) -> str:
    """`58 of 60, 97 ± 3 %`: the error of a share whose every value was alike before (Laplace), so of all too."""
    p = (caught + 1) / (n + 2)
    return f"{caught} of {n}, {100 * caught / max(n, 1):.0f} ± {100 * math.sqrt(p * (1 - p) / (n + 3)):.0f} %"


def told(found: list[Outcome]) -> None:
    """Print markdown."""
    print("| fault | wing | kind | noticed by | s |\n|---|---|---|---|---|")
    for o in found:
        print(f"| {o.fault.name} | {o.fault.wing} | {o.fault.kind} | {o.by} | {o.seconds:.0f} |")
    judged = [o for o in found if o.caught is not None]
    print("\n| wing | noticed |\n|---|---|")
    for wing in dict.fromkeys(o.fault.wing for o in judged):
        mine = [o.caught for o in judged if o.fault.wing == wing]
        print(f"| {wing} | {sum(map(bool, mine))} of {len(mine)} |")
    print(f"\nNoticed: {share(sum(bool(o.caught) for o in judged), len(judged))}.")
    if left := len(found) - len(judged):
        print(f"Not measured: {left}, see the table.")


def main() -> int:
    """0 where every fault was measured; a survivor is a result, no failure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="faults with one of these in the name")
    parser.add_argument("--wing", default="", help="faults of this wing, as estimate or films")
    parser.add_argument("--list", action="store_true", help="what there is, and whether each is found in the code")
    parser.add_argument("--jobs", type=int, default=1, help="faults at a time")
    parser.add_argument("--copy", type=Path, help="folder of the copied tree, used again; default: a temporary one")
    a = parser.parse_args()
    chosen = [f for f in faults() if f.wing.startswith(a.wing) and (not a.only or any(o in f.name for o in a.only))]
    if a.list:
        return listed(chosen)
    with tempfile.TemporaryDirectory() as folder:
        found = list(outcomes(chosen, max(a.jobs, 1), a.copy or Path(folder)))
    told(found)
    return int(any(o.caught is None for o in found))


def listed(faults: list[Fault]) -> int:
    """Print the faults with their places; 1 where one has none any more."""
    lost = 0
    for f in faults:
        try:
            where = str(place_of(f).file)
        except LookupError as e:
            where, lost = str(e), 1
        print(f"{f.wing:13s} {f.kind:20s} {f.name}\n    {where}; {f.tests} {f.select}".rstrip())
    return lost


if __name__ == "__main__":
    sys.exit(main())
