"""An experiment of which nothing has changed since its last run is told from what was noted then, not looked into.

The note holds what became of it, for the folder, parameters and code as they were, and the stamp of every file that
counts: recordings, results, the entries of the cache. Whatever differs is left to the run itself, which hashes.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import os
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import jumpvision
from jumpvision.base.storage import FRESH, NOTES, recording_files, sha256, stamp, write_aside
from jumpvision.experiment.files import PROVENANCE

from .entries import RECEIPT
from .stage import STAGES
from .workspace import Workspace


@functools.cache
def _code() -> str:
    """Names, sizes and dates of the package's own files: with other code, other stages."""
    told = []
    for at, folders, files in os.walk(Path(jumpvision.__file__).parent):
        folders[:] = sorted(f for f in folders if f != "__pycache__")
        for name in sorted(f for f in files if f.endswith(".py")):
            found = os.stat(file := os.path.join(at, name))
            told.append((file, found.st_size, found.st_mtime_ns))
    return hashlib.sha256(repr(told).encode()).hexdigest()


def key_of(*asked: object) -> str:
    """Of what was asked for, by the texts that it prints as."""
    return hashlib.sha256(repr((_code(), *asked)).encode()).hexdigest()


def _place(cache: Path, results: Path) -> Path:
    return cache / NOTES / (hashlib.sha256(str(results.absolute()).encode()).hexdigest()[:24] + ".json")


def _write(place: Path, content: Mapping[str, Any]) -> None:
    """As JSON, its checksum before it: `sealed` takes five times as long."""
    text = json.dumps(content)
    write_aside(place, f'["{_seal(text)}",\n{text}]')


def _read(place: Path) -> Mapping[str, Any]:
    """ValueError for one that is damaged."""
    head, _, text = place.read_text(encoding="utf-8").partition("\n")
    if head != f'["{_seal(text[:-1])}",':
        raise ValueError("its checksum is wrong")
    return dict(json.loads(text[:-1]))


def _seal(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def note(workspace: Workspace, key: str, told: Mapping[str, Any]) -> None:
    """Note what became of an experiment whose results lie there whole."""
    results, at = workspace.results, time.time()  # before the first look at a file
    receipt = results / PROVENANCE
    files = {**workspace.counted(), receipt: (stamp(receipt), sha256(receipt))}
    foreign = {s.output.file for s in STAGES.values()} - workspace.outputs.keys()  # type: ignore[attr-defined]
    content = {
        "key": key,
        "results": str(results.absolute()),
        "recordings": {str(path): [str(f) for f in files] for path, files in workspace.recordings.items()},
        "files": {str(f.absolute()): [*seen, digest] for f, (seen, digest) in files.items()},
        "foreign": sorted(foreign.difference(os.listdir(results))),
        "told": told,
    }
    _write(place := _place(workspace.cache, results), content)
    os.utime(place, (at, at))


def told(cache: Path, results: Path, key: str) -> Mapping[str, Any] | None:
    """What became of an experiment, if all is as it was noted; else None."""
    place, now = _place(cache, results), time.time()
    try:
        found, at = _read(place), place.stat().st_mtime
        if found["key"] != key or found["results"] != str(results.absolute()) or not _same(found, results, at):
            return None
        os.utime(place, (now, now))  # when all was last looked at, and used
        return dict(found["told"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _same(found: Mapping[str, Any], results: Path, at: float) -> bool:
    """Whether no file came, went or changed since a time [s since 1970]: by dates, and what was new then by content;
    entries of the cache by dates alone, as they are checked whenever they are read."""
    if not set(found["foreign"]).isdisjoint(os.listdir(results)):
        return False
    for path, files in found["recordings"].items():
        if [str(f) for f in recording_files(Path(path))] != files:
            return False
    for name, (*noted, digest) in found["files"].items():
        if list(stamp(name)) != noted or (digest and _fresh(noted, at) and sha256(Path(name)) != digest):
            return False
    return True


def _fresh(file: Iterable[Any], at: float) -> bool:
    """Whether a file was changed so shortly before that it could be changed again without another stamp."""
    _, modified, changed, *_ = file
    return bool(at - (modified if os.name == "nt" else changed) / 1e9 <= FRESH)


def notes(cache: Path) -> Iterator[tuple[Path, Mapping[str, Any]]]:
    """The notes of a cache, those that can be read, with their files."""
    for place in (cache / NOTES).glob("*.json"):
        with contextlib.suppress(OSError, ValueError):
            yield place, _read(place)


def last_used(cache: Path) -> dict[Path, float]:
    """When entries of a cache were last told to be as they were [s since 1970], by their folders."""
    out: dict[Path, float] = {}
    for place, noted in notes(cache):
        used = place.stat().st_mtime
        for file in map(Path, noted["files"]):
            if file.name == RECEIPT:
                out[file.parent] = max(out.get(file.parent, 0.0), used)
    return out
