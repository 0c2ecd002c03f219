"""The cache of a results folder: how large it is, stage by stage, and making it smaller.

Nothing is deleted but sealed entries of a marked cache. An entry is moved out of sight first, so a run beside it finds
it whole or computes it again.
"""

from __future__ import annotations

import re
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from jumpvision.base.schema import InputError
from jumpvision.base.storage import remove_aside, sweep_leftovers

from . import stamps
from .entries import RECEIPT, CorruptEntry, marked, receipt_of

SECONDS = {"s": 1.0, "m": 60.0, "h": 3600.0, "d": 86400.0, "w": 7 * 86400.0}
BYTES = {"": 1, "B": 1, "kB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12}


@dataclass(frozen=True)
class Entry:
    """One cached result; used: when it was last read or written [s since 1970]."""

    cache: Path
    folder: Path
    stage: str
    nbytes: int
    used: float


def caches_of(path: Path) -> list[Path]:
    """The cache of a results folder, those of the results folders in it, or `path` itself; InputError for none."""
    if marked(path):
        return [path]
    found = [c for c in (path / ".cache", *sorted(path.glob("*/.cache"))) if marked(c)]
    if not found:
        raise InputError(
            [
                f"{path}: no cache of jumpvision here (a folder with its CACHEDIR.TAG); give a results folder (with "
                ".cache) or the folder of --cache"
            ]
        )
    return found


def entries_of(cache: Path) -> list[Entry]:
    """The whole entries: folders with a sealed receipt of this place and, beside it, only the files it names.

    One that vanishes meanwhile is left out, and so is whatever else lies in the folder.
    """
    found = []
    for folder in cache.glob("*/*"):
        if folder.is_symlink() or folder.parent.is_symlink() or not folder.is_dir():
            continue
        try:
            names = receipt_of(folder)["outputs"].keys() | {RECEIPT}
            files = list(folder.iterdir())
            if any(f.name not in names or f.is_symlink() or not f.is_file() for f in files):
                continue
            sizes, used = [f.stat().st_size for f in files], folder.stat().st_mtime
        except (CorruptEntry, FileNotFoundError, NotADirectoryError):
            continue
        found.append(Entry(cache, folder, folder.parent.name, sum(sizes), used))
    return found


def to_prune(entries: Iterable[Entry], *, older_than: float | None = None, keep: float | None = None) -> list[Entry]:
    """Entries unused for `older_than` [s], and the longest unused of the rest until `keep` [bytes] are left.

    A time of use that lies ahead (a clock that was set back) counts as now.
    """
    now = time.time()
    left: list[Entry] = []
    out: list[Entry] = []
    for e in sorted(entries, key=lambda e: -e.used):
        (out if older_than is not None and now - e.used > older_than else left).append(e)
    if keep is not None:
        total = 0.0
        for e in left:  # the last used first
            total += e.nbytes
            if total > keep:
                out.append(e)
    return out


def prune(entries: Iterable[Entry]) -> int:
    """Delete entries; bytes freed."""
    freed = 0
    for e in entries:
        remove_aside(e.folder, e.cache)
        freed += e.nbytes
    return freed


def tidy(cache: Path) -> None:
    """Remove what killed runs left, and the table of stamps, of which many may be of files that are gone."""
    sweep_leftovers(cache.parent, cache)
    stamps.remove(cache)


def table(entries: Iterable[Entry], removed: Iterable[Entry]) -> list[dict[str, object]]:
    """Rows stage, entries, bytes, removed entries and bytes; the last row is the sum."""
    gone = {e.folder for e in removed}
    rows: dict[str, dict[str, object]] = {}
    for e in sorted(entries, key=lambda e: e.stage):
        for name in (e.stage, "all"):
            row = rows.setdefault(name, {"stage": name, "entries": 0, "bytes": 0, "removed": 0, "removed_bytes": 0})
            count, size = ("removed", "removed_bytes") if e.folder in gone else ("entries", "bytes")
            row[count] += 1  # type: ignore[operator]
            row[size] += e.nbytes  # type: ignore[operator]
    return [*(r for n, r in rows.items() if n != "all"), *([rows["all"]] if rows else [])]


def quantity(text: str, units: Mapping[str, float], option: str) -> float:
    """`30d` or `5GB` as a number in the base unit; InputError otherwise."""
    match = re.fullmatch(r"([0-9]+(?:\.[0-9]+)?)\s*([A-Za-z]*)", text.strip())
    known = {u.lower(): factor for u, factor in units.items()}
    if match is None or match[2].lower() not in known:
        allowed = ", ".join(u for u in units if u)
        raise InputError(
            [f"{option} {text}: must be a number with a unit ({allowed}), e.g. 30 {allowed.split(', ')[-1]}"]
        )
    return float(match[1]) * known[match[2].lower()]
