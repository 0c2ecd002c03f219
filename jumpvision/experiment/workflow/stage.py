"""A stage is its typed signature: inputs by type, parameters `p`, output by type, a version, and help in its docstring.

Everything else derives from it: `jumpvision NAME`, `jv.NAME`, the names a pipeline may list, the order of a run, the
table in docs/keys.md.
"""

from __future__ import annotations

import ast
import functools
import importlib
import inspect
import pkgutil
import types
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Union, get_args, get_origin, get_type_hints

if TYPE_CHECKING:
    from jumpvision.base.record import Record

from jumpvision.base.schema import FileSection, MissingKey, WarningRecord
from jumpvision.base.schema import StageWarning as StageWarning

FOLDER = Path(__file__).parents[1] / "stages"  # every module below it may hold stages
PACKAGE = "jumpvision.experiment.stages"


@dataclass(frozen=True)
class Input:
    """One argument of a stage: a section of the experiment, a record, or the experiment itself."""

    name: str
    type: type
    optional: bool


class Said(list[WarningRecord]):
    """An input: what all other stages that make results had to say of the experiment, each warning once."""

    file = "what was said"


class Inputs:
    """Base of a dataclass whose fields are inputs of a stage that takes many; each is declared as an argument is."""


@dataclass(frozen=True)
class Stage:
    """A registered stage; calling it calls the function."""

    name: str
    function: Callable[..., Record | None]
    version: int
    inputs: tuple[Input, ...]
    output: type[Record]
    params: type | None
    any_of: tuple[str, ...]
    picture: bool = False  # a figure drawn from records, not a result that others need
    gathered: Mapping[str, type[Inputs]] = field(default_factory=dict, hash=False)  # arguments of several inputs each
    needs: Callable[..., list[str]] | None = None  # of inputs by their names: the keys that they lack, in words

    def __call__(self, *args: object, **kwargs: object) -> Any:
        return self.function(*args, **kwargs)

    def called_with(self, values: Mapping[str, object]) -> Record | None:
        """What the function makes of its inputs and `p`, given one by one by their names. MissingKey: see `lacks`."""
        if problems := self.lacks(values):
            raise MissingKey(problems)
        left = dict(values)
        together = {
            name: kind(**{n: left.pop(n) for n in get_type_hints(kind)}) for name, kind in self.gathered.items()
        }
        return self.function(**left, **together)

    def lacks(self, values: Mapping[str, object]) -> list[str]:
        """Keys that sections among the inputs, by name, must give and do not, each with its remedy: all at once, before
        anything is computed."""
        if self.needs is None:
            return []
        return self.needs(**{name: values[name] for name in inspect.signature(self.needs).parameters})

    @property
    def help(self) -> str:
        """What it makes, in a line, with the file."""
        return f"{first_paragraph(self.function.__doc__).removesuffix('.')} ({self.output.file})."


STAGES: dict[type, Stage] = {}  # by output type


def stage(
    *,
    version: int,
    any_of: tuple[str, ...] = (),
    picture: bool = False,
    needs: Callable[..., list[str]] | None = None,
) -> Callable[[Callable[..., Record | None]], Stage]:
    """Register a function as a stage. any_of: names of inputs of which at least one must be there. needs: takes inputs
    by their names, sections alone, and gives the keys that they lack (`base.schema.lacking`); `run` and `check` ask it.

    The first paragraph of its docstring is its help, for the command line, notebooks and the docs.
    """

    def register(function: Callable[..., Record | None]) -> Stage:
        hints = get_type_hints(function)
        arguments = {n: hints[n] for n in inspect.signature(function).parameters if n != "p"}
        gathered = {n: h for n, h in arguments.items() if isinstance(h, type) and issubclass(h, Inputs)}
        inputs = []
        for name, hint in arguments.items():
            each = get_type_hints(hint) if name in gathered else {name: hint}
            inputs += [_input(n, h) for n, h in each.items()]
        made = Stage(
            function.__name__,
            function,
            version,
            tuple(inputs),
            hints["return"],
            hints.get("p"),
            any_of,
            picture,
            gathered,
            needs,
        )
        if needs and (unknown := set(inspect.signature(needs).parameters) - {i.name for i in inputs}):
            raise TypeError(f"stage {made.name}: needs asks for {unknown}, which are no inputs of it")
        if made.output in STAGES and STAGES[made.output].name != made.name:
            raise TypeError(f"stages {STAGES[made.output].name} and {made.name} both make {made.output.__name__}")
        if made.params and made.params.stage != made.name:  # type: ignore[attr-defined]
            raise TypeError(f"{made.params.__name__}: stage = {made.params.stage!r}: must be {made.name!r}")  # type: ignore[attr-defined]
        STAGES[made.output] = made
        return made

    return register


