"""The cache of a results folder: how large it is, stage by stage, and making it smaller.

An entry is moved out of sight before it is deleted, so a run beside it finds it whole or computes it again.
"""

from __future__ import annotations

import re
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from jumpvision.base.schema import InputError
from jumpvision.base.storage import remove_aside, sweep_leftovers

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
    if path.is_dir() and (path.name == ".cache" or (path / "hashes").is_dir()):
        return [path]
    found = [c for c in (path / ".cache", *sorted(path.glob("*/.cache"))) if c.is_dir()]
    if not found:
        raise InputError([f"{path}: no cache here; give a results folder (with .cache) or the folder of --cache"])
    return found


def entries_of(cache: Path) -> list[Entry]:
    """Every entry that is there, whole or not; one that vanishes meanwhile is left out."""
    found = []
    for receipt_folder in cache.glob("*/*"):
        if not receipt_folder.is_dir() or receipt_folder.parent.name.startswith("writing-"):
            continue
        try:
            stats = [f.stat() for f in receipt_folder.iterdir()]
            used = max([s.st_mtime for s in stats], default=receipt_folder.stat().st_mtime)
        except FileNotFoundError:
            continue
        size = sum(s.st_size for s in stats)
        found.append(Entry(cache, receipt_folder, receipt_folder.parent.name, size, used))
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
    """Remove what killed runs left, and what was remembered of files that are gone or changed since."""
    sweep_leftovers(cache.parent, cache)
    for memo in (cache / "hashes").glob("*.json"):
        memo.unlink(missing_ok=True)  # made again at the next run, at the cost of hashing


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
