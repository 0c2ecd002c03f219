"""The application and the options of every command that works on a folder."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from jumpvision import __version__

from .codes import BAD_CALL as BAD_CALL
from .codes import DONE as DONE
from .codes import FAILED as FAILED

ABOUT = (
    "From films of a jumping robot on hard ground and sand to tracks, fields, forces and tested models.",
    "Start with: jumpvision run data_samples/loose_sand --results results/loose_sand",
)
app = App(name="jumpvision", help="\n\n".join(ABOUT), version=__version__, suppress_keyboard_interrupt=False)


def option(help: str, group: str | None = None, negative: str | None = None) -> Parameter:
    """What help says of an option, and under which head; negative: "" for one that has no --no- of its own."""
    if group is None:  # a group that is given as None hides the option
        return Parameter(help=help)
    return Parameter(help=help, group=group, negative=negative)


@Parameter(name="*", show_default=False)
@dataclass(frozen=True)
class Options:
    """Options of every command that works on a folder."""

    results: Annotated[
        Path | None,
        Parameter(help="Folder for results; default: results/NAME beside PATH, of a sample beside data_samples."),
    ] = None
    cache: Annotated[Path | None, Parameter(help="Folder for intermediate results; default: RESULTS/.cache.")] = None
    set: Annotated[
        tuple[str, ...],
        Parameter(name="--set", negative="", help="Override a value: stage.key=value or section.key=value."),
    ] = ()
    model: Annotated[
        Path | None, Parameter(help="model.toml, e.g. of diagnose: its [model] and [robot] over the folder's.")
    ] = None
    json: Annotated[bool, Parameter(negative="", help="Machine-readable result on stdout.")] = False
    table: Annotated[bool, Parameter(negative="", help="Print every row, not only what stands out.")] = False
    workers: Annotated[int | None, Parameter(help="Processes for a campaign; default: the cores.")] = None
    verify: Annotated[bool, Parameter(negative="", help="Hash every input again, whatever its date says.")] = False
    fresh_if_versions_differ: Annotated[
        bool, Parameter(negative="", help="Compute again what other versions of jumpvision or its packages have made.")
    ] = False
    pictures: Annotated[bool, Parameter(help="Draw figures beside the results.")] = True
    debug: Annotated[bool, Parameter(negative="", help="Show the traceback of an unexpected error.")] = False


OPTIONS = Options()


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
