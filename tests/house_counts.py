"""The house in numbers: `python tests/house_counts.py`; the bounds that test_house.py keeps, and the aims."""

from __future__ import annotations

import ast
import functools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1] / "jumpvision"
FLOOR = re.compile(r"^\| (\d+) \| `(\w+)` \|", re.M)
LONG, MANY = 100, 10  # lines and arguments of a function


class Bound(NamedTuple):
    """What a count may be now, and what it shall come to; a bound above its aim may only fall; that of the files
    rises with a capability, by the files which that needs, or where a long one becomes two."""

    now: int
    aim: int


BOUNDS = {
    "rooms": Bound(22, 22),
    "floors": Bound(9, 9),
    "loose modules": Bound(1, 2),
    "entries of the fullest folder": Bound(12, 12),
    "files": Bound(362, 250),
    "fmt: skip": Bound(0, 39),
    'attrs["..."] outside results': Bound(0, 0),
    "dict[str, Any]": Bound(54, 59),
    "large functions outside kernels": Bound(0, 0),
}


def floors() -> list[set[str]]:
    """Rooms by floor, from the ground up, as docs/architecture.md lists them."""
    page = (ROOT.parent / "docs" / "architecture.md").read_text(encoding="utf-8")
    by_number: dict[int, set[str]] = {}
    for number, room in FLOOR.findall(page):
        by_number.setdefault(int(number), set()).add(room)
    assert sorted(by_number) == list(range(1, len(by_number) + 1)), "floors are numbered from 1 without a gap"
    return [by_number[n] for n in sorted(by_number)]


def entries(folder: Path) -> list[str]:
    """Modules and packages in a folder."""
    modules = [f.stem for f in folder.glob("*.py") if f.stem != "__init__"]
    return sorted(modules + [d.name for d in folder.iterdir() if (d / "__init__.py").exists()])


def large_functions(file: Path) -> Iterator[str]:
    """Functions of more than LONG lines or MANY arguments that are not compiled (by their decorators)."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        if any(re.search(r"jit|kernel|vectorize|shared", ast.unparse(d)) for d in node.decorator_list):
            continue
        a = node.args
        names = [x.arg for x in (*a.posonlyargs, *a.args, *a.kwonlyargs)]
        lines, given = (node.end_lineno or 0) - node.lineno + 1, len(names) - (names[:1] in (["self"], ["cls"]))
        if lines > LONG or given > MANY:
            yield f"{file.relative_to(ROOT)}: {node.name} ({lines} lines, {given} arguments)"


@functools.cache
def counts() -> dict[str, int]:
    """The house as it is."""
    files = sorted(ROOT.rglob("*.py"))
    text = {f: f.read_text(encoding="utf-8") for f in files}
    folders = {f.parent for f in files} - {ROOT}
    outside = [t for f, t in text.items() if f.relative_to(ROOT).parts[0] != "results"]
    return {
        "rooms": len(entries(ROOT)),
        "floors": len(floors()),
        "loose modules": len([f for f in ROOT.glob("*.py") if f.stem not in ("__init__", "__main__")]),
        "entries of the fullest folder": max(len(entries(d)) for d in folders),
        "files": len(files),
        "fmt: skip": sum(t.count("fmt: skip") for t in text.values()),
        'attrs["..."] outside results': sum(t.count('attrs["') for t in outside),
        "dict[str, Any]": sum(t.count("dict[str, Any]") for t in text.values()),
        "large functions outside kernels": sum(len(list(large_functions(f))) for f in files),
    }


if __name__ == "__main__":
    for name, n in counts().items():
        print(f"{name:34}{n:6}   bound {BOUNDS[name].now:4}, aim {BOUNDS[name].aim}")
    for folder in sorted({f.parent for f in ROOT.rglob("*.py")} - {ROOT}, key=lambda d: -len(entries(d))):
        if len(entries(folder)) > BOUNDS["entries of the fullest folder"].aim:
            print(f"  {folder.relative_to(ROOT)}: {len(entries(folder))} entries")
    for file in sorted(ROOT.rglob("*.py")):
        for function in large_functions(file):
            print(f"  {function}")
