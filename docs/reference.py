"""Make the text of api.md, the public names with their docstrings, and the types of `jv.*`.

`python docs/reference.py` writes the types, jumpvision/__init__.pyi.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jumpvision
from jumpvision.api import stage_function
from jumpvision.base.schema import InputError
from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.experiment.inputs.experiment import Campaign, Experiment
from jumpvision.experiment.workflow.stage import results_stages

TARGET = Path(__file__).with_name("api.md")
ROOT = Path(jumpvision.__file__).parent
STUB = ROOT / "__init__.pyi"
HEAD = """# API: `import jumpvision as jv`

Made from the docstrings when the site is built. All that is public is on this page: what `jv` offers, and the
records that its functions return. What else lies in the package may change from version to version. The functions are
introduced in [notebook.md](notebook.md); "the thesis" is Aguilar, with the equations in [physics.md](physics.md)."""


def signature(function: Callable[..., Any]) -> str:
    """(arguments) -> type, as written."""
    return re.sub(r"(: |-> )'([^']*)'", r"\1\2", str(inspect.signature(function)))


def members(kind: type) -> list[str]:
    """What a class offers beyond its fields: a line each, with the first of its docstring."""
    found = []
    for name, what in inspect.getmembers(kind):
        function = what.fget if isinstance(what, property) else what
        said = inspect.cleandoc(getattr(function, "__doc__", None) or "").split("\n")[0]
        own = (getattr(function, "__module__", None) or "").startswith("jumpvision") and not inspect.isclass(function)
        if own and callable(function) and said and not name.startswith("_"):
            call = "" if isinstance(what, property) else "()"
            found.append(f"- `.{name}{call}`: {said}")
    return found


def of_function(name: str) -> str:
    """A function of `jv`: how it is called, of a folder and of arrays, and its help."""
    function = stage_function(name) if name in jumpvision.OF_ARRAYS else getattr(jumpvision, name)
    calls = [f"jv.{name}{signature(function)}"]
    if name in {s.name for s in results_stages()}:
        calls = [f"jv.{name}(experiment, *, results=None) -> {function.__annotations__['return'].__name__}"]
        calls += [f"jv.{name}{signature(of)}" for of in map(jumpvision.of_arrays, {name} & jumpvision.OF_ARRAYS.keys())]
    return "\n\n".join([f"### {name}", "```python\n" + "\n".join(calls) + "\n```", inspect.cleandoc(function.__doc__)])


def of_class(kind: type, shown: str) -> str:
    """A class: what it holds and what it offers."""
    doc = inspect.cleandoc(kind.__doc__ or "")
    return "\n\n".join([f"### {shown}", doc, "\n".join(members(kind))]).rstrip()


def stub() -> str:
    """jumpvision/__init__.pyi: the functions that are found when first used, as editors and type checkers see them."""
    stages = results_stages()
    lines = [
        "# made by `python docs/reference.py`",
        "import os",
        "from collections.abc import Callable, Iterable",
        "from typing import Any, overload",
        "import pandas as pd",
        "import xarray as xr",
        "from numpy.typing import ArrayLike",
        "from .api import Folder, PathLike",
        *(f"from .{module} import {name} as {name}" for name, module in (jumpvision.VERBS | jumpvision.TYPES).items()),
        *(f"from {s.output.__module__} import {s.output.__name__}" for s in stages),
        "",
        "__version__: str",
        "__all__: list[str]",
        "VERBS: dict[str, str]",
        "TYPES: dict[str, str]",
        "OF_ARRAYS: dict[str, str]",
        "def of_arrays(name: str) -> Callable[..., Any]: ...",
        "",
        *(
            f"def {s.name}(experiment: Folder, *, results: PathLike | None = ...) -> {s.output.__name__}: ..."
            for s in stages
            if s.name not in jumpvision.OF_ARRAYS
        ),
        *(
            line
            for s in stages
            if s.name in jumpvision.OF_ARRAYS
            for line in (
                "@overload",
                f"def {s.name}(experiment: Folder, *, results: PathLike | None = ...) -> {s.output.__name__}: ...",
                "@overload",
                f"def {s.name}{signature(jumpvision.of_arrays(s.name))}: ...",
            )
        ),
    ]
    return "\n".join(lines) + "\n"


def text() -> str:
    """The whole page."""
    stages = results_stages()
    parts = [HEAD, "## Folders and commands", *(of_function(v) for v in jumpvision.VERBS)]
    parts += ["## Stages", *(of_function(s.name) for s in stages)]
    parts += ["## A simulator of your own", *(of_class(getattr(jumpvision, t), t) for t in jumpvision.TYPES)]
    records = dict.fromkeys([*(s.output for s in stages), Diagnosis, Experiment, Campaign, InputError])
    parts += ["## What they return and raise", *(of_class(r, r.__name__) for r in records)]
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    STUB.write_text(stub(), encoding="utf-8")
