"""jumpvision: from films of a jumping robot to tracks, fields, forces and tested models.

In a notebook: `import jumpvision as jv; experiment = jv.open("folder"); jv.track(experiment)` (docs/notebook.md).
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .api import (
        bed,
        column,
        crater,
        diagnose,
        fit,
        flow,
        geometry,
        intrusion,
        open,
        piv,
        plan,
        rod,
        run,
        simulate,
        spring,
        summary,
        sweep,
        track,
    )

__version__ = "0.1.0"
__all__ = [
    "__version__",
    "bed",
    "column",
    "crater",
    "diagnose",
    "fit",
    "flow",
    "geometry",
    "intrusion",
    "open",
    "piv",
    "plan",
    "rod",
    "run",
    "simulate",
    "spring",
    "summary",
    "sweep",
    "track",
]


class _Room(ModuleType):
    """A folder of the package that has the name of a function of the notebook: called, it is that function."""

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return getattr(import_module("jumpvision.api"), self.__name__.rpartition(".")[2])(*args, **kwargs)


class _Package(ModuleType):
    def __setattr__(self, name: str, value: Any) -> None:
        if name in ("fit", "sweep") and isinstance(value, ModuleType):  # Python sets a folder as it is imported
            value.__class__ = _Room
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str) -> Any:
    """The notebook's functions, imported when first used: `import jumpvision` itself is light."""
    if name in ("fit", "sweep"):
        return import_module(f"jumpvision.{name}")
    if name in __all__:
        return getattr(import_module("jumpvision.api"), name)
    raise AttributeError(f"module 'jumpvision' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
