"""Benchmarks and their numbers as CSV: `python -m benchmarks.run NAME [OPTIONS of the benchmark]`, or `--list`.

Runs `python -m benchmarks.NAME`, shows what it prints, and adds a line a number of its tables to
`benchmarks/results/NAME.csv`: benchmark, quantity, value, unit, commit, date, machine, seed. A quantity is the row's
words and the column's heading; a cell with several numbers gives several. Commit them; docs/benchmarks.md says what
they are. Peers need `pip install -e '.[bench]'`, real pictures JUMPVISION_REAL_DATA.
"""

from __future__ import annotations

import csv
import datetime
import os
import platform
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
COLUMNS = ("benchmark", "quantity", "value", "unit", "commit", "date", "machine", "seed")
TABLE = re.compile(r"(?:^\|.*\n?)+", re.M)
NUMBER = re.compile(r"(?<![\w.])[-+]?\d[\d,]*\.?\d*(?:e[-+]?\d+)?")
UNIT = re.compile(r"\[([^]]+)\]|(%|\bpx\b|\bpx\^2|\bgrey\b|\bmm\b|\bs\b)")


def numbers_of(printed: str) -> Iterator[tuple[str, float, str]]:
    """Yield (quantity, value, unit) of every number in the tables of a text."""
    for table in TABLE.findall(printed):
        head, _, *rows = [
            [c.strip() for c in line.strip().strip("|").split("|")] for line in table.strip().splitlines()
        ]
        values = [k for k in range(len(head)) if k and any(NUMBER.match(r[k]) for r in rows if k < len(r))]
        names = [k for k in range(len(head)) if k not in values] or [0]
        for row in rows:
            name = ", ".join(row[k] for k in names if k < len(row) and row[k])
            for k in values:
                found = NUMBER.findall(row[k]) if k < len(row) else []
                unit = UNIT.search(head[k]) or UNIT.search(row[k]) if found else None
                for i, text in enumerate(found):
                    part = f" ({i + 1} of {len(found)})" if len(found) > 1 else ""
                    quantity = f"{name}; {head[k]}{part}"
                    yield quantity, float(text.replace(",", "")), (unit[1] or unit[2]) if unit else "1"


def machine() -> str:
    """Return processor, cores, Python."""
    model = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text()) if sys.platform == "linux" else None
    name = model[1] if model else platform.machine()
    return f"{name}, {os.cpu_count()} cores, Python {platform.python_version()}"


def commit() -> str:
    """Return the hash of the tree, with a plus where files differ from it."""
    told = subprocess.run(["git", "describe", "--always", "--dirty=+"], cwd=ROOT, capture_output=True, text=True)
    return told.stdout.strip() or "unknown"


def main(name: str = "--list", *options: str) -> None:
    """Run one benchmark and keep its numbers."""
    folder = ROOT / "benchmarks"
    there = sorted({f.stem for f in folder.glob("*.py")} - {"__init__", "run"} | {"causes"})
    if name not in there:
        raise SystemExit("\n".join(there) if name == "--list" else f"{name}: one of {', '.join(there)}")
    command, printed = [sys.executable, "-m", f"benchmarks.{name}", *options], ""
    env = {**os.environ, "PYTHONUTF8": "1"}
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, encoding="utf-8", env=env) as running:
        assert running.stdout is not None
        for line in running.stdout:
            print(line, end="", flush=True)
            printed += line
    if running.returncode:
        raise SystemExit(f"benchmarks.{name} failed: nothing is kept")
    seed = re.search(r"--seed[ =](\d+)", " ".join(options)) or re.match(r"((?:\d+ ?)+)$", " ".join(options))
    said = (commit(), datetime.date.today().isoformat(), machine(), seed[1] if seed else "default")
    file = folder / "results" / f"{name}.csv"
    file.parent.mkdir(exist_ok=True)
    new = not file.exists()
    with file.open("a", newline="", encoding="utf-8") as out:
        table = csv.writer(out)
        table.writerows([COLUMNS] * new)
        table.writerows([name, quantity, value, unit, *said] for quantity, value, unit in numbers_of(printed))


if __name__ == "__main__":
    main(*sys.argv[1:])
