"""Names of experiments and of their recordings: what can be a folder of results on every system, what can be read."""

from __future__ import annotations

import glob
import os
import unicodedata
from pathlib import Path

from jumpvision.base.schema import closest
from jumpvision.base.storage import irregular
from jumpvision.experiment import files

WINDOWS = {"con", "prn", "aux", "nul", *(f"{d}{i}" for d in ("com", "lpt") for i in range(1, 10))}


def name_problem(name: str) -> str:
    """Why results cannot lie in a folder of this name, on every system; "" where they can."""
    if not name.strip(". ") or name != name.rstrip(". ") or any(c in name for c in '/\\:*?"<>|'):
        return "must be usable as a folder name"
    if not name.isprintable():
        return "must have no control characters"
    if name.startswith("."):
        return "must not begin with a dot: the cache and what is hidden lie there"
    if alike(name) in files.OF_A_CAMPAIGN:
        return "is the name of a file among a campaign's results"
    if alike(name).partition(".")[0] in WINDOWS:
        return "cannot be a folder's name on Windows"
    return "must have at most 120 bytes" if len(name.encode("utf-8", "surrogateescape")) > 120 else ""


def alike(name: str) -> str:
    """Equal for names that some disks take for one: upper and lower case, composed and decomposed accents."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


def file_problem(folder: Path, campaign: Path | None, file: str) -> str:
    """Why a recording cannot be used; "" when it can."""
    if not file:
        return "must name a file"
    root = os.path.abspath(campaign or folder)
    target = os.path.abspath(folder / file)
    if not _within(root, target):
        return f"lies outside {root}; move the recording there, or put a link to it there"
    if any(c in file for c in "*?["):
        return "" if glob.glob(str(folder / file)) else f"no file in {folder} matches this pattern"
    path = folder / file
    if not path.exists():
        return f"no such file in {folder}{closest(file, [p.name for p in folder.iterdir()])}"
    if path.is_file() and path.stat().st_size == 0:
        return "is empty (0 bytes)"
    return irregular(path)


def _within(root: str, target: str) -> bool:
    try:
        return os.path.commonpath([root, target]) == root
    except ValueError:  # on another drive
        return False
