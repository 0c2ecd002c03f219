"""A stage is its typed signature: inputs by type, parameters `p`, output by type, a version."""

from __future__ import annotations

import inspect
import types
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Union, get_args, get_origin, get_type_hints


class StageWarning(UserWarning):
    """Something a user should know about a result that stands all the same; kept with the result."""


@dataclass(frozen=True)
class Input:
    """One argument of a stage: a section of the experiment, a record, or the experiment itself."""

    name: str
    type: type
    optional: bool


@dataclass(frozen=True)
class Stage:
    """A registered stage; calling it calls the function."""

    name: str
    function: Callable[..., Any]
    version: int
    inputs: tuple[Input, ...]
    output: type
    params: type | None
    any_of: tuple[str, ...]
    picture: bool = False  # a figure drawn from records, not a result that others need

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return self.function(*args, **kwargs)


STAGES: dict[type, Stage] = {}  # by output type


def stage(
    *, version: int, any_of: tuple[str, ...] = (), picture: bool = False
) -> Callable[[Callable[..., Any]], Stage]:
    """Register a function as a stage. any_of: argument names of which at least one must be there."""

    def register(function: Callable[..., Any]) -> Stage:
        hints = get_type_hints(function)
        inputs = []
        for name in inspect.signature(function).parameters:
            if name == "p":
                continue
            hint = hints[name]
            optional = get_origin(hint) in (Union, types.UnionType)
            plain = next(t for t in get_args(hint) if t is not type(None)) if optional else hint
            inputs.append(Input(name, plain, optional))
        made = Stage(
            function.__name__, function, version, tuple(inputs), hints["return"], hints.get("p"), any_of, picture
        )
        if made.output in STAGES and STAGES[made.output].name != made.name:
            raise TypeError(f"stages {STAGES[made.output].name} and {made.name} both make {made.output.__name__}")
        STAGES[made.output] = made
        return made

    return register
