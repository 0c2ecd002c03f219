"""Entries of a cache, of stages and of a diagnosis: folders with a sealed receipt, whole or not there.

CACHE/STAGE/KEY, KEY the hash of all that the content depends on. An entry is written aside, made durable and renamed;
whoever reads it compares the receipt's key, checks every file, and looks again when it is done.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import platform
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypedDict

from jumpvision import __version__
from jumpvision.base.schema import WarningRecord
from jumpvision.base.storage import aside_folder, remove_aside, sealed, sha256, stamp, sync, unsealed, write_aside

RECEIPT = "receipt.json"
TAG = "CACHEDIR.TAG"  # https://bford.info/cachedir: programs for backups leave such a folder out
SIGNATURE = "Signature: 8a477f597d28d172789f06886806bc55\n# A cache of jumpvision; `jumpvision cache` prunes it.\n"
ATTEMPTS = 3  # at an entry that others make, mend or remove meanwhile


class Receipt(TypedDict):
    """What lies beside the files of an entry: who made it, of what, with what, and what there was to say."""

    stage: str
    version: int
    key: str
    versions: dict[str, str]  # of the packages that made it
    warnings: list[WarningRecord]
    not_applicable: list[str]  # why there is no record; empty where there is one
    outputs: dict[str, str]  # file: SHA-256


class CorruptEntry(Exception):
    """An entry is not what its receipt says, or not the one that was asked for."""


@functools.cache  # reading the packages' metadata takes longer than most stages
def versions() -> dict[str, str]:
    """Of jumpvision, Python and the packages that results depend on, here and now."""
    from importlib.metadata import PackageNotFoundError, version

    def of(package: str) -> str:
        try:
            return version(package)
        except PackageNotFoundError:  # conda has OpenCV by another name
            return "unknown"

    packages = ("numpy", "scipy", "pandas", "xarray", "numba", "opencv-python-headless", "scikit-image", "av")
    return {"jumpvision": __version__, "python": platform.python_version(), **{p: of(p) for p in packages}}


def mark(cache: Path) -> None:
    """Say that a folder is a cache; only in such a folder is anything ever deleted."""
    if not marked(cache):
        write_aside(cache / TAG, SIGNATURE)


def marked(folder: Path) -> bool:
    """Whether the folder is a cache of jumpvision."""
    try:
        with (folder / TAG).open(encoding="utf-8", newline="") as file:
            return file.read(len(SIGNATURE)) == SIGNATURE
    except (OSError, ValueError):
        return False


def place(cache: Path, stage: str, key: str) -> Path:
    """Where the entry of a key lies."""
    return cache / stage / key[:24]


def receipt_of(entry: Path) -> Receipt:
    """The sealed receipt of an entry, which names the folder that it lies in; CorruptEntry, FileNotFoundError."""
    try:
        found: Receipt = unsealed((entry / RECEIPT).read_text(encoding="utf-8"))
        named = (found["stage"], found["key"][:24])
        lacking = Receipt.__annotations__.keys() - found.keys()
    except FileNotFoundError:
        raise
    except (ValueError, KeyError, TypeError, OSError) as e:
        raise CorruptEntry(f"{entry}: unreadable in the cache ({type(e).__name__})") from e
    if named != (entry.parent.name, entry.name):
        raise CorruptEntry(f"{entry}: the cache holds the entry of another key there ({'/'.join(named)})")
    if lacking or not all(isinstance(w, dict) for w in found["warnings"]):
        raise CorruptEntry(f"{entry}: its receipt is of another version of jumpvision")
    return found


@contextlib.contextmanager
def opened(cache: Path, stage: str, key: str) -> Iterator[Receipt]:
    """The receipt of a whole entry of this key: files checked before the block that reads them, and looked at after it.

    Raises FileNotFoundError where there is none, CorruptEntry where it is damaged or not the one of this key.
    """
    entry = place(cache, stage, key)
    receipt = receipt_of(entry)
    if receipt["key"] != key:
        raise CorruptEntry(f"{entry}: the cache holds the entry of another key there ({receipt['key']})")
    before = {name: stamp(entry / name) for name in receipt["outputs"]}
    for name, digest in receipt["outputs"].items():
        if sha256(entry / name) != digest:
            raise CorruptEntry(f"{entry / name}: damaged in the cache")
    with contextlib.suppress(OSError):  # when it was last used, for pruning by age; notes stamp the files in it
        os.utime(entry)
    try:
        yield receipt
    except FileNotFoundError:
        raise
    except (ValueError, KeyError, OSError) as e:
        raise CorruptEntry(f"{entry}: unreadable in the cache ({type(e).__name__})") from e
    if any(stamp(entry / name) != at for name, at in before.items()):
        raise CorruptEntry(f"{entry}: changed while it was read from the cache")


def keep(
    cache: Path,
    stage: str,
    key: str,
    fill: Callable[[Path], None],
    *,
    version: int,
    warnings: list[WarningRecord],
    not_applicable: list[str],
    good: Callable[[], bool],
) -> Receipt:
    """Make an entry of the files that `fill` writes into the folder it is given; its receipt.

    good: whether an entry that is there already will do; any other is replaced.
    """
    mark(cache)
    entry, aside = place(cache, stage, key), aside_folder(cache)
    try:
        fill(aside)
        receipt: Receipt = {
            "stage": stage,
            "version": version,
            "key": key,
            "versions": versions(),
            "warnings": warnings,
            "not_applicable": not_applicable,
            "outputs": {f.name: sha256(f) for f in sorted(aside.iterdir())},
        }
        (aside / RECEIPT).write_text(sealed(receipt), encoding="utf-8", newline="\n")
        sync(aside)
        entry.parent.mkdir(parents=True, exist_ok=True)
        for attempt in range(ATTEMPTS):
            try:
                os.rename(aside, entry)
                return receipt
            except OSError:  # there already: made by a faster run, damaged, or of other versions
                if good():
                    return receipt_of(entry)
                if attempt == ATTEMPTS - 1 or not entry.exists():
                    raise
                remove_aside(entry, cache)
    finally:
        shutil.rmtree(aside, ignore_errors=True)
    raise AssertionError("unreachable")


PARTS = "parts"  # stage by which parts of a long result lie in the cache


class Parts:
    """Finished parts of one result, entries of their own until the whole is kept (a `base.progress.Keeper`).

    key: of the result; fresh: parts that other versions made are none; check: raises where the inputs are not any more
    what the key says, before each part is kept.
    """

    def __init__(
        self, cache: Path, stage: str, key: str, version: int, *, check: Callable[[], None], fresh: bool = False
    ):
        self.cache, self.whole, self.version, self.check, self.fresh = cache, f"{stage} {key}", version, check, fresh
        self.names: set[str] = set()

    def _key(self, name: str) -> str:
        return hashlib.sha256(f"{self.whole} {name}".encode()).hexdigest()

    def _receipt(self, name: str) -> Receipt:
        receipt = receipt_of(place(self.cache, PARTS, self._key(name)))
        if self.fresh and receipt["versions"] != versions():
            raise FileNotFoundError
        return receipt

    def has(self, name: str) -> bool:
        """Whether a part is there; it may still be damaged."""
        self.names.add(name)
        try:
            return bool(self._receipt(name))
        except (CorruptEntry, OSError):
            return False

    def get(self, name: str) -> bytes | None:
        """A part as it was put; None where it is not there, or damaged."""
        self.names.add(name)
        key = self._key(name)
        try:
            self._receipt(name)
            with opened(self.cache, PARTS, key):
                return (place(self.cache, PARTS, key) / name).read_bytes()
        except (CorruptEntry, OSError):
            return None

    def put(self, name: str, data: bytes) -> None:
        """Keep a part. Raises what `check` does."""
        self.check()
        self.names.add(name)

        def fill(folder: Path) -> None:
            (folder / name).write_bytes(data)

        keep(
            self.cache,
            PARTS,
            self._key(name),
            fill,
            version=self.version,
            warnings=[],
            not_applicable=[],
            good=lambda: self.get(name) == data,
        )

    def drop(self) -> None:
        """Remove the parts that were asked for: the whole is kept, or they are of another recording."""
        for name in self.names:
            if self.has(name):
                remove_aside(place(self.cache, PARTS, self._key(name)), self.cache)
