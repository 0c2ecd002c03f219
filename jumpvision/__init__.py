"""jumpvision: from films of a jumping robot to tracks, fields, forces and tested models.

In a notebook: `import jumpvision as jv; experiment = jv.open("folder"); jv.track(experiment)` (docs/notebook.md).
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

__version__ = "0.1.0"
VERBS = {  # name: the module that has it
    "open": "api",
    "run": "api",
    "diagnose": "api_study",
    "sweep": "api",
    "plan": "api",
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
}
OF_ARRAYS = {  # stages that have a function of arrays, which needs no folder
    "track": "films.arrays.track.track",
    "piv": "films.arrays.piv.piv",
    "paths": "films.arrays.paths.paths",
    "bed": "films.arrays.bed.bed",
    "crater": "films.arrays.crater.crater",
    "intrusion": "experiment.stages.bed.intrusion.of_arrays",
    "simulate": "experiment.stages.simulate.of_arrays",
}


def _compiled_code_goes() -> None:
    """Compiled functions are kept beside the package or under the home folder; where neither can be written (a package
    for all users, a container without a home) in a folder of the user's own among the temporary files."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path(os.path.expanduser("~")) / ".cache")
    there = next((p for p in (home, *home.parents) if p.is_dir()), home)
    if "NUMBA_CACHE_DIR" in os.environ or _writable(Path(__file__).parent) or _writable(there):
        return
    user = os.getuid() if hasattr(os, "getuid") else 0
    own = Path(tempfile.gettempdir()) / f"jumpvision-{user}"
    try:
        own.mkdir(mode=0o700, exist_ok=True)
        if hasattr(os, "getuid") and (own.is_symlink() or own.stat().st_uid != user or own.stat().st_mode & 0o022):
            raise PermissionError  # somebody else's: code that is loaded from there would be theirs
    except OSError:
        own = Path(tempfile.mkdtemp(prefix="jumpvision-"))
    os.environ["NUMBA_CACHE_DIR"] = str(own)


def _writable(folder: Path) -> bool:
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


_compiled_code_goes()


def __getattr__(name: str) -> Any:
    """The notebook's functions, imported when first used: `import jumpvision` itself is light."""
    if name in VERBS or name in TYPES:
        return getattr(import_module(f"jumpvision.{(VERBS | TYPES)[name]}"), name)
    if name in OF_ARRAYS:
        from jumpvision.base.doors import ArraysOrFolder

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
