"""jumpvision: from films of a jumping robot to tracks, fields, forces and tested models.

In a notebook: `import jumpvision as jv; experiment = jv.open("folder"); jv.track(experiment)` (docs/notebook.md).
"""

from __future__ import annotations

import os
import tempfile
from importlib import import_module
from pathlib import Path
from typing import Any

__version__ = "0.1.0"
VERBS = ("open", "run", "diagnose", "sweep", "plan", "ringdown", "flights", "triangulate")
TYPES = ("Recording", "Study", "Parameter", "Mechanism", "Channel")  # what diagnose takes of a user's own simulator


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
