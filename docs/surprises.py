"""Make the text of surprises.md from the marks of the tests, each `@pytest.mark.surprise(package=, version=, ...)`."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from tables import rows

TARGET = Path(__file__).with_name("surprises.md")
TESTS = Path(__file__).parents[1] / "tests"
HEAD = """# Surprises

Libraries and files that behave otherwise than one remembers. Each row was seen with the version named; a test of the
name in the last column tries it again with the version that is installed.
"""


def surprises() -> Iterator[dict[str, object]]:
    """Yield a row for each mark, in the order of the files; its arguments are literal strings."""
    for file in sorted(TESTS.rglob("test_*.py")):
        for test in (n for n in ast.walk(ast.parse(file.read_text(encoding="utf-8"))) if hasattr(n, "decorator_list")):
            for mark in test.decorator_list:
                if isinstance(mark, ast.Call) and ast.unparse(mark.func) == "pytest.mark.surprise":
                    said = {k.arg: ast.literal_eval(k.value) for k in mark.keywords}
                    yield {
                        "package": f"{said['package']} {said['version']}",
                        "what it does": said["behaviour"],
                        "what jumpvision does": said["here"],
                        "test": f"`{file.stem}::{test.name}`",
                    }


def text() -> str:
    """Return the whole page."""
    return f"{HEAD}\n{rows(sorted(surprises(), key=lambda r: str(r['package']).lower()))}\n"