def _input(name: str, hint: Any) -> Input:
    optional = get_origin(hint) in (Union, types.UnionType)
    return Input(name, next(t for t in get_args(hint) if t is not type(None)) if optional else hint, optional)


def results_stages() -> list[Stage]:
    """All stages that make results, each after those whose records it reads; of several by module. Imports them."""
    import_all(PACKAGE)
    ours = [s for s in STAGES.values() if s.function.__module__.startswith(PACKAGE + ".")]
    return in_order(sorted(ours, key=lambda s: s.function.__module__))


def modules() -> list[str]:
    """Those that hold stages and what they call, by name."""
    inside = (f.relative_to(FOLDER).with_suffix("").parts for f in sorted(FOLDER.rglob("*.py")))
    return [".".join((PACKAGE, *parts)).removesuffix(".__init__") for parts in inside]


@functools.cache
def import_all(package: str) -> None:
    """Import every module below a package, for what they register."""
    for module in pkgutil.walk_packages(importlib.import_module(package).__path__, package + "."):
        importlib.import_module(module.name)


def in_order(stages: Iterable[Stage]) -> list[Stage]:
    """Each after those of them whose records it reads, else as given; last those that read what the others say."""
    waiting = sorted(stages, key=lambda s: any(i.type is Said for i in s.inputs))
    out: list[Stage] = []
    while waiting:
        missing = {s.output for s in waiting}
        ready = next((s for s in waiting if not any(i.type in missing for i in s.inputs)), None)
        if ready is None:
            raise TypeError("stages that read each other's records: " + ", ".join(s.name for s in waiting))
        waiting.remove(ready)
        out.append(ready)
    return out


def stage_named(name: str) -> Stage:
    """The stage of this name. KeyError where there is none."""
    return {s.name: s for s in results_stages()}[name]


class Declared(NamedTuple):
    """A stage as its source declares it."""

    name: str
    help: str


@functools.cache
def recording_of(name: str) -> str:
    """The section of the recording that a stage reads itself; "" where it reads none."""
    kinds = (i.type for i in stage_named(name).inputs)
    return next((k.name for k in kinds if issubclass(k, FileSection)), "")


def declared() -> dict[str, Declared]:
    """The stages by name, read from their source: importing them takes seconds, `jumpvision --help` must not."""
    texts = (file.read_text(encoding="utf-8") for file in sorted(FOLDER.rglob("*.py")))
    return {d.name: d for text in texts if "@stage" in text for d in _stages_in(text)}


def _stages_in(text: str) -> Iterator[Declared]:
    for node in ast.parse(text).body:
        if isinstance(node, ast.FunctionDef) and any(_is_stage(d) for d in node.decorator_list):
            yield Declared(node.name, first_paragraph(ast.get_docstring(node)))


def _is_stage(decorator: ast.expr) -> bool:
    called = decorator.func if isinstance(decorator, ast.Call) else decorator
    return isinstance(called, ast.Name) and called.id == stage.__name__


def first_paragraph(text: str | None) -> str:
    """On one line."""
    return " ".join(inspect.cleandoc(text or "").split("\n\n")[0].split())
