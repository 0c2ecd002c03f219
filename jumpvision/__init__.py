"""jumpvision: from films of a jumping robot to tracks, fields, forces and tested models.

In a notebook: `import jumpvision as jv; experiment = jv.open("folder"); jv.track(experiment)` (docs/notebook.md).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from jumpvision.base.compiling import compiled_code_goes

__version__ = "0.1.0"
VERBS = {  # name: the module that has it
    "open": "api",
    "run": "api",
    "diagnose": "api_study",
    "isolable": "api_study",
    "sweep": "api",
    "plan": "api",
    "export": "api_fields",
    "plot": "api_fields",
    "ringdown": "estimate.oscillation",
    "flights": "estimate.free_flight",
    "triangulate": "films.arrays.space",
}
TYPES = {  # what diagnose takes of a user's own simulator
    "Recording": "engine",
    "Study": "engine",
    "Parameter": "engine",
    "Mechanism": "engine",
    "Channel": "engine",
    "Measured": "engine",
    "from_mujoco": "engine",
    "from_fmu": "engine",
    "from_program": "engine",
}
OF_ARRAYS = {  # stages that have a function of arrays, which needs no folder
    "track": "films.arrays.track.track",
    "piv": "films.arrays.piv.piv",
    "flow": "experiment.stages.grains.of_fields.flow",
    "statistics": "experiment.stages.grains.of_fields.statistics",
    "bed": "films.arrays.bed.bed",
    "crater": "films.arrays.crater.crater",
    "intrusion": "experiment.stages.bed.intrusion.of_arrays",
    "simulate": "experiment.stages.simulate.of_arrays",
}


OF_FIELDS = ("piv", "flow", "statistics")  # of these, those of velocity fields


compiled_code_goes(Path(__file__).parent, __version__)


def __getattr__(name: str) -> Any:
    """The notebook's functions, imported when first used: `import jumpvision` itself is light."""
    if name in VERBS or name in TYPES:
        return getattr(import_module(f"jumpvision.{(VERBS | TYPES)[name]}"), name)
    if name in OF_ARRAYS:
        from jumpvision.base.doors import ArraysOrFolder

        if name in OF_FIELDS:
            import_module("jumpvision.api_fields")  # what they give has `.jv`

        globals()[name] = found = ArraysOrFolder(of_arrays(name), partial(_stage, name))
        return found
    if name == "__all__":
        return sorted(("__version__", *VERBS, *TYPES, *_stages()))
    if not name.startswith("_") and name in _stages():
        globals()[name] = found = _stage(name)
        return found
    raise AttributeError(f"module 'jumpvision' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted({*globals(), *VERBS, *TYPES, *_stages()})


def of_arrays(name: str) -> Callable[..., Any]:
    """A stage's function of arrays; KeyError where it has none."""
    module, _, function = OF_ARRAYS[name].rpartition(".")
    found: Callable[..., Any] = getattr(import_module(f"jumpvision.{module}"), function)
    return found


def _stage(name: str) -> Any:
    return import_module("jumpvision.api").stage_function(name)


def _stages() -> tuple[str, ...]:
    names: dict[str, Any] = import_module("jumpvision.experiment.workflow.stage").declared()
    return tuple(names)
