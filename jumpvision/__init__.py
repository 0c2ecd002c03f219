"""jumpvision: from films of a jumping robot to tracks, fields, forces and tested models.

In a notebook: `import jumpvision as jv; experiment = jv.open("folder"); jv.track(experiment)` (docs/notebook.md).
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.1.0"
VERBS = ("open", "run", "diagnose", "sweep", "plan")
TYPES = ("Recording", "Study", "Parameter", "Mechanism", "Channel")  # what diagnose takes of a user's own simulator


def __getattr__(name: str) -> Any:
    """The notebook's functions, imported when first used: `import jumpvision` itself is light."""
    if name in VERBS + TYPES:
        return getattr(import_module("jumpvision.api"), name)
    if name == "__all__":
        return sorted(("__version__", *VERBS, *TYPES, *_stages()))
    if not name.startswith("_") and name in _stages():
        globals()[name] = found = import_module("jumpvision.api").stage_function(name)
        return found
    raise AttributeError(f"module 'jumpvision' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted({*globals(), *VERBS, *TYPES, *_stages()})


def _stages() -> tuple[str, ...]:
    names: dict[str, Any] = import_module("jumpvision.workflow.stage").declared()
    return tuple(names)
