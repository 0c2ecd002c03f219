"""Write docs/api.md, the public functions and classes with their docstrings, and the types of `jv.*`: this script."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jumpvision
from jumpvision.api import without_folder
from jumpvision.workflow.stage import results_stages

TARGET = Path(__file__).with_name("api.md")
ROOT = Path(jumpvision.__file__).parent
STUB = ROOT / "__init__.pyi"
ROOMS = {  # what a heading covers, in the order of the page
    "For notebooks": ["api.py"],
    "Folders": ["inputs/experiment.py", "results", "base/schema.py"],
    "Films (`jumpvision.frames`)": ["frames"],
    "Pictures to pixels (`jumpvision.vision`)": ["vision"],
    "Velocity fields of grains (`jumpvision.grains`)": ["grains"],
    "Estimates (`jumpvision.estimate`)": ["estimate"],
    "Mechanisms (`jumpvision.mechanisms`)": ["mechanisms"],
    "The jumper (`jumpvision.physics`)": ["physics"],
    "Grains as discs (`jumpvision.dem`)": ["dem"],
    "Diagnosis (`jumpvision.diagnosis`)": ["diagnosis"],
    "Planning (`jumpvision.planning`)": ["planning"],
}
HEAD = """# API reference

Made by `python docs/reference.py` from the docstrings. The functions for notebooks are introduced in
[notebook.md](notebook.md). The rooms below them are core code: arrays in, arrays out, nothing read, written or drawn;
import them from their module, e.g. `from jumpvision.estimate.decay import ...`. Pixels and frames in `vision`,
SI units from `grains` on. "The thesis" is Aguilar, with the equations in [physics.md](physics.md)."""


def files(name: str) -> list[Path]:
    """A module, or the modules of a folder."""
    path = ROOT / name
    return [path] if path.suffix else sorted(f for f in path.rglob("*.py") if not f.name.startswith("_"))


def signature(node: ast.FunctionDef) -> str:
    """name(arguments) -> type, as written."""
    returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    return f"{node.name}({ast.unparse(node.args)}){returns}"


def public(body: list[ast.stmt]) -> Iterator[ast.FunctionDef | ast.ClassDef]:
    """Functions and classes with a docstring and without a leading underscore."""
    for node in body:
        if (
            isinstance(node, ast.FunctionDef | ast.ClassDef)
            and not node.name.startswith("_")
            and ast.get_docstring(node)
        ):
            yield node


def entry(node: ast.FunctionDef | ast.ClassDef, inside: str = "") -> str:
    """One function, or a class with its public methods."""
    doc = inspect.cleandoc(ast.get_docstring(node) or "")
    if isinstance(node, ast.FunctionDef):
        property_ = any(isinstance(d, ast.Name) and d.id == "property" for d in node.decorator_list)
        return f"`{inside}{node.name if property_ else signature(node)}`\n\n{doc}"
    return "\n\n".join([f"**`class {node.name}`**\n\n{doc}", *(entry(n, f"{node.name}.") for n in public(node.body))])


def module(file: Path) -> str:
    """A module with what it offers, "" where that is nothing."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    entries = [entry(node) for node in public(tree.body)]
    name = ".".join(["jumpvision", *file.relative_to(ROOT).with_suffix("").parts])
    return "\n\n".join([f"### {name}", ast.get_docstring(tree) or "", *entries]) if entries else ""


def _of_arrays(function: Callable[..., Any]) -> str:
    """The signature of a function of arrays, as the stub has it."""
    return str(inspect.signature(function)).replace("'", "")


def stub() -> str:
    """jumpvision/__init__.pyi: the functions that are found when first used, as editors and type checkers see them."""
    stages = results_stages()
    lines = [
        "# made by `python docs/reference.py`",
        "from typing import Any, overload",
        "import pandas as pd",
        "import xarray as xr",
        "from .api import Folder, PathLike",
        *(f"from .api import {verb} as {verb}" for verb in jumpvision.VERBS + jumpvision.TYPES),
        *(f"from {s.output.__module__} import {s.output.__name__}" for s in stages),
        "",
        "__version__: str",
        "__all__: list[str]",
        "VERBS: tuple[str, ...]",
        "TYPES: tuple[str, ...]",
        "",
        *(
            f"def {s.name}(experiment: Folder, *, results: PathLike | None = ...) -> {s.output.__name__}: ..."
            for s in stages
            if not without_folder(s.name)
        ),
        *(
            line
            for s in stages
            if (of := without_folder(s.name))
            for line in (
                "@overload",
                f"def {s.name}(experiment: Folder, *, results: PathLike | None = ...) -> {s.output.__name__}: ...",
                "@overload",
                f"def {s.name}{_of_arrays(of)}: ...",
            )
        ),
    ]
    return "\n".join(lines) + "\n"


def text() -> str:
    """The whole page."""
    parts = [HEAD]
    for heading, names in ROOMS.items():
        parts += [f"## {heading}", *(m for name in names for f in files(name) if (m := module(f)))]
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    TARGET.write_text(text(), encoding="utf-8")
    STUB.write_text(stub(), encoding="utf-8")
