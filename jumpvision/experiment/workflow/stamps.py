"""SHA-256 of files, known by their stamps: one table CACHE/stamps.sqlite, a row a file.

A row that is damaged, or a table that cannot be read or written, costs hashing the file again and nothing else.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import sqlite3
import time
import weakref
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from jumpvision.base.schema import InputError
from jumpvision.base.storage import recording_names, settled, sha256, stamp

from . import entries
from .entries import ATTEMPTS

TABLE = "stamps.sqlite"
COLUMNS = "files (path BLOB PRIMARY KEY, known TEXT, seal BLOB)"  # known: stamp and SHA-256; seal: checksum of the row
SAVE_EVERY_S = 60.0  # a run that is stopped while it hashes loses no more than that


@dataclass(frozen=True)
class Recording:
    """Hold the files of a recording: their folder, their names in order, stamp and SHA-256 of each as one text."""

    folder: str
    names: list[str]
    known: list[str]

    def __iter__(self) -> Iterator[tuple[str, str, str]]:
        """(path, SHA-256, stamp) of each file."""
        for name, known in zip(self.names, self.known):
            at, _, digest = known.rpartition(" ")
            yield os.path.join(self.folder, name), digest, at


class Stamps:
    """SHA-256 of files, hashed where their stamp is not that of the table.

    recordings: those that were read, by their path. verify: hash each file, whatever its stamp.
    """

    def __init__(self, cache: Path, *, verify: bool = False):
        self.file, self.verify = cache / TABLE, verify
        self.recordings: dict[Path, Recording] = {}
        self._new: list[tuple[bytes, str, bytes]] = []
        self._connection: sqlite3.Connection | None = None

    def of_recording(self, path: Path) -> str:
        """Return the SHA-256 of a recording: of all its files with their names."""
        folder, names = recording_names(path)
        before = self.recordings.get(path, Recording("", [], []))
        earlier = dict(zip(before.names, before.known))  # in this run
        known, due = [], time.monotonic() + SAVE_EVERY_S
        for name in names:
            known.append(self._known(os.path.join(folder, name), earlier.get(name, "")))
            if time.monotonic() > due:
                self.save()
                due = time.monotonic() + SAVE_EVERY_S
        self.save()
        self.recordings[path] = Recording(str(folder), names, known)
        digests = {name: text.rpartition(" ")[2] for name, text in zip(names, known)}
        return hashlib.sha256(json.dumps(digests).encode()).hexdigest()

    def of_file(self, path: Path) -> str:
        """Return the SHA-256 of a file."""
        return self._known(os.fspath(path)).rpartition(" ")[2]

    def _known(self, file: str, earlier: str = "") -> str:
        """Stamp and SHA-256 of a file: as known earlier in this run, of the table, or hashed now.

        Raises InputError where the file changes all the time.
        """
        at, key = f"{text_of(stamp(file))} ", os.fsencode(os.path.abspath(file))
        if earlier.startswith(at):
            return earlier
        if not self.verify and (row := self._row(key)).startswith(at):
            return row
        for _ in range(ATTEMPTS):
            seen, now = stamp(file), time.time()
            known = f"{text_of(seen)} {sha256(Path(file))}"
            if stamp(file) == seen:
                if settled(seen, now):  # else it may change again unseen
                    self._new.append((key, known, seal(key, known)))
                return known
        raise InputError([f"{file}: changes while it is read; run again when it is whole"])

    def _row(self, key: bytes) -> str:
        """Return the table's stamp and SHA-256 of a file; "" where it has none."""
        with contextlib.suppress(sqlite3.Error):
            if self._connection is None and self.file.exists():
                self._connection = self._open()
            if self._connection is not None:
                found = self._connection.execute("SELECT known, seal FROM files WHERE path = ?", (key,)).fetchone()
                if found and isinstance(found[0], str) and seal(key, found[0]) == found[1]:
                    return found[0]
        return ""

    def _open(self) -> sqlite3.Connection:
        opened = sqlite3.connect(self.file, check_same_thread=False)
        weakref.finalize(self, opened.close)
        opened.execute("PRAGMA synchronous = OFF")  # what a power failure damages is hashed again
        return opened

    def save(self) -> None:
        """Write what was hashed since the last time, in one short transaction."""
        if not self._new:
            return
        try:
            entries.mark(self.file.parent)
            self._connection = self._connection or self._open()
            with self._connection as table:
                table.execute(f"CREATE TABLE IF NOT EXISTS {COLUMNS} WITHOUT ROWID")
                table.executemany("REPLACE INTO files VALUES (?, ?, ?)", self._new)
        except (OSError, sqlite3.OperationalError):  # full, read-only, or others write for long
            pass
        except sqlite3.DatabaseError:  # damaged: made anew by the next run
            remove(self.file.parent)
            self._connection = None
        self._new = []


def remove(cache: Path) -> None:
    """Remove the table of a cache, at the cost of hashing again."""
    with contextlib.suppress(OSError):
        (cache / TABLE).unlink()


def text_of(at: tuple[int, ...]) -> str:
    """A stamp as text."""
    return " ".join(map(str, at))


def seal(key: bytes, known: str) -> bytes:
    """Return the checksum of a row."""
    return hashlib.sha256(key + known.encode()).digest()
