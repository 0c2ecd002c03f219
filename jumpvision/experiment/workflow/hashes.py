"""SHA-256 of recordings, remembered in the cache while the stamps of their files stay.

A recording is a file with its headers, or a folder of up to 100,000 pictures: what is known of its files is one file
of the cache, and in memory a list of names and one row of bytes.
"""

from __future__ import annotations

import base64
import bisect
import functools
import hashlib
import json
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from jumpvision.base.schema import InputError
from jumpvision.base.storage import HASHES, Stamp, recall, recording_names, remember, settled, sha256, stamp

from . import entries
from .entries import ATTEMPTS

NUMBERS = 4  # of a stamp
WIDTH = 17  # bytes of one of them: what identifies a file on Windows has 128 bits, dates have a sign
EACH = 60.0  # s between two notes of what was hashed so far
SIZE = 32 + NUMBERS * WIDTH  # bytes of SHA-256 and stamp


@dataclass(frozen=True)
class Hashed:
    """The files of a recording: their folder, their names in order; known: SHA-256 and stamp of each (`packed`), one
    after the other."""

    folder: str
    names: list[str]
    known: bytes

    def __len__(self) -> int:
        return len(self.names)

    def __iter__(self) -> Iterator[tuple[str, str, Stamp]]:
        """(path, SHA-256, stamp) of each."""
        for k, name in enumerate(self.names):
            yield (os.path.join(self.folder, name), *unpacked(self.known[k * SIZE : (k + 1) * SIZE]))

    @functools.cached_property
    def digest(self) -> str:
        """SHA-256 of all, as of the JSON of their digests by name."""
        whole = hashlib.sha256()
        for k, (file, digest, _) in enumerate(self):  # one at a time
            each = json.dumps({os.path.basename(file): digest})
            whole.update(((", " if k else "{") + each[1:-1]).encode())
        whole.update(b"}" if self.names else b"{}")
        return whole.hexdigest()

    def of(self, name: str) -> bytes:
        """What is known of a file, b"" for nothing."""
        k = bisect.bisect_left(self.names, name)
        return self.known[k * SIZE : (k + 1) * SIZE] if self.names[k : k + 1] == [name] else b""


NOTHING = Hashed("", [], b"")


class Hashes:
    """What is known of the recordings that an experiment has read, and of other files. verify: each is hashed again in
    place of trusting its stamp."""

    def __init__(self, cache: Path, *, verify: bool = False):
        self.cache, self.verify = cache, verify
        self.read: dict[Path, Hashed] = {}

    def of_recording(self, path: Path) -> str:
        """SHA-256 of a recording: of all its files with their names."""
        before = self.read.get(path, NOTHING)
        folder, names = recording_names(path)
        found = Hashed(str(folder), names, self._all(folder, names, path, before))
        if found != before:
            self.read[path] = found
        return self.read[path].digest

    def of_file(self, path: Path) -> str:
        """SHA-256 of a file."""
        return unpacked(self._all(path.parent, [path.name], path, NOTHING))[0]

    def _all(self, folder: Path, names: list[str], about: Path, before: Hashed) -> bytes:
        """What is known of these files, packed; what is new is remembered. before: what this run has found earlier."""
        out, new, remembered, due = bytearray(), False, None, time.monotonic() + EACH
        for k, name in enumerate(names):
            at = stamp(file := os.path.join(folder, name))
            seen, known = _bytes_of(at), before.of(name)
            if known[32:] != seen:
                if remembered is None:
                    remembered = NOTHING if self.verify else self._remembered(about)
                known = remembered.of(name)
            if known[32:] != seen:
                known, new = _hashed_now(file, at), True
            out += known
            if new and time.monotonic() > due:  # a run that is stopped loses no more than that
                self._remember(about, Hashed(str(folder), names[: k + 1], bytes(out)))
                due = time.monotonic() + EACH
        if new:
            self._remember(about, Hashed(str(folder), names, bytes(out)))
        return bytes(out)

    def _remembered(self, about: Path) -> Hashed:
        """Of the files of a recording, from the cache."""
        try:
            found = recall(self.cache, HASHES, about)
            names, known = found["names"].split("/") if found["names"] else [], base64.b64decode(found["known"])
            return Hashed("", names, known) if len(known) == SIZE * len(names) else NOTHING
        except (OSError, ValueError, KeyError, AttributeError, TypeError):
            return NOTHING

    def _remember(self, about: Path, found: Hashed) -> None:
        """In the cache, but for files that were changed just now, which may change again unseen."""
        now = time.time()
        kept = [k for k, (_, _, at) in enumerate(found) if settled(at, now)]
        if kept:
            names = "/".join(found.names[k] for k in kept)  # what no name contains
            known = b"".join(found.known[k * SIZE : (k + 1) * SIZE] for k in kept)
            entries.mark(self.cache)
            remember(self.cache, HASHES, about, {"names": names, "known": base64.b64encode(known).decode()})


def _hashed_now(file: str, at: Stamp) -> bytes:
    """A file that has this stamp, packed. InputError where it changes all the time."""
    for _ in range(ATTEMPTS):
        digest, before = sha256(Path(file)), at
        at = stamp(file)
        if at == before:
            return packed(digest, at)
    raise InputError([f"{file}: changes while it is read; run again when it is whole"])


def packed(digest: str, at: Stamp) -> bytes:
    """SHA-256 and stamp of a file as bytes, which take a third of the memory of text and numbers."""
    return bytes.fromhex(digest) + _bytes_of(at)


def _bytes_of(at: Stamp) -> bytes:
    return b"".join([n.to_bytes(WIDTH, "little", signed=True) for n in at])


def unpacked(known: bytes) -> tuple[str, Stamp]:
    """What was `packed`."""
    numbers = range(32, SIZE, WIDTH)
    return known[:32].hex(), tuple(int.from_bytes(known[k : k + WIDTH], "little", signed=True) for k in numbers)
