"""An experiment of which nothing has changed since its last run is told from what was noted then, not looked into.

The note holds what became of it, for the folder, parameters and code as they were, and the stamp of every file that
counts: recordings, results, the entries of the cache. Whatever differs is left to the run itself, which hashes.
"""

from __future__ import annotations

import functools
import hashlib
import os
import time
from collections.abc import Iterable
from itertools import chain
from pathlib import Path

import jumpvision
from jumpvision.base.schema import Toml
from jumpvision.base.storage import (
    NOTES,
    Stamp,
    memories,
    memory,
    recall,
    recording_names,
    remember,
    settled,
    sha256,
    stamp,
)
from jumpvision.experiment.files import PROVENANCE

from .entries import RECEIPT
from .hashes import Hashed
from .stage import STAGES
from .workspace import Workspace


@functools.cache
def _code() -> str:
    """Names, sizes and dates of the package's own files: with other code, other stages."""
    stamps = []
    for at, folders, files in os.walk(Path(jumpvision.__file__).parent):
        folders[:] = sorted(f for f in folders if f != "__pycache__")
        for name in sorted(f for f in files if f.endswith(".py")):
            found = os.stat(file := os.path.join(at, name))
            stamps.append((file, found.st_size, found.st_mtime_ns))
    return hashlib.sha256(repr(stamps).encode()).hexdigest()


def key_of(*asked: object) -> str:
    """Of what was asked for, by the texts that it prints as."""
    return hashlib.sha256(repr((_code(), *asked)).encode()).hexdigest()


def note(workspace: Workspace, key: str, outcome: Toml) -> None:
    """Note what became of an experiment whose results lie there whole."""
    results, at = workspace.results, time.time()  # before the first look at a file
    receipt = results / PROVENANCE
    files = chain(workspace.counted(), [(receipt, stamp(receipt), sha256(receipt))])
    foreign = {s.output.file for s in STAGES.values()} - workspace.outputs.keys()
    content = {
        "key": key,
        "recordings": {str(path): _files_noted(files, at) for path, files in workspace.recordings.items()},
        "files": {str(f.absolute()): (*seen, digest) for f, seen, digest in files},
        "foreign": sorted(foreign.difference(os.listdir(results))),
        "told": outcome,
    }
    remember(workspace.cache, NOTES, results, content)
    os.utime(memory(workspace.cache, NOTES, results), (at, at))


def _files_noted(files: Hashed, at: float) -> tuple[str, dict[str, str]]:
    """Of the files of a recording: their `_digest`, and the SHA-256 of those whose stamp may miss a change."""
    late = {f: digest for f, digest, seen in files if not settled(seen, at)}
    return _digest((f, seen) for f, _, seen in files), late


def _digest(files: Iterable[tuple[str, Stamp]]) -> str:
    """Digest of names and stamps: a film of pictures has 100,000."""
    found = hashlib.sha256()
    for each in files:
        found.update(repr(each).encode())
    return found.hexdigest()


def noted(cache: Path, results: Path, key: str) -> Toml | None:
    """What became of an experiment, if all is as it was noted; else None."""
    place, now = memory(cache, NOTES, results), time.time()
    try:
        found, at = recall(cache, NOTES, results), place.stat().st_mtime
        if found["key"] != key or not _same(found, results, at):
            return None
        os.utime(place, (now, now))  # when all was last looked at, and used
        return dict(found["told"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _same(found: Toml, results: Path, at: float) -> bool:
    """Whether no file came, went or changed since a time [s since 1970]: by dates, and what was new then by content;
    entries of the cache by dates alone, as they are checked whenever they are read."""
    if not set(found["foreign"]).isdisjoint(os.listdir(results)):
        return False
    for path, (noted, late) in found["recordings"].items():
        folder, names = recording_names(Path(path))
        if _digest((f, stamp(f)) for f in (os.path.join(folder, name) for name in names)) != noted:
            return False
        if any(not settled(stamp(f), at) and sha256(Path(f)) != digest for f, digest in late.items()):
            return False
    for name, (*seen, digest) in found["files"].items():
        if list(stamp(name)) != seen or (digest and not settled(seen, at) and sha256(Path(name)) != digest):
            return False
    return True


def last_used(cache: Path) -> dict[Path, float]:
    """When entries of a cache were last told to be as they were [s since 1970], by their folders."""
    out: dict[Path, float] = {}
    for place, noted in memories(cache, NOTES):
        used = place.stat().st_mtime
        for file in map(Path, noted["files"]):
            if file.name == RECEIPT:
                out[file.parent] = max(out.get(file.parent, 0.0), used)
    return out
