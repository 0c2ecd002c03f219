"""The house in numbers: `python tests/house_counts.py` prints them; the table of the wings; what a door loads.

The numbers are signs by which a round of work is judged, printed and never asserted;
what must hold stands in test_house.py.
"""

from __future__ import annotations

import ast
import functools
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1] / "jumpvision"
ROW = re.compile(r"^\| (\d+) \| `(\w+)` \| ([^|]*)\|", re.M)
NUMBER = re.compile(r"^[A-Z][A-Z_0-9, ]* = -?[0-9.]", re.M)


class Wing(NamedTuple):
    """Its floor, and its rooms from below (none: their order is free)."""

    floor: int
    rooms: tuple[str, ...]


@functools.cache
def wings() -> dict[str, Wing]:
    """The wings as docs/architecture.md lists them."""
    page = (ROOT.parent / "docs" / "architecture.md").read_text(encoding="utf-8")
    table = page[page.index("## The wings") : page.index("Three rules besides")]
    return {name: Wing(int(floor), tuple(re.findall(r"`(\w+)`", rooms))) for floor, name, rooms in ROW.findall(table)}


@functools.cache
def modules() -> dict[str, Path]:
    """Files of the package by dotted name."""
    out = {}
    for file in sorted(ROOT.rglob("*.py")):
        parts = file.relative_to(ROOT.parent).with_suffix("").parts
        out[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    return out


@functools.cache
def tree(file: Path) -> ast.Module:
    """The syntax of a file."""
    return ast.parse(file.read_text(encoding="utf-8"))


@functools.cache
def imports(name: str) -> frozenset[str]:
    """Modules of the package that a module imports, anywhere in it."""
    file = modules()[name]
    package = list(file.relative_to(ROOT.parent).parent.parts)
    out = set()
    for node in ast.walk(tree(file)):
        if isinstance(node, ast.Import):
            out |= {a.name for a in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            full = ".".join([*base, *(node.module.split(".") if node.module else [])])
            out |= {f"{full}.{a.name}" if f"{full}.{a.name}" in modules() else full for a in node.names}
    return frozenset(out & modules().keys())


def circles() -> list[list[str]]:
    """Modules that import each other, directly or by way of others (Tarjan's strongly connected components)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found = []

    def visit(v: str) -> None:
        index[v] = low[v] = len(index)
        stack.append(v)
        for w in imports(v):
            if w not in index:
                visit(w)
            if w in stack:
                low[v] = min(low[v], low[w])
        if low[v] == index[v]:
            one = stack[stack.index(v) :]
            del stack[stack.index(v) :]
            if len(one) > 1:
                found.append(sorted(one))

    for v in modules():
        if v not in index:
            visit(v)
    return found


def loaded(code: str) -> tuple[int, int]:
    """Modules of the package, and lines of their files, that a program loads."""
    tail = "\nimport sys; print(*[m.__file__ for n, m in sys.modules.items() if n.startswith('jumpvision')], sep='\\n')"
    call = [sys.executable, "-c", code + tail]
    out = subprocess.run(call, capture_output=True, text=True, check=True, cwd=ROOT.parent)
    files = [Path(line) for line in out.stdout.splitlines() if line.endswith(".py")]
    return len(files), sum(len(f.read_text(encoding="utf-8").splitlines()) for f in files)


def code_lines(text: str) -> int:
    """Lines that are neither blank nor a comment nor a docstring."""
    lines = {i for i, line in enumerate(text.splitlines(), 1) if line.strip() and not line.strip().startswith("#")}
    for node in ast.walk(ast.parse(text)):
        documented = isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        if documented and ast.get_docstring(node) is not None:
            doc = node.body[0]
            lines -= set(range(doc.lineno, (doc.end_lineno or doc.lineno) + 1))
    return len(lines)


def code_lines_of(folder: Path) -> int:
    """Code lines of all Python files below a folder."""
    return sum(code_lines(f.read_text(encoding="utf-8")) for f in folder.rglob("*.py"))


def lines_of(file: Path) -> int:
    return len(file.read_text(encoding="utf-8").splitlines())


def words_of(file: Path) -> int:
    return len(file.read_text(encoding="utf-8").split())


def pages() -> list[Path]:
    """The pages of docs/ that git keeps."""
    return [f for f in (ROOT.parent / "docs").rglob("*.md") if f.name not in ("api.md", "keys.md", "surprises.md")]


def commands() -> list[str]:
    """Names that `jumpvision --help` lists."""
    code = "from jumpvision.cli import main; main(['--help'])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT.parent)
    return re.findall(r"^│ ([a-z]+) ", out.stdout, re.M)


def upward() -> Iterator[str]:
    """Imports that do not point down, by the table of the wings."""
    for name in modules():
        here = name.split(".")
        for other in imports(name):
            there = other.split(".")
            if len(here) < 2 or len(there) < 2:
                continue
            a, b = wings()[here[1]], wings()[there[1]]
            if here[1] != there[1]:
                up = b.floor >= a.floor
            else:
                both = bool(a.rooms) and len(here) > 2 and len(there) > 2
                up = both and a.rooms.index(there[2]) > a.rooms.index(here[2])
            if up:
                yield f"{name} imports {other}"


DOORS = {
    "jv.piv(a, b)": "import numpy as np, jumpvision as jv\n"
    "a = np.random.default_rng(0).integers(0, 255, (96, 128)).astype('uint8'); jv.piv(a, np.roll(a, 1, 1))",
    "jv.track(frames)": "import numpy as np, jumpvision as jv\ny, x = np.mgrid[:64, :80]\n"
    "f = [(40 + 160 / (1 + np.exp(2 * (np.hypot(x - 30.2 - i, y - 32) - 6)))).astype('uint8') for i in range(8)]\n"
    "jv.track(np.array(f), frame_rate=500, diameter=12)",
    "jv.diagnose(recordings, study)": "import numpy as np, jumpvision as jv\n"
    "t, rng = np.arange(60) / 200, np.random.default_rng(0)\n"
    "drag = jv.Mechanism('drag', [jv.Parameter('c', 0.0, (-5, 5))])\n"
    "fall = lambda p, r: 0.5 * p['g'] * r.t**2 - p['c'] * r.t**3\n"
    "study = jv.Study(fall, [jv.Parameter('g', 9.8, (9, 11))], [drag], [jv.Channel('y', 'm', noise=1e-3)])\n"
    "y = [4.9 * t**2 - 0.3 * t**3 + 1e-3 * rng.standard_normal(60) for k in range(3)]\n"
    "found = jv.diagnose([jv.Recording(f'fall {k}', t, y[k]) for k in range(3)], study)\n"
    "assert found.named == ('drag',)",
}


def counts() -> dict[str, object]:
    """The house as it is."""
    text = {f: f.read_text(encoding="utf-8") for f in modules().values()}
    all_of = "".join(text.values())
    return {
        "files": len(text),
        "lines": sum(len(t.splitlines()) for t in text.values()),
        "code lines": sum(code_lines(t) for t in text.values()),
        **{f"code lines of {f}": code_lines_of(ROOT.parent / f) for f in ("tests", "benchmarks", "pipelines")},
        "lines of JavaScript": sum(map(lines_of, (f for f in ROOT.rglob("*.js") if "uplot" not in f.parts))),
        "words of docs": sum(map(words_of, pages())),
        "commands of --help, with the stages": len(commands()),
        "named numbers": len(NUMBER.findall(all_of)),
        "the word Any": len(re.findall(r"\bAny\b", all_of)),
        "imports that point up": len(list(upward())),
        "circles": len(circles()),
        **{f"{door} loads (modules, lines)": loaded(code) for door, code in DOORS.items()},
    }


if __name__ == "__main__":
    for name, n in counts().items():
        print(f"{name:48}{n}")
