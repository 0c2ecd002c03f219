"""Entries of a cache, of stages and of a diagnosis: folders with a sealed receipt, whole or not there.

CACHE/STAGE/KEY, KEY the hash of all that the content depends on. An entry is written aside, made durable and renamed;
whoever reads it compares the receipt's key, checks every file, and looks again when it is done.
"""

from __future__ import annotations

import contextlib
import functools
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
    if found["versions"] == versions():
        found["versions"] = versions()  # one object: a campaign has many receipts
    return found


def check_entry(cache: Path, stage: str, key: str, digest_of: Callable[[Path], str] = sha256) -> Receipt:
    """Return the receipt of the entry of this key, all files of which are there and have their SHA-256 by `digest_of`.

    Raises FileNotFoundError where there is none, CorruptEntry where it is damaged or not the one of this key.
    """
    entry = place(cache, stage, key)
    receipt = receipt_of(entry)
    if receipt["key"] != key:
        raise CorruptEntry(f"{entry}: the cache holds the entry of another key there ({receipt['key']})")
    for name, digest in receipt["outputs"].items():
        if digest_of(entry / name) != digest:
            raise CorruptEntry(f"{entry / name}: damaged in the cache")
    with contextlib.suppress(OSError):  # when it was last used, for pruning by age
        os.utime(entry)
    return receipt


@contextlib.contextmanager
def opened(cache: Path, stage: str, key: str) -> Iterator[Receipt]:
    """Give an entry's receipt to a block that reads its files: `check_entry` before the block, stamps after it."""
    entry = place(cache, stage, key)
    before = {name: stamp(entry / name) for name in receipt_of(entry)["outputs"]}
    receipt = check_entry(cache, stage, key)
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
